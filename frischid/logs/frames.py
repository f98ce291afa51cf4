"""Data frames as logs: pandas, polars, pyarrow and whatever else narwhals knows."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from typing import Any

import narwhals as nw
import numpy as np
from numpy.typing import NDArray

from frischid.errors import InputError
from frischid.logs.conversion import first_stamp, log_of_table
from frischid.logs.log import Log
from frischid.logs.mapping import LogMap, MappingLike
from frischid.logs.table import Table


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
    except nw.exceptions.DuplicateError:
        raise InputError(f"{name}: two columns have the same name; rename one") from None
    numeric: dict[str, NDArray[Any]] = {}
    unusable: dict[str, str] = {}
    notes: list[str] = []
    digest = hashlib.sha256()
    titles = [str(title) for title in columns.columns]  # pandas also has numbers and tuples as names
    for title, column in zip(titles, columns.iter_columns(), strict=True):
        if title in numeric or title in unusable:
            raise InputError(f"{name}: two columns are called '{title}'; rename one")
        values = column.to_numpy()
        if values.dtype.kind == "M" and not np.isnat(values).any():  # as in a file
            values = values.astype("datetime64[ns]").astype(np.int64)
            notes.append(f"{title}: dates as nanoseconds since 1970")
        if values.dtype.kind in "fiub":
            numeric[title] = values
            digest.update(title.encode() + np.ascontiguousarray(values).tobytes())
        else:
            unusable[title] = f"its values are of type {column.dtype}"
    table = Table(name, tuple(titles), numeric, unusable, notes=tuple(notes))
    form = LogMap.of(mapping)
    if form.layouts:
        raise InputError(f"{name}: the mapping has several layouts; give the one of this frame")
    return log_of_table(table, form, joints, first_stamp(table, form), digest=digest.hexdigest())


def is_frame(given: Any) -> bool:
    """Whether narwhals knows this object as a data frame in memory."""
    try:
        return isinstance(nw.from_native(given, eager_only=True, pass_through=True), nw.DataFrame)
    except nw.exceptions.DuplicateError:  # `log_of_frame` says so
        return True
