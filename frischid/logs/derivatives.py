"""Measured and derived q̇ and q̈ of a stretch of motion, and the choice of the more accurate one.

A log may have measured velocities and accelerations. Both can also be derived from the positions by a differentiator.
A measured acceleration a_m has an error e; the derived one a_d has noise n of known size. So, after the filter F,

    E (F (a_m − a_d))² = e² + n².

The measured one is more accurate if e < n, that is, if the rms difference is below √2 n.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from frischid.core.types import Array
from frischid.logs.filters import LowPass, correlate, derivative_taps, noise_level
from frischid.logs.log import Log
from frischid.logs.velocity_lag import velocity_lag

SAME_ACCELERATION = 1e-3
"""Measured and derived accelerations that differ by less than this share of the acceleration count as equal."""
LATE_VELOCITY = 0.05
"""Share of the speed. A measured q̇ that differs from the slope of q by more than this is not used."""


@dataclass(frozen=True, eq=False)
class Derivatives:
    """Derivatives of one stretch, from its positions and from its measured velocities."""

    q: Array
    """Positions on a uniform grid, rad (m), (N, J)."""
    v_measured: Array
    """Measured velocities, rad/s (m/s), (N, J); NaN where there are none."""
    step: float
    """Time between samples, s."""
    lowpass: LowPass
    """The filter: measured and derived values are compared within its band."""

    @cached_property
    def taps(self) -> tuple[Array, Array]:
        """Weights of the first and of the second derivative."""
        cutoff = self.lowpass.cutoff
        return derivative_taps(1, self.step, cutoff), derivative_taps(2, self.step, cutoff)

    @property
    def half(self) -> int:
        """Samples at each end that have no derivative."""
        return len(self.taps[0]) // 2

    @cached_property
    def v(self) -> Array:
        """Velocities from the positions, (N − 2 half, J)."""
        return correlate(self.taps[0], self.q - self.q[0])  # a joint that never moves has exactly zero speed

    @cached_property
    def a(self) -> Array:
        """Accelerations from the positions, (N − 2 half, J)."""
        return correlate(self.taps[1], self.q - self.q[0])

    @cached_property
    def a_from_v(self) -> Array:
        """Accelerations from the measured velocities, (N − 2 half, J)."""
        return correlate(self.taps[0], self.v_measured)

    def choice(self, log: Log, velocity: str) -> tuple[NDArray[np.bool_], list[str]]:
        """Whether each joint's measured velocity is used, (J,), and notes on those that are not."""
        present = log.has("v")
        if velocity == "derived" or not present.any():
            return np.zeros(len(present), bool), []
        if velocity == "measured":
            return present, []
        smooth = self.lowpass.taps(self.step)
        inside = slice(self.half, len(self.q) - self.half)
        measured, derived = correlate(smooth, self.v_measured[inside]), correlate(smooth, self.v)
        scale = np.sqrt(np.mean(derived**2, axis=0)) + 1e-12
        off = np.sqrt(np.mean((measured - derived) ** 2, axis=0)) / scale
        late = present & (off > LATE_VELOCITY)
        notes = []
        if late.any():
            lag = velocity_lag(measured[:, late], derived[:, late], self.step).lag
            names = [name for name, wrong in zip(log.joints, late, strict=True) if wrong]
            notes.append(
                f"{log.source}: measured velocity of {', '.join(names)} differs from the slope of the positions by "
                f"{_range(100 * off[late])} % (it lags {_range(lag)} s): derived from the positions instead"
            )
        return present & ~late & self.better(self.a_from_v), notes

    def better(self, acceleration: Array) -> NDArray[np.bool_]:
        """Whether each joint's given acceleration is more accurate than that of the positions, in the filter's band.

        The mean square of the difference of the two is e² + n². The given one has the error e (noise, and a
        tachometer's lag). The noise n of the positions' second derivative is known, so e < n if the rms difference is
        below √2 n. If both agree to `SAME_ACCELERATION`, the given one is taken, because it has no differentiator's
        bias.
        """
        smooth = self.lowpass.taps(self.step)
        difference = correlate(smooth, acceleration - self.a)
        noise = noise_level(self.q) * np.linalg.norm(np.convolve(smooth, self.taps[1]))
        alike = SAME_ACCELERATION * np.sqrt(np.mean(self.a**2, axis=0))
        return np.asarray(np.sqrt(np.mean(difference**2, axis=0)) < np.maximum(np.sqrt(2) * noise, alike))


def _range(values: Array) -> str:
    """Smallest and largest value as text; only one value where both are equal."""
    low, high = (f"{x:.2g}" for x in (values.min(), values.max()))
    return low if low == high else f"{low} to {high}"
