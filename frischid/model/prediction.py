"""A model along some logs: measured torque, the model's, the band its bounds predict, and the motion they belong to.

A torque row is linear in the parameters, so their bounds and their covariance carry over directly. For bounds
l ≤ θ ≤ u, and for a covariance C of the estimate with residual variance σ²,

    Σ_c min(y_c l_c, y_c u_c) ≤ y θ ≤ Σ_c max(y_c l_c, y_c u_c),        y θ̂ ± 1.645 sqrt(σ² + y C yᵀ).

The first band holds the torque of the true parameters; neither noise nor a missing effect is in it. The second holds
90 % of the measurements, if the robot is the one that was fitted: noise and the model's own error are in it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from frischid.core.types import Array
from frischid.errors import InputError
from frischid.logs.log import Log
from frischid.model.model import Model
from frischid.regression.block import Block

INTERVAL = 0.9
"""Share of the measurements that the band of a covariance is to hold."""


@dataclass(frozen=True, eq=False)
class Prediction:
    """Filtered samples of some logs under a model; M samples, J joints whose torque the model predicts.

    Attributes
    ----------
    joints : tuple of str
    sources : tuple of str
        The logs, in order.
    starts : tuple of float
        First time stamp of each log, s.
    log : ndarray of int, shape (M,)
        Position in `sources` of each sample's log.
    t : ndarray, shape (M,)
        Time since that log's first sample, s.
    q, v, a : ndarray, shape (M, J)
        rad, rad/s, rad/s² (m, m/s, m/s² for prismatic joints).
    measured, fitted, lower, upper : ndarray, shape (M, J)
        Torque, N·m (N): measured, the model's, and the band around it.
    used : ndarray of bool, shape (M, J)
        False where the joint rests, so that its dry friction is undetermined.
    band : str
        What the band is.
    """

    joints: tuple[str, ...]
    sources: tuple[str, ...]
    starts: tuple[float, ...]
    log: NDArray[np.intp]
    t: Array
    q: Array
    v: Array
    a: Array
    measured: Array
    fitted: Array
    lower: Array
    upper: Array
    used: NDArray[np.bool_]
    band: str

    @property
    def residual(self) -> Array:
        """Measured less predicted torque, (M, J), N·m (N)."""
        return self.measured - self.fitted


def predict(
    model: Model, logs: Sequence[Log], evaluated: Sequence[Sequence[tuple[Block, Array]]] | None = None
) -> Prediction:
    """Evaluate a model along logs.

    Parameters
    ----------
    model : Model
    logs : sequence of Log
        At least one; each must hold position and torque of the model's joints.
    evaluated : sequence of sequence of (Block, ndarray), optional
        ``model.blocks([log])`` of each log, where the caller has it already.

    Returns
    -------
    Prediction
    """
    if not logs:
        raise InputError("there is no log to predict")
    index = model.torque_index
    band = _Band(model)
    parts: dict[str, list[Array]] = {
        k: [] for k in ("t", "q", "v", "a", "measured", "fitted", "lower", "upper", "used")
    }
    numbers: list[NDArray[np.intp]] = []
    for number, log in enumerate(logs):
        for block, fitted in model.blocks([log]) if evaluated is None else evaluated[number]:
            known = block.known[:, index]
            low, high = band(block.Y[:, list(model.base)][:, :, index], fitted[:, index])
            torques = (block.tau[:, index], fitted[:, index], low, high)
            motion = (block.t - log.t[0], block.q[:, index], block.v[:, index], block.a[:, index])
            rows = (*motion, *(x + known for x in torques), block.used[:, index])
            for store, values in zip(parts.values(), rows, strict=True):
                store.append(values)
            numbers.append(np.full(len(block.t), number))
    whole = {k: np.concatenate(x) for k, x in parts.items()}
    used = whole.pop("used").astype(bool)
    sources, starts = tuple(log.source for log in logs), tuple(float(log.t[0]) for log in logs)
    return Prediction(model.joints, sources, starts, np.concatenate(numbers), **whole, used=used, band=band.name)


class _Band:
    """Lower and upper torque that the parameters' bounds allow."""

    def __init__(self, model: Model) -> None:
        self.estimate, self.reach = model.estimate, NormalDist().inv_cdf(0.5 + 0.5 * INTERVAL)
        self.theta = model.estimate.theta
        box = model.bounds.get("sensorwise")
        whole = box is not None and bool(np.isfinite(box.lower).all() and np.isfinite(box.upper).all())
        self.box = box if whole else None
        self.name = "sensor-wise Frisch bounds" if whole else "90 % of measurements"

    def __call__(self, Y: Array, fitted: Array) -> tuple[Array, Array]:
        """Band of rows Y (M, p, J) around their torque (M, J)."""
        if self.box is not None:
            low, high = (b - self.theta for b in (self.box.lower, self.box.upper))
            middle, half = (high + low) / 2, (high - low) / 2
            centre = fitted + np.einsum("mpj,p->mj", Y, middle)
            reach = np.einsum("mpj,p->mj", np.abs(Y), half)
            return centre - reach, centre + reach
        half = self.reach * np.sqrt(self.estimate.error_variance(Y))
        return fitted - half, fitted + half
