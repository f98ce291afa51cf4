"""Names that try to become code in an exported file, and the parts of a file that no name may change.

`renamed` gives a model's robot, joints and links other names, wherever these stand. The *skeleton* of an exported file
is its text without the places that are meant for names. Two exports of one model under different names must have equal
skeletons: then no byte of a name has become code. `tests/export/test_hostile_names.py` and
`benchmarks/exported_names.py` compare them.
"""

from __future__ import annotations

import ast
import json
import random
import re
import xml.etree.ElementTree as ET

from frischid.export.names import identifier
from frischid.model.model import Model

HOSTILE = (
    'a\n"""\nevil = 1\n"""', "*/ int evil; /*", "*/*/", "/*/**", "\\", "\\\n*/", "??/", "???/\n*/",
    "'''", '"', "<&>]]>-->", "\r#define double int\r", "@J@{q}%s", "é\u202egnp\u2028x", "", " ", "1", "int",
    "\N{SNOWMAN}", "\\N{nothing}\\x", '""""', "/", "*", "?",
)  # fmt: skip
"""Pieces that end a comment, a string or a tag, or that a template or a preprocessor would read."""

_ALPHABETS = ("abz_09 ", "*/\\\"'<>&?-!#@{}[]()%$;:=,.|`~^+", "\t\n\r", "\u0085\u00a0\u2028\u202e\ufeff\U0001f600éß中")
_NAMED = {"name", "link", "joint", "body", "model", "class"}  # attributes that hold names, and names may be numbers
_NUMBER = re.compile(r"[-+\d.eE\s]*")


def names(rng: random.Random, count: int) -> list[str]:
    """Different hostile names that a URDF can hold."""
    found: dict[str, None] = {}
    while len(found) < count:
        text = "".join(
            rng.choice(HOSTILE) if rng.random() < 0.4
            else "".join(rng.choice(rng.choice(_ALPHABETS)) for _ in range(rng.randrange(1, 9)))
            for _ in range(rng.randrange(1, 5))
        )  # fmt: skip
        if text not in ("", "universe"):
            found[text] = None
    return list(found)


def renamed(model: Model, title: str, called: dict[str, str]) -> Model:
    """The model with its robot, and the joints and links of `called`, named otherwise, wherever their names stand."""

    def change(x):
        if isinstance(x, dict):
            return {called.get(k, k): change(y) for k, y in x.items()}
        if isinstance(x, list):
            return [change(y) for y in x]
        return called.get(x, x) if isinstance(x, str) else x

    data = json.loads(json.dumps({**model.to_dict(), "previous": None}))
    tree = ET.fromstring(data["robot"]["urdf"])
    tree.set("name", title)
    for element in tree.iter():
        for key in ("name", "link", "joint"):
            if element is not tree and element.get(key) in called:
                element.set(key, called[element.get(key)])
    data = change(data)
    data["robot"] |= {"urdf": ET.tostring(tree, encoding="unicode"), "name": title}
    return Model.from_dict(data)


def python_skeleton(text: str) -> str:
    """Python's meaning without the names: the tree with its docstring and the tuple of joints taken out."""
    tree = ast.parse(text)
    assert isinstance(tree.body[0].value, ast.Constant)
    assert tree.body[2].targets[0].id == "JOINTS"
    return ast.dump(ast.Module([tree.body[1], *tree.body[3:]], []))


def c_skeleton(text: str, title: str) -> str:
    """C without its comments and names of its own."""
    text, prefix = re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL), identifier(title)
    text = re.sub(r"enum \{.*?\};", "", text, flags=re.DOTALL)
    text = re.sub(rf"\b{prefix.lower()}_", "robot_", text)
    return re.sub(r"\s+", " ", re.sub(rf"\b{prefix.upper()}_", "ROBOT_", text))


def xml_skeleton(text: str) -> list[tuple[str, dict[str, str]]]:
    """Elements and attributes of a URDF or an MJCF in their order, with the numbers and without other texts."""
    return [
        (element.tag, {k: v if k not in _NAMED and _NUMBER.fullmatch(v) else "a text" for k, v in element.items()})
        for element in ET.fromstring(text).iter()
    ]
