"""A sketch of a log: a thousand filtered samples on which hypotheses about the log are cheap to try.

Gross faults of a log show at low frequency. Motion and torque pass the same low-pass filter, and every n-th sample is
kept. Each hypothesis ("joint 3's torque has the wrong sign", "a hand is missing") costs one recursive Newton-Euler pass
over these samples and one small least-squares problem per joint:

    τ_j ≈ τ_nominal,j(q, q̇, q̈) + fv_j q̇_j + fc_j sign q̇_j + off_j + Ia_j q̈_j,      fv, fc, Ia ≥ 0.

Friction coefficients and rotor inertia cannot be negative, whatever the URDF says: a hypothesis that needs negative
friction is no explanation.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline
from scipy.optimize import nnls

from frischid.checks.check_criteria import DEFAULT_CRITERIA, CheckCriteria
from frischid.checks.sketch_motion import SketchMotion
from frischid.core.types import Array
from frischid.effects.state import SIGN_WIDTH
from frischid.errors import InputError
from frischid.logs.filters import LowPass, decimate, derivative_taps, noise_level
from frischid.logs.log import DEAD_TORQUE
from frischid.logs.preprocessing import Motion
from frischid.regression.regressor import STANDSTILL_WEIGHT
from frischid.robot.robot import Robot

FRICTION_NUMBERS = 4
"""Fitted numbers of each joint: fv, fc, Ia and the offset."""


@dataclass(frozen=True, eq=False)
class Sketch:
    """Filtered samples of one log."""

    motion: SketchMotion
    """Robot, positions, velocities and accelerations of the M samples."""
    t: Array
    """Time, s, (M,)."""
    tau: Array
    """Torques, N·m (N), (M, J); NaN where not measured."""
    rows: NDArray[np.intp]
    """Joints whose torque can be judged."""
    noise: Array
    """Standard deviation of the white noise after the filter, (2, J): of the torques, and of the accelerations (from
    the positions)."""
    ends: tuple[int, ...]
    """Index after the last sample of each stretch without a gap."""
    criteria: CheckCriteria = DEFAULT_CRITERIA
    given_nominal: Array | None = None
    """Rigid torque that replaces the URDF's, for a hypothesis about the rigid torque, (M, J), or None."""
    earlier: float = 0.0
    """Time by which the torques were moved to earlier times, s: see `moved_earlier`."""
    start: float = 0.0
    """Time at which the log begins, s."""

    @classmethod
    def of(
        cls,
        robot: Robot,
        motions: Sequence[Motion],
        lowpass: LowPass,
        rows: Sequence[str],
        criteria: CheckCriteria = DEFAULT_CRITERIA,
    ) -> Sketch:
        """Filter and thin out the motions of one log."""
        cutoff = min(lowpass.cutoff or criteria.sketch_cutoff, criteria.sketch_cutoff)
        coarse = LowPass(cutoff)
        parts, noise, samples = [], np.zeros((2, len(robot.joints))), 0
        clear = np.ones(len(robot.joints), bool)
        for motion in motions:
            taps = coarse.taps(motion.step)
            every = max(1, int(1 / (criteria.sketch_oversampling * cutoff * motion.step)))
            if len(motion.t) < len(taps):
                continue
            second = np.convolve(taps, derivative_taps(2, motion.step, cutoff))
            first = derivative_taps(1, motion.step, cutoff)
            sigma = noise_level(motion.q)
            level = [noise_level(motion.tau) * np.linalg.norm(taps), sigma * np.linalg.norm(second)]
            noise += len(motion.t) * np.square(level)
            clear &= sigma * np.linalg.norm(first) < criteria.clear_velocity * motion.v.std(axis=0)
            samples += len(motion.t)
            half = len(taps) // 2
            t = motion.t[half : len(motion.t) - half][::every]
            channels = (motion.q, motion.v, motion.a, motion.tau, np.tanh(motion.v / SIGN_WIDTH))
            filtered = [decimate(taps, x, every) for x in channels]
            rest = decimate(abs(taps), motion.standstill.astype(float), every)
            parts.append((t[: len(rest)], *filtered, rest < STANDSTILL_WEIGHT))
        if not parts:
            raise InputError(f"the log is shorter than its filters ({len(taps)} samples); record longer")
        ends = tuple(np.cumsum([len(part[0]) for part in parts]).tolist())
        t, q, v, a, tau, sign, used = (np.concatenate(x) for x in zip(*parts, strict=True))
        index = np.array([robot.joints.index(n) for n in rows], dtype=int)
        known = np.isfinite(tau).all(axis=0) & (np.ptp(tau, axis=0) > DEAD_TORQUE)
        ok = (known & clear & (used.sum(axis=0) > criteria.fewest_moving))[index]
        moving = SketchMotion(robot, q, v, a, sign, used, criteria.fewest_moving)
        start = motions[0].start
        sketch = cls(moving, t, tau, index[ok], np.sqrt(noise / samples), ends, criteria, start=start)
        return sketch.thinned(criteria.sketch_samples)

    def thinned(self, most: int) -> Sketch:
        """At most `most` samples, evenly spread."""
        every = -(-len(self.t) // most)
        if every == 1:
            return self
        return replace(
            self,
            motion=self.motion.thinned(every),
            t=self.t[::every],
            tau=self.tau[::every],
            given_nominal=None if self.given_nominal is None else self.given_nominal[::every],
            ends=tuple(-(-end // every) for end in self.ends),
        )

    def __len__(self) -> int:
        return len(self.t)

    @property
    def robot(self) -> Robot:
        """The robot of the motion."""
        return self.motion.robot

    @property
    def q(self) -> Array:
        """Positions (M, J), rad (m)."""
        return self.motion.q

    @property
    def v(self) -> Array:
        """Velocities (M, J), rad/s (m/s)."""
        return self.motion.v

    @property
    def a(self) -> Array:
        """Accelerations (M, J), rad/s² (m/s²)."""
        return self.motion.a

    @property
    def sign(self) -> Array:
        """Smoothed sign of the velocities, (M, J)."""
        return self.motion.sign

    @property
    def used(self) -> NDArray[np.bool_]:
        """False where a joint stands still, (M, J)."""
        return self.motion.used

    @property
    def nominal(self) -> Array:
        """Rigid torque of the URDF's own parameters, (M, J)."""
        return self.motion.rigid if self.given_nominal is None else self.given_nominal

    @cached_property
    def spread(self) -> Array:
        """Standard deviation of each judged joint's torque while it moves, (R,)."""
        return np.array([self.tau[self.motion.uses(j), j].std() for j in self.rows])

    @cached_property
    def without(self) -> Array:
        """NRMSE of friction, offset and rotor inertia alone, without a rigid part, (R,)."""
        return self.errors(np.zeros_like(self.tau))

    @cached_property
    def asis(self) -> Array:
        """NRMSE of the nominal URDF with fitted friction, (R,)."""
        return self.errors(self.nominal)

    @cached_property
    def white(self) -> Array:
        """NRMSE that white noise of torques and positions alone causes on the judged joints, (R,)."""
        some = slice(None, None, max(1, len(self) // 20))
        q, v, a = self.q[some], self.v[some], self.a[some]
        base, variance = self.robot.inverse_dynamics(q, v, a), np.square(self.noise[0])
        for i, level in enumerate(self.noise[1]):
            moved = self.robot.inverse_dynamics(q, v, a + np.eye(len(self.robot.joints))[i])
            variance = variance + np.mean((moved - base) ** 2, axis=0) * level**2
        return np.asarray(np.sqrt(variance[self.rows]) / self.spread)

    @cached_property
    def excess(self) -> Array:
        """`asis` beyond the error that white noise causes, (R,)."""
        return np.asarray(np.sqrt(np.maximum(self.asis**2 - self.white**2, 0.0)))

    def moved_earlier(self, lag: float) -> Sketch:
        """The sketch with torques that were `lag` seconds late put right; samples without a torque are not used."""
        tau, used, start = self.tau.copy(), self.used.copy(), 0
        for end in self.ends:
            t, part = self.t[start:end], slice(start, end)
            if len(t) > 3:
                at = np.clip(t + lag, t[0], t[-1])
                tau[part, self.rows] = make_interp_spline(t, self.tau[part, self.rows])(at)
                used[part] &= (at == t + lag)[:, None]
            start = end
        return replace(self, motion=replace(self.motion, used=used), tau=tau, earlier=self.earlier + lag)

    def moving(self, **changes: Any) -> Sketch:
        """Copy with another motion; the rigid torque is that of this motion."""
        return replace(self, motion=self.motion.changed(**changes), given_nominal=None)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the judged joints."""
        return tuple(self.robot.joints[j] for j in self.rows)

    @property
    def longest(self) -> slice:
        """Samples of the longest stretch without a gap."""
        edges = [0, *self.ends]
        k = int(np.argmax(np.diff(edges)))
        return slice(edges[k], edges[k + 1])

    def errors(self, torque: Array) -> Array:
        """NRMSE of each judged joint when `torque` (M, J) is its rigid part and friction is fitted, (R,)."""
        return np.array([self.error(j, self.tau[:, j] - torque[:, j]) for j in self.rows]) / self.spread

    def error(self, j: int, left: Array) -> float:
        """RMS of a torque (M,) after the friction of joint j is fitted and subtracted, while the joint moves [N·m]."""
        if self.used[:, j].sum() < self.criteria.fewest_moving:  # the hypothesis lets the joint stand still
            return float(np.sqrt(np.mean(left**2)))
        fit = self.motion.fit(int(j))
        return fit.solve(left[fit.use])[0]


def shared_fit(sketch: Sketch, columns: Mapping[int, Array], left: Array) -> Array:
    """Least squares of a few parameters that all joints share, together with each joint's own friction.

    Parameters
    ----------
    columns : mapping of int to ndarray, shape (M, P)
        Joint -> columns of the shared parameters in its torque.
    left : ndarray, shape (M, J)
        Torque to explain, N·m (N); each joint is weighted by one over its standard deviation.

    Returns
    -------
    ndarray, shape (P + 4 R,)
        The shared parameters, then each joint's friction; a parameter without effect is zero.
    """
    R, P = len(sketch.rows), columns[int(sketch.rows[0])].shape[1]
    parts = []
    for k, j in enumerate(sketch.rows):
        use = sketch.used[:, j]
        own = sketch.motion.friction(j)[:, :FRICTION_NUMBERS]
        seen = np.column_stack([columns[int(j)], own, left[:, j]])[use] / sketch.spread[k]
        # a row's own triangle says all that the row says: the rows together are then a small problem
        triangle = np.asarray(np.linalg.qr(seen, mode="r"))
        part = np.zeros((len(triangle), P + FRICTION_NUMBERS * R + 1))
        part[:, :P], part[:, -1] = triangle[:, :P], triangle[:, -1]
        part[:, P + FRICTION_NUMBERS * k : P + FRICTION_NUMBERS * (k + 1)] = triangle[:, P:-1]
        parts.append(part)
    whole = np.concatenate(parts)
    X, y = whole[:, :-1], whole[:, -1]
    scale = np.sqrt((X**2).sum(axis=0))
    acts = scale > 1e-9 * scale.max()
    if not acts.any():  # SciPy's nnls corrupts memory if its matrix has no column
        return np.zeros(len(scale))
    free = np.concatenate([np.ones(P, bool), np.tile([False, False, False, True], R)])[acts]
    triangle = np.asarray(np.linalg.qr(np.column_stack([X[:, acts] / scale[acts], y]), mode="r"))
    # a parameter of unknown sign is the difference of two non-negative ones
    A, b = triangle[:, :-1], triangle[:, -1]
    both, _ = nnls(np.column_stack([A, -A[:, free]]), b, maxiter=100 * A.shape[1])
    x = both[: A.shape[1]]
    x[free] -= both[A.shape[1] :]
    found = np.zeros(len(scale))
    found[acts] = x / scale[acts]
    return found
