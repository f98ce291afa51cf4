"""Diagnoses, and the steps that add their findings, as pages."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rich.markup import escape

from frischid.cli.narrow import Command
from frischid.cli.pages.page import Page, change, headline_line, quantities, table_of
from frischid.core.text import percent, sentence
from frischid.diagnosis.clause import missing, on_condition
from frischid.diagnosis.findings import Finding
from frischid.diagnosis.model_notes import TOUCHED, delay_in
from frischid.diagnosis.motion_space import MotionDiagnosis
from frischid.diagnosis.result import Diagnosis
from frischid.diagnosis.rivals import HOW_RANKED, IN_WORDS
from frischid.diagnosis.step import Step
from frischid.effects import EFFECTS
from frischid.export.reach import Reach, in_words, reach_of
from frischid.model.headline import error_after, headline_of
from frischid.model.model import Model

MOST_LISTED, FEWEST_LISTED = 10, 3
SMALLEST_SHOWN = 0.005  # probability; a smaller one is printed as 0 %


def diagnosis(result: Diagnosis, moved: MotionDiagnosis | None = None) -> Page:
    """Verdict, ranking, effects that these data cannot distinguish, and the simulated motion of each finding."""
    changed = "changed since it was identified" if result.situation == "changed" else "has not changed"
    verdict = on_condition(result, sentence(verdict_of(result)))
    head = f"[bold]{verdict}[/bold] (assumed: the robot {changed})."
    parts: list[Any] = [head, headline_line(result.headline)]
    for c in result.contacts:
        parts.append(f"contact in {c.source} {c.when} on {', '.join(c.joints)}; left out")
    table = table_of("effect", "where", "error", "explains", "gain", "probability", "confused with")
    listed = shown(result)
    for f in listed:
        where = ", ".join(f.joints) or "robot"
        evidence = (f.change, f.explains, f"{f.gain:.1f}", percent(f.probability))
        table.add_row(f.effect, where, *evidence, ", ".join(f.confused_with))
    if result.fit is None:
        parts += [part for note in result.notes[1:] for part in noted(note)]
        return Page(result.to_dict(), parts, result.headline.alarms)
    parts.append(table)
    parts.append(f"Probability that something else is the cause: {elsewhere(result, listed)}.")
    parts += [part for note in result.notes[1:] for part in noted(note)]
    significant = [f for f in result.findings if f.significant]
    if significant:
        best = significant[0]
        robot = result.validator.model.robot
        numbers = f" ({said})" if (said := best.joint_numbers(robot)) else ""
        found = f"{quantities(best.found(robot))}{numbers}"
        confirm = f" Found: {found}. To confirm: {EFFECTS[best.effect].confirmed_by}." if best.effect in EFFECTS else ""
        parts.append(f"{sentence(best.sentence, best.joints)}.{confirm}")
    if len(significant) > 1:
        parts.append(f"{HOW_RANKED} `frischid improve` adds them one at a time.")
    parts.append(
        "error: change of the mean error with this effect alone, cross-validated on the logs that select; explains: "
        "share of the error above the sensor noise on its joints, – where that error is negligible; gain: rise of the "
        "log likelihood, less a price per parameter; probability: that the model lacks this effect and no more "
        "probable answer is right, as learnt from simulated robots; it is small for an effect beside a first one that "
        "is right"
    )
    if moved is None:
        return Page(result.to_dict(), parts, result.headline.alarms)
    return Page({**result.to_dict(), "simulated": moved.to_dict()}, parts + simulated(moved), result.headline.alarms)


def simulated(moved: MotionDiagnosis) -> list[Any]:
    """Errors of the simulated positions, without an effect and with each finding."""
    how = "under the model's controller" if moved.closed else "under the recorded torque alone"
    on = "test logs" if moved.tested else "logs that the models were fitted to"
    title = f"simulated positions over {moved.horizon:g} s {how}: rms error in rad (m), {on}"
    table = table_of("effect", "change", "joint by joint, without and with the effect", title=title)
    for f in moved.findings:
        named = [n for n in moved.joints if n in f.finding.joints] or list(moved.joints)
        errors = (
            ", ".join(f"{n} {moved.joints[n]:.2g} → {f.joints[n]:.2g}" for n in named) if f.joints else "not simulated"
        )
        table.add_row(f.finding.effect, change(1.0, f.ratio) if f.joints else "–", errors)
    each = ", ".join(f"{n} {x:.2g}" for n, x in moved.joints.items())
    refused = [f"{f.finding.effect}: {f.refused}." for f in moved.findings if f.refused]
    return [
        table,
        "change: how the simulated error changes with this effect, as the geometric mean over all joints. Errors "
        f"without any further effect: {each}",
        *refused,
    ]


def shown(result: Diagnosis) -> list[Finding]:
    """The findings that are worth a row: at most ten, those without any evidence only to make three."""
    # The first line has the verdict.
    effects = [f for f in result.by_verdict if f.effect != result.verdict][:MOST_LISTED]
    return [f for k, f in enumerate(effects) if k < FEWEST_LISTED or f.gain > 0 or f.probability >= SMALLEST_SHOWN]


def elsewhere(result: Diagnosis, listed: Sequence[Finding]) -> str:
    """Probabilities of the hypotheses that are no effect, and of all findings that are not `listed`, in words."""
    names = {f.effect for f in listed}
    others = sum(p for name, p in result.probabilities.items() if name not in names and name not in IN_WORDS)
    told = [f"{words} {percent(result.probabilities[name])}" for name, words in IN_WORDS.items()]
    return ", ".join([*told, *([f"another effect {percent(others)}"] if others >= SMALLEST_SHOWN else [])])


def noted(note: str) -> list[Any]:
    """A note as a sentence; a command at its end stands on lines of its own, to be copied."""
    text, _, command = note.removesuffix("`").partition(": `frischid ")
    if not command or not note.endswith("`"):
        return [f"{escape(sentence(note))}."]
    return [f"{escape(sentence(text))}:", Command(f"frischid {command}")]


def verdict_of(result: Diagnosis) -> str:
    """The verdict in words."""
    part = any(f.significant and f.members for f in result.findings)
    return {
        "none": result.remainder,
        "effect": "an effect is missing",
        "several": "several small effects are missing; none of them dominates",
        "contact": "something touched the robot",
        "unknown": "more is missing than any one effect of the catalogue explains"
        + ("; known effects explain a part" if part else ""),
    }[result.verdict]


def added(step: Step, output: str) -> Page:
    """Error before and after."""
    names = ", ".join(str(e) for e in step.model.effects)
    new = ", ".join(step.model.history[-1]["effects"])
    error, reach = step.headline, reach_of(step.model)
    data = {
        "effect": new,
        "headline": None if error is None else error.to_dict(),
        "step": step_errors(step),
        "exports": exports(reach),
        "model": output,
    }
    return Page(
        data,
        [
            f"{new} added: {fall_of(step)}",
            *([] if error is None else [headline_line(error)]),
            f"effects now: {names}",
            in_words(reach),
            f"model written to {output}",
        ],
        () if error is None else error.alarms,
    )


def exports(reach: Sequence[Reach]) -> dict[str, Any]:
    """The part of a model that each format holds, as plain JSON values."""
    return {x.format: x.to_dict() for x in reach}


def step_errors(step: Step) -> dict[str, Any]:
    """Errors before and after a step, as plain JSON values."""
    return {
        "error_before": step.error_before,
        "error_after": step.error_after,
        "measured_on": step.measured_on,
        "test_before": step.test_before,
        "test_after": step.test_after,
    }


def fall_of(step: Step) -> str:
    """The error before and after a step, measured as its headline is."""
    if step.test_before is not None and step.test_after is not None:
        before, after, where = step.test_before, step.test_after, "on the test logs, which decide nothing"
    else:
        before, after, where = step.error_before, step.error_after, step.measured_on
    return f"NRMSE {before:.4f} → {after:.4f} ({change(before, after)}), {where}"


def improvement(steps: Sequence[Step], last: Diagnosis, output: str | None) -> Page:
    """The steps of an improvement with the error before and after each."""
    tested = any(step.test_after is not None for step in steps)
    ways = ["on the test logs" if tested else step.measured_on for step in steps]
    columns = ("step", "effect", "where", "NRMSE before", "after", "change")
    tables = {how: table_of(*columns, title=f"error of each step: {how}") for how in ways}
    rows = []
    for i, step in enumerate(steps, start=1):
        finding = step.finding
        where = ", ".join(finding.joints) if finding is not None and finding.joints else "robot"
        effect = finding.effect if finding is not None else step.effect.id
        before, after = (step.test_before, step.test_after) if tested else (step.error_before, step.error_after)
        if before is not None and after is not None:
            tables[ways[i - 1]].add_row(str(i), effect, where, f"{before:.4f}", f"{after:.4f}", change(before, after))
        joints = list(finding.joints) if finding is not None else []
        rows.append({"effect": effect, "joints": joints, **step_errors(step)})
    parts: list[Any] = [headline_line(last.headline), *(tables.values() if steps else ["no effect was added"])]
    parts.append(f"{missing(last)}.")
    known = delay_in(last.validator.model)
    parts += [f"{sentence(note)}." for note in last.notes if "was not added: " in note or note in {known, TOUCHED}]
    reach = reach_of(last.validator.model)
    if steps:
        parts.append(in_words(reach))
    if output:
        parts.append(f"model written to {output}")
    elif steps:
        parts.append("no model was written; -o FILE saves the improved one")
    return Page(
        {
            "headline": last.headline.to_dict(),
            "steps": rows,
            "exports": exports(reach),
            "criteria": last.criteria.to_dict(),
            "last": last.to_dict(),
        },
        parts,
        last.headline.alarms,
    )


def history(model: Model) -> Page:
    """The model's error, and its steps."""
    last = headline_of(model.history[-1]) if model.history else None
    table = table_of("step", "action", "effects", "NRMSE", "measured", "logs fitted")
    for i, event in enumerate(model.history):
        error = error_after(event)
        found = ("–", "–") if error is None else (f"{error[0]:.4f}", error[1])
        table.add_row(str(i), event["action"], ", ".join(event["effects"]), *found, str(len(event["logs"])))
    data = {
        "headline": None if last is None else last.to_dict(),
        "steps": [dict(event) for event in model.history],
    }
    return Page(data, [*([] if last is None else [headline_line(last)]), table])
