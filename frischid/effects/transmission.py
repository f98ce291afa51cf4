"""Torques of the drive train: rotor inertia, torque ripple, and one motor that turns with two joints.

A rotor of inertia I_m behind a gear of ratio k turns k times as fast as its joint. Seen from the joint, its inertia is
``Ia = k² I_m``, often more than the inertia of the link itself. The full form adds the torque of the spinning rotor on
the link that carries the motor (see `frischid.robot.rotors`).

The torque of a motor ripples with the position of its magnets and of the gear's teeth, ``A sin(N q) + B cos(N q)``.

In a wrist, one motor may turn with the sum of two joints, ``s = q_i + r q_j``. Its friction and inertia load both
joints,

    τ_i = f(ṡ, s̈),   τ_j = r f(ṡ, s̈),   f = fvm ṡ + fcm tanh(ṡ/w) + Iam s̈.

Sources: Sciavicco, Siciliano and Villani 1996, Robotica 14(4); Holtz and Springob 1996, IEEE Trans. Industrial
Electronics 43(2); Janot, Vandanjon and Gautier 2014, IEEE Trans. Control Systems Technology 22(1).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import ClassVar, Self

import numpy as np

from frischid.effects.base import Effect
from frischid.effects.state import SIGN_WIDTH, State, Term
from frischid.effects.units import SPEED_UNITS, is_number, torque_unit
from frischid.errors import InputError
from frischid.robot.robot import Robot
from frischid.robot.rotors import rotor_coupling


@dataclass(frozen=True)
class RotorInertia(Effect):
    """Reflected inertia of the motor's rotor.

    Attributes
    ----------
    coupled : bool
        False: ``Ia q̈`` on the joint's own row, with ``Ia`` on the joint's side of the gear. True: the full form of a
        motor that the previous link carries. Its parameter ``Im`` is on the motor's side, and it couples neighbouring
        rows.
    ratio : float
        Gear ratio (motor turns per joint turn); used by the full form only.
    """

    id = "rotor_inertia"
    title = "reflected rotor inertia"
    equation = "Ia·a  (coupled: Im·(ratio²·a + ratio·z·ω̇) and its reaction on the rows before)"
    symbols: ClassVar = {
        "Im": "identified coefficient: the rotor's inertia on the motor's side",
        "ω̇": "angular acceleration of the link that carries the motor",
        "z": "axis of the motor",
    }
    sentence = (
        "{joint} needs torque in proportion to its acceleration, in addition to the torque for its links: rotor inertia"
    )
    looks_like = "the residual drawn against acceleration is a straight line through zero"
    confused_with = ("payload", "elasticity", "time_delay")
    confirmed_by = (
        "record fast oscillations of this joint alone, in poses with different inertia of the links about this joint"
    )
    reference = "Sciavicco, Siciliano and Villani 1996, Robotica 14(4); Featherstone 2008, sec. 9.6"

    code: ClassVar = {"Ia": "{a}"}

    coupled: bool = False
    ratio: float = 1.0

    def __post_init__(self) -> None:
        if not is_number(self.ratio) or self.ratio == 0:
            raise InputError(f"rotor_inertia: ratio must be a finite number other than zero, got {self.ratio}")

    def terms(self, state: State) -> list[Term]:
        """One column per joint: its acceleration, or the coupled form in all rows."""
        return [self._term(state, *joint) for joint in self.acts_on(state.robot)]

    def nominal(self, robot: Robot) -> list[float]:
        """``armature`` of an MJCF file; zero for a URDF."""
        return [0.0 if self.coupled else robot.armature[name] for _, name, _ in self.acts_on(robot)]

    def _term(self, state: State, i: int, name: str, number: str) -> Term:
        unit = torque_unit(state.robot, i, "acceleration")
        if not self.coupled:
            return Term(self.column("Ia", unit, name, number, sign=1), {i: state.a[:, i]})
        torque = rotor_coupling(state.robot, state.q, state.v, state.a, name, self.ratio)
        rows = {j: torque[:, j] for j in range(torque.shape[1])}
        return Term(self.column("Im", unit, name, number, sign=1), rows)


@dataclass(frozen=True)
class Cogging(Effect):
    """Torque ripple with the joint's position, ``A sin(order q) + B cos(order q)``.

    Attributes
    ----------
    order : float
        Ripples per turn of the joint (rad/m for a sliding joint).
    """

    id = "cogging"
    title = "cogging and gear ripple"
    equation = "A·sin(N·q) + B·cos(N·q)"
    symbols: ClassVar = {
        "N": "ripples per turn, the shape parameter order",
    }
    sentence = (
        "the torque of {joint} ripples with the angle, because of the motor's magnets (cogging) or the gear's teeth"
    )
    looks_like = "the residual drawn against angle is a regular wave, the same in both directions"
    confused_with = ("joint_spring", "payload")
    confirmed_by = "record one slow turn at constant speed, with many samples per ripple"
    reference = "Holtz and Springob 1996, IEEE Trans. Industrial Electronics 43(2)"

    code: ClassVar = {"A": "sin({order} * {q})", "B": "cos({order} * {q})"}
    shapes: ClassVar = {
        "order": tuple(map(float, [*range(3, 64), *range(64, 202, 2)])),
    }
    units: ClassVar = {"order": ("per turn", "rad/m")}

    order: float = 12.0

    def __post_init__(self) -> None:
        self.require_positive(order="number of ripples per turn")

    def shows_within(self, reach: Mapping[str, float]) -> bool:
        """Whether each joint passes two ripples: a wave that does not repeat is no ripple but a torque of a spring."""
        return all(self.order * reach[name] >= 2 * 2 * np.pi for name in self.joints or reach)

    def terms(self, state: State) -> list[Term]:
        """Two columns per joint: sine and cosine."""
        return [
            *self.per_joint(state, "A", "", lambda i: np.sin(self.order * state.q[:, i])),
            *self.per_joint(state, "B", "", lambda i: np.cos(self.order * state.q[:, i])),
        ]


@dataclass(frozen=True)
class JointCoupling(Effect):
    """A motor that turns with two joints at once, ``s = q_i + ratio q_j``: its friction and inertia load both joints.

    The effect acts on pairs of joints. With two joints named, these are the pair, in the order in which they are named.
    With more joints named, or none, every two of them that follow one another in the robot are a pair (turning joints
    with turning, sliding with sliding ones). A turning and a sliding joint are a pair only where they are named, since
    their ratio is that of a screw.

    Two motors may turn with the same two joints, as in a differential: one with their sum, one with their difference.
    Where the ratio is negative, the parameters' names have an ``m`` (minus) before the second joint's number.

    Attributes
    ----------
    ratio : float
        Motion of the motor per motion of the second joint, over the motion of the motor per motion of the first: 1 in a
        wrist whose motor turns with the sum of both, −1 in a wrist whose motor turns with their difference. Gears of
        other sizes have other ratios. Of a turning and a sliding joint, as on the splined screw of a SCARA, it is in
        rad/m: ±2π/lead of the screw.
    """

    id = "joint_coupling"
    title = "coupled joints: one motor turns with two"
    equation = "f = fvm·ṡ + fcm·tanh(ṡ/width) + Iam·s̈ on joint i, ratio·f on joint j,  s = q_i + ratio·q_j"
    symbols: ClassVar = {
        "f": "torque of the shared motor",
        "fvm": "identified coefficient: viscous friction",
        "fcm": "identified coefficient: dry friction",
        "Iam": "identified coefficient: rotor inertia",
        "s": "motion of the motor",
        "width": "speed over which the sign is smoothed, rad/s (m/s)",
    }
    sentence = (
        "the torques of {joints} depend on the motion of both joints: one motor turns with both, as in many wrists, "
        "and its friction and inertia load both"
    )
    looks_like = "each of two joints needs torque when only the other moves"
    confused_with = ("coulomb", "viscous", "rotor_inertia")
    confirmed_by = (
        "hold the first joint and move the second: the torque of the first joint follows the motion of the second"
    )
    reference = "Janot, Vandanjon and Gautier 2014, IEEE Trans. Control Systems Technology 22(1)"

    several = True
    dry = True
    smooths_sign = True
    shapes: ClassVar = {"ratio": (-8.0, -4.0, -2.0, -1.0, -0.5, -0.25, -0.125, 0.125, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0)}
    units: ClassVar = {"width": SPEED_UNITS}

    ratio: float = 1.0
    width: float = SIGN_WIDTH

    def __post_init__(self) -> None:
        if not is_number(self.ratio) or self.ratio == 0:
            raise InputError(f"joint_coupling: ratio must be a finite number other than zero, got {self.ratio}")
        if self.joints is not None and len(set(self.joints)) < 2:
            raise InputError(
                f"joint_coupling: name the two joints that the motor couples, got {' '.join(self.joints) or 'none'}"
            )
        self.require_positive(width="speed in rad/s (m/s)")

    @classmethod
    def candidates(cls, robot: Robot) -> list[list[Self]]:
        """Every two joints that follow one another, with each ratio."""
        return [cls.variants(pair) for pair in _neighbours(robot)]

    @property
    def searched(self) -> Mapping[str, tuple[float, ...]]:
        """The ratio; but 1 and −1, which most wrists have, count as no search."""
        return {} if abs(self.ratio) == 1 else self.shapes

    def pairs(self, robot: Robot) -> list[tuple[str, str]]:
        """Names of the coupled joints, pair by pair."""
        names = [name for _, name, _ in self.acts_on(robot)]
        if self.joints is None or len(names) > 2:
            return [pair for pair in _neighbours(robot) if set(pair) <= set(names)]
        names = list(self.joints)  # in the user's order, which the ratio refers to
        return [(names[0], names[1])]

    def number(self, robot: Robot, first: str, second: str) -> str:
        """What follows the symbols in the names of a pair's parameters: 1_2, or 1_m2 where the ratio is negative."""
        return f"{robot.numbers[first]}_{'m' if self.ratio < 0 else ''}{robot.numbers[second]}"

    def terms(self, state: State) -> list[Term]:
        """Three columns per pair: the motor's speed, the smoothed sign of that speed, and the motor's acceleration."""
        return [term for pair in self.pairs(state.robot) for term in self._of_pair(state, *pair)]

    def _of_pair(self, state: State, first: str, second: str) -> list[Term]:
        robot = state.robot
        i, j = robot.joints.index(first), robot.joints.index(second)
        speed, acceleration = (x[:, i] + self.ratio * x[:, j] for x in (state.v, state.a))
        columns = {
            ("fvm", "velocity"): speed,
            ("fcm", ""): np.tanh(speed / self.width),
            ("Iam", "acceleration"): acceleration,
        }
        number = self.number(robot, first, second)
        return [
            Term(self.column(symbol, torque_unit(robot, i, per), second, number, sign=1), {i: f, j: self.ratio * f})
            for (symbol, per), f in columns.items()
        ]


def _neighbours(robot: Robot) -> list[tuple[str, str]]:
    """Every two joints that follow one another and both turn or both slide."""
    kinds = ([n for n, slides in zip(robot.joints, robot.prismatic, strict=True) if slides == k] for k in (False, True))
    return [pair for names in kinds for pair in pairwise(names)]
