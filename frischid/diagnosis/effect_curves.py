"""What a finding would add to the model, on the residual it was found in.

Adding an effect C β also changes the base parameters by Δθ. What the model's torque changes by is

    Δτ̂ = Y Δθ + C β,

and that, not C β alone, is what the residual should look like. It is shown over the one quantity (position, velocity,
acceleration or load; time if it is a function of none of these) of which it is most a function: the one whose bins
explain the largest share of its variance,

    η² = Σ_bins n_b (mean_b Δτ̂ − mean Δτ̂)² / Σ (Δτ̂ − mean Δτ̂)²    (correlation ratio, Pearson 1905).

An effect with memory is a function of none of them; it is shown along the stretch of time where it explains most.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from frischid.core.types import Array
from frischid.diagnosis.cross_validation import Evidence
from frischid.diagnosis.diagnosis import Diagnosis
from frischid.diagnosis.findings import Finding
from frischid.diagnosis.motion_cache import Indices
from frischid.model.prediction import Prediction

BINS = 24
VARIABLES = ("q", "v", "a", "load", "t")
FUNCTION = 0.5  # η² below which the torque is no function of a single variable
STRETCH = 12.0  # s shown of such an effect


@dataclass(frozen=True, eq=False)
class Shape:
    """Residual of one joint and what a finding would explain of it, over N samples.

    Attributes
    ----------
    effect, joint : str
    variable : {"q", "v", "a", "load", "t"}
    x : ndarray, shape (N,)
        Values of the variable: rad, rad/s, rad/s² (m, ...), N·m of the model's torque, s since the log's beginning.
    residual, added : ndarray, shape (N,)
        Measured less predicted torque, and what the model's torque would change by, N·m (N).
    explained : float
        Share of the joint's squared residual, over all samples, that it explains.
    stretch : str
        The log, when what is shown is a stretch of one; otherwise empty, and all samples are shown.
    """

    effect: str
    joint: str
    variable: str
    x: Array
    residual: Array
    added: Array
    explained: float
    stretch: str = ""


def shape_of(diagnosis: Diagnosis, finding: Finding, prediction: Prediction) -> Shape | None:
    """Shape of a finding on the joint where it removes most.

    Parameters
    ----------
    diagnosis : Diagnosis
    finding : Finding
        One of its findings.
    prediction : Prediction
        Of the diagnosed model along the same logs in the same order (``logs`` then ``valid``).

    Returns
    -------
    Shape or None
        None when the finding names no effect (contact, unknown), or its columns cannot be fitted here.
    """
    evidence = diagnosis.evidence
    if not finding.members:
        return None
    candidate = evidence.joined(evidence.project(finding.members))
    fit = evidence.fit(*evidence.moments(candidate), candidate, None)
    if fit is None or sum(len(t) for t in evidence.times) != len(prediction.t):
        return None
    best: tuple[float, int, Array, Array] | None = None
    for row in range(len(evidence.joints)):
        parts = [
            (
                part.tau,
                part.tau - evidence.predicted(part, evidence.theta),
                evidence.predicted(part, fit.change, candidate, fit.beta),
            )
            for part in evidence.data.parts(row)
        ]
        tau, residual, added = map(np.concatenate, zip(*parts, strict=True))
        removed = float((residual**2).sum() - ((residual - added) ** 2).sum()) / max(float((tau**2).sum()), 1e-300)
        if best is None or removed > best[0]:
            best = (removed, row, residual, added)
    assert best is not None  # a model has at least one joint
    _, row, residual, added = best
    where = _samples(evidence, row)
    columns = {k: getattr(prediction, k)[where, row] for k in ("q", "v", "a")}
    columns |= {"load": prediction.fitted[where, row], "t": prediction.t[where]}
    scores = {k: correlation_ratio(columns[k], added) for k in VARIABLES}
    physical = max(VARIABLES[:-1], key=lambda k: scores[k])
    variable = physical if scores[physical] >= FUNCTION else VARIABLES[-1]  # of a slow motion all is a function of time
    joint = evidence.joints[row]
    explained = 1.0 - float(((residual - added) ** 2).sum() / max(float((residual**2).sum()), 1e-300))
    if scores[variable] >= FUNCTION:
        return Shape(finding.effect, joint, variable, columns[variable], residual, added, explained)
    log, t = prediction.log[where], prediction.t[where]
    part, source = _best_stretch(log, t, residual**2 - (residual - added) ** 2)
    return Shape(
        finding.effect, joint, "t", t[part], residual[part], added[part], explained, prediction.sources[source]
    )


def _best_stretch(log: Indices, t: Array, gain: Array) -> tuple[Indices, int]:
    """Samples of the stretch of `STRETCH` seconds over which `gain` sums to most, and its log."""
    best, found, source = -np.inf, np.arange(len(t)), int(log[0])
    for k in np.unique(log):
        part = np.flatnonzero(log == k)
        total = np.concatenate([[0.0], np.cumsum(gain[part])])
        ends = np.searchsorted(t[part], t[part] + STRETCH, side="right")
        sums = total[ends] - total[:-1]
        first = int(sums.argmax())
        if sums[first] > best:
            best, found, source = float(sums[first]), part[first : ends[first]], int(k)
    return found, source


def correlation_ratio(x: Array, y: Array, bins: int = BINS) -> float:
    """Share of the variance of y that the means over quantile bins of x explain, in [0, 1]."""
    edges = np.unique(np.quantile(x, np.linspace(0, 1, bins + 1)))
    if len(edges) < 3 or not np.ptp(y) > 0:
        return 0.0
    where = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, len(edges) - 2)
    count = np.bincount(where, minlength=len(edges) - 1)
    mean = np.bincount(where, y, minlength=len(edges) - 1) / np.maximum(count, 1)
    return float((count * (mean - y.mean()) ** 2).sum() / ((y - y.mean()) ** 2).sum())


def _samples(evidence: Evidence, row: int) -> Indices:
    """Which of all filtered samples, motion after motion, the rows of a joint are."""
    offsets = np.concatenate([[0], np.cumsum([len(t) for t in evidence.times])]).astype(int)
    parts = evidence.data.parts(row)
    return np.concatenate([start + part.picked for start, part in zip(offsets, parts, strict=False)])
