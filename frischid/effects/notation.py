"""Effects as text, for the command line, and as plain data, for model files.

    viscous, coulomb(width=0.02), stribeck(0.1)@elbow+wrist, formula("sin(3*q2)*v1")@shoulder

A value without a name belongs to the effect's first parameter. Expressions may have quotes or not. The text of
``str(effect)`` is read back exactly by `parse_effects`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from difflib import get_close_matches
from itertools import pairwise
from typing import Any

from frischid.effects.base import EFFECTS, Effect
from frischid.errors import InputError, UnknownNameError

_MOST_CHANGES = 20  # of one effect: after so many the robot should be identified again


def effect_from_dict(data: Mapping[str, Any]) -> Effect:
    """Inverse of `Effect.to_dict`.

    Raises
    ------
    UnknownNameError
        There is no such effect, or the effect has no such parameter.
    InputError
        The effect comes from a package that is not installed, or a value has the wrong type.
    """
    values = dict(data)
    name, package = str(values.pop("effect")), values.pop("package", None)
    kind = _kind(name) if package is None else EFFECTS.of_package(name, package)
    known = {f.name: f.default for f in dataclasses.fields(kind)}
    joints = values.pop("joints", None)
    if "changed" in values:
        values["changed"] = _number_of_change(kind, values["changed"])
    for key, value in values.items():
        if key not in known:
            raise UnknownNameError("parameter", key, set(known) - {"joints"}, f"effect {kind.id}")
        number = isinstance(known[key], float) and isinstance(value, int | float) and not isinstance(value, bool)
        if isinstance(known[key], bool | float | str) and not (number or type(value) is type(known[key])):
            raise InputError(f"effect {kind.id}: {key} = {value!r}, expected something like {known[key]!r}")
    return kind(joints=None if joints is None else tuple(joints), **values)


def _number_of_change(kind: type[Effect], value: Any) -> int:
    if isinstance(value, bool) or not isinstance(value, int | float) or value not in range(_MOST_CHANGES + 1):
        raise InputError(f"effect {kind.id}: changed = {value!r}, expected a number from 0 to {_MOST_CHANGES}")
    return int(value)


def parse_effects(text: str, *, complete: bool = False) -> tuple[Effect, ...]:
    """Read effects from text, for example ``"viscous, coulomb(width=0.02), offset@joint1+joint2"``.

    Parameters
    ----------
    text : str
        Identifiers with commas between; shape parameters in brackets; after ``@`` the joints, all by default.
    complete : bool
        Refuse an effect without a shape parameter that has no usual value: the expression of a formula.

    Returns
    -------
    tuple of Effect

    Raises
    ------
    InputError
        The text is malformed, or names an effect twice for the same joints, or is not `complete`.
    UnknownNameError
        The catalogue has no such effect, or the effect no such shape parameter.

    Examples
    --------
    >>> import frischid as fr
    >>> viscous, coulomb = fr.parse_effects("viscous, coulomb(width=0.02)@elbow")
    >>> coulomb.width, coulomb.joints
    (0.02, ('elbow',))
    """
    items = _items(text)
    for before, item in pairwise(map(str.strip, items)):
        if "@" in before and item.isidentifier() and not get_close_matches(item, EFFECTS):
            raise InputError(
                f"effects '{text}': unknown effect '{item}'; if this is another joint of the effect before it, write + "
                f"in place of the comma: {before}+{item}"
            )
    effects = [_parse_one(item, complete) for item in items]
    if len({(e.id, e.joints, e.changed, str(e) if e.several else "") for e in effects}) < len(effects):
        raise InputError(f"effects '{text}': the same effect is named twice for the same joints")
    return tuple(effects)


def states_shape(text: str) -> list[bool]:
    """For each effect of a text that `parse_effects` reads: whether it is written with parentheses.

    Examples
    --------
    >>> from frischid.effects.notation import states_shape
    >>> states_shape("cogging@wrist, stribeck(0.1)@elbow")
    [False, True]
    """
    return ["(" in _split(item, "@")[0] for item in _items(text)]


def stated_choices(effect: Effect) -> dict[str, float | bool | str]:
    """Parameters of an effect that are not its class's usual ones, besides searched shapes and the friction smoothing.

    Examples
    --------
    >>> import frischid as fr
    >>> from frischid.effects.notation import stated_choices
    >>> stated_choices(*fr.parse_effects("joint_coupling(ratio=-1)@wrist_2+wrist_3"))
    {'ratio': -1.0}
    """
    usual, known = type(effect)().parameters, {*effect.searched, *effect.internal}
    known |= {"width"} if effect.smooths_sign else set()
    return {k: x for k, x in effect.parameters.items() if k not in known and x != usual[k]}


def _items(text: str) -> list[str]:
    """The text of each effect."""
    return [item for item in _split(text, ",") if item.strip()]


def _kind(name: str) -> type[Effect]:
    if name not in EFFECTS:
        raise UnknownNameError("effect", name, EFFECTS)
    return EFFECTS[name]


def _split(text: str, separator: str) -> list[str]:
    """Split at every `separator` outside parentheses and quotes."""
    items, depth, quote = [""], 0, ""
    for character in text:
        if quote:
            quote = "" if character == quote else quote
        elif character in "\"'":
            quote = character
        else:
            depth += (character == "(") - (character == ")")
        if character == separator and depth == 0 and not quote:
            items.append("")
        else:
            items[-1] += character
    return items


def _parse_one(text: str, complete: bool) -> Effect:
    item = text.strip()
    head, *joints = (part.strip() for part in _split(item, "@"))
    name, bracket, inside = head.partition("(")
    if len(joints) > 1 or (bracket and not inside.endswith(")")):
        raise InputError(f"effect '{item}': write it as name(parameter=value)@joint+joint")
    kind = _kind(name.strip())
    values: dict[str, Any] = {"effect": kind.id}
    for position, pair in enumerate(p.strip() for p in _split(inside.removesuffix(")"), ",") if p.strip()):
        key, equals, value = (part.strip() for part in pair.partition("="))
        if not equals:
            key, value = _nth_parameter(kind, position, item), pair
        values[key] = _value(value, item)
    for parameter in kind.stated:
        if complete and parameter not in values:
            where = f"@{joints[0]}" if joints else ""
            raise InputError(
                f"effect '{item}': {kind.id} needs its {parameter}; write it in brackets, for example "
                f"'{kind.id}(\"{kind().parameters[parameter]}\"){where}'"
            )
    if joints:
        values["joints"] = [j.strip() for j in joints[0].split("+")]
    return effect_from_dict(values)


def _nth_parameter(kind: type[Effect], position: int, item: str) -> str:
    names = list(kind().parameters)
    if position >= len(names):
        known = ", ".join(names) or "none"
        raise InputError(f"effect '{item}': {kind.id} has {len(names)} parameters ({known}), this has more values")
    return names[position]


def _value(text: str, item: str) -> float | bool | str:
    if len(text) > 1 and text[0] == text[-1] and text[0] in "\"'":
        return text[1:-1]
    if text.lower() in {"true", "false"}:
        return text.lower() == "true"
    try:
        return float(text)
    except ValueError:
        if text:
            return text
        raise InputError(f"effect '{item}': a parameter has no value; write name(parameter=value)") from None
