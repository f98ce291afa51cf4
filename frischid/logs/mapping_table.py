"""The file for which a mapping is proposed: its table, with names for all columns, and its time or its rate."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from frischid.core.types import Array
from frischid.errors import InputError
from frischid.logs.bags import bag_form, is_bag, read_bag, topics_of
from frischid.logs.column_names import assign
from frischid.logs.column_words import CLOCK_UNITS, OTHER_WORDS, TIME_WORDS, unit_of
from frischid.logs.mapping import LogMap
from frischid.logs.mapping_rules import TICKS_PER_SECOND
from frischid.logs.proposal import Proposal
from frischid.logs.table import Table
from frischid.logs.tables import read_table
from frischid.robot.robot import Robot

USUAL_RATE = 100.0
"""Hz. Proposed, as a guess, for a file without time whose rate nothing tells."""


def table_of(path: Path, robot: Robot, found: Proposal) -> Table:
    """The file as a table; a CSV without a header gets numbers for names."""
    if is_bag(path):
        topics = topics_of(path)
        if len(topics) > 1:
            covered = {
                topic: len(assign({n: n for n in names}, robot.joints).columns) for topic, names in topics.items()
            }
            topic = max(covered, key=lambda name: covered[name])
            found.file["topic"] = topic
            found.reasons.append(f"topic {topic}: of all topics it has most joints of the robot ({covered[topic]})")
            if list(covered.values()).count(covered[topic]) > 1:
                found.guesses.append(f"topic {topic}: another topic has as many joints of the robot")
            return read_bag(path, bag_form(LogMap(topic=topic)), topics[topic])
        return read_bag(path, bag_form(LogMap()), robot.joints)
    try:
        table = read_table(path, LogMap(), robot.joints)
    except InputError as error:
        if "should name the columns" in str(error):
            found.file |= {"header": False}
            found.reasons.append("the file has no header: columns are numbers from 0")
            return read_table(path, LogMap(header=False))
        if "string array 'joints'" not in str(error):
            raise
        table = _arrays(path, robot, found)
    if any("in the robot's order" in note for note in table.notes):
        found.file["joints"] = list(robot.joints)
        found.guesses.append("the file names no joints: its columns are taken in the robot's order")
    return table


def _arrays(path: Path, robot: Robot, found: Proposal) -> Table:
    """2-D arrays of fewer columns than the robot has joints: the first joints."""
    with np.load(path, allow_pickle=False) as file:
        widths = {x.shape[1] for x in (file[name] for name in file.files) if x.ndim == 2}
    if len(widths) != 1 or max(widths) > len(robot.joints):
        raise InputError(
            f"{path}: its 2-D arrays have {', '.join(map(str, sorted(widths)))} columns and the robot has "
            f"{len(robot.joints)} joints ({', '.join(robot.joints)}); write joints = [...] under [file] by hand"
        )
    joints = list(robot.joints[: max(widths)])
    found.file["joints"] = joints
    found.guesses.append(f"the file names no joints: its columns are taken as {', '.join(joints)}")
    return read_table(path, LogMap(joints=tuple(joints)))


# ---------------------------------------------------------------------- time

PARTS_OF_STAMPS = ("sec", "secs", "seconds"), ("nsec", "nsecs", "nanosec", "nanosecs", "nanoseconds")
WORDS_OF_UNITS = {"ms": "ms", "us": "us", "µs": "us", "ns": "ns", "s": "s"} | dict.fromkeys(PARTS_OF_STAMPS[0], "s")
ROWS_PER_STAMP = 5
"""Most rows that have the same stamp: a recorder that is so much faster than the controller."""


def time_column(table: Table, found: Proposal) -> str | None:
    """Name of the time column; None without one."""
    words = {n: set(re.split(r"[^a-z]+", n.lower())) for n in table.names}
    growing = [n for n in table.names if n in table.numeric and _grows(table.numeric[n]) and not words[n] & OTHER_WORDS]
    clocks = [n for n in table.names if n in table.numeric and (words[n] & TIME_WORDS or unit_of(n)[0] in CLOCK_UNITS)]
    by_name = [n for n in growing if n in clocks] or [n for n in clocks if _is_repeated_clock(table.numeric[n])]
    even = [n for n in growing if n not in by_name and _is_even(table.numeric[n])]
    even.sort(key=lambda n: _counts_rows(table.numeric[n]))
    name = next(iter([*by_name, *even]), None)
    if name is None:
        return None
    if name != "t":
        found.file["time"] = name
        found.reasons.append(f"time: {name}, which grows from row to row")
    if name not in by_name and table.named:
        found.guesses.append(
            f"time: {name}, which grows in even steps; its name does not say time (if {name} only counts the rows: "
            "--rate, with the samples per second)"
        )
    return name


def stamps_of(table: Table, path: Path, name: str, found: Proposal) -> Array:
    """Stamps of the time column in seconds, and their unit.

    The unit is the one in the column's name, if it gives a rate that is possible at all; otherwise the first one that
    gives a usual rate.
    """
    raw = np.asarray(table.numeric[name] - table.numeric[name][0], dtype=float)
    steps = np.diff(raw)
    rate = 1 / float(np.median(steps[steps > 0]))
    said = _unit_said(name)
    units = [said] if said and 2 <= rate * TICKS_PER_SECOND[said] <= 2e4 else []
    units += [unit for unit, scale in TICKS_PER_SECOND.items() if 20 <= rate * scale <= 5e3]
    unit = "ns" if is_bag(path) else (units or ["s"])[0]
    if unit != "s" and not is_bag(path):
        found.file["time_unit"] = unit
        found.reasons.append(f"stamps in {unit}: {rate * TICKS_PER_SECOND[unit]:.4g} samples per second")
    if not is_bag(path) and abs(float(table.numeric[name][0])) / TICKS_PER_SECOND[unit] > 1e8:
        found.file["zero_time"] = True
    return raw / TICKS_PER_SECOND[unit]


def _unit_said(name: str) -> str | None:
    """Unit of time that a column's name says; None without one."""
    words = {unit_of(name)[0], *re.split(r"[^a-zµ]+", name.lower())}
    return next((unit for word, unit in WORDS_OF_UNITS.items() if word in words), None)


def rate_of(table: Table, rate: float | None, found: Proposal) -> Array:
    """Stamps of a file without time: the given rate, the one that velocities tell, or a guess."""
    found.file.pop("time", None)
    if rate is None:
        factors = []
        for columns in found.joints.values():
            if "v" in columns:
                q, v = (np.asarray(table.numeric[columns[c]], dtype=float) for c in "qv")
                advance, speed = np.diff(q), (v[1:] + v[:-1]) / 2
                factors.append(float(speed @ advance) / max(float(advance @ advance), 1e-300))
        told = float(np.median(factors)) if factors else 0.0
        rate = float(f"{told:.3g}") if told > 0 else USUAL_RATE
        how = f"the velocities tell {rate:g} samples per second" if told > 0 else f"{rate:g} samples per second"
        found.guesses.append(f"no column is time{_no_clock(table)}: {how}; correct it if you know the rate (--rate)")
    else:
        found.reasons.append(f"no column is taken as time: {rate:g} samples per second, as given")
    found.file["rate"] = rate
    return np.arange(table.rows) / rate


def _no_clock(table: Table) -> str:
    """Why a column whose name says time is none."""
    words = {word: n for n in table.names for word in re.split(r"[^a-z]+", n.lower())}
    parts = [next((words[w] for w in known if w in words), None) for known in PARTS_OF_STAMPS]
    if all(parts):
        both = f"{parts[0]} and {parts[1]}"
        return f" (the time is in two columns, {both}: write one column of their sum, sec + 1e-9 nsec, then map again)"
    for name in table.names:
        if not set(re.split(r"[^a-z]+", name.lower())) & TIME_WORDS:
            continue
        if name in table.unusable:
            return f" ({name} is not numeric: {table.unusable[name]})"
        back = np.diff(np.asarray(table.numeric[name], dtype=float)) < 0
        if back.any():
            where = table.place(int(back.argmax()) + 1)
            back_to = f"goes backwards {back.sum()} times, first at {where}"
            return f" ({name} {back_to}; sort the rows by {name}, then map again)"
    return ""


def _grows(x: NDArray[np.generic]) -> bool:
    steps = np.diff(np.asarray(x, dtype=float))
    return bool(len(steps) and np.isfinite(steps).all() and (steps > 0).mean() > 0.99 and steps.min() >= 0)


def _is_repeated_clock(x: NDArray[np.generic]) -> bool:
    """Whether a column never falls and has a new value every few rows: a clock whose rows were recorded repeatedly."""
    steps = np.diff(np.asarray(x, dtype=float))
    return bool(len(steps) and steps.min() >= 0 and (steps > 0).mean() > 1 / ROWS_PER_STAMP)


def _counts_rows(x: NDArray[np.generic]) -> bool:
    """Whether a column grows by one from row to row: a clock does so only in a unit of the sampling step."""
    return bool((np.diff(np.asarray(x, dtype=float)) == 1).all())


def _is_even(x: NDArray[np.generic]) -> bool:
    """Whether most steps have the same size, as a clock's have and a joint's have not."""
    steps = np.diff(np.asarray(x, dtype=float))
    return bool(np.mean(np.abs(steps / np.median(steps) - 1) < 0.5) > 0.9)
