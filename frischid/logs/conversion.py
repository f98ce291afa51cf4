"""Columns of a table become the channels of a log: units, signs, gears, and torque from current.

    q = sign · unit · raw / gear_ratio + offset        τ = sign · torque_sign · gear_ratio · raw, or current_gain · i

`frischid.logs.mapping` defines the keys. Each conversion, and each column left out, is a note of the log.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from frischid.core.types import Array
from frischid.errors import InputError
from frischid.logs.column_names import assign
from frischid.logs.log import CHANNELS, Log, check_times, check_values, is_usable
from frischid.logs.mapping import JointMap, LogMap
from frischid.logs.mapping_rules import RADIANS_PER_UNIT, TICKS_PER_SECOND
from frischid.logs.repeated_rows import without_repeats
from frischid.logs.restarts import RESTART_GAP, continued
from frischid.logs.table import Table

SETPOINT = re.compile(r"(?:des|desired|ref|reference|cmd|command|target)_(.+)")
"""Words that mark a column as a set point of a joint; such a column is not a joint of its own."""


def first_stamp(table: Table, form: LogMap) -> Any:
    """First stamp exactly as in the file, so that its subtraction loses no digit of the other stamps."""
    return np.zeros(1) if form.rate is not None else table.values(_time_name(table, form))[:1]


def log_of_table(
    table: Table,
    form: LogMap,
    joints: Sequence[str] | None,
    start: Any,
    digest: str | None = None,
    *,
    whole: bool = True,
) -> Log:
    """Convert the rows of a table to a log.

    Parameters
    ----------
    joints : sequence of str, optional
        The robot's joints, in the desired order.
    start : ndarray, shape (1,)
        Stamp that is subtracted if the mapping sets `zero_time`; see `first_stamp`.
    digest : str, optional
        Hash of the file.
    whole : bool
        Whether the table is the whole file; only then its time may start anew (`frischid.logs.restarts`).

    Raises
    ------
    InputError
        A column or a value is not usable, or no joint of the robot has a position column.
    """
    notes = list(table.notes)
    table = _without_repeated_rows(table, form, joints, notes)
    time, t = _time(table, form, start, notes, whole)
    mapped, ignored = _columns_of_joints(table, form, joints, notes)
    if whole:
        table, t = _without_empty_ends(table, t, mapped, notes)
    channels: dict[str, Any] = {channel: np.full((t.size, len(mapped)), np.nan) for channel in CHANNELS}
    conversions: list[_Conversion] = []
    empty: list[str] = []
    for j, (joint, columns) in enumerate(mapped.items()):
        found = _convert(table, form, joint, columns, conversions, notes)
        empty += [f"{channel}_{joint}" for channel in columns if channel not in found]
        for channel, values in found.items():
            channels[channel][:, j] = values
    notes += _described(conversions)
    converted = {(x.channel, x.joint) for x in conversions}
    renamed = [
        f"{channel}_{joint} = {name}"
        for joint, columns in mapped.items()
        for channel, name in columns.items()
        if name != f"{channel}_{joint}" and (channel, joint) not in converted
    ]
    if renamed:
        notes.append(f"columns renamed: {', '.join(renamed[:3])}{f' and {len(renamed) - 3} more' * (len(renamed) > 3)}")
    used = {time, *ignored}.union(*(columns.values() for columns in mapped.values()))
    taken = {"t"} | {f"{channel}_{joint}" for channel in CHANNELS for joint in mapped}
    extra = _extra(table, used, taken, notes)
    channels |= {"notes": tuple(notes), "empty": tuple(empty)}
    return Log(t, tuple(mapped), **channels, extra=extra, source=table.source, sha256=digest)


def _without_repeated_rows(table: Table, form: LogMap, joints: Sequence[str] | None, notes: list[str]) -> Table:
    """The table without rows that were recorded repeatedly; a table without repeated stamps has none."""
    if form.rate is not None:
        return table
    stamps = table.values(time := _time_name(table, form))
    if not (stamps[1:] == stamps[:-1]).any():
        return table
    mapped, _ = _columns_of_joints(table, form, joints, [])
    return without_repeats(table, time, [name for c in mapped.values() for name in c.values()], notes)


def _without_empty_ends(
    table: Table, t: Array, mapped: Mapping[str, Mapping[str, str]], notes: list[str]
) -> tuple[Table, Array]:
    """The table without first and last rows that hold no position at all: recorders start before the robot's driver."""
    positions = [np.asarray(table.numeric[c["q"]], dtype=float) for c in mapped.values() if c["q"] in table.numeric]
    if not positions:
        return table, t
    empty = np.asarray(np.isnan(np.array(positions)).all(axis=0))
    if not (empty[0] or empty[-1]) or empty.all():
        return table, t
    start, stop = int(np.argmin(empty)), len(empty) - int(np.argmin(empty[::-1]))
    ends = len(empty) - (stop - start)
    notes.append(f"{ends} rows without any position left out at the start and the end")
    place = table.place
    numeric = {name: x[start:stop] for name, x in table.numeric.items()}
    return replace(table, numeric=numeric, place=lambda row: place(start + row)), t[start:stop]


def _time_name(table: Table, form: LogMap) -> str:
    if isinstance(form.time, str) and form.time not in table.names:
        raise InputError(
            f"{table.source}: no time column '{form.time}'; the columns are {', '.join(table.names)}; "
            "rename one to 't', or name it as time = ... under [file] in a mapping file (without one: rate = ...)"
        )
    return table.find(form.time)


def _time(table: Table, form: LogMap, start: Any, notes: list[str], whole: bool) -> tuple[str, Array]:
    """Name of the time column (empty without one) and the stamps [s]."""
    if form.rate is not None:
        notes.append(f"no time column: {form.rate:g} samples per second, as the mapping says")
        t = (table.first + np.arange(table.rows)) / form.rate
        check_times(t, table.source, table.place)
        return "", t
    name = _time_name(table, form)
    raw = table.values(name)
    # A double cannot hold nanoseconds since 1970 exactly: the start is subtracted before integers become doubles.
    ticks = raw - start if form.zero_time else raw
    if form.zero_time and ticks.dtype == np.uint64:  # a stamp before the first one is negative, not 2⁶⁴ ticks later
        ticks = ticks.astype(np.int64)
    t = np.asarray(ticks, dtype=np.float64) / TICKS_PER_SECOND[form.time_unit]
    t, restarts = continued(t) if whole else (t, 0)
    if restarts:
        notes.append(
            f"{name} starts anew {restarts} time{'s' * (restarts > 1)}: the parts follow one another with gaps of "
            f"{RESTART_GAP:g} s, since nobody knows the time between them"
        )
    check_times(t, table.source, table.place, name)
    if form.zero_time or form.time_unit != "s" or name != "t":
        zeroed = f", starting from zero ({start[0]} subtracted)" if form.zero_time else ""
        notes.append(f"t = {name} [{form.time_unit}] in seconds{zeroed}")
    return name, t


def _columns_of_joints(
    table: Table, form: LogMap, joints: Sequence[str] | None, notes: list[str]
) -> tuple[dict[str, dict[str, str]], set[str]]:
    """Column of each channel of each joint, and the columns of joints that the robot does not have."""
    explicit = {
        joint: {
            c: table.find(ref, f"{c} of {joint} in {form.source}")
            for c in CHANNELS
            if (ref := getattr(entry, c)) is not None
        }
        for joint, entry in form.joint.items()
    }
    claimed = [name for columns in explicit.values() for name in columns.values()]
    if twice := sorted({name for name in claimed if claimed.count(name) > 1}):
        raise InputError(f"{form.source}: column {', '.join(twice)} is given to two channels; correct one of them")
    free = [name for name in table.names if name not in claimed]

    def columns_of(joint: str) -> dict[str, str]:
        named = {channel: form.default[channel].replace("{joint}", joint) for channel in CHANNELS}
        return {channel: name for channel, name in named.items() if name in free} | explicit.get(joint, {})

    head, tail = form.default["q"].split("{joint}")
    inner = (n[len(head) : len(n) - len(tail)] for n in free if n.startswith(head) and n.endswith(tail))
    found = dict.fromkeys(filter(None, [*inner, *(joint for joint in explicit if "q" in explicit[joint])]))
    # q_des_<joint> is a set point of a joint, not a joint called des_<joint>.
    known = {*found, *(joints or ())}
    there = [j for j in found if j in (joints or ()) or not ((m := SETPOINT.fullmatch(j)) and m[1] in known)]
    chosen = [joint for joint in (there if joints is None else joints) if joint in there]
    for joint, columns in explicit.items():
        if joint not in chosen and (columns or joints is None):
            raise InputError(f"{form.source}: joint '{joint}' has no position column in {table.source}; name q")
        if joint not in chosen:
            notes.append(f"mapping of {joint} not used: the log has no position of this joint")
    if not chosen:
        raise InputError(f"{table.source}: {_no_joint(table, form, there, joints)}")
    ignored = [joint for joint in there if joint not in chosen]
    if ignored:
        notes.append(f"left out, not joints of the robot: {', '.join(ignored)}")
    left_out = {name for joint in ignored for name in columns_of(joint).values()}
    return {joint: columns_of(joint) for joint in chosen}, left_out


def _no_joint(table: Table, form: LogMap, there: Sequence[str], joints: Sequence[str] | None) -> str:
    if not there or joints is None:
        template = form.default["q"].replace("{joint}", "<joint>")
        return (
            f"no position column '{template}'; the columns are {', '.join(table.names)}; "
            "say which is which in a mapping file (frischid map LOG ROBOT -o map.toml proposes one)"
        )
    found = assign({name: name for name in there}, joints).columns  # as `frischid map` reads the names
    near = [f"{found[joint]} for {joint}" for joint in joints if joint in found]
    hint = f" (perhaps {', '.join(near)})" if near else ""
    return (
        f"none of the joints in this log is a joint of the robot{hint}; the log has {', '.join(there)}; "
        f"the robot has {', '.join(joints)}; rename the columns or say which is which in a mapping file "
        "(frischid map LOG ROBOT -o map.toml proposes one)"
    )


class _Conversion(NamedTuple):
    """A channel of a joint that is computed from a column: ``factor × column + offset``."""

    channel: str
    joint: str
    column: str
    factor: float
    offset: float = 0.0
    unit: str = ""
    instead: str = ""

    @property
    def term(self) -> str:
        scaled = self.column if self.factor == 1 else f"{self.factor:.6g}{self.unit} × {self.column}"
        return f"{scaled} {self.offset:+.6g}" if self.offset else scaled


def _described(conversions: Sequence[_Conversion]) -> list[str]:
    """One note for each channel, however many joints there are."""
    notes = []
    for channel in dict.fromkeys(x.channel for x in conversions):
        same = [x for x in conversions if x.channel == channel]
        notes.append(", ".join(f"{channel}_{x.joint} = {x.term}{x.instead}" for x in same))
    return notes


def _convert(
    table: Table,
    form: LogMap,
    joint: str,
    columns: Mapping[str, str],
    conversions: list[_Conversion],
    notes: list[str],
) -> dict[str, Array]:
    """Channels of one joint, converted to SI units, the joint's direction and the joint side of the gear."""
    entry = form.joint.get(joint, JointMap())
    motion = entry.sign * RADIANS_PER_UNIT[entry.angle_unit or form.angle_unit] / entry.gear_ratio
    effort = entry.sign * entry.torque_sign
    factors = {
        "q": motion,
        "v": motion * entry.velocity_factor,
        "a": motion,
        "tau": effort * entry.gear_ratio * entry.torque_factor,
        "current": effort * entry.current_factor,
    }
    factors |= {"qcmd": motion, "vcmd": factors["v"], "tauff": factors["tau"]}
    channels: dict[str, Array] = {}
    for channel, name in columns.items():
        raw = np.asarray(table.values(name), dtype=np.float64)
        if channel != "q" and np.isnan(raw).all():
            notes.append(f"{name} left out: it is empty")
            continue
        check_values(name, raw, table.source, table.place)
        factor, offset = factors[channel], entry.offset if channel in ("q", "qcmd") else 0.0
        channels[channel] = raw if factor == 1 and offset == 0 else factor * raw + offset
        if factor != 1 or offset:  # one note for all columns that are only renamed
            conversions.append(_Conversion(channel, joint, name, factor, offset))
    gain, tau_from = entry.current_gain, entry.tau_from or form.tau_from
    if tau_from == "current" and (gain is None or "current" not in channels):
        raise InputError(
            f'{form.source}: tau_from = "current" of joint {joint} needs a current_gain and a current column'
        )
    if gain is None:
        return channels
    if "current" in channels and (tau_from == "current" or (tau_from is None and "tau" not in channels)):
        instead = f" instead of column {columns['tau']}" if "tau" in channels else ""
        channels["tau"] = gain * channels["current"]
        conversions.append(_Conversion("tau", joint, f"current_{joint}", gain, unit=" N·m/A", instead=instead))
    else:
        why = f"torque is column {columns['tau']}" if "tau" in channels else "there is no current to convert"
        notes.append(f"current_gain of {joint} not used: {why}")
    return channels


def _extra(table: Table, used: set[str], taken: set[str], notes: list[str]) -> dict[str, Array]:
    """All other columns of usable numbers; columns without are left out, with a note."""
    extra: dict[str, Array] = {}
    rest = [name for name in table.names if name not in used]
    if rest and not table.named:
        notes.append(f"columns without a name left out: {', '.join(rest)}")
        return extra
    for name in rest:
        if name in table.unusable:
            notes.append(f"{name} left out, not numeric: {table.unusable[name]}")
            continue
        values = np.asarray(table.values(name), dtype=np.float64)
        usable = is_usable(values)
        if not usable.all():
            row = int(np.argmin(usable))
            notes.append(f"{name} left out: {table.place(row)} holds {values[row]:g}")
        elif name in taken:
            notes.append(f"{name} left out: the mapping takes this quantity from another column")
        else:
            extra[name] = values
    return extra
