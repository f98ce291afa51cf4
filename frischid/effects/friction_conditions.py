"""Friction that depends on more than the speed: on the load of the gear, or on the position of the joint.

    τ_f,j = |τ_rigid,j| tanh(q̇_j/w) (fl_j + fsl_j exp(−|q̇_j|/v_s)) + fp_j q_j tanh(q̇_j/w)

A linkage between motor and joint has a ratio r(q) = dq_motor/dq. By the principle of virtual work, the motor's dry
friction F acts on the joint as F |r(q)|. Near a position q0 this is F |r(q0)| + F |r|'(q0) (q − q0): a constant, which
is Coulomb friction, and a slope fp over the position.

Sources: Bittencourt, Wernholt, Sander-Tavallaey and Brogårdh 2010, "An extended friction model to capture load and
temperature effects in robot joints", IEEE/RSJ IROS; Armstrong 1988, "Friction: experimental determination, modeling and
compensation", IEEE ICRA, which measured friction of a PUMA 560 over the position.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from frischid.core.types import Array
from frischid.effects.base import Effect
from frischid.effects.state import SIGN_WIDTH, State, Term
from frischid.effects.units import SPEED_UNITS


@dataclass(frozen=True)
class LoadFriction(Effect):
    """Coulomb friction that grows with the load, ``fl |τ_rigid| tanh(q̇/width)``.

    Attributes
    ----------
    width : float
        Speed over which the sign is smoothed, rad/s (m/s).
    """

    id = "load_friction"
    title = "load-dependent friction"
    equation = "fl·|τ_rigid|·tanh(v/width)"
    sentence = "the dry friction of {joint} grows with the load that the gear carries"
    looks_like = "the residual drawn against speed has a step at zero, and the step is larger where the load is high"
    confused_with = ("coulomb", "position_friction", "drive_gain", "hysteresis")
    confirmed_by = "record the same slow reversals with the arm stretched out and folded, or with a payload"
    reference = "Hamon, Gautier and Garrec 2010, IEEE/RSJ IROS"

    friction = True
    after_change = ("friction_change",)
    code: ClassVar = {"fl": "abs({load}) * tanh({v} / {width})"}
    dry = True
    smooths_sign = True
    loaded = True
    units: ClassVar = {"width": SPEED_UNITS}

    width: float = SIGN_WIDTH

    def __post_init__(self) -> None:
        self.require_positive(width="speed in rad/s (m/s)")

    def terms(self, state: State) -> list[Term]:
        """One column per joint: the size of its load times the smoothed sign of its speed."""
        return self.per_joint(
            state, "fl", "torque", lambda i: np.abs(state.load[:, i]) * np.tanh(state.v[:, i] / self.width), sign=1
        )


@dataclass(frozen=True)
class LoadStribeck(Effect):
    """Stribeck friction that grows with the load, ``fsl |τ_rigid| tanh(q̇/width) exp(−|q̇|/speed)``.

    Attributes
    ----------
    speed : float
        Speed at which the extra friction has fallen to 1/e, rad/s (m/s).
    width : float
        Speed over which the sign is smoothed, rad/s (m/s).
    """

    id = "load_stribeck"
    title = "Stribeck friction that grows with the load"
    equation = "fsl·|τ_rigid|·tanh(v/width)·exp(−|v|/speed)"
    sentence = (
        "{joint} needs more torque just after a reversal, and the more so the larger the load: under load the "
        "lubricant film is pressed out and builds up again with speed"
    )
    looks_like = (
        "the residual drawn against speed has a peak on each side of zero, and the peaks are higher where the load is "
        "high"
    )
    confused_with = ("stribeck", "load_friction", "hysteresis")
    confirmed_by = (
        "record slow constant speeds, from 0.01 to 0.5 rad/s, once with the arm folded and once stretched out or with "
        "a payload: the peak at low speed grows with the load"
    )
    reference = "Bittencourt and Gunnarsson 2012, ASME J. Dyn. Systems, Meas. and Control 134(5)"

    friction = True
    after_change = ("friction_change",)
    code: ClassVar = {"fsl": "abs({load}) * tanh({v} / {width}) * exp(-abs({v}) / {speed})"}
    dry = True
    smooths_sign = True
    loaded = True
    shapes: ClassVar = {"speed": (0.03, 0.1, 0.3)}
    units: ClassVar = {"speed": SPEED_UNITS, "width": SPEED_UNITS}

    speed: float = 0.1
    width: float = SIGN_WIDTH

    def __post_init__(self) -> None:
        self.require_positive(speed="speed in rad/s (m/s)", width="speed in rad/s (m/s)")

    def terms(self, state: State) -> list[Term]:
        """One column per joint: the size of its load times the smoothed sign of its speed, fading with the speed."""

        def column(i: int) -> Array:
            v = state.v[:, i]
            fading = np.exp(-np.abs(v) / self.speed)
            return np.asarray(np.abs(state.load[:, i]) * np.tanh(v / self.width) * fading)

        return self.per_joint(state, "fsl", "torque", column, sign=1)


@dataclass(frozen=True)
class PositionFriction(Effect):
    """Dry friction that grows or falls with the position, ``fp (q − middle) tanh(q̇/width)``.

    The middle of the joint's range is that of the URDF; zero without a range. So the Coulomb friction fc is that in the
    middle, where it is positive. At the angle 0, which a knee never reaches, it would be extrapolated.

    Attributes
    ----------
    width : float
        Speed over which the sign is smoothed, rad/s (m/s).
    """

    id = "position_friction"
    title = "friction that depends on the position"
    equation = "fp·(q − middle)·tanh(v/width)"
    sentence = (
        "the dry friction of {joint} changes along the range of the joint: a linkage with a changing ratio, a gear "
        "that is not centred, or a guide that is tighter at one end"
    )
    looks_like = "the residual drawn against speed has a step at zero, and the step grows towards one end of the range"
    confused_with = ("coulomb", "load_friction", "hysteresis", "joint_coupling")
    confirmed_by = (
        "record slow movements to and fro over a few degrees, near both ends of the range: the torque jumps by "
        "different amounts at the reversals"
    )
    reference = "Armstrong 1988, IEEE ICRA"

    friction = True
    after_change = ("friction_change",)
    code: ClassVar = {"fp": "({q} - {middle}) * tanh({v} / {width})"}
    dry = True
    smooths_sign = True
    units: ClassVar = {"width": SPEED_UNITS}

    width: float = SIGN_WIDTH

    def __post_init__(self) -> None:
        self.require_positive(width="speed in rad/s (m/s)")

    def terms(self, state: State) -> list[Term]:
        """One column per joint: its distance from the middle of its range times the smoothed sign of its speed."""
        x = state.q - state.robot.limits.middle
        return self.per_joint(state, "fp", "position", lambda i: x[:, i] * np.tanh(state.v[:, i] / self.width))
