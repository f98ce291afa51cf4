"""A planned motion as a robot runs it: from a home pose to the first pose, the motion, and back, at rest in between.

A way from pose to pose is a quintic q(s) = q_0 + (q_1 − q_0)(10 s³ − 15 s⁴ + 6 s⁵), s = t/T, at rest at both ends, with

    max |q̇| = 15/8 |q_1 − q_0|/T,    max |q̈| = 10/√3 |q_1 − q_0|/T².

T keeps the limits of speed and acceleration, and grows until the torque keeps its limit. Where bodies would touch on
the straight way, it leads through one more pose, at rest there.

Source: Biagiotti and Melchiorri 2008, "Trajectory Planning for Automatic Machines and Robots", Springer, section 2.1.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from frischid.core.types import Array
from frischid.errors import InputError
from frischid.logs.log import Log
from frischid.motions.collision import Clearance
from frischid.motions.limits import CHECK_RATE, MotionLimits, extremes, nominal_torque, violations
from frischid.motions.motion_request import check_rate
from frischid.motions.plan import Plan
from frischid.motions.trajectory import ClosedForm, Quintic
from frischid.robot.robot import Robot

WAY_SHARE = 0.5
"""Share of the planned motion's limits of speed and acceleration that a way uses: nobody measures on the way."""
SHORTEST_WAY = 1.0  # s
DETOURS = 100
"""Poses that a way may lead through, besides the middle of the limits: random ones, the same in every call."""
NEAREST_MEASURED = 0.2
"""m. Distances above this are not measured; no margin is that wide."""
NEAREST_RATE = 20.0
"""Hz. Rate at which the least distance is measured for the output; `violations` checks the margins at `CHECK_RATE`."""


@dataclass(frozen=True)
class Peak:
    """The largest value of one quantity of one joint, against its limit."""

    joint: str
    kind: str
    """`joint`, `kind`: kind: ``"position"``, ``"speed"``, ``"acceleration"`` or ``"torque"`` (of the URDF's own
    parameters)."""
    value: float
    limit: float
    """`value`, `limit`: rad, rad/s, rad/s², N·m (m, m/s, m/s², N). The limit is infinite where the URDF states none. A
    position is counted from the middle of its limits."""


@dataclass(frozen=True)
class Nearest:
    """The least distance of two bodies along a motion."""

    bodies: str
    distance: float
    margin: float
    """`distance`, `margin`: m; the distance is infinite if nothing comes nearer than `NEAREST_MEASURED`."""
    time: float
    """s from the start."""


@dataclass(frozen=True, eq=False)
class Programme:
    """A motion with its ways, ready to be sampled."""

    joints: tuple[str, ...]
    parts: tuple[ClosedForm, ...]
    """The ways and the motion, in order; each starts where the last one ends, at rest."""
    approach: float
    back: float
    """`approach`, `back`: Length of the ways before and after the motion, s; zero without a home pose."""
    peaks: tuple[Peak, ...]
    """Of all parts together."""
    nearest: Nearest | None
    """None where the URDF has no collision shapes."""

    @property
    def duration(self) -> float:
        """Length of all parts, s."""
        return sum(part.duration for part in self.parts)

    def __call__(self, t: Array) -> tuple[Array, Array, Array]:
        """Position, velocity and acceleration at times t (N,), each of shape (N, J)."""
        return _along(self.parts, t)

    def to_log(self, rate: float) -> Log:
        """Sample t, q, v and a at `rate` Hz, from the start on, and the end."""
        check_rate(rate, self.duration)
        t = np.arange(int(np.ceil(rate * self.duration * (1 - 1e-12))) + 1) / rate
        q, v, a = self(t)
        return Log(t, self.joints, q, v, a, source="exciting motion")


def _along(parts: Sequence[ClosedForm], t: Array) -> tuple[Array, Array, Array]:
    ends = np.cumsum([part.duration for part in parts])
    which = np.minimum(np.searchsorted(ends, t, side="right"), len(parts) - 1)
    rows = np.empty((3, len(t), parts[0](np.zeros(1))[0].shape[1]))
    for k, part in enumerate(parts):
        here = which == k
        if here.any():
            rows[:, here] = part(np.minimum(t[here] - (ends[k] - part.duration), part.duration))
    return rows[0], rows[1], rows[2]


def programme(
    robot: Robot,
    plan: Plan,
    home: Sequence[float] | None = None,
    share: float = 0.9,
    repeat: int = 1,
    clearance: Clearance | None = None,
) -> Programme:
    """Add ways from a home pose to a planned motion and back, and measure everything against the limits.

    Parameters
    ----------
    home : sequence of float, optional
        Pose before and after the motion, rad (m); None: the motion alone.
    share : float
        Share of the limits that the plan used.
    repeat : int
        Runs of the motion, one after another without a pause.
    clearance : Clearance, optional
        Pairs of bodies that must not touch; by default from the URDF's collision shapes and a floor at the base.

    Raises
    ------
    InputError
        The home pose lies outside of the limits, no way from it keeps all distances, or a motion that comes again does
        not end where it began.

    Examples
    --------
    >>> import frischid as fr
    >>> from frischid.motions.programme import programme
    >>> robot = fr.Robot.load("planar2")
    >>> plan = fr.plan(robot, options=fr.PlanOptions(duration=4.0, budget=20, seed=0))
    >>> found = programme(robot, plan, home=(0.0, 0.0))
    >>> found.duration > 4.0, found.to_log(50.0).q[[0, -1]].round(9).tolist()
    (True, [[0.0, 0.0], [0.0, 0.0]])
    """
    limits, clearance = MotionLimits.of(robot, share), clearance or Clearance.of(robot)
    plan.check_repeat(repeat)
    motion = plan.trajectory
    before: list[ClosedForm] = []
    after: list[ClosedForm] = []
    if home is not None:
        pose = checked_home(robot, home)
        first, last = (motion(np.array([t]))[0][0] for t in (0.0, motion.duration))
        before, after = _way(robot, pose, first, limits, clearance), _way(robot, last, pose, limits, clearance)
    parts = (*before, *([motion] * repeat), *after)
    return Programme(
        plan.joints,
        parts,
        sum(p.duration for p in before),
        sum(p.duration for p in after),
        tuple(_peaks(robot, parts, limits)),
        _nearest(parts, clearance),
    )


def checked_home(robot: Robot, home: Sequence[float]) -> Array:
    """The home pose as an array, (J,), rad (m).

    Raises
    ------
    InputError
        It has another number of joints than the robot, or lies outside of the URDF's limits.
    """
    if len(home) != len(robot.joints):
        raise InputError(
            f"the home pose has {len(home)} numbers, but {robot.name} has {len(robot.joints)} joints: "
            f"{', '.join(robot.joints)}"
        )
    limits = MotionLimits.whole_range(robot)
    for name, x, low, high in zip(robot.joints, home, limits.lower, limits.upper, strict=True):
        if not low <= x <= high:
            raise InputError(f"the home pose has {name} at {x:g}, outside of its limits {low:.4g} to {high:.4g}")
    return np.array(home, dtype=float)


def _way(robot: Robot, start: Array, end: Array, limits: MotionLimits, clearance: Clearance) -> list[ClosedForm]:
    """A way at rest at both ends, through one more pose where the straight one touches something."""
    full = MotionLimits.whole_range(robot)
    slow = replace(
        limits,
        lower=full.lower,
        upper=full.upper,
        velocity=WAY_SHARE * limits.velocity,
        acceleration=WAY_SHARE * limits.acceleration,
    )
    for poses in _candidates(start, end, limits):
        if np.isfinite(clearance.nearest(np.stack(poses))[0]).any():
            continue
        way = [_straight(robot, a, b, slow) for a, b in pairwise(poses) if (a != b).any()]
        if not any(violations(robot, part, slow, clearance) for part in way):
            return list(way)
    raise InputError(
        f"no way from the pose {_pose(start)} to {_pose(end)} keeps all distances and limits, also not through "
        f"{DETOURS} other poses; give another home pose, nearer to the middle of the limits {_pose(limits.middle)}"
    )


def _candidates(start: Array, end: Array, limits: MotionLimits) -> Iterator[list[Array]]:
    rng = np.random.default_rng(0)
    yield [start, end]
    yield [start, limits.middle, end]
    for _ in range(DETOURS):
        yield [start, rng.uniform(limits.lower, limits.upper), end]


def _straight(robot: Robot, start: Array, end: Array, limits: MotionLimits) -> Quintic:
    """The shortest quintic within the limits of speed and acceleration, slower where that keeps the torque's limit."""
    d = np.abs(end - start)
    T = max(
        SHORTEST_WAY, (15 / 8 * d / limits.velocity).max(), np.sqrt(10 / np.sqrt(3) * d / limits.acceleration).max()
    )
    zero = np.zeros((2, len(d)))
    for _ in range(6):
        T *= 1.001  # rounding must not exceed a limit
        way = Quintic(np.array([0.0, T]), np.stack([start, end]), zero, zero)
        if not any(v.kind == "torque" for v in violations(robot, way, limits)):
            break
        T *= 1.5
    return way


def _pose(q: Array) -> str:
    return "(" + ", ".join(f"{x:.3g}" for x in q) + ")"


def _peaks(robot: Robot, parts: Sequence[ClosedForm], limits: MotionLimits) -> Iterator[Peak]:
    """Largest values of all joints: exact for the motion, at `CHECK_RATE` for the torque."""
    J = len(robot.joints)
    values = np.stack([extremes(part, J)[1] for part in parts])  # part, order, side, joint
    position = np.abs(values[:, 0] - limits.middle).max(axis=(0, 1))
    speed, acceleration = (np.abs(values[:, k]).max(axis=(0, 1)) for k in (1, 2))
    t = np.arange(0.0, sum(part.duration for part in parts), 1 / CHECK_RATE)
    torque = np.abs(nominal_torque(robot, *_along(parts, t))).max(axis=0)
    for j, name in enumerate(robot.joints):
        yield Peak(name, "position", float(position[j]), float(limits.half[j]))
        yield Peak(name, "speed", float(speed[j]), float(limits.velocity[j]))
        yield Peak(name, "acceleration", float(acceleration[j]), float(limits.acceleration[j]))
        yield Peak(name, "torque", float(torque[j]), float(limits.torque[j]))


def _nearest(parts: Sequence[ClosedForm], clearance: Clearance) -> Nearest | None:
    if not clearance.names:
        return None
    t = np.arange(0.0, sum(part.duration for part in parts), 1 / NEAREST_RATE)
    wide = replace(clearance, margins=np.full(len(clearance.names), NEAREST_MEASURED))
    distance, pair = wide.nearest(_along(parts, t)[0])
    k = int(distance.argmin())
    return Nearest(clearance.names[pair[k]], float(distance[k]), float(clearance.margins[pair[k]]), float(t[k]))
