"""The limits of a motion, and the violations of these limits.

Limits must hold for every t, not only at samples:

    lower ≤ q(t) ≤ upper,   |q̇(t)| ≤ velocity,   |q̈(t)| ≤ acceleration,   |τ(t)| ≤ torque,   distance(t) ≥ margin.

Position, velocity and acceleration are checked where they are extreme: at the roots of the next derivative
(`frischid.motions.trajectory`). So their limits hold exactly. Distances are checked at 100 Hz, and so is the torque of
the URDF's own parameters and friction.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from frischid.core.arguments import check_number
from frischid.core.text import listed
from frischid.core.types import Array
from frischid.errors import InputError
from frischid.motions.collision import Clearance
from frischid.motions.trajectory import ClosedForm
from frischid.robot.joint_limits import JointLimits, read_limits
from frischid.robot.robot import Robot

SECONDS_TO_FULL_SPEED = 0.25
"""s from standstill to full speed. A URDF has no acceleration limit; this one is gentle for an industrial arm."""
CHECK_RATE = 100.0
"""Hz. Rate at which torque and distance are checked."""
LIMIT_ROUNDING = 1e-9
"""Relative excess of a limit that does not count as a violation."""
STATE_STEP = 1e-6
"""Step of a state variable for the finite differences of torque and distance."""
TIGHT = 0.999
"""Share of the limits that a search may use, so that little has to be scaled down afterwards."""
DISTANCE_SCALE = 0.1
"""m. A distance this much below its margin counts as much as a torque of twice its limit."""


LEAST_SHARE = 1e-6
"""Least share of the limits to use: no sensor sees a smaller motion, and its moments vanish in double precision."""


@dataclass(frozen=True)
class Violation:
    """One limit that a motion violates, at the time of the largest violation."""

    kind: str
    """``"position"``, ``"velocity"``, ``"acceleration"``, ``"torque"`` or ``"distance"``."""
    joint: str
    """The joint, or the two bodies that come too close."""
    time: float
    """Seconds from the start."""
    value: float
    limit: float

    def __str__(self) -> str:
        word = "below" if self.kind == "distance" or self.value < self.limit else "above"
        return f"{self.kind} of {self.joint} at {self.time:.2f} s is {self.value:.4g}, {word} {self.limit:.4g}"


@dataclass(frozen=True, eq=False)
class MotionLimits:
    """Limits of the J joints, each of shape (J,).

    Attributes
    ----------
    lower, upper : ndarray
        Position, rad (m).
    velocity, acceleration, torque : ndarray
        Largest magnitudes: rad/s (m/s), rad/s² (m/s²), N·m (N).
    """

    lower: Array
    upper: Array
    velocity: Array
    acceleration: Array
    torque: Array

    @classmethod
    def of(
        cls,
        robot: Robot,
        scale: float = 0.9,
        acceleration: float | Sequence[float] | None = None,
        turn: float = np.pi,
    ) -> MotionLimits:
        """Take the limits of a robot's URDF.

        Where the URDF states no limit: positions within ±`turn` (±0.5 m), velocities below 2 rad/s (m/s), full speed
        reached in `SECONDS_TO_FULL_SPEED`, any torque. No joint turns further than `turn` from zero, because poses
        repeat. A joint that others mimic keeps their limits of position and velocity too.

        Parameters
        ----------
        robot : Robot
        scale : float
            Share of every limit that is used, in (0, 1]; position ranges shrink about their middle.
        acceleration : float or sequence of J float, optional
            Acceleration limits, rad/s² (m/s²), also multiplied by `scale`.
        turn : float
            Largest angle from zero of a joint that turns, rad.

        Raises
        ------
        InputError
            `scale` lies outside (0, 1], or an acceleration is not a positive number.

        Examples
        --------
        >>> import frischid as fr
        >>> from frischid.motions.limits import MotionLimits
        >>> limits = MotionLimits.of(fr.Robot.load("planar2"), scale=0.5)
        >>> limits.lower.tolist(), limits.upper.tolist()
        ([-1.5, -1.5], [1.5, 1.5])
        """
        check_number("the share of the limits that is used", scale)
        if not LEAST_SHARE <= scale <= 1.0:
            raise InputError(f"the share of the limits that is used must lie in [{LEAST_SHARE:g}, 1], got {scale}")
        limits, J = robot.limits, len(robot.joints)
        reach = np.where(robot.prismatic, np.where(np.isfinite(limits.stroke), np.inf, 0.5), turn)
        limits = _with_followers(robot, limits)
        lower, upper = limits.within(reach)
        middle, half = (upper + lower) / 2, scale * (upper - lower) / 2
        velocity = np.where(np.isfinite(limits.velocity), limits.velocity, 2.0)
        most = velocity / SECONDS_TO_FULL_SPEED if acceleration is None else np.asarray(acceleration, dtype=float)
        if most.shape not in {(), (J,)} or not (most > 0).all():
            raise InputError(f"acceleration limits must be one or {J} positive numbers, got {acceleration}")
        most = np.broadcast_to(most, (J,))
        return cls(middle - half, middle + half, scale * velocity, scale * most, scale * limits.effort)

    @classmethod
    def whole_range(cls, robot: Robot) -> MotionLimits:
        """The limits of a robot's URDF, also beyond ±π; ±2π or more for a joint that turns without any."""
        ends = np.abs([robot.limits.lower, robot.limits.upper])
        stated = np.isfinite(ends) & ~robot.prismatic
        return cls.of(robot, 1.0, turn=float(ends.max(initial=2 * np.pi, where=stated)))

    @property
    def middle(self) -> Array:
        """Middle of the position range."""
        return (self.upper + self.lower) / 2

    @property
    def half(self) -> Array:
        """Half of the position range."""
        return (self.upper - self.lower) / 2


def _with_followers(robot: Robot, limits: JointLimits) -> JointLimits:
    """The limits of the independent joints, within which the joints that mimic them keep theirs too.

    Where a URDF leaves a joint no room in this way, its follower's limits of position do not count.
    """
    lower, upper, velocity = limits.lower.copy(), limits.upper.copy(), limits.velocity.copy()
    for name, (leader, factor, shift) in robot.mimics.items():
        j, own = robot.joints.index(leader), read_limits(robot.model, [robot.numbers[name]])
        if factor == 0:
            continue
        low, high = sorted(((float(own.lower[0]) - shift) / factor, (float(own.upper[0]) - shift) / factor))
        if max(low, lower[j]) < min(high, upper[j]):
            lower[j], upper[j] = max(low, lower[j]), min(high, upper[j])
        velocity[j] = min(velocity[j], float(own.velocity[0]) / abs(factor))
    return replace(limits, lower=lower, upper=upper, velocity=velocity)


def assumed_limits(robot: Robot) -> str:
    """The limits that `MotionLimits.of` takes where the URDF states none, joint by joint; empty where it states all.

    A range from 0 to 0 is none. A continuous joint has no range by its kind.

    Examples
    --------
    >>> import frischid as fr
    >>> from frischid.motions.limits import assumed_limits
    >>> assumed_limits(fr.Robot.load("planar2"))
    ''
    >>> assumed_limits(fr.Robot.load("double_pendulum")).split(" (")[0]
    "the limits in the robot's file state no range of position of any joint"
    """
    limits = _with_followers(robot, robot.limits)
    endless = np.array([robot.model.joints[robot.numbers[n]].nq == 2 for n in robot.joints])
    absent = {
        "no range of position of {} (the plan takes ±π rad or ±0.5 m)": ~np.isfinite(limits.stroke) & ~endless,
        "no speed of {} (the plan takes 2 rad/s or m/s)": ~np.isfinite(limits.velocity),
        "no torque of {} (the plan takes any)": ~np.isfinite(limits.effort),
    }
    names = np.array(robot.joints, dtype=object)
    said = [
        text.format("any joint" if none.all() else listed(names[none].tolist(), "or"))
        for text, none in absent.items()
        if none.any()
    ]
    return f"the limits in the robot's file state {listed(said)}; check that the robot may move so" if said else ""


def extremes(motion: ClosedForm, joints: int) -> tuple[Array, Array]:
    """Times and values of the extremes of every joint's position, velocity and acceleration.

    Returns
    -------
    times, values : ndarray, shape (3, 2, J)
        First axis: position, velocity, acceleration; second axis: minimum, maximum.
    """
    times, values = np.empty((3, 2, joints)), np.empty((3, 2, joints))
    for order in range(3):
        for j in range(joints):
            t = np.concatenate([[0.0, motion.duration], motion.turning(order, j)])
            x = motion(t)[order][:, j]
            for side, k in enumerate((x.argmin(), x.argmax())):
                times[order, side, j], values[order, side, j] = t[k], x[k]
    return times, values


def nominal_torque(robot: Robot, q: Array, v: Array, a: Array) -> Array:
    """Torque of the file's links, rotors and ``<dynamics>``, dry friction at its full size: (N, J) each -> (N, J)."""
    damping, friction = np.array([robot.dynamics[j] for j in robot.joints]).T
    rotors = np.array([robot.armature[j] for j in robot.joints])
    return np.asarray(robot.inverse_dynamics(q, v, a) + rotors * a + damping * v + friction * np.tanh(v / 0.02))


def violations(
    robot: Robot, motion: ClosedForm, limits: MotionLimits, clearance: Clearance | None = None
) -> list[Violation]:
    """List every limit of every joint that a motion exceeds anywhere, each at its worst time."""
    found = list(_kinematic(robot, motion, limits))
    t = np.linspace(0.0, motion.duration, int(np.ceil(CHECK_RATE * motion.duration)) + 1)
    q, v, a = motion(t)
    if np.isfinite(limits.torque).any():
        torque = nominal_torque(robot, q, v, a)
        for j, k in enumerate(np.abs(torque).argmax(axis=0)):
            if abs(torque[k, j]) > limits.torque[j] * (1 + LIMIT_ROUNDING):
                limit = np.copysign(limits.torque[j], torque[k, j])
                found.append(Violation("torque", robot.joints[j], float(t[k]), float(torque[k, j]), float(limit)))
    if clearance is not None:
        distance, pair = clearance.nearest(q)
        for p in np.unique(pair[np.isfinite(distance)]):
            k = int(np.where(pair == p, distance, np.inf).argmin())
            found.append(
                Violation("distance", clearance.names[p], float(t[k]), float(distance[k]), float(clearance.margins[p]))
            )
    return found


def _kinematic(robot: Robot, motion: ClosedForm, limits: MotionLimits) -> Iterator[Violation]:
    times, values = extremes(motion, len(robot.joints))
    sizes = (limits.half, limits.velocity, limits.acceleration)
    for order, kind in enumerate(("position", "velocity", "acceleration")):
        shift = limits.middle if order == 0 else np.zeros(len(robot.joints))
        for j, name in enumerate(robot.joints):
            side = int(np.abs(values[order, :, j] - shift[j]).argmax())
            value, time = float(values[order, side, j]), float(times[order, side, j])
            if abs(value - shift[j]) > sizes[order][j] * (1 + LIMIT_ROUNDING):
                limit = shift[j] + np.copysign(sizes[order][j], value - shift[j])
                yield Violation(kind, name, time, value, float(limit))


@dataclass(frozen=True, eq=False)
class Excess:
    """Excess of a motion over its limits on a grid of times, as one smooth number with a gradient.

    Every limit contributes ``Σ max(0, |x|/limit − 1)²``, every distance d ``Σ max(0, (margin − d)/0.1 m)²``.
    """

    robot: Robot
    limits: MotionLimits
    clearance: Clearance | None

    def loads(self, states: Array, slope: bool = True) -> tuple[float, Array]:
        """Excess of torques and distances, and its derivative by q, q̇, q̈ at M times, (3, M, J)."""
        value, gradient = 0.0, np.zeros_like(states)
        for part in (self._torque, self._distance):
            more, rows, part_gradient = part(states, slope)
            value += more
            gradient[:, rows] += part_gradient
        return value, gradient

    def wider(self, factor: float) -> Excess:
        """The same limits with margins between bodies that are `factor` times as wide."""
        if self.clearance is None:
            return self
        return replace(self, clearance=replace(self.clearance, margins=factor * self.clearance.margins))

    def fits(self, states: Array, tolerance: float = 0.0) -> bool:
        """Whether torques and distances keep their limits at all times."""
        return self.loads(states, slope=False)[0] <= tolerance

    def broken(self, states: Array) -> NDArray[np.intp]:
        """Indices of the times at which a torque or a distance violates its limit."""
        return np.union1d(self._torque(states, False)[1], self._distance(states, False)[1])

    def kinematic(self, states: Array) -> tuple[float, Array]:
        """Excess of positions, velocities and accelerations, and its derivative by q, q̇, q̈ at M times, (3, M, J)."""
        e = self.limits
        size = np.stack([e.half, e.velocity, e.acceleration])[:, None]
        relative = states / size
        relative[0] -= e.middle / e.half
        excess = np.maximum(np.abs(relative) - TIGHT, 0.0)
        return float((excess**2).sum()), 2.0 * excess * np.sign(relative) / size

    def _torque(self, states: Array, slope: bool) -> tuple[float, NDArray[np.intp], Array]:
        limit = TIGHT * self.limits.torque
        none = np.empty(0, dtype=np.intp)
        if not np.isfinite(limit).any():
            return 0.0, none, states[:, none]
        torque = nominal_torque(self.robot, *states)
        excess = np.maximum(np.abs(torque) / limit - 1.0, 0.0)
        rows = np.flatnonzero(excess.any(axis=1))
        gradient = np.zeros((3, len(rows), states.shape[2]))
        if slope and len(rows):
            by_torque = (2.0 * excess * np.sign(torque) / limit)[rows]
            for order, j in np.ndindex(3, states.shape[2]):
                moved = states[:, rows].copy()
                moved[order, :, j] += STATE_STEP
                change = nominal_torque(self.robot, *moved) - torque[rows]
                gradient[order, :, j] = (by_torque * change).sum(axis=1) / STATE_STEP
        return float((excess**2).sum()), rows, gradient

    def _distance(self, states: Array, slope: bool) -> tuple[float, NDArray[np.intp], Array]:
        none = np.empty(0, dtype=np.intp)
        if self.clearance is None or not self.clearance.names:
            return 0.0, none, states[:, none]
        q = states[0]
        distance, pair = self.clearance.nearest(q)
        excess = np.maximum(self.clearance.margins[pair] - distance, 0.0) / DISTANCE_SCALE
        rows = np.flatnonzero(excess)
        gradient = np.zeros((3, len(rows), q.shape[1]))
        if slope and len(rows):
            for j in range(q.shape[1]):
                moved = q[rows].copy()
                moved[:, j] += STATE_STEP
                change = self.clearance.distance(moved, pair[rows]) - distance[rows]
                gradient[0, :, j] = -2.0 * excess[rows] * change / (DISTANCE_SCALE * STATE_STEP)
        return float((excess**2).sum()), rows, gradient
