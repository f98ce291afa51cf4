"""The layout of a CSV file, from its first lines: separator, columns, decimal sign, encoding, and the first row."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from frischid.core.text import counted
from frischid.errors import InputError
from frischid.logs.csv_text import (
    COMMENT_SIGNS,
    cells_of,
    encoding_of,
    first_lines,
    has_decimal_comma,
    header_of,
    is_line_of_units,
    is_number,
    not_readable,
    separator_of,
)
from frischid.logs.mapping import LogMap
from frischid.logs.table import check_width


@dataclass(frozen=True)
class Layout:
    """Layout of a CSV file: its separator, its columns, and the number of lines before the first row."""

    delimiter: str
    names: Sequence[str]
    skip: int
    named: bool
    encoding: str = "utf-8"
    decimal_comma: bool = False
    notes: tuple[str, ...] = ()


def csv_layout(path: Path, form: LogMap) -> Layout:
    """Find the layout of a CSV file from its first lines."""
    encoding = encoding_of(path)
    lines = first_lines(path, encoding)
    at = header_of(lines, form.delimiter)
    before, line = lines[at] if lines else (0, "")
    delimiter = form.delimiter or separator_of(line)
    try:
        cells = cells_of(line, delimiter)
    except csv.Error as error:
        raise not_readable(path, before, error) from error
    if not any(cells):
        raise InputError(f"{path}: the file holds only empty lines")
    check_width(path, len(cells))
    comma = has_decimal_comma(lines[at : at + 50], delimiter)
    if form.header and all(is_number(cell, comma=comma) for cell in cells):
        raise InputError(
            f"{path}: line {before + 1} should name the columns but holds {len(cells)} numbers; if the file "
            "has no header, set header = false and columns = [...] under [file] in a mapping file"
        )
    if form.header and at:
        cells[0] = cells[0].lstrip(COMMENT_SIGNS + " ")
    names = cells if form.header else list(form.columns) or [str(i) for i in range(len(cells))]
    if len(names) != len(cells):
        raise InputError(
            f"{path}: line {before + 1} holds {len(cells)} cells, {form.source} names {len(names)} columns"
        )
    notes = [f"{counted(at, 'line')} before line {before + 1} left out: no names of columns"] if at else []
    notes += ["numbers have a decimal comma"] if comma else []
    notes += [f"text in {encoding}"] if encoding != "utf-8" else []
    skip, named = before + 1 if form.header else before, form.header or bool(form.columns)
    if form.header and is_line_of_units(lines[at + 1 :], delimiter):
        skip = lines[at + 1][0] + 1
        notes.append(f"line {skip} left out: it holds no number (units?)")
    return Layout(delimiter, names, skip, named, encoding, comma, tuple(notes))
