"""Friction and torque offsets that changed after the model was identified.

Every robot has friction, and many a torque channel has an offset. Both change in the robot's life: new grease, a worn
or a new gear, a cold morning; a sensor or an amplifier that is zeroed again when the controller starts. The change has
the columns of the effects that the model has,

    τ = τ_model + Δfv q̇ + Δfc sign(q̇) + Δoff.

One log alone cannot separate the change from the old value, as it cannot separate a payload from the link that carries
it. A model of the robot from before the change can. So a diagnosis tries these effects only where the robot changed.

Sources: Bittencourt and Axelsson 2014, "Modeling and experiment design for identification of wear in a robot joint
under load and temperature uncertainties based on friction data", IEEE/ASME Trans. Mechatronics 19(5); Swevers,
Verdonck and De Schutter 2007, IEEE Control Systems 27(5).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from frischid.effects.base import Effect
from frischid.effects.state import SIGN_WIDTH, State, Term
from frischid.effects.units import SPEED_UNITS


@dataclass(frozen=True)
class FrictionChange(Effect):
    """Viscous and dry friction that changed since the model was identified, ``dfv q̇ + dfc tanh(q̇/width)``.

    A diagnosis names one joint at a time. Where the friction of many joints changed, the identified parameters as a
    whole no longer hold, and the robot should be identified again.

    Attributes
    ----------
    width : float
        Speed over which the sign is smoothed, rad/s (m/s).
    """

    id = "friction_change"
    title = "changed friction"
    equation = "dfv·v + dfc·tanh(v/width)"
    sentence = (
        "the friction of {joint} is not what it was when the model was identified: wear, new grease, another "
        "temperature, or a part that rubs"
    )
    looks_like = (
        "on new logs the residual drawn against speed is a straight line with a step at zero; on the model's own logs "
        "it is not"
    )
    confused_with = ("thermal_drift", "self_heating", "load_friction", "quadratic_viscous")
    confirmed_by = (
        "record the motion of the model's own logs once more, with the joint as warm as then: only changed friction "
        "changes its torque"
    )
    reference = "Bittencourt and Axelsson 2014, IEEE/ASME Trans. Mechatronics 19(5)"

    change = True
    single = True
    friction = True
    dry = True
    smooths_sign = True
    code: ClassVar = {"dfv": "{v}", "dfc": "tanh({v} / {width})"}
    units: ClassVar = {"width": SPEED_UNITS}

    width: float = SIGN_WIDTH

    def __post_init__(self) -> None:
        self.require_positive(width="speed in rad/s (m/s)")

    def terms(self, state: State) -> list[Term]:
        """Two columns per joint: its speed, and the smoothed sign of its speed."""
        viscous = self.per_joint(state, "dfv", "velocity", lambda i: state.v[:, i])
        dry = self.per_joint(state, "dfc", "", lambda i: np.tanh(state.v[:, i] / self.width))
        return [term for pair in zip(viscous, dry, strict=True) for term in pair]


@dataclass(frozen=True)
class OffsetChange(Effect):
    """Torque offset that changed since the model was identified: a sensor or amplifier that was zeroed again."""

    id = "offset_change"
    title = "changed torque offset"
    equation = "doff"
    sentence = (
        "the torque of {joint} has another constant part than when the model was identified: the offset of its sensor "
        "or amplifier changed, or a constant force acts on {joint}"
    )
    looks_like = "on new logs the whole residual lies above zero or below zero"
    confused_with = ("asymmetric_coulomb", "torque_drift", "joint_spring", "payload")
    confirmed_by = (
        "hold one pose of the model's own logs, and restart the controller there: a new offset changes the torque, "
        "and no body or friction does"
    )
    reference = "Swevers, Verdonck and De Schutter 2007, IEEE Control Systems 27(5)"

    change = True
    code: ClassVar = {"doff": "1.0"}

    def terms(self, state: State) -> list[Term]:
        """One column per joint: one."""
        return self.per_joint(state, "doff", "", lambda i: np.ones(len(state.t)))
