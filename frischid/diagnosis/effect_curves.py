"""Curve of a finding: the change of the model's torque by the effect, beside the residual in which it was found.

An effect C β also changes the base parameters, by Δθ. The model's torque changes by

    Δτ̂ = Y Δθ + C β,

and the residual should look like that sum, not like C β alone. The curve is drawn over one quantity (position,
velocity, acceleration, load, or time): the one whose bins explain the largest share of the variance of Δτ̂,

    η² = Σ_bins n_b (mean_b Δτ̂ − mean Δτ̂)² / Σ (Δτ̂ − mean Δτ̂)²    (correlation ratio, Pearson 1905).

An effect with memory is a function of none of these; its curve is drawn along the stretch of time where it explains
most. The constants of this module choose a picture. They change no result.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from frischid.core.types import Array
from frischid.diagnosis.cached_motion import Indices
from frischid.diagnosis.candidate_columns import Candidate
from frischid.diagnosis.candidate_fits import CandidateFit
from frischid.diagnosis.cross_validation import CrossValidator
from frischid.diagnosis.findings import Finding
from frischid.diagnosis.result import Diagnosis
from frischid.model.prediction import Prediction

_BINS = 24  # quantiles of a variable
_VARIABLES = ("q", "v", "a", "load", "t")
_LEAST_RATIO = 0.5  # η² below which the torque is not a function of one variable
_STRETCH = 12.0  # s: the stretch of time that is drawn then


@dataclass(frozen=True, eq=False)
class Shape:
    """Residual of one joint and the part of it that a finding explains, over N samples."""

    effect: str
    joint: str
    variable: str
    x: Array
    """Values of the variable, (N,): q, v, a in rad, rad/s, rad/s² (m, ...), load in N·m (N), t in s since the log
    began."""
    residual: Array
    added: Array
    """`residual`, `added`: Measured less predicted torque, and the change of the model's torque, N·m (N), (N,)."""
    stretch: str = ""
    """Name of the log, when only a stretch of that log is drawn; empty when all samples are drawn."""


def shape_of(diagnosis: Diagnosis, finding: Finding, prediction: Prediction) -> Shape | None:
    """Curve of a finding: of the joints that the effect acts on, the one where it explains most.

    Parameters
    ----------
    finding : Finding
        One of its findings.
    prediction : Prediction
        Of the diagnosed model along the diagnosed logs, in the same order; other logs may come between.

    Returns
    -------
    Shape or None
        None when the finding names no effect (contact, unknown), or its columns cannot be fitted here.
    """
    validator = diagnosis.validator
    if not finding.members:
        return None
    candidate = validator.joined(validator.candidates(finding.members))
    fit = validator.fitted(candidate)
    prediction = _along(prediction, set(validator.data.sources))
    if fit is None or sum(len(t) for t in validator.data.times) != len(prediction.t):
        return None
    curves = [_curve(validator, row, candidate, fit) for row in range(len(validator.joints))]
    acts = [k for k, name in enumerate(validator.joints) if name in finding.joints]
    row = max(acts or range(len(curves)), key=lambda k: curves[k].share)
    residual, added = curves[row].residual, curves[row].added
    where, joint = _samples(validator, row), validator.joints[row]
    place = prediction.joints.index(joint)  # the prediction also has the joints that never move
    columns = {k: getattr(prediction, k)[where, place] for k in ("q", "v", "a")}
    columns |= {"load": prediction.fitted[where, place], "t": prediction.t[where]}
    scores = {k: correlation_ratio(columns[k], added) for k in _VARIABLES}
    physical = max(_VARIABLES[:-1], key=lambda k: scores[k])
    # Everything in a slow motion is a function of time: time is the last resort.
    variable = physical if scores[physical] >= _LEAST_RATIO else _VARIABLES[-1]
    if scores[variable] >= _LEAST_RATIO:
        return Shape(finding.effect, joint, variable, columns[variable], residual, added)
    log, t = prediction.log[where], prediction.t[where]
    part, source = _best_stretch(log, t, residual**2 - (residual - added) ** 2)
    return Shape(finding.effect, joint, "t", t[part], residual[part], added[part], prediction.sources[source])


def _along(prediction: Prediction, sources: Collection[str]) -> Prediction:
    """The prediction along some of its logs."""
    kept = np.isin(prediction.log, [k for k, source in enumerate(prediction.sources) if source in sources])
    parts = ("log", "t", "q", "v", "a", "measured", "fitted", "lower", "upper", "used")
    return replace(prediction, **{name: getattr(prediction, name)[kept] for name in parts})


class _Curve(NamedTuple):
    """Residual and added torque of one joint, (n,) each, and the share of its squared torque that is explained."""

    residual: Array
    added: Array
    share: float


def _curve(validator: CrossValidator, row: int, candidate: Candidate, fit: CandidateFit) -> _Curve:
    parts = [
        (
            data.tau,
            validator.columns.residual(data, validator.theta),
            validator.columns.predicted(data, fit.change, candidate, fit.beta),
        )
        for data in validator.data.motions_of(row)
    ]
    tau, residual, added = map(np.concatenate, zip(*parts, strict=True))
    fall = float((residual**2).sum() - ((residual - added) ** 2).sum())
    return _Curve(residual, added, fall / max(float((tau**2).sum()), 1e-300))


def _best_stretch(log: Indices, t: Array, gain: Array) -> tuple[Indices, int]:
    """Samples of the stretch of `_STRETCH` seconds with the largest sum of `gain`, and its log."""
    best, found, source = -np.inf, np.arange(len(t)), int(log[0])
    for k in np.unique(log):
        part = np.flatnonzero(log == k)
        total = np.concatenate([[0.0], np.cumsum(gain[part])])
        ends = np.searchsorted(t[part], t[part] + _STRETCH, side="right")
        sums = total[ends] - total[:-1]
        first = int(sums.argmax())
        if sums[first] > best:
            best, found, source = float(sums[first]), part[first : ends[first]], int(k)
    return found, source


def correlation_ratio(x: Array, y: Array) -> float:
    """Share of the variance of y that the means over quantile bins of x explain, in [0, 1]."""
    edges = np.unique(np.quantile(x, np.linspace(0, 1, _BINS + 1)))
    if len(edges) < 3 or not np.ptp(y) > 0:
        return 0.0
    where = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, len(edges) - 2)
    count = np.bincount(where, minlength=len(edges) - 1)
    mean = np.bincount(where, y, minlength=len(edges) - 1) / np.maximum(count, 1)
    return float((count * (mean - y.mean()) ** 2).sum() / ((y - y.mean()) ** 2).sum())


def _samples(validator: CrossValidator, row: int) -> Indices:
    """Positions of a joint's rows among all filtered samples, motion after motion."""
    offsets = np.concatenate([[0], np.cumsum([len(t) for t in validator.data.times])]).astype(int)
    motions = validator.data.motions_of(row)
    return np.concatenate([start + data.picked for start, data in zip(offsets, motions, strict=False)])
