"""The simulated world of the hidden-effect benchmark: arms, motions, and torque along them.

Nothing here uses frischid's regressor or its effects. Rigid torques are those of Pinocchio's recursive Newton-Euler
algorithm with inertial parameters that differ from the URDF's. Dry friction is a sign that sticks at standstill.
Motions are functions of time whose clock is late or early at times, or stops.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from frischid.core.types import Array
from frischid.motions.trajectory import Quintic, Trajectory, random_fourier
from frischid.robot.robot import Robot

STEP = 1e-3
"""Time step of every simulated world, s."""
STICK = 5e-4
"""Speed below which a joint may stick, rad/s."""
RESTING = 0.1
"""Time that a joint must be so slow to count as at standstill, s."""
SMOOTH = 4e-3
"""Speed over which dry friction changes its direction in a simulation that integrates it, rad/s."""

_LINK = (
    '<link name="{0}"><inertial><origin xyz="{1}"/><mass value="{2}"/>'
    '<inertia ixx="{3}" iyy="{4}" izz="{5}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
)
_JOINT = (
    '<joint name="{0}" type="revolute"><parent link="{1}"/><child link="{2}"/><origin xyz="{3}" rpy="{4}"/>'
    '<axis xyz="0 0 1"/><limit lower="-2.5" upper="2.5" velocity="3" effort="200"/></joint>'
)
ELBOW = '<robot name="elbow">{}</robot>'.format(
    "".join(
        [
            '<link name="base"/>',
            _LINK.format("column", "0.01 0 -0.05", 6.0, 0.05, 0.06, 0.03),
            _LINK.format("upper", "0.2 0.01 0.02", 4.0, 0.01, 0.09, 0.09),
            _LINK.format("fore", "0.15 0 0.01", 2.0, 0.004, 0.03, 0.03),
            _JOINT.format("waist", "base", "column", "0 0 0.3", "0 0 0"),
            _JOINT.format("shoulder", "column", "upper", "0 0 0.1", "1.5708 0 0"),
            _JOINT.format("elbow", "upper", "fore", "0.45 0 0", "0 0 0"),
        ]
    )
)
"""An arm with three joints, invented for this benchmark."""

ARMS: dict[str, tuple[str, ...]] = {
    "planar2": (),
    "TwoDofs": (),
    "elbow3": (),
    "tiago_no_hand": (),
    "z1": ("jointGripper",),
    "ur5": (),
    "ur10": (),
    "kinova": (),
    "panda": ("panda_finger_joint1",),
    "xarm7": (),
}
"""Arms of the benchmark, and the joints of each that are locked."""


def arm(name: str) -> Robot:
    """Load an arm as its user knows it."""
    if name == "elbow3":
        return Robot(name="elbow3", source="elbow3", urdf=ELBOW)
    if name == "tiago_no_hand":
        return Robot.load(name, joints=[f"arm_{k}_joint" for k in range(1, 6)])
    return Robot.load(name, lock=ARMS[name])


def perturbed(model: Any, rng: np.random.Generator, lower: float = 0.05, upper: float = 0.2) -> Any:
    """Copy a Pinocchio model and change every link by 5 to 20 %; the links stay physical.

    The density-weighted covariance about the centre of mass, ``Σ = tr(I)/2·1 − I``, is deformed as ``A Σ Aᵀ``: this
    stretches the body, so that no inertia becomes impossible.
    """
    other = pin.Model(model)

    def change(*shape: int) -> Array:
        return rng.choice([-1.0, 1.0], shape) * rng.uniform(lower, upper, shape)

    for i in range(1, model.njoints):
        body = model.inertias[i]
        spread = 0.5 * np.trace(body.inertia) * np.eye(3) - body.inertia
        A = np.eye(3) + np.diag(0.5 * change(3)) + 0.02 * rng.normal(size=(3, 3))
        spread = A @ spread @ A.T
        mass = float(1 + change(1)[0])
        size = max(np.linalg.norm(body.lever), np.sqrt(np.trace(spread) / max(body.mass, 1e-9)))
        lever = body.lever + change(3) * size / np.sqrt(3)
        inertia = mass * (np.trace(spread) * np.eye(3) - spread)
        other.inertias[i] = pin.Inertia(mass * body.mass, lever, inertia)
    return other


@dataclass(frozen=True, eq=False)
class Path:
    """The motion of all joints on the world's clock, (N, J) each."""

    t: Array
    q: Array
    v: Array
    a: Array


def clock(rng: np.random.Generator, duration: float, pauses: int) -> tuple[Array, Array, Array, Array]:
    """Time t, and the motion's own time s(t) with two derivatives: a little early and late, and with pauses."""
    t = np.arange(round(duration / STEP) + 1) * STEP
    frequency, phase = rng.uniform(0.3, 2.0, 3), rng.uniform(0, 2 * np.pi, 3)
    size = rng.uniform(0.0, 0.01, 3)
    angle = 2 * np.pi * frequency * t[:, None] + phase
    rate = 1 + (size * np.sin(angle)).sum(axis=1)
    slope = (size * 2 * np.pi * frequency * np.cos(angle)).sum(axis=1)
    go, dgo = np.ones_like(t), np.zeros_like(t)
    for k in range(pauses):
        width, ramp = rng.uniform(0.6, 1.5), 0.25
        centre = duration * (k + rng.uniform(0.3, 0.7)) / pauses
        x = np.clip((np.abs(t - centre) - width / 2) / ramp, 0, 1)
        step, dstep = x**3 * (10 - 15 * x + 6 * x**2), 30 * x**2 * (1 - x) ** 2 * np.sign(t - centre) / ramp
        go, dgo = go * step, dgo * step + go * dstep
    rate, slope = rate * go, slope * go + rate * dgo
    s = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1])) * STEP])
    return t, s, rate, slope


def point_to_point(robot: Robot, duration: float, seed: int, scale: float) -> Quintic:
    """Rest-to-rest moves between random poses, some followed by a wait."""
    rng = np.random.default_rng(seed)
    lower, upper = np.maximum(robot.limits.lower, -np.pi), np.minimum(robot.limits.upper, np.pi)
    middle, reach = (upper + lower) / 2, scale * (upper - lower) / 2
    speed = scale * np.minimum(robot.limits.velocity, 2.0)
    t, q = [0.0], [middle + reach * rng.uniform(-1, 1, len(middle))]
    while t[-1] < duration:
        step = np.clip(rng.uniform(-1, 1, len(middle)) * reach, -speed, speed)
        goal = q[-1] + step
        goal = np.where(np.abs(goal - middle) > reach, q[-1] - step, goal)
        t.append(t[-1] + max(0.5, 1.875 * float(np.max(np.abs(goal - q[-1]) / speed))))
        q.append(goal)
        if rng.random() < 0.4:
            t.append(t[-1] + rng.uniform(0.2, 1.0))
            q.append(goal)
    still = np.zeros((len(t), len(middle)))
    return Quintic(np.array(t), np.array(q), still, still)


def motion(
    robot: Robot, family: str, duration: float, seed: int, scale: float, bandwidth: float = 0.4, pauses: int = 0
) -> Path:
    """Random motion that an arm can follow.

    Parameters
    ----------
    robot : Robot
    family : {"fourier", "points"}
    duration : float
        Seconds.
    seed : int
    scale : float
        Share of the limits that is used.
    bandwidth : float
        Fastest harmonic, Hz.
    pauses : int
        Number of pauses, in which all joints stand still for about a second.
    """
    t, s, rate, slope = clock(np.random.default_rng([seed, 1]), duration, pauses)
    plan: Trajectory
    if family == "points":
        plan = point_to_point(robot, float(s[-1]), seed, scale)
    else:
        plan = random_fourier(
            robot, float(s[-1]), seed=seed, scale=scale, harmonics=max(5, round(bandwidth * float(s[-1])))
        )
    q, v, a = plan(np.minimum(s, plan.duration))
    return Path(t, q, v * rate[:, None], a * rate[:, None] ** 2 + v * slope[:, None])


@dataclass(frozen=True, eq=False)
class Drive:
    """Friction and rotors of all joints, (J,) each, N·m per rad/s, N·m, N·m and kg·m²."""

    viscous: Array
    coulomb: Array
    offset: Array
    rotor: Array

    @classmethod
    def plausible(cls, rng: np.random.Generator, path: Path, load: Array) -> Drive:
        """Drives whose terms are each a few percent of the joint's torque in a motion."""
        spread = load.std(axis=0)
        size = np.sqrt(spread**2 + (0.03 * spread.max()) ** 2)
        J = len(size)
        return cls(
            rng.uniform(0.05, 0.2, J) * size / np.maximum(rms(path.v), 1e-3),
            rng.uniform(0.05, 0.2, J) * size,
            rng.uniform(-0.05, 0.05, J) * size,
            rng.uniform(0.05, 0.25, J) * size / np.maximum(rms(path.a), 1e-3),
        )

    def torque(self, path: Path, sign: Array) -> Array:
        """Torque of the drives along a motion, (N, J)."""
        return self.viscous * path.v + self.coulomb * sign + self.offset + self.rotor * path.a


@dataclass(frozen=True, eq=False)
class World:
    """A true motion and its torque, without hidden effects.

    Attributes
    ----------
    model : pinocchio.Model
        The true rigid bodies.
    robot : Robot
        The user's robot, for names and the meaning of q.
    path : Path
        Motion that the motors' encoders measure.
    drive : Drive
    load : ndarray, shape (N, J)
        Rigid-body torque, N·m.
    base : ndarray, shape (N, J)
        Torque of links and drives, N·m.
    sign : ndarray, shape (N, J)
        Direction of dry friction, -1 to 1.
    number : int
        0 for the motion to fit, 1 for the second one, 2 for the one before the change.
    """

    model: Any
    robot: Robot
    path: Path
    drive: Drive
    load: Array
    base: Array
    sign: Array
    number: int

    def on(self, joint: int, values: Array) -> Array:
        """Torque on one joint only, (N, J)."""
        out = np.zeros_like(self.path.q)
        out[:, joint] = values
        return out


def rnea(model: Any, robot: Robot, path: Path) -> Array:
    """Rigid-body torque along a motion, (N, J)."""
    data, compute = model.createData(), pin.rnea
    rows = zip(robot.configuration(path.q), path.v, path.a, strict=True)
    return np.array([compute(model, data, q, v, a) for q, v, a in rows])


def direction(v: Array) -> Array:
    """Direction of dry friction; a joint at standstill keeps a part of its last friction until it moves again."""
    sign = np.tanh(v / STICK)
    for j in range(v.shape[1]):
        slow = np.abs(v[:, j]) < STICK
        edges = np.flatnonzero(np.diff(np.concatenate([[0], slow.astype(int), [0]])))
        for start, stop in edges.reshape(-1, 2):
            if (stop - start) * STEP > RESTING:
                before = sign[start - 1, j] if start else 0.0
                sign[start:stop, j] = before * (0.5 + 0.5 * np.exp(-np.arange(stop - start) * STEP / 0.2))
    return sign


def prescribed(model: Any, robot: Robot, path: Path, drive: Drive, number: int, sign: Array | None = None) -> World:
    """World of a given motion: its torque by inverse dynamics."""
    load = rnea(model, robot, path)
    way = direction(path.v) if sign is None else sign
    return World(model, robot, path, drive, load, load + drive.torque(path, way), way, number)


def rms(x: Array) -> Array:
    """Root mean square of every column, at least a very small number."""
    return np.asarray(np.maximum(np.sqrt((x**2).mean(axis=0)), 1e-9))
