"""The error to expect of a model on a motion, before any torque of that motion is seen.

With the residual variance σ_j² of joint j on the fitted logs and the covariance C of the parameters,

    E (τ − y θ)² = σ_j² + y C yᵀ.

With a prior, C holds the model's own error too (`frischid.estimators.map_estimate`), and the formula holds away from
the fitted motion. Without a prior, C is of noise alone, and the expectation is too small there.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from frischid.core.types import Array
from frischid.model.model import Model
from frischid.regression.block import Block

SAMPLES = 500
"""Samples per block whose uncertainty is computed: its mean needs no more, and all of them would cost a second pass."""


@dataclass(eq=False)
class ExpectedError:
    """Expected error and reach of logs, gathered block by block."""

    model: Model
    squares: Array = field(init=False)
    """Sum of the expected squared errors of the samples looked at, (J,)."""
    outside: Array = field(init=False)
    """Samples faster, or with more acceleration, than the fitted logs reach, (J,)."""
    count: Array = field(init=False)
    """Samples looked at in which the joint moves, (J,)."""

    def __post_init__(self) -> None:
        self.squares, self.outside, self.count = np.zeros((3, len(self.model.joints)))

    def add(self, block: Block) -> None:
        """Take in a block."""
        index = self.model.torque_index
        some = slice(None, None, max(1, len(block.t) // SAMPLES))
        Y = block.Z[some][:, list(self.model.base)][:, :, index]
        used = block.used[some][:, index]
        noise = self.model.estimate.sigma**2
        share = 1.0 if self.model.fitted is None else self.model.fitted.model_share
        expected = noise + share * (self.model.estimate.error_variance(Y) - noise)
        self.squares += (expected * used).sum(axis=0)
        self.count += used.sum(axis=0)
        reach = self.model.fitted
        if reach is not None:
            beyond = (np.abs(block.v[some][:, index]) > reach.velocity) | (
                np.abs(block.a[some][:, index]) > reach.acceleration
            )
            self.outside += (beyond & used).sum(axis=0)

    @property
    def rms(self) -> Array:
        """Expected root mean square error of each joint, N·m (N), (J,)."""
        return np.asarray(np.sqrt(self.squares / np.maximum(self.count, 1)))

    @property
    def outside_share(self) -> Array:
        """Share of each joint's samples that the fitted logs do not reach, (J,)."""
        return np.asarray(self.outside / np.maximum(self.count, 1))
