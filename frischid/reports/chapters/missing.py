"""Missing effects: a card for every significant finding with its evidence, then the whole ranking."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from frischid import figures
from frischid.core.text import listed, percent, sentence
from frischid.diagnosis.clause import missing
from frischid.diagnosis.effect_curves import shape_of
from frischid.diagnosis.findings import Finding
from frischid.diagnosis.result import Diagnosis
from frischid.diagnosis.rivals import HOW_RANKED, IN_WORDS, command_for, pair_of, sentence_of
from frischid.effects import EFFECTS
from frischid.figures.style import number
from frischid.reports.chapters.table import Table
from frischid.reports.commands import alone
from frischid.reports.study import Study

FINDING_CARDS = 6  # findings with a card; the others stand in the ranking
RANK_CAPTION = (
    "error: its change with this effect alone, cross-validated; explains: share of the error above the sensor noise on "
    "its joints, – where that error is negligible; gain: of log likelihood; probability: that the model lacks this "
    "effect and no more probable answer is right, as learnt from simulated robots; it is small for an effect beside a "
    "first one that is right"
)
LEAST_TOLD = 0.005  # probability
RANK_HEADINGS = ("effect", "where", "error", "explains", "gain", "probability", "confused with")


def content(study: Study, model_path: str) -> dict[str, Any]:
    """Values for the template."""
    diagnosis = study.diagnosis
    if diagnosis is None:
        return {"diagnosis": None}
    significant, robot = [f for f in diagnosis.findings if f.significant], study.model.robot
    said, shared = missing(diagnosis), sentence_of(diagnosis.findings, diagnosis.probabilities, robot)
    pair = pair_of(diagnosis.findings, diagnosis.probabilities) if shared in diagnosis.notes else []
    contacts = [
        f"Contact in {Path(c.source).name} {c.when} on {listed(c.joints)}: left out" for c in diagnosis.contacts
    ]
    return {
        "diagnosis": diagnosis,
        "missing": said,
        "contacts": contacts,
        "chances": [f"{IN_WORDS.get(k, k)} {percent(p)}" for k, p in _likely(diagnosis)],
        "notes": [
            sentence(study.brief(note)) for note in diagnosis.notes[1:] if note != shared and f"; {note}" not in said
        ],
        "refused": study.refusals,
        "separate": command_for(pair, robot, alone),
        "separated": listed([f.effect for f in pair]),
        "how_ranked": HOW_RANKED if len(significant) > 1 else "",
        "cards": _cards(study, significant[:FINDING_CARDS], {frozenset(f.effect for f in pair)}),
        "ranking": Table(
            RANK_HEADINGS, [_row(f) for f in diagnosis.by_verdict if f.members], words=2, caption=RANK_CAPTION
        ),
    }


def _likely(diagnosis: Diagnosis) -> list[tuple[str, float]]:
    """Hypotheses of at least half a percent, most probable first."""
    told = ((name, p) for name, p in diagnosis.probabilities.items() if p >= LEAST_TOLD)
    return sorted(told, key=lambda x: -x[1])


def _row(f: Finding) -> list[str]:
    evidence = [f.change.replace("-", "−"), f.explains, number(f.gain, 3), percent(f.probability)]
    return [f.effect, ", ".join(f.joints) or "robot", *evidence, ", ".join(f.confused_with) or "–"]


def _cards(study: Study, findings: Sequence[Finding], told: set[frozenset[str]]) -> list[dict[str, Any]]:
    """The findings; a motion that separates two effects is proposed once, and not where `told` has the pair."""
    cards = []
    for finding in findings:
        other = next((x for x in finding.confused_with if frozenset((finding.effect, x)) not in told), "")
        told.add(frozenset((finding.effect, other)))
        cards.append(_card(study, finding, other))
    return cards


def _card(study: Study, finding: Finding, other: str) -> dict[str, Any]:
    """A finding, and the effect from which a motion should tell it; only its sentence where no effect is known."""
    card: dict[str, Any] = {
        "sentence": sentence(finding.sentence, finding.joints),
        "change": f"error {finding.change}",
        "facts": [],
        "separate": "",
        "shape": None,
    }
    kind = EFFECTS.get(finding.effect)
    if kind is None:
        return card
    values = finding.found(study.model.robot)
    said = ((k, x if isinstance(x, str | bool) else number(x), unit) for k, x, unit in values)
    found = ", ".join(f"{k} = {x} {unit}".rstrip() for k, x, unit in said)
    found += f" ({numbers})" if (numbers := finding.joint_numbers(study.model.robot)) else ""
    confused = listed(finding.confused_with) or "no other effect on these logs"
    general = f". On other logs: {listed(kind.confused_with)}" if kind.confused_with else ""
    if study.diagnosis is not None:
        rival = [f for f in study.diagnosis.findings if f.effect == other and f.members]
        card["separate"] = command_for([finding, *rival], study.model.robot, alone)
    plan = f" To plan a motion that distinguishes it from {other}:" if card["separate"] else ""
    above = "the error above the sensor noise on its joints"
    share = f"{above} is negligible" if finding.negligible else f"explains {finding.explains} of {above}"
    evidence = (
        f"probability that this is the cause {percent(finding.probability)}; error {finding.change}, "
        f"cross-validated; {share}; log likelihood gained {finding.gain:.0f}"
    )
    card["facts"] = [
        ("Evidence", evidence),
        ("Effect", kind.title if kind.title.startswith(f"{kind.id}:") else f"{finding.effect}: {kind.title}"),
        ("Found", found),
        ("Could also be", f"{confused}{general}"),
        ("To be sure", f"{kind.confirmed_by}.{plan}"),
    ]
    shape = shape_of(study.diagnosis, finding, study.prediction) if study.diagnosis is not None else None
    if shape is not None:
        card["shape"] = figures.shape(shape, kind.title, study.sliding(shape.joint))
    return card
