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

from dataclasses import replace

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
    """The true path of a measured motion, nearly: all channels through the filter, which passes the slower motion."""
    taps = lowpass.taps(motion.step)
    if len(motion.t) < 3 * len(taps):
        return motion
    half = len(taps) // 2
    inner = motion.part(slice(half, len(motion.t) - half))
    return replace(inner, q=correlate(taps, motion.q), v=correlate(taps, motion.v), a=correlate(taps, motion.a))


def with_noise(path: Motion, motion: Motion, lowpass: LowPass, rng: np.random.Generator) -> Motion:
    """A path with the sensor noise of a motion, drawn at random."""
    first, second = (derivative_taps(order, path.step, lowpass.cutoff) for order in (1, 2))
    half = len(first) // 2
    long = (len(path.t) + 2 * half, path.q.shape[1])
    nothing = np.zeros(long[1], bool)
    own_v, own_a = motion.measured or (nothing, nothing)
    first_seen = round((path.t[0] - motion.t[0]) / path.step) - half
    at = np.clip(np.arange(first_seen, first_seen + long[0]), 0, len(motion.t) - 1)
    of_q = _encoder_noise(np.pad(path.q, ((half, half), (0, 0)), "reflect", reflect_type="odd"), motion, at, rng)
    of_v = rng.normal(size=long) * _levels(motion.v, path.step)[at]
    v = np.where(own_v, of_v[half : len(of_v) - half], correlate(first, of_q))
    a = np.where(own_v, correlate(first, of_v), correlate(second, of_q))
    of_a = rng.normal(size=long) * _levels(motion.a, path.step)[at]
    a = np.where(own_a, of_a[half : len(of_a) - half], a)
    return replace(path, q=path.q + of_q[half : len(of_q) - half], v=path.v + v, a=path.a + a)


def _encoder_noise(path: Array, motion: Motion, at: NDArray[np.intp], rng: np.random.Generator) -> Array:
    """Noise of the positions along a path, (N, J): rounding to the encoder's step, and random noise beyond rounding.

    Rounding is no white noise where a joint moves slowly: its error is a slow saw tooth, which passes the filter.
    """
    steps = np.array([_encoder_step(q) for q in motion.q.T])
    rounding = np.where(steps > 0, steps * np.round(path / np.where(steps > 0, steps, 1.0)) - path, 0.0)
    beyond = np.sqrt(np.maximum(_levels(motion.q, motion.step)[at] ** 2 - steps**2 / 12, 0.0))
    return np.asarray(rounding + beyond * rng.normal(size=path.shape))


def _encoder_step(q: Array) -> float:
    """Step of a coarse encoder, rad (m): all changes are whole multiples of the smallest one; 0 where they are not."""
    changes = np.abs(np.diff(q))
    changes = changes[changes > 0]
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
