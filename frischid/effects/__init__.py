"""The catalogue of physical effects: one family a file, one class an effect."""

from frischid.effects.base import (
    EFFECTS,
    Effect,
    State,
    Term,
    columns_of,
    effect_from_dict,
    parse_effects,
)
from frischid.effects.friction import Coulomb, Offset, Viscous
from frischid.effects.transmission import RotorInertia

BASELINE = (Viscous(), Coulomb(), Offset(), RotorInertia())
"""Effects every model starts from."""

__all__ = [
    "BASELINE",
    "EFFECTS",
    "Coulomb",
    "Effect",
    "Offset",
    "RotorInertia",
    "State",
    "Term",
    "Viscous",
    "columns_of",
    "effect_from_dict",
    "parse_effects",
]
