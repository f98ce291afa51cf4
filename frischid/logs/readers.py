"""Readers that turn files of measurements, with any names of columns, into a `Log`.

A file is first read as a table of named columns (`frischid.logs.tables`). A mapping (`frischid.logs.mapping`) gives
their meaning. Without a mapping the columns are ``t``, ``q_<joint>``, ``v_<joint>``, ``a_<joint>``, ``tau_<joint>`` and
``current_<joint>``, in SI units, on the joint side of the gear. Each conversion, and each column left out, is a note of
the log.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from frischid.core.types import Array
from frischid.errors import InputError, UnknownNameError
from frischid.logs.bags import bag_form, bag_tables, is_bag, read_bag
from frischid.logs.content_size import check_size
from frischid.logs.conversion import first_stamp, log_of_table
from frischid.logs.layouts import layout_of
from frischid.logs.log import CHANNELS, FEWEST_SAMPLES, Log
from frischid.logs.log_file import LogFile, parts_of, size_of
from frischid.logs.mapping import LogMap, MappingLike
from frischid.logs.table import Table, joined
from frischid.logs.table_writing import write_table
from frischid.logs.tables import read_table, read_tables


def read_log(
    path: str | Path,
    joints: Sequence[str] | None = None,
    mapping: MappingLike = None,
) -> Log:
    """Read a CSV (.csv, .tsv, .txt), Parquet or NPZ file, a ROS bag (.bag, .db3, a ROS 2 folder) or MCAP file.

    Parameters
    ----------
    path : str or Path
    joints : sequence of str, optional
        The robot's joints, in the desired order. Columns of any other joint are left out with a note, and a joint
        without a position column is not in the log. 2-D arrays as wide as this list take its names, if their file
        names no joints.
    mapping : LogMap, mapping, path of a TOML file or list of paths, optional
        Names and units of the columns, where they are not those of frischid. Of several files, and of several layouts
        in one file, the one that fits the log is used.

    Returns
    -------
    Log

    Raises
    ------
    InputError
        The file, a column or a value is not usable; the message names it and its place.

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
    path, given = Path(path), layout_of(Path(path), LogMap.of(mapping))
    check_size(path)
    form = _form(path, joints, given)
    table = read_bag(path, form, joints) if is_bag(path) else read_table(path, form, joints or ())
    log = log_of_table(table, form, joints, first_stamp(table, form), digest=digest_of(path))
    return replace(log, file=file_behind(path, given))


def read_chunks(
    path: str | Path,
    joints: Sequence[str] | None = None,
    mapping: MappingLike = None,
    *,
    samples: int = 65_536,
) -> Iterator[Log]:
    """Read a long file as consecutive logs of about `samples` samples; only one of them is in memory at a time.

    Parameters
    ----------
    path, joints, mapping
        As for `read_log`. An NPZ file is read as a whole, the others are not.
    samples : int

    Yields
    ------
    Log
        Together the logs hold every sample once, and stamps continue from one to the next. They have no `Log.sha256`.

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
    tables = bag_tables(path, form, joints, samples) if is_bag(path) else read_tables(path, form, samples, joints or ())
    start, last = None, -np.inf
    before: Mapping[str, Array] = {}
    for table in _none_too_short(tables):
        start = first_stamp(table, form) if start is None else start
        log = log_of_table(table, form, joints, start, whole=False)
        if log.t[0] == last and _repeats(before, log):
            log = log.slice(1)  # the row before is repeated
        if log.t[0] <= last:
            raise InputError(
                f"{path}: time does not increase at {table.place(0)}: {log.t[0]!s} after {last!s}; remove the repeated "
                "rows, or split the log where the clock was set back"
            )
        last, before = float(log.t[-1]), {c: x[-1] for c in CHANNELS if (x := getattr(log, c)) is not None}
        yield log


def _repeats(before: Mapping[str, Array], log: Log) -> bool:
    """Whether the first sample of a log repeats the last one before it."""
    return all(np.array_equal(x, getattr(log, channel)[0], equal_nan=True) for channel, x in before.items())


def _form(path: Path, joints: Sequence[str] | None, mapping: Any) -> LogMap:
    """The mapping, checked against the robot; stamps of a bag are always nanoseconds."""
    form = layout_of(path, LogMap.of(mapping))
    for name in form.joint:
        if joints is not None and name not in joints:
            raise UnknownNameError("joint", name, joints, form.source)
    return bag_form(form) if is_bag(path) else form


def _none_too_short(tables: Iterator[Table]) -> Iterator[Table]:
    """The same tables; a last one that is too short for a log is joined to the one before."""
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


def digest_of(path: Path) -> str:
    """Hash of a file, or of all files of a folder in the order of their names."""
    digest = hashlib.sha256()
    for part in parts_of(path):
        with part.open("rb") as file:
            while block := file.read(1 << 20):
                digest.update(block)
    return digest.hexdigest()


def file_behind(path: Path, form: LogMap) -> LogFile | None:
    """The file of a log and its mapping file; None where the mapping was written in Python, and is in no file."""
    if form.file is None and form != LogMap():
        return None
    return LogFile(str(path.absolute()), size_of(path), form.file)


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
