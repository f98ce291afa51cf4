"""What the command line prints: every result as a page for people and as JSON for machines, side by side.

No mathematics: numbers are only arranged here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from rich.markup import escape
from rich.table import Table

from frischid.comparison import Comparison
from frischid.demo import HIDDEN, STRENGTH, Demo
from frischid.diagnosis import Diagnosis
from frischid.effects import EFFECTS, Effect
from frischid.excitation import Plan
from frischid.identification import Examination, Identification
from frischid.improvement import Step
from frischid.log import Log
from frischid.model import Model
from frischid.reduction import Reduction
from frischid.regressor import Regressor
from frischid.robot import LINK_PARAMETERS, LINK_UNITS, Robot

ORDER = (
    "near reversal", "slow", "fast", "forwards", "backwards", "low angles", "middle angles", "high angles",
    "high load", "high acceleration", "beginning", "end",
)  # fmt: skip


@dataclass(frozen=True)
class Page:
    """A result, ready to print."""

    data: Any
    parts: Sequence[Any]


def robots(names: Sequence[str]) -> Page:
    """Robots that load by name."""
    return Page(sorted(names), [", ".join(sorted(names))])


def robot(machine: Robot, regressor: Regressor, reduction: Reduction) -> Page:
    """Joints and identifiable parameters."""
    limits = machine.limits
    table = _table("joint", "", "kind", "lower", "upper", "speed", "torque", title=f"{machine.name}: {machine.source}")
    joints = []
    for i, name in enumerate(machine.joints):
        kind = "prismatic" if machine.prismatic[i] else "revolute"
        values = [limits.lower[i], limits.upper[i], limits.velocity[i], limits.effort[i]]
        table.add_row(name, str(machine.numbers[name]), kind, *(_figure(x) for x in values))
        keys = ("lower", "upper", "velocity", "effort")
        joints.append(
            {"name": name, "number": machine.numbers[name], "kind": kind}
            | dict(zip(keys, map(_plain, values), strict=True))
        )
    base = [
        {"name": c.name, "expression": e, "unit": c.unit, "joint": c.joint, "effect": c.effect}
        for c, e in zip(reduction.base_columns(), reduction.expressions(), strict=True)
    ]
    columns = [c.name for c in reduction.columns]
    groups = {
        "identifiable_alone": [columns[i] for i in reduction.absolute],
        "identifiable_in_combination": [columns[i] for i in reduction.linear],
        "not_identifiable": [*(columns[i] for i in reduction.none), *machine.known],
    }
    regrouped = _table("base parameter", "stands for", "unit", title=f"{reduction.rank} base parameters")
    for b in base:
        regrouped.add_row(b["name"], b["expression"], b["unit"])
    notes = [f"mimic joint {n} follows {x[0]}" for n, x in machine.mimics.items()]
    notes += [f"locked at {x:.4g} rad (m): {n}" for n, x in machine.locked.items()]
    notes += ["the URDF has no inertials: nominal torques are zero"] * (not machine.nominal.any())
    counts = (
        f"{len(columns) + len(machine.known)} parameters: {len(groups['identifiable_alone'])} identifiable alone, "
        f"{len(groups['identifiable_in_combination'])} only in combination, {len(groups['not_identifiable'])} not "
        "at all"
        f"{f' ({len(machine.known)} of them known)' if machine.known else ''}; "
        f"rank {reduction.rank}, gap {reduction.gap:.2g}"
    )
    units = ", ".join(f"{p} {u}" for p, u in zip(LINK_PARAMETERS, LINK_UNITS, strict=True))
    data = {
        "name": machine.name,
        "source": machine.source,
        "gravity": list(machine.gravity),
        "joints": joints,
        "mimic": list(machine.mimics),
        "locked": dict(machine.locked),
        "effects": [str(e) for e in regressor.effects],
        "rank": reduction.rank,
        "gap": reduction.gap,
        "base_parameters": base,
        **groups,
    }
    return Page(data, [table, *notes, f"each link: {units}", counts, regrouped])


def check(findings: Sequence[Examination]) -> Page:
    """Facts and suspicions of logs."""
    parts: list[Any] = []
    for f in findings:
        facts = f.facts
        channels = ", ".join(("q", *facts["channels"]))
        parts.append(
            f"[bold]{f.source}[/bold]: {facts['samples']} samples, {facts['seconds']:.4g} s at "
            f"{facts['rate_hz']:.4g} Hz, "
            f"{len(facts['joints'])} joints, channels {channels}"
        )
        parts += [f"  {escape(n)}" for n in facts["notes"]]
        parts += _warnings(f.warnings) or ["  nothing suspicious"]
    data = [{"log": f.source, **f.facts, "warnings": list(f.warnings)} for f in findings]
    return Page({"logs": data, "ok": not any(f.warnings for f in findings)}, parts)


def identification(found: Identification, output: str | None) -> Page:
    """Parameters with bounds, and errors."""
    model = found.model
    parts: list[Any] = [_summary(found), *(f"  {escape(n)}" for n in found.notes), parameters(model)]
    parts += _errors(found.comparison) if found.comparison else []
    parts += [_cross_validation(found), *_warnings(found.warnings)]
    if output:
        parts.append(f"model written to {output}")
    return Page(_identified(found), parts)


def _identified(found: Identification) -> dict[str, Any]:
    model, reduction, triangle = found.model, found.reduction, found.simplex
    content = model.to_dict()
    recursion = found.recursion
    return {
        "robot": model.robot.name,
        "samples": found.samples,
        "cutoff_hz": model.lowpass.cutoff,
        "rank": reduction.rank,
        "gap": reduction.gap,
        "condition": model.estimate.condition,
        "estimator": model.estimate.estimator,
        "parameters": content["parameters"],
        "frisch": {
            "same_orthant": triangle.same_orthant,
            "changing_sign": list(triangle.disagreeing),
            "exact": triangle.exact,
        },
        "bbrf": None
        if recursion is None
        else {
            "variant": recursion.variant,
            "windows": recursion.windows,
            "skipped": recursion.skipped,
            "emptied": None if recursion.emptied is None else recursion.emptied._asdict(),
        },
        "cross_validation": found.cross_validation,
        "cross_validated_nrmse": float(np.mean(list(found.cross_validation.values()))),
        "comparison": None if found.comparison is None else found.comparison.to_dict(),
        "notes": list(found.notes),
        "warnings": list(found.warnings),
    }


def parameters(model: Model, truth: Sequence[float] | None = None) -> Table:
    """Table of base parameters: value, standard error, boxes, and the truth where it is known."""
    known = [] if truth is None else ["true"]
    table = _table("parameter", "stands for", "unit", *known, "value", "± s.e.", *(f"{k} box" for k in model.bounds))
    e = model.estimate
    for i, column in enumerate(e.columns):
        boxes = [f"{_figure(b.lower[i])} … {_figure(b.upper[i])}" for b in model.bounds.values()]
        expected = [] if truth is None else [_figure(truth[i])]
        row = [column.name, model.expressions[i], column.unit, *expected, _figure(e.theta[i]), _figure(e.stderr[i])]
        table.add_row(*row, *boxes)
    return table


def comparison(result: Comparison) -> Page:
    """Errors of a model, joint by joint."""
    parts: list[Any] = [*_errors(result), *_where(result), *_what_is_left(result)]
    return Page(result.to_dict(), parts)


def _errors(result: Comparison) -> list[Any]:
    """Errors joint by joint, and what was left out of them."""
    where = ", ".join(result.sources)
    table = _table(
        "joint", "RMSE", "NRMSE", "noise floor", "fit %", "bias", "nominal URDF", "constant", "worst error", "at",
        title=f"measured against model on {where}: mean NRMSE {result.nrmse:.4f}",
    )  # fmt: skip
    for name, j in result.joints.items():
        error = j.worst.measured - j.worst.predicted
        table.add_row(
            name, _figure(j.rmse), f"{j.nrmse:.4f}", f"{j.noise_floor:.4f}", f"{j.fit:.1f}", _figure(j.bias),
            f"{j.nominal:.3f}",
            f"{j.constant:.3f}", _figure(error), f"{j.worst.t:.2f} s",
        )  # fmt: skip
    parts: list[Any] = [table]
    if result.resting > 0:
        parts.append(
            f"{result.resting:.1%} of the torque samples are left out: the joint rests, dry friction is "
            "undetermined there "
            f"(mean NRMSE with them {result.nrmse_with_rest:.4f})"
        )
    return parts


def _where(result: Comparison) -> list[Any]:
    """Joint × condition table of ratios to the joint's average; a star where it is more than chance."""
    conditions = result.residuals.conditions()
    if not conditions:
        return []
    names = list(dict.fromkeys(c.condition for c in conditions))
    order = [n for n in ORDER if n in names]
    table = _table("joint", *order, title="where it fails: error under a condition / the joint's average (* p < 0.01)")
    found = {(c.joint, c.condition): c for c in conditions}
    for joint in result.joints:
        cells = [found.get((joint, n)) for n in order]
        table.add_row(joint, *("–" if c is None else f"{c.ratio:.2f}{'*' * (c.p_value < 0.01)}" for c in cells))
    return [table]


def _what_is_left(result: Comparison) -> list[str]:
    lines = []
    for joint, left in result.residuals.structure().items():
        on = [name for name, p in left.depends_on.items() if p < 0.01]
        if on or not left.white:
            colour = (
                "" if left.white else f"correlated over {left.correlation_time:.2g} s (noise: {left.white_time:.2g} s)"
            )
            lines.append(f"{joint}: the residual is {' and '.join(filter(None, (colour, _depends(on))))}")
    return lines


def _depends(variables: Sequence[str]) -> str:
    return f"not independent of {', '.join(variables)}" if variables else ""


def diagnosis(result: Diagnosis) -> Page:
    """Verdict, ranking and what could be confused."""
    verdicts = {
        "none": "nothing is missing that these logs can show",
        "effect": "an effect is missing",
        "contact": "something touched the robot",
        "unknown": "something is missing, and nothing in the catalogue explains it",
    }
    changed = "the robot changed since it was identified" if result.situation == "changed" else "it was always so"
    head = (
        f"[bold]{verdicts[result.verdict]}[/bold] (taken as: {changed}). Held-out NRMSE {result.error:.4f}, noise "
        "floor "
        f"{result.noise_floor:.4f}."
    )
    parts: list[Any] = [head]
    for c in result.contacts:
        parts.append(f"contact in {c.source} from {c.start:.2f} to {c.stop:.2f} s on {', '.join(c.joints)}; left out")
    table = _table("effect", "where", "NRMSE after", "removes", "gain", "p", "confused with")
    for f in result.findings[:10]:
        where = ", ".join(f.joints) or "robot"
        table.add_row(
            f.effect, where, f"{f.error_after:.4f}", f"{f.share:.0%}", f"{f.gain:.1f}", "< 1e-16" if f.p_value <
            1e-16 else f"{f.p_value:.1e}",
            ", ".join(f.confused_with),
        )  # fmt: skip
    parts.append(table)
    significant = [f for f in result.findings if f.significant]
    if significant:
        best = significant[0]
        found = ", ".join(f"{k} = {v:.4g}" for k, v in best.parameters.items())
        parts.append(f"{best.sentence}. Found: {found}. To confirm: {EFFECTS[best.effect].confirmed_by}.")
    if len(significant) > 1:
        parts.append(
            "The findings below the first are what each would do alone; many vanish once the first is in the model. "
            "`frischid improve` adds them one at a time."
        )
    parts.append(
        "removes: share of the error above the noise floor on its joints; gain: held-out log likelihood less its price"
    )
    return Page(result.to_dict(), parts)


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
        f"NRMSE {step.error_before:.4f} → {step.error_after:.4f} ({_change(step.error_before, step.error_after)}), "
        f"{step.measured_on}"
    )
    return Page(data, [f"{step.effect} added: {fall}", f"effects now: {names}", f"model written to {output}"])


def improvement(steps: Sequence[Step], last: Diagnosis, output: str | None) -> Page:
    """The staircase."""
    table = _table("step", "effect", "where", "NRMSE before", "after", "change", title="the error falls")
    rows = []
    for i, step in enumerate(steps, start=1):
        finding = step.finding
        where = ", ".join(finding.joints) if finding is not None and finding.joints else "robot"
        effect = finding.effect if finding is not None else step.effect.id
        change = _change(step.error_before, step.error_after)
        table.add_row(str(i), effect, where, f"{step.error_before:.4f}", f"{step.error_after:.4f}", change)
        rows.append(
            {"effect": effect, "joints": list(finding.joints) if finding is not None else [],
             "error_before": step.error_before, "error_after": step.error_after}
        )  # fmt: skip
    parts: list[Any] = [table] if steps else ["nothing passes: no effect of the catalogue lowers the held-out error"]
    parts.append(f"noise floor {last.noise_floor:.4f}; last verdict: {last.verdict}")
    if output:
        parts.append(f"model written to {output}")
    return Page({"steps": rows, "noise_floor": last.noise_floor, "last": last.to_dict()}, parts)


def history(model: Model) -> Page:
    """Steps of a model."""
    table = _table("step", "action", "effects", "NRMSE before", "after", "logs")
    for i, event in enumerate(model.history):
        before, after = event.get("error_before"), event.get("error_after", event.get("cross_validated_nrmse"))
        table.add_row(
            str(i), event["action"], ", ".join(event["effects"]), "–" if before is None else f"{before:.4f}",
            "–" if after is None else f"{after:.4f}", str(len(event["logs"])),
        )  # fmt: skip
    return Page([dict(e) for e in model.history], [table])


def _change(before: float, after: float) -> str:
    return f"{100 * (after / before - 1):+.1f} %" if before else "–"


def _hidden(result: Demo) -> list[Any]:
    """The second half: what was hidden, what the diagnosis said, how the error fell."""
    step, best = result.step, result.diagnosis.findings[0]
    found = ", ".join(f"{k} {v:.4g}" for k, v in best.parameters.items())
    values = ", ".join(f"{k} {v:.4g}" for k, v in STRENGTH.items())
    return [
        f"[bold]A hidden effect.[/bold] The same arm with {HIDDEN} ({values}) that the model knows nothing of. "
        "frischid diagnose:",
        *diagnosis(result.diagnosis).parts[:2],
        f"{best.sentence}. Found: {found}.",
        f"Added: held-out NRMSE {step.error_before:.4f} → {step.error_after:.4f} "
        f"({_change(step.error_before, step.error_after)}), noise floor {result.diagnosis.noise_floor:.4f}.",
    ]


def excitation(planned: Plan, output: str, picture: str | None) -> Page:
    """What was planned, and which limits could not be met."""
    lines = [
        f"{planned.criterion} {planned.cost:.4g} after {planned.evaluations:,} evaluations in {planned.seconds:.1f} s",
        *(f"limit not met: {v}" for v in planned.violations),
        *planned.notes,
        f"motion of {planned.trajectory.duration:g} s written to {output}",
    ]
    if picture:
        lines.append(f"picture written to {picture}")
    data = {
        "criterion": planned.criterion,
        "cost": planned.cost,
        "evaluations": planned.evaluations,
        "seconds": planned.seconds,
        "violations": [str(v) for v in planned.violations],
        "notes": list(planned.notes),
        "output": output,
        "picture": picture,
    }
    return Page(data, lines)


def simulated(log: Log, output: str, noisy: bool) -> Page:
    """Where a simulated log went."""
    data = {
        "output": output,
        "samples": len(log),
        "seconds": log.duration,
        "rate_hz": log.rate,
        "joints": list(log.joints),
    }
    exact = "" if noisy else "; no noise (see --noise-q, --noise-tau)"
    return Page(data, [f"{output}: {len(log)} samples of {len(log.joints)} joints, {log.duration:.4g} s{exact}"])


def catalogue() -> Page:
    """Every effect in a line."""
    table = _table("effect", "what", "equation")
    for name, kind in EFFECTS.items():
        table.add_row(name, kind.title, kind.equation)
    return Page([_effect_data(kind) for kind in EFFECTS.values()], [table])


def effect(kind: type[Effect]) -> Page:
    """One effect's page."""
    data = _effect_data(kind)
    lines = [
        f"[bold]{kind.id}[/bold]: {kind.title}",
        f"  equation      {kind.equation}",
        f"  in words      {kind.sentence.format(joint='the joint')}",
        f"  looks like    {kind.looks_like}",
        f"  confused with {', '.join(kind.confused_with)}",
        f"  confirmed by  {kind.confirmed_by}",
        f"  source        {kind.reference}",
        f"  parameters    {', '.join(f'{k} (default {v})' for k, v in data['parameters'].items()) or 'none'}",
    ]
    return Page(data, lines)


def _effect_data(kind: type[Effect]) -> dict[str, Any]:
    return {
        "effect": kind.id,
        "title": kind.title,
        "equation": kind.equation,
        "sentence": kind.sentence,
        "looks_like": kind.looks_like,
        "confused_with": list(kind.confused_with),
        "confirmed_by": kind.confirmed_by,
        "reference": kind.reference,
        "parameters": kind().parameters,
    }


def demo(result: Demo, output: str | None) -> Page:
    """The demonstration, with the truth beside every estimate."""
    found = result.found
    assert found.comparison is not None  # the demonstration always holds a motion out
    within = np.abs(found.model.estimate.theta - result.truth) <= 2 * found.model.estimate.stderr
    story = (
        f"A planar arm with known parameters made two motions of {result.seconds:g} s, recorded at {result.rate:g} "
        "Hz with noisy "
        "positions and torques. The parameters were identified on motion A; motion B was only predicted."
    )
    verdict = (
        f"{int(within.sum())} of {len(within)} true values lie within two standard errors. Held-out error on motion "
        "B: NRMSE "
        f"{found.comparison.nrmse:.4f}, against {found.comparison.nominal:.4f} of the URDF alone and "
        f"{found.comparison.constant:.4f} of a constant torque."
    )
    parts: list[Any] = [story, _summary(found), parameters(found.model, result.truth.tolist())]
    parts += [*comparison(found.comparison).parts, verdict, *_warnings(found.warnings), "", *_hidden(result)]
    if output:
        parts.append(f"model written to {output}")
    data = _identified(found)
    for row, true in zip(data["parameters"], result.truth, strict=True):
        row["true"] = float(true)
    data["hidden"] = {"truth": HIDDEN, "diagnosis": result.diagnosis.to_dict(), "error_after": result.step.error_after}
    return Page(data, parts)


# ---------------------------------------------------------------------- pieces


def _summary(found: Identification) -> str:
    model, e = found.model, found.model.estimate
    cut = "unfiltered" if model.lowpass.cutoff is None else f"low-passed at {model.lowpass.cutoff:g} Hz"
    return (
        f"[bold]{model.robot.name}[/bold]: {found.reduction.rank} base parameters from {found.samples} samples "
        f"({cut}), "
        f"effects {', '.join(str(x) for x in model.effects)}; {e.estimator}, condition {e.condition:.3g}, "
        f"rank gap {found.reduction.gap:.2g}"
    )


def _cross_validation(found: Identification) -> str:
    values = found.cross_validation
    listing = ", ".join(f"{n} {x:.4f}" for n, x in values.items())
    return f"cross-validated NRMSE on stretches left out of the fit: {np.mean(list(values.values())):.4f} ({listing})"


def _warnings(warnings: Sequence[str]) -> list[str]:
    return [f"[yellow]warning:[/yellow] {escape(w)}" for w in warnings]


def _table(*columns: str, title: str | None = None) -> Table:
    table = Table(title=title, title_justify="left", header_style="bold", box=None, pad_edge=False)
    words = {
        "joint",
        "where",
        "confused with",
        "action",
        "effects",
        "parameter",
        "base parameter",
        "stands for",
        "unit",
        "kind",
        "effect",
        "what",
        "equation",
    }
    for column in columns:
        table.add_column(column, justify="left" if column in words else "right", overflow="fold")
    return table


def _figure(x: float) -> str:
    return "–" if not np.isfinite(x) else f"{x:.4g}"


def _plain(x: float) -> float | None:
    return float(x) if np.isfinite(x) else None
