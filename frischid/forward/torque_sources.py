"""Where the torque of a simulation comes from: a recording, or a controller that follows commands.

    open loop:    τ(t) = the recorded torque, a cubic through two samples with the slopes of their neighbours
    closed loop:  τ = sat( τ_ff + kp dz(q_cmd − q) + kd (v_cmd − q̇) ),   dz(x) = x less at most the dead band

A source is anything with a method ``torque(t, q, v)`` for K robots at once. It may have a `delay`: the torque that acts
at t is the one the source gave at t − delay.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from frischid.core.types import Array
from frischid.errors import InputError
from frischid.robot.motion_arrays import numbers_of


def _as_floats(source: object, *names: str) -> None:
    """Turn fields of a frozen source into arrays of floats; None stays None."""
    for name in names:
        given = getattr(source, name)
        object.__setattr__(source, name, None if given is None else numbers_of(name, given))


class TorqueSource(Protocol):
    """Torque for K simulated robots."""

    def torque(self, t: Array, q: Array, v: Array) -> Array:
        """Torque (K, J), N·m (N), at the times t (K,), s, for positions and velocities (K, J)."""
        ...


def between(t: Array, values: Array, at: Array) -> Array:
    """Values (N, J) at the times t (N,), joined by straight lines, at other times (K,): (K, J)."""
    k = np.minimum(np.maximum(np.searchsorted(t, at, side="right") - 1, 0), len(t) - 2)
    before = t[k]
    share = np.minimum(np.maximum((at - before) / (t[k + 1] - before), 0.0), 1.0)[:, None]
    low = values[k]
    return np.asarray(low + share * (values[k + 1] - low))


@dataclass(frozen=True, eq=False)
class RecordedTorque:
    """A torque over time, for open-loop simulation: a cubic Hermite spline, which straight lines would flatten.

    A torque that was recorded d seconds late acted at its time stamps less d. For the record of a log that a model
    counts as late, give the times ``log.t - model.lowpass.torque_lag``; the functions that take logs do this
    themselves.

    Attributes
    ----------
    t : ndarray, shape (N,)
        Increasing times, s. Before the first and after the last, the torque stays the same.
    tau : ndarray, shape (N, J)
        N·m (N).

    Raises
    ------
    InputError
        Shapes disagree, times do not increase, or a torque is not finite.

    Examples
    --------
    >>> import numpy as np
    >>> import frischid as fr
    >>> source = fr.RecordedTorque(np.array([0.0, 1.0]), np.array([[0.0], [2.0]]))
    >>> source.torque(np.array([0.25]), np.zeros((1, 1)), np.zeros((1, 1)))
    array([[0.5]])
    """

    t: Array
    tau: Array

    def __post_init__(self) -> None:
        _as_floats(self, "t", "tau")
        if self.tau.ndim != 2 or self.t.shape != self.tau.shape[:1] or len(self.t) < 2:
            raise InputError(
                f"a recorded torque needs tau (N, J) with N ≥ 2 times, got {self.tau.shape} with {self.t.shape} times"
            )
        if not (np.diff(self.t) > 0).all():
            raise InputError("the times of a recorded torque must increase")
        if not np.isfinite(self.tau).all():
            raise InputError("a recorded torque has values that are not finite; name only joints with a torque channel")

    def torque(self, t: Array, q: Array, v: Array) -> Array:
        """Interpolate; `q` and `v` do not matter."""
        k = np.minimum(np.maximum(np.searchsorted(self.t, t, side="right") - 1, 0), len(self.t) - 2)
        before, low = self.t[k], self.tau[k]
        step = self.t[k + 1] - before
        x = np.minimum(np.maximum((t - before) / step, 0.0), 1.0)[:, None]
        rise, first, last = self.tau[k + 1] - low, step[:, None] * self._slopes[k], step[:, None] * self._slopes[k + 1]
        return np.asarray(low + x * (first + x * (3.0 * rise - 2.0 * first - last + x * (first + last - 2.0 * rise))))

    @cached_property
    def _slopes(self) -> Array:
        return np.asarray(np.gradient(self.tau, self.t, axis=0))


Gain = float | Array


@dataclass(frozen=True, eq=False)
class PositionController:
    """Position control with saturation, dead band and delay; every gain is a number, (J,), or (K, J) for K robots.

    Attributes
    ----------
    t : ndarray, shape (N,)
        Times of the commands, s.
    q_cmd : ndarray, shape (N, J)
        Commanded positions, rad (m); straight lines between the samples.
    kp, kd : float or ndarray
        N·m/rad (N/m), N·m·s/rad (N·s/m).
    v_cmd, feedforward : ndarray, shape (N, J), optional
        Commanded velocities and torques; zero by default.
    limit : float or ndarray
        Largest torque, N·m (N).
    dead_band : float or ndarray
        Position error that makes no torque, rad (m).
    delay : float
        Time from measuring to torque, s.

    Raises
    ------
    InputError
        Shapes disagree, times do not increase, a command or a gain is not finite, or the delay or a limit is negative.

    Examples
    --------
    >>> import numpy as np
    >>> import frischid as fr
    >>> hold = fr.PositionController(np.array([0.0, 1.0]), np.ones((2, 1)), kp=10.0, kd=1.0, limit=4.0)
    >>> hold.torque(np.zeros(1), np.zeros((1, 1)), np.zeros((1, 1)))
    array([[4.]])
    """

    t: Array
    q_cmd: Array
    kp: Gain
    kd: Gain
    v_cmd: Array | None = None
    feedforward: Array | None = None
    limit: Gain = np.inf
    dead_band: Gain = 0.0
    delay: float = 0.0

    def __post_init__(self) -> None:
        _as_floats(self, "t", "q_cmd", "v_cmd", "feedforward")
        if self.t.ndim != 1 or len(self.t) < 2 or not (np.diff(self.t) > 0).all():
            raise InputError("a controller needs at least two commands, at increasing times")
        if self.q_cmd.ndim != 2 or len(self.q_cmd) != len(self.t):
            raise InputError(f"q_cmd must be (N, J) with the N = {len(self.t)} times, got {self.q_cmd.shape}")
        for name in ("q_cmd", "v_cmd", "feedforward"):
            values = getattr(self, name)
            if values is not None and values.shape != self.q_cmd.shape:
                raise InputError(f"{name} must have the shape {self.q_cmd.shape} of q_cmd, got {values.shape}")
            if values is not None and not np.isfinite(values).all():
                row, column = np.argwhere(~np.isfinite(values))[0].tolist()
                raise InputError(f"{name} of a controller is {values[row, column]} at row {row}, joint {column}")
        _as_floats(self, *(name for name in ("kp", "kd", "limit", "dead_band") if np.ndim(getattr(self, name))))
        for name in ("kp", "kd"):
            if not np.isfinite(getattr(self, name)).all():
                raise InputError(f"{name} of a controller must be finite, got {getattr(self, name)}")
        for name in ("limit", "dead_band", "delay"):
            if not (np.asarray(getattr(self, name)) >= 0).all():
                raise InputError(f"{name} of a controller must not be negative, got {getattr(self, name)}")

    def torque(self, t: Array, q: Array, v: Array) -> Array:
        """Torque of the controller for K robots, (K, J)."""
        error = between(self.t, self.q_cmd, t) - q
        rate = (0.0 if self.v_cmd is None else between(self.t, self.v_cmd, t)) - v
        error = np.sign(error) * np.maximum(np.abs(error) - self.dead_band, 0.0)
        ahead = 0.0 if self.feedforward is None else between(self.t, self.feedforward, t)
        return np.asarray(np.clip(ahead + self.kp * error + self.kd * rate, -np.asarray(self.limit), self.limit))


@dataclass(frozen=True, eq=False)
class TorqueFunction:
    """A function ``(t, q, v) -> tau`` as a source, for controllers of one's own."""

    function: Callable[[Array, Array, Array], Array]
    """Takes times (K,), positions and velocities (K, J), and returns the torque (K, J)."""
    delay: float = 0.0
    """s."""

    def torque(self, t: Array, q: Array, v: Array) -> Array:
        """The torque that the function returns."""
        return self.function(t, q, v)
