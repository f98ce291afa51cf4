"""Parameters: values with every method's bounds, correlation, physical links, regrouping, and the recursion."""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from frischid import figures
from frischid.core.text import counted, listed
from frischid.estimators.least_squares import ESTIMATOR_TITLES
from frischid.export.consistency import Consistency
from frischid.figures.style import number
from frischid.model.identification_bounds import NO_INFORMATION, without_information
from frischid.model.model import Model
from frischid.model.parameters import numbering
from frischid.model.physical_alarms import SIGN
from frischid.reports.chapters.table import Table
from frischid.reports.study import Study

RECURSION_TITLES = {
    "strict": "the paper's Algorithm 1", "undo": "windows that would empty the box are left out",
    "calibrated": "every window's box is widened by its sampling error",
}  # fmt: skip
MOST_CHANGED = 12  # parameters in the open table
STRONGLY = 0.9  # correlation from which the logs hardly distinguish two parameters
PAIRS_NAMED = 5
CHANGED_CAPTION = "The parameters that differ most from the URDF, in standard errors"
PARAMETERS_CAPTION = "Base parameters; R marks one that others are regrouped into; s.e. is the standard error"


def content(study: Study, model_path: str) -> dict[str, Any]:
    """Values for the template."""
    model, e = study.model, study.model.estimate
    record = figures.parameters.recursion_of(model)
    return {
        "count": len(e.theta),
        "estimator": ESTIMATOR_TITLES.get(e.estimator, e.estimator),
        "condition": number(e.condition, 3),
        "weak": len(e.hardly_known),
        "impossible": listed(study.impossible),
        "alarmed": any(alarm.id == SIGN for alarm in study.headline.alarms),
        "doubtful": listed([c.name for c, x in zip(e.columns, e.theta, strict=True) if c.sign * x < 0]),
        "physical": study.physical if isinstance(study.physical, Consistency) else None,
        "no_links": study.physical if isinstance(study.physical, str) else "",
        "held": _held(study.physical),
        "intervals": figures.intervals(model, study.nominal, study.truth),
        "values": _values(study),
        "changed": _changed(study),
        "correlated": _correlated(study),
        "regrouping": _regrouping(study),
        "recursion": record,
        "recursion_means": "" if record is None else RECURSION_TITLES.get(record["variant"], record["variant"]),
        "refitted": model.recursion is None,
        "closing": figures.closing(model),
    }


def _changed(study: Study) -> Table:
    """The parameters that differ most from the URDF, in standard errors."""
    model, e = study.model, study.model.estimate
    nominal = np.zeros(len(e.theta)) if study.nominal is None else study.nominal
    matter = np.abs(e.theta - nominal) / np.where(e.stderr > 0, e.stderr, np.inf)
    rows = []
    for i in sorted(range(len(matter)), key=lambda i: -matter[i])[:MOST_CHANGED]:
        column, unit = e.columns[i], "–" if e.columns[i].unit == "1" else e.columns[i].unit
        given = "–" if study.nominal is None else number(float(nominal[i]))
        share = "–" if e.from_data is None else f"{100 * e.from_data[i]:.0f} %"
        row = [column.name, unit, number(e.theta[i]), number(e.stderr[i], 2), given, number(float(matter[i]), 2), share]
        rows.append([*row, _sum(model.expressions[i])])
    headings = ["parameter", "unit", "value", "± s.e.", "URDF", "off by, s.e.", "from logs", "stands for"]
    return Table(headings, rows, words=2, caption=_with_numbers(CHANGED_CAPTION, model))


def _with_numbers(caption: str, model: Model) -> str:
    said = numbering(model.estimate, model.robot.numbers)
    return f"{caption}; {said}" if said else caption


def _correlated(study: Study) -> str:
    """Pairs of parameters that the logs hardly distinguish, in a sentence."""
    e = study.model.estimate
    scale = np.where(e.stderr > 0, e.stderr, 1.0)
    rho = e.covariance / np.outer(scale, scale)
    rows, columns = np.nonzero(np.triu(np.abs(rho) > STRONGLY, 1))
    if not len(rows):
        return f"No two estimates are correlated beyond ± {STRONGLY}."
    order = np.argsort(-np.abs(rho[rows, columns]))
    names = [c.name for c in e.columns]
    pairs = [f"{names[rows[k]]} and {names[columns[k]]} ({rho[rows[k], columns[k]]:.2f})" for k in order[:PAIRS_NAMED]]
    left = len(order) - PAIRS_NAMED
    more = f" and {left} more pair{'s' * (left > 1)}" if left > 0 else ""
    return f"The logs hardly distinguish these pairs, by the correlation of their errors: {', '.join(pairs)}{more}."


def _values(study: Study) -> Table:
    """One row per base parameter."""
    model, e = study.model, study.model.estimate
    given = {name: x for name, x in (("true", study.truth), ("URDF", study.nominal)) if x is not None}
    silent = without_information(model.bounds)
    rows, weak = [], e.hardly_known
    for i, column in enumerate(e.columns):
        flags = ["impossible sign"] * (column.name in study.impossible) + ["hardly known"] * (column.name in weak)
        boxes = [
            NO_INFORMATION if silent[method][i] else f"{number(b.lower[i], 3)} … {number(b.upper[i], 3)}"
            for method, b in model.bounds.items()
        ]
        known = [number(float(x[i])) for x in given.values()]
        unit = "–" if column.unit == "1" else column.unit
        row = [column.name, unit, number(e.theta[i]), number(e.stderr[i], 2)]
        rows.append([*row, *known, *boxes, ", ".join(flags), _sum(model.expressions[i])])
    boxed = [f"{figures.parameters.title(method)} box" for method in model.bounds]
    headings = ["parameter", "unit", "value", "± s.e.", *given, *boxed, "flags", "stands for"]
    return Table(headings, rows, words=2, caption=_with_numbers(PARAMETERS_CAPTION, model))


def _sum(expression: str) -> str:
    """A regrouped parameter with proper minus signs; a line never breaks between a factor and its parameter."""
    return re.sub(r"(?<=\d) (?=[a-zA-Z])", "\u00a0", expression.replace(" - ", " − "))


def _held(found: Consistency | str) -> str:
    """The limits that physical links reach."""
    if isinstance(found, str):
        return ""
    limits: dict[str, list[str]] = {}
    for active in found.active:
        limits.setdefault(active.constraint, []).append(active.where)
    return "; ".join(f"{listed(where)}: {constraint}" for constraint, where in limits.items())


def _regrouping(study: Study) -> Table | None:
    reduction = study.reduction
    if reduction is None:
        return None
    names = [c.name for c in reduction.columns]
    groups = (
        ("alone", reduction.absolute),
        ("only in combination", reduction.linear),
        ("not at all", reduction.none),
    )
    rows = [[kind, str(len(group)), ", ".join(names[i] for i in group)] for kind, group in groups]
    return Table(
        ["identifiable", "count", "parameters"],
        rows,
        words=3,
        caption=f"{counted(len(names), 'parameter')}, rank {reduction.rank}",
    )
