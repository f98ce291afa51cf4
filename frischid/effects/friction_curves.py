"""Friction beyond the viscous line and the Coulomb step: other curves over the speed.

    τ_f,j = fs_j tanh(q̇_j/w) exp(−(|q̇_j|/v_s)^δ) + fvv_j q̇_j|q̇_j| + fvvv_j q̇_j³ + fva_j |q̇_j| + fca_j
    tanh(|q̇_j|/w)

The first term is Stribeck friction: it fades as the speed builds up the lubricant film (Stribeck 1902; the exponential
form is from Bo and Pavelescu). The odd powers bend the viscous line: churning oil bends the line up, shear-thinning
grease bends it down. The last two terms, even in the speed, are friction that differs between the two directions.

Source: Armstrong-Hélouvry, Dupont and Canudas de Wit 1994, Automatica 30(7).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from frischid.effects.base import Effect
from frischid.effects.state import SIGN_WIDTH, State, Term
from frischid.effects.units import SPEED_UNITS


@dataclass(frozen=True)
class Stribeck(Effect):
    """Extra friction near zero speed, ``fs tanh(q̇/width) exp(−(|q̇|/speed)^exponent)``.

    Attributes
    ----------
    speed : float
        Speed at which the extra friction has fallen to 1/e (the Stribeck speed), rad/s (m/s).
    exponent : float
        1: slow decay (Tustin); 2: bell-shaped decay (Gauss).
    width : float
        Speed over which the sign is smoothed, rad/s (m/s).
    """

    id = "stribeck"
    title = "Stribeck friction"
    equation = "fs·tanh(v/width)·exp(−(|v|/speed)^exponent)"
    sentence = (
        "{joint} needs more torque just after a reversal than at higher speed: Stribeck friction, because the "
        "lubricant film builds up with speed"
    )
    looks_like = (
        "the residual drawn against speed has a peak on each side of zero; the peak ends within a tenth of a rad/s"
    )
    confused_with = ("coulomb", "quadratic_viscous", "cubic_viscous", "hysteresis")
    confirmed_by = (
        "record many slow constant speeds, from 0.01 to 0.5 rad/s: with rising speed the torque first falls, then rises"
    )
    reference = "Bo and Pavelescu 1982, Wear 82(3)"

    friction = True
    after_change = ("friction_change",)
    code: ClassVar = {"fs": "tanh({v} / {width}) * exp(-pow(abs({v}) / {speed}, {exponent}))"}
    dry = True
    smooths_sign = True
    shapes: ClassVar = {"speed": (0.02, 0.05, 0.1, 0.2, 0.5), "exponent": (1.0, 2.0)}
    units: ClassVar = {"speed": SPEED_UNITS, "width": SPEED_UNITS}

    speed: float = 0.1
    exponent: float = 2.0
    width: float = SIGN_WIDTH

    def __post_init__(self) -> None:
        self.require_positive(speed="speed in rad/s (m/s)", exponent="number", width="speed in rad/s (m/s)")

    def terms(self, state: State) -> list[Term]:
        """One column per joint: the smoothed sign of its speed, fading with the speed."""

        def column(i: int) -> np.ndarray:
            v = state.v[:, i]
            return np.asarray(np.tanh(v / self.width) * np.exp(-((np.abs(v) / self.speed) ** self.exponent)))

        return self.per_joint(state, "fs", "", column, sign=1)


@dataclass(frozen=True)
class QuadraticViscous(Effect):
    """Friction that grows with the square of the speed, ``fvv q̇|q̇|``."""

    id = "quadratic_viscous"
    title = "quadratic viscous friction"
    equation = "fvv·v·|v|"
    sentence = (
        "the friction of {joint} has a part that is quadratic in the speed: with a positive sign churning lubricant or "
        "air drag, with a negative sign lubricant that gets thinner with speed"
    )
    looks_like = "the residual drawn against speed is an S: at both ends the viscous line becomes steeper (or flatter)"
    confused_with = ("cubic_viscous", "viscous", "stribeck")
    confirmed_by = "record constant speeds up to the joint's limit, in both directions"
    reference = "Simoni, Beschi, Legnani and Visioli 2015, IEEE/RSJ IROS"

    friction = True
    after_change = ("friction_change",)
    code: ClassVar = {"fvv": "{v} * abs({v})"}

    def terms(self, state: State) -> list[Term]:
        """One column per joint: speed times its size."""
        return self.per_joint(state, "fvv", "velocity^2", lambda i: state.v[:, i] * np.abs(state.v[:, i]))


@dataclass(frozen=True)
class CubicViscous(Effect):
    """Friction that grows with the third power of the speed, ``fvvv q̇³``."""

    id = "cubic_viscous"
    title = "cubic viscous friction"
    equation = "fvvv·v³"
    sentence = "the friction of {joint} bends away from a straight line at high speed: cubic viscous friction"
    looks_like = "the residual drawn against speed is flat in the middle and steep at both ends"
    confused_with = ("quadratic_viscous", "viscous", "stribeck")
    confirmed_by = "record constant speeds up to the joint's limit, in both directions"
    reference = "Taghirad and Bélanger 1998, ASME J. Dynamic Systems, Measurement and Control 120(4)"

    friction = True
    after_change = ("friction_change",)
    code: ClassVar = {"fvvv": "{v} * {v} * {v}"}

    def terms(self, state: State) -> list[Term]:
        """One column per joint: the third power of its speed."""
        return self.per_joint(state, "fvvv", "velocity^3", lambda i: state.v[:, i] ** 3)


@dataclass(frozen=True)
class AsymmetricViscous(Effect):
    """Viscous friction that differs between the two directions, ``fva |q̇|``."""

    id = "asymmetric_viscous"
    title = "direction-dependent viscous friction"
    equation = "fva·|v|"
    sentence = (
        "{joint} needs more torque to move fast in one direction than in the other: its viscous friction depends on "
        "the direction"
    )
    looks_like = "the residual drawn against speed is a V: with faster motion it rises (or falls) in both directions"
    confused_with = ("offset", "asymmetric_coulomb")
    confirmed_by = "record the same constant speeds forward and backward through the same angles"
    reference = "Armstrong-Hélouvry 1991, Control of Machines with Friction, Kluwer"

    friction = True
    after_change = ("friction_change", "offset_change")
    code: ClassVar = {"fva": "abs({v})"}

    def terms(self, state: State) -> list[Term]:
        """One column per joint: the size of its speed."""
        return self.per_joint(state, "fva", "velocity", lambda i: np.abs(state.v[:, i]))


@dataclass(frozen=True)
class AsymmetricCoulomb(Effect):
    """Dry friction that differs between the two directions, ``fca tanh(|q̇|/width)``: an offset in motion.

    Attributes
    ----------
    width : float
        Speed below which the joint counts as standing still, rad/s (m/s).
    """

    id = "asymmetric_coulomb"
    title = "direction-dependent Coulomb friction"
    equation = "fca·tanh(|v|/width)"
    sentence = (
        "the dry friction of {joint} is larger in one direction than in the other; in motion this looks like a torque "
        "offset"
    )
    looks_like = "a torque offset in motion that vanishes at standstill"
    confused_with = ("offset", "asymmetric_viscous")
    confirmed_by = (
        "hold the joint still in several poses, approached from both sides: a torque offset stays, this friction "
        "vanishes"
    )
    reference = "Armstrong-Hélouvry 1991, Control of Machines with Friction, Kluwer"

    friction = True
    after_change = ("friction_change",)  # the offset's change is the same in motion
    same_in_motion = "offset"
    code: ClassVar = {"fca": "tanh(abs({v}) / {width})"}
    dry = True
    smooths_sign = True
    units: ClassVar = {"width": SPEED_UNITS}

    width: float = 0.05

    def __post_init__(self) -> None:
        self.require_positive(width="speed in rad/s (m/s)")

    def terms(self, state: State) -> list[Term]:
        """One column per joint: one while the joint moves, zero at standstill."""
        return self.per_joint(state, "fca", "", lambda i: np.tanh(np.abs(state.v[:, i]) / self.width))
