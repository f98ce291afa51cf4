"""Torque that depends on a joint's own position: springs and counterbalances.

    ks q_j;   bq q_j + bqq q_j² + bqqq q_j³;   bs sin q_j + bc cos q_j + bss sin 2q_j + bcc cos 2q_j

A spring or hose that grows stiffer as it is stretched is a cubic. A spring between a link and its base pulls along a
line whose lever arm changes with the angle; over a turn that is a periodic function, and two harmonics describe it well
whatever the geometry. Where the geometry is known, a cylinder with its lever is exact: of the lengths ρ (between the
axis and the rod's end, as a share of that to the cylinder's end) and ℓ = √(1 + ρ² − 2ρ cos(q − rest)),

    τ_j = cp sin(q_j − rest)/ℓ + cs sin(q_j − rest).

Constant parts are an offset.

Source: Arakelian 2016, "Gravity compensation in robotics", Advanced Robotics 30(2).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Literal, Self

import numpy as np

from frischid.core.types import Array
from frischid.effects.base import Effect
from frischid.effects.state import State, Term
from frischid.effects.units import ANGLE_UNITS, is_number, torque_unit
from frischid.errors import InputError, UnknownNameError
from frischid.robot.robot import Robot

SPRING_FORMS = ("linear", "cubic", "periodic")


@dataclass(frozen=True)
class JointSpring(Effect):
    """A spring or counterbalance on the joint: linear in its angle, or a smooth function of it.

    Attributes
    ----------
    form : {"linear", "cubic", "periodic"}
        ``"linear"``: ``ks q``, where it rests is in the torque offset: ``ks (q − q₀) = ks q + off``. ``"periodic"``:
        two harmonics of the angle of a turning joint.
    """

    id: ClassVar[str] = "joint_spring"
    title: ClassVar[str] = "spring or counterbalance on a joint"
    equation: ClassVar[str] = (
        "ks·q (it rests at −off/ks); cubic: bq·q + bqq·q² + bqqq·q³; "
        "periodic: bs·sin q + bc·cos q + bss·sin 2q + bcc·cos 2q"
    )
    sentence: ClassVar[str] = (
        "{joint} is pulled by a torque that depends on its angle alone, at any speed: a spring or a counterbalance"
    )
    looks_like: ClassVar[str] = "a line or a smooth curve when the residual is drawn against the joint's angle"
    confused_with: ClassVar[tuple[str, ...]] = ("cable_hose", "payload", "gravity_tilt", "cogging", "offset")
    confirmed_by: ClassVar[str] = "hold still all over the joint's range, with the other joints in different poses"
    reference: ClassVar[str] = "Arakelian 2016, Advanced Robotics 30(2)"

    code: ClassVar[Mapping[str, str]] = {
        "ks": "{q}",
        "bs": "sin({q})",
        "bc": "cos({q})",
        "bss": "sin(2 * {q})",
        "bcc": "cos(2 * {q})",
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
        """Every joint, in every form it can have."""
        slides = dict(zip(robot.joints, robot.prismatic, strict=True))
        return [
            [cls(joints=(name,), form=form) for form in SPRING_FORMS if not (slides[name] and form == "periodic")]
            for name in robot.joints
        ]

    def terms(self, state: State) -> list[Term]:
        """One column a joint, its position; or three, or four.

        Raises
        ------
        InputError
            A joint slides, and cannot have a periodic spring.
        """
        if self.form == "linear":
            return self.per_joint(state, "ks", "position", lambda i: state.q[:, i])
        found = []
        for i, name, number in self.acts_on(state.robot):
            if state.robot.prismatic[i] and self.form == "periodic":
                raise InputError(f"joint_spring: {name} slides, so its spring cannot be periodic; choose form=cubic")
            for symbol, per, values in _curves(state.q[:, i], self.form):
                found.append(Term(self.column(symbol, torque_unit(state.robot, i, per), name, number), {i: values}))
        return found


def _curves(q: Array, form: str) -> list[tuple[str, str, Array]]:
    """Symbol, what it is made of, and values of each column."""
    if form == "cubic":
        return [("bq", "position", q), ("bqq", "position^2", q**2), ("bqqq", "position^3", q**3)]
    harmonics = {"bs": np.sin(q), "bc": np.cos(q), "bss": np.sin(2 * q), "bcc": np.cos(2 * q)}
    return [(symbol, "", values) for symbol, values in harmonics.items()]


@dataclass(frozen=True)
class Counterbalance(Effect):
    """A gas or hydraulic cylinder with a lever of known geometry, on a turning joint.

    Attributes
    ----------
    ratio : float
        Distance of the rod's end from the axis, over the cylinder's end's.
    rest : float
        Angle at which both ends and the axis are in line, rad.
    """

    id: ClassVar[str] = "counterbalance"
    title: ClassVar[str] = "counterbalance of known geometry: a gas or hydraulic cylinder"
    equation: ClassVar[str] = "cp·sin(q − rest)/ℓ + cs·sin(q − rest),  ℓ = √(1 + ratio² − 2·ratio·cos(q − rest))"
    sentence: ClassVar[str] = "{joint} is helped by a cylinder on a lever: a constant force and a spring's"
    looks_like: ClassVar[str] = "a lopsided arch when the residual is drawn against the joint's angle, at any speed"
    confused_with: ClassVar[tuple[str, ...]] = ("joint_spring", "payload", "gravity_tilt")
    confirmed_by: ClassVar[str] = "hold still all over the joint's range, with the links after it folded and stretched"
    reference: ClassVar[str] = "Arakelian 2016, Advanced Robotics 30(2)"

    candidate: ClassVar[Literal["joint", "robot", "never"]] = "never"  # joint_spring's periodic form finds it

    units: ClassVar[Mapping[str, tuple[str, str]]] = {"rest": ANGLE_UNITS}

    ratio: float = 0.3
    rest: float = 0.0

    def __post_init__(self) -> None:
        self.require_positive(ratio="ratio of two distances")
        if not is_number(self.rest):
            raise InputError(f"counterbalance: rest must be an angle in rad, got {self.rest}")

    def terms(self, state: State) -> list[Term]:
        """Two columns a joint: the constant force's lever arm, and the spring's."""
        columns = []
        for i, name, number in self.acts_on(state.robot):
            if state.robot.prismatic[i]:
                continue
            lever = np.sin(state.q[:, i] - self.rest)
            length = np.sqrt(np.maximum(1 + self.ratio**2 - 2 * self.ratio * np.cos(state.q[:, i] - self.rest), 1e-9))
            for symbol, values in (("cp", lever / length), ("cs", lever)):
                columns.append(Term(self.column(symbol, torque_unit(state.robot, i), name, number), {i: values}))
        return columns
