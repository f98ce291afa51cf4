"""Rows of `bad_inputs.py` whose input is a text: robots, mappings, models and formulas."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from bad_input_row import ANY, COMMANDS, REFUSED, Row, writer

from frischid.logs.mapping import DEFAULT_RULES, FILE_RULES, JOINT_RULES

# ---- robots

NUMBERS = ("nan", "inf", "-1e999", "", "text", "1,5", "-1", "0", "1e300", "1 2 3 4 5 6 7", "0x10", "1e-320", "\x0b")


def robots(folder: Path, urdf: str) -> Iterator[Row]:
    """Each kind of number of a URDF with each fault; then texts that are no URDF."""
    attributes = list({m[1]: m for m in re.finditer(r'\b([a-z]+)="[-\d. e]+"', urdf)}.values())
    for match in attributes:
        for value in NUMBERS:
            text = urdf[: match.start()] + f'{match[1]}="{value}"' + urdf[match.end() :]
            fault = f"{match[1]} = {value!r}"
            yield Row(
                "robot",
                fault,
                ("identify", "bad.urdf", "good.csv", "--bbrf", "none"),
                ANY,
                writer(folder, "bad.urdf", text),
            )
    for match in re.finditer(r"<(link|joint|parent|child|axis|origin|mass|inertia|limit|inertial)\b", urdf):
        text = urdf[: match.start()] + f"<no{match[1]}" + urdf[match.end() :]
        yield Row(
            "robot", f"no {match[1]} at {match.start()}", ("info", "bad.urdf"), ANY, writer(folder, "bad.urdf", text)
        )
    bomb = '<!DOCTYPE r [<!ENTITY a "' + "x" * 1000 + '">' + "".join(
        f'<!ENTITY {chr(98 + k)} "{f"&{chr(97 + k)};" * 20}">' for k in range(8)
    ) + "]><robot name='&i;'/>"  # fmt: skip
    for name, text in {
        "empty": "", "no XML": "<robot", "no robot": "<a/>", "robot without links": "<robot name='r'/>",
        "a bomb of entities": bomb,
        "an outer entity": "<!DOCTYPE r [<!ENTITY a SYSTEM 'file:///etc/passwd'>]><robot name='&a;'/>",
        "nested deep": "<robot>" + "<link>" * 20_000 + "</link>" * 20_000 + "</robot>", "no UTF-8": "\udcff",
        "every name the same": urdf.replace("link2", "link1").replace("joint2", "joint1"),
        "a link that is its own parent": urdf.replace('child link="link2"', 'child link="link1"'),
    }.items():  # fmt: skip
        for command in (("info",), ("check", "good.csv"), ("excite", "-o", "x.csv", "--budget", "10")):
            line = (command[0], "bad.urdf", *command[1:])
            yield Row("robot", name, line, REFUSED, writer(folder, "bad.urdf", text))


# ---- mappings

WRONG = (
    "true",
    "-1",
    "0",
    "1e400",
    "nan",
    "inf",
    '""',
    '"nothing"',
    "[]",
    "[1, 2]",
    "{a = 1}",
    "1979-05-27",
    "9" * 400,
)


def mappings(folder: Path) -> Iterator[Row]:
    """Each key of a mapping with each wrong value; then texts that are no mapping."""
    tables = (("file", FILE_RULES), ("default", DEFAULT_RULES), ("joint.joint2", JOINT_RULES))
    for table, rules in tables:
        for key in rules:
            for value in WRONG:
                text = f"[{table}]\n{key} = {value}\n"
                line = ("check", "robot.urdf", "good.csv", "--map", "bad.toml")
                yield Row("mapping", f"[{table}] {key} = {value[:30]}", line, ANY, writer(folder, "bad.toml", text))
    for name, text in {
        "no TOML": "[[[", "an unknown table": "[files]\n", "an unknown key": "[file]\ntimes = 't'\n",
        "a table that is none": "file = 1", "nested deep": "a = " + "[" * 50_000, "no UTF-8": "\udcff",
        "a joint that is none": "[joint]\njoint2 = 3", "a joint nobody has": "[joint.elbow]\nq = 'q_joint1'",
        "one column twice": "[joint.joint1]\nq = 'q_joint2'\n[joint.joint2]\nq = 'q_joint2'",
        "a gain of nothing": "[current_gain]\njoint2 = 0", "a gain of text": "[current_gain]\njoint2 = 'x'",
    }.items():  # fmt: skip
        for command, subject in COMMANDS:
            yield Row(
                "mapping",
                name,
                (command, subject, "good.csv", "--map", "bad.toml"),
                REFUSED,
                writer(folder, "bad.toml", text),
            )


# ---- controllers


def controllers(folder: Path) -> Iterator[Row]:
    """Each quantity of a controller with each wrong value, as a file and as an option; then texts that are none."""
    log = ("robot.urdf", "commanded.csv")
    for key in ("kp", "kd", "limit", "dead_band", "delay", "kp_doubt", "delay_doubt"):
        for value in (*WRONG, "1e300", "1e-300"):
            for text in (f"kp = 200.0\n{key} = {value}\n", f"[{key}]\njoint2 = {value}\n"):
                text = text if key != "kp" else text.removeprefix("kp = 200.0\n")
                line = ("check", *log, "--controller", "bad.toml")
                yield Row("controller", f"{key} = {value[:30]}", line, ANY, writer(folder, "bad.toml", text))
    for option in ("--kp", "--kd", "--effort-limit", "--dead-band", "--delay"):
        for text in (
            "nan",
            "inf",
            "-1",
            "1e300",
            "1e-300",
            "",
            "text",
            "joint2=",
            "=1",
            "joint2=nan",
            "elbow=1",
            "a=b=c",
            ",",
        ):
            line = ("check", *log, "--controller", "pd", option, text)
            yield Row("controller", f"{option} {text!r}", line, ANY)
    for name, text in {
        "no TOML": "[[[", "an unknown key": "gain = 1", "nested deep": "kp = " + "[" * 50_000, "no UTF-8": "\udcff",
        "tables deep": f"kp{'.a' * 5000} = 1", "a joint nobody has": "[kp]\nelbow = 1.0", "a list": "kp = [1, 2]",
        "a gain of text": "[kp]\njoint2 = 'x'", "digits without end": f"kp = {'9' * 5000}",
    }.items():  # fmt: skip
        for command in ("check", "identify"):
            line = (command, *log, "--controller", "bad.toml")
            yield Row("controller", name, line, REFUSED, writer(folder, "bad.toml", text))


# ---- models

VALUES: tuple[Any, ...] = (None, True, -1, 0, 1e300, float("nan"), float("inf"), "text", "", [], {}, [[1]], 10**400)


def models(folder: Path) -> Iterator[Row]:
    """Each field of a model with each wrong value, the hash removed; then texts that are no model."""
    data = json.loads((folder / "model.json").read_text(encoding="utf-8"))
    del data["sha256"]
    inner = [("filter", "cutoff_hz"), ("filter", "velocity"), ("parameters", 0, "value"), ("parameters", 0, "column"),
             ("parameters", 0, "name"), ("joints", 0, "name"), ("joints", 0, "sigma"), ("robot", "urdf"),
             ("robot", "gravity"), ("effects", 0), ("history", 0), ("covariance", 0)]  # fmt: skip
    for path in [*((key,) for key in data), *inner]:
        for value in VALUES:

            def prepare(path: Any = path, value: Any = value) -> None:
                copy = json.loads(json.dumps(data))
                place = copy
                for step in path[:-1]:
                    place = place[step]
                place[path[-1]] = value
                (folder / "bad.json").write_text(json.dumps(copy), encoding="utf-8")

            fault = f"{'.'.join(map(str, path))} = {str(value)[:20]}"
            yield Row("model", fault, ("compare", "bad.json", "good.csv"), ANY, prepare)
    other = (
        ("report", "bad.json", "good.csv", "-o", "x.html"),
        ("export", "bad.json", "-o", "x.c"),
        ("history", "bad.json"),
    )
    for name, text in {
        "empty": "", "no JSON": "{", "another JSON": "[]", "a number": "1", "nested deep": "[" * 100_000,
        "nested deep within": json.dumps(data)[:-1] + ', "x": ' + "[" * 90_000 + "]" * 90_000 + "}",
        "no UTF-8": "\udcff",
        "edited": json.dumps(data | {"sha256": "0"}), "the robot's URDF": "<robot/>",
    }.items():  # fmt: skip
        for line in (("compare", "bad.json", "good.csv"), *other):
            yield Row("model", name, line, REFUSED, writer(folder, "bad.json", text))


# ---- formulas

FORMULAS = (
    "", " ", "banana", "sin(", "sin(banana)", "q**q**q**q", "1/0", "0", "q-q", "nan", "inf", "1e308*1e308*q", "q;v",
    "q v",
    "__import__('os').system('true')", "().__class__.__bases__", "open('/etc/passwd')", "lambda: q",
    "q if v else a", "[q]",
    "q[0]", "'text'", "q.real", "f'{q}'", "(" * 5000 + "q" + ")" * 5000, "+".join(["q"] * 20_000), "-" * 10_000 + "q",
    "9" * 10_000 + "*q", "q" * 1000, "sin(q, v)", "q3", "v99", "sqrt(-1)", "log(0)", "exp(1e9)", "q@v", "q=v", "q:=v",
    "ü(q)",
    "\x00", "q\nv", "1e53", "v", "sign(v)", "10**10**10", "2**1000000", "q%0", "q//0", "q<v", "not q", "True", "None",
)  # fmt: skip


def formulas() -> Iterator[Row]:
    """Formulas that are none, that do harm, or that add nothing."""
    for text in FORMULAS:
        quoted = text.replace("'", "")
        line = ("add", "model.json", f"formula(expression='{quoted}')", "good.csv", "-o", "new.json")
        yield Row("formula", text, line, ANY)
