"""Parameters: bounds of all methods, and BBRF's bounds from window to window.

Parameters have different units, and their bounds differ in width by factors of a thousand. To share an axis, each bound
is drawn as its distance from the estimate in standard errors, d = (θ − θ̂) / s.e. The scale is linear within one
standard error and logarithmic beyond: sign(d) log₁₀(1 + |d|).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go

from frischid.core.text import counted
from frischid.core.types import Array
from frischid.figures.style import BLUE, COLOURS, GREEN, INK, MEASURED, PURPLE, Drawing, drawing, number, plain
from frischid.model.model import Model

BOUND_TITLES = {"frisch": "Classical Frisch", "bbrf": "BBRF", "sensorwise": "Sensor-wise Frisch"}
LOOKS = {"frisch": ("#a6d5f5", 11.0), "bbrf": (COLOURS[4], 7.0), "sensorwise": (PURPLE, 5.0)}
"""Bars of the methods, widest and lightest first, so that narrower ones lie on top and all differ in grey too."""
CLOSING_DRAWN = 6  # parameters whose bounds are drawn over the windows
FURTHEST = 6.0  # decades of standard errors that are drawn
NEAR = {"1": 1.0, "2": 2.0, "5": 5.0, "10": 10.0}
FAR = {"10": 1e1, "100": 1e2, "10⁴": 1e4, "10⁶": 1e6}
FARTHEST = {"100": 1e2, "10⁴": 1e4, "10⁶": 1e6}
"""Labelled distances, for bars within ten standard errors, for longer ones, and for those beyond ten thousand."""


def title(method: str) -> str:
    """Name of a method that gives bounds."""
    return BOUND_TITLES.get(method, method)


def scaled(d: Array) -> Array:
    """Linear within a standard error, logarithmic beyond."""
    return np.asarray(np.clip(np.sign(d) * np.log10(1 + np.abs(d)), -FURTHEST, FURTHEST))


def intervals(model: Model, nominal: Array | None = None, truth: Array | None = None) -> Drawing:
    """Bounds of every parameter by every method, and the nominal or true value where it is known.

    Parameters
    ----------
    nominal, truth : ndarray, shape (p,), optional
        Base parameters of the URDF, and of a simulated robot.
    """
    e = model.estimate
    names = [c.name for c in e.columns]
    unit = np.where(e.stderr > 0, e.stderr, 1.0)
    figure = go.Figure()
    for method, box in model.bounds.items():
        low, high = (box.lower - e.theta) / unit, (box.upper - e.theta) / unit
        # Without any bound there is no bar; with one bound, the bar reaches the edge on the open side.
        open_ = np.isinf(low) & np.isinf(high)
        low, high = scaled(np.where(open_, np.nan, low)), scaled(np.where(open_, np.nan, high))
        colour, width = LOOKS.get(method, (COLOURS[3], 5.0))
        _bars(figure, names, low, high, title(method), colour, width)
    two = np.full(len(names), float(scaled(np.array(2.0))))
    _bars(figure, names, -two, two, "± 2 standard errors", INK, 2.0)
    marks = (("URDF", nominal, "circle-open", INK), ("true value", truth, "cross", GREEN))
    for name, values, symbol, colour in marks:
        if values is not None:
            d = (np.asarray(values, dtype=float) - e.theta) / unit
            figure.add_scatter(
                x=plain(scaled(d)), y=names, mode="markers", name=name,
                marker={"symbol": symbol, "size": 8, "color": colour, "line": {"width": 1.5}},
            )  # fmt: skip
    ticks = _ticks(np.concatenate([trace.x for trace in figure.data]))
    figure.update_xaxes(
        tickvals=list(ticks.values()), ticktext=list(ticks), tickangle=0,
        title_text="distance from the estimate, standard errors",
    )  # fmt: skip
    figure.update_yaxes(
        range=[len(names) - 0.4, -0.6], tickfont={"size": 10}, showgrid=False, tickmode="array", tickvals=names
    )
    reading = f"A short bar means that the parameter is well known. {_widths(model, unit)}{_no_bound(model)}"
    layout = {"margin": {"l": 70, "r": 10, "t": 56, "b": 44}}
    return drawing("Bounds of every parameter around its estimate", reading, figure, 120 + 17 * len(names), **layout)


def _ticks(drawn: Array) -> dict[str, float]:
    """Labels of the scale and their places, sparse enough for a small screen."""
    longest = np.nanmax(np.abs(drawn))
    sizes = NEAR if longest < scaled(np.array(10.0)) else FAR if longest < scaled(np.array(1e4)) else FARTHEST
    sides = [(name, float(scaled(np.array(x)))) for name, x in sizes.items()]
    return {"0": 0.0} | dict(sides) | {f"−{name}": -x for name, x in sides}


def _bars(
    figure: go.Figure, names: Sequence[str], low: Array, high: Array, name: str, colour: str, width: float
) -> None:
    x = np.column_stack([low, high, np.full(len(names), np.nan)]).ravel()
    y = [n for name_ in names for n in (name_, name_, None)]
    figure.add_scatter(
        x=plain(x), y=y, mode="lines", name=name, line={"color": colour, "width": width}, hoverinfo="name"
    )


def _widths(model: Model, unit: Array) -> str:
    parts = []
    for method, box in model.bounds.items():
        half = (box.upper - box.lower) / 2 / unit
        known = half[np.isfinite(half)]
        if len(known) == 0:
            parts.append(f"{title(method)} bounds nothing")
            continue
        share = "" if len(known) == len(half) else f" ({len(half) - len(known)} open)"
        parts.append(f"{title(method)} ± {number(float(np.median(known)), 2)}{share}")
    return (
        f"Half-widths in standard errors, median: {'; '.join(parts)}."
        if parts
        else "This model has standard errors only."
    )


def _no_bound(model: Model) -> str:
    """A sentence where the classical box is no bound: a parameter with a box around zero changes its sign."""
    box = model.bounds.get("frisch")
    changing = 0 if box is None else int(((box.lower < 0) & (box.upper > 0)).sum())
    if not changing:
        return ""
    return (
        f" {title('frisch')} is no bound here: its theorem needs equal signs in all least-squares solutions, and "
        f"{changing} of {counted(len(model.estimate.columns), 'parameter')} change"
        f"{'s' * (changing == 1)} the sign."
    )


def closing(model: Model) -> list[Drawing]:
    """BBRF's bounds over the windows, for the parameters whose bounds shrink most (the paper's Figure 3)."""
    identified = _with_recursion(model)
    if identified is None or (record := identified.recursion) is None:
        return []
    lower, upper = (np.array(record[k], dtype=float) for k in ("lower", "upper"))
    if len(lower) < 2:
        return []
    with np.errstate(invalid="ignore"):
        first = np.array([_first_finite(w) for w in (upper - lower).T])
        ratio = np.where(first > 0, (upper - lower)[-1] / first, np.inf)
    chosen = [int(i) for i in np.argsort(ratio, kind="stable")[:CLOSING_DRAWN] if np.isfinite(ratio[i])]
    # The bounds are those of the identified model, and so is the estimate: added effects change its parameters.
    e, whose = identified.estimate, "the estimate" if identified is model else "the identified model's estimate"
    values = dict(zip((c.name for c in e.columns), map(float, e.theta), strict=True))
    drawings = []
    for i in chosen:
        name = record["names"][i]
        final = float((upper - lower)[-1, i])
        middle = float((upper + lower)[-1, i]) / 2
        figure = go.Figure()
        for side, dash, bound in (("upper bound", "solid", upper), ("lower bound", "dash", lower)):
            figure.add_scatter(
                x=[s + 1 for s in record["steps"]], y=plain(bound[:, i]), name=side, mode="lines",
                line={"color": BLUE, "dash": dash, "width": 2, "shape": "hv"},
            )  # fmt: skip
        value = values.get(name, middle)
        if name in values:
            figure.add_hline(y=value, line={"color": MEASURED, "dash": "dot"})
        figure.update_xaxes(title_text="windows so far", type="log", dtick=1)
        # The first windows' bounds are a thousand times wider: the axis shows the last ones, and the estimate.
        reach = [min(middle - 5 * final, value - final), max(middle + 5 * final, value + final)]
        figure.update_yaxes(title_text=f"{name}, {record['units'][i]}", range=reach)
        drawings.append(
            drawing(
                f"{name}: BBRF's bounds over the windows",
                f"From {number(first[i], 3)} to {number(final, 3)} {record['units'][i]} wide; dotted: {whose}.",
                figure, 240, margin={"l": 70, "r": 8, "t": 30, "b": 46},
            )
        )  # fmt: skip
    return drawings


def recursion_of(model: Model) -> dict[str, Any] | None:
    """The recursion's record of this model, or of the model that this one was refitted from."""
    found = _with_recursion(model)
    return None if found is None or found.recursion is None else dict(found.recursion)


def _with_recursion(model: Model) -> Model | None:
    """The model, or the one that it was refitted from, that has the recursion's record."""
    at: Model | None = model
    while at is not None and at.recursion is None:
        at = at.previous
    return at


def _first_finite(width: Array) -> float:
    finite = width[np.isfinite(width)]
    return float(finite[0]) if len(finite) else np.nan
