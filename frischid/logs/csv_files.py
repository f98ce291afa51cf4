"""CSV files as tables: numbers in lines, however the file is laid out (`frischid.logs.csv_layout`).

An error in a line names the line.
"""

from __future__ import annotations

import csv
import itertools
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.csv

from frischid.errors import InputError
from frischid.logs.arrow_columns import table_of_arrow
from frischid.logs.csv_layout import Layout, csv_layout, even_spaces
from frischid.logs.log import Place
from frischid.logs.mapping import LogMap
from frischid.logs.table import Table, place_after

CSV = (".csv", ".tsv", ".txt")


def read_csv(path: Path, form: LogMap, _joints: Sequence[str] = ()) -> Table:
    """Read a file as a whole."""
    layout = csv_layout(path, form)
    with _telling_the_line(path, layout):
        arrow = pa.csv.read_csv(_text(path, layout), *_options(layout), _conversion(layout))
    table = table_of_arrow(arrow, path, _line_place(path, layout.skip), layout=layout)
    return replace(table, notes=(*layout.notes, *table.notes))


def csv_chunks(path: Path, form: LogMap, rows: int, _joints: Sequence[str] = ()) -> Iterator[Table]:
    """Read a file block by block; integers of the first block become floats, because later blocks may differ.

    A column that is empty in the first block is read as texts, which later may be numbers.
    """
    layout = csv_layout(path, form)
    options, parsing = _options(layout)
    options.block_size = max(1 << 16, rows * (path.stat().st_size // _lines_guess(path)))
    with _telling_the_line(path, layout):
        kinds = pa.csv.open_csv(_text(path, layout), options, parsing, _conversion(layout)).schema
        time = form.time if isinstance(form.time, str) else layout.names[form.time]
        convert = _conversion(layout)
        whole = [f.name for f in kinds if f.name != time and pa.types.is_integer(f.type)]
        empty = [f.name for f in kinds if pa.types.is_null(f.type)]
        convert.column_types = dict.fromkeys(whole, pa.float64()) | dict.fromkeys(empty, pa.string())
        place, start = _line_place(path, layout.skip), 0
        for batch in pa.csv.open_csv(_text(path, layout), options, parsing, convert):
            yield replace(table_of_arrow(pa.table(batch), path, place_after(start, place), layout=layout), first=start)
            start += batch.num_rows


def csv_names(path: Path, form: LogMap) -> Sequence[str]:
    """Names of a file's columns: those of its header, or of its layout."""
    return csv_layout(path, form).names


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
