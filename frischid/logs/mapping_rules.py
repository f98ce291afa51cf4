"""The keys of a mapping file and the values that each may have: for the reader, and as a JSON Schema for editors.

One `Rule` per key says the same thing three times: as a test in Python, in words for messages, and as JSON Schema.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from frischid.core.text import shortened
from frischid.errors import InputError, UnknownNameError
from frischid.logs.log import CHANNELS, GARBAGE

RADIANS_PER_UNIT = {"rad": 1.0, "m": 1.0, "deg": np.pi / 180, "mm": 1e-3}
"""rad of a turning joint, m of a sliding one."""
TICKS_PER_SECOND = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}
TABLES = ("file", "default", "joint", "current_gain", "layout")


class Rule(NamedTuple):
    """The values that one key may have."""

    is_right: Callable[[Any], bool]
    """Whether a value may stand there."""
    expected: str
    """The same in words, after "expected"."""
    schema: dict[str, Any]
    """The same as JSON Schema."""


def _one_of(*options: Any) -> Rule:
    # true == 1 in Python, but sign = true is a mistake.
    words = f"one of {', '.join(map(repr, options))}"
    return Rule(lambda x: any(type(x) is type(o) and x == o for o in options), words, {"enum": list(options)})


def _is_finite(x: Any) -> bool:
    # A whole number of TOML has as many digits as are written; float() would raise OverflowError.
    return isinstance(x, int | float) and not isinstance(x, bool) and abs(x) <= GARBAGE


def _is_names(x: Any) -> bool:
    return isinstance(x, list | tuple) and all(isinstance(n, str) for n in x) and len(set(x)) == len(x) > 0


FINITE = {"type": "number", "minimum": -GARBAGE, "maximum": GARBAGE}
NAME_LIST = {"type": "array", "items": {"type": "string"}, "uniqueItems": True, "minItems": 1}
COLUMN_RULE = Rule(
    lambda x: isinstance(x, str) or (isinstance(x, int) and not isinstance(x, bool) and 0 <= x <= GARBAGE),
    "a column name, or a column number from 0",
    {"anyOf": [{"type": "string"}, {"type": "integer", "minimum": 0, "maximum": GARBAGE}]},
)
TEMPLATE_RULE = Rule(
    lambda x: isinstance(x, str) and x.count("{joint}") == 1,
    "a text with {joint} in it once",
    {"type": "string", "pattern": r"\{joint\}", "not": {"pattern": r"\{joint\}[\s\S]*\{joint\}"}},
)
BOOL_RULE = Rule(lambda x: isinstance(x, bool), "true or false", {"type": "boolean"})
SIGN_RULE = _one_of(1, -1)
NONZERO_RULE = Rule(
    lambda x: _is_finite(x) and abs(x) * GARBAGE >= 1,
    "a number other than 0",
    {**FINITE, "not": {"exclusiveMinimum": -1 / GARBAGE, "exclusiveMaximum": 1 / GARBAGE}},
)
TAU_FROM_RULE = _one_of("tau", "current")

FILE_RULES: dict[str, Rule] = {
    "time": COLUMN_RULE,
    "time_unit": _one_of(*TICKS_PER_SECOND),
    "zero_time": BOOL_RULE,
    "header": BOOL_RULE,
    "delimiter": Rule(
        lambda x: isinstance(x, str) and len(x.encode()) == 1,
        "one character",
        {"type": "string", "pattern": r"^[\x00-\x7f]$", "maxLength": 1},
    ),
    "columns": Rule(_is_names, "a list of different names", NAME_LIST),
    "joints": Rule(_is_names, "a list of different names", NAME_LIST),
    "topic": Rule(lambda x: isinstance(x, str) and x != "", "the name of a topic", {"type": "string", "minLength": 1}),
    "rate": Rule(
        lambda x: _is_finite(x) and x > 0,
        "samples per second, a number above 0",
        {"type": "number", "exclusiveMinimum": 0, "maximum": GARBAGE},
    ),
    "logs": Rule(_is_names, "a list of different patterns of file names", NAME_LIST),
    "angle_unit": _one_of("rad", "deg"),
}
DEFAULT_RULES: dict[str, Rule] = dict.fromkeys(CHANNELS, TEMPLATE_RULE) | {"tau_from": TAU_FROM_RULE}
JOINT_RULES: dict[str, Rule] = dict.fromkeys(CHANNELS, COLUMN_RULE) | {
    "sign": SIGN_RULE,
    "offset": Rule(_is_finite, "a number", FINITE),
    "gear_ratio": NONZERO_RULE,
    "velocity_factor": NONZERO_RULE,
    "torque_sign": SIGN_RULE,
    "torque_factor": NONZERO_RULE,
    "current_factor": NONZERO_RULE,
    "current_gain": NONZERO_RULE,
    "tau_from": TAU_FROM_RULE,
    "angle_unit": _one_of(*RADIANS_PER_UNIT),
}


def checked(table: Any, rules: Mapping[str, Rule], where: str) -> dict[str, Any]:
    """Keys and values of one table of a mapping file; an error lists the keys that the table may hold.

    Parameters
    ----------
    table : object
        As TOML has it.
    rules : mapping of str to Rule
        Of this table.
    where : str
        Table and file, for messages.

    Raises
    ------
    InputError
        Not a table, an unknown key, or a value that its rule refuses.
    """
    if not isinstance(table, Mapping):
        raise InputError(f"{where}: expected a table, found {shortened(table)}")
    for key, value in table.items():
        if key not in rules:
            raise UnknownNameError("key", key, rules, where)
        if not rules[key].is_right(value):
            raise InputError(f"{where}: {key} = {shortened(value)}, expected {rules[key].expected}")
    return dict(table)


def mapping_schema() -> dict[str, Any]:
    """JSON Schema of a mapping file, in the words of the messages.

    The schema sees one table at a time. The reader also refuses two different gains of one joint, and keys of a layout
    that contradict those outside.

    Examples
    --------
    >>> from frischid.logs.mapping_rules import mapping_schema
    >>> mapping_schema()["properties"]["file"]["properties"]["time_unit"]["enum"]
    ['s', 'ms', 'us', 'ns']
    """
    file = _table(FILE_RULES) | {
        "not": {"required": ["rate", "time"]},
        "dependentSchemas": {"columns": {"required": ["header"], "properties": {"header": {"const": False}}}},
    }
    tables = {
        "file": file,
        "default": _table(DEFAULT_RULES),
        "joint": {"type": "object", "additionalProperties": _table(JOINT_RULES)},
        "current_gain": {"type": "object", "additionalProperties": _described(NONZERO_RULE)},
    }
    layout = {"type": "object", "properties": {**tables, "file": _table(FILE_RULES)}, "additionalProperties": False}
    properties = {**tables, "layout": {"type": "object", "additionalProperties": layout}}
    return {"type": "object", "properties": properties, "additionalProperties": False}


def _table(rules: Mapping[str, Rule]) -> dict[str, Any]:
    properties = {key: _described(rule) for key, rule in rules.items()}
    return {"type": "object", "properties": properties, "additionalProperties": False}


def _described(rule: Rule) -> dict[str, Any]:
    return {"description": rule.expected, **rule.schema}
