"""A motion as sensors as noisy as a log's would record it, and the model's healthy twin on that motion.

The *true path* of a measured motion is nearly the motion behind the low-pass filter F. A path with noise is

    q + n_q,   q̇ + n_q̇,   q̈ + n_q̈,

with n random draws of the channels' noise (`noise_level`). Their size is measured in each stretch of time, because
wrong time stamps make positions noisier where a joint moves faster. Derived q̇ and q̈ get the noise of the positions
through the differentiator.

The *healthy twin* is a robot exactly like the model, with dry friction that changes its sign at once. This robot moves
along the true path and is recorded by such sensors. So nothing is missing from the model of the twin.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from frischid.core.types import Array
from frischid.effects import State, columns_of
from frischid.logs.filters import LowPass, correlate, derivative_taps, noise_level
from frischid.logs.preprocessing import Motion
from frischid.model.comparison_criteria import COMPARISON_CRITERIA as CRITERIA
from frischid.model.model import Model


def sharpened(model: Model, motion: Motion) -> Array:
    """Change of the unfiltered torque if dry friction changes its sign at once, shape (N, J)."""
    theta = dict(zip((c.name for c in columns_of(model.robot, model.effects)), model.full_theta, strict=True))
    none = np.zeros(motion.q.shape)
    state = State(model.robot, motion.t, motion.q, motion.v, motion.a, none, none, motion.start, motion.extra)
    change = none.copy()
    for effect in model.effects:
        if effect.smooths_sign and not effect.loaded:
            sharp = effect.with_sign_width(CRITERIA.sharp_width)
            for after, before in zip(sharp.terms(state), effect.terms(state), strict=True):
                for joint, values in after.rows.items():
                    change[:, joint] += theta[after.column.name] * (values - before.rows[joint])
    return change


def true_path(motion: Motion, lowpass: LowPass) -> Motion:
    """The true path of a measured motion, nearly: all channels through a filter, which passes the slower motion."""
    taps = lowpass.taps(motion.step)
    if len(motion.t) < 3 * len(taps):
        return motion
    half = len(taps) // 2
    inner = motion.part(slice(half, len(motion.t) - half))
    return replace(inner, q=correlate(taps, motion.q), v=correlate(taps, motion.v), a=correlate(taps, motion.a))


@dataclass(frozen=True, eq=False)
class SensorNoise:
    """The noise of a motion's sensors along its true path. Its size is measured once, for any number of draws."""

    path: Motion
    """The true path."""
    derived: tuple[Array, Array]
    """Taps that differentiate positions once and twice, at the cut-off, (T,)."""
    own: tuple[NDArray[np.bool_], NDArray[np.bool_]]
    """Whether velocities and accelerations have sensors of their own, (J,), bool."""
    rounding: Array
    """Change of the positions by the encoder's step, rad (m), along the path and half a filter's length on both sides,
    (M, J)."""
    beyond: Array
    velocity: Array
    acceleration: Array
    """`beyond`, `velocity`, `acceleration`: Standard deviation of the positions' random noise beyond rounding, and that
    of the other channels, (M, J)."""

    @classmethod
    def of(cls, path: Motion, motion: Motion, lowpass: LowPass) -> SensorNoise:
        """Measure the noise of a motion with a true path."""
        first, second = (derivative_taps(order, path.step, lowpass.cutoff) for order in (1, 2))
        half = len(first) // 2
        nothing = np.zeros(path.q.shape[1], bool)
        first_seen = round((path.t[0] - motion.t[0]) / path.step) - half
        at = np.clip(np.arange(first_seen, first_seen + len(path.t) + 2 * half), 0, len(motion.t) - 1)
        long = np.pad(path.q, ((half, half), (0, 0)), "reflect", reflect_type="odd")
        # Rounding is no white noise where a joint moves slowly: its error is a slow saw tooth, which passes the filter.
        steps = np.array([_encoder_step(q) for q in motion.q.T])
        rounding = np.where(steps > 0, steps * np.round(long / np.where(steps > 0, steps, 1.0)) - long, 0.0)
        beyond = np.sqrt(np.maximum(_levels(motion.q, motion.step)[at] ** 2 - steps**2 / 12, 0.0))
        velocity, acceleration = (_levels(x, path.step)[at] for x in (motion.v, motion.a))
        own = motion.measured or (nothing, nothing)
        return cls(path, (first, second), own, rounding, beyond, velocity, acceleration)

    def drawn(self, rng: np.random.Generator) -> Motion:
        """The path as the sensors record it, with noise drawn at random."""
        path, (first, second), (own_v, own_a) = self.path, self.derived, self.own
        half = len(first) // 2
        inner = slice(half, len(self.rounding) - half)
        of_q = self.rounding + self.beyond * rng.normal(size=self.beyond.shape)
        of_v = rng.normal(size=self.velocity.shape) * self.velocity
        v = np.where(own_v, of_v[inner], correlate(first, of_q))
        a = np.where(own_v, correlate(first, of_v), correlate(second, of_q))
        of_a = rng.normal(size=self.acceleration.shape) * self.acceleration
        return replace(path, q=path.q + of_q[inner], v=path.v + v, a=path.a + np.where(own_a, of_a[inner], a))


def _encoder_step(q: Array) -> float:
    """Step of a coarse encoder, rad (m): all changes are whole multiples of the smallest one; 0 where they are not."""
    changes = np.abs(np.diff(q))
    changes = changes[changes > np.finfo(float).eps * np.abs(q).max(initial=0.0)]  # smaller ones: rounding of numbers
    if not len(changes):
        return 0.0
    multiples = changes / changes.min()
    return float(changes.min()) if np.abs(multiples - np.round(multiples)).max() < CRITERIA.step_rounding else 0.0


def _levels(x: Array, step: float) -> Array:
    """Noise level of a channel at each of its samples, measured block by block, (N, J)."""
    size = min(max(CRITERIA.noise_stretch_samples, round(CRITERIA.noise_stretch / step)), len(x))
    count = len(x) // size
    blocks = x[: count * size].reshape(count, size, -1).swapaxes(0, 1)
    return np.asarray(noise_level(blocks)[np.minimum(np.arange(len(x)) // size, count - 1)])
