"""Figures 1 to 4 of the paper, from this run's numbers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from frischid.core.types import Array
from frischid.figures.style import BLUE, GREEN, INK, MEASURED, VERMILION, Drawing, drawing, plain
from frischid.motions.plan import Plan
from frischid.paper.author_points import AuthorPoints
from frischid.paper.monte_carlo import SHOWN_SECONDS, ArmMotion, StudyRun, history_steps
from frischid.paper.printed import POINT_LIMITS, PRINTED_PARAMETERS, SEARCHES

_SHORT = 10.0
"""Seconds of torque that Figure 4 shows: more would hide the curves in one another."""


def descent(plan: Plan) -> Drawing:
    """Figure 1: how the cost falls, ours against the two ends that the paper prints."""
    figure = go.Figure()
    best = np.minimum.accumulate(plan.history[:, 1])
    figure.add_scatter(x=plain(plan.history[:, 0]), y=plain(best), mode="lines", name="frischid excite",
                       line={"color": BLUE, "shape": "hv", "width": 2})  # fmt: skip
    total = np.cumsum([s.evaluations for s in SEARCHES])
    figure.add_scatter(x=total, y=[s.cost for s in SEARCHES], mode="markers+text", name="printed",
                       text=[s.phase for s in SEARCHES], textposition="top left",
                       marker={"color": VERMILION, "size": 10, "symbol": "diamond"})  # fmt: skip
    figure.update_xaxes(title_text="evaluations of cost (19)", type="log")
    figure.update_yaxes(title_text="cost (19)", type="log", dtick="D2")  # 1, 2, 5: more labels cover each other
    reading = (
        f"frischid reaches {plan.cost:.2f} after {plan.evaluations:,} evaluations, with gradients and its own draw of "
        f"noise; the paper {SEARCHES[-1].cost:.4f} after {total[-1]:,}. Of the paper's curve the two ends are printed."
    )
    return drawing("Figure 1: descent of the cost", reading, figure, 340)


def motion(case: ArmMotion, points: AuthorPoints) -> Drawing:
    """Figure 2: the first 30 s of the interpolated motion, points marked."""
    figure = make_subplots(rows=3, cols=1, shared_xaxes=True, vertical_spacing=0.06)
    part, dots = case.t <= SHOWN_SECONDS, points.t <= SHOWN_SECONDS
    names = ("q, rad", "q̇, rad/s", "q̈, rad/s²")
    rows = zip(names, case.states, points.states, POINT_LIMITS, strict=True)
    for row, (name, curve, at, limit) in enumerate(rows, start=1):
        for j, (colour, dash) in enumerate(((BLUE, "solid"), (VERMILION, "dot"))):
            figure.add_scatter(x=plain(case.t[part]), y=plain(curve[part, j]), name=f"joint {j + 1}", row=row, col=1,
                               legendgroup=str(j), showlegend=row == 1,
                               line={"color": colour, "width": 1.3, "dash": dash})  # fmt: skip
            figure.add_scatter(x=plain(points.t[dots]), y=plain(at[dots, j]), mode="markers", showlegend=False,
                               hoverinfo="skip", marker={"color": colour, "size": 5}, row=row, col=1)  # fmt: skip
        for side in (-limit, limit):
            figure.add_hline(y=side, line={"color": INK, "width": 1, "dash": "dash"}, row=row, col=1)
        figure.update_yaxes(title_text=name, row=row, col=1)
    figure.update_xaxes(title_text="time, s", row=3, col=1)
    most = [float(np.abs(x).max()) for x in case.states]
    reading = (
        "Dots: the points, one a second. Dashed: the limits that the points keep. Between the points the motion breaks "
        f"them: |q| up to {most[0]:.1f} rad, |q̇| up to {most[1]:.0f} rad/s, |q̈| up to {most[2]:.0f} rad/s²."
    )
    return drawing("Figure 2: the first 30 s of the exciting motion", reading, figure, 620)


def bounds(runs: Sequence[StudyRun], samples: int) -> Drawing:
    """Figure 3: mean, least and largest bounds of BBRF as published, over the runs."""
    kept = [run for run in runs if not run.discarded]
    titles = [f"{row.symbol}: {row.stands_for}" for row in PRINTED_PARAMETERS]
    figure = make_subplots(rows=9, cols=1, shared_xaxes=True, vertical_spacing=0.022, subplot_titles=titles)
    steps = history_steps(samples).astype(np.float64) + 1.0
    for i, row in enumerate(PRINTED_PARAMETERS, start=1):
        for name, colour in (("lower", BLUE), ("upper", VERMILION)):
            curves = np.array([getattr(run, name)[:, i - 1] for run in kept])
            _band(figure, steps, curves, f"{name} bound", colour, i, show=i == 1)
        figure.add_hline(y=row.reference, line={"color": INK, "dash": "dash", "width": 1.2}, row=i, col=1)
        figure.update_yaxes(title_text=row.unit, row=i, col=1)
    figure.update_xaxes(type="log")
    figure.update_xaxes(title_text="window", row=9, col=1)
    figure.update_annotations(font={"size": 12}, x=0, xanchor="left")
    final = [(run.last.lower <= _reference()) & (_reference() <= run.last.upper) for run in kept]
    shares = zip(PRINTED_PARAMETERS, np.mean(final, axis=0), strict=True)
    share = ", ".join(f"{row.symbol} {100 * x:.0f} %" for row, x in shares)
    reading = (
        f"Mean (line) and range (band) over {len(kept)} runs; dashed: the true value. The last bounds hold it in: "
        f"{share}; all nine at once in {100 * np.mean(np.all(final, axis=1)):.0f} % of the runs."
    )
    return drawing("Figure 3: bounds of BBRF", reading, figure, 1500, legend={"y": 1.02})


def torque(case: ArmMotion, runs: Sequence[StudyRun]) -> Drawing:
    """Figure 4: torque as measured and as rebuilt from θ*, and the norm of the difference."""
    kept = [run for run in runs if not run.discarded]
    count = int((case.t <= _SHORT).sum())
    t = case.t[:count]
    measured, rebuilt = (np.array([getattr(run, name)[:count] for run in kept]) for name in ("measured", "rebuilt"))
    figure = make_subplots(rows=3, cols=1, shared_xaxes=True, vertical_spacing=0.06)
    for j in range(2):
        figure.add_scatter(x=plain(t), y=plain(measured[:, :, j].mean(axis=0)), name="measured", legendgroup="m",
                           row=j + 1, col=1, showlegend=j == 0, line={"color": MEASURED, "width": 4})  # fmt: skip
        figure.add_scatter(x=plain(t), y=plain(rebuilt[:, :, j].mean(axis=0)), name="rebuilt from θ*", legendgroup="r",
                           row=j + 1, col=1, showlegend=j == 0, line={"color": BLUE, "width": 1.3})  # fmt: skip
        figure.update_yaxes(title_text=f"torque {j + 1}, N·m", row=j + 1, col=1)
    norms = np.linalg.norm(rebuilt - measured, axis=2)
    _band(figure, t, norms, "error", GREEN, 3, show=True)
    figure.update_yaxes(title_text="norm of the error, N·m", row=3, col=1)
    figure.update_xaxes(title_text="time, s", row=3, col=1)
    reading = (
        f"Means over {len(kept)} runs, first {_SHORT:g} s; below: the norm of the difference, mean and range. The norm "
        f"averages {norms.mean():.2f} N·m; the noise of 1 N·m on each torque alone makes {np.sqrt(np.pi / 2):.2f}."
    )
    return drawing("Figure 4: measured and rebuilt torque", reading, figure, 620)


def _band(figure: go.Figure, x: Array, curves: Array, name: str, colour: str, row: int, *, show: bool) -> None:
    """Mean of some curves, (runs, S), in the band from the least to the largest of them."""
    low, high = plain(curves.min(axis=0)), plain(curves.max(axis=0))
    red, green, blue = (int(colour[k : k + 2], 16) for k in (1, 3, 5))
    figure.add_scatter(x=plain(np.concatenate([x, x[::-1]])), y=np.concatenate([high, low[::-1]]), fill="toself",
                       fillcolor=f"rgba({red},{green},{blue},0.22)", line={"width": 0}, hoverinfo="skip",
                       showlegend=False, row=row, col=1)  # fmt: skip
    figure.add_scatter(x=plain(x), y=plain(curves.mean(axis=0)), name=name, legendgroup=name, showlegend=show,
                       row=row, col=1, line={"color": colour, "width": 1.8})  # fmt: skip


def _reference() -> Array:
    return np.array([row.reference for row in PRINTED_PARAMETERS])
