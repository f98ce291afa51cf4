"""A planned motion."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from frischid.figures.style import COLOURS, DASHES

if TYPE_CHECKING:
    from frischid.motions.plan import Plan


def excitation(plan: Plan, rate: float = 50.0) -> go.Figure:
    """Position, velocity and acceleration of a planned motion, and the cost over the course of the search."""
    log = plan.to_log(rate)
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
    best = np.minimum.accumulate(plan.history[:, 1])
    figure.add_scatter(
        x=plan.history[:, 0], y=best, showlegend=False, line={"color": COLOURS[0], "shape": "hv"}, row=4, col=1
    )
    figure.update_yaxes(title_text=plan.criterion, type="log" if (best > 0).all() else "linear", row=4, col=1)
    figure.update_xaxes(title_text="evaluations", row=4, col=1)
    figure.update_layout(template="plotly_white", height=1100, margin={"l": 70, "r": 20, "t": 60, "b": 50})
    return figure
