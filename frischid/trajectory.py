"""Motions as functions of time: q(t), q̇(t), q̈(t) in closed form, nothing differentiated numerically.

Two families: joint-wise finite Fourier series (Swevers et al. 1997) brought to rest at both ends, and quintic
polynomials through given points (q, q̇, q̈), the paper's section 3.2.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BPoly

from frischid.errors import InputError
from frischid.robot import Robot

Array = NDArray[np.float64]


class Trajectory(Protocol):
    """Anything that gives a motion of J joints over ``[0, duration]`` seconds."""

    @property
    def duration(self) -> float:
        """Length in seconds."""
        ...

    def __call__(self, t: Array) -> tuple[Array, Array, Array]:
        """Position, velocity and acceleration at times t, each of shape (N, J)."""
        ...


@dataclass(frozen=True, eq=False)
class Fourier:
    """Finite Fourier series per joint, periodic, at rest at both ends.

        q_j(t) = c_j + Σ_k [A_kj (sin ω_k t)/ω_k − B_kj (cos ω_k t − 1)/ω_k],   ω_k = 2πk / duration

    with Σ_k A_kj = 0 and Σ_k k B_kj = 0, which makes q̇ and q̈ vanish at the ends; `rested` projects onto that.

    Attributes
    ----------
    centre : ndarray, shape (J,)
        Position at both ends, rad (m).
    A, B : ndarray, shape (K, J)
        Coefficients of K harmonics, rad/s (m/s).
    duration : float
        Period, s.
    """

    centre: Array
    A: Array
    B: Array
    duration: float

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


@dataclass(frozen=True, eq=False)
class Quintic:
    """Quintic polynomials through points given with velocity and acceleration.

    Attributes
    ----------
    t : ndarray, shape (M,)
        Times of the points, s; the first is time zero of the motion.
    q, v, a : ndarray, shape (M, J)
    """

    t: Array
    q: Array
    v: Array
    a: Array

    def __post_init__(self) -> None:
        if len(self.t) < 2 or (np.diff(self.t) <= 0).any():
            raise InputError("points to interpolate need at least two strictly increasing times")

    @property
    def duration(self) -> float:
        """Length in seconds."""
        return float(self.t[-1] - self.t[0])

    def __call__(self, t: Array) -> tuple[Array, Array, Array]:
        """Position, velocity and acceleration at times t (N,), each of shape (N, J)."""
        spline = BPoly.from_derivatives(self.t - self.t[0], np.stack([self.q, self.v, self.a], axis=1))
        return spline(t), spline.derivative(1)(t), spline.derivative(2)(t)


def random_fourier(robot: Robot, duration: float, *, seed: int, harmonics: int = 5, scale: float = 0.7) -> Fourier:
    """Random motion that stays within `scale` times the robot's position and velocity limits.

    Joints without a position limit swing by at most π, joints without a velocity limit move at most 2 rad/s (m/s).

    Parameters
    ----------
    robot : Robot
    duration : float
        Seconds.
    seed : int
    harmonics : int
        Number of harmonics of 1/duration; raised so that the fastest is at least 0.4 Hz.
    scale : float
        Share of the limits used.

    Returns
    -------
    Fourier
    """
    if not (np.isfinite(duration) and duration > 0):
        raise InputError(f"the duration must be a positive number of seconds, got {duration}")
    rng = np.random.default_rng(seed)
    limits, J = robot.limits, len(robot.joints)
    harmonics = max(harmonics, round(0.4 * duration), 3)
    lower, upper = np.maximum(limits.lower, -np.pi), np.minimum(limits.upper, np.pi)
    free = Fourier.rested(
        np.zeros(J), rng.normal(size=(harmonics, J)), rng.normal(size=(harmonics, J)), duration
    )
    t = np.linspace(0, duration, 40 * harmonics)
    q, v, _ = free(t)
    middle, reach = (q.max(axis=0) + q.min(axis=0)) / 2, np.ptp(q, axis=0) / 2
    factor = scale * np.minimum((upper - lower) / 2 / reach, np.minimum(limits.velocity, 2.0) / np.abs(v).max(axis=0))
    return Fourier((upper + lower) / 2 - factor * middle, free.A * factor, free.B * factor, duration)
