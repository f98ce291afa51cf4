"""Torque that depends on a joint's own position: springs and counterbalances.

    τ_j = ks_j q_j,   or   τ_j = bs sin q_j + bc cos q_j + bss sin 2q_j + bcc cos 2q_j

A gas spring or hydraulic cylinder between a link and its base pulls along a line whose lever arm changes with the
angle; over a turn that is a periodic function, and two harmonics describe it well. Its constant part is an offset.

Source: Arakelian 2016, "Gravity compensation in robotics", Advanced Robotics 30(2).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from frischid.effects.base import Array, Effect, State, Term, torque_unit


@dataclass(frozen=True)
class JointSpring(Effect):
    """A spring on the joint, ``ks q``; where it rests is in the torque offset: ``ks (q − q₀) = ks q + off``."""

    id: ClassVar[str] = "joint_spring"
    title: ClassVar[str] = "spring on a joint"
    equation: ClassVar[str] = "ks·q  (its rest angle is −off/ks)"
    sentence: ClassVar[str] = "{joint} is pulled towards one angle, the more the further away it is: a spring"
    looks_like: ClassVar[str] = "a straight line when the residual is drawn against the joint's angle"
    confused_with: ClassVar[tuple[str, ...]] = ("counterbalance", "cable_hose", "payload", "offset")
    confirmed_by: ClassVar[str] = "hold still all over the joint's range, with the other joints in different poses"
    reference: ClassVar[str] = "Wang, Gondokaryono, Munawar and Fischer 2019, IEEE Robotics and Automation Letters 4(4)"

    def terms(self, state: State) -> list[Term]:
        """One column a joint: its position."""
        return self.per_joint(state, "ks", "position", lambda i: state.q[:, i])


@dataclass(frozen=True)
class Counterbalance(Effect):
    """A counterbalance: a smooth function of the angle, two harmonics of it (of a sliding joint, a cubic)."""

    id: ClassVar[str] = "counterbalance"
    title: ClassVar[str] = "counterbalance: spring, gas or hydraulic cylinder"
    equation: ClassVar[str] = "bs·sin q + bc·cos q + bss·sin 2q + bcc·cos 2q  (sliding: bq·q + bqq·q² + bqqq·q³)"
    sentence: ClassVar[str] = (
        "{joint} is helped by a torque that depends on its angle alone: a counterbalance such as a spring or a "
        "hydraulic cylinder"
    )
    looks_like: ClassVar[str] = "a smooth curve when the residual is drawn against the joint's angle, at any speed"
    confused_with: ClassVar[tuple[str, ...]] = ("joint_spring", "payload", "cable_hose", "cogging", "gravity_tilt")
    confirmed_by: ClassVar[str] = "hold still all over the joint's range, with the links after it folded and stretched"
    reference: ClassVar[str] = "Arakelian 2016, Advanced Robotics 30(2)"
    generalises: ClassVar[tuple[str, ...]] = ("joint_spring",)

    def terms(self, state: State) -> list[Term]:
        """Four columns for a turning joint, three for a sliding one."""
        return [
            Term(self.column(symbol, torque_unit(state.robot, i, per), name, number), {i: values})
            for i, name, number in self.acts_on(state.robot)
            for symbol, per, values in _shapes(state.q[:, i], bool(state.robot.prismatic[i]))
        ]


def _shapes(q: Array, slides: bool) -> list[tuple[str, str, Array]]:
    """Symbol, what it is made of, and values of each column."""
    if slides:
        return [("bq", "position", q), ("bqq", "position^2", q**2), ("bqqq", "position^3", q**3)]
    harmonics = {"bs": np.sin(q), "bc": np.cos(q), "bss": np.sin(2 * q), "bcc": np.cos(2 * q)}
    return [(symbol, "", values) for symbol, values in harmonics.items()]
