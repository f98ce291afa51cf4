"""Identifications, as pages."""

from __future__ import annotations

import re
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.markup import escape
from rich.table import Table

from frischid.cli.narrow import Command
from frischid.cli.pages.comparing import error_tables, motion_table
from frischid.cli.pages.joint_drives import MEANING, amperes, drives, left_open
from frischid.cli.pages.page import Page, figure, headline_line, table_of, warning_lines
from frischid.core.text import counted, percent
from frischid.estimators.least_squares import ESTIMATOR_TITLES
from frischid.forward.output_error import OutputError
from frischid.logs.log import Log
from frischid.logs.recording import Recording
from frischid.model.alarms import FAULTY_LOG
from frischid.model.drive_parameters import drive_parameters
from frischid.model.headline import headline
from frischid.model.identification import Identification
from frischid.model.identification_bounds import NO_INFORMATION, without_information
from frischid.model.model import Model
from frischid.model.parameters import numbering
from frischid.reports.commands import check_command, excite_command, tested_files, with_tests

HARDLY_KNOWN_NAMED = 6  # parameters in the line that names those that the logs hardly determine


def identification(found: Identification, output: str | None, *, whole: bool = False) -> Page:
    """The error first, then warnings and notes; parameters with bounds on request.

    Parameters
    ----------
    output : str or None
        File of the model.
    whole : bool
        Whether to list the parameters.
    """
    model = found.model
    parts: list[Any] = [] if found.headline is None else [headline_line(found.headline)]
    parts += error_tables(found.comparison) if found.comparison else []
    speeds = [] if found.speed_range is None else [str(found.speed_range)]
    parts += [cross_validation(found), *speeds, *warning_lines(_brief(found, found.warnings)), summary(found)]
    parts += [f"  {escape(n)}" for n in _brief(found, found.notes)]
    if model.controller is not None:
        parts += [drives(model), *warning_lines(left_open(model)), f"  {MEANING}"]
    if found.amperes:
        parts.append(amperes(found.amperes, model.robot))
    if whole:
        parts += _table_of_parameters(model)
    else:
        parts.append(_known(model))
    if output:
        parts += [f"model written to {output}", _next(found, output)]
    return Page(identified(found), parts, found.alarms)


def _known(model: Model) -> str:
    """How many parameters the logs determine, and the names of the first of the others."""
    weak, count = model.estimate.hardly_known, counted(len(model.expressions), "parameter")
    if not weak:
        return f"  the logs determine all {count}: --parameters lists them"
    names = f"{', '.join(weak[:HARDLY_KNOWN_NAMED])}{' ...' * (len(weak) > HARDLY_KNOWN_NAMED)}"
    return f"  the logs hardly determine {len(weak)} of {count} ({escape(names)}): --parameters lists them"


def moved(result: OutputError, logs: Sequence[Log | Recording], output: str | None) -> Page:
    """A model fitted to the simulated motion: its error, what the motion determines, and the parameters."""
    model, kept = result.model, result.kept
    error = headline(model, logs)
    parts: list[Any] = [
        headline_line(error),
        f"error of the simulated positions on the fitted logs: {percent(1 - result.ratio)} less than with the "
        "least-squares parameters",
        f"singular values of the motion, in standard errors of least squares: {result.singular_values[0]:.3g} to "
        f"{result.singular_values[-1]:.2g}; in directions below 1, the least-squares values are kept",
    ]
    if kept:
        names = escape(", ".join(kept))
        parts.append(f"parameters that keep their least-squares values, within one standard error: {names}")
    if result.tested is not None:
        for name, found in zip(("least squares", "output error"), result.tested, strict=True):
            parts += [f"on the test logs, {name}:", motion_table(found)]
    parts += _table_of_parameters(model)
    if output:
        parts.append(f"model written to {output}")
    data = {"headline": error.to_dict(), **result.to_dict(), "parameters": model.to_dict()["parameters"]}
    return Page(data, parts, error.alarms)


def _brief(found: Identification, messages: Sequence[str]) -> list[str]:
    """Messages with the names of logs instead of their paths; what is said of several logs stands once."""
    paths = {x["source"] for x in (*found.model.fitted_logs, *found.model.history[-1].get("test_logs", ()))}
    names = {path: Path(path).name for path in paths}
    if len(set(names.values())) < len(names):  # two logs of one name in two folders
        return list(messages)
    for path in sorted(paths, key=len, reverse=True):
        messages = [text.replace(path, names[path]) for text in messages]
    told: dict[str, list[str]] = {}
    for text in dict.fromkeys(messages):
        log, colon, rest = text.partition(": ")
        alike = re.sub(r"[-+]?\d[\d.]*", "#", rest)
        told.setdefault(alike if colon and log in names.values() else text, []).append(text)
    return [first if not others else _once(first, len(others)) for first, *others in told.values()]


def _once(text: str, others: int) -> str:
    """A message on the first of several logs, for all of them."""
    log, _, rest = text.partition(": ")
    return f"{log} (and the like of {others} other log{'s' * (others > 1)}): {rest}"


def _next(found: Identification, output: str) -> Command:
    """The command that helps next: logs that make a wrong model are to be mended first.

    The model's file names the fitted logs and their mapping file, but no test log.
    """
    severe = {alarm.id for alarm in found.alarms if alarm.severity == "severe"}
    if FAULTY_LOG in severe:
        return Command(f"next: {check_command(found.model, 'map.toml')}")
    if "log-too-short" in severe:
        return Command(f"next: {excite_command(found.model)}")
    return Command(f"next: frischid diagnose {shlex.quote(output)}{with_tests(tested_files(found.model))}")


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
        "merging_cost": reduction.cost,
        "condition": model.estimate.condition,
        "estimator": model.estimate.estimator,
        "controller": content["controller"],
        "currents": content["currents"],
        "amperes": [x.to_dict() for x in found.amperes],
        "drives": [x.to_dict() for x in drive_parameters(model)],
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
        "torque_lag": None if found.torque_lag is None else found.torque_lag.to_dict(),
        "speed_range": None if found.speed_range is None else found.speed_range._asdict(),
        "notes": list(found.notes),
        "warnings": list(found.warnings),
    }


def _table_of_parameters(model: Model) -> list[Any]:
    """The table of parameters, and the joints that the numbers in their names mean."""
    said = numbering(model.estimate, model.robot.numbers)
    return [parameters(model), *([f"  {escape(said)}"] if said else [])]


def parameters(model: Model, truth: Sequence[float] | None = None) -> Table:
    """Table of base parameters: value, standard error, boxes, and the truth where it is known."""
    known = [] if truth is None else ["true"]
    e = model.estimate
    shares = [] if e.from_data is None else ["from logs"]
    boxed = [f"{k} box" for k in model.bounds]
    silent = without_information(model.bounds)
    table = table_of(
        "parameter", "stands for", "unit", *known, "value", "± s.e.", *shares, *boxed,
        droppable=(*boxed, "from logs", "stands for"),
    )  # fmt: skip
    for i, column in enumerate(e.columns):
        boxes = [
            NO_INFORMATION if silent[method][i] else f"{figure(b.lower[i])} … {figure(b.upper[i])}"
            for method, b in model.bounds.items()
        ]
        expected = [] if truth is None else [figure(truth[i])]
        row = [column.name, model.expressions[i], column.unit, *expected, figure(e.theta[i]), figure(e.stderr[i])]
        share = [] if e.from_data is None else [percent(e.from_data[i])]
        table.add_row(*row, *share, *boxes)
    return table


def summary(found: Identification) -> str:
    """One sentence on the fit."""
    model, e = found.model, found.model.estimate
    cut = "unfiltered" if model.lowpass.cutoff is None else f"low-passed at {model.lowpass.cutoff:g} Hz, then thinned"
    return (
        f"[bold]{model.robot.name}[/bold]: {counted(found.reduction.rank, 'base parameter')} from "
        f"{found.samples} samples ({cut}) by {ESTIMATOR_TITLES.get(e.estimator, e.estimator)}; condition number "
        f"{e.condition:.3g}; effects {', '.join(str(x) for x in model.effects)}"
        f"{f'; {cost}' if (cost := found.reduction.described_cost()) else ''}"
    )


def cross_validation(found: Identification) -> str:
    """Cross-validated error of each joint, in a line."""
    errors = found.cross_validation
    listing = ", ".join(f"{n} {errors[n]:.4f}" if n in errors else f"{n} –" for n in found.model.joints)
    dash = " (–: never moves)" * (len(errors) < len(found.model.joints))
    return f"joint by joint, cross-validated on stretches left out of the fit: {listing}{dash}"
