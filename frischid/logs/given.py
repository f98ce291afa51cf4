"""Logs as a caller gives them: logs, recordings and data frames, alone or in a list.

Results name their logs. So logs in memory that share a name, such as two simulations, get numbers: ``simulated``,
``simulated (2)``.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import partial
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from frischid.core.remembered import Remembered
from frischid.errors import InputError
from frischid.logs.log import Log
from frischid.logs.mapping import MappingLike
from frischid.logs.recording import Recording

if TYPE_CHECKING:
    from narwhals.typing import IntoDataFrame
import hashlib

import narwhals as nw
import numpy as np
from numpy.typing import NDArray

from frischid.logs.conversion import first_stamp, log_of_table
from frischid.logs.mapping import LogMap
from frischid.logs.table import Table

Logs: TypeAlias = "IntoDataFrame | Sequence[Log | Recording | IntoDataFrame]"
"""The logs that a function takes: a list of logs, recordings and data frames, or one data frame."""
_NUMBERED = Remembered[Log]()  # what is remembered of a log holds for its numbered copy in the next call too


def as_logs(
    given: Logs, joints: Sequence[str], mapping: MappingLike = None, name: str = "logs"
) -> list[Log | Recording]:
    """Logs of what a caller gave, each with its own name; each data frame becomes a log.

    Parameters
    ----------
    joints : sequence of str
        The robot's joints.
    mapping : LogMap, mapping or path of a TOML file, optional
        Names and units of the columns of the data frames.
    name : str
        Name of the argument in messages.

    Raises
    ------
    InputError
        An item is neither a log nor a data frame, or a frame cannot be read as a log.

    Examples
    --------
    >>> import numpy as np
    >>> import pyarrow as pa
    >>> from frischid.logs.given import as_logs
    >>> frame = pa.table({"t": np.arange(20) / 100, "q_elbow": np.linspace(0, 1, 20)})
    >>> [log.source for log in as_logs(frame, ["elbow"])]
    ['logs[0]']
    """
    if isinstance(given, Log | Recording | str | Path):
        raise refusal(name, given)
    items: list[Any] = list(given) if isinstance(given, Sequence) else [given]
    return _numbered(_log(item, f"{name}[{k}]", joints, mapping) for k, item in enumerate(items))


def whole_logs(given: Logs, joints: Sequence[str], mapping: MappingLike = None, name: str = "logs") -> list[Log]:
    """As `as_logs`, but no recording, whose samples are not in memory."""
    found = as_logs(given, joints, mapping, name)
    for log in found:
        if isinstance(log, Recording):
            raise InputError(f"{log.source}: a whole log is needed here; read the file with frischid.read_log")
    return [log for log in found if isinstance(log, Log)]


def _numbered(logs: Iterable[Log | Recording]) -> list[Log | Recording]:
    """The logs, with a number behind the name of each that has the name of one before; no two get one name."""
    found, names = list[Log | Recording](), set[str]()
    for log in logs:
        if log.source in names and isinstance(log, Log):
            again = next(name for k in count(2) if (name := f"{log.source} ({k})") not in names)
            log = _NUMBERED.of(log, again, partial(replace, log, source=again))
        names.add(log.source)
        found.append(log)
    return found


def _log(item: Any, name: str, joints: Sequence[str], mapping: MappingLike) -> Log | Recording:
    if isinstance(item, Log | Recording):
        return item
    from frischid.logs.given import is_frame, log_of_frame

    if not is_frame(item):
        raise refusal(name.partition("[")[0], item)
    return log_of_frame(item, joints, mapping, name=name)


def refusal(name: str, wrong: object) -> InputError:
    """The error of an argument that is no list of logs."""
    return InputError(
        f"{name} must be a list of logs, got {type(wrong).__name__}: {name}=[frischid.read_log(path)]; a data frame "
        "may stand in place of a log"
    )


def log_of_frame(
    frame: Any, joints: Sequence[str] | None = None, mapping: MappingLike = None, *, name: str = "frame"
) -> Log:
    """A log from the columns of a data frame.

    Parameters
    ----------
    frame : pandas.DataFrame, polars.DataFrame, pyarrow.Table, or another that narwhals knows
    joints : sequence of str, optional
        The robot's joints, in the desired order.
    mapping : LogMap, mapping or path of a TOML file, optional
        Names and units of the columns, as for `frischid.read_log`.
    name : str
        Name of the log in messages.

    Returns
    -------
    Log

    Raises
    ------
    InputError
        The argument is no data frame, or a column or a value is not usable.

    Examples
    --------
    >>> import numpy as np
    >>> import pyarrow as pa
    >>> import frischid as fr
    >>> frame = pa.table({"t": np.arange(20) / 100, "q_elbow": np.linspace(0, 1, 20)})
    >>> fr.log_of_frame(frame).joints
    ('elbow',)
    """
    try:
        columns = nw.from_native(frame, eager_only=True)
    except TypeError:
        raise InputError(
            f"{name}: expected a data frame of pandas, polars or pyarrow, got {type(frame).__name__}; read a file with "
            "frischid.read_log"
        ) from None
    numeric: dict[str, NDArray[Any]] = {}
    unusable: dict[str, str] = {}
    digest = hashlib.sha256()
    for title in columns.columns:
        values = columns[title].to_numpy()
        if values.dtype.kind in "fiu":
            numeric[title] = values
            digest.update(title.encode() + np.ascontiguousarray(values).tobytes())
        else:
            unusable[title] = f"its values are of type {columns[title].dtype}"
    table = Table(name, tuple(columns.columns), numeric, unusable)
    form = LogMap.of(mapping)
    if form.layouts:
        raise InputError(f"{name}: the mapping has several layouts; give the one of this frame")
    return log_of_table(table, form, joints, first_stamp(table, form), digest=digest.hexdigest())


def is_frame(given: Any) -> bool:
    """Whether narwhals knows this object as a data frame in memory."""
    return isinstance(nw.from_native(given, eager_only=True, pass_through=True), nw.DataFrame)
