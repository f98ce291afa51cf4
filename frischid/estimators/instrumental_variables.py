"""Instrumental variables: least squares with a second regressor of the same motion, free of the sensors' noise.

Least squares is biased because the regressor Y, computed from noisy states, is correlated with the errors of the
equation. An *instrument* Z is correlated with the true regressor, but not with those errors. Replacing Yᵀ by Zᵀ in the
normal equations,

    θ = (Σ_j w_j Z_jᵀ Y_j)⁻¹ Σ_j w_j Z_jᵀ τ_j,

removes the bias without any knowledge of the noise. For robots there is a good instrument (IDIM-IV: Janot, Vandanjon
and Gautier 2014, IEEE Trans. Control Systems Technology 22(1); Brunot et al. 2018). A robot follows a reference in
closed loop, so the model with the current θ is *simulated* with the same reference, ``Z = Y(q_s, q̇_s, q̈_s)``.
Estimation and simulation alternate.

Here the simulated controller is computed torque at the reference with feedback on the simulated error e = q_r − q_s,

    u = Y(q_r, q̇_r, q̈_r) θ + M(q_s) (ω² e + 2 ω ė),      q̈_s = M(q_s)⁻¹ (u − h(q_s, q̇_s)),

with M and h from the columns (the torque is affine in q̈, but for the sign of dry friction, which is no part of M). The
simulation restarts at the reference every second, and all seconds are simulated at once. So the simulated motion stays
close to the reference for any θ, as the method needs, and an error of θ does not grow over the log.

If no reference was recorded, one is made from the log. At every sample, it is the polynomial that best fits the
measured q, q̇ and q̈ *around* the sample, without the sample itself and without all samples used for its derivatives.
So the white sensor noise of the sample is not in its instrument. After a low-pass, neighbouring rows share noise, and
this holds only approximately; a recorded reference is better.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from frischid.core.types import Array
from frischid.effects.state import NO_SIGN
from frischid.errors import InputError
from frischid.estimators.errors_in_variables import covariance_of, information_of, solve_scaled
from frischid.estimators.least_squares import JACKKNIFE_BLOCKS, Estimate
from frischid.estimators.sensor_noise import noise_levels, sensors_of
from frischid.logs.filters import LowPass
from frischid.logs.preprocessing import Motion
from frischid.motions.trajectory import Trajectory
from frischid.regression.accumulation import MAX_BLOCKS
from frischid.regression.block import Samples
from frischid.regression.regressor import CHUNK_SAMPLES, Regressor
from frischid.robot.robot import Robot

Indices = NDArray[np.intp]

REFERENCE_SPAN = 0.15  # s before and after a sample from which its reference is made
REFERENCE_DEGREE = 5
RESTART_SECONDS = 1.0  # seconds between restarts of the simulation
FEEDBACK_STEP = 0.3  # feedback bandwidth times the step
SETTLED_STDERR = 1e-2  # change of θ, in standard errors, at which the iterations end


def iv(
    regressor: Regressor,
    motions: Iterable[Motion],
    lowpass: LowPass,
    base: Sequence[int],
    start: Estimate,
    *,
    references: Sequence[Trajectory] | None = None,
    iterations: int = 4,
) -> Estimate:
    """Instrumental-variable estimate of the base parameters.

    Parameters
    ----------
    motions : iterable of Motion
        Read once per iteration and once before; one motion at a time is in memory.
    base : sequence of int
        Columns of the base parameters.
    start : Estimate
        Least squares to begin with; its weights and torque joints are kept.
    references : sequence of Trajectory, optional
        Reference of each motion's controller, on the log's own time (zero at the log's beginning).
    iterations : int
        Most iterations of simulation and estimation.

    Raises
    ------
    InputError
        References and motions differ in number, or a motion is too short to make a reference from.
    IdentifiabilityError
        The instruments do not determine some combination of parameters.
    """
    durations = [_duration(m, references is None) for m in motions]
    if references is not None and len(references) != len(durations):
        raise InputError(f"{len(references)} references given for {len(durations)} motions; give one each")
    theta, notes = start.theta, list(start.notes)
    for _ in range(iterations):
        sums = _CrossMoments(regressor, lowpass, base, start, durations)
        for number, motion in enumerate(motions):
            here, reference = (
                _smoothed(motion, regressor.robot, lowpass)
                if references is None
                else (motion, _followed(motion, references[number]))
            )
            simulated = _simulated(regressor, base, theta, reference)
            if simulated is None:
                notes.append(
                    "a mass matrix of the current model is not positive definite, so its motion cannot be simulated; "
                    "the reference motion is the instrument"
                )
            sums.add(number, here, reference if simulated is None else simulated)
        moments = sums.blocks()
        whole = moments.sum(axis=0)
        previous = theta
        theta, condition = solve_scaled(whole[:, :-1], whole[:, -1], [c.name for c in start.columns])
        covariance = covariance_of(moments, theta)
        if (np.abs(theta - previous) <= SETTLED_STDERR * np.sqrt(np.diag(covariance))).all():
            break
    if len(moments) < JACKKNIFE_BLOCKS:
        notes.append(f"only {len(moments)} blocks of data: standard errors are uncertain")
    return replace(
        start,
        theta=theta,
        covariance=covariance,
        condition=condition,
        estimator="iv",
        information=information_of(whole[:, :-1], covariance),
        notes=tuple(dict.fromkeys(notes)),
    )


class _CrossMoments:
    """``Σ_j w_j Z_jᵀ [Y_j τ_j]`` of consecutive blocks of time.

    About `MAX_BLOCKS` of equal length, none over two motions, unless these are so many that neighbours share a block.
    """

    def __init__(
        self, regressor: Regressor, lowpass: LowPass, base: Sequence[int], start: Estimate, durations: Sequence[float]
    ) -> None:
        self.regressor, self.lowpass, self.weights = regressor, lowpass, start.weights
        self.index = [regressor.robot.joints.index(n) for n in start.joints]
        self.columns = list(base)
        self.seconds = max(1.0, sum(durations) / MAX_BLOCKS)
        self.motions = len(durations)
        self.sums: dict[tuple[int, int], Array] = {}

    def add(self, number: int, motion: Motion, instrument: Motion) -> None:
        """Add a motion."""
        every = self.lowpass.decimation(motion.step)
        each = max(1, round(self.seconds / motion.step) // every)  # rows of a block
        first = 0
        pieces = (self.regressor.blocks(m, self.lowpass) for m in (motion, instrument))
        for here, there in zip(*pieces, strict=True):
            weight = here.used[:, self.index] * self.weights
            Y = np.concatenate([here.Y[:, self.columns], here.tau[:, None, :]], axis=1)[:, :, self.index]
            Z = there.Y[:, self.columns][:, :, self.index] * weight[:, None, :]
            block = (first + np.arange(len(Y))) // each
            for k in np.unique(block):
                own = block == k
                alone = (number, int(k)) if self.motions <= MAX_BLOCKS else (number * MAX_BLOCKS // self.motions, 0)
                self.sums[alone] = self.sums.get(alone, 0.0) + np.tensordot(Z[own], Y[own], axes=([0, 2], [0, 2]))
            first += len(Y)

    def blocks(self) -> Array:
        """All of them, (B, p, p + 1)."""
        return np.array(list(self.sums.values()))


def _duration(motion: Motion, smoothed: bool) -> float:
    """Length of the used part of a motion, s."""
    half = _half(motion) if smoothed else 0
    return float(motion.t[len(motion.t) - 1 - half] - motion.t[half])


def _half(motion: Motion) -> int:
    """Number of samples before and after a sample from which its reference is made."""
    half, N = max(REFERENCE_DEGREE + 3, round(REFERENCE_SPAN / motion.step)), len(motion.t)
    if 2 * half + 2 > N:
        raise InputError(
            f"{motion.source}: {N} samples are too few to make a reference from; {2 * half + 2} are needed"
        )
    return half


def _followed(motion: Motion, reference: Trajectory) -> Motion:
    q, v, a = reference(motion.t - motion.start)
    return replace(motion, q=q, v=v, a=a)


def _smoothed(motion: Motion, robot: Robot, lowpass: LowPass) -> tuple[Motion, Motion]:
    """The inner part of a motion, and a reference for it made of each sample's neighbours."""
    half, N = _half(motion), len(motion.t)
    levels = noise_levels([motion], robot, lowpass)
    sensors = sensors_of(motion, robot, lowpass)
    channels = {"q": motion.q, "v": motion.v, "a": motion.a}
    out = {c: x[half : N - half].copy() for c, x in channels.items()}
    for j in range(len(robot.joints)):
        own = [s for s in sensors if s.joint == j]
        gap = max(len(taps) // 2 for s in own for taps in s.taps.values())
        measured = {s.name.split()[0]: max(levels[s.name], 1e-12) for s in own}
        measured = {c: max(s, 1e-6 * max(measured.values())) for c, s in measured.items()}
        taps = _neighbour_taps(half + gap if gap else half, gap, motion.step, measured)
        reach = (taps.shape[2] - 1) // 2
        for k, c in enumerate(out):
            total = np.zeros(N - 2 * half)
            for i, source in enumerate(measured):
                padded = np.pad(channels[source][:, j], reach - half, mode="reflect", reflect_type="odd")
                total += np.correlate(padded, taps[k, i], mode="valid")
            out[c][:, j] = total
    inner = motion.part(slice(half, N - half))
    return inner, replace(inner, q=out["q"], v=out["v"], a=out["a"])


def _neighbour_taps(half: int, gap: int, step: float, sigma: dict[str, float]) -> Array:
    """Weights of neighbours in the polynomial fit at a sample: (q q̇ q̈ out, channels in, 2 half + 1)."""
    offsets = np.arange(-half, half + 1) * step / (half * step)  # in units of half the window: well scaled
    unit = half * step
    use = np.abs(np.arange(-half, half + 1)) > gap
    rows = []
    for channel, s in sigma.items():
        order = "qva".index(channel)
        powers = [np.zeros_like(offsets)] * order + [
            np.prod(np.arange(m - order + 1, m + 1)) * offsets ** (m - order)
            for m in range(order, REFERENCE_DEGREE + 1)
        ]
        rows.append(np.stack(powers, axis=1) / unit**order * use[:, None] / s)
    inverse = np.linalg.pinv(np.concatenate(rows))
    scale = np.repeat([1.0 / s for s in sigma.values()], len(offsets))
    wanted = np.array([1.0, 1.0 / unit, 2.0 / unit**2])[:, None] * inverse[:3] * scale
    return np.asarray(wanted.reshape(3, len(sigma), -1))


def _simulated(regressor: Regressor, base: Sequence[int], theta: Array, reference: Motion) -> Motion | None:
    """The model's own motion under the reference; None where its mass matrix is not positive."""
    names = [regressor.columns[i].name for i in base]
    torque = _Torque(regressor, dict(zip(names, theta, strict=True)), reference)
    N, J = reference.q.shape
    length = min(N, max(2, round(RESTART_SECONDS / reference.step)))
    starts = np.arange(0, N, length)
    w, h = FEEDBACK_STEP / reference.step, reference.step
    forward = torque(np.arange(N), reference.q, reference.v, reference.a)
    out = np.empty((3, N, J))
    q, v = reference.q[starts].copy(), reference.v[starts].copy()
    for k in range(length):
        at = np.minimum(starts + k, N - 1)
        M, rest = torque.mass_and_rest(at, q, v)
        if not np.isfinite(M).all() or np.linalg.eigvalsh(M).min() <= 0:
            return None
        feedback = w**2 * (reference.q[at] - q) + 2 * w * (reference.v[at] - v)
        a = feedback + np.linalg.solve(M, (forward[at] - rest)[:, :, None])[:, :, 0]
        there = starts + k < N  # the last second may be shorter than the others
        out[:, at[there]] = q[there], v[there], a[there]
        q, v = q + h * v + 0.5 * h**2 * a, v + h * a
    return replace(reference, q=out[0], v=out[1], a=out[2])


class _Torque:
    """Torque of parameters at samples of a motion, without that of effects with memory; its mass matrix and the rest.

    Parameters
    ----------
    values : mapping of str to float
        Parameters that are not zero.
    motion : Motion
        Gives the time and the further channels of each sample.
    """

    def __init__(self, regressor: Regressor, values: Mapping[str, float], motion: Motion) -> None:
        static = [e for e in regressor.effects if not e.memory]
        self.motion = motion
        self.static = regressor.with_effects(static)
        self.smooth = regressor.with_effects([e.with_sign_width(NO_SIGN) for e in static])
        self.theta = np.array([values.get(c.name, 0.0) for c in self.static.columns])

    def __call__(self, at: Indices, q: Array, v: Array, a: Array) -> Array:
        """Torque (N, J) at the samples `at` (N,) of the motion, for states of their own, each (N, J)."""
        return self._along(self.static, at, q, v, a)

    def _along(self, regressor: Regressor, at: Indices, q: Array, v: Array, a: Array) -> Array:
        out, start = np.empty_like(q), self.motion.start
        for first in range(0, len(q), CHUNK_SAMPLES):  # chunk by chunk, to save memory
            s = slice(first, first + CHUNK_SAMPLES)
            extra = {name: x[at[s]] for name, x in self.motion.extra.items()}
            Y = regressor.evaluate(Samples(self.motion.t[at[s]], q[s], v[s], a[s], start, extra))
            known = regressor.robot.known_torque(q[s], v[s], a[s])
            out[s] = np.einsum("ncj,c->nj", Y, self.theta) + (0.0 if known is None else known)
        return out

    def mass_and_rest(self, at: Indices, q: Array, v: Array) -> tuple[Array, Array]:
        """M (N, J, J) and h (N, J) with ``τ = M q̈ + h``."""
        N, J = q.shape
        unit = np.concatenate([np.zeros((1, J)), np.eye(J)])
        of, each = np.repeat(np.arange(N), J + 1), np.tile(unit, (N, 1))
        torque = self._along(self.smooth, at[of], q[of], v[of], each).reshape(N, J + 1, J)
        M = (torque[:, 1:] - torque[:, :1]).swapaxes(1, 2)
        return (M + M.swapaxes(1, 2)) / 2, self(at, q, v, np.zeros_like(q))
