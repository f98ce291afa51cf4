"""The catalogue of physical effects: one family per file, one class per effect.

Comes in: a stretch of motion. Goes out: the columns that an effect adds to the regressor, with names, units and known
signs. Start with `friction`, the simplest effects, then `base`, the class of all effects. CONTRIBUTING.md has the
recipe for a new effect.

- **Families.** Friction: `friction`, `friction_curves` (over the speed), `friction_conditions` (load, position),
  `friction_memory`, `warming`, `self_heating`. Drive train: `transmission`, `flexibility` (with `link_lag`),
  `saturation`, `springs`. The robot's surroundings: `load`. Recordings: `sensing`, `commands`. Changes of old
  parameters: `changed_parameters`. A user's own: `formula`, in the language of `expression`.
- **Input and output of an effect.** `state` has both, `units` and `symbols` the words for them, `dynamics` the rigid
  torque that some effects need.
- **The catalogue.** `catalogue` finds effects, also of installed packages; `definition` checks a class; `notation`
  reads and writes effects as text.

Examples
--------
>>> import frischid as fr
>>> [effect.id for effect in fr.BASELINE]
['viscous', 'coulomb', 'offset', 'rotor_inertia']
>>> fr.EFFECTS["coulomb"].equation
'fc·tanh((v + lead·a)/width)'
>>> sorted(name for name, kind in fr.EFFECTS.items() if kind.change)
['friction_change', 'offset_change', 'payload']
"""

# isort: off
# The order of definition is the order of the catalogue: effects that every robot has come first.
from frischid.effects.base import EFFECTS, Effect, check_effects, columns_of
from frischid.effects.state import State, Term
from frischid.effects.friction import Coulomb, Offset, Viscous
from frischid.effects.transmission import Cogging, JointCoupling, RotorInertia
from frischid.effects.friction_curves import (
    AsymmetricCoulomb,
    AsymmetricViscous,
    CubicViscous,
    QuadraticViscous,
    Stribeck,
)
from frischid.effects.friction_conditions import LoadFriction, LoadStribeck, PositionFriction
from frischid.effects.warming import ThermalDrift, TorqueDrift
from frischid.effects.self_heating import SelfHeating
from frischid.effects.friction_memory import CableHose, Hysteresis
from frischid.effects.springs import Counterbalance, JointSpring
from frischid.effects.flexibility import Backlash, Elasticity
from frischid.effects.saturation import GearPlay
from frischid.effects.changed_parameters import FrictionChange, OffsetChange
from frischid.effects.load import GravityTilt, Payload
from frischid.effects.sensing import DriveGain, EncoderZero, TimeDelay
from frischid.effects.commands import CommandDelay
from frischid.effects.formula import Formula
from frischid.effects.notation import effect_from_dict, parse_effects
# isort: on

BASELINE = (Viscous(), Coulomb(), Offset(), RotorInertia())
"""Effects that `identify` uses when none are named."""

__all__ = [
    "BASELINE",
    "EFFECTS",
    "AsymmetricCoulomb",
    "AsymmetricViscous",
    "Backlash",
    "CableHose",
    "Cogging",
    "CommandDelay",
    "Coulomb",
    "Counterbalance",
    "CubicViscous",
    "DriveGain",
    "Effect",
    "Elasticity",
    "EncoderZero",
    "Formula",
    "FrictionChange",
    "GearPlay",
    "GravityTilt",
    "Hysteresis",
    "JointCoupling",
    "JointSpring",
    "LoadFriction",
    "LoadStribeck",
    "Offset",
    "OffsetChange",
    "Payload",
    "PositionFriction",
    "QuadraticViscous",
    "RotorInertia",
    "SelfHeating",
    "State",
    "Stribeck",
    "Term",
    "ThermalDrift",
    "TimeDelay",
    "TorqueDrift",
    "Viscous",
    "check_effects",
    "columns_of",
    "effect_from_dict",
    "parse_effects",
]
