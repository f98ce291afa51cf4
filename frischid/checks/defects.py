"""All faults of a CSV file that cannot be read, at once.

Reading stops at the first fault. But a recording that was cut, or that holds memory written before it was filled, has
many faults. So the whole file is searched line by line, and every kind of fault is reported with its lines. Nothing is
repaired.
"""

from __future__ import annotations

import csv
from array import array
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from frischid.checks.log_issue import LogReport, Notebook
from frischid.core.text import counted
from frischid.errors import InputError
from frischid.logs.csv_files import CSV
from frischid.logs.csv_layout import Layout, csv_layout, is_number
from frischid.logs.layouts import layout_of
from frischid.logs.log import GARBAGE
from frischid.logs.mapping import LogMap
from frischid.logs.mapping_rules import TICKS_PER_SECOND

PLACES_NAMED = 6  # places of a file in one sentence


def defects(path: Path, form: LogMap) -> LogReport | None:
    """Every kind of unusable line of a CSV file; None when there is none, or the file is not a CSV."""
    if path.suffix.lower() not in CSV or not path.is_file():
        return None
    try:
        form = layout_of(path, form)
        layout = csv_layout(path, form)
    except InputError:
        return None
    width, notes, time = len(layout.names), Notebook(()), _time_column(form, layout)
    try:
        found = _scan(path, layout, time)
    except csv.Error:  # a cell longer than any number
        return None
    if not found.last:
        return None
    ragged, garbage = found.ragged, found.garbage
    notes.facts["bad_lines"] = len(ragged) + len(garbage)
    if ragged and ragged[-1] == found.last[0]:
        ragged.pop()
        what = f"line {found.last[0]}, the last, holds {found.last[1]} cells instead of {width}: the recording was cut"
        notes.add("truncated line", what, (), "certain", "delete that line", blocks=True)
    if ragged:
        what = f"{counted(len(ragged), 'line')} with another number of cells than {width}: {_ranges(ragged)}"
        notes.add("ragged lines", what, (), "certain", "correct or delete them", blocks=True)
    if garbage:
        what = f"{counted(len(garbage), 'line')} without a measurement (not a number, nan, or above {GARBAGE:g}): "
        what += _ranges(garbage)
        advice = "delete these lines: a cell is empty, or they are memory that was written before it was filled"
        notes.add("garbage rows", what, (), "certain", advice, blocks=True)
    if time is not None:
        _stamps(found.lines, np.asarray(found.stamps) / TICKS_PER_SECOND[form.time_unit], notes)
    return notes.report(str(path)) if notes.issues else None


def _time_column(form: LogMap, layout: Layout) -> int | None:
    """Position of the column of stamps; None where the file has none."""
    if form.rate is not None:
        return None
    if form.time in layout.names:
        return layout.names.index(form.time)
    return form.time if isinstance(form.time, int) and form.time < len(layout.names) else None


@dataclass
class _Scan:
    """Numbers of the lines with a fault, and the good lines' stamps: eight bytes each, since a file may be long."""

    ragged: array[int] = field(default_factory=lambda: array("q"))
    garbage: array[int] = field(default_factory=lambda: array("q"))
    lines: array[int] = field(default_factory=lambda: array("q"))
    stamps: array[float] = field(default_factory=lambda: array("d"))
    last: tuple[int, int] | None = None


def _scan(path: Path, layout: Layout, time: int | None) -> _Scan:
    """Look at every line once."""
    found = _Scan()
    encoding = "utf-8-sig" if layout.encoding == "utf-8" else layout.encoding
    texts: set[int] = set()  # columns that are no numbers from the first row on: dates, names of states
    never = np.ones(len(layout.names), dtype=bool)  # columns that no line has a measurement in: clocks in ns, unused
    doubtful = array("q")  # lines that only such columns make garbage
    with path.open(newline="", encoding=encoding, errors="replace") as file:
        text = (" ".join(line.split()) if layout.delimiter == " " else line for line in file)
        for number, row in enumerate(csv.reader(text, delimiter=layout.delimiter), start=1):
            if number <= layout.skip or not row:
                continue
            found.last = number, len(row)
            if len(row) != len(layout.names):
                found.ragged.append(number)
                continue
            if not found.lines and not found.garbage:
                texts = {
                    k
                    for k, cell in enumerate(row)
                    if k != time and cell and not is_number(cell, comma=layout.decimal_comma)
                }
            values = _numbers(
                ["0" if k in texts else cell or "nan" for k, cell in enumerate(row)], layout.decimal_comma
            )
            bad = ~(np.abs(values) <= GARBAGE)
            if doubtful and (never & ~bad).any():  # every line so far was bad in this column
                found.garbage = array("q", sorted([*found.garbage, *doubtful]))
                doubtful = array("q")
            never &= bad
            if (bad & ~never).any():
                found.garbage.append(number)
            elif bad.any():
                doubtful.append(number)
            # the stamp of a line with an empty cell is a time; that of a line of unfilled memory may be any number
            if time is not None and not bad[time] and np.isnan(values[bad]).all():
                found.lines.append(number)
                found.stamps.append(values[time])
    return found


def _numbers(row: Sequence[str], comma: bool) -> np.ndarray:
    try:
        return np.array([cell.replace(",", ".") for cell in row] if comma else row, dtype=float)
    except ValueError:
        return np.full(len(row), np.nan)


def _stamps(lines: Sequence[int], t: np.ndarray, notes: Notebook) -> None:
    """Report stamps that are no times, stamps that fall or repeat, and the gaps between the others."""
    if len(t) < 3:
        return
    steps = np.diff(t)
    usual = float(np.median(np.abs(steps[steps != 0]))) if steps.any() else 0.0
    jump = notes.criteria.lost_stamp_steps * usual
    lost = np.abs(t - np.median(t)) > jump * len(t)
    before, after = np.append(np.inf, np.abs(steps)), np.append(np.abs(steps), np.inf)
    lost |= np.minimum(before, after) > jump
    if lost.any():
        where = _ranges([line for line, yes in zip(lines, lost, strict=True) if yes])
        what = f"{counted(int(lost.sum()), 'line')} with a stamp far away from the stamps around it: {where}"
        notes.add("garbage rows", what, (), "certain", "delete these lines: they hold no measurement", blocks=True)
    kept, at = t[~lost], [line for line, yes in zip(lines, lost, strict=True) if not yes]
    steps = np.diff(kept)
    back = np.flatnonzero(steps <= 0)
    if len(back):
        what = f"time does not increase at {counted(len(back), 'line')}: {_ranges([at[k + 1] for k in back])}"
        notes.add(
            "time", what, (), "certain", "remove repeated rows; split the log where the clock was set back", blocks=True
        )
    wide = np.flatnonzero(steps > notes.criteria.gap_steps * usual)
    if len(wide):
        longest = int(steps.argmax())
        what = (
            f"{counted(len(wide), 'gap')} in the time stamps, the longest {steps[longest]:.4g} s "
            f"after line {at[longest]}"
        )
        notes.add("gap", what, (), "certain", "a gap splits the log in two; nothing is filled in")


def _ranges(lines: Sequence[int]) -> str:
    """Line numbers as text; neighbouring lines as a range."""
    groups: list[list[int]] = []
    for line in lines:
        if groups and line == groups[-1][1] + 1:
            groups[-1][1] = line
        else:
            groups.append([line, line])
    words = [str(a) if a == b else f"{a} to {b}" for a, b in groups[:PLACES_NAMED]]
    return ", ".join(words) + (f" and {len(groups) - PLACES_NAMED} more places" if len(groups) > PLACES_NAMED else "")
