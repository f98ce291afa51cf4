"""The simulated robot as a ghost beside the measured one, and the position error between the two over time or horizon.

Both robots are lines between their joints, seen from the direction that spreads the joints most, so the animation needs
no mesh and is drawn on paper too.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from frischid.core.types import Array
from frischid.figures.motion import links_of
from frischid.figures.robot_picture import best_view, view
from frischid.figures.style import (
    BLUE,
    COLOURS,
    DASHES,
    MEASURED,
    VERMILION,
    Drawing,
    drawing,
    number,
    plain,
    short,
    thinned,
    units_among,
)

if TYPE_CHECKING:
    from frischid.forward.simulated_beside import SimulatedBeside
    from frischid.robot.robot import Robot

GHOST_POSES = 100
"""Poses of the animation: 0.2 s apart in 20 s."""
GHOST = 0.45
"""Opacity of the simulated robot."""
TIP_LINES = ({"color": BLUE, "width": 2.2}, {"color": MEASURED, "dash": "dash", "width": 2.2})
"""The model's line and that of the URDF with fitted friction."""


def ghost(beside: SimulatedBeside, robot: Robot) -> Drawing:
    """Both robots along the log, with a button that plays the motion and a slider over the time."""
    stable = np.flatnonzero(np.isfinite(beside.simulated).all(axis=1))
    samples = stable[:: max(1, -(-len(stable) // GHOST_POSES))]
    both = [[links_of(robot, q[k]) for q in (beside.measured, beside.simulated)] for k in samples]
    poses = [*both[0], *both[len(both) // 2]]  # a sliding axis at its zero is a point, which has no best view
    angle = best_view(np.concatenate([x[np.isfinite(x[:, 0])] for x in poses]))
    flat = [[view(x, angle) for x in pair] for pair in both]
    figure = go.Figure(_robots(flat[0]))
    figure.frames = [
        go.Frame(data=_robots(pair), name=f"{beside.t[k]:.2f}") for k, pair in zip(samples, flat, strict=True)
    ]
    apart = float(beside.t[samples[1]] - beside.t[samples[0]]) if len(samples) > 1 else 1.0
    still = {"frame": {"duration": 0, "redraw": False}, "mode": "immediate", "transition": {"duration": 0}}
    pace = {"frame": {"duration": 1e3 * apart, "redraw": False}, "transition": {"duration": 0}, "fromcurrent": True}
    buttons = [
        {"label": "Play", "method": "animate", "args": [None, pace]},
        {"label": "Pause", "method": "animate", "args": [[None], still]},
    ]
    steps = [{"label": f.name, "method": "animate", "args": [[f.name], still]} for f in figure.frames]
    whole = np.concatenate([x for pair in flat for x in pair])
    low, high = np.nanmin(whole, axis=0), np.nanmax(whole, axis=0)
    room = 0.08 * float((high - low).max())
    axes = [
        {"range": [float(a) - room, float(b) + room], "title": {"text": "m"}} for a, b in zip(low, high, strict=True)
    ]
    menu = {"type": "buttons", "direction": "left", "x": 0, "y": -0.1, "xanchor": "left", "yanchor": "top"}
    slider = {"steps": steps, "y": -0.1, "currentvalue": {"prefix": "time, s: "}, "ticklen": 0}
    return drawing(
        "The simulated robot beside the measured one",
        "Blue: the measured positions. Orange and transparent: the positions that the model reaches from the same "
        f"start, {'with the same commands' if beside.closed else 'under the recorded torque'}.",
        figure, 527, xaxis=axes[0], yaxis={**axes[1], "scaleanchor": "x"},
        updatemenus=[{**menu, "buttons": buttons, "showactive": False, "pad": {"t": 96}}], sliders=[slider],
        margin={"l": 64, "r": 12, "t": 34, "b": 177},
    )  # fmt: skip


def position_error(beside: SimulatedBeside, robot: Robot) -> Drawing:
    """Error of the simulated positions: over time along commands, and over the horizon under a recorded torque."""
    return _over_time(beside, robot) if beside.closed else _over_horizon(beside, robot)


def _over_time(beside: SimulatedBeside, robot: Robot) -> Drawing:
    figure, error = go.Figure(), beside.simulated - beside.measured
    _joints(figure, beside.t, error, robot)
    figure.update_xaxes(title_text="time, s")
    figure.update_yaxes(title_text=f"simulated − measured position, {units_among(robot.prismatic)['q']}")
    each = ", ".join(f"{n} {number(x, 3)}" for n, x in zip(short(robot.joints), beside.rms.tolist(), strict=True))
    tip = number(float(np.sqrt((beside.errors[0, :, -1] ** 2).mean())), 3)
    reading = f"Rms, {units_among(robot.prismatic)['q']}: {each}. Rms distance at the tip: {tip} mm."
    return drawing("Error of the simulated positions", reading, figure, 330)


def _over_horizon(beside: SimulatedBeside, robot: Robot) -> Drawing:
    figure = make_subplots(rows=2, cols=1, shared_xaxes=True, vertical_spacing=0.08)
    horizons, rms = beside.over_horizon()
    rms[~np.isfinite(rms)] = np.nan
    for name, look, tip in zip(("model", "URDF with friction"), TIP_LINES, rms[:, :, -1], strict=True):
        keep = thinned(tip, points=400)
        figure.add_scatter(
            x=plain(horizons[keep]), y=plain(tip[keep]), name=name, mode="lines", line=look, row=1, col=1,
            hovertemplate="%{y:.4g} mm",
        )  # fmt: skip
    _joints(figure, horizons, rms[0, :, :-1], robot, row=2, col=1)
    figure.update_xaxes(title_text="horizon, s", row=2, col=1)
    figure.update_yaxes(title_text="tip, mm", rangemode="tozero", row=1, col=1)
    figure.update_yaxes(title_text=f"joints, {units_among(robot.prismatic)['q']}", rangemode="tozero", row=2, col=1)
    starts = len(beside.t) // beside.length
    ends = [number(float(x), 3) for x in rms[:, -1, -1]]
    reading = (
        f"Rms over {starts} starts from measured states; the horizon is the time since a start. Above: the tip; after "
        f"{number(float(horizons[-1]), 3)} s, {ends[0]} mm, and {ends[1]} mm for the URDF with fitted friction. Below: "
        "the model's positions."
    )
    return drawing("Error of the simulated positions against the horizon", reading, figure, 460)


def _joints(figure: go.Figure, t: Array, curves: Array, robot: Robot, **place: int) -> None:
    """One line per joint; curves (N, J) over t (N,)."""
    for j, (joint, name) in enumerate(zip(robot.joints, short(robot.joints), strict=True)):
        keep = thinned(curves[:, j], points=800)
        unit = "m" if robot.prismatic[j] else "rad"
        figure.add_scatter(
            x=plain(t[keep]), y=plain(curves[keep, j]), name=name, mode="lines",
            line={"color": COLOURS[j % len(COLOURS)], "dash": DASHES[j // len(COLOURS) % len(DASHES)], "width": 1.3},
            hovertemplate=f"%{{y:.4g}} {unit}", meta={"joint": joint}, **place,
        )  # fmt: skip


def _robots(pair: list[Array]) -> list[Any]:
    """The measured robot and the ghost in one pose; the joints are points, which a link without a length needs."""
    looks = (("measured", BLUE, 1.0, 6), ("simulated", VERMILION, GHOST, 11))
    return [
        go.Scatter(
            x=plain(x[:, 0]), y=plain(x[:, 1]), name=name, mode="lines+markers", opacity=seen, hoverinfo="skip",
            line={"color": colour, "width": width}, marker={"size": 1.7 * width},
        )
        for x, (name, colour, seen, width) in zip(pair, looks, strict=True)
    ]  # fmt: skip
