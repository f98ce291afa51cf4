"""The meaning of the symbols in an effect's equation, in words.

A symbol is one of four: a quantity of the motion or of the model, which has the same letter in every equation
(`COMMON`); a quantity of this effect alone (its class attribute ``symbols``); a shape parameter, which the class's
docstring describes; or a coefficient, which is identified. Other words of an equation are words.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from inspect import cleandoc
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from frischid.effects.base import Effect

COMMON: Mapping[str, str] = {
    "q": "position of the joint",
    "v": "velocity q̇ of the joint",
    "a": "acceleration q̈ of the joint",
    "t": "time",
    "middle": "middle of the joint's range, zero without a range",
    "z": "state of the friction between −1 and 1: its sign, which changes over some distance after a reversal",
    "h": "heat of the joint: the mean of |v|^exponent over the past, cold at the beginning",
    "f": "dry friction that acts on the link, behind the gear",
    "f_c": "size of that friction",
    "g": "gravity",
    "M": "inertia of the link about the joint",
    "load": "torque of the links on the joint",
    "temperature": "temperature of the joint, a column of the log",
    "τ": "torque of the links",
    "τ_rigid": "torque of the links on the joint, by the URDF or the model before",
    "τ_model": "torque of the model without this effect",
    "tau_model": "torque of the model without this effect",
}
"""Letters that mean the same in every equation."""
_SYMBOL = re.compile(r"[^\W\d²³][^\W²³]*[\u0300-\u036f]*")
"""A letter, then letters, digits, underscores, and dots above; a power is no part of a symbol."""
_WITHIN = {"dz": "z", "dq": "q", "dh": "h", "dt": "t", "ṡ": "s", "s̈": "s"}
"""Differentials and derivatives, and the symbol that explains them."""
_COEFFICIENT = "identified coefficient"


def symbols_of(kind: type[Effect]) -> dict[str, str]:
    """The symbols of an effect's equation and what they stand for, in the order of the equation.

    Examples
    --------
    >>> import frischid as fr
    >>> from frischid.effects.symbols import symbols_of
    >>> symbols_of(fr.EFFECTS["viscous"])
    {'fv': 'identified coefficient', 'v': 'velocity q̇ of the joint'}
    """
    shapes = parameter_texts(kind)
    known = {**COMMON, **{name: shapes.get(name, "shape parameter") for name in kind().parameters}, **kind.symbols}
    found: dict[str, str] = {}
    for symbol in dict.fromkeys(_SYMBOL.findall(kind.equation)):
        plain = _WITHIN.get(symbol, symbol)
        if plain in known:
            found[plain] = known[plain]
        elif plain in kind.code:
            found[plain] = _COEFFICIENT
    return found


def parameter_texts(kind: type[Effect]) -> dict[str, str]:
    """The first sentence of a class's docstring on each attribute."""
    text = cleandoc(kind.__doc__ or "").partition("Attributes\n----------\n")[2]
    found = {}
    for name, body in re.findall(r"^(\w+) : .*\n((?:[ ]+.*\n?)+)", text, re.MULTILINE):
        words = " ".join(body.split())
        first = re.split(r"(?<=[a-z)0-9])[.;:](?= |$)", words)[0].rstrip(".")
        found[name] = first[:1].lower() + first[1:]
    return found
