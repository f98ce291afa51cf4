"""A missing effect: the residual, and the part of it that a candidate effect would explain."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import plotly.graph_objects as go

from frischid.figures.failure import binned
from frischid.figures.style import (
    BLUE,
    MEASURED,
    VARIABLE_WORDS,
    VERMILION,
    Drawing,
    axis_of,
    breaks,
    drawing,
    plain,
    thinned,
    units_of,
)

if TYPE_CHECKING:
    from frischid.diagnosis.effect_curves import Shape


def shape(found: Shape, title: str, sliding: bool = False) -> Drawing:
    """Residual of the joint where a finding explains most, with the fitted curve of the finding.

    Parameters
    ----------
    title : str
        Title of the effect.
    sliding : bool
        Whether the joint is prismatic.
    """
    units = units_of(sliding)
    figure = _along(found) if found.stretch else _over(found)
    figure.update_xaxes(title_text=axis_of(found.variable, sliding))
    figure.update_yaxes(title_text=f"residual, {units['load']}")
    how = (
        "The closer the thin blue line follows the thick grey one, the better"
        if found.stretch
        else "Diamonds: residual; blue line: fitted effect (shaded: 90 % of its torque there). The nearer, the better"
    )
    reading = (
        f"{how}. Drawn on {found.joint}: {title}, refitted with the model to all of the logs that select. "
        "The residual holds the sensors' noise and all other causes too."
    )
    where = (
        f"a stretch of {Path(found.stretch).name}"
        if found.stretch
        else f"residual against {VARIABLE_WORDS[found.variable]}"
    )
    return drawing(f"{found.joint}: {where}", reading, figure, 300)


def _along(found: Shape) -> go.Figure:
    """Two curves over time, broken where samples are left out."""
    keep = thinned(found.residual, found.added)
    steps = np.diff(found.x)
    broken = breaks(np.cumsum(np.append(False, steps > 1.5 * np.median(steps)))[keep])
    curves = (
        ("residual", found.residual, {"color": MEASURED, "width": 2.6}),
        (f"torque of {found.effect}", found.added, {"color": BLUE, "width": 1.4}),
    )
    figure = go.Figure()
    for name, values, line in curves:
        figure.add_scatter(
            x=plain(np.insert(found.x[keep], broken, np.nan)), y=plain(np.insert(values[keep], broken, np.nan)),
            mode="lines", name=name, line=line,
        )  # fmt: skip
    return figure


def _over(found: Shape) -> go.Figure:
    """Samples over a variable, their median, and the effect's median and spread."""
    order = np.argsort(found.x, kind="stable")
    x, r, added = found.x[order], found.residual[order], found.added[order]
    keep = thinned(r, points=900)
    figure = go.Figure()
    figure.add_scatter(
        x=plain(x[keep]), y=plain(r[keep]), mode="markers", name="residual", marker={"size": 3, "color": MEASURED}
    )
    centre, spread = binned(x, r, 24)
    figure.add_scatter(
        x=plain(centre), y=plain(spread[2]), name="median", mode="markers",
        marker={"size": 8, "symbol": "diamond-open", "color": VERMILION, "line": {"width": 2}},
    )  # fmt: skip
    centre, spread = binned(x, added, 40)
    figure.add_scatter(
        x=plain(np.concatenate([centre, centre[::-1]])), y=plain(np.concatenate([spread[4], spread[0][::-1]])),
        fill="toself", fillcolor="rgba(86,180,233,0.3)", line={"width": 0}, mode="lines", showlegend=False,
        hoverinfo="skip",
    )  # fmt: skip
    figure.add_scatter(
        x=plain(centre), y=plain(spread[2]), name=f"torque of {found.effect}", line={"color": BLUE, "width": 2.2},
        mode="lines",
    )  # fmt: skip
    return figure
