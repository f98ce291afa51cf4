"""Diagnoses and the steps they lead to, as pages."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from frischid.cli.pages.page import Page, change, quantities, table_of
from frischid.diagnosis.diagnosis import Diagnosis
from frischid.diagnosis.findings import HOW_RANKED
from frischid.diagnosis.improvement import Step
from frischid.effects import EFFECTS
from frischid.model.model import Model


def diagnosis(result: Diagnosis) -> Page:
    """Verdict, ranking and what could be confused."""
    changed = "the robot changed since it was identified" if result.situation == "changed" else "it was always so"
    head = (
        f"[bold]{verdict_of(result)}[/bold] (taken as: {changed}). Held-out NRMSE {result.error:.4f} (all these "
        f"logs, each part predicted from the others), noise floor {result.noise_floor:.4f}."
    )
    parts: list[Any] = [head]
    for c in result.contacts:
        parts.append(f"contact in {c.source} from {c.start:.2f} to {c.stop:.2f} s on {', '.join(c.joints)}; left out")
    table = table_of("effect", "where", "NRMSE after", "explains", "gain", "p", "confused with")
    for f in result.findings[:10]:
        where = ", ".join(f.joints) or "robot"
        table.add_row(
            f.effect, where, f"{f.error_after:.4f}", f"{f.share:.0%}", f"{f.gain:.1f}", "< 1e-16" if f.p_value <
            1e-16 else f"{f.p_value:.1e}",
            ", ".join(f.confused_with),
        )  # fmt: skip
    parts.append(table)
    parts += [f"{note[:1].upper()}{note[1:]}." for note in result.notes[1:]]
    significant = [f for f in result.findings if f.significant]
    if significant:
        best = significant[0]
        found = quantities(best.found(result.validator.model.robot))
        confirm = f" Found: {found}. To confirm: {EFFECTS[best.effect].confirmed_by}." if best.effect in EFFECTS else ""
        parts.append(f"{best.sentence}.{confirm}")
    if len(significant) > 1:
        parts.append(f"{HOW_RANKED} `frischid improve` adds them one at a time.")
    parts.append(
        "explains: share of the error above the sensor noise on its joints; gain: held-out log likelihood less its "
        "price"
    )
    return Page(result.to_dict(), parts)


def verdict_of(result: Diagnosis) -> str:
    """The verdict in words."""
    return {
        "none": result.remainder,
        "effect": "an effect is missing",
        "contact": "something touched the robot",
        "unknown": "something is missing, and nothing in the catalogue explains it",
    }[result.verdict]


def added(step: Step, output: str) -> Page:
    """Error before and after."""
    names = ", ".join(str(e) for e in step.model.effects)
    data = {
        "effect": str(step.effect),
        "error_before": step.error_before,
        "error_after": step.error_after,
        "model": output,
    }
    fall = (
        f"NRMSE {step.error_before:.4f} → {step.error_after:.4f} ({change(step.error_before, step.error_after)}), "
        f"{step.measured_on}"
    )
    return Page(data, [f"{step.effect} added: {fall}", f"effects now: {names}", f"model written to {output}"])


def improvement(steps: Sequence[Step], last: Diagnosis, output: str | None) -> Page:
    """The staircase."""
    table = table_of("step", "effect", "where", "NRMSE before", "after", "change", title="the error falls")
    rows = []
    for i, step in enumerate(steps, start=1):
        finding = step.finding
        where = ", ".join(finding.joints) if finding is not None and finding.joints else "robot"
        effect = finding.effect if finding is not None else step.effect.id
        fall = change(step.error_before, step.error_after)
        table.add_row(str(i), effect, where, f"{step.error_before:.4f}", f"{step.error_after:.4f}", fall)
        rows.append(
            {"effect": effect, "joints": list(finding.joints) if finding is not None else [],
             "error_before": step.error_before, "error_after": step.error_after}
        )  # fmt: skip
    parts: list[Any] = [table] if steps else []
    parts.append(f"noise floor {last.noise_floor:.4f}; {verdict_of(last)}")
    if output:
        parts.append(f"model written to {output}")
    elif steps:
        parts.append("no model was written: -o FILE keeps the improved one")
    return Page(
        {"steps": rows, "noise_floor": last.noise_floor, "criteria": last.criteria.to_dict(), "last": last.to_dict()},
        parts,
    )


def history(model: Model) -> Page:
    """Steps of a model."""
    table = table_of("step", "action", "effects", "NRMSE before", "after", "measured on", "logs fitted")
    for i, event in enumerate(model.history):
        before, after, where = event.get("error_before"), event.get("error_after"), event.get("measured_on", "")
        if after is None and (after := event.get("held_out_nrmse")) is not None:
            where = "held out"
        elif after is None:
            after, where = event.get("cross_validated_nrmse"), "cross-validated on the fitted logs"
        table.add_row(
            str(i), event["action"], ", ".join(event["effects"]), "–" if before is None else f"{before:.4f}",
            "–" if after is None else f"{after:.4f}", where, str(len(event["logs"])),
        )  # fmt: skip
    return Page([dict(e) for e in model.history], [table])
