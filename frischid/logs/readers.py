"""Files of measurements become a `Log`, whatever their columns are called.

A file is first a table of named columns (`frischid.logs.tables`); a mapping (`frischid.logs.mapping`) gives their
meaning. Without one the columns are ``t``, ``q_<joint>``, ``v_<joint>``, ``a_<joint>``, ``tau_<joint>`` and
``current_<joint>``, SI units, joint side. Each conversion, and each column left out, is a note of the log.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from frischid.core.types import Array
from frischid.errors import InputError, UnknownNameError, close_names
from frischid.logs.bags import bag_form, bag_tables, is_bag, read_bag
from frischid.logs.log import CHANNELS, FEWEST_SAMPLES, Log, check_times, check_values, is_usable
from frischid.logs.mapping import ANGLE_UNITS, TICKS_PER_SECOND, JointMap, LogMap
from frischid.logs.tables import Table, joined, read_table, read_tables, write_table

SETPOINT = re.compile(r"(?:des|desired|ref|reference|cmd|command|target)_(.+)")


def read_log(
    path: str | Path,
    joints: Sequence[str] | None = None,
    mapping: LogMap | Mapping[str, Any] | str | Path | None = None,
) -> Log:
    """Read a CSV (.csv, .tsv, .txt), Parquet or NPZ file, a ROS bag (.bag, .db3, a ROS 2 folder) or MCAP file.

    Parameters
    ----------
    path : str or Path
    joints : sequence of str, optional
        The robot's joints, in the order wanted. Columns of any other joint are left out with a note, and a
        joint without a position column is not in the log.
    mapping : LogMap, mapping or path of a TOML file, optional
        Names and units of the columns, where they are not those of frischid.

    Returns
    -------
    Log

    Raises
    ------
    InputError
        The file, a column or a value is not usable; the message says which and where.

    Examples
    --------
    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> import numpy as np
    >>> import frischid as fr
    >>> with TemporaryDirectory() as folder:
    ...     path = Path(folder) / "log.csv"
    ...     rows = np.column_stack([10 * np.arange(20), np.linspace(0, 1, 20)])
    ...     np.savetxt(path, rows, delimiter=",", header="stamp,pos", comments="")
    ...     mapping = {"file": {"time": "stamp", "time_unit": "ms"}, "joint": {"elbow": {"q": "pos"}}}
    ...     log = fr.read_log(path, mapping=mapping)
    >>> log.joints, round(log.rate), log.notes
    (('elbow',), 100, ('t = stamp [ms] in seconds', 'columns renamed: q_elbow = pos'))
    """
    path = Path(path)
    form = _form(path, joints, mapping)
    table = read_bag(path, form, joints) if is_bag(path) else read_table(path, form)
    return _log(table, form, joints, _first(table, form), digest=digest_of(path))


def read_chunks(
    path: str | Path,
    joints: Sequence[str] | None = None,
    mapping: LogMap | Mapping[str, Any] | str | Path | None = None,
    *,
    samples: int = 65_536,
) -> Iterator[Log]:
    """Read a long file as consecutive logs of about `samples` samples; only one of them is in memory.

    Parameters
    ----------
    path, joints, mapping
        As for `read_log`. An NPZ file is read as a whole, the others are not.
    samples : int

    Yields
    ------
    Log
        Together they hold every sample once; their stamps go on from one to the next. `Log.sha256` is not computed.

    Raises
    ------
    InputError
        As for `read_log`, when the chunk that holds the fault is reached.

    Examples
    --------
    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> import frischid as fr
    >>> robot = fr.Robot.load("planar2")
    >>> log = fr.simulate(robot, fr.random_fourier(robot, 3.0, seed=0), rate=100.0)
    >>> with TemporaryDirectory() as folder:
    ...     fr.write_log(log, Path(folder) / "log.parquet")
    ...     [len(chunk) for chunk in fr.read_chunks(Path(folder) / "log.parquet", samples=150)]
    [150, 151]
    """
    path = Path(path)
    form = _form(path, joints, mapping)
    if samples < FEWEST_SAMPLES:
        raise InputError(f"a chunk needs at least {FEWEST_SAMPLES} samples, got {samples}")
    tables = bag_tables(path, form, joints, samples) if is_bag(path) else read_tables(path, form, samples)
    start, last = None, -np.inf
    for table in _none_too_short(tables):
        start = _first(table, form) if start is None else start
        log = _log(table, form, joints, start)
        if log.t[0] <= last:
            raise InputError(
                f"{path}: time does not increase at {table.place(0)}: {log.t[0]!s} after {last!s}; remove the repeated "
                "rows, or split the log where the clock was set back"
            )
        last = float(log.t[-1])
        yield log


def _form(path: Path, joints: Sequence[str] | None, mapping: Any) -> LogMap:
    """The mapping, checked against the robot; stamps of a bag are nanoseconds whatever it says."""
    form = LogMap.of(mapping)
    for name in form.joint:
        if joints is not None and name not in joints:
            raise UnknownNameError("joint", name, joints, form.source)
    return bag_form(form) if is_bag(path) else form


def _none_too_short(tables: Iterator[Table]) -> Iterator[Table]:
    """Tables whose last, if it is too short for a log, is joined to the one before."""
    held: Table | None = None
    for table in tables:
        if held is not None and table.rows < FEWEST_SAMPLES:
            held = joined([held, table])
            continue
        if held is not None:
            yield held
        held = table
    if held is not None:
        yield held


def _first(table: Table, form: LogMap) -> Any:
    """First stamp as it stands in the file: stamps from which it is subtracted must keep every digit."""
    name = _time_name(table, form)
    return table.values(name)[:1]


def digest_of(path: Path) -> str:
    """Hash of a file; of a folder, that of its files one after the other in the order of their names."""
    digest = hashlib.sha256()
    for part in sorted(p for p in path.iterdir() if p.is_file()) if path.is_dir() else [path]:
        with part.open("rb") as file:
            while block := file.read(1 << 20):
                digest.update(block)
    return digest.hexdigest()


def _log(table: Table, form: LogMap, joints: Sequence[str] | None, start: Any, digest: str | None = None) -> Log:
    """A table's rows as a log, its time counted from `start` where the mapping says so."""
    notes = list(table.notes)
    time, t = _time(table, form, start, notes)
    mapped, ignored = _columns_of_joints(table, form, joints, notes)
    channels = {channel: np.full((t.size, len(mapped)), np.nan) for channel in CHANNELS}
    for j, (joint, columns) in enumerate(mapped.items()):
        for channel, values in _convert(table, form, joint, columns, notes).items():
            channels[channel][:, j] = values
    converted = {note.partition(" = ")[0] for note in notes}
    renamed = [
        f"{channel}_{joint} = {name}"
        for joint, columns in mapped.items()
        for channel, name in columns.items()
        if name != f"{channel}_{joint}" and f"{channel}_{joint}" not in converted
    ]
    if renamed:
        notes.append(f"columns renamed: {', '.join(renamed[:3])}{f' and {len(renamed) - 3} more' * (len(renamed) > 3)}")
    used = {time, *ignored}.union(*(columns.values() for columns in mapped.values()))
    taken = {"t"} | {f"{channel}_{joint}" for channel in CHANNELS for joint in mapped}
    extra = _extra(table, used, taken, notes)
    return Log(t, tuple(mapped), **channels, extra=extra, source=table.source, sha256=digest, notes=tuple(notes))


def write_log(log: Log, path: str | Path) -> None:
    """Write a CSV, Parquet or NPZ file that `read_log` reads back to the same numbers.

    The file appears under its name only when it is complete.

    Parameters
    ----------
    log : Log
    path : str or Path
        Its suffix (.csv, .parquet or .npz) chooses the format.

    Raises
    ------
    InputError
        The format is unknown, or the file cannot be written.

    Examples
    --------
    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> import numpy as np
    >>> import frischid as fr
    >>> log = fr.Log(np.arange(20) / 100, ("elbow",), q=np.linspace(0, 1, 20)[:, None])
    >>> with TemporaryDirectory() as folder:
    ...     fr.write_log(log, Path(folder) / "log.npz")
    ...     again = fr.read_log(Path(folder) / "log.npz")
    >>> bool((again.q == log.q).all())
    True
    """
    write_table(log.to_table(), Path(path))


def _time_name(table: Table, form: LogMap) -> str:
    if isinstance(form.time, str) and form.time not in table.names:
        raise InputError(
            f"{table.source}: no time column '{form.time}'; the columns are {', '.join(table.names)}; "
            "rename one to 't', or name it as time = ... under [file] in a mapping file"
        )
    return table.find(form.time)


def _time(table: Table, form: LogMap, start: Any, notes: list[str]) -> tuple[str, Array]:
    """Name of the time column and the stamps [s]."""
    name = _time_name(table, form)
    raw = table.values(name)
    # Nanoseconds since 1970 do not fit a double: the start is subtracted before integers become doubles.
    t = np.asarray(raw - start if form.zero_time else raw, dtype=np.float64) / TICKS_PER_SECOND[form.time_unit]
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
    motion = entry.sign * ANGLE_UNITS[entry.angle_unit or form.angle_unit] / entry.gear_ratio
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
        if factor == 1 and not offset:
            continue  # a mere name: one note for all of them
        notes.append(f"{channel}_{joint} = {f'{scaled} {offset:+.6g}' if offset else scaled}")
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
