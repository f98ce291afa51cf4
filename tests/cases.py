"""What the test matrices run over: robots, effects, estimators, and an independent reference for the torque."""

import xml.etree.ElementTree as ET
from functools import cache
from itertools import pairwise

import numpy as np
import pinocchio as pin

from frischid.effects import EFFECTS, RotorInertia
from frischid.model.identification import identify
from frischid.model.identify_options import ESTIMATORS
from frischid.motions.simulation import parameters_of, simulate
from frischid.motions.trajectory import random_fourier
from frischid.regression.regressor import Regressor
from frischid.robot.robot import Robot
from frischid.robot.urdf_reading import robot_names

INERTIAL = (
    '<inertial><origin xyz="{c}"/><mass value="{m}"/><inertia ixx="{i[0]}" iyy="{i[1]}" izz="{i[2]}" '
    'ixy="0.001" ixz="-0.002" iyz="0.003"/></inertial>'
)
LIMIT = '<limit lower="-2" upper="2" velocity="3" effort="50"/>'


def link(name, mass=0.0, centre="0.1 0.02 -0.03", inertia=(0.05, 0.06, 0.07), extra=""):
    """One URDF link, without an inertial when it has no mass."""
    inside = INERTIAL.format(c=centre, m=mass, i=inertia) if mass else ""
    return f'<link name="{name}">{inside}{extra}</link>'


def joint(name, parent, child, kind="revolute", xyz="0 0 0.3", rpy="0 0 0", axis="0 0 1", inside=LIMIT):
    """One URDF joint."""
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/>{inside}</joint>'
    )


def urdf(*parts, name="made"):
    """Put a URDF together from links and joints."""
    return f'<?xml version="1.0"?><robot name="{name}">{"".join(parts)}</robot>'


def made(text, **options):
    """Build a robot from a URDF's text."""
    return Robot(name="made", source="made", urdf=text, **options)


# A chain with one joint of each kind; `gripper` follows a follower of the elbow.
MIXED = urdf(
    link("base"),
    link("a", 3.0),
    link("b", 2.0, "0.05 0 0.1"),
    link("c", 1.0, "0 0.1 0.02"),
    link("d", 0.5, "0.02 0 0.1"),
    link("e", 0.3, "0.01 0 0.03", (0.01, 0.02, 0.015)),
    joint("turn", "base", "a", "continuous", inside='<limit velocity="4" effort="60"/>'),
    joint("slide", "a", "b", "prismatic", "0.2 0 0", "0.3 0.1 0", "0 1 0"),
    joint("elbow", "b", "c", "revolute", "0 0.1 0.4", "1.2 0 0.4", "1 0 0"),
    joint(
        "follower", "c", "d", rpy="0 0.7 0", axis="0 1 0",
        inside=f'{LIMIT}<mimic joint="elbow" multiplier="2" offset="0.3"/>',
    ),
    joint(
        "gripper", "d", "e", "prismatic", rpy="0.5 0 0",
        inside=f'{LIMIT}<mimic joint="follower" multiplier="-0.5" offset="0.1"/>',
    ),
    name="mixed",
)  # fmt: skip

TIAGO = ["torso_lift_joint", "arm_1_joint", "arm_2_joint", "arm_3_joint", "arm_4_joint"]
LOADERS = {
    "planar2": lambda: Robot.load("planar2"),
    "planar2 far_end known": lambda: Robot.load("planar2", frames="far_end", known={"my1": 0.0, "my2": 0.1, "m2": 9.0}),
    "ur10": lambda: Robot.load("ur10"),
    "ur10 far_end tilted": lambda: Robot.load("ur10", frames="far_end", base_rpy=(0.4, -0.9, 0.2)),
    "ur10 own frames": lambda: Robot.load("ur10", frames={"elbow_joint": "forearm_link"}),
    "panda with fingers": lambda: Robot.load("panda"),
    "double pendulum continuous": lambda: Robot.load("double_pendulum_continuous"),
    "one joint": lambda: Robot.load("double_pendulum", joints=["joint1"]),
    "kinova continuous": lambda: Robot.load("kinova", lock={"j2s6s200_joint_4": 0.7}),
    "tiago torso and arm": lambda: Robot.load("tiago", joints=TIAGO, lock={"arm_6_joint": 0.5}),
    "mixed mimic": lambda: made(MIXED),
    "mixed mimic far_end known": lambda: made(MIXED, frames="far_end", known={"m2": 2.5, "Ixx5": 0.0}),
}
ROBOTS = tuple(LOADERS)


@cache
def robot(name):
    """One of `ROBOTS`."""
    return LOADERS[name]()


def _variants(kind):
    """Build an effect as it comes, and once more for every switch it has."""
    usual = kind()
    flipped = [kind(**{k: not x}) for k, x in usual.parameters.items() if isinstance(x, bool)]
    return [usual, *flipped]


# An effect of a controller needs a log of commands, which no simulation of a torque gives.
EFFECT_CASES = {
    str(effect): effect
    for effect in [
        *(effect for kind in EFFECTS.values() if not kind.of_controller for effect in _variants(kind)),
        RotorInertia(coupled=True, ratio=60.0),
    ]
}
ESTIMATOR_CASES = tuple(ESTIMATORS)


def commands_of(machine, q):
    """Channels of a log of commands near the positions q (N, J)."""
    kinds = ("push_rate", np.cos), ("rest", np.sin), ("velocity_command", np.tanh)
    return {f"controller_{k}_{n}": 3.0 * f(q[:, i]) for k, f in kinds for i, n in enumerate(machine.joints)}


def states(machine, count=6, seed=0):
    """Random positions, velocities and accelerations within the robot's limits."""
    rng = np.random.default_rng(seed)
    J = len(machine.joints)
    lower, upper = np.maximum(machine.limits.lower, -3.0), np.minimum(machine.limits.upper, 3.0)
    return rng.uniform(lower, upper, (count, J)), rng.normal(size=(count, J)), 3 * rng.normal(size=(count, J))


class Reference:
    """Torque from the whole, unreduced Pinocchio tree: locked joints held, mimic joints by the URDF's own rule."""

    def __init__(self, machine):
        self.machine = machine
        self.model = pin.buildModelFromXML(machine.urdf)
        self.model.gravity.linear = np.array(machine.gravity)
        self.names = list(self.model.names)[1:]
        self.rules = {}
        for j in ET.fromstring(machine.urdf).findall("joint"):
            if (tag := j.find("mimic")) is not None:
                rule = tag.get("joint"), float(tag.get("multiplier", 1)), float(tag.get("offset", 0))
                self.rules[j.get("name")] = rule

    def positions(self, q):
        """Positions of all joints of the tree, from those of the independent ones."""
        given = dict(self.machine.locked) | dict(zip(self.machine.joints, q, strict=True))

        def value(name):
            if name in given:
                return given[name]
            leader, factor, shift = self.rules[name]
            return factor * value(leader) + shift

        return np.array([value(name) for name in self.names])

    def __call__(self, q, v, a, model=None):
        """Torque on the independent joints, (N, J)."""
        model = model or self.model
        data, J = model.createData(), len(self.machine.joints)
        zero = self.positions(np.zeros(J))
        # positions are affine in q: this is dq_full/dq, and its transpose maps torques by virtual work
        G = np.stack([self.positions(e) - zero for e in np.eye(J)], axis=1)
        rows = []
        for x, y, z in zip(q, v, a, strict=True):
            full = pin.integrate(model, pin.neutral(model), self.positions(x))
            rows.append(G.T @ pin.rnea(model, data, full, G @ y, G @ z))
        return np.array(rows)


def whole_regressor(regressor, q, v, a):
    """Regressor of states at times 0, 0.01, ..., shape (N, C, J)."""
    return regressor(np.arange(len(q)) * 0.01, q, v, a)


def along(machine, effects):
    """Regressor along a smooth motion, for what remembers or differentiates: one sample in ten."""
    t = np.arange(500) * 0.01
    q, v, a = random_fourier(machine, 5.0, seed=7)(t)
    return Regressor(machine, effects)(t, q, v, a, extra=commands_of(machine, q))[::10]


def random_values(machine, effects, seed=0):
    """Effect parameters that the URDF says nothing of: positive, different, each worth about one N·m (N)."""
    rng = np.random.default_rng(seed)
    columns = [c for effect in effects for c in effect.columns(machine)]
    Y = along(machine, effects)[:, len(machine.columns) :]
    size = np.maximum(np.abs(Y).max(axis=2).mean(axis=0), 1e-3)  # some effects hardly act on this motion
    return {c.name: float(x / s) for c, x, s in zip(columns, rng.uniform(0.5, 1.5, len(columns)), size, strict=True)}


def exact_log(machine, effects, values=None, seconds=10.0, rate=100.0, seed=1, **options):
    """A noise-free log with v and a, or as `options` for `simulate` say."""
    motion = random_fourier(machine, seconds, seed=seed)
    return simulate(machine, motion, rate=rate, effects=effects, parameters=values, **options)


def true_base(found, values=None):
    """True base parameters of a simulated robot."""
    model = found.model
    return found.reduction.mapping @ parameters_of(model.robot, model.effects, values)


def misfit(found, truth):
    """Largest torque that one wrong parameter causes, as a share of the torque: free of units."""
    model = found.model
    Y = along(model.robot, model.effects)[:, list(model.base)]
    size = np.sqrt((Y**2).mean(axis=(0, 2)))
    torque = np.sqrt((np.einsum("ncj,c->nj", Y, truth) ** 2).mean())
    return float((np.abs(model.estimate.theta - truth) * size / torque).max())


def quick(machine, logs, **options):
    """Identify without filter and recursion."""
    return identify(machine, logs, **{"cutoff": None, "recursion": "none", **options})


@cache
def serial_arms():
    """Robots of example-robot-data that are one chain of 2 to 8 joints, one name a URDF."""
    arms = {}
    for name, path in robot_names().items():
        try:
            model = pin.buildModelFromUrdf(str(path))
        except (ValueError, RuntimeError):
            continue
        parents = list(model.parents)[1:]
        if 2 <= len(parents) <= 8 and all(b == a + 1 for a, b in pairwise(parents)) and model.nv == len(parents):
            arms.setdefault(path, name)
    return tuple(sorted(arms.values()))
