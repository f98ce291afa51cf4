"""Friction whose curve over the speed is not a straight line and a step.

    τ_f,j = fs_j tanh(q̇_j/w) exp(−(|q̇_j|/v_s)^δ) + fvv_j q̇_j|q̇_j| + fvvv_j q̇_j³ + fva_j |q̇_j| + fca_j tanh(|q̇_j|/w)

The first is what lubrication takes away as speed builds the film (Stribeck 1902; the exponential form is Bo and
Pavelescu's); odd powers bend the viscous line, up with churning oil and down with shear thinning grease; the even terms
are friction that differs between the two directions.

Source: Armstrong-Hélouvry, Dupont and Canudas de Wit 1994, Automatica 30(7).
"""

from __future__ import annotations

from collections.abc import Mapping
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
        Stribeck speed, at which 1/e of the extra friction is left, rad/s (m/s).
    exponent : float
        1: slow decay (Tustin); 2: a bell (Gauss).
    width : float
        Speed over which the sign is smoothed, rad/s (m/s).
    """

    id: ClassVar[str] = "stribeck"
    title: ClassVar[str] = "Stribeck friction"
    equation: ClassVar[str] = "fs·tanh(v/width)·exp(−(|v|/speed)^exponent)"
    sentence: ClassVar[str] = (
        "{joint} needs more torque just after it reverses than when it moves: Stribeck friction, a lubricant film that "
        "builds up with speed"
    )
    looks_like: ClassVar[str] = "against speed, a peak on each side of zero that dies out within a tenth of a rad/s"
    confused_with: ClassVar[tuple[str, ...]] = ("coulomb", "quadratic_viscous", "cubic_viscous", "hysteresis")
    confirmed_by: ClassVar[str] = (
        "record many slow constant speeds, from 0.01 to 0.5 rad/s: the torque falls before it rises"
    )
    reference: ClassVar[str] = "Bo and Pavelescu 1982, Wear 82(3)"

    friction: ClassVar[bool] = True
    code: ClassVar[Mapping[str, str]] = {"fs": "tanh({v} / {width}) * exp(-pow(abs({v}) / {speed}, {exponent}))"}

    dry: ClassVar[bool] = True
    smooths_sign: ClassVar[bool] = True
    shapes: ClassVar[Mapping[str, tuple[float, ...]]] = {
        "speed": (0.02, 0.05, 0.1, 0.2, 0.5),
        "exponent": (1.0, 2.0),
    }

    units: ClassVar[Mapping[str, tuple[str, str]]] = {"speed": SPEED_UNITS, "width": SPEED_UNITS}

    speed: float = 0.1
    exponent: float = 2.0
    width: float = SIGN_WIDTH

    def __post_init__(self) -> None:
        self.require_positive(speed="speed in rad/s (m/s)", exponent="number", width="speed in rad/s (m/s)")

    def terms(self, state: State) -> list[Term]:
        """One column a joint: the smoothed sign of its speed, fading with the speed."""

        def column(i: int) -> np.ndarray:
            v = state.v[:, i]
            return np.asarray(np.tanh(v / self.width) * np.exp(-((np.abs(v) / self.speed) ** self.exponent)))

        return self.per_joint(state, "fs", "", column, sign=1)


@dataclass(frozen=True)
class QuadraticViscous(Effect):
    """Friction with the square of the speed, ``fvv q̇|q̇|``."""

    id: ClassVar[str] = "quadratic_viscous"
    title: ClassVar[str] = "quadratic viscous friction"
    equation: ClassVar[str] = "fvv·v·|v|"
    sentence: ClassVar[str] = (
        "the friction of {joint} does not grow in proportion to the speed but with its square: churning or "
        "shear-thinning lubricant, or air drag"
    )
    looks_like: ClassVar[str] = "against speed, an S that bends the viscous line up (or down) at both ends"
    confused_with: ClassVar[tuple[str, ...]] = ("cubic_viscous", "viscous", "stribeck")
    confirmed_by: ClassVar[str] = "record constant speeds up to the joint's limit, in both directions"
    reference: ClassVar[str] = "Simoni, Beschi, Legnani and Visioli 2015, IEEE/RSJ IROS"

    friction: ClassVar[bool] = True
    code: ClassVar[Mapping[str, str]] = {"fvv": "{v} * abs({v})"}

    def terms(self, state: State) -> list[Term]:
        """One column a joint: speed times its size."""
        return self.per_joint(state, "fvv", "rate^2", lambda i: state.v[:, i] * np.abs(state.v[:, i]))


@dataclass(frozen=True)
class CubicViscous(Effect):
    """Friction with the third power of the speed, ``fvvv q̇³``."""

    id: ClassVar[str] = "cubic_viscous"
    title: ClassVar[str] = "cubic viscous friction"
    equation: ClassVar[str] = "fvvv·v³"
    sentence: ClassVar[str] = (
        "the friction of {joint} bends away from a straight line at high speed: cubic viscous friction"
    )
    looks_like: ClassVar[str] = "against speed, a flat middle and steep ends"
    confused_with: ClassVar[tuple[str, ...]] = ("quadratic_viscous", "viscous", "stribeck")
    confirmed_by: ClassVar[str] = "record constant speeds up to the joint's limit, in both directions"
    reference: ClassVar[str] = "Taghirad and Bélanger 1998, ASME J. Dynamic Systems, Measurement and Control 120(4)"

    friction: ClassVar[bool] = True
    code: ClassVar[Mapping[str, str]] = {"fvvv": "{v} * {v} * {v}"}

    def terms(self, state: State) -> list[Term]:
        """One column a joint: the third power of its speed."""
        return self.per_joint(state, "fvvv", "rate^3", lambda i: state.v[:, i] ** 3)


@dataclass(frozen=True)
class AsymmetricViscous(Effect):
    """Viscous friction that differs between the two directions, ``fva |q̇|``."""

    id: ClassVar[str] = "asymmetric_viscous"
    title: ClassVar[str] = "direction-dependent viscous friction"
    equation: ClassVar[str] = "fva·|v|"
    sentence: ClassVar[str] = (
        "{joint} is harder to move fast in one direction than in the other: its viscous friction "
        "depends on the direction"
    )
    looks_like: ClassVar[str] = "against speed, a V: both halves of the line tilt the same way"
    confused_with: ClassVar[tuple[str, ...]] = ("offset", "asymmetric_coulomb")
    confirmed_by: ClassVar[str] = "record the same constant speeds forward and backward through the same angles"
    reference: ClassVar[str] = "Armstrong-Hélouvry 1991, Control of Machines with Friction, Kluwer"

    friction: ClassVar[bool] = True
    code: ClassVar[Mapping[str, str]] = {"fva": "abs({v})"}

    def terms(self, state: State) -> list[Term]:
        """One column a joint: the size of its speed."""
        return self.per_joint(state, "fva", "rate", lambda i: np.abs(state.v[:, i]))


@dataclass(frozen=True)
class AsymmetricCoulomb(Effect):
    """Dry friction that differs between the two directions, ``fca tanh(|q̇|/width)``: an offset except at rest.

    Attributes
    ----------
    width : float
        Speed below which the joint counts as at rest, rad/s (m/s).
    """

    id: ClassVar[str] = "asymmetric_coulomb"
    title: ClassVar[str] = "direction-dependent Coulomb friction"
    equation: ClassVar[str] = "fca·tanh(|v|/width)"
    sentence: ClassVar[str] = (
        "the dry friction of {joint} is larger in one direction than in the other; in motion, that is a torque offset"
    )
    looks_like: ClassVar[str] = "an offset that is there in motion and gone at rest"
    confused_with: ClassVar[tuple[str, ...]] = ("offset", "asymmetric_viscous")
    confirmed_by: ClassVar[str] = (
        "hold still in several poses, approached from both sides: an offset stays, this does not"
    )
    reference: ClassVar[str] = "Armstrong-Hélouvry 1991, Control of Machines with Friction, Kluwer"

    friction: ClassVar[bool] = True
    code: ClassVar[Mapping[str, str]] = {"fca": "tanh(abs({v}) / {width})"}

    dry: ClassVar[bool] = True
    smooths_sign: ClassVar[bool] = True

    units: ClassVar[Mapping[str, tuple[str, str]]] = {"width": SPEED_UNITS}

    width: float = 0.05

    def __post_init__(self) -> None:
        self.require_positive(width="speed in rad/s (m/s)")

    def terms(self, state: State) -> list[Term]:
        """One column a joint: one while it moves."""
        return self.per_joint(state, "fca", "", lambda i: np.tanh(np.abs(state.v[:, i]) / self.width))
