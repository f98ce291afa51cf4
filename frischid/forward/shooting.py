"""Multiple shooting: stretches of logs, simulated from their measured starts with any parameters, and the derivatives.

    θ = θ_linear + L z,   L Lᵀ = C_linear,      r_k(t) = (q_sim(t; θ, s_k) − q(t)) / σ

The scaled parameters z are in standard errors of the linear answer. Stretch k starts at the measured position and
velocity s_k. With a free start, a long motion would hide its error: the place where a rolling cart stops depends on the
start. The noise of a start is an error of its own stretch, and the stretches' scores hold this error.

Source: Bock 1983, "Recent advances in parameter identification techniques for ODE", Birkhäuser.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from frischid.core.arguments import check_number
from frischid.core.types import Array
from frischid.errors import InputError
from frischid.forward.commanded_motion import moved
from frischid.forward.forward_dynamics import LARGEST_STEP, ForwardDynamics
from frischid.forward.simulated_motion import Starts
from frischid.forward.tangents import Tangents
from frischid.forward.torque_sources import TorqueSource
from frischid.logs.log import Log
from frischid.logs.preprocessing import Motion
from frischid.logs.recording import Recording
from frischid.model.model import Model

FEWEST_PIECES = 20
"""Pieces of the motion whose scores are summed: fewer do not show how far errors are correlated."""
SMALLEST_PATH = 1e-12
"""rad (m): a smaller step or rms error is rounding."""


@dataclass(frozen=True)
class OutputErrorOptions:
    """How the simulated motion is fitted.

    Attributes
    ----------
    horizon : float
        Length of a stretch, s; at most that of a log. Longer stretches show slower errors, and an arm that falls is
        less predictable over a longer one.
    samples : int
        Positions compared per stretch: the motion of a stretch is smooth.
    stretches : int
        Most stretches per log, spread evenly.
    step : float
        Longest step of the integration, s.
    rounds : int
        Fits; after each, the positions of each joint are weighted by the joint's own rms error.
    iterations : int
        Most Gauss-Newton steps of one fit.

    Examples
    --------
    >>> import frischid as fr
    >>> fr.OutputErrorOptions(horizon=0.5).samples
    40
    """

    horizon: float = 1.0
    samples: int = 40
    stretches: int = 40
    step: float = LARGEST_STEP
    rounds: int = 2
    iterations: int = 15

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            check_number(f"{name} of an output error fit", value)
            if not 0 < value < math.inf:
                raise InputError(f"{name} of an output error fit must be positive and finite, got {value}")
            if isinstance(value, np.number):  # a model file holds Python's numbers
                object.__setattr__(self, name, value.item())


class Jacobian(NamedTuple):
    """Derivatives of the scaled residuals by the parameters (R, p), the residuals (R,), the piece of each row (R,)."""

    parameters: Array
    residuals: Array
    piece: Array


class Cut(NamedTuple):
    """Stretches of one motion under a torque: their first samples, and the samples of a stretch that are compared."""

    motion: Motion
    source: TorqueSource
    first: NDArray[np.intp]
    samples: NDArray[np.intp]


class Shooting:
    """Stretches of logs, simulated with parameters ``θ = θ_linear + L z`` and starts of their own."""

    def __init__(self, model: Model, logs: Sequence[Log | Recording], options: OutputErrorOptions) -> None:
        self.model, self.options = model, options
        self.weights = np.ones(len(model.robot.joints))
        self.cuts = [self._cut(motion, source) for motion, source in moved(model, logs)]

    def _cut(self, motion: Motion, source: TorqueSource) -> Cut:
        o = self.options
        length = min(max(2, round(o.horizon / motion.step)), len(motion.t) - 1)
        most = min(max(1, (len(motion.t) - 1) // length), o.stretches)
        first = np.linspace(0, len(motion.t) - 1 - length, most).round().astype(np.intp)
        count = max(1, min(length, round(o.samples * length * motion.step / o.horizon)))
        return Cut(motion, source, first, np.unique(np.linspace(0, length, count + 1).round().astype(np.intp)))

    @cached_property
    def root(self) -> Array:
        """L of θ = θ_linear + L z."""
        return np.asarray(np.linalg.cholesky(self.model.estimate.covariance))

    @cached_property
    def _directions(self) -> Array:
        """Change of the values of all columns with z, (C, p)."""
        full = np.zeros((len(self.model.full_theta), len(self.root)))
        full[list(self.model.base)] = self.root
        return full

    def errors(self) -> Array:
        """Rms error of the simulated positions of the linear answer, (J,), rad (m); infinite where unstable."""
        r = self._simulated(np.zeros(len(self.root)))
        squares = (np.where(np.isfinite(r), r, np.inf) ** 2).sum(axis=(0, 1))
        return np.asarray(np.sqrt(squares / sum(len(cut.first) * len(cut.samples) for cut in self.cuts)))

    def residuals(self, z: Array) -> Array:
        """Scaled errors of positions (stretches, samples, J) for parameters (p,); zero after a shorter stretch."""
        return self._simulated(z) / self.weights

    def _simulated(self, z: Array, slopes: Array | None = None) -> Array:
        """Errors of positions (stretches, samples, J), rad (m); `slopes` gets their derivatives (..., p)."""
        done, J = 0, len(self.weights)
        widest = max(len(cut.samples) for cut in self.cuts)
        out = np.zeros((sum(len(cut.first) for cut in self.cuts), widest, J))
        theta = self.model.full_theta + self._directions @ z
        for motion, source, first, samples in self.cuts:
            part = slice(done, done + len(first)), slice(len(samples))
            extra = {name: (motion.t, values) for name, values in motion.extra.items()}
            forward = ForwardDynamics(self.model, theta[None], extra=extra, begin=motion.start)
            speed = np.where(motion.standstill, 0.0, motion.v)  # the measured speed of standstill is noise
            begin = Starts(
                motion.q[first], speed[first], motion.t[first], remembered=forward.remembered(motion.t, motion.v, first)
            )
            times = np.asarray(samples * motion.step, dtype=np.float64)
            tangents = None if slopes is None else Tangents(forward, self._directions, source, len(first))
            found = forward.simulate(source, begin, times, step=self.options.step, follower=tangents).q
            out[part] = found - motion.q[first[:, None] + samples]
            if slopes is not None and tangents is not None:
                slopes[part[0], 1 : len(samples)] = np.stack(tangents.noted, axis=1)
            done += len(first)
        return out

    def jacobian(self, z: Array) -> Jacobian:
        """Residuals and their derivatives (`frischid.forward.tangents`).

        Raises
        ------
        InputError
            A simulated motion is unstable.
        """
        shape = sum(len(cut.first) for cut in self.cuts), max(len(cut.samples) for cut in self.cuts)
        slopes = np.zeros((*shape, len(self.weights), len(z)))
        r = self._simulated(z, slopes) / self.weights
        if not (np.isfinite(r).all() and np.isfinite(slopes).all()):
            raise InputError(
                "the simulated motion is unstable while it is fitted: the torque recorded in the logs moves the model "
                "away within one stretch; give a shorter horizon, or identify with the URDF as a prior first"
            )
        S, m = shape[0], shape[1] * len(self.weights)
        pieces = min(m, -(-FEWEST_PIECES // S))  # of a stretch, where stretches are few
        piece = np.asarray((np.arange(S)[:, None] * pieces + np.arange(m) * pieces // m).ravel())
        return Jacobian((slopes / self.weights[:, None]).reshape(-1, len(z)), r.ravel(), piece)
