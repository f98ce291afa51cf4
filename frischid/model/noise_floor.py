"""The error that the sensors alone would make: the floor below which no model of this form can push the error.

A robot exactly like the model, whose dry friction changes sign at once, is sent along the measured path and looked at
through sensors as noisy as the log's own; the model's error on that is the floor. With F the parallel filter,

    floor_j² = ‖F (τ̂(q, q̇, q̈) − τ̂(q + n_q, q̇ + n_q̇, q̈ + n_q̈))_j‖² / N  +  s_j² ‖h‖²

where n are draws of the channels' own noise (`noise_level`), as large in each stretch as it is there, for stamps that
miss the moment make positions the noisier the faster a joint moves; derived q̇ and q̈ get that of the positions through
the differentiator, h are the filter's taps, and s_j² is the torque's noise *within* the filter's band: drives' noise is
seldom white, and the part of it that the filter passes is what counts. Motion hides it there; it is measured in the
octaves above the band, and carried on into it (`level_within`). The floor contains noise of positions that reaches the
torque through the accelerations, and reversals that noise moves or makes a model smooth (the second τ̂ has the model's
own friction or a sharp one, whichever is nearer). A robot whose friction is as smooth as the model's has a lower floor;
which it is, the error itself says. What wanders as slowly as the motion cannot be told from physics, and counts as
unexplained.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from frischid.core.types import Array
from frischid.effects import State, columns_of
from frischid.logs.filters import LowPass, correlate, decimating_filter, derivative_taps, noise_level
from frischid.logs.preprocessing import Motion
from frischid.model.comparison_criteria import COMPARISON_CRITERIA as CRITERIA
from frischid.model.model import Model
from frischid.regression.regressor import Regressor

DRAW_SEED = 0  # of the draws: the same log gives the same floor
SIXTH_DIFFERENCE = np.array([1.0, -6.0, 15.0, -20.0, 15.0, -6.0, 1.0])


class NoiseFloor:
    """The noise floor of motions, gathered as they pass.

    Attributes
    ----------
    bounds : ndarray, shape (2, J)
        Sum over samples of the floor's square, (N·m)² (N²): for dry friction as smooth as the model's, and for a sharp
        one.
    samples : int
        Of the motions looked at.
    passed : int
        Motions that passed.
    """

    def __init__(self, model: Model) -> None:
        self.model = model
        self.bounds, self.samples, self.passed = np.zeros((2, len(model.joints))), 0, 0

    def watch(self, motions: Iterable[Motion]) -> Iterator[Motion]:
        """Pass motions on, and see each."""
        for motion in motions:
            self.passed += 1
            if self.passed <= CRITERIA.full_motions or self.passed.bit_count() == 1:
                self.bounds += len(motion.t) * self._of(motion)
                self.samples += len(motion.t)
            yield motion

    def _of(self, motion: Motion) -> Array:
        index, taps = self.model.torque_index, self.model.lowpass.taps(motion.step)
        level = level_within(motion.tau[:, index], motion.v[:, index], motion.step, self.model.lowpass)
        return np.asarray((level * np.linalg.norm(taps)) ** 2 + _through_the_motion(self.model, motion))

    def under(self, rmse: Array) -> Array:
        """Floor of each joint, N·m (N), shape (J,), for a model with this residual error.

        The residual error says how sharp the robot's friction is: not so sharp that the sensors alone would make more.
        """
        smooth, sharp = np.sqrt(self.bounds / self.samples)
        return np.asarray(np.maximum(smooth, np.minimum(sharp, rmse)))


def level_within(x: Array, v: Array, step: float, lowpass: LowPass) -> Array:
    """Standard deviation of white noise as strong as that of torques within a filter's band, judged from above it.

    Sixth differences over a lag of a quarter of the cut-off's period pass the octave around twice the cut-off, and next
    to nothing of a motion ten times slower than the cut-off; half that lag passes the octave above, and so on. Moments
    that see the joint turn round are left out, for dry friction jumps there, and the median is not fooled by other
    jerks. Noise falls from octave to octave as white noise and noise with a memory do, W + L/(1 + (f/f₀)²).

    Parameters
    ----------
    x, v : ndarray, shape (N, J)
        Torque and speed, uniformly sampled.
    step : float
        s.
    lowpass : LowPass

    Returns
    -------
    ndarray, shape (J,)
    """
    if lowpass.cutoff is None:
        return noise_level(x)
    lags = dict.fromkeys(max(1, round(0.25 / (2**k * lowpass.cutoff * step))) for k in range(CRITERIA.octaves))
    found = [(0.5 / (lag * step), power) for lag in lags if (power := _power(x, v, step, lag)) is not None]
    if not found:
        return noise_level(x)
    centres, powers = zip(*found, strict=True)
    return np.asarray(np.sqrt(_carried_on(np.array(centres), np.array(powers), lowpass.cutoff)))


def _power(x: Array, v: Array, step: float, lag: int) -> Array | None:
    """Variance of white noise as strong as that of torques around 1 / (2 lag step), (J,); None: too few samples."""
    differences = np.zeros(6 * lag + 1)
    differences[::lag] = SIXTH_DIFFERENCE
    cutoff = CRITERIA.octave_top / (2 * lag * step)
    both = np.convolve(LowPass(cutoff).taps(step), differences) if cutoff < 0.45 / step else differences
    if len(x) < 2 * len(both):
        return None
    passed = np.abs(correlate(both, x))
    forward: NDArray[np.intp] = np.cumsum(v > 0, axis=0)
    there = forward[len(both) - 1 :] - forward[: len(passed)]  # of the samples after the first
    one_way = np.isin(there, (0, len(both) - 1))
    # A joint that turns round all the time shows no such moment: all there is must do.
    kept = np.where(one_way.sum(axis=0) < len(both), True, one_way)
    spread = np.array([np.median(y[here]) for y, here in zip(passed.T, kept.T, strict=True)])
    return np.asarray((spread / 0.6745) ** 2 / (both @ both))


def _carried_on(centres: Array, powers: Array, cutoff: float) -> Array:
    """Power (J,) below a cut-off from powers (K, J) at frequencies (K,) above it, Hz.

    The first octave says how much, all of them how it falls. The corner is that of all joints' drives together; two
    octaves do not tell a corner from a white floor.
    """
    if len(centres) < 3 or not (powers > 0).all():
        return np.asarray(powers[0])
    best, rise = np.inf, np.ones(powers.shape[1])
    for corner in CRITERIA.corners:
        parts = np.stack([1 / (1 + (centres / corner) ** 2), np.ones(len(centres))], axis=1)
        fits = [optimize.nnls(parts / y[:, None], np.ones(len(y))) for y in powers.T]
        left = sum(error**2 for _, error in fits)
        if left < best:
            shares = np.array([share for share, _ in fits])
            best, rise = left, shares @ [1 / (1 + (cutoff / corner) ** 2 / 3), 1.0] / (shares @ parts[0])
    return np.asarray(powers[0] * rise)


def _through_the_motion(model: Model, motion: Motion) -> Array:
    """Mean square of what noise of q, q̇, q̈ does to the model's filtered torque with a smooth and a sharp friction."""
    path = _smoothed(motion.middle(min(1.0, CRITERIA.noise_samples / len(motion.t))), model.lowpass)
    seen = _with_noise(path, motion, model.lowpass)
    regressor, index = Regressor(model.robot, model.effects, model.reference), model.torque_index
    taps, every = model.lowpass.taps(path.step), model.lowpass.decimation(path.step)
    F = decimating_filter(taps, len(path.t), every)
    used = regressor.counted(abs(F) @ path.standstill)[:, index]
    truth, found = (regressor.torque(motion, model.full_theta) for motion in (path, seen))
    sharp_truth, sharp_found = (_sharpened(model, motion) for motion in (path, seen))
    errors = (truth - found, truth + sharp_truth - found, truth + sharp_truth - found - sharp_found)
    smooth, *sharp = (((F @ x[:, index] * used) ** 2).sum(axis=0) / np.maximum(used.sum(axis=0), 1) for x in errors)
    return np.array([smooth, np.maximum(smooth, np.minimum(*sharp))])


def _sharpened(model: Model, motion: Motion) -> Array:
    """What the torque changes by, unfiltered, where dry friction changes its sign at once, shape (N, J)."""
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


def _smoothed(motion: Motion, lowpass: LowPass) -> Motion:
    """The path behind a measured motion: all of it through the filter, which the motion is ten times slower than."""
    taps = lowpass.taps(motion.step)
    if len(motion.t) < 3 * len(taps):
        return motion
    half = len(taps) // 2
    inner = motion.part(slice(half, len(motion.t) - half))
    return replace(inner, q=correlate(taps, motion.q), v=correlate(taps, motion.v), a=correlate(taps, motion.a))


def _with_noise(path: Motion, motion: Motion, lowpass: LowPass) -> Motion:
    """A path as the sensors of a motion would see it."""
    rng = np.random.default_rng(DRAW_SEED)
    first, second = (derivative_taps(order, path.step, lowpass.cutoff) for order in (1, 2))
    half = len(first) // 2
    long = (len(path.t) + 2 * half, path.q.shape[1])
    nothing = np.zeros(long[1], bool)
    own_v, own_a = motion.measured or (nothing, nothing)
    first_seen = round((path.t[0] - motion.t[0]) / path.step) - half
    at = np.clip(np.arange(first_seen, first_seen + long[0]), 0, len(motion.t) - 1)
    of_q, of_v = (rng.normal(size=long) * _levels(x, path.step)[at] for x in (motion.q, motion.v))
    v = np.where(own_v, of_v[half : len(of_v) - half], correlate(first, of_q))
    a = np.where(own_v, correlate(first, of_v), correlate(second, of_q))
    of_a = rng.normal(size=long) * _levels(motion.a, path.step)[at]
    a = np.where(own_a, of_a[half : len(of_a) - half], a)
    return replace(path, q=path.q + of_q[half : len(of_q) - half], v=path.v + v, a=path.a + a)


def _levels(x: Array, step: float) -> Array:
    """Noise level of a channel block by block, at each of its samples, (N, J)."""
    size = min(max(CRITERIA.noise_stretch_samples, round(CRITERIA.noise_stretch / step)), len(x))
    count = len(x) // size
    blocks = x[: count * size].reshape(count, size, -1).swapaxes(0, 1)
    return np.asarray(noise_level(blocks)[np.minimum(np.arange(len(x)) // size, count - 1)])
