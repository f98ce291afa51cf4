"""File formats: CSV, Parquet and NPZ, each as one table of named columns.

Nothing here depends on the meaning of a column. Long files are read as several tables of consecutive rows.
"""

from __future__ import annotations

import csv
import itertools
import lzma
import zipfile
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute
import pyarrow.csv
import pyarrow.parquet
from numpy.typing import NDArray

from frischid.core.text import counted
from frischid.errors import InputError, close_names
from frischid.logs.csv_layout import (
    Layout,
    clock_of,
    csv_layout,
    even_spaces,
    is_number,
)
from frischid.logs.list_columns import flattened, names_in
from frischid.logs.log import Place, row_place
from frischid.logs.mapping import LogMap
from frischid.logs.npz_arrays import read_npz
from frischid.logs.table import Table, check_width

CSV = (".csv", ".tsv", ".txt")
SPREADSHEET = "save the sheet as CSV"
OTHER_FORMATS = {
    ".xlsx": SPREADSHEET,
    ".xls": SPREADSHEET,
    ".ods": SPREADSHEET,
    ".mat": "in MATLAB: writetable(array2table([t q tau]), 'log.csv'), with t as a column and a column per joint in q",
    ".h5": "in Python: pandas.read_hdf(...).to_csv('log.csv', index=False)",
    ".json": "in Python: pandas.json_normalize(json.load(open(...))).to_parquet('log.parquet')",
    ".jsonl": "in Python: pandas.read_json(..., lines=True).to_parquet('log.parquet')",
    ".xml": "write a .csv with one row per message: the time (RSI: IPOC, in ms), and one column per axis",
    ".log": "if the file is a table of text, rename it to .csv",
    ".dat": "if the file is a table of text, rename it to .csv",
    ".asc": "if the file is a table of text, rename it to .csv",
}
"""The commands that turn files of other formats into one that can be read."""


def joined(tables: Sequence[Table]) -> Table:
    """Join tables of consecutive rows to one table."""
    first = tables[0]
    unusable = {name: why for table in tables for name, why in table.unusable.items()}
    names = [name for name in first.names if name not in unusable]
    columns = {name: np.concatenate([table.numeric[name] for table in tables]) for name in names}
    return replace(first, numeric=columns, unusable=unusable, notes=tables[-1].notes)


def read_table(path: Path, form: LogMap, order: Sequence[str] = ()) -> Table:
    """Read a CSV (.csv, .tsv, .txt), Parquet or NPZ file as a table.

    `form` describes the layout of a CSV; `order` names the columns of 2-D arrays whose file names no joints.
    """
    kind = _kind(path)
    with _reading(path, kind):
        if kind == ".npz":
            return read_npz(path, form, order)
        return _read_parquet(path) if kind == ".parquet" else _read_csv(path, form)


def read_tables(path: Path, form: LogMap, rows: int, order: Sequence[str] = ()) -> Iterator[Table]:
    """Read such a file as tables of about `rows` consecutive rows; an NPZ file is in memory as a whole."""
    kind = _kind(path)
    with _reading(path, kind):
        if kind == ".npz":
            whole = read_npz(path, form, order)
            for start in range(0, whole.rows, rows):
                part = {name: x[start : start + rows] for name, x in whole.numeric.items()}
                yield replace(whole, numeric=part, place=_after(start, whole.place), first=start)
        elif kind == ".parquet":
            start = 0
            # Reading ahead would keep whole row groups in memory, which may be most of a long file.
            file = pa.parquet.ParquetFile(path, pre_buffer=False, buffer_size=1 << 16)
            check_width(path, file.metadata.num_columns)
            for batch in file.iter_batches(batch_size=rows):
                part = flattened(pa.table(batch), path)
                yield replace(_from_arrow(part, path, _after(start, row_place)), first=start)
                start += batch.num_rows
        else:
            yield from _csv_tables(path, form, rows)


def column_names(path: Path, form: LogMap) -> Sequence[str]:
    """Names of a file's columns, as its table will have them."""
    kind = _kind(path)
    if kind == ".parquet":
        with _reading(path, kind):
            return names_in(path)
    return csv_layout(path, form).names if kind in CSV else read_table(path, form).names


def _after(start: int, place: Place) -> Place:
    return lambda row: place(start + row)


def _kind(path: Path) -> str:
    """Suffix of a file that can be read; otherwise an error with the reason."""
    supported = ", ".join((*CSV, ".parquet", ".npz", ".bag", ".db3", ".mcap"))
    if path.is_dir():
        raise InputError(f"{path}: is a folder; give one file ({supported}), or the folder of a ROS 2 bag")
    if not path.exists():
        close = close_names(path.name, (p.name for p in path.parent.glob("*")))
        hint = f"; did you mean {', '.join(close)}?" if close else ""
        if not path.parent.is_dir():
            hint = f", and no folder {path.parent}; check the path"
        raise InputError(f"{path}: there is no such file{hint}")
    kind = path.suffix.lower()
    if kind not in (*CSV, ".parquet", ".npz"):
        hint = f"; {how}" if (how := OTHER_FORMATS.get(kind)) else ""
        raise InputError(f"{path}: cannot read '{path.suffix}' files; supported are {supported}{hint}")
    if path.stat().st_size == 0:
        raise InputError(f"{path}: the file is empty")
    return kind


@contextmanager
def _reading(path: Path, kind: str) -> Iterator[None]:
    try:
        yield
    except (OSError, ValueError, EOFError, zipfile.BadZipFile, zlib.error, pa.ArrowException) as error:
        raise InputError(f"{path}: cannot be read as {kind[1:]} ({error}); was it copied completely?") from error
    except (RuntimeError, lzma.LZMAError) as error:  # encrypted, or of a compression that Python does not know
        raise InputError(f"{path}: cannot be read as {kind[1:]} ({error}); write it without password") from error
    except MemoryError as error:
        raise InputError(f"{path}: its columns do not fit into memory ({error}); is it damaged?") from error


def _read_csv(path: Path, form: LogMap) -> Table:
    layout = csv_layout(path, form)
    with _telling_the_line(path, layout):
        arrow = pa.csv.read_csv(_text(path, layout), *_options(layout), _conversion(layout))
    table = _from_arrow(arrow, path, _line_place(path, layout.skip), layout=layout)
    return replace(table, notes=(*layout.notes, *table.notes))


def _csv_tables(path: Path, form: LogMap, rows: int) -> Iterator[Table]:
    """Read a CSV file block by block; integers of the first block become floats, because later blocks may differ."""
    layout = csv_layout(path, form)
    options, parsing = _options(layout)
    options.block_size = max(1 << 16, rows * (path.stat().st_size // _lines_guess(path)))
    with _telling_the_line(path, layout):
        kinds = pa.csv.open_csv(_text(path, layout), options, parsing, _conversion(layout)).schema
        time = form.time if isinstance(form.time, str) else layout.names[form.time]
        loose = [f.name for f in kinds if f.name != time and (pa.types.is_integer(f.type) or pa.types.is_null(f.type))]
        convert = _conversion(layout)
        convert.column_types = dict.fromkeys(loose, pa.float64())
        place, start = _line_place(path, layout.skip), 0
        for batch in pa.csv.open_csv(_text(path, layout), options, parsing, convert):
            yield replace(_from_arrow(pa.table(batch), path, _after(start, place), layout=layout), first=start)
            start += batch.num_rows


def _lines_guess(path: Path) -> int:
    """Approximate number of lines of a file, from its first ones."""
    with path.open("rb") as file:
        head = file.read(1 << 16)
    return max(1, round(path.stat().st_size / max(1.0, len(head) / max(1, head.count(b"\n")))))


def _text(path: Path, layout: Layout) -> Any:
    """The file for Arrow; columns that are filled up with spaces are evened out, in memory."""
    return even_spaces(path, layout.encoding) if layout.delimiter == " " else path


def _options(layout: Layout) -> tuple[Any, Any]:
    names, encoding = (
        list(layout.names),
        "utf8" if layout.encoding == "utf-8" or layout.delimiter == " " else layout.encoding,
    )
    options = pa.csv.ReadOptions(column_names=names, skip_rows=layout.skip, encoding=encoding)
    return options, pa.csv.ParseOptions(delimiter=layout.delimiter)


def _conversion(layout: Layout) -> Any:
    return pa.csv.ConvertOptions(decimal_point="," if layout.decimal_comma else ".")


@contextmanager
def _telling_the_line(path: Path, layout: Layout) -> Iterator[None]:
    try:
        yield
    except pa.ArrowInvalid as error:
        wrong = _ragged_line(path, layout)
        raise InputError(f"{path}: {wrong or error}") from error


def _line_place(path: Path, skip: int) -> Place:
    """Place of a row as a line of the file; empty lines count as lines but hold no row."""

    def place(row: int) -> str:
        with path.open("rb") as file:
            filled = (k for k, line in enumerate(file) if k >= skip and line.strip(b"\r\n"))
            line = next(itertools.islice(filled, row, None), None)
            return f"row {row + 1}" if line is None else f"line {line + 1}"  # lone carriage returns are lines to Arrow

    return place


def _ragged_line(path: Path, layout: Layout) -> str | None:
    """Description of the lines with too few or too many cells; None without such lines."""
    width, skip = len(layout.names), layout.skip
    encoding = "utf-8-sig" if layout.encoding == "utf-8" else layout.encoding
    with path.open(newline="", encoding=encoding, errors="replace") as file:
        text = (" ".join(line.split()) if layout.delimiter == " " else line for line in file)
        rows = csv.reader(itertools.islice(text, skip, None), delimiter=layout.delimiter)
        try:
            wrong = [(skip + rows.line_num, len(row)) for row in rows if row and len(row) != width]
        except csv.Error:
            return None
    if not wrong:
        return None
    line, cells = wrong[0]
    if line == skip + rows.line_num:
        return f"line {line}, the last, holds {cells} cells instead of {width}: the recording was cut; delete it"
    return (
        f"line {line} holds {cells} cells instead of {width} (and {len(wrong) - 1} more such lines); "
        "correct or delete them, nothing is guessed here"
    )


def _read_parquet(path: Path) -> Table:
    check_width(path, pa.parquet.read_metadata(path).num_columns)
    return _from_arrow(flattened(pa.parquet.read_table(path), path), path)


def _from_arrow(arrow: Any, path: Path, place: Place = row_place, layout: Layout | None = None) -> Table:
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
    cells = column.to_pylist()
    wrong = ((k, x) for k, x in enumerate(cells) if x is not None and not is_number(x, comma=comma))
    row, cell = next(wrong, (0, cells[0]))
    if row == 0 and (stamps := clock_of(cells)) is not None:
        return stamps, "times as nanoseconds since the first"
    return None, f"{place(row)} holds {cell!r}"


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
