"""The rows of `bad_inputs.py`: what each input is, what is wrong with it, and the command that gets it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import cycle
from pathlib import Path
from typing import Any

import click
import numpy as np
from bad_input_row import ANY, COMMANDS, REFUSED, TOLD, Row
from bad_input_texts import controllers, formulas, mappings, models, robots

import frischid as fr
from frischid.cli import main as frischid
from frischid.logs.readers import write_log
from frischid.logs.table_writing import write_table

FORMATS = ("csv", "parquet", "npz")
Table = dict[str, np.ndarray]


def rows(folder: Path) -> list[Row]:
    """Every row; good inputs beside the bad ones are written into `folder`."""
    robot = fr.Robot.load("planar2")
    motion = fr.random_fourier(robot, 8.0, seed=1)
    log = fr.simulate(robot, motion, rate=50.0, noise=fr.Noise(q=1e-5, tau=0.01), name="good")
    write_log(log, folder / "good.csv")
    fr.identify(robot, [log], recursion="none").model.save(folder / "model.json")
    (folder / "robot.urdf").write_text(robot.urdf, encoding="utf-8")
    assert log.tau is not None
    write_log(replace(log, tau=None, qcmd=log.q + log.tau / 200.0), folder / "commanded.csv")
    table = log.to_table() | {"temperature": np.linspace(20.0, 30.0, len(log))}
    return [
        *columns(folder, table),
        *files(folder),
        *robots(folder, robot.urdf),
        *mappings(folder),
        *controllers(folder),
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
    "1e-300 times": (lambda x: 1e-300 * x, "tiny"),
    "1e-300": (lambda x: np.full_like(x, 1e-300), "dead"),
    "noise": (lambda x: np.random.default_rng(0).normal(size=len(x)), "odd"),
    "every row twice": (lambda x: np.repeat(x, 2)[: len(x)], "odd"),
}
COLUMNS = ("t", "q_joint2", "v_joint2", "a_joint2", "tau_joint2", "temperature")


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
    if fault == "tiny" and column.startswith("tau"):  # uninitialised memory often holds such numbers
        return TOLD
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
            ("tsv", "cut by one byte"), ("tsv", "twice"), ("npz", "twice"), ("parquet", "twice"),
            ("csv", "utf-16"), ("tsv", "utf-16")}  # fmt: skip
"""Damage that may leave a readable file. UTF-16 is another way to write text."""


# ---- arguments

FLOATS = ("nan", "inf", "-inf", "-1", "0", "1e-300", "1e300", "text", "")
WHOLE = ("-1", "0", "99999999999999999999", "1.5", "text", "")
TEXTS = ("", " ", ",", "=", "@", "nothing", "a=b=c", "*", "../../x", "x" * 5000, "nan", "-1")
SLOW = {"starts", "budget", "workers", "diagnosed", "max_steps", "runs"}  # a large number was asked for
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
                if name == "paper" and option.name != "runs":
                    line += ["--runs", "2", "--as-corrected"]
                if name == "fleet" and option.name != "scheduler":
                    line += ["--scheduler", "none"]
                yield Row(f"argument {name}", f"{option.opts[-1]} {value!r}", tuple(line), ANY)
