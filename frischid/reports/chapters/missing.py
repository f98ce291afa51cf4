"""Missing effects: a card for every significant finding with its evidence, then the whole ranking."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from frischid import figures
from frischid.core.text import listed
from frischid.diagnosis.effect_curves import shape_of
from frischid.diagnosis.findings import HOW_RANKED, Finding
from frischid.effects import EFFECTS
from frischid.figures.style import number
from frischid.reports.chapters.table import Table
from frischid.reports.study import Study, missing, opened

FINDING_CARDS = 6  # findings with a card; the others stand in the ranking
RANK_CAPTION = (
    "error: its change with this effect alone, cross-validated; explains: share of the error above the sensor noise on "
    "its joints; gain: of log likelihood; p: probability of such a gain by chance. Ranked by the rise of the "
    "error when one effect is taken out of a model that has all of them: error that several effects explain equally "
    "well does not count"
)
RANK_HEADINGS = ("effect", "where", "error", "explains", "gain", "p", "confused with")
TINY = 1e-15  # probability below which only its bound is printed


def content(study: Study, model_path: str) -> dict[str, Any]:
    """Values for the template."""
    diagnosis = study.diagnosis
    if diagnosis is None:
        return {"diagnosis": None}
    significant = [f for f in diagnosis.findings if f.significant]
    contacts = [
        f"Contact in {Path(c.source).name} from {c.start:.2f} to {c.stop:.2f} s on {listed(c.joints)}: left out"
        for c in diagnosis.contacts
    ]
    return {
        "diagnosis": diagnosis,
        "missing": missing(diagnosis),
        "contacts": contacts,
        "notes": [note[:1].upper() + note[1:] for note in diagnosis.notes[1:]],
        "how_ranked": HOW_RANKED if len(significant) > 1 else "",
        "cards": [_card(study, finding) for finding in significant[:FINDING_CARDS]],
        "ranking": Table(
            RANK_HEADINGS, [_row(f) for f in diagnosis.findings if f.members], words=2, caption=RANK_CAPTION
        ),
    }


def _row(f: Finding) -> list[str]:
    p = "< 10⁻¹⁵" if f.p_value < TINY else number(f.p_value, 2)
    evidence = [f.change, f"{100 * f.share:.0f} %", number(f.gain, 3), p]
    return [f.effect, ", ".join(f.joints) or "robot", *evidence, ", ".join(f.confused_with) or "–"]


def _card(study: Study, finding: Finding) -> dict[str, Any]:
    """A finding; only its sentence where the catalogue has no such effect."""
    card: dict[str, Any] = {
        "sentence": opened(finding.sentence, finding.joints),
        "change": f"error {finding.change}",
        "facts": [],
        "separate": "",
        "shape": None,
    }
    kind = EFFECTS.get(finding.effect)
    if kind is None:
        return card
    found = ", ".join(f"{k} = {number(x)} {unit}".rstrip() for k, x, unit in finding.found(study.model.robot))
    confused = listed(finding.confused_with) or "nothing on these logs"
    general = f" (in general: {listed(kind.confused_with)})" if kind.confused_with else ""
    other = next(iter((*finding.confused_with, *kind.confused_with)), "")
    plan = f" To plan a motion that distinguishes it from {other}:" if other else ""
    p = "below 10⁻¹⁵" if finding.p_value < TINY else number(finding.p_value, 2)
    evidence = (
        f"error {finding.change}, cross-validated; explains "
        f"{100 * finding.share:.0f} % of the error above the sensor noise on its joints; log likelihood gained "
        f"{finding.gain:.0f}, probability by chance {p}"
    )
    card["facts"] = [
        ("Evidence", evidence),
        ("Effect", f"{finding.effect}: {kind.title}"),
        ("Found", found),
        ("Could also be", f"{confused}{general}"),
        ("To be sure", f"{kind.confirmed_by}.{plan}"),
    ]
    if other:
        card["separate"] = f"frischid excite ROBOT --separate {finding.effect},{other} -o motion.csv"
    shape = shape_of(study.diagnosis, finding, study.prediction) if study.diagnosis is not None else None
    if shape is not None:
        card["shape"] = figures.shape(shape, kind.title, finding.joints, study.sliding(shape.joint))
    return card
