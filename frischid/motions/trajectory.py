"""Motions as functions of time: q(t), q̇(t), q̈(t) in closed form, without numerical differentiation.

Finite Fourier series for each joint (Swevers et al. 1997) that start and end at standstill, quintic polynomials through
given points (q, q̇, q̈) (Massaroli et al., section 3.2), and quintic B-splines. All are linear in their coefficients, and
all know exactly where they turn back. For a Fourier series this holds because a trigonometric polynomial is an ordinary
one on the unit circle,

    Σ_k (s_k sin kφ + c_k cos kφ) = 0   ⇔   Σ_k (c_k + i s_k) z^{K−k} + (c_k − i s_k) z^{K+k} = 0,   z = e^{iφ},

so the extremes of a motion are roots of polynomials, not the largest values of some samples.

References: J. Swevers et al., "Optimal robot excitation and identification", IEEE Trans. Robotics and Automation
13(5), 1997; S. Massaroli et al., "Frisch Scheme Identification of Robots Dynamic Parameters"; C. de Boor, "A Practical
Guide to Splines", 1978.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from scipy.interpolate import BPoly, PPoly
from scipy.interpolate import BSpline as ScipySpline

from frischid.core.arguments import check_kind
from frischid.core.types import Array
from frischid.errors import InputError
from frischid.motions.motion_request import check_length
from frischid.robot.motion_arrays import numbers_of
from frischid.robot.robot import Robot


class Trajectory(Protocol):
    """An object that gives the motion of J joints over ``[0, duration]`` seconds."""

    @property
    def duration(self) -> float:
        """Length in seconds."""
        ...

    def __call__(self, t: Array) -> tuple[Array, Array, Array]:
        """Position, velocity and acceleration at times t, each of shape (N, J)."""
        ...


class ClosedForm(Trajectory, Protocol):
    """A trajectory that knows the times at which it turns back."""

    def turning(self, order: int, joint: int) -> Array:
        """Times in the open interval at which derivative `order` (0, 1 or 2) of a joint may be extreme."""
        ...


@dataclass(frozen=True, eq=False)
class Fourier:
    """Finite Fourier series per joint, periodic, at standstill at both ends.

        q_j(t) = c_j + Σ_k [A_kj (sin ω_k t)/ω_k − B_kj (cos ω_k t − 1)/ω_k],   ω_k = 2πk / duration

    with Σ_k A_kj = 0 and Σ_k k B_kj = 0, so that q̇ and q̈ are zero at the ends; `rested` makes coefficients so.
    """

    centre: Array
    """Position at both ends, rad (m), (J,)."""
    A: Array
    B: Array
    """`A`, `B`: Coefficients of K harmonics, rad/s (m/s), (K, J)."""
    duration: float
    """Period, s."""

    @classmethod
    def rested(cls, centre: Array, A: Array, B: Array, duration: float) -> Fourier:
        """Project free coefficients onto those with zero velocity and acceleration at the ends."""
        k = np.arange(1, len(A) + 1)[:, None]
        return cls(centre, A - A.mean(axis=0), B - k * (k * B).sum(axis=0) / (k**2).sum(), duration)

    def __call__(self, t: Array) -> tuple[Array, Array, Array]:
        """Position, velocity and acceleration at times t (N,), each of shape (N, J)."""
        w = 2 * np.pi * np.arange(1, len(self.A) + 1) / self.duration
        phase = np.outer(t, w)
        s, c = np.sin(phase), np.cos(phase)
        q = self.centre + (s / w) @ self.A - ((c - 1) / w) @ self.B
        v = c @ self.A + s @ self.B
        a = -(s * w) @ self.A + (c * w) @ self.B
        return q, v, a

    def turning(self, order: int, joint: int) -> Array:
        """Times in the open interval at which derivative `order` (0, 1 or 2) of a joint may be extreme."""
        w = 2 * np.pi * np.arange(1, len(self.A) + 1) / self.duration
        # The next derivative, as sine and cosine coefficients of each harmonic.
        A, B = self.A[:, joint], self.B[:, joint]
        sine, cosine = ((B, A), (-A * w, B * w), (-B * w**2, -A * w**2))[order]
        half = cosine + 1j * sine
        roots = np.roots(np.concatenate([half.conj()[::-1], [0.0], half]))
        # Rounding moves roots off the circle, so near ones count too; a time that is no extreme does no harm.
        angle = np.angle(roots[np.abs(np.abs(roots) - 1.0) < 0.05])
        return np.asarray(np.mod(angle, 2 * np.pi) * self.duration / (2 * np.pi))


@dataclass(frozen=True, eq=False)
class Quintic:
    """Quintic polynomials through points with given positions, velocities and accelerations.

    Attributes
    ----------
    t : ndarray, shape (M,)
        Times of the points, s; the first is time zero of the motion.
    q, v, a : ndarray, shape (M, J)
        Positions, rad (m), velocities and accelerations at the points.

    Raises
    ------
    InputError
        There are fewer than two points, their times do not increase, or a point is not of finite numbers.

    Examples
    --------
    From 0 to 1 rad in two seconds, with standstill at both ends:

    >>> import numpy as np
    >>> import frischid as fr
    >>> zero = np.zeros((2, 1))
    >>> motion = fr.Quintic(np.array([0.0, 2.0]), np.array([[0.0], [1.0]]), zero, zero)
    >>> q, v, a = motion(np.array([0.0, 1.0, 2.0]))
    >>> q[:, 0].tolist(), v[:, 0].tolist()
    ([0.0, 0.5, 1.0], [0.0, 0.9375, 0.0])
    """

    t: Array
    q: Array
    v: Array
    a: Array

    def __post_init__(self) -> None:
        for name in ("t", "q", "v", "a"):
            object.__setattr__(self, name, numbers_of(f"{name} of points to interpolate", getattr(self, name)))
        if self.t.ndim != 1 or len(self.t) < 2 or not (np.diff(self.t) > 0).all():
            raise InputError("points to interpolate need at least two strictly increasing times")
        for name, x in (("q", self.q), ("v", self.v), ("a", self.a)):
            if x.ndim != 2 or len(x) != len(self.t) or x.shape != self.q.shape:
                raise InputError(
                    f"{name} of points to interpolate has the shape {x.shape}; expected ({len(self.t)}, J): a row for "
                    "each time, a column for each joint"
                )
            if not np.isfinite(x).all():
                raise InputError(f"{name} of point {int(np.argwhere(~np.isfinite(x))[0, 0])} is not finite")

    @property
    def duration(self) -> float:
        """Length in seconds."""
        return float(self.t[-1] - self.t[0])

    def __call__(self, t: Array) -> tuple[Array, Array, Array]:
        """Position, velocity and acceleration at times t (N,), each of shape (N, J)."""
        q, v, a = self._splines
        return q(t), v(t), a(t)

    @cached_property
    def _splines(self) -> tuple[Any, Any, Any]:
        spline = BPoly.from_derivatives(self.t - self.t[0], np.stack([self.q, self.v, self.a], axis=1))
        return spline, spline.derivative(1), spline.derivative(2)

    @cached_property
    def _polynomials(self) -> list[Any]:
        stack = np.stack([self.q, self.v, self.a], axis=1)
        return [
            PPoly.from_bernstein_basis(BPoly.from_derivatives(self.t - self.t[0], stack[..., j]))
            for j in range(self.q.shape[1])
        ]

    def turning(self, order: int, joint: int) -> Array:
        """Times in the open interval at which derivative `order` (0, 1 or 2) of a joint may be extreme."""
        return _roots(self._polynomials[joint].derivative(order + 1), self.duration)


SPLINE_DEGREE = 5


@dataclass(frozen=True, eq=False)
class BSpline:
    """Uniform quintic B-spline with clamped ends.

    It is four times continuously differentiable, each control point changes it locally, and it stays in the hull of its
    control points.
    """

    points: Array
    """Control points, rad (m), (M, J). Three equal ones at an end mean standstill at that end: see `rested`."""
    duration: float
    """Length, s."""

    def __post_init__(self) -> None:
        if len(self.points) <= SPLINE_DEGREE:
            raise InputError(f"a quintic B-spline needs at least {SPLINE_DEGREE + 1} points, got {len(self.points)}")

    @classmethod
    def rested(cls, points: Array, duration: float) -> BSpline:
        """Triple the end points, so that the motion starts and ends there with zero velocity and acceleration."""
        return cls(np.concatenate([points[:1]] * 2 + [points] + [points[-1:]] * 2), duration)

    @cached_property
    def _spline(self) -> Any:
        inner = np.linspace(0.0, self.duration, len(self.points) - SPLINE_DEGREE + 1)
        knots = np.concatenate([[0.0] * SPLINE_DEGREE, inner, [self.duration] * SPLINE_DEGREE])
        return ScipySpline(knots, self.points, SPLINE_DEGREE)

    def __call__(self, t: Array) -> tuple[Array, Array, Array]:
        """Position, velocity and acceleration at times t (N,), each of shape (N, J)."""
        spline = self._spline
        return spline(t), spline.derivative(1)(t), spline.derivative(2)(t)

    def turning(self, order: int, joint: int) -> Array:
        """Times in the open interval at which derivative `order` (0, 1 or 2) of a joint may be extreme."""
        spline = self._spline
        polynomials = PPoly.from_spline((spline.t, spline.c[:, joint], SPLINE_DEGREE))
        return _roots(polynomials.derivative(order + 1), self.duration)


def _roots(piecewise: Any, duration: float) -> Array:
    """Zeros of a piecewise polynomial, and its breaks, where it may jump across zero."""
    roots = piecewise.roots(extrapolate=False)
    # A polynomial that is zero everywhere gives NaN; there the motion has no turning point.
    candidates = np.concatenate([roots[np.isfinite(roots)], piecewise.x])
    return np.asarray(candidates[(candidates > 0.0) & (candidates < duration)])


def random_fourier(robot: Robot, duration: float, *, seed: int, harmonics: int = 5, scale: float = 0.7) -> Fourier:
    """Random motion that stays within `scale` times the robot's position and velocity limits.

    Joints without a position limit swing by at most π. No joint is faster than `scale` times 2 rad/s (m/s).

    Parameters
    ----------
    robot : Robot
    duration : float
        Seconds.
    seed : int
    harmonics : int
        Number of harmonics of 1/duration; raised so that the fastest is at least 0.4 Hz.
    scale : float
        Share of the limits that is used.

    Returns
    -------
    Fourier

    Raises
    ------
    InputError
        The duration is not a positive number.

    Examples
    --------
    >>> import numpy as np
    >>> import frischid as fr
    >>> robot = fr.Robot.load("planar2")
    >>> motion = fr.random_fourier(robot, 5.0, seed=0)
    >>> q, v, a = motion(np.linspace(0.0, motion.duration, 1000))
    >>> bool((np.abs(q) <= 0.7 * robot.limits.upper).all()), bool(np.allclose(v[[0, -1]], 0.0, atol=1e-9))
    (True, True)
    """
    check_kind("robot", robot, Robot, "robot=frischid.Robot.load(path or name)")
    check_length(duration, seed)
    rng = np.random.default_rng(seed)
    limits, J = robot.limits, len(robot.joints)
    harmonics = max(harmonics, round(0.4 * duration), 3)
    lower, upper = limits.within(np.pi)
    free = Fourier.rested(np.zeros(J), rng.normal(size=(harmonics, J)), rng.normal(size=(harmonics, J)), duration)
    t = np.linspace(0, duration, 40 * harmonics)
    q, v, _ = free(t)
    middle, reach = (q.max(axis=0) + q.min(axis=0)) / 2, np.ptp(q, axis=0) / 2
    factor = scale * np.minimum((upper - lower) / 2 / reach, np.minimum(limits.velocity, 2.0) / np.abs(v).max(axis=0))
    return Fourier((upper + lower) / 2 - factor * middle, free.A * factor, free.B * factor, duration)
