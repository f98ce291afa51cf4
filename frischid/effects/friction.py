"""Friction and constant torque at a joint, the terms every robot needs.

    τ_f,j = fv_j q̇_j + fc_j tanh((q̇_j + T q̈_j) / w) + off_j

The sign of the speed is smoothed over ±w, because at standstill the measured speed is noise and its sign is random.

T is the lead. If friction stops a joint before the joint reverses, the torque begins to change before the speed does.
MuJoCo's ``frictionloss`` is a constraint. The constraint aims at ``q̈ = −q̇/T`` with T = timeconst · dmax / 2 (of
``solreffriction`` and ``solimpfriction``; 9.5 ms by default), and its torque is at most fc. With d the impedance of the
constraint and I the inertia of the joint, this friction is ``fc sat((q̇ + T q̈)/w)``, ``w = fc T (1 − d)/(I d)``.

Sources: Armstrong-Hélouvry, Dupont and Canudas de Wit 1994, Automatica 30(7); Todorov 2014, ICRA, "Convex and
analytically-invertible dynamics with contacts and constraints".
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import ClassVar

import numpy as np

from frischid.core.types import Array
from frischid.effects.base import Effect
from frischid.effects.state import SIGN_WIDTH, State, Term
from frischid.effects.units import SPEED_UNITS, TIME_UNITS, is_number
from frischid.errors import InputError
from frischid.robot.robot import Robot


@dataclass(frozen=True)
class Viscous(Effect):
    """Friction proportional to speed, ``fv q̇``."""

    id = "viscous"
    title = "viscous friction"
    equation = "fv·v"
    sentence = "{joint} needs torque in proportion to its speed: viscous friction"
    looks_like = "the residual drawn against speed is a straight line through zero"
    confused_with = ("coulomb", "quadratic_viscous", "time_delay")
    confirmed_by = "move the joint at several constant speeds, in both directions"
    reference = "Armstrong-Hélouvry, Dupont and Canudas de Wit 1994, Automatica 30(7)"

    friction = True
    code: ClassVar = {"fv": "{v}"}

    def terms(self, state: State) -> list[Term]:
        """One column per joint: its speed."""
        return self.per_joint(state, "fv", "velocity", lambda i: state.v[:, i], sign=1)

    def nominal(self, robot: Robot) -> list[float]:
        """``<dynamics damping>`` of the URDF."""
        return [robot.dynamics[name][0] for _, name, _ in self.acts_on(robot)]


@dataclass(frozen=True)
class Coulomb(Effect):
    """Dry friction of constant size against the motion, ``fc tanh((q̇ + lead q̈) / width)``.

    Attributes
    ----------
    width : float
        Speed over which the sign is smoothed, rad/s (m/s).
    lead : float
        Time by which friction changes its direction ahead of the motion, s.
    """

    id = "coulomb"
    title = "Coulomb (dry) friction"
    equation = "fc·tanh((v + lead·a)/width)"
    sentence = "{joint} needs a constant torque against its motion, whatever the speed: Coulomb friction"
    looks_like = "the residual drawn against speed has a step at zero"
    confused_with = ("viscous", "load_friction", "hysteresis")
    confirmed_by = "move the joint slowly in both directions: the torque jumps by 2·fc at each reversal"
    reference = "Armstrong-Hélouvry, Dupont and Canudas de Wit 1994, Automatica 30(7)"

    friction = True
    code: ClassVar = {"fc": "tanh(({v} + {lead} * {a}) / {width})"}
    dry = True
    smooths_sign = True
    units: ClassVar = {"width": SPEED_UNITS, "lead": TIME_UNITS}

    width: float = SIGN_WIDTH
    lead: float = 0.0

    def __post_init__(self) -> None:
        self.require_positive(width="speed in rad/s (m/s)")
        if not is_number(self.lead) or self.lead < 0:
            raise InputError(f"coulomb: lead must be a time in s, zero or more, got {self.lead}")

    def terms(self, state: State) -> list[Term]:
        """One column per joint: the smoothed sign of its speed."""
        return self.per_joint(state, "fc", "", partial(self.sign, state), sign=1)

    def sign(self, state: State, joint: int) -> Array:
        """Direction of dry friction of one joint, -1 to 1, (N,)."""
        return self.sign_at(state, joint, self.lead)

    def sign_at(self, state: State, joint: int, lead: float) -> Array:
        """The same with another lead, s, which may be negative."""
        ahead = lead * state.a[:, joint] if lead else 0.0
        return np.asarray(np.tanh((state.v[:, joint] + ahead) / self.width))

    def nominal(self, robot: Robot) -> list[float]:
        """``<dynamics friction>`` of the URDF."""
        return [robot.dynamics[name][1] for _, name, _ in self.acts_on(robot)]


@dataclass(frozen=True)
class Offset(Effect):
    """Constant torque: the zero error of a sensor or current loop, or friction that differs between directions."""

    id = "offset"
    title = "torque offset"
    equation = "off"
    sentence = (
        "the torque of {joint} has a constant error: an offset of the sensor or amplifier, or dry friction that "
        "differs between the two directions"
    )
    looks_like = "the whole residual lies above zero or below zero"
    confused_with = ("asymmetric_coulomb", "joint_spring")
    confirmed_by = "hold the robot still in several poses: the offset is the same in every pose"
    reference = "Swevers, Verdonck and De Schutter 2007, IEEE Control Systems 27(5)"

    code: ClassVar = {"off": "1.0"}

    def terms(self, state: State) -> list[Term]:
        """One column per joint: one."""
        return self.per_joint(state, "off", "", lambda i: np.ones(len(state.t)))
