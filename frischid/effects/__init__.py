"""The catalogue of physical effects: one family a file, one class an effect."""

# isort: off
# In the order of the catalogue, which is that of definition: first what every robot has.
from frischid.effects.base import EFFECTS, Effect, State, Term, columns_of
from frischid.effects.friction import Coulomb, Offset, Viscous
from frischid.effects.transmission import Cogging, JointCoupling, RotorInertia
from frischid.effects.friction_curves import (
    AsymmetricCoulomb,
    AsymmetricViscous,
    CubicViscous,
    QuadraticViscous,
    Stribeck,
)
from frischid.effects.friction_conditions import LoadFriction, ThermalDrift
from frischid.effects.friction_memory import CableHose, Hysteresis
from frischid.effects.springs import Counterbalance, JointSpring
from frischid.effects.flexibility import Backlash, Elasticity
from frischid.effects.load import GravityTilt, Payload
from frischid.effects.sensing import DriveGain, EncoderZero, TimeDelay
from frischid.effects.formula import Formula
from frischid.effects.text import effect_from_dict, parse_effects
# isort: on

BASELINE = (Viscous(), Coulomb(), Offset(), RotorInertia())
"""Effects every model starts from."""

__all__ = [
    "BASELINE",
    "EFFECTS",
    "AsymmetricCoulomb",
    "AsymmetricViscous",
    "Backlash",
    "CableHose",
    "Cogging",
    "Coulomb",
    "Counterbalance",
    "CubicViscous",
    "DriveGain",
    "Effect",
    "Elasticity",
    "EncoderZero",
    "Formula",
    "GravityTilt",
    "Hysteresis",
    "JointCoupling",
    "JointSpring",
    "LoadFriction",
    "Offset",
    "Payload",
    "QuadraticViscous",
    "RotorInertia",
    "State",
    "Stribeck",
    "Term",
    "ThermalDrift",
    "TimeDelay",
    "Viscous",
    "columns_of",
    "effect_from_dict",
    "parse_effects",
]
