"""A model along some logs: measured torque, the model's, the band around it, and the motion.

For a torque row y, with the residual variance σ² and the covariance C of the parameters, the band is

    y θ̂ ± sqrt((r σ)² + z² s y C yᵀ),

with r from the errors on stretches of time that were left out of the fit (`frischid.model.residual_scores`), z of a
normal distribution, and the share s of C that is the model's own error (`frischid.model.fit_record`). Noise and the
model's own error are in the band. A change of the robot since the fit is not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from frischid.core.types import Array
from frischid.errors import InputError
from frischid.logs.log import Log
from frischid.model.fit_record import half_width
from frischid.model.model import Model
from frischid.regression.block import Block

INTERVAL = 0.9
"""Share of the measurements that the band is to hold."""


@dataclass(frozen=True, eq=False)
class Prediction:
    """Filtered samples of some logs under a model; M samples, J joints whose torque the model predicts."""

    joints: tuple[str, ...]
    sources: tuple[str, ...]
    """The logs, in order."""
    starts: tuple[float, ...]
    """First time stamp of each log, s."""
    log: NDArray[np.intp]
    """Position in `sources` of each sample's log, (M,)."""
    t: Array
    """Time since that log's first sample, s, (M,)."""
    q: Array
    v: Array
    a: Array
    """`q`, `v`, `a`: rad, rad/s, rad/s² (m, m/s, m/s² for prismatic joints), (M, J)."""
    measured: Array
    fitted: Array
    lower: Array
    upper: Array
    """`measured`, `fitted`, `lower`, `upper`: Torque, N·m (N), (M, J): measured, the model's, and the band around it.
    """
    used: NDArray[np.bool_]
    """False where the joint rests, so that its dry friction is undetermined, (M, J)."""

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
    logs : sequence of Log
        At least one; each must hold position and torque of the model's joints.
    evaluated : sequence of sequence of (Block, ndarray), optional
        ``model.blocks([log])`` of each log, where the caller has it already.
    """
    if not logs:
        raise InputError("there is no log to predict; give at least one")
    index = model.torque_index
    parts: dict[str, list[Array]] = {
        k: [] for k in ("t", "q", "v", "a", "measured", "fitted", "lower", "upper", "used")
    }
    numbers: list[NDArray[np.intp]] = []
    for number, log in enumerate(logs):
        for block, fitted in model.blocks([log]) if evaluated is None else evaluated[number]:
            known = block.known[:, index]
            half = half_width(model.estimate, model.fitted, block.Y[:, list(model.base)][:, :, index], INTERVAL)
            torques = (block.tau[:, index], fitted[:, index], fitted[:, index] - half, fitted[:, index] + half)
            motion = (block.t - log.t[0], block.q[:, index], block.v[:, index], block.a[:, index])
            rows = (*motion, *(x + known for x in torques), block.used[:, index])
            for store, values in zip(parts.values(), rows, strict=True):
                store.append(values)
            numbers.append(np.full(len(block.t), number))
    whole = {k: np.concatenate(x) for k, x in parts.items()}
    used = whole.pop("used").astype(bool)
    sources, starts = tuple(log.source for log in logs), tuple(float(log.t[0]) for log in logs)
    return Prediction(model.joints, sources, starts, np.concatenate(numbers), **whole, used=used)
