"""Torque that depends on a joint's own position: springs and counterbalances.

    ks q_j;   bq q_j + bqq q_j² + bqqq q_j³;   Σ_h bs_h sin(h q_j) + bc_h cos(h q_j),   h = 1 … 2 or 1 … 4

The cubic form describes a spring or hose that becomes stiffer as it stretches. The lever arm of a spring between a link
and its base changes with the angle. Over a turn the torque of such a spring is periodic, and two harmonics describe it
well where its ends stay far apart. A cylinder whose ends come near to each other has a narrow peak of torque, which
needs four. Where the geometry of a cylinder on a lever is known, its torque is exact,

    τ_j = cp sin(q_j − rest)/ℓ + cs sin(q_j − rest),    ℓ = √(1 + ρ² − 2ρ cos(q_j − rest)),

with ρ the distance of the rod's end from the axis over the distance of the cylinder's end from the axis. All constant
torques are in the torque offset.

Source: Arakelian 2016, "Gravity compensation in robotics", Advanced Robotics 30(2).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from frischid.core.types import Array
from frischid.effects.base import Effect
from frischid.effects.state import State, Term
from frischid.effects.units import ANGLE_UNITS, is_number, torque_unit
from frischid.errors import InputError, UnknownNameError
from frischid.robot.robot import Robot

DIAGNOSED_FORMS = ("linear", "cubic", "periodic")
"""Forms that a diagnosis tries. The eight coefficients of a curve also follow a ripple that the motion passes twice:
with this form, a spring was as probable as the ripple that acts (`tests/diagnosis/test_situation.py`)."""
SPRING_FORMS = (*DIAGNOSED_FORMS, "curve")
SPRING_HARMONICS = {"periodic": 2, "curve": 4}
"""Harmonics of the angle in the forms of a turning joint."""


@dataclass(frozen=True)
class JointSpring(Effect):
    """A spring or counterbalance on the joint: linear in its angle, or a smooth function of it.

    Attributes
    ----------
    form : {"linear", "cubic", "periodic", "curve"}
        ``"linear"``: ``ks q``; the torque offset holds the angle q₀ without torque: ``ks (q − q₀) = ks q + off``.
        ``"cubic"``: up to the third power of the angle. ``"periodic"``: two harmonics of the angle of a turning joint.
        ``"curve"``: four harmonics.
    """

    id = "joint_spring"
    title = "spring or counterbalance on a joint"
    equation = (
        "ks·q (no torque at q = −off/ks); cubic: bq·q + bqq·q² + bqqq·q³; "
        "periodic: bs·sin q + bc·cos q + bss·sin 2q + bcc·cos 2q; "
        "curve: periodic + bsss·sin 3q + bccc·cos 3q + bssss·sin 4q + bcccc·cos 4q"
    )
    symbols: ClassVar = {
        "off": "offset of the joint, an effect of its own",
    }
    sentence = "a torque acts on {joint} that depends on the angle of the joint alone: a spring or a counterbalance"
    looks_like = "the residual drawn against the joint's angle is a line or a smooth curve"
    confused_with = ("cable_hose", "payload", "gravity_tilt", "cogging", "offset")
    confirmed_by = "hold the joint still at several angles over its range, with the other joints in different poses"
    reference = "Arakelian 2016, Advanced Robotics 30(2)"

    after_change = ("offset_change",)
    code: ClassVar = {
        "ks": "{q}",
        "bs": "sin({q})",
        "bc": "cos({q})",
        "bss": "sin(2 * {q})",
        "bcc": "cos(2 * {q})",
        "bsss": "sin(3 * {q})",
        "bccc": "cos(3 * {q})",
        "bssss": "sin(4 * {q})",
        "bcccc": "cos(4 * {q})",
        "bq": "{q}",
        "bqq": "{q} * {q}",
        "bqqq": "{q} * {q} * {q}",
    }

    form: str = "linear"

    def __post_init__(self) -> None:
        if self.form not in SPRING_FORMS:
            raise UnknownNameError("form", str(self.form), SPRING_FORMS, "joint_spring")

    @classmethod
    def candidates(cls, robot: Robot) -> list[list[Self]]:
        """Every joint, in the forms that a diagnosis tries and the joint can have."""
        slides = dict(zip(robot.joints, robot.prismatic, strict=True))
        return [
            [
                cls(joints=(name,), form=form)
                for form in DIAGNOSED_FORMS
                if not (slides[name] and form in SPRING_HARMONICS)
            ]
            for name in robot.joints
        ]

    def usual(self, robot: Robot) -> list[float]:
        """Shares 1/h² of the h-th harmonics: each adds the same curvature, so the torque varies smoothly."""
        if self.form not in SPRING_HARMONICS:
            return super().usual(robot)
        return [1.0 / h**2 for _ in self.acts_on(robot) for h in _orders(self.form) for _ in range(2)]

    def terms(self, state: State) -> list[Term]:
        """Columns per joint: one if linear (the position), three if cubic, four if periodic, eight if a curve.

        Raises
        ------
        InputError
            The form has harmonics and a joint slides.
        """
        if self.form == "linear":
            return self.per_joint(state, "ks", "position", lambda i: state.q[:, i])
        found = []
        for i, name, number in self.acts_on(state.robot):
            if state.robot.prismatic[i] and self.form in SPRING_HARMONICS:
                raise InputError(
                    f"joint_spring: {name} slides, so its spring cannot be of form {self.form}; choose form=cubic"
                )
            for symbol, per, values in _curves(state.q[:, i], self.form):
                found.append(Term(self.column(symbol, torque_unit(state.robot, i, per), name, number), {i: values}))
        return found


def _curves(q: Array, form: str) -> list[tuple[str, str, Array]]:
    """Symbol, quantity and values of each column."""
    if form == "cubic":
        return [("bq", "position", q), ("bqq", "position^2", q**2), ("bqqq", "position^3", q**3)]
    waves = (("s", np.sin), ("c", np.cos))
    return [("b" + letter * h, "", wave(h * q)) for h in _orders(form) for letter, wave in waves]


def _orders(form: str) -> range:
    return range(1, SPRING_HARMONICS[form] + 1)


@dataclass(frozen=True)
class Counterbalance(Effect):
    """A gas or hydraulic cylinder with a lever of known geometry, on a turning joint.

    Attributes
    ----------
    ratio : float
        Distance of the rod's end from the axis, over the distance of the cylinder's end from the axis.
    rest : float
        Angle at which both ends and the axis lie on one line, rad.
    """

    id = "counterbalance"
    title = "counterbalance of known geometry: a gas or hydraulic cylinder"
    equation = "cp·sin(q − rest)/ℓ + cs·sin(q − rest),  ℓ = √(1 + ratio² − 2·ratio·cos(q − rest))"
    symbols: ClassVar = {
        "ℓ": "length of the cylinder over the distance of its end from the axis",
    }
    sentence = (
        "a cylinder on a lever carries part of the weight at {joint}, with a constant force and the force of a spring"
    )
    looks_like = (
        "the residual drawn against the joint's angle is an arch that is not symmetric, the same at every speed"
    )
    confused_with = ("joint_spring", "payload", "gravity_tilt")
    confirmed_by = (
        "hold the joint still at several angles over its range, with the links after it folded, then stretched"
    )
    reference = "Arakelian 2016, Advanced Robotics 30(2)"

    code: ClassVar = {
        "cp": "sin({q} - {rest}) / sqrt(max(1.0 + {ratio} * {ratio} - 2.0 * {ratio} * cos({q} - {rest}), 1e-9))",
        "cs": "sin({q} - {rest})",
    }
    candidate = "never"  # joint_spring's periodic form finds it
    units: ClassVar = {"rest": ANGLE_UNITS}

    ratio: float = 0.3
    rest: float = 0.0

    def __post_init__(self) -> None:
        self.require_positive(ratio="ratio of two distances")
        if not is_number(self.rest):
            raise InputError(f"counterbalance: rest must be an angle in rad, got {self.rest}")

    def terms(self, state: State) -> list[Term]:
        """Two columns per joint: the lever arm of the constant force, and the lever arm of the spring."""
        columns = []
        for i, name, number in self.acts_on(state.robot):
            if state.robot.prismatic[i]:
                continue
            lever = np.sin(state.q[:, i] - self.rest)
            length = np.sqrt(np.maximum(1 + self.ratio**2 - 2 * self.ratio * np.cos(state.q[:, i] - self.rest), 1e-9))
            for symbol, values in (("cp", lever / length), ("cs", lever)):
                columns.append(Term(self.column(symbol, torque_unit(state.robot, i), name, number), {i: values}))
        return columns
