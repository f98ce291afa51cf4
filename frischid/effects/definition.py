"""Rules for the class of an effect, checked when the class is defined, and defaults for texts that the class lacks.

An effect is a frozen dataclass with an `id` and a method `terms`. Its dataclass fields are its shape parameters. A
class that breaks a rule raises an error at its definition and not later in a diagnosis. Texts that a class leaves out
are made from its docstring, its `id` and its module, so that every page has something to show.

Source of the hook: PEP 487, "Simpler customisation of class creation", https://peps.python.org/pep-0487/.
"""

from __future__ import annotations

import dataclasses
import inspect
import re
from collections.abc import Iterable, Mapping
from typing import Any

from frischid.effects.units import is_number
from frischid.errors import InputError

RESERVED_IDS = ("rigid", "contact", "unknown", "old_parameters")
"""Names in columns and findings that do not mean an effect of the catalogue."""

RESERVED_FIELDS = ("effect", "package")
"""Keys of a saved effect besides its shape parameters."""

TEXTS = ("title", "equation", "sentence", "looks_like", "confirmed_by", "reference")
"""Texts of an effect that pages print."""

CODE_QUANTITIES = ("q", "v", "a", "load", "torque", "temperature", "t", "middle")
"""Quantities that the expressions of `Effect.code` may use; and `z` where the effect has a `distance`,
`heat` where it has a `constant` and an `exponent`."""

CLASS_VARIABLE = re.compile(r"(\w+\.)?ClassVar\b")


def is_complete(kind: type[Any]) -> bool:
    """Whether a class is meant for the catalogue, as opposed to a base class of several effects.

    A base class still lacks a method (`terms`, or one of its own), or its name begins with an underscore.

    Raises
    ------
    InputError
        The class has an `id` but lacks a method, or has all methods but no `id` of its own.
    """
    missing = [n for n in dir(kind) if getattr(getattr(kind, n, None), "__isabstractmethod__", False)]
    if "id" in vars(kind):
        if missing:
            raise _wrong(kind, f"has the id '{vars(kind)['id']}' but no method {', '.join(missing)}; define it")
        return True
    if missing or kind.__name__.startswith("_"):
        return False
    raise _wrong(kind, 'has no id of its own; write a line such as id = "magnetic_detent"')


def check_class(kind: type[Any], base: type[Any]) -> None:
    """Raise InputError when the class of an effect breaks a rule; `base` is `frischid.effects.Effect`."""
    name = kind.id
    if not isinstance(name, str) or not name.isidentifier() or name in RESERVED_IDS:
        raise _wrong(
            kind,
            f"the id must be letters, digits and underscores, such as magnetic_detent, and none of "
            f"{', '.join(RESERVED_IDS)}; got {name!r}",
        )
    for field in own_fields(kind):
        _check_field(kind, base, field)
    _check_shapes(kind)
    if kind.smooths_sign and not hasattr(kind, "width"):
        raise _wrong(kind, "smooths_sign needs a field of the width, such as width: float = 0.005")
    if kind.candidate not in ("joint", "robot", "never"):
        raise _wrong(kind, f"candidate must be 'joint', 'robot' or 'never', got {kind.candidate!r}")
    for key in ("confused_with", "generalises", "after_change"):
        value = getattr(kind, key, ())
        if not isinstance(value, tuple) or not all(isinstance(x, str) for x in value):
            raise _wrong(kind, f'{key} must be a tuple of effect ids, such as ("viscous",), got {value!r}')
    for key in TEXTS:
        if not isinstance(getattr(kind, key, ""), str):
            raise _wrong(kind, f"{key} must be a text, got {getattr(kind, key)!r}")
    _check_templates(kind)


def own_fields(kind: type[Any]) -> list[str]:
    """Annotated names in the body of a class that `dataclasses.dataclass` makes fields of."""
    notes = {n: note if isinstance(note, str) else str(note) for n, note in inspect.get_annotations(kind).items()}
    return [n for n, note in notes.items() if n != "_" and not CLASS_VARIABLE.search(note)]


def check_decorated(kind: type[Any]) -> None:
    """Raise InputError when a class has fields but is not a dataclass; this is known only after its definition."""
    lacking = [n for n in own_fields(kind) if n not in getattr(kind, "__dataclass_fields__", ())]
    if lacking:
        raise _wrong(
            kind, f"has fields ({', '.join(lacking)}) but is not a dataclass; put @dataclass(frozen=True) above it"
        )


def complete(kind: type[Any]) -> None:
    """Give a class a default for every text that it lacks."""
    first = (kind.__doc__ or "").strip().partition("\n")[0].replace("``", "").rstrip(".")
    title = getattr(kind, "title", "") or first or kind.id.replace("_", " ")
    quoted = title.replace("{", "{{").replace("}", "}}")
    where = f"{kind.__module__}.{kind.__qualname__}"
    defaults = {
        "title": title,
        "equation": f"Σ coefficient·column, with the columns of {where}.terms",
        "sentence": f"{{joint}} needs torque that the effect {kind.id} describes: {quoted}",
        "looks_like": f"a residual that follows the columns of {kind.id}",
        "confused_with": (),
        "confirmed_by": f"record a motion on which the columns of {kind.id} change independently of all other columns",
        "reference": f"defined in {where}",
    }
    for key, value in defaults.items():
        if not hasattr(kind, key):
            setattr(kind, key, value)


def _check_field(kind: type[Any], base: type[Any], field: str) -> None:
    """Check that a field has a free name and a default that a file can hold."""
    if field == "joints":
        return
    if field in RESERVED_FIELDS or hasattr(base, field) or field in inspect.get_annotations(base):
        raise _wrong(
            kind,
            f"'{field}' cannot be a field, because every effect has an attribute of this name; write it without a type "
            "annotation, or with ClassVar[...]; a shape parameter needs another name",
        )
    default = vars(kind).get(field, dataclasses.MISSING)
    default = default.default if isinstance(default, dataclasses.Field) else default
    if not isinstance(default, bool | str) and not is_number(default):
        raise _wrong(
            kind,
            f"the field {field} needs a default: a number, a text or a truth value, such as {field}: float = 1.0",
        )


def _check_shapes(kind: type[Any]) -> None:
    """Check that shapes and units name fields, and that the values to try are ascending numbers."""
    fields = {f for base in kind.__mro__ for f in own_fields(base)} - {"joints", "changed"}
    for key in ("shapes", "units"):
        given = getattr(kind, key)
        if not isinstance(given, Mapping):
            raise _wrong(kind, f"{key} must be a dictionary from field to values, got {given!r}")
        unknown, known = sorted(set(given) - fields), ", ".join(sorted(fields)) or "none"
        if unknown:
            raise _wrong(kind, f"{key} names {', '.join(unknown)}, which is not a field; the fields are: {known}")
    for field, values in kind.shapes.items():
        numbers = isinstance(values, Iterable) and not isinstance(values, str) and all(map(is_number, values))
        if not numbers or not values or list(values) != sorted(set(values)):
            raise _wrong(kind, f"shapes['{field}'] must be ascending numbers, such as (0.1, 0.3, 1.0), got {values!r}")
    for field, pair in kind.units.items():
        if not (isinstance(pair, tuple) and len(pair) == 2 and all(isinstance(x, str) for x in pair)):
            raise _wrong(kind, f"units['{field}'] must be the units on a turning and on a sliding joint, got {pair!r}")


def _check_templates(kind: type[Any]) -> None:
    """Check that every placeholder of the sentence and of the expressions for generated code can be filled in."""
    fields = {f for base in kind.__mro__ for f in own_fields(base)}
    made = {name for name, needed in (("z", {"distance"}), ("heat", {"constant", "exponent"})) if needed <= fields}
    values = dict.fromkeys(fields | {*CODE_QUANTITIES} | made, "")
    templates = [("sentence", getattr(kind, "sentence", ""), {"joint": "", "joints": ""})]
    templates += [(f"code['{symbol}']", text, values) for symbol, text in kind.code.items()]
    for key, text, known in templates:
        try:
            text.format(**known)
        except (KeyError, IndexError, ValueError, AttributeError) as error:
            names = ", ".join(f"{{{n}}}" for n in sorted(known))
            raise _wrong(
                kind, f"{key} cannot be filled in ({type(error).__name__} {error}); it may use {names}"
            ) from None


def _wrong(kind: type[Any], text: str) -> InputError:
    return InputError(f"effect class {kind.__module__}.{kind.__qualname__}: {text}")
