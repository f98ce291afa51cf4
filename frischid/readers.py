"""Files of measurements become a `Log`, and anybody's column names become ours.

Every format is first a table of named columns. A `LogMap` then says which column is which joint's what, and
in which unit and direction it was recorded:

    q = sign · unit · raw / gear_ratio + offset        q̇, q̈ = sign · unit · raw / gear_ratio
    i = sign · torque_sign · raw                       τ = sign · torque_sign · gear_ratio · raw
                                                       or τ = current_gain · i

Without a mapping the columns are ``t``, ``q_<joint>``, ``v_<joint>``, ``a_<joint>``, ``tau_<joint>`` and
``current_<joint>``, SI units, joint side. Each conversion, and each column left out, is a note of the log.
"""

from __future__ import annotations

import csv
import hashlib
import io
import itertools
import os
import re
import tomllib
import zipfile
import zlib
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet
from numpy.typing import NDArray

from frischid.errors import InputError, UnknownNameError, close_names
from frischid.log import CHANNELS, Array, Log, Place, check_times, check_values, is_usable, row_place

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
    table = _open(path, form)
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
    path = Path(path)
    writers = {".csv": _write_csv, ".parquet": _write_parquet, ".npz": _write_npz}
    if path.suffix.lower() not in writers:
        raise InputError(f"{path}: cannot write '{path.suffix}' files; use one of {', '.join(writers)}")
    if not path.parent.is_dir():
        raise InputError(f"{path}: there is no folder {path.parent}")
    scratch = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        with scratch.open("wb") as file:
            writers[path.suffix.lower()](log.to_table(), file)
        scratch.replace(path)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror})") from error
    finally:
        scratch.unlink(missing_ok=True)


def _write_csv(table: Mapping[str, Array], file: IO[bytes]) -> None:
    header = io.StringIO()
    csv.writer(header, lineterminator="\n").writerow(table)
    file.write(header.getvalue().encode())
    # Arrow prints the shortest digits that read back to the same double.
    pa.csv.write_csv(pa.table(dict(table)), file, pa.csv.WriteOptions(include_header=False))


def _write_parquet(table: Mapping[str, Array], file: IO[bytes]) -> None:
    pa.parquet.write_table(pa.table(dict(table)), file, compression="zstd")


def _write_npz(table: Mapping[str, Array], file: IO[bytes]) -> None:
    # np.savez takes names as keywords, but a column may be called "file"; a fixed date keeps hashes equal.
    with zipfile.ZipFile(file, "w") as archive:
        for name, values in table.items():
            with archive.open(zipfile.ZipInfo(f"{name}.npy"), "w", force_zip64=True) as member:
                np.lib.format.write_array(member, np.ascontiguousarray(values))


@dataclass(frozen=True)
class _Table:
    """A file's columns in their order; `unusable` says why a column is not numbers."""

    source: str
    names: Sequence[str]
    numeric: Mapping[str, NDArray[Any]]
    unusable: Mapping[str, str]
    place: Place = row_place
    named: bool = True

    def find(self, reference: str | int) -> str:
        """Name of a column given by name, or by number from 0."""
        if isinstance(reference, int) and 0 <= reference < len(self.names):
            return self.names[reference]
        if reference not in self.names:
            raise UnknownNameError("column", str(reference), self.names, self.source)
        return str(reference)

    def values(self, name: str) -> NDArray[Any]:
        if name in self.unusable:
            raise InputError(f"{self.source}: column '{name}' is not numeric: {self.unusable[name]}")
        return self.numeric[name]


def _open(path: Path, form: LogMap) -> _Table:
    readers = dict.fromkeys((".csv", ".tsv", ".txt"), _read_csv) | {
        ".parquet": _read_parquet,
        ".npz": _read_npz,
    }
    if path.is_dir():
        raise InputError(f"{path}: is a folder; give one file ({', '.join(readers)})")
    if not path.exists():
        close = close_names(path.name, (p.name for p in path.parent.glob("*")))
        hint = f"; did you mean {', '.join(close)}?" if close else ""
        raise InputError(f"{path}: there is no such file{hint}")
    if path.suffix.lower() not in readers:
        raise InputError(f"{path}: cannot read '{path.suffix}' files; supported are {', '.join(readers)}")
    if path.stat().st_size == 0:
        raise InputError(f"{path}: the file is empty")
    try:
        return readers[path.suffix.lower()](path, form)
    except (OSError, ValueError, EOFError, zipfile.BadZipFile, zlib.error, pa.ArrowException) as error:
        kind = path.suffix.lower()[1:]
        raise InputError(f"{path}: cannot be read as {kind} ({error}); was it copied completely?") from error


def _read_csv(path: Path, form: LogMap) -> _Table:
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        before, line = next(((k, line) for k, line in enumerate(file) if line.strip()), (0, ""))
    # The separator is whichever of the usual ones the first line has most of.
    delimiter = form.delimiter or max(",;\t ", key=lambda c: line.strip(" ").count(c) if c != " " else 0.5)
    cells = [cell.strip() for cell in next(csv.reader([line.strip("\r\n")], delimiter=delimiter), [])]
    if not cells:
        raise InputError(f"{path}: the file holds only empty lines")
    if form.header and all(_is_number(cell) for cell in cells):
        raise InputError(
            f"{path}: line {before + 1} should name the columns but holds {len(cells)} numbers; if the file "
            "has no header, set header = false and columns = [...] under [file] in a mapping file"
        )
    names = cells if form.header else list(form.columns) or [str(i) for i in range(len(cells))]
    if len(names) != len(cells):
        raise InputError(
            f"{path}: line {before + 1} holds {len(cells)} cells, {form.source} names {len(names)} columns"
        )
    skip = before + 1 if form.header else before
    options = pa.csv.ReadOptions(column_names=names, skip_rows=skip)
    try:
        arrow = pa.csv.read_csv(path, options, pa.csv.ParseOptions(delimiter=delimiter))
    except pa.ArrowInvalid as error:
        raise InputError(f"{path}: {_ragged_line(path, delimiter, len(names), skip) or error}") from error
    return _from_arrow(arrow, path, _line_place(path, skip), named=form.header or bool(form.columns))


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _line_place(path: Path, skip: int) -> Place:
    """Rows as lines of the file, in which empty lines count but hold no row."""

    def place(row: int) -> str:
        with path.open("rb") as file:
            filled = (k for k, line in enumerate(file) if k >= skip and line.strip(b"\r\n"))
            return f"line {next(itertools.islice(filled, row, None)) + 1}"

    return place


def _ragged_line(path: Path, delimiter: str, width: int, skip: int) -> str | None:
    """Which line has too few or too many cells."""
    with path.open(newline="", encoding="utf-8-sig", errors="replace") as file:
        rows = csv.reader(itertools.islice(file, skip, None), delimiter=delimiter)
        try:
            wrong = [(skip + rows.line_num, len(row)) for row in rows if row and len(row) != width]
        except csv.Error:
            return None
    if not wrong:
        return None
    line, cells = wrong[0]
    if line == skip + rows.line_num:
        return (
            f"line {line}, the last, holds {cells} cells instead of {width}: the recording was cut; delete it"
        )
    return (
        f"line {line} holds {cells} cells instead of {width} (and {len(wrong) - 1} more such lines); "
        "correct or delete them, nothing is guessed here"
    )


def _read_parquet(path: Path, form: LogMap) -> _Table:
    return _from_arrow(pa.parquet.read_table(path), path)


def _from_arrow(arrow: Any, path: Path, place: Place = row_place, named: bool = True) -> _Table:
    numeric: dict[str, NDArray[Any]] = {}
    unusable: dict[str, str] = {}
    for name, column in zip(arrow.column_names, arrow.columns, strict=True):
        if name in numeric or name in unusable:
            raise InputError(f"{path}: two columns are called '{name}'; rename one")
        kind = column.type
        if pa.types.is_null(kind) or pa.types.is_boolean(kind):
            column = column.cast(pa.float64() if pa.types.is_null(kind) else pa.int8())
        if pa.types.is_integer(column.type) or pa.types.is_floating(column.type):
            numeric[name] = column.to_numpy()
        elif pa.types.is_string(kind) or pa.types.is_large_string(kind):
            cells = enumerate(column.to_pylist())
            wrong = ((k, cell) for k, cell in cells if cell is not None and not _is_number(cell))
            row, cell = next(wrong, (0, column[0].as_py()))
            unusable[name] = f"{place(row)} holds {cell!r}"
        else:
            unusable[name] = f"its values are of type {kind}"
    return _Table(str(path), tuple(arrow.column_names), numeric, unusable, place, named)


def _read_npz(path: Path, form: LogMap) -> _Table:
    """Columns by name, or 2-D blocks (N, J) called q, v, a, tau, current beside the names `joints`."""
    if not zipfile.is_zipfile(path):
        raise InputError(f"{path}: is not an NPZ archive; write it with numpy.savez or frischid.write_log")
    with np.load(path, allow_pickle=False) as file:
        arrays = dict(file.items())
    joints = arrays.pop("joints").tolist() if arrays.get("joints", np.empty(0)).dtype.kind == "U" else []
    for channel in CHANNELS:
        if arrays.get(channel, np.empty(0)).ndim == 2:
            block = arrays.pop(channel)
            if block.shape[1] != len(joints):
                raise InputError(
                    f"{path}: {channel} has {block.shape[1]} columns, but the string array 'joints' names "
                    f"{len(joints)}: {', '.join(joints) or '(none)'}"
                )
            arrays |= {f"{channel}_{joint}": block[:, j] for j, joint in enumerate(joints)}
    # The length most columns have is the log's.
    shape = Counter(x.shape for x in arrays.values() if x.ndim == 1).most_common(1)
    if not shape:
        raise InputError(f"{path}: holds no columns (1-D arrays), only {', '.join(arrays) or 'nothing'}")
    numeric, unusable = {}, {}
    for name, values in arrays.items():
        if values.dtype.kind not in "iufb" or values.shape != shape[0][0]:
            unusable[name] = f"it has type {values.dtype} and shape {values.shape}"
        else:
            numeric[name] = values
    return _Table(str(path), tuple(arrays), numeric, unusable)


def _time(table: _Table, form: LogMap, notes: list[str]) -> tuple[str, Array]:
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
    table: _Table, form: LogMap, joints: Sequence[str] | None, notes: list[str]
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
            raise InputError(
                f"{form.source}: joint '{joint}' has no position column in {table.source}; name q"
            )
        if joint not in chosen:
            notes.append(f"mapping of {joint} not used: the log has no position of it")
    if not chosen:
        raise InputError(f"{table.source}: {_no_joint(table, form, there, joints)}")
    ignored = [joint for joint in there if joint not in chosen]
    if ignored:
        notes.append(f"left out, not joints of the robot: {', '.join(ignored)}")
    left_out = {name for joint in ignored for name in columns_of(joint).values()}
    return {joint: columns_of(joint) for joint in chosen}, left_out


def _no_joint(table: _Table, form: LogMap, there: Sequence[str], joints: Sequence[str] | None) -> str:
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


def _convert(
    table: _Table, form: LogMap, joint: str, columns: Mapping[str, str], notes: list[str]
) -> dict[str, Array]:
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


def _extra(table: _Table, used: set[str], taken: set[str], notes: list[str]) -> dict[str, Array]:
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


# ---- mapping files

UNITS = {"rad": 1.0, "m": 1.0, "deg": np.pi / 180}
SECONDS = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}


@dataclass(frozen=True)
class JointMap:
    """How one joint was recorded; all that is not said is as in a log of our own.

    Attributes
    ----------
    q, v, a, tau, current : str or int, optional
        Column name, or number from 0; otherwise the template under ``[default]``.
    sign : {1, -1}
        Direction of the recorded axis: turns q, v, a, tau and current.
    offset : float
        Added to q after sign, unit and gear [rad or m].
    gear_ratio : float
        Of motor-side columns: q, v, a are divided by it, tau is multiplied.
    torque_sign : {1, -1}
        Further sign of tau and current alone.
    current_gain : float, optional
        Joint-side torque per ampere [N·m/A]: ``tau = current_gain · current`` where there is no tau column.
    tau_from : {"tau", "current"}, optional
        Overrules that choice.
    angle_unit : {"rad", "deg", "m"}, optional
        Unit of this joint, where it differs from the file's (a prismatic joint among degrees: ``"m"``).
    """

    q: str | int | None = None
    v: str | int | None = None
    a: str | int | None = None
    tau: str | int | None = None
    current: str | int | None = None
    sign: int = 1
    offset: float = 0.0
    gear_ratio: float = 1.0
    torque_sign: int = 1
    current_gain: float | None = None
    tau_from: str | None = None
    angle_unit: str | None = None


@dataclass(frozen=True)
class LogMap:
    """What the columns of a file mean; made by `load` or `from_dict`.

    Attributes
    ----------
    time, time_unit, zero_time
        Column of the stamps, its unit (s, ms, us, ns), and whether to subtract the first stamp.
    header, delimiter, columns
        Whether a CSV's first line names the columns, what separates them, and the names if it does not.
    angle_unit : {"rad", "deg"}
        Of all positions, velocities and accelerations.
    default : mapping of str to str
        Template of each channel's column names; ``{joint}`` stands for the joint.
    tau_from : {"tau", "current"}, optional
        As in `JointMap`, for every joint.
    joint : mapping of str to JointMap
    source : str
        The mapping file, for messages.
    """

    time: str | int = "t"
    time_unit: str = "s"
    zero_time: bool = False
    header: bool = True
    delimiter: str | None = None
    columns: tuple[str, ...] = ()
    angle_unit: str = "rad"
    default: Mapping[str, str] = field(default_factory=lambda: {c: f"{c}_{{joint}}" for c in CHANNELS})
    tau_from: str | None = None
    joint: Mapping[str, JointMap] = field(default_factory=dict)
    source: str = "mapping"

    @classmethod
    def of(cls, mapping: LogMap | Mapping[str, Any] | str | Path | None) -> LogMap:
        """Whatever describes a mapping, as a mapping; None is the plain one."""
        if mapping is None:
            return cls()
        if isinstance(mapping, str | Path):
            return cls.load(mapping)
        return mapping if isinstance(mapping, LogMap) else cls.from_dict(mapping)

    @classmethod
    def load(cls, path: str | Path) -> LogMap:
        """Read a mapping from a TOML file."""
        try:
            text = Path(path).read_text(encoding="utf-8")
            return cls.from_dict(tomllib.loads(text), str(path))
        except OSError as error:
            raise InputError(f"{path}: the mapping file cannot be read ({error.strerror})") from error
        except ValueError as error:
            raise InputError(f"{path}: the mapping file is not TOML: {error}") from error

    @classmethod
    def from_dict(cls, content: Mapping[str, Any], source: str = "mapping") -> LogMap:
        """Check the tables [file], [default], [joint.<name>] and [current_gain], and put them together."""
        for key, table in content.items():
            if key not in ("file", "default", "joint", "current_gain"):
                raise UnknownNameError("table", key, ("file", "default", "joint", "current_gain"), source)
            if not isinstance(table, Mapping):
                raise InputError(f"{source}: {key} must be a table, found {table!r}")
        file = _checked(content.get("file", {}), FILE_RULES, f"[file] of {source}")
        if file.get("header", True) and "columns" in file:
            raise InputError(f"{source}: columns = [...] names those of a file with header = false")
        default = _checked(content.get("default", {}), DEFAULT_RULES, f"[default] of {source}")
        tau_from = default.pop("tau_from", None)
        joint = {
            name: _checked(table, JOINT_RULES, f"[joint.{name}] of {source}")
            for name, table in content.get("joint", {}).items()
        }
        for name, gain in content.get("current_gain", {}).items():
            _checked({"current_gain": gain}, JOINT_RULES, f"[current_gain] {name} of {source}")
            if joint.setdefault(name, {}).setdefault("current_gain", gain) != gain:
                raise InputError(f"{source}: joint {name} has two different current gains")
        return cls(
            **file | {"columns": tuple(file.get("columns", ()))},
            default={**cls().default, **default},
            tau_from=tau_from,
            joint={name: JointMap(**table) for name, table in joint.items()},
            source=source,
        )


Rule = tuple[Callable[[Any], bool], str]


def _one_of(*options: Any) -> Rule:
    # true == 1 in Python, but sign = true is a mistake.
    return lambda x: any(
        type(x) is type(o) and x == o for o in options
    ), f"one of {', '.join(map(repr, options))}"


def _is_finite(x: Any) -> bool:
    return isinstance(x, int | float) and not isinstance(x, bool) and bool(np.isfinite(x))


def _is_names(x: Any) -> bool:
    return isinstance(x, list | tuple) and all(isinstance(n, str) for n in x) and len(set(x)) == len(x) > 0


COLUMN: Rule = (
    lambda x: isinstance(x, str) or (isinstance(x, int) and not isinstance(x, bool) and x >= 0),
    "a column name, or a column number from 0",
)
TEMPLATE: Rule = (lambda x: isinstance(x, str) and x.count("{joint}") == 1, "a text with {joint} in it once")
BOOL = _one_of(True, False)
SIGN = _one_of(1, -1)
NONZERO: Rule = (lambda x: _is_finite(x) and x != 0, "a number other than 0")
TAU_FROM = _one_of("tau", "current")

FILE_RULES: dict[str, Rule] = {
    "time": COLUMN,
    "time_unit": _one_of(*SECONDS),
    "zero_time": BOOL,
    "header": BOOL,
    "delimiter": (lambda x: isinstance(x, str) and len(x.encode()) == 1, "one character"),
    "columns": (_is_names, "a list of different names"),
    "angle_unit": _one_of("rad", "deg"),
}
DEFAULT_RULES: dict[str, Rule] = dict.fromkeys(CHANNELS, TEMPLATE) | {"tau_from": TAU_FROM}
JOINT_RULES: dict[str, Rule] = dict.fromkeys(CHANNELS, COLUMN) | {
    "sign": SIGN,
    "offset": (_is_finite, "a number"),
    "gear_ratio": NONZERO,
    "torque_sign": SIGN,
    "current_gain": NONZERO,
    "tau_from": TAU_FROM,
    "angle_unit": _one_of(*UNITS),
}


def _checked(table: Any, rules: Mapping[str, Rule], where: str) -> dict[str, Any]:
    """Keys and values of one table of a mapping file, or an error that lists what it may hold."""
    if not isinstance(table, Mapping):
        raise InputError(f"{where}: expected a table, found {table!r}")
    for key, value in table.items():
        if key not in rules:
            raise UnknownNameError("key", key, rules, where)
        is_right, expected = rules[key]
        if not is_right(value):
            raise InputError(f"{where}: {key} = {value!r}, expected {expected}")
    return dict(table)
