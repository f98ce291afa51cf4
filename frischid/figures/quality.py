"""Data quality: the range of each joint within its limits, and the noise of each channel."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal

import numpy as np
import plotly.graph_objects as go

from frischid.core.types import Array
from frischid.figures.style import (
    BLUE,
    COLOURS,
    MEASURED,
    Drawing,
    drawing,
    number,
    plain,
    short,
    units_among,
    units_of,
)
from frischid.robot.robot import Robot

if TYPE_CHECKING:
    from frischid.model.log_quality import Quality


def reach(robot: Robot, logs: Sequence[Quality]) -> Drawing:
    """Range of each joint's positions, within the URDF's limits."""
    names = short(list(robot.joints))
    low = np.min([q.lower for q in logs], axis=0)
    high = np.max([q.upper for q in logs], axis=0)
    limits = robot.limits
    figure = go.Figure()
    for name, a, b, colour, width in (
        ("allowed", limits.lower, limits.upper, MEASURED, 3.0),
        ("reached", low, high, BLUE, 9.0),
    ):
        finite = np.isfinite(a) & np.isfinite(b)
        x = np.column_stack([np.where(finite, a, np.nan), np.where(finite, b, np.nan), np.full(len(names), np.nan)])
        y = [n for name_ in names for n in (name_, name_, None)]
        figure.add_scatter(
            x=plain(x.ravel()), y=y, mode="lines+markers", name=name, line={"color": colour, "width": width},
            marker={"symbol": "line-ns-open", "size": 12, "color": colour},
        )  # fmt: skip
    figure.update_xaxes(title_text=f"position, {units_among(robot.prismatic)['q']}")
    figure.update_yaxes(autorange="reversed", showgrid=False, automargin=True)
    with np.errstate(invalid="ignore"):
        share = (high - low) / (limits.upper - limits.lower)
    bounded = np.isfinite(limits.upper - limits.lower) & (limits.upper > limits.lower)
    if bounded.any():
        k = int(np.where(bounded, share, np.inf).argmin())
        used = f"{100 * share[k]:.0f} %"
        how = f"uses least of its range, {used}" if len(names) > 1 else f"uses {used} of its range"
        reading = f"{robot.joints[k]} {how}; outside, the model is not tested."
    else:
        reading = "The URDF limits no position."
    return drawing("Positions reached", reading, figure, 140 + 26 * len(names))


def usual_noise(logs: Sequence[Quality], channel: Literal["tau", "q"]) -> Array:
    """Median over the logs of each joint's white noise, (J,); NaN for a joint whose channel no log has."""
    levels = np.array([log.noise[channel] for log in logs])
    there = ~np.isnan(levels).all(axis=0)
    usual = np.full(len(there), np.nan)
    usual[there] = np.nanmedian(levels[:, there], axis=0)
    return usual


def noise(robot: Robot, logs: Sequence[Quality], channel: Literal["tau", "q"]) -> Drawing:
    """White noise of torque or position, joint by joint, one mark per log."""
    names = short(list(robot.joints))
    word = {"tau": "torque", "q": "position"}[channel]
    unit = units_among(robot.prismatic)["load" if channel == "tau" else "q"]
    figure = go.Figure()
    for i, log in enumerate(logs, start=1):
        figure.add_scatter(
            x=plain(log.noise[channel]), y=names, mode="markers", showlegend=False, name=f"log {i}", cliponaxis=False,
            marker={"color": COLOURS[1] if channel == "tau" else BLUE, "size": 9, "line": {"width": 1.5},
                    "symbol": "circle-open" if channel == "tau" else "diamond-open"},
        )  # fmt: skip
    figure.update_xaxes(
        title_text=f"noise of the {word}, {unit}", rangemode="tozero", exponentformat="power", nticks=3, tickangle=0
    )
    figure.update_yaxes(autorange="reversed", automargin=True)
    level = usual_noise(logs, channel)
    k = int(np.nanargmax(level))
    own = units_of(bool(robot.prismatic[k]))["load" if channel == "tau" else "q"]
    usually = "; median over the logs" if len(logs) > 1 else ""
    how = f"{number(level[k], 2)} {own}{usually}"
    most = f"{robot.joints[k]} is the noisiest ({how})" if len(names) > 1 else f"The noise of {robot.joints[k]}: {how}"
    reading = f"{most}. One mark per log, before any filter."
    return drawing(f"White noise of the measured {word}", reading, figure, 140 + 26 * len(names))
