"""Measured and predicted torque of one joint above, the residual below, on the same time axis."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray
from plotly.subplots import make_subplots

from frischid.core.types import Array
from frischid.figures.style import (
    BLUE,
    FAINT,
    INK,
    MEASURED,
    ORANGE,
    SHADE,
    VERMILION,
    Drawing,
    breaks,
    drawing,
    number,
    plain,
    thinned,
)
from frischid.model.comparison import Comparison
from frischid.model.prediction import Prediction

if TYPE_CHECKING:
    from frischid.diagnosis.contacts import Contact

APART = 0.02  # gap between two logs, as a share of the length of all logs
TIME_MARGIN = 0.01  # empty share of the time axis at each end
BEFORE = {"color": ORANGE, "width": 1.4, "dash": "dot"}
"""Curves of the model before its last step."""
EXCLUDED = "#f3d9b1"


def measured(
    prediction: Prediction,
    comparison: Comparison,
    joint: str,
    contacts: Sequence[Contact] = (),
    unit: str = "N·m",
    at: float | None = None,
    within: tuple[float, float] | None = None,
    ghost: Prediction | None = None,
) -> Drawing:
    """Torque, band, residual, standstills, excluded parts and the worst moment of one joint.

    Parameters
    ----------
    prediction : Prediction
    comparison : Comparison
        On the same logs.
    joint : str
    contacts : sequence of Contact
        Stretches of time that are left out of the diagnosis.
    unit : str
        Unit of the torque.
    at : float, optional
        A moment to mark, s on the figure's axis.
    within : (float, float), optional
        Stretch of the figure's axis to show, s; everything by default.
    ghost : Prediction, optional
        The same samples under an earlier model, drawn as a faint curve.
    """
    j = prediction.joints.index(joint)
    positions, apart = side_by_side(prediction)
    x = prediction.t + positions[prediction.log]
    used, residual = prediction.used[:, j], prediction.residual[:, j]
    shown = np.where(used, residual, np.nan)
    first, last = (float(x.min()), float(x.max())) if within is None else within
    seen = np.flatnonzero((x >= first) & (x <= last))
    keep = seen[thinned(prediction.measured[seen, j], prediction.fitted[seen, j], shown[seen])]
    figure = make_subplots(rows=2, cols=1, shared_xaxes=True, row_heights=[0.57, 0.43], vertical_spacing=0.05)
    _band(figure, x[keep], prediction.lower[keep, j], prediction.upper[keep, j], prediction.log[keep], "band")
    curves = [
        ("measured", prediction.measured[:, j], {"color": MEASURED, "width": 2.6}, 1),
        ("model", prediction.fitted[:, j], {"color": BLUE, "width": 1.2}, 1),
        ("residual", shown, {"color": VERMILION, "width": 1.0}, 2),
    ]
    if ghost is not None and ghost.fitted.shape == prediction.fitted.shape:
        before = np.where(ghost.used[:, j], ghost.residual[:, j], np.nan)
        curves = [("before", ghost.fitted[:, j], BEFORE, 1), *curves, ("residual before", before, BEFORE, 2)]
    _curves(figure, x, prediction.log, keep, curves, unit)
    _shade(figure, x, ~used, prediction.log, SHADE, "standstill")
    excluded = np.zeros(len(x), bool)
    for c in contacts:
        inside = np.array([prediction.sources[k] == c.source for k in prediction.log])
        absolute = prediction.t + np.array(prediction.starts)[prediction.log]
        excluded |= inside & (absolute >= c.start) & (absolute <= c.stop) & (joint in c.joints)
    _shade(figure, x, excluded, prediction.log, EXCLUDED, "contact")
    reading = _worst(
        figure, comparison, prediction, joint, x, np.where(np.isin(np.arange(len(x)), seen), shown, np.nan), unit
    )
    for start in positions[1:]:
        figure.add_vline(x=float(start - apart / 2), line={"color": FAINT, "width": 1, "dash": "dot"})
    if at is not None:
        figure.add_vline(x=at, line={"color": INK, "width": 1.5})
    figure.update_yaxes(title_text=f"torque, {unit}", row=1, col=1)
    figure.update_yaxes(title_text=f"residual, {unit}", row=2, col=1)
    several = len(prediction.sources) > 1
    figure.update_xaxes(title_text=f"time, s{' (logs side by side)' if several else ''}", row=2, col=1)
    margin = TIME_MARGIN * (last - first)
    # The same title for every joint, so that figures can be compared.
    figure.update_xaxes(range=[first - margin, last + margin])
    return drawing(f"{joint}: measured and predicted torque", reading, figure, 340)


def _curves(
    figure: go.Figure,
    x: Array,
    log: NDArray[np.intp],
    keep: NDArray[np.intp],
    curves: Sequence[tuple[str, Array, dict[str, Any], int]],
    unit: str,
) -> None:
    """Draw the kept samples of named curves, broken between logs."""
    broken = breaks(log[keep])
    for name, values, line, row in curves:
        figure.add_scatter(
            x=plain(np.insert(x[keep], broken, np.nan)), y=plain(np.insert(values[keep], broken, np.nan)),
            name=name, line=line, mode="lines", row=row, col=1, hovertemplate="%{x:.2f} s: %{y:.4g} " + unit,
            showlegend=name != "residual before",
        )  # fmt: skip


def side_by_side(prediction: Prediction) -> tuple[Array, float]:
    """Begin of each log on a common axis, (logs,), and the gap between two logs, s."""
    ends = np.array([prediction.t[prediction.log == k].max(initial=0.0) for k in range(len(prediction.sources))])
    apart = APART * float(ends.sum())
    return np.concatenate([[0.0], np.cumsum(ends + apart)[:-1]]), apart


def _band(figure: go.Figure, x: Array, low: Array, high: Array, log: NDArray[np.intp], name: str) -> None:
    """One closed outline per log."""
    xs: list[Array] = []
    ys: list[Array] = []
    for one in np.unique(log):
        part = log == one
        xs += [x[part], x[part][::-1], np.array([np.nan])]
        ys += [high[part], low[part][::-1], np.array([np.nan])]
    figure.add_scatter(
        x=plain(np.concatenate(xs)), y=plain(np.concatenate(ys)), fill="toself", fillcolor="rgba(86,180,233,0.45)",
        line={"width": 0}, mode="lines", name=name, hoverinfo="skip", row=1, col=1,
    )  # fmt: skip


def _shade(
    figure: go.Figure, x: Array, inside: NDArray[np.bool_], log: NDArray[np.intp], colour: str, name: str
) -> None:
    """Shade stretches of time behind both panels, as one path; no stretch reaches from one log into the next."""
    if not inside.any():
        return
    edges = np.flatnonzero(np.diff(np.concatenate([[0], inside.astype(int), [0]])))
    # If one log ends and the next begins in a shaded part, one stretch ends and another begins.
    next_too = breaks(log)[inside[breaks(log)] & inside[breaks(log) - 1]]
    edges = np.sort(np.concatenate([edges, next_too, next_too]))
    step = float(np.median(np.diff(x))) / 2
    path = "".join(
        f"M{x[a] - step:.4g},0L{x[b - 1] + step:.4g},0L{x[b - 1] + step:.4g},1L{x[a] - step:.4g},1Z"
        for a, b in zip(edges[::2], edges[1::2], strict=True)
    )
    figure.add_shape(type="path", path=path, xref="x", yref="paper", fillcolor=colour, line={"width": 0}, layer="below")
    figure.add_scatter(
        x=[None], y=[None], mode="markers", marker={"symbol": "square", "size": 12, "color": colour}, name=name,
        row=1, col=1,
    )  # fmt: skip


def _worst(
    figure: go.Figure, comparison: Comparison, prediction: Prediction, joint: str, x: Array, shown: Array, unit: str
) -> str:
    """Mark the worst moment, and return the text that explains the figure."""
    fit = comparison.joints[joint]
    error = np.where(np.isnan(shown), -1.0, np.abs(shown))
    k = int(error.argmax())
    figure.add_scatter(
        x=[float(x[k])], y=[float(shown[k])], mode="markers", name="worst", row=2, col=1, cliponaxis=False,
        marker={"symbol": "x", "size": 9, "color": INK},
    )  # fmt: skip
    j = prediction.joints.index(joint)
    where = f" of {_name(prediction.sources[prediction.log[k]])}" if len(prediction.sources) > 1 else ""
    return (
        f"The rms error is {number(fit.rmse, 3)} {unit}, {100 * fit.nrmse:.1f} % of the torque's standard deviation "
        f"(sensors alone: {100 * fit.noise_floor:.1f} %). Worst at {prediction.t[k]:.2f} s{where}: measured "
        f"{number(prediction.measured[k, j], 3)} {unit}, model {number(prediction.fitted[k, j], 3)} {unit}."
    )


def _name(source: str) -> str:
    return source.replace("\\", "/").rsplit("/", 1)[-1]
