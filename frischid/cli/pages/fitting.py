"""Robots, checks, identifications and comparisons, as pages."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from rich.markup import escape
from rich.table import Table

from frischid.cli.pages.page import Page, depends, figure, plain, table_of, warning_lines
from frischid.estimators.urdf_prior import PriorChoice
from frischid.model.comparison import Comparison
from frischid.model.identification import Identification
from frischid.model.model import Model
from frischid.regression.base_parameters import Reduction
from frischid.regression.regressor import Regressor
from frischid.robot.robot import LINK_PARAMETERS, LINK_UNITS, Robot

ORDER = (
    "near reversal", "slow", "fast", "forwards", "backwards", "low angles", "middle angles", "high angles",
    "high load", "high acceleration", "beginning", "end",
)  # fmt: skip


def robots(names: Sequence[str]) -> Page:
    """Robots that load by name."""
    return Page(sorted(names), [", ".join(sorted(names))])


def robot(machine: Robot, regressor: Regressor, reduction: Reduction) -> Page:
    """Joints and identifiable parameters."""
    limits = machine.limits
    table = table_of(
        "joint", "", "kind", "lower", "upper", "speed", "torque", title=f"{machine.name}: {machine.source}"
    )
    joints = []
    for i, name in enumerate(machine.joints):
        kind = "prismatic" if machine.prismatic[i] else "revolute"
        values = [limits.lower[i], limits.upper[i], limits.velocity[i], limits.effort[i]]
        table.add_row(name, str(machine.numbers[name]), kind, *(figure(x) for x in values))
        keys = ("lower", "upper", "velocity", "effort")
        joints.append(
            {"name": name, "number": machine.numbers[name], "kind": kind}
            | dict(zip(keys, map(plain, values), strict=True))
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
    regrouped = table_of("base parameter", "stands for", "unit", title=f"{reduction.rank} base parameters")
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


def identification(found: Identification, output: str | None) -> Page:
    """Parameters with bounds, and errors."""
    model = found.model
    parts: list[Any] = [summary(found), *(f"  {escape(n)}" for n in found.notes), parameters(model)]
    parts += error_tables(found.comparison) if found.comparison else []
    parts += [cross_validation(found), *warning_lines(found.warnings)]
    if output:
        parts.append(f"model written to {output}")
    return Page(identified(found), parts)


def identified(found: Identification) -> dict[str, Any]:
    """An identification as plain JSON values."""
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
        "prior": None if found.prior is None else _prior(found.prior),
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


def _prior(choice: PriorChoice) -> dict[str, Any]:
    """Whether a prior was used, and what cross-validation said of each strength."""
    errors = {f"{strength:g}": plain(error) for strength, error in choice.errors.items()}
    return {"used": choice.prior is not None, "strength": choice.strength, "cross_validated_nrmse": errors}


def parameters(model: Model, truth: Sequence[float] | None = None) -> Table:
    """Table of base parameters: value, standard error, boxes, and the truth where it is known."""
    known = [] if truth is None else ["true"]
    e = model.estimate
    shares = [] if e.from_data is None else ["from data"]
    boxed = (f"{k} box" for k in model.bounds)
    table = table_of("parameter", "stands for", "unit", *known, "value", "± s.e.", *shares, *boxed)
    for i, column in enumerate(e.columns):
        boxes = [f"{figure(b.lower[i])} … {figure(b.upper[i])}" for b in model.bounds.values()]
        expected = [] if truth is None else [figure(truth[i])]
        row = [column.name, model.expressions[i], column.unit, *expected, figure(e.theta[i]), figure(e.stderr[i])]
        share = [] if e.from_data is None else [f"{e.from_data[i]:.0%}"]
        table.add_row(*row, *share, *boxes)
    return table


def comparison(result: Comparison) -> Page:
    """Errors of a model, joint by joint."""
    parts: list[Any] = [*error_tables(result), *_where(result), *_what_is_left(result)]
    return Page(result.to_dict(), parts)


def error_tables(result: Comparison) -> list[Any]:
    """Errors joint by joint, and what was left out of them."""
    where = ", ".join(result.sources)
    table = table_of(
        "joint", "RMSE", "NRMSE", "noise floor", "fit %", "bias", "nominal URDF", "constant", "worst error", "at",
        title=f"measured against model on {where}: mean NRMSE {result.nrmse:.4f}",
    )  # fmt: skip
    for name, j in result.joints.items():
        error = j.worst.measured - j.worst.predicted
        table.add_row(
            name, figure(j.rmse), f"{j.nrmse:.4f}", f"{j.noise_floor:.4f}", f"{j.fit:.1f}", figure(j.bias),
            f"{j.nominal:.3f}",
            f"{j.constant:.3f}", figure(error), f"{j.worst.t:.2f} s",
        )  # fmt: skip
    parts: list[Any] = [table]
    if result.standstill > 0:
        parts.append(
            f"{result.standstill:.1%} of the torque samples are left out: the joint rests, dry friction is "
            "undetermined there "
            f"(mean NRMSE with them {result.nrmse_with_standstill:.4f})"
        )
    return parts


def _where(result: Comparison) -> list[Any]:
    """Joint × condition table of ratios to the joint's average; a star where it is more than chance."""
    conditions = result.residuals.conditions()
    if not conditions:
        return []
    names = list(dict.fromkeys(c.condition for c in conditions))
    order = [n for n in ORDER if n in names]
    table = table_of(
        "joint", *order, title="where it fails: error under a condition / the joint's average (* p < 0.01)"
    )
    found = {(c.joint, c.condition): c for c in conditions}
    for joint in result.joints.names:
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
            lines.append(f"{joint}: the residual is {' and '.join(filter(None, (colour, depends(on))))}")
    return lines


def summary(found: Identification) -> str:
    """One sentence on what was fitted."""
    model, e = found.model, found.model.estimate
    cut = "unfiltered" if model.lowpass.cutoff is None else f"low-passed at {model.lowpass.cutoff:g} Hz"
    return (
        f"[bold]{model.robot.name}[/bold]: {found.reduction.rank} base parameters from {found.samples} samples "
        f"({cut}), "
        f"effects {', '.join(str(x) for x in model.effects)}; {e.estimator}, condition {e.condition:.3g}, "
        f"rank gap {found.reduction.gap:.2g}"
    )


def cross_validation(found: Identification) -> str:
    """Cross-validated error of each joint, in a line."""
    values = found.cross_validation
    listing = ", ".join(f"{n} {x:.4f}" for n, x in values.items())
    return f"cross-validated NRMSE on stretches left out of the fit: {np.mean(list(values.values())):.4f} ({listing})"
