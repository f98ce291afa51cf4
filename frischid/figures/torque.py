"""Torque, residual and motion of one joint: panels one above the other on one time axis.

The panels share the axis itself, so a zoom in one is a zoom in all, and one cursor reads all curves at its moment.
Curves of other models, such as an earlier step of this one, are dotted. Each belongs to the number of its model; the
page shows one model at a time.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray

from frischid.core.types import Array
from frischid.figures.style import (
    BLUE,
    FAINT,
    INK,
    MEASURED,
    PURPLE,
    SHADE,
    VERMILION,
    Drawing,
    breaks,
    drawing,
    number,
    plain,
    stack,
    thinned,
    units_of,
)
from frischid.model.comparison import Comparison
from frischid.model.prediction import Prediction

if TYPE_CHECKING:
    from frischid.diagnosis.stretches import Stretch

APART = 0.02  # gap between two logs, as a share of the length of all logs
TIME_MARGIN = 0.01  # empty share of the time axis at each end
BEFORE = {"color": PURPLE, "width": 1.4, "dash": "dot"}
"""Curves of the model before its last step."""
EXCLUDED = "#f3d9b1"


@dataclass(frozen=True, eq=False)
class Overlay:
    """Another model along the same samples."""

    name: str
    """For legends."""
    prediction: Prediction
    visible: bool = True
    """Whether the curves are shown at first."""


def measured(
    prediction: Prediction,
    comparison: Comparison,
    joint: str,
    left_out: Mapping[str, Sequence[Stretch]] | None = None,
    sliding: bool = False,
    within: tuple[float, float] | None = None,
    overlays: Sequence[Overlay] = (),
    motion: bool = False,
) -> Drawing:
    """Torque, band, residual, standstills, excluded parts and the worst moment of one joint.

    Parameters
    ----------
    comparison : Comparison
        On the same logs.
    left_out : mapping of str to sequence of (str, float, float), optional
        Reason ("contact") -> log, start and stop, s: stretches of time that are left out of the joint's diagnosis.
    sliding : bool
        Whether the joint is prismatic.
    within : (float, float), optional
        Stretch of the figure's axis to show, s; everything by default.
    overlays : sequence of Overlay
        Other models, drawn as dotted curves; one that has other samples is left out.
    motion : bool
        Whether to draw position and velocity too, below the residual.
    """
    j, units = prediction.joints.index(joint), units_of(sliding)
    positions, apart = side_by_side(prediction)
    x = prediction.t + positions[prediction.log]
    used = prediction.used[:, j]
    shown = np.where(used, prediction.residual[:, j], np.nan)
    first, last = (float(x.min()), float(x.max())) if within is None else within
    seen = np.flatnonzero((x >= first) & (x <= last))
    keep = seen[thinned(prediction.measured[seen, j], prediction.fitted[seen, j], shown[seen])]
    figure = go.Figure()
    _band(figure, x[keep], prediction.lower[keep, j], prediction.upper[keep, j], prediction.log[keep], "band")
    curves = [
        *_of_the_overlays(prediction, overlays, j),  # behind the curves of this model
        Curve("measured", prediction.measured[:, j], {"color": MEASURED, "width": 2.6}),
        Curve("model", prediction.fitted[:, j], {"color": BLUE, "width": 1.2}),
        Curve("residual", shown, {"color": VERMILION, "width": 1.0}, 1),
    ]
    if motion:
        curves += [
            Curve("q", prediction.q[:, j], {"color": INK, "width": 1.2}, 2, legend=False),
            Curve("q̇", prediction.v[:, j], {"color": INK, "width": 1.2}, 3, legend=False),
        ]
    _curves(figure, x, prediction, keep, curves)
    _shade(figure, x, ~used, prediction.log, SHADE, "standstill")
    for reason, stretches in (left_out or {}).items():
        _shade(figure, x, _within(prediction, stretches), prediction.log, EXCLUDED, reason)
    in_view = np.where(np.isin(np.arange(len(x)), seen), shown, np.nan)
    reading = _worst(figure, comparison, prediction, joint, x, in_view, units["load"])
    for start in positions[1:]:
        figure.add_shape(
            type="line", x0=float(start - apart / 2), x1=float(start - apart / 2), y0=0, y1=1, xref="x", yref="paper",
            line={"color": FAINT, "width": 1, "dash": "dot"},
        )  # fmt: skip
    titles = [f"torque, {units['load']}", f"residual, {units['load']}"]
    stack(figure, [*titles, *([f"q, {units['q']}", f"q̇, {units['v']}"] if motion else [])])
    several = len(prediction.sources) > 1
    margin = TIME_MARGIN * (last - first)
    # The same title for every joint, so that figures can be compared.
    figure.update_xaxes(
        title_text=f"time, s{' (logs side by side)' if several else ''}", range=[first - margin, last + margin]
    )
    title = f"{joint}: measured and predicted torque{', and the motion' if motion else ''}"
    return drawing(title, reading, figure, 470 if motion else 340)


@dataclass(frozen=True, eq=False)
class Curve:
    """One curve: its name, values (N,), line, panel from above, number of its overlay, and place in the legend."""

    name: str
    values: Array
    line: dict[str, Any]
    panel: int = 0
    overlay: int | None = None
    legend: bool = True
    visible: bool = True


def _of_the_overlays(prediction: Prediction, overlays: Sequence[Overlay], j: int) -> Iterator[Curve]:
    """Torque and residual of the other models that have the same samples."""
    for k, overlay in enumerate(overlays):
        other = overlay.prediction
        if other.fitted.shape != prediction.fitted.shape:
            continue
        residual = np.where(other.used[:, j], other.residual[:, j], np.nan)
        yield Curve(overlay.name, other.fitted[:, j], BEFORE, overlay=k, visible=overlay.visible)
        yield Curve(f"residual {overlay.name}", residual, BEFORE, 1, k, False, overlay.visible)


def _curves(
    figure: go.Figure, x: Array, prediction: Prediction, keep: NDArray[np.intp], curves: Sequence[Curve]
) -> None:
    """Draw the kept samples of curves, broken between logs; the measured one says the moment within its log."""
    log = prediction.log
    broken = breaks(log[keep])
    several = len(prediction.sources) > 1
    shared = plain(np.insert(x[keep], broken, np.nan))
    for curve in curves:
        own: dict[str, Any] = {"hovertemplate": "%{y:.4g}"}
        if several and curve.name == "measured":
            within = np.insert(prediction.t[keep], broken, np.nan)
            number = np.insert(log[keep] + 1.0, broken, np.nan)
            own = {
                "customdata": plain(np.column_stack([within, number])),
                "hovertemplate": "%{y:.4g} (log %{customdata[1]}, %{customdata[0]:.2f} s)",
            }
        if curve.overlay is not None:
            own |= {"meta": {"overlay": curve.overlay, "residual": curve.panel == 1}, "visible": curve.visible}
        figure.add_scatter(
            x=shared, y=plain(np.insert(curve.values[keep], broken, np.nan)), name=curve.name, line=curve.line,
            mode="lines", yaxis=f"y{curve.panel + 1}" if curve.panel else "y", showlegend=curve.legend, **own,
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
        line={"width": 0}, mode="lines", name=name, hoverinfo="skip",
    )  # fmt: skip


def _within(prediction: Prediction, stretches: Sequence[Stretch]) -> NDArray[np.bool_]:
    """Samples within some stretches of their logs, (N,)."""
    sources = np.array(prediction.sources)[prediction.log]
    absolute = prediction.t + np.array(prediction.starts)[prediction.log]
    found = np.zeros(len(absolute), bool)
    for source, start, stop in stretches:
        found |= (sources == source) & (absolute >= start) & (absolute <= stop)
    return found


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
        hoverinfo="skip",
    )  # fmt: skip


def _worst(
    figure: go.Figure, comparison: Comparison, prediction: Prediction, joint: str, x: Array, shown: Array, unit: str
) -> str:
    """Mark the worst moment, and return the text that explains the figure."""
    fit = comparison.joints[joint]
    error = np.where(np.isnan(shown), -1.0, np.abs(shown))
    k = int(error.argmax())
    figure.add_scatter(
        x=[float(x[k])], y=[float(shown[k])], mode="markers", name="worst", yaxis="y2", cliponaxis=False,
        marker={"symbol": "x", "size": 9, "color": INK}, hoverinfo="skip",
    )  # fmt: skip
    j = prediction.joints.index(joint)
    source = _name(prediction.sources[prediction.log[k]])
    beside = f" ({x[k]:.2f} s in the figure)" if prediction.log[k] > 0 else ""
    where = f" of {source}{beside}" if len(prediction.sources) > 1 else ""
    over = "Over all logs, the" if len(prediction.sources) > 1 else "The"
    return (
        f"{over} rms error is {number(fit.rmse, 3)} {unit}, {100 * fit.nrmse:.1f} % of the torque's standard deviation "
        f"(sensors alone: {100 * fit.noise_floor:.1f} %). Worst at {prediction.t[k]:.2f} s{where}: measured "
        f"{number(prediction.measured[k, j], 3)} {unit}, model {number(prediction.fitted[k, j], 3)} {unit}."
    )


def _name(source: str) -> str:
    return source.replace("\\", "/").rsplit("/", 1)[-1]
