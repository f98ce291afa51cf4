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
    from frischid.logs.frames import is_frame, log_of_frame

    if not is_frame(item):
        raise refusal(name.partition("[")[0], item)
    return log_of_frame(item, joints, mapping, name=name)


def refusal(name: str, wrong: object) -> InputError:
    """The error of an argument that is no list of logs."""
    return InputError(
        f"{name} must be a list of logs, got {type(wrong).__name__}: {name}=[frischid.read_log(path)]; a data frame "
        "may stand in place of a log"
    )
