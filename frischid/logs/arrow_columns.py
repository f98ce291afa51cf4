"""Columns of an Arrow table as numbers; CSV and Parquet files are read by Arrow.

Dates and clock times become nanoseconds. Lines that repeat the header are left out, because files that were put
together have such lines.
"""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute
from numpy.typing import NDArray

from frischid.core.text import counted
from frischid.errors import InputError
from frischid.logs.csv_layout import Layout, clock_of, is_number
from frischid.logs.log import Place, row_place
from frischid.logs.table import Table


def table_of_arrow(arrow: Any, path: Path, place: Place = row_place, layout: Layout | None = None) -> Table:
    """The columns of an Arrow table; `layout` is that of a CSV file."""
    numeric: dict[str, NDArray[Any]] = {}
    unusable: dict[str, str] = {}
    comma, notes = layout is not None and layout.decimal_comma, []
    again = _repeated_headers(arrow)
    if again.any():
        lines = counted(int(again.sum()), "line")
        notes.append(f"{lines} like the header left out, the first at {place(int(again.argmax()))}")
        arrow, kept, every = _without(arrow, again, comma), np.flatnonzero(~again), place

        def place(row: int) -> str:
            return every(int(kept[row]))

    for name, column in zip(arrow.column_names, arrow.columns, strict=True):
        if name in numeric or name in unusable:
            raise InputError(f"{path}: two columns are called '{name}'; rename one")
        values, said = _numbers_of(column, place, comma)
        if values is None:
            unusable[name] = said
        else:
            numeric[name] = values
            notes += [f"{name}: {said}"] if said else []
    named = layout is None or layout.named
    return Table(str(path), tuple(arrow.column_names), numeric, unusable, place, named, tuple(notes))


def _numbers_of(column: Any, place: Place, comma: bool) -> tuple[NDArray[Any] | None, str]:
    """Numbers of a column, and a note on how they were made; None and the reason where there are none."""
    kind = column.type
    if pa.types.is_null(kind) or pa.types.is_boolean(kind):
        return column.cast(pa.float64() if pa.types.is_null(kind) else pa.int8()).to_numpy(), ""
    if pa.types.is_integer(kind) or pa.types.is_floating(kind):
        return column.to_numpy(), ""
    if pa.types.is_timestamp(kind) and not column.null_count:
        values = column.cast(pa.timestamp("ns", kind.tz)).cast(pa.int64()).to_numpy()
        return values, "dates as nanoseconds since 1970"
    if not (pa.types.is_string(kind) or pa.types.is_large_string(kind)):
        return None, f"its values are of type {kind}"
    if (numbers := _of_texts(column, comma)) is not None:
        return numbers, ""
    cells = column.to_pylist()
    wrong = ((k, x) for k, x in enumerate(cells) if x is not None and not is_number(x, comma=comma))
    row, cell = next(wrong, (0, cells[0]))
    if row == 0 and (stamps := clock_of(cells)) is not None:
        return stamps, "times as nanoseconds since the first"
    return None, f"{place(row)} holds {cell!r}"


def _of_texts(column: Any, comma: bool) -> NDArray[Any] | None:
    """Numbers of a column of texts that are all numbers, or empty; None of others.

    The first block of a file gives its columns their types. There a column may be empty, or hold a second header.
    """
    empty = pa.compute.equal(column, "")
    column = pa.compute.if_else(empty, pa.scalar(None, column.type), column)
    if comma and pa.compute.any(pa.compute.match_substring(column, ".")).as_py():  # 1.000 may be a thousand
        return None
    with suppress(pa.ArrowInvalid):
        return np.asarray((pa.compute.replace_substring(column, ",", ".") if comma else column).cast(pa.float64()))
    return None


def _repeated_headers(arrow: Any) -> NDArray[np.bool_]:
    """Rows whose cells are the names of the columns, (N,): files that were put together repeat their header."""
    found = np.zeros(arrow.num_rows, bool)
    texts = [
        name for name, kind in zip(arrow.column_names, arrow.schema.types, strict=True) if pa.types.is_string(kind)
    ]
    if not texts or len(texts) < arrow.num_columns or len(set(texts)) < len(texts):
        return found
    found[:] = True
    for name in texts:
        cells = pa.compute.utf8_trim_whitespace(arrow.column(name))
        found &= pa.compute.equal(cells, name).fill_null(False).to_numpy()
        if not found.any():
            break
    return found


def _without(arrow: Any, rows: NDArray[np.bool_], comma: bool) -> Any:
    """A table of texts without these rows; columns that then are numbers become numbers."""
    arrow = arrow.filter(pa.array(~rows))
    for k, name in enumerate(arrow.column_names):
        column = arrow.column(name)
        text = pa.compute.replace_substring(column, ",", ".") if comma else column
        with suppress(pa.ArrowInvalid):
            arrow = arrow.set_column(k, name, text.cast(pa.float64()))
    return arrow
