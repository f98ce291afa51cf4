"""Where a model fails: the matrix of joints and conditions, and the residual over the variables it may depend on."""

from __future__ import annotations

import numpy as np
import plotly.graph_objects as go

from frischid.core.types import Array
from frischid.figures.style import (
    SCALE,
    VARIABLE_WORDS,
    VERMILION,
    Drawing,
    axis_of,
    drawing,
    number,
    on_scale,
    plain,
    short,
    units_of,
)
from frischid.model.comparison import Comparison
from frischid.model.comparison_criteria import COMPARISON_CRITERIA
from frischid.model.prediction import Prediction
from frischid.model.residual_conditions import CONDITION_ORDER

PHRASES = {
    "near reversal": "near reversals", "slow": "at low speed", "fast": "at high speed", "forwards": "going forwards",
    "backwards": "going backwards", "low angles": "at low angles", "middle angles": "at middle angles",
    "high angles": "at high angles", "high load": "under high load", "high acceleration": "at high acceleration",
    "beginning": "at the beginning of the logs", "end": "at the end of the logs",
}  # fmt: skip
CERTAIN = 0.01
BINS = 16
CELLS = 20
QUANTILES = (5, 25, 50, 75, 95)


def matrix(comparison: Comparison) -> Drawing:
    """Joints by conditions: error under a condition over the joint's average error, with a star where significant."""
    joints = list(comparison.joints.names)
    found = {(c.joint, c.condition): c for c in comparison.residuals.conditions()}
    order = [name for name in CONDITION_ORDER if any((j, name) in found for j in joints)]
    cells = [found.get((j, n)) for n in order for j in joints]
    text = ["" if c is None else f"{c.ratio:.1f}{'*' * (c.p_value < CERTAIN)}" for c in cells]
    ratio = np.array([np.nan if c is None else c.ratio for c in cells]).reshape(len(order), len(joints))
    top = max(2.0, float(np.nanmax(ratio, initial=1.0)))
    names = short(joints)
    figure = go.Figure(
        go.Heatmap(
            z=plain(ratio), x=names, y=order, colorscale=SCALE, zmin=1.0, zmax=top, xgap=2, ygap=2,
            showscale=False, hovertemplate="%{x}, %{y}: %{z:.2f} × its average<extra></extra>",
        )
    )  # fmt: skip
    shares = (ratio.ravel() - 1) / (top - 1)
    figure.add_scatter(
        x=names * len(order), y=[n for n in order for _ in names], text=text, mode="text", hoverinfo="skip",
        textfont={"color": [on_scale(share) for share in shares]}, showlegend=False,
    )  # fmt: skip
    figure.update_yaxes(range=[len(order) - 0.5, -0.5], showgrid=False, automargin=True)
    tilted = -40 if sum(map(len, names)) > 40 else 0
    figure.update_xaxes(
        range=[-0.5, len(names) - 0.5],
        showgrid=False,
        automargin=True,
        tickangle=tilted,
    )
    reading = worst(comparison, 3)
    if np.isnan(ratio).any():
        reading += " Blank: too few samples."
    return drawing(
        "Error under each condition, as a multiple of the joint's average (* more than chance, p < 0.01)",
        reading, figure, 108 + 30 * max(len(order), 2), margin={"l": 116, "r": 8, "t": 28, "b": 70},
    )  # fmt: skip


def worst(comparison: Comparison, most: int = 1, above: float = 0.0) -> str:
    """The conditions with the largest errors, more than chance: one sentence each, for NRMSE `above` a bound.

    A condition whose error is hardly above the joint's average says nothing, however certain (`telling_ratio`).
    """
    certain = [c for c in comparison.residuals.conditions() if c.p_value < CERTAIN]
    if not certain:
        return "Under no condition is the error of these logs together larger than chance would make it."
    telling = [c for c in certain if c.ratio >= COMPARISON_CRITERIA.telling_ratio]
    if not telling:
        return (
            "No condition stands out: where the error is larger than chance would make it, it is at most "
            f"{max(c.ratio for c in certain):.1f} times the joint's average."
        )
    error = {c: c.ratio * comparison.joints[c.joint].nrmse for c in telling}
    return " ".join(
        f"{_opening(c.condition)}, the error of {c.joint} is {c.ratio:.1f} times its average."
        for c in sorted(telling, key=lambda c: -error[c])[:most]
        if error[c] > above
    )


def _opening(condition: str) -> str:
    phrase = PHRASES.get(condition, condition)
    return phrase[:1].upper() + phrase[1:]


def against(prediction: Prediction, joint: str, variable: str, sliding: bool = False) -> Drawing:
    """Residual of a joint over one variable: median and spread in bins of equally many samples.

    Parameters
    ----------
    variable : {"q", "v", "a", "load", "t"}
    sliding : bool
        Whether the joint is prismatic.
    """
    j = prediction.joints.index(joint)
    x, r = values_of(prediction, j, variable)
    centre, spread = binned(x, r)
    figure = go.Figure()
    bands = ((0, 4, "rgba(213,94,0,0.15)", "90 % of samples"), (1, 3, "rgba(213,94,0,0.35)", "half of them"))
    for low, high, colour, name in bands:
        figure.add_scatter(
            x=plain(np.concatenate([centre, centre[::-1]])), y=plain(np.concatenate([spread[high], spread[low][::-1]])),
            fill="toself", fillcolor=colour, line={"width": 0}, mode="lines", name=name, hoverinfo="skip",
        )  # fmt: skip
    figure.add_scatter(
        x=plain(centre), y=plain(spread[2]), name="median", mode="lines+markers", marker={"size": 5},
        line={"color": VERMILION, "width": 1.8},
    )  # fmt: skip
    units = units_of(sliding)
    figure.update_xaxes(title_text=axis_of(variable, sliding))
    figure.update_yaxes(title_text=f"residual, {units['load']}", zeroline=True)
    reading = "No sample of this joint is in motion."
    if len(centre):
        half = spread[3] - spread[1]
        widest = int(half.argmax())
        times = half[widest] / max(float(np.median(half)), 1e-300)
        reading = (
            f"Median from {number(spread[2].min(), 2)} to {number(spread[2].max(), 2)} {units['load']}. Strong "
            f"shade: half of the samples, faint: 90 %; widest around {number(centre[widest], 2)} {units[variable]}, "
            f"{times:.1f} × the usual."
        )
    return drawing(
        f"Residual against {VARIABLE_WORDS[variable]}", reading, figure, 250, showlegend=False,
        margin={"l": 64, "r": 10, "t": 8, "b": 46},
    )  # fmt: skip


def plane(prediction: Prediction, joint: str, sliding: bool = False) -> Drawing:
    """Rms residual of a joint over position and velocity."""
    j = prediction.joints.index(joint)
    (q, r), (v, _) = values_of(prediction, j, "q"), values_of(prediction, j, "v")
    if len(q) == 0:
        q, v, r = np.zeros((3, 1))
    count, rows, columns = np.histogram2d(v, q, bins=CELLS)
    total, _, _ = np.histogram2d(v, q, bins=(rows, columns), weights=r**2)
    with np.errstate(invalid="ignore", divide="ignore"):
        rms = np.where(count > 0, np.sqrt(total / count), np.nan)
    units = units_of(sliding)
    figure = go.Figure(
        go.Heatmap(
            z=plain(rms), x=plain((columns[1:] + columns[:-1]) / 2), y=plain((rows[1:] + rows[:-1]) / 2),
            colorscale=SCALE, zmin=0, colorbar={"title": {"text": units["load"]}, "thickness": 10, "outlinewidth": 0},
            hovertemplate="q %{x:.3g}, q̇ %{y:.3g}: rms %{z:.3g}<extra></extra>",
        )
    )  # fmt: skip
    figure.update_xaxes(title_text=axis_of("q", sliding), showgrid=False)
    figure.update_yaxes(title_text=axis_of("v", sliding), showgrid=False)
    worst = np.unravel_index(np.nanargmax(rms), rms.shape)
    where = (
        f"q = {number((columns[worst[1]] + columns[worst[1] + 1]) / 2, 2)} {units['q']}, "
        f"q̇ = {number((rows[worst[0]] + rows[worst[0] + 1]) / 2, 2)} {units['v']}"
    )
    return drawing(
        "Rms residual over position and velocity",
        f"The model misses most, {number(float(np.nanmax(rms)), 2)} {units['load']}, around {where}. Blank: "
        "the joint never moved there.",
        figure, 250, margin={"l": 64, "r": 8, "t": 8, "b": 46},
    )  # fmt: skip


def values_of(prediction: Prediction, j: int, variable: str) -> tuple[Array, Array]:
    """A variable and the residual of a joint over the samples in motion, (N,) each."""
    used = prediction.used[:, j]
    source = {"load": prediction.fitted, "q": prediction.q, "v": prediction.v, "a": prediction.a}
    x = prediction.t if variable == "t" else source[variable][:, j]
    return x[used], prediction.residual[used, j]


def binned(x: Array, y: Array, bins: int = BINS) -> tuple[Array, Array]:
    """Quantiles of y in bins of equally many samples of x: centres (B,), quantiles (5, B)."""
    if len(x) == 0:
        return np.zeros(0), np.zeros((len(QUANTILES), 0))
    order = np.array_split(np.argsort(x, kind="stable"), max(1, min(bins, len(x) // 5)))
    centre = np.array([np.median(x[part]) for part in order])
    return centre, np.array([np.percentile(y[part], QUANTILES) for part in order]).T
