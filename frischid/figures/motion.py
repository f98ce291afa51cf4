"""A planned motion: its curves, and the robot that moves along it.

The robot is drawn as lines between its joints (`skeleton`), so the page needs no mesh and opens offline.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from frischid.core.types import Array
from frischid.figures.style import BLUE, COLOURS, DASHES, VERMILION, plain
from frischid.robot.kinematic_tree import skeleton

if TYPE_CHECKING:
    from frischid.motions.plan import Plan
    from frischid.robot.robot import Robot

DRAWN_RATE = 50.0  # samples per second of a drawn motion
POSES = 240
"""Largest number of poses in the animation: 0.1 s apart in 24 s, and half a megabyte for a robot of seven joints."""
TALL = 680  # pixels of the animation


def excitation(plan: Plan) -> go.Figure:
    """Position, velocity and acceleration of a planned motion, and the cost over the course of the search."""
    log = plan.to_log(DRAWN_RATE)
    figure = make_subplots(
        rows=4,
        cols=1,
        vertical_spacing=0.07,
        subplot_titles=(
            f"planned motion: {plan.criterion} {plan.cost:.4g}; it {'meets' if not plan.violations else 'breaks'} "
            "its limits",
            "velocity",
            "acceleration",
            f"cost of the best motion: {plan.evaluations:,} evaluations in {plan.seconds:.0f} s",
        ),
    )
    channels = ((log.q, "q, rad (m)"), (log.v, "q̇, rad/s (m/s)"), (log.a, "q̈, rad/s² (m/s²)"))
    for row, (values, title) in enumerate(channels, start=1):
        for j, joint in enumerate(plan.joints):
            line = {"color": COLOURS[j % len(COLOURS)], "dash": DASHES[j // len(COLOURS) % len(DASHES)], "width": 1.4}
            column = None if values is None else values[:, j]
            figure.add_scatter(
                x=log.t, y=column, name=joint, legendgroup=joint, showlegend=row == 1, line=line, row=row, col=1
            )
        figure.update_yaxes(title_text=title, row=row, col=1)
        figure.update_xaxes(title_text="time, s", row=row, col=1)
    # A search that spent its evaluations on the limits has no history: only the cost of its motion is known.
    history = plan.history if len(plan.history) else np.array([[plan.evaluations, plan.cost]])
    best = np.minimum.accumulate(history[:, 1])
    figure.add_scatter(
        x=history[:, 0], y=best, mode="lines+markers", showlegend=False,
        line={"color": COLOURS[0], "shape": "hv"}, row=4, col=1,
    )  # fmt: skip
    figure.update_yaxes(title_text=plan.criterion, type="log" if (best > 0).all() else "linear", row=4, col=1)
    figure.update_xaxes(title_text="evaluations", row=4, col=1)
    # Titles and legend that begin at the left are whole on a narrow page too.
    figure.update_annotations(x=0, xanchor="left", font_size=13)
    below = {"orientation": "h", "x": 0, "y": -0.06, "yanchor": "top"}
    figure.update_layout(
        template="plotly_white", height=1100, margin={"l": 70, "r": 20, "t": 60, "b": 50}, legend=below
    )
    return figure


def animated(plan: Plan, robot: Robot) -> go.Figure:
    """The robot along a planned motion, with a button that plays it and a slider over the time.

    Parameters
    ----------
    robot : Robot
        The robot of the plan.
    """
    log = plan.to_log(DRAWN_RATE)
    step = max(1, -(-len(log.t) // POSES))
    poses = [links_of(robot, q) for q in log.q[::step]]
    times, place = log.t[::step] - log.t[0], np.concatenate(poses)
    middle = 0.5 * (np.nanmin(place, axis=0) + np.nanmax(place, axis=0))
    half = 0.55 * float(np.nanmax(np.nanmax(place, axis=0) - np.nanmin(place, axis=0)))
    figure = go.Figure(_robot(poses[0]))
    figure.frames = [go.Frame(data=[_robot(pose)], name=f"{t:.2f}") for t, pose in zip(times, poses, strict=True)]
    pace = {"frame": {"duration": 1000 * step / DRAWN_RATE, "redraw": True}, "transition": {"duration": 0}}
    still = {"frame": {"duration": 0, "redraw": True}, "mode": "immediate", "transition": {"duration": 0}}
    buttons = [
        {"label": "Play", "method": "animate", "args": [None, {**pace, "fromcurrent": True}]},
        {"label": "Pause", "method": "animate", "args": [[None], still]},
    ]
    steps = [{"label": frame.name, "method": "animate", "args": [[frame.name], still]} for frame in figure.frames]
    axes = {
        f"{name}axis": {"title": f"{name}, m", "range": [float(m) - half, float(m) + half]}
        for name, m in zip("xyz", middle, strict=True)
    }
    figure.update_layout(
        template="plotly_white", height=TALL, margin={"l": 10, "r": 10, "t": 40, "b": 10}, title="the planned motion",
        scene={**axes, "aspectmode": "cube", "camera": {"eye": {"x": 1.1, "y": 1.1, "z": 0.6}}}, showlegend=False,
        updatemenus=[{"type": "buttons", "direction": "left", "x": 0, "y": 0, "xanchor": "left", "yanchor": "top",
                      "buttons": buttons, "showactive": False, "pad": {"t": 96}}],
        sliders=[{"steps": steps, "currentvalue": {"prefix": "time, s: "}, "ticklen": 0}],
    )  # fmt: skip
    return figure


def links_of(robot: Robot, q: Array) -> Array:
    """Ends of the robot's links, m, a row of NaN after each link, (3 L, 3)."""
    points, parents, _, tips = skeleton(robot, q)
    links = [(points[parents[k]], points[k]) for k in range(1, len(points))]
    links += [(points[k], end) for k, end in tips.items()]
    return np.array([row for start, end in links for row in (start, end, np.full(3, np.nan))])


def _robot(lines: Array) -> Any:
    x, y, z = (plain(column) for column in lines.T)
    return go.Scatter3d(
        x=x, y=y, z=z, mode="lines+markers", line={"color": BLUE, "width": 9}, hoverinfo="skip",
        marker={"color": VERMILION, "size": 4},
    )  # fmt: skip
