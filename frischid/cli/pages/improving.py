"""Diagnoses and the steps they lead to, as pages."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from frischid.cli.pages.page import Page, change, quantities, table_of
from frischid.diagnosis.diagnosis import Diagnosis
from frischid.diagnosis.findings import HOW_RANKED
from frischid.diagnosis.history import measured_on, selection_errors, test_errors
from frischid.diagnosis.improvement import Step
from frischid.effects import EFFECTS
from frischid.model.model import Model


def diagnosis(result: Diagnosis) -> Page:
    """Verdict, ranking and what could be confused."""
    changed = "the robot changed since it was identified" if result.situation == "changed" else "it was always so"
    head = (
        f"[bold]{verdict_of(result)}[/bold] (taken as: {changed}). Cross-validated NRMSE {result.error:.4f} "
        f"(each part of these logs predicted from the others), noise floor {result.noise_floor:.4f}."
    )
    parts: list[Any] = [head, *_on_test_logs(result)]
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
        "explains: share of the error above the sensor noise on its joints; gain: cross-validated log "
        "likelihood less its price"
    )
    return Page(result.to_dict(), parts)


def _on_test_logs(result: Diagnosis) -> list[str]:
    """The model's error on the test logs, where there are any."""
    if result.test_error is None:
        return []
    return [f"On the test logs (--valid) the model as it is has NRMSE {result.test_error:.4f}; they decide nothing."]


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
        "measured_on": step.measured_on,
        "test_before": step.test_before,
        "test_after": step.test_after,
        "model": output,
    }
    fall = (
        f"NRMSE {step.error_before:.4f} → {step.error_after:.4f} ({change(step.error_before, step.error_after)}), "
        f"{step.measured_on}"
    )
    return Page(
        data,
        [
            f"{step.effect} added: {fall}",
            *_fall_on_test_logs(step),
            f"effects now: {names}",
            f"model written to {output}",
        ],
    )


def _fall_on_test_logs(step: Step) -> list[str]:
    """The error on the test logs before and after, where there are any."""
    if step.test_before is None or step.test_after is None:
        return []
    fall = change(step.test_before, step.test_after)
    return [f"on the test logs (--valid): NRMSE {step.test_before:.4f} → {step.test_after:.4f} ({fall})"]


def improvement(steps: Sequence[Step], last: Diagnosis, output: str | None) -> Page:
    """The staircase."""
    tested = any(step.test_after is not None for step in steps)
    headings = ("step", "effect", "where", "NRMSE before", "after", "change", *(["on test logs"] if tested else []))
    how = ", ".join(dict.fromkeys(step.measured_on for step in steps))
    table = table_of(*headings, title=f"the error falls ({how})")
    rows = []
    for i, step in enumerate(steps, start=1):
        finding = step.finding
        where = ", ".join(finding.joints) if finding is not None and finding.joints else "robot"
        effect = finding.effect if finding is not None else step.effect.id
        fall = change(step.error_before, step.error_after)
        test = [f"{step.test_before:.4f} → {step.test_after:.4f}"] if step.test_after is not None else []
        table.add_row(str(i), effect, where, f"{step.error_before:.4f}", f"{step.error_after:.4f}", fall, *test)
        rows.append(
            {"effect": effect, "joints": list(finding.joints) if finding is not None else [],
             "error_before": step.error_before, "error_after": step.error_after, "measured_on": step.measured_on,
             "test_before": step.test_before, "test_after": step.test_after}
        )  # fmt: skip
    parts: list[Any] = [table] if steps else [f"no effect was added; cross-validated NRMSE {last.error:.4f}"]
    parts.append(f"noise floor {last.noise_floor:.4f}; {verdict_of(last)}")
    parts += [f"{note[:1].upper()}{note[1:]}." for note in last.notes if "was not added: " in note]
    if output:
        parts.append(f"model written to {output}")
    elif steps:
        parts.append("no model was written: -o FILE keeps the improved one")
    return Page(
        {
            "steps": rows,
            "noise_floor": last.noise_floor,
            "test_error": last.test_error,
            "criteria": last.criteria.to_dict(),
            "last": last.to_dict(),
        },
        parts,
    )


def history(model: Model) -> Page:
    """Steps of a model."""
    table = table_of("step", "action", "effects", "NRMSE before", "after", "measured on", "on test logs", "logs fitted")
    for i, event in enumerate(model.history):
        errors = ["–" if x is None else f"{x:.4f}" for x in selection_errors(event)]
        test = " → ".join(f"{x:.4f}" for x in test_errors(event)) or "–"
        effects = ", ".join(event["effects"])
        table.add_row(str(i), event["action"], effects, *errors, measured_on(event), test, str(len(event["logs"])))
    return Page([dict(e) for e in model.history], [table])
