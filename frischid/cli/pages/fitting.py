"""Identifications, as pages."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rich.markup import escape
from rich.table import Table

from frischid.cli.pages.comparing import error_tables
from frischid.cli.pages.page import Page, figure, headline_line, table_of, warning_lines
from frischid.model.identification import Identification
from frischid.model.identification_bounds import NO_INFORMATION, without_information
from frischid.model.model import Model


def identification(found: Identification, output: str | None) -> Page:
    """Parameters with bounds, and errors."""
    model = found.model
    parts: list[Any] = [
        summary(found),
        *([] if found.headline is None else [headline_line(found.headline)]),
        *(f"  {escape(n)}" for n in found.notes),
        parameters(model),
    ]
    parts += error_tables(found.comparison) if found.comparison else []
    parts += [cross_validation(found), *warning_lines(found.warnings)]
    if output:
        parts.append(f"model written to {output}")
    return Page(identified(found), parts, found.alarms)


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
        "prior": content["prior"],
        "frisch": None
        if triangle is None
        else {
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
        "headline": None if found.headline is None else found.headline.to_dict(),
        "cross_validation": found.cross_validation,
        "comparison": None if found.comparison is None else found.comparison.to_dict(),
        "alarms": [alarm.to_dict() for alarm in found.alarms],
        "notes": list(found.notes),
        "warnings": list(found.warnings),
    }


def parameters(model: Model, truth: Sequence[float] | None = None) -> Table:
    """Table of base parameters: value, standard error, boxes, and the truth where it is known."""
    known = [] if truth is None else ["true"]
    e = model.estimate
    shares = [] if e.from_data is None else ["from logs"]
    boxed = (f"{k} box" for k in model.bounds)
    silent = without_information(model.bounds)
    table = table_of("parameter", "stands for", "unit", *known, "value", "± s.e.", *shares, *boxed)
    for i, column in enumerate(e.columns):
        boxes = [
            NO_INFORMATION if silent[method][i] else f"{figure(b.lower[i])} … {figure(b.upper[i])}"
            for method, b in model.bounds.items()
        ]
        expected = [] if truth is None else [figure(truth[i])]
        row = [column.name, model.expressions[i], column.unit, *expected, figure(e.theta[i]), figure(e.stderr[i])]
        share = [] if e.from_data is None else [f"{e.from_data[i]:.0%}"]
        table.add_row(*row, *share, *boxes)
    return table


def summary(found: Identification) -> str:
    """One sentence on the fit."""
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
    listing = ", ".join(f"{n} {x:.4f}" for n, x in found.cross_validation.items())
    return f"joint by joint, cross-validated on stretches left out of the fit: {listing}"
