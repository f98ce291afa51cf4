"""The rows of `bad_inputs.py`: what each input is, what is wrong with it, and the command that gets it."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import cycle
from pathlib import Path
from typing import Any

import click
import numpy as np

import frischid as fr
from frischid.cli import main as frischid
from frischid.logs.mapping import DEFAULT_RULES, FILE_RULES, JOINT_RULES
from frischid.logs.readers import write_log
from frischid.logs.tables import write_table

ANY, TOLD, REFUSED = (0, 1, 2), (1, 2), (2,)
"""Exit codes that are right: whatever comes, something is said, or nothing is done."""
FORMATS = ("csv", "parquet", "npz")
Table = dict[str, np.ndarray]


@dataclass(frozen=True)
class Row:
    """One command on one bad input.

    Attributes
    ----------
    kind, fault : str
        What the input is, and what is wrong with it.
    arguments : tuple of str
        The command line.
    codes : tuple of int
        Exit codes that are right.
    prepare : callable
        Writes the input, just before the command runs.
    """

    kind: str
    fault: str
    arguments: tuple[str, ...]
    codes: tuple[int, ...] = REFUSED
    prepare: Callable[[], Any] = lambda: None


def rows(folder: Path) -> list[Row]:
    """Every row; good inputs beside the bad ones are written into `folder`."""
    robot = fr.Robot.load("planar2")
    motion = fr.random_fourier(robot, 8.0, seed=1)
    log = fr.simulate(robot, motion, rate=50.0, noise=fr.Noise(q=1e-5, tau=0.01), name="good")
    write_log(log, folder / "good.csv")
    fr.identify(robot, [log], recursion="none").model.save(folder / "model.json")
    (folder / "robot.urdf").write_text(robot.urdf, encoding="utf-8")
    table = log.to_table() | {"temperature": np.linspace(20.0, 30.0, len(log))}
    return [
        *columns(folder, table),
        *files(folder),
        *robots(folder, robot.urdf),
        *mappings(folder),
        *models(folder),
        *formulas(),
        *arguments(folder),
    ]


# ---- columns of a log

FAULTS: dict[str, tuple[Callable[[np.ndarray], Any], str]] = {
    "nan in one row": (lambda x: put(x, 50, np.nan), "lost"),
    "inf in one row": (lambda x: put(x, 50, np.inf), "lost"),
    "1e300 in one row": (lambda x: put(x, 50, 1e300), "lost"),
    "-1e13 in the last row": (lambda x: put(x, -1, -1e13), "lost"),
    "nan everywhere": (lambda x: np.full_like(x, np.nan), "gone"),
    "inf everywhere": (lambda x: np.full_like(x, np.inf), "lost"),
    "zero": (np.zeros_like, "dead"),
    "constant": (lambda x: np.full_like(x, 3.5), "dead"),
    "the column is missing": (lambda _: None, "gone"),
    "whole numbers of 64 bits": (lambda x: np.full(len(x), 2**63 - 1), "lost"),
    "in milli-units": (lambda x: 1e3 * x, "unit"),
    "in nano-units": (lambda x: 1e9 * x, "unit"),
    "backwards": (lambda x: x[::-1].copy(), "odd"),
    "sign": (np.negative, "odd"),
    "one spike": (lambda x: put(x, 50, 1e6), "odd"),
    "1e-300": (lambda x: np.full_like(x, 1e-300), "dead"),
    "noise": (lambda x: np.random.default_rng(0).normal(size=len(x)), "odd"),
    "every row twice": (lambda x: np.repeat(x, 2)[: len(x)], "odd"),
}
COLUMNS = ("t", "q_joint2", "v_joint2", "a_joint2", "tau_joint2", "temperature")
COMMANDS = (("check", "robot.urdf"), ("identify", "robot.urdf"), ("compare", "model.json"))


def put(x: np.ndarray, row: int, value: float) -> np.ndarray:
    """A copy with another value in one row."""
    copy = x.copy()
    copy[row] = value
    return copy


def right_codes(column: str, fault: str, command: str) -> tuple[int, ...]:
    """Whether a fault of a column can be overlooked."""
    if column == "temperature":
        return ANY
    if fault == "lost" or (fault in ("gone", "dead") and column == "t"):
        return REFUSED
    if fault == "gone" and column == "q_joint2":
        return ANY if command != "compare" else REFUSED  # a joint without positions is locked
    if fault == "dead" and command == "check" and column.startswith(("q", "tau")):
        return TOLD
    return ANY


def columns(folder: Path, table: Table) -> Iterator[Row]:
    """Each column with each fault, in each format."""
    commands = cycle(COMMANDS)
    for form in FORMATS:
        for column in COLUMNS:
            for name, (damage, fault) in FAULTS.items():
                command, subject = next(commands)
                path = folder / f"bad.{form}"

                def prepare(column: str = column, damage: Any = damage, path: Path = path) -> None:
                    values = damage(table[column])
                    kept = {n: x for n, x in table.items() if n != column}
                    write_table(kept if values is None else kept | {column: values}, path)

                codes = right_codes(column, fault, command)
                yield Row(
                    f"column {column.split('_')[0]}", f"{name} ({form})", (command, subject, path.name), codes, prepare
                )


# ---- files

CONTENTS: dict[str, Callable[[bytes], bytes]] = {
    "empty": lambda _: b"",
    "one byte": lambda b: b[:1],
    "half": lambda b: b[: len(b) // 2],
    "cut by one byte": lambda b: b[:-9],
    "zeros": lambda b: bytes(len(b)),
    "random bytes": lambda b: np.random.default_rng(0).bytes(len(b)),
    "a byte flipped": lambda b: b[: len(b) // 2] + bytes([b[len(b) // 2] ^ 255]) + b[len(b) // 2 + 1 :],
    "twice": lambda b: b + b,
    "text": lambda _: b"this is no log\n" * 40,
    "utf-16": lambda b: b.decode("latin-1").encode("utf-16"),
    "zip bomb's beginning": lambda _: b"PK\x03\x04" + bytes(200),
    "json": lambda _: b'{"t": [0, 1, 2]}',
}


def files(folder: Path) -> Iterator[Row]:
    """Files that are damaged, or no logs at all, under every suffix."""
    log = fr.read_log(folder / "good.csv")
    for form in (*FORMATS, "mcap", "bag", "db3", "tsv", "xyz"):
        for name, change in CONTENTS.items():

            def prepare(form: str = form, change: Any = change) -> None:
                good = folder / f"whole.{form if form in FORMATS else 'csv'}"
                write_log(log, good)
                (folder / f"bad.{form}").write_bytes(change(good.read_bytes()))

            mild = form == "csv" and name in ("cut by one byte", "half", "a byte flipped", "twice")
            for command, subject in (COMMANDS[0], COMMANDS[2]):
                codes = ANY if mild or (form, name) in LOSSLESS else REFUSED
                yield Row("file", f"{name} (.{form})", (command, subject, f"bad.{form}"), codes, prepare)
    for path in ("missing.csv", ".", "", "/dev/null", "a" * 300 + ".csv", "good.csv/good.csv", "s3://nowhere/x.csv"):
        for command, subject in COMMANDS:
            yield Row("file", "no such file", (command, subject, path))


LOSSLESS = {("npz", "a byte flipped"), ("parquet", "a byte flipped"), ("tsv", "a byte flipped"), ("tsv", "half"),
            ("tsv", "cut by one byte"), ("tsv", "twice"), ("npz", "twice"), ("parquet", "twice")}  # fmt: skip
"""Damage that may leave a readable file."""


# ---- robots

NUMBERS = ("nan", "inf", "-1e999", "", "text", "1,5", "-1", "0", "1e300", "1 2 3 4 5 6 7", "0x10", "1e-320", "\x0b")


def robots(folder: Path, urdf: str) -> Iterator[Row]:
    """Each kind of number of a URDF with each fault; then texts that are no URDF."""
    import re

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


def writer(folder: Path, name: str, text: str) -> Callable[[], Any]:
    """A function that writes a file."""
    return lambda: (folder / name).write_bytes(text.encode("utf-8", errors="surrogateescape"))


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


# ---- arguments

FLOATS = ("nan", "inf", "-inf", "-1", "0", "1e-300", "1e300", "text", "")
WHOLE = ("-1", "0", "99999999999999999999", "1.5", "text", "")
TEXTS = ("", " ", ",", "=", "@", "nothing", "a=b=c", "*", "../../x", "x" * 5000, "nan", "-1")
SLOW = {"starts", "budget", "workers", "diagnosed", "max_steps"}  # a large number of these is what was asked for
GOOD = {"model": "model.json", "robot": "robot.urdf", "logs": "good.csv", "log": "good.csv", "unloaded": "good.csv",
        "loaded": "good.csv", "payload": "1", "effect": "joint_spring", "output": "out.csv",
        "name": "planar"}  # fmt: skip


def arguments(folder: Path) -> Iterator[Row]:
    """Each option and argument of each command with each wrong value."""
    for name, command in sorted(frischid.commands.items()):
        if name in ("studio", "demo"):  # the one never ends, the other has hardly an option
            continue
        for option in command.params:
            if option.name in ("as_json", "help") or isinstance(option.type, click.types.BoolParamType):
                continue
            whole = isinstance(option.type, click.types.IntParamType)
            real = isinstance(option.type, click.types.FloatParamType)
            for value in WHOLE if whole else FLOATS if real else TEXTS:
                if option.name in SLOW and value.startswith("999"):
                    continue
                output = {"export": "out.c", "simulate": "out.csv", "excite": "out.csv"}.get(name, "out.json")
                line = [name]
                for other in command.params:
                    values = [value] * max(other.nargs, 1) if other is option else [GOOD.get(str(other.name), output)]
                    if other is option or other.required:
                        line += values if isinstance(other, click.Argument) else [other.opts[-1], *values]
                if name == "excite" and option.name != "budget":
                    line += ["--budget", "20"]
                if name == "fleet" and option.name != "scheduler":
                    line += ["--scheduler", "none"]
                yield Row(f"argument {name}", f"{option.opts[-1]} {value!r}", tuple(line), ANY)
