"""Files of measurements become a `Log`, and anybody's column names become ours.

A file is first a table of named columns (`frischid.tables`); a mapping (`frischid.mapping`) says what they
mean. Without one the columns are ``t``, ``q_<joint>``, ``v_<joint>``, ``a_<joint>``, ``tau_<joint>`` and
``current_<joint>``, SI units, joint side. Each conversion, and each column left out, is a note of the log.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from frischid.errors import InputError, UnknownNameError, close_names
from frischid.log import CHANNELS, Array, Log, check_times, check_values, is_usable
from frischid.mapping import SECONDS, UNITS, JointMap, LogMap
from frischid.tables import Table, read_table, write_table

SETPOINT = re.compile(r"(?:des|desired|ref|reference|cmd|command|target)_(.+)")


def read_log(
    path: str | Path,
    joints: Sequence[str] | None = None,
    mapping: LogMap | Mapping[str, Any] | str | Path | None = None,
) -> Log:
    """Read a CSV (.csv, .tsv, .txt), Parquet or NPZ file.

    Parameters
    ----------
    path : str or Path
    joints : sequence of str, optional
        The robot's joints, in the order wanted. Columns of any other joint are left out with a note, and a
        joint without a position column is not in the log.
    mapping : LogMap, mapping or path of a TOML file, optional
        Names and units of somebody else's columns.

    Returns
    -------
    Log

    Raises
    ------
    InputError
        The file, a column or a value is not usable; the message says which and where.
    """
    path = Path(path)
    form = LogMap.of(mapping)
    for name in form.joint:
        if joints is not None and name not in joints:
            raise UnknownNameError("joint", name, joints, form.source)
    table = read_table(path, form)
    notes: list[str] = []
    time, t = _time(table, form, notes)
    mapped, ignored = _columns_of_joints(table, form, joints, notes)
    channels = {channel: np.full((t.size, len(mapped)), np.nan) for channel in CHANNELS}
    for j, (joint, columns) in enumerate(mapped.items()):
        for channel, values in _convert(table, form, joint, columns, notes).items():
            channels[channel][:, j] = values
    used = {time, *ignored}.union(*(columns.values() for columns in mapped.values()))
    taken = {"t"} | {f"{channel}_{joint}" for channel in CHANNELS for joint in mapped}
    extra = _extra(table, used, taken, notes)
    with path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    return Log(t, tuple(mapped), **channels, extra=extra, source=str(path), sha256=digest, notes=tuple(notes))


def write_log(log: Log, path: str | Path) -> None:
    """Write a CSV, Parquet or NPZ file that `read_log` reads back to the same numbers.

    The file appears under its name only when it is complete.
    """
    write_table(log.to_table(), Path(path))


def _time(table: Table, form: LogMap, notes: list[str]) -> tuple[str, Array]:
    """Name of the time column and the stamps [s]."""
    if isinstance(form.time, str) and form.time not in table.names:
        raise InputError(
            f"{table.source}: no time column '{form.time}'; the columns are {', '.join(table.names)}; "
            "rename one to 't', or name it as time = ... under [file] in a mapping file"
        )
    name = table.find(form.time)
    raw = table.values(name)
    # Nanoseconds since 1970 do not fit a double: the start is subtracted while they are still integers.
    t = np.asarray(raw - raw[:1] if form.zero_time else raw, dtype=np.float64) / SECONDS[form.time_unit]
    check_times(t, table.source, table.place, name)
    if form.zero_time or form.time_unit != "s" or name != "t":
        start = f", starting from zero ({raw[0]} subtracted)" if form.zero_time else ""
        notes.append(f"t = {name} [{form.time_unit}] in seconds{start}")
    return name, t


def _columns_of_joints(
    table: Table, form: LogMap, joints: Sequence[str] | None, notes: list[str]
) -> tuple[dict[str, dict[str, str]], set[str]]:
    """Column of each channel of each joint, and the columns of joints that the robot does not have."""
    explicit = {
        joint: {c: table.find(ref) for c in CHANNELS if (ref := getattr(entry, c)) is not None}
        for joint, entry in form.joint.items()
    }
    claimed = [name for columns in explicit.values() for name in columns.values()]
    if twice := sorted({name for name in claimed if claimed.count(name) > 1}):
        raise InputError(f"{form.source}: column {', '.join(twice)} is given twice")
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
            notes.append(f"mapping of {joint} not used: the log has no position of it")
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
            "say which is which in a mapping file"
        )
    close = [f"{name} for {joint}" for name in there for joint in close_names(name, joints, 1)]
    hint = f" (perhaps {', '.join(close)})" if close else ""
    return (
        f"none of the joints in this log is a joint of the robot{hint}; the log has {', '.join(there)}; "
        f"the robot has {', '.join(joints)}; rename the columns or say which is which in a mapping file"
    )


def _convert(table: Table, form: LogMap, joint: str, columns: Mapping[str, str], notes: list[str]) -> dict[str, Array]:
    """Channels of one joint in its own unit, direction and side of the gear."""
    entry = form.joint.get(joint, JointMap())
    motion = entry.sign * UNITS[entry.angle_unit or form.angle_unit] / entry.gear_ratio
    effort = entry.sign * entry.torque_sign
    factors = {"q": motion, "v": motion, "a": motion, "tau": effort * entry.gear_ratio, "current": effort}
    channels: dict[str, Array] = {}
    for channel, name in columns.items():
        raw = np.asarray(table.values(name), dtype=np.float64)
        if channel != "q" and np.isnan(raw).all():
            notes.append(f"{name} left out: it is empty")
            continue
        check_values(name, raw, table.source, table.place)
        factor, offset = factors[channel], entry.offset if channel == "q" else 0.0
        channels[channel] = raw if factor == 1 and offset == 0 else factor * raw + offset
        scaled = f"{factor:.6g} × {name}" if factor != 1 else name
        if (formula := f"{scaled} {offset:+.6g}" if offset else scaled) != f"{channel}_{joint}":
            notes.append(f"{channel}_{joint} = {formula}")
    gain, tau_from = entry.current_gain, entry.tau_from or form.tau_from
    if tau_from == "current" and (gain is None or "current" not in channels):
        raise InputError(
            f'{form.source}: tau_from = "current" of joint {joint} needs a current_gain and a current column'
        )
    if gain is None:
        return channels
    if "current" in channels and (tau_from == "current" or (tau_from is None and "tau" not in channels)):
        instead = f", instead of column {columns['tau']}" if "tau" in channels else ""
        channels["tau"] = gain * channels["current"]
        notes.append(f"tau_{joint} = {gain:.6g} N·m/A × current_{joint}{instead}")
    else:
        why = f"torque is column {columns['tau']}" if "tau" in channels else "there is no current to convert"
        notes.append(f"current_gain of {joint} not used: {why}")
    return channels


def _extra(table: Table, used: set[str], taken: set[str], notes: list[str]) -> dict[str, Array]:
    """Every other column of usable numbers; the rest is noted and left out, as no joint depends on it."""
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
