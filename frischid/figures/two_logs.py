"""Two logs laid over one another: measured torque and residual of a joint, each log from its own beginning.

If the robot repeats a motion, a difference between the torques is a change of the robot. If the motions differ, the
residuals still can be compared in size.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import plotly.graph_objects as go

from frischid.core.types import Array
from frischid.figures.style import BLUE, VERMILION, Drawing, drawing, number, plain, stack, thinned, units_of
from frischid.model.prediction import Prediction

CURVE_POINTS = 800
"""Largest number of drawn samples of one curve: the figure is half as wide as that of all logs."""
LINES = ({"color": BLUE, "width": 1.6}, {"color": VERMILION, "width": 1.2, "dash": "dot"})


def two_logs(prediction: Prediction, joint: str, sliding: bool = False) -> Drawing:
    """Lay the first two logs of a prediction over one another.

    Parameters
    ----------
    prediction : Prediction
        Along at least two logs.
    sliding : bool
        Whether the joint is prismatic.
    """
    j, unit = prediction.joints.index(joint), units_of(sliding)["load"]
    figure = go.Figure()
    said = []
    for k, line in enumerate(LINES):
        mine = prediction.log == k
        name = Path(prediction.sources[k].replace("\\", "/")).stem
        t, tau = prediction.t[mine], prediction.measured[mine, j]
        residual = np.where(prediction.used[mine, j], prediction.residual[mine, j], np.nan)
        keep = thinned(tau, residual, points=CURVE_POINTS)
        for values, axis in ((tau, "y"), (residual, "y2")):
            figure.add_scatter(
                x=plain(t[keep]), y=plain(values[keep]), name=name, line=line, mode="lines", yaxis=axis,
                legendgroup=name, showlegend=axis == "y", hovertemplate="%{y:.4g} " + unit,
            )  # fmt: skip
        said.append(f"{_rms(residual, unit)} on {name}")
    stack(figure, [f"torque, {unit}", f"residual, {unit}"], (1.0, 1.0))
    figure.update_xaxes(title_text="time from each log's beginning, s")
    return drawing(f"{joint}: both logs", f"The rms residual is {' and '.join(said)}.", figure, 340)


def _rms(residual: Array, unit: str) -> str:
    """Rms of a residual in words; NaN where the joint rests."""
    moving = residual[~np.isnan(residual)]
    return f"{number(float(np.sqrt(np.mean(moving**2))), 3)} {unit}" if len(moving) else "unknown (the joint rests)"
