"""The simulated robot as a ghost beside the measured one, and the position error between the two over time.

Both robots are lines between their joints, seen from the direction that spreads the joints most, so the animation needs
no mesh and is drawn on paper too.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import plotly.graph_objects as go

from frischid.core.types import Array
from frischid.figures.motion import links_of
from frischid.figures.robot_picture import best_view, view
from frischid.figures.style import BLUE, COLOURS, DASHES, VERMILION, Drawing, drawing, number, plain, short, thinned

if TYPE_CHECKING:
    from frischid.forward.simulated_beside import SimulatedBeside
    from frischid.robot.robot import Robot

GHOST_POSES = 100
"""Poses of the animation: 0.2 s apart in 20 s."""
GHOST = 0.45
"""Opacity of the simulated robot."""


def ghost(beside: SimulatedBeside, robot: Robot) -> Drawing:
    """Both robots along the log, with a button that plays the motion and a slider over the time.

    Parameters
    ----------
    beside : SimulatedBeside
    robot : Robot
    """
    stable = np.flatnonzero(np.isfinite(beside.simulated).all(axis=1))
    samples = stable[:: max(1, -(-len(stable) // GHOST_POSES))]
    both = [[links_of(robot, q[k]) for q in (beside.measured, beside.simulated)] for k in samples]
    angle = best_view(np.concatenate([x[np.isfinite(x[:, 0])] for x in both[0]]))
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
    menu = {"type": "buttons", "direction": "left", "x": 0, "y": -0.16, "xanchor": "left", "yanchor": "top"}
    slider = {"steps": steps, "x": 0.22, "len": 0.78, "y": -0.1, "currentvalue": {"prefix": "time, s: "}, "ticklen": 0}
    return drawing(
        "The simulated robot beside the measured one",
        "Blue: the measured positions. Orange and transparent: the positions that the model reaches from the same "
        "start, with the same commands.",
        figure, 460, xaxis=axes[0], yaxis={**axes[1], "scaleanchor": "x"},
        updatemenus=[{**menu, "buttons": buttons, "showactive": False}], sliders=[slider],
        margin={"l": 64, "r": 12, "t": 34, "b": 110},
    )  # fmt: skip


def position_error(beside: SimulatedBeside, robot: Robot) -> Drawing:
    """Simulated less measured position of each joint over time.

    Parameters
    ----------
    beside : SimulatedBeside
    robot : Robot
    """
    figure, error = go.Figure(), beside.simulated - beside.measured
    for j, (joint, name) in enumerate(zip(robot.joints, short(robot.joints), strict=True)):
        keep = thinned(error[:, j], points=800)
        unit = "m" if robot.prismatic[j] else "rad"
        figure.add_scatter(
            x=plain(beside.t[keep]), y=plain(error[keep, j]), name=name, mode="lines",
            line={"color": COLOURS[j % len(COLOURS)], "dash": DASHES[j // len(COLOURS) % len(DASHES)], "width": 1.3},
            hovertemplate=f"%{{y:.4g}} {unit}", meta={"joint": joint},
        )  # fmt: skip
    figure.update_xaxes(title_text="time, s")
    figure.update_yaxes(title_text="simulated − measured position, rad (m)")
    each = ", ".join(f"{n} {number(x, 3)}" for n, x in zip(short(robot.joints), beside.rms.tolist(), strict=True))
    return drawing("Error of the simulated positions", f"Rms, rad (m): {each}.", figure, 330)


def _robots(pair: list[Array]) -> list[Any]:
    """The measured robot and the ghost in one pose."""
    looks = (("measured", BLUE, 1.0, 6), ("simulated", VERMILION, GHOST, 11))
    return [
        go.Scatter(
            x=plain(x[:, 0]), y=plain(x[:, 1]), name=name, mode="lines", opacity=seen, hoverinfo="skip",
            line={"color": colour, "width": width},
        )
        for x, (name, colour, seen, width) in zip(pair, looks, strict=True)
    ]  # fmt: skip
