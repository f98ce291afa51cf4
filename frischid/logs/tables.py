"""File formats: CSV, Parquet and NPZ, each as one table of named columns, and back.

Nothing here depends on the meaning of a column. Long files are read as several tables of consecutive rows.
"""

from __future__ import annotations

import csv
import io
import itertools
import lzma
import zipfile
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO, Any

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet
from numpy.typing import NDArray

from frischid.core.files import written
from frischid.core.text import shortened
from frischid.core.types import Array
from frischid.errors import InputError, close_names
from frischid.logs.log import Place, row_place
from frischid.logs.mapping import LogMap
from frischid.logs.npz_arrays import read_npz
from frischid.logs.table import Table, check_width

CSV = (".csv", ".tsv", ".txt")


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
                yield replace(_from_arrow(pa.table(batch), path, _after(start, row_place)), first=start)
                start += batch.num_rows
        else:
            yield from _csv_tables(path, form, rows)


def column_names(path: Path, form: LogMap) -> Sequence[str]:
    """Names of a file's columns, as its table will have them."""
    kind = _kind(path)
    if kind == ".parquet":
        with _reading(path, kind):
            return list(pa.parquet.read_schema(path).names)
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
        raise InputError(f"{path}: cannot read '{path.suffix}' files; supported are {supported}")
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


@dataclass(frozen=True)
class Layout:
    """Layout of a CSV file: its separator, its columns, and the number of lines before the first row."""

    delimiter: str
    names: Sequence[str]
    skip: int
    named: bool


def csv_layout(path: Path, form: LogMap) -> Layout:
    """Find the layout of a CSV file from its first line."""
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        before, line = next(((k, line) for k, line in enumerate(file) if line.strip()), (0, ""))
    # The separator is the most frequent of the usual ones in the first line.
    delimiter = form.delimiter or max(",;\t ", key=lambda c: line.strip(" ").count(c) if c != " " else 0.5)
    try:
        cells = [cell.strip() for cell in next(csv.reader([line.strip("\r\n")], delimiter=delimiter), [])]
    except csv.Error as error:
        raise InputError(f"{path}: line {before + 1} cannot be read as CSV ({error})") from error
    if not cells:
        raise InputError(f"{path}: the file holds only empty lines")
    check_width(path, len(cells))
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
    return Layout(delimiter, names, before + 1 if form.header else before, form.header or bool(form.columns))


def _read_csv(path: Path, form: LogMap) -> Table:
    layout = csv_layout(path, form)
    with _telling_the_line(path, layout):
        arrow = pa.csv.read_csv(path, *_options(layout))
    return _from_arrow(arrow, path, _line_place(path, layout.skip), named=layout.named)


def _csv_tables(path: Path, form: LogMap, rows: int) -> Iterator[Table]:
    """Read a CSV file block by block; integers of the first block become floats, because later blocks may differ."""
    layout = csv_layout(path, form)
    options, parsing = _options(layout)
    options.block_size = max(1 << 16, rows * (path.stat().st_size // _lines_guess(path)))
    with _telling_the_line(path, layout):
        kinds = pa.csv.open_csv(path, options, parsing).schema
        time = form.time if isinstance(form.time, str) else layout.names[form.time]
        loose = [f.name for f in kinds if f.name != time and (pa.types.is_integer(f.type) or pa.types.is_null(f.type))]
        convert = pa.csv.ConvertOptions(column_types=dict.fromkeys(loose, pa.float64()))
        place, start = _line_place(path, layout.skip), 0
        for batch in pa.csv.open_csv(path, options, parsing, convert):
            yield replace(_from_arrow(pa.table(batch), path, _after(start, place), named=layout.named), first=start)
            start += batch.num_rows


def _lines_guess(path: Path) -> int:
    """Approximate number of lines of a file, from its first ones."""
    with path.open("rb") as file:
        head = file.read(1 << 16)
    return max(1, round(path.stat().st_size / max(1.0, len(head) / max(1, head.count(b"\n")))))


def _options(layout: Layout) -> tuple[Any, Any]:
    options = pa.csv.ReadOptions(column_names=list(layout.names), skip_rows=layout.skip)
    return options, pa.csv.ParseOptions(delimiter=layout.delimiter)


@contextmanager
def _telling_the_line(path: Path, layout: Layout) -> Iterator[None]:
    try:
        yield
    except pa.ArrowInvalid as error:
        wrong = _ragged_line(path, layout.delimiter, len(layout.names), layout.skip)
        raise InputError(f"{path}: {wrong or error}") from error


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _line_place(path: Path, skip: int) -> Place:
    """Place of a row as a line of the file; empty lines count as lines but hold no row."""

    def place(row: int) -> str:
        with path.open("rb") as file:
            filled = (k for k, line in enumerate(file) if k >= skip and line.strip(b"\r\n"))
            line = next(itertools.islice(filled, row, None), None)
            return f"row {row + 1}" if line is None else f"line {line + 1}"  # lone carriage returns are lines to Arrow

    return place


def _ragged_line(path: Path, delimiter: str, width: int, skip: int) -> str | None:
    """Description of the lines with too few or too many cells; None without such lines."""
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
        return f"line {line}, the last, holds {cells} cells instead of {width}: the recording was cut; delete it"
    return (
        f"line {line} holds {cells} cells instead of {width} (and {len(wrong) - 1} more such lines); "
        "correct or delete them, nothing is guessed here"
    )


def _read_parquet(path: Path) -> Table:
    check_width(path, pa.parquet.read_metadata(path).num_columns)
    return _from_arrow(pa.parquet.read_table(path), path)


def _from_arrow(arrow: Any, path: Path, place: Place = row_place, named: bool = True) -> Table:
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
    return Table(str(path), tuple(arrow.column_names), numeric, unusable, place, named)


def write_table(table: Mapping[str, Array], path: Path) -> None:
    """Write a CSV, Parquet or NPZ file; it appears under its name only when it is complete."""
    writers = {".csv": _write_csv, ".parquet": _write_parquet, ".npz": _write_npz}
    if path.suffix.lower() not in writers:
        raise InputError(f"{path}: cannot write '{path.suffix}' files; use one of {', '.join(writers)}")
    if path.suffix.lower() == ".csv":
        _check_header(table, path)
    with written(path) as scratch, scratch.open("wb") as file:
        writers[path.suffix.lower()](table, file)


def _check_header(names: Iterable[str], path: Path) -> None:
    """Refuse names that the header of a CSV file would not give back."""
    lost = next((x for x in names if x != x.strip() or "\n" in x or "\r" in x), None)
    if lost is not None:
        raise InputError(
            f"{path}: a CSV file cannot hold a column {shortened(lost)}, whose name has a new line in it or a space at "
            "its end; write .parquet, or rename the joint"
        )


def _write_csv(table: Mapping[str, Array], file: IO[bytes]) -> None:
    csv.writer(header := io.StringIO(), lineterminator="\n").writerow(table)
    file.write(header.getvalue().encode())
    # Arrow writes the fewest digits that give the same double when read.
    pa.csv.write_csv(pa.table(dict(table)), file, pa.csv.WriteOptions(include_header=False))


def _write_parquet(table: Mapping[str, Array], file: IO[bytes]) -> None:
    pa.parquet.write_table(pa.table(dict(table)), file, compression="zstd")


def _write_npz(table: Mapping[str, Array], file: IO[bytes]) -> None:
    # np.savez cannot name a column "file"; a fixed date keeps hashes equal.
    with zipfile.ZipFile(file, "w") as archive:
        for name, values in table.items():
            with archive.open(zipfile.ZipInfo(f"{name}.npy"), "w", force_zip64=True) as member:
                np.lib.format.write_array(member, np.ascontiguousarray(values))
