"""The schema of a mapping file says yes where the reader says yes."""

import tomllib

import pytest
from jsonschema import Draft202012Validator

from frischid.errors import InputError
from frischid.logs.mapping import LogMap
from frischid.logs.mapping_rules import DEFAULT_RULES, FILE_RULES, JOINT_RULES, mapping_schema

VALIDATOR = Draft202012Validator(mapping_schema())
VALUES = (
    True, False, 0, 1, -1, 2, -3, 0.5, 1e-13, 10**12, 10**13, 10**400, "", "t", ";", "é", "ab", "{joint}",
    "q_{joint}_{joint}", "s", "ms", "us", "ns", "rad", "deg", "m",
    "tau", "current", [], ["a"], ["a", "b"], ["a", "a"], ["a", 1],
    {},
)  # fmt: skip
"""Values of every kind, at the edges of the rules. For JSON Schema, 1.0 is an integer too; no such number is here."""


def reads(tables):
    """Whether the reader takes the tables."""
    try:
        LogMap.from_dict(tables)
    except InputError:
        return False
    return True


def tables_of(table, key, value):
    joints = table in ("joint", "current_gain")
    entry = {"elbow": value} if table == "current_gain" else {key: value}
    content = {"elbow": entry} if joints and table == "joint" else entry
    with_key = {"header": False, **content} if key == "columns" else content
    return {table: with_key}


KEYS = [
    *(("file", key) for key in FILE_RULES),
    *(("default", key) for key in DEFAULT_RULES),
    *(("joint", key) for key in JOINT_RULES),
    ("current_gain", ""),
    *((table, "unknown") for table in ("file", "default", "joint")),
]


@pytest.mark.parametrize(("table", "key"), KEYS)
def test_the_schema_takes_a_value_where_the_reader_takes_it(table, key):
    for value in VALUES:
        tables = tables_of(table, key, value)
        for content in (tables, {"layout": {"a": tables}}):
            assert VALIDATOR.is_valid(content) == reads(content), content


def test_the_schema_and_the_reader_know_the_same_keys():
    found = mapping_schema()["properties"]
    assert set(found["file"]["properties"]) == set(FILE_RULES)
    assert set(found["default"]["properties"]) == set(DEFAULT_RULES)
    assert set(found["joint"]["additionalProperties"]["properties"]) == set(JOINT_RULES)


@pytest.mark.parametrize(
    "text",
    [
        '[file]\nrate = 100.0\ntime = "t"',
        '[file]\ncolumns = ["a"]',
        '[file]\nheader = true\ncolumns = ["a"]',
        '[files]\ntime = "t"',
        "file = 3",
        "[layout.a]\nlayout = {}",
        "[layout]\na = 3",
    ],
)
def test_what_the_reader_refuses_the_schema_refuses(text):
    content = tomllib.loads(text)
    assert not reads(content)
    assert not VALIDATOR.is_valid(content)
