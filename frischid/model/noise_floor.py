"""The noise floor: the error that the sensor noise alone causes; no model of this form can have a smaller one.

Imagine a robot exactly like the model, with dry friction that changes its sign at once. This robot moves along the
measured path and is recorded by sensors as noisy as the log's. The model's error on this recording is the floor. With F
the parallel filter,

    floor_j² = ‖F (τ̂(q, q̇, q̈) − τ̂(q + n_q, q̇ + n_q̇, q̈ + n_q̈))_j‖² / N  +  (s_j² + A_j² / 12) ‖h‖²

- n are random draws of the channels' noise (`noisy_motion`).
- h are the filter's taps, and s_j² is the torque's noise *within* the filter's band. The noise of drives is seldom
  white, and motion hides it inside the band. So it is measured in the octaves above the band and extrapolated into the
  band (`torque_noise`).
- A_j² is the mean square of the torque's jumps between two samples (`sampled_jumps`). Where a trapezoidal motion begins
  to brake, the torque jumps, and samples tell only to half a step when a torque jumps. At 100 Hz this error may be
  several times that of the sensors.

The first term contains position noise that reaches the torque through the accelerations. It also contains errors at
reversals: noise shifts reversals, and the model's friction is smoothed. A robot whose friction is as smooth as the
model's, and whose torque does not jump, has a lower floor than one with sharp friction and jumps; the residual error
decides between the two (`NoiseFloor.under`). Noise that varies as slowly as the motion cannot be distinguished from
physics, so it is not part of the floor and counts as unexplained.
"""

from __future__ import annotations

import json
from collections.abc import Hashable, Iterable, Iterator
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from frischid.core.bursts import ROBUST_EFFICIENCY, robust_std
from frischid.core.remembered import Remembered
from frischid.core.types import Array
from frischid.effects import Coulomb, columns_of
from frischid.logs.filters import LowPass, correlate, decimate, decimating_filter, noise_level
from frischid.logs.preprocessing import Motion
from frischid.model.comparison_criteria import COMPARISON_CRITERIA as CRITERIA
from frischid.model.model import Model
from frischid.model.model_parts import plain_numbers, robot_text
from frischid.model.noisy_motion import SensorNoise, sharpened, true_path
from frischid.model.remembered_blocks import key_of
from frischid.regression.regressor import Regressor

DRAW_SEED = 0  # seed of the draws, so that the same log gives the same floor
_THROUGH = Remembered[Array]()  # error that the noise of a motion causes, by the model
TORQUE_ROUNDING = 1e-12  # of the largest torque: less is the rounding error of the transform
SIXTH_DIFFERENCE = np.array([1.0, -6.0, 15.0, -20.0, 15.0, -6.0, 1.0])


class Octaves(NamedTuple):
    """Noise of a motion's torques above the filter's band.

    ``samples`` of the motion, ``step`` between them (s), middles of the octaves ``centres`` (K,) in Hz, variance of
    white noise with the torques' power there, ``powers`` (K, J) in (N·m)² (N²), and the number of independent squares
    of which each power is the mean, ``independent`` (K, J).
    """

    samples: int
    step: float
    centres: Array
    powers: Array
    independent: Array


class NoiseFloor:
    """The noise floor of motions, summed motion by motion.

    Attributes
    ----------
    bounds : ndarray, shape (2, J)
        Sum over samples of the floor's square, (N·m)² (N²): for dry friction as smooth as the model's, and for a sharp
        one and torques that jump.
    samples : int
        Number of samples in the sum.
    passed : int
        Number of motions so far.
    octaves : list of Octaves
        Of each motion in the sum.
    poses : int
        Samples that are poses of an arm at standstill.
    """

    def __init__(self, model: Model) -> None:
        self.model = model
        self.bounds, self.samples, self.passed = np.zeros((2, len(model.joints))), 0, 0
        self.octaves: list[Octaves] = []
        self.poses, self._held = 0, np.zeros(len(model.joints))

    @cached_property
    def _key(self) -> Hashable:
        """Everything of the model that the torque of a motion depends on."""
        model = self.model
        reference = json.dumps(plain_numbers(model.reference), sort_keys=True)
        theta = model.full_theta.tobytes()
        filtered = model.lowpass.cutoff, model.lowpass.torque_lag
        return robot_text(model.robot), key_of(model.effects), model.joints, filtered, theta, reference

    @property
    def held(self) -> Array:
        """Root mean square torque with which dry friction may hold the joints in these samples, N·m (N), (J,)."""
        return np.asarray(np.sqrt(self._held / max(self.samples, 1)))

    def watch(self, motions: Iterable[Motion]) -> Iterator[Motion]:
        """Add every motion to the floor, and pass the motions on."""
        for motion in motions:
            self.passed += 1
            if self.passed <= CRITERIA.full_motions or self.passed.bit_count() == 1:
                self.bounds += len(motion.t) * self._of(motion)
                self.samples += len(motion.t)
            yield motion

    def _of(self, motion: Motion) -> Array:
        if motion.at_poses:
            # Dry friction holds with any torque up to break-away τ_c: uniform, of variance τ_c² / 3.
            held = _break_away(self.model) ** 2 / 3
            self.poses += len(motion.t)
            self._held += len(motion.t) * held
            return np.array([np.zeros(len(held)), held])
        index, taps = self.model.torque_index, self.model.lowpass.taps(motion.step)
        octaves = octaves_above(motion.tau[:, index], motion.direction[:, index], motion.step, self.model.lowpass)
        self.octaves.append(octaves)
        level = torque_noise(motion.tau[:, index], octaves, self.model.lowpass)
        through = _THROUGH.of(motion, self._key, lambda: _through_the_motion(self.model, motion))
        jumps = sampled_jumps(motion.tau[:, index], motion.direction[:, index]) / 12
        white = np.stack([level**2, level**2 + jumps])
        return np.asarray(white * np.linalg.norm(taps) ** 2 + through)

    def under(self, rmse: Array) -> Array:
        """Floor of each joint, N·m (N), shape (J,), for a model with this residual error.

        The floor is the residual error, limited to the range from the floor with friction as smooth as the model's to
        the floor with sharp friction and jumps: the robot is in between.
        """
        smooth, sharp = np.sqrt(self.bounds / self.samples)
        return np.asarray(np.maximum(smooth, np.minimum(sharp, rmse)))


def sampled_jumps(x: Array, direction: Array) -> Array:
    """Mean square of a torque's jumps between two samples, while a joint moves in one direction, (N·m)² (N²), (J,).

    A jump of height A is -A/2, A, -A/2 in the halves of the torque's third differences. Noise has as much of them as
    their median says. The rest is that of jumps.

    Parameters
    ----------
    x : ndarray, shape (N, J)
        Torque, uniformly sampled.
    direction : ndarray, shape (N, J)
        Sign of the speed; 0 at standstill (`Motion.direction`).
    """
    squares, one_way = _squares_of_jumps(x, direction)
    return np.asarray(np.maximum(squares.sum(axis=0) / np.maximum(one_way.sum(axis=0), 1), 0.0))


def variance_of_jumps(x: Array, direction: Array, step: float, lowpass: LowPass) -> Array:
    """Variance of filtered torques because the times of jumps are known to half a step only, (M, J), (N·m)² (N²).

    The jumps are those of `sampled_jumps`, sample by sample, each spread by the filter over M filtered samples.
    """
    placed = np.zeros(x.shape)
    placed[1:-2] = np.maximum(_squares_of_jumps(x, direction)[0], 0.0) / 12
    return decimate(lowpass.taps(step) ** 2, placed, lowpass.decimation(step))


def _squares_of_jumps(x: Array, direction: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Squares of the jumps sample by sample, (N - 3, J), with the noise of either sign; and where they are measured.

    Of a jump of height A, the squares of the three differences sum to 1.5 A².
    """
    third = np.diff(x, n=3, axis=0) / 2
    one_way = np.abs(sum(direction[k : len(direction) - 3 + k] for k in range(4))) == 4
    squares = np.zeros(third.shape)
    for j, here in enumerate(one_way.T):
        if here.any():
            squares[here, j] = (third[here, j] ** 2 - robust_std(third[here, j]) ** 2) / 1.5
    return squares, one_way


def octaves_above(x: Array, direction: Array, step: float, lowpass: LowPass) -> Octaves:
    """Power of the noise of torques in the octaves above a filter's band.

    Sixth differences over a lag of a quarter of the cut-off's period pass the octave around twice the cut-off, and
    hardly any motion ten times slower than the cut-off. Half that lag passes the next octave, and so on. Differences
    across a reversal of the joint, or with a sample at standstill, are left out: dry friction jumps at a reversal and
    takes any value at standstill. The median ignores other jerks.

    Parameters
    ----------
    x : ndarray, shape (N, J)
        Torque, uniformly sampled.
    direction : ndarray, shape (N, J)
        Sign of the speed; 0 at standstill (`Motion.direction`).
    step : float
        Time between samples, s.
    """
    if lowpass.cutoff is None:
        return Octaves(len(x), step, np.empty(0), *np.empty((2, 0, x.shape[1])))
    lags = dict.fromkeys(max(1, round(0.25 / (2**k * lowpass.cutoff * step))) for k in range(CRITERIA.octaves))
    found = [(0.5 / (lag * step), power) for lag in lags if (power := _power(x, direction, step, lag)) is not None]
    powers, independent = np.array([power for _, power in found]).reshape(len(found), 2, x.shape[1]).swapaxes(0, 1)
    powers = np.where(powers > (TORQUE_ROUNDING * np.abs(x).max(axis=0, initial=0.0)) ** 2, powers, 0.0)
    return Octaves(len(x), step, np.array([centre for centre, _ in found]), powers, independent)


def torque_noise(x: Array, octaves: Octaves, lowpass: LowPass) -> Array:
    """Standard deviation of white noise with the same power within a filter's band as the noise of torques, (J,).

    The power in the band is extrapolated from `octaves_above`. It is modelled over frequency as that of white noise and
    of noise with a memory (`spectra_of_noise`); no octave may have less power than the noise (`shares_of_noise`).
    """
    if lowpass.cutoff is None or not len(octaves.centres):
        return noise_level(x)
    return np.asarray(np.sqrt(_carried_on(octaves, lowpass.cutoff)))


def _power(x: Array, direction: Array, step: float, lag: int) -> tuple[Array, Array] | None:
    """Variance of white noise with the torques' power around 1 / (2 lag step), and how well it is known; both (J,).

    The second is the number of independent squares with the same variance of their mean. None: too few samples.
    """
    differences = np.zeros(6 * lag + 1)
    differences[::lag] = SIXTH_DIFFERENCE
    cutoff = CRITERIA.octave_top / (2 * lag * step)
    both = np.convolve(LowPass(cutoff).taps(step), differences) if cutoff < 0.45 / step else differences
    if len(x) < 2 * len(both):
        return None
    passed = correlate(both, x)
    sums = np.cumsum(direction, axis=0)
    one_way = np.abs(sums[len(both) - 1 :] - sums[: len(passed)]) == len(both) - 1  # of the samples after the first
    # A joint that always rests or reverses has no difference in one direction: then all differences count.
    kept = np.where(one_way.sum(axis=0) < len(both), True, one_way)
    spread = np.array([robust_std(y[here]) for y, here in zip(passed.T, kept.T, strict=True)])
    energy = float(both @ both)
    apart = energy**2 / float((np.convolve(both, both[::-1]) ** 2).sum())  # independent differences for each sample
    return np.asarray(spread**2 / energy), np.asarray(ROBUST_EFFICIENCY * apart * kept.sum(axis=0))


def spectra_of_noise(centres: Array, corner: float, step: float) -> Array:
    """Spectra (..., 2) of noise with a memory and of white noise at frequencies (...); the first is 1 at frequency 0.

    Samples of noise with the memory 1 / (2π f₀) are a first-order autoregressive series with ρ = exp(−2π f₀ h). Its
    spectrum is (1 − ρ)² / (1 − 2ρ cos(2π f h) + ρ²): near 1 / (1 + (f/f₀)²) at frequencies far below 1/h.
    """
    rho = np.exp(-2 * np.pi * corner * step)
    memory = (1 - rho) ** 2 / (1 - 2 * rho * np.cos(2 * np.pi * centres * step) + rho**2)
    return np.stack([memory, np.ones(centres.shape)], axis=-1)


def mean_in_band(corner: float, cutoff: float) -> tuple[float, float]:
    """Means of both spectra of `spectra_of_noise` from frequency 0 to a cut-off, Hz, far below 1/h."""
    return corner / cutoff * float(np.arctan(cutoff / corner)), 1.0


def shares_of_noise(spectra: Array, powers: Array) -> Array:
    """Shares (J, 2) of two spectra (K, 2) in the powers (K, J) of K octaves.

    Other causes than noise (ripple, resonances, fast parts of the motion) only add power. So the spectra are fitted
    to the octaves relative to their powers, and then lowered until no octave has less power than the noise.
    """
    fits = [optimize.nnls(spectra / y[:, None], np.ones(len(y)))[0] for y in powers.T]
    most = [float((spectra @ share / y).max()) for share, y in zip(fits, powers.T, strict=True)]
    return np.array([share / max(1.0, top) for share, top in zip(fits, most, strict=True)])


def _carried_on(octaves: Octaves, cutoff: float) -> Array:
    """Power (J,) below a cut-off, Hz, from the powers above it.

    All joints share one corner frequency; with only two octaves a corner cannot be distinguished from white noise. A
    torque without any power in an octave, as one with coarse steps has, says nothing of the corner.
    """
    found, seen = octaves.powers[0].copy(), (octaves.powers > 0).all(axis=0)
    if len(octaves.centres) < 3 or not seen.any():
        return np.asarray(found)
    powers, least = octaves.powers[:, seen], np.inf
    for corner in CRITERIA.corners:
        spectra = spectra_of_noise(octaves.centres, corner, octaves.step)
        shares = shares_of_noise(spectra, powers)
        left = float(((spectra @ shares.T / powers - 1) ** 2).sum())
        if left < least:
            least, found[seen] = left, shares @ mean_in_band(corner, cutoff)
    return np.asarray(found)


def _through_the_motion(model: Model, motion: Motion) -> Array:
    """Mean square error of the model's filtered torque from noise of q, q̇, q̈, with smooth and with sharp friction.

    Noise at a slow reversal may shift the jump of friction far, or not at all. So the noise is drawn several times: the
    least error of all draws is that with smooth friction, the largest that with sharp friction. The residual error
    decides in between (`NoiseFloor.under`).
    """
    path = true_path(motion.middle(min(1.0, CRITERIA.noise_samples / len(motion.t))), model.lowpass)
    regressor, index = Regressor(model.robot, model.effects, model.reference), model.torque_index
    F = decimating_filter(model.lowpass.taps(path.step), len(path.t), model.lowpass.decimation(path.step))
    used = regressor.counted(abs(F) @ path.standstill)[:, index]
    truth, sharp_truth = regressor.torque(path, model.full_theta), sharpened(model, path)
    rng, noise, drawn = np.random.default_rng(DRAW_SEED), SensorNoise.of(path, motion, model.lowpass), []
    for _ in range(CRITERIA.draws):
        seen = noise.drawn(rng)
        found, sharp_found = regressor.torque(seen, model.full_theta), sharpened(model, seen)
        errors = (truth - found, truth + sharp_truth - found, truth + sharp_truth - found - sharp_found)
        squares = (((F @ x[:, index] * used) ** 2).sum(axis=0) / np.maximum(used.sum(axis=0), 1) for x in errors)
        least, *others = squares
        drawn.append([least, np.maximum(least, np.minimum(*others))])
    smooth, sharp = np.array(drawn).swapaxes(0, 1)
    return np.array([smooth.min(axis=0), sharp.max(axis=0)])


def _break_away(model: Model) -> Array:
    """Dry friction of each fitted joint according to the model, N·m (N), (J,)."""
    columns = columns_of(model.robot, model.effects)
    dry = {
        c.joint: max(float(x), 0.0) for c, x in zip(columns, model.full_theta, strict=True) if c.effect == Coulomb.id
    }
    return np.array([dry.get(name, 0.0) for name in model.joints])
