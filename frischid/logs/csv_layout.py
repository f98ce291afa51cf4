"""The layout of a CSV file, from its first lines: separator, columns, decimal sign, encoding, and the first row.

People bring files of spreadsheets and of controllers. A byte order mark says UTF-16; bytes that are no UTF-8 are taken
as Windows-1252. Cells as ``1,5`` have a decimal comma (between quotes, or beside another separator). The header is
the first line after which two more lines have as many cells; before it stands a preamble. A line of units may follow.
"""

from __future__ import annotations

import codecs
import csv
import io
import mmap
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from frischid.core.text import counted
from frischid.errors import InputError
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
    comma = has_decimal_comma(lines[at : at + 50], delimiter) or _comma_below(path, delimiter, encoding)
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


LINES_LOOKED_AT = 200
"""Lines of a preamble; robots' controllers write a few dozen."""
SEPARATORS = ",;\t "
COMMENT_SIGNS = "#%"


def encoding_of(path: Path) -> str:
    """Name of the encoding of a text file, for Python and for Arrow."""
    with path.open("rb") as file:
        head = file.read(1 << 20)
    if head.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return "utf-16"
    try:
        codecs.getincrementaldecoder("utf-8")().decode(head)
    except UnicodeDecodeError:
        return "cp1252" if b"\0" not in head else "utf-8"
    return "utf-8"


def lines_of(path: Path, encoding: str) -> Iterator[str]:
    """Lines of a text file, without the byte order mark."""
    with path.open(encoding="utf-8-sig" if encoding == "utf-8" else encoding, errors="replace") as file:
        yield from file


def separator_of(line: str) -> str:
    """The most frequent of the usual separators in a line; a space only where there is no other."""
    return max(SEPARATORS, key=lambda c: line.strip(" ").count(c) if c != " " else 0.5)


def cells_of(line: str, delimiter: str) -> list[str]:
    """Cells of one line, without spaces around them."""
    line = " ".join(line.split()) if delimiter == " " else line.strip("\r\n")
    return [cell.strip() for cell in next(csv.reader(io.StringIO(line), delimiter=delimiter), [])]


def header_of(lines: Sequence[tuple[int, str]], delimiter: str | None) -> int:
    """Which of the first filled lines names the columns: 0, or the line after a preamble."""

    def width(k: int, separator: str) -> int:
        return len(_cells(lines[k][1], separator))

    for k in range(len(lines) - 2):
        if lines[k + 1][1].lstrip()[:1] in COMMENT_SIGNS:
            continue
        separator = delimiter or separator_of(lines[k][1])
        count = width(k, separator)
        if k == 0 and count > 1 and count == width(1, separator):
            return 0
        if count > 1 and count == width(k + 1, separator) == width(k + 2, separator):
            return k
    return 0


def first_lines(path: Path, encoding: str) -> list[tuple[int, str]]:
    """The first filled lines, each with its number from 0."""
    return list(islice(((k, line) for k, line in enumerate(lines_of(path, encoding)) if line.strip()), LINES_LOOKED_AT))


def has_decimal_comma(lines: Sequence[tuple[int, str]], delimiter: str) -> bool:
    """Whether a cell of these lines is a number with a decimal comma."""
    return any(re.fullmatch(r"[-+]?\d*,\d+([eE][-+]?\d+)?", cell) for _, x in lines for cell in _cells(x, delimiter))


def _comma_below(path: Path, delimiter: str, encoding: str) -> bool:
    """Whether the first lines with a comma, anywhere in a file of another separator, have a decimal comma.

    A robot that rests at the start of a log may have whole numbers in hundreds of lines.
    """
    if delimiter == ",":
        return False
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        lines = [(0, line) for line in _lines_with(b",", data, encoding)]
        if not has_decimal_comma(lines, delimiter):
            return False
        pointed = (cell for line in _lines_with(b".", data, encoding) for cell in _cells(line, delimiter))
        return not any("." in cell and is_number(cell) for cell in pointed)  # a text such as 3,4 beside 0.5 is none


def _lines_with(sign: bytes, data: mmap.mmap, encoding: str) -> Iterator[str]:
    """The first lines of a file that hold a sign."""
    place = data.find(sign)
    for _ in range(LINES_LOOKED_AT):
        if place < 0:
            break
        start, end = data.rfind(b"\n", 0, place) + 1, data.find(b"\n", place)
        end = len(data) if end < 0 else end
        yield data[start:end].replace(b"\0", b"").decode("utf-8" if encoding == "utf-16" else encoding, "replace")
        place = data.find(sign, end)


def is_line_of_units(lines: Sequence[tuple[int, str]], delimiter: str) -> bool:
    """Whether the first of these lines holds no number, while the second holds some."""
    if len(lines) < 2:
        return False
    one, two = ([is_number(c, comma=True) for c in _cells(x, delimiter) if c] for _, x in lines[:2])
    return bool(one) and not any(one) and any(two)


def even_spaces(path: Path, encoding: str) -> io.BytesIO:
    """The text with one space where columns are filled up with several."""
    return io.BytesIO("".join(" ".join(line.split()) + "\n" for line in lines_of(path, encoding)).encode())


FORMS_OF_DATES = (
    *(f"{day}%H:%M:%S{part}" for part in (".%f", ",%f", "") for day in ("", "%d.%m.%Y ", "%Y/%m/%d ", "%m/%d/%Y ")),
)
"""Of stamps that are texts. A month and a day that are exchanged change no difference between stamps of one day."""


def clock_of(cells: Sequence[str | None]) -> NDArray[np.int64] | None:
    """Nanoseconds of cells that are all times of day or dates of one form, (N,); None where they are not."""
    for form in FORMS_OF_DATES:
        try:
            stamps = [datetime.strptime(str(cell).strip(), form) for cell in cells]
        except ValueError:
            continue
        since = [stamp - stamps[0] for stamp in stamps]
        return np.array([10**9 * (86400 * x.days + x.seconds) + 1000 * x.microseconds for x in since], dtype=np.int64)
    return None


def is_number(cell: str, *, comma: bool = False) -> bool:
    """Whether a cell is a number."""
    try:
        float(cell.replace(",", ".") if comma else cell)
    except ValueError:
        return False
    return True


def _cells(line: str, delimiter: str) -> list[str]:
    try:
        return cells_of(line, delimiter)
    except csv.Error:
        return []


def not_readable(path: Path, line: int, error: csv.Error) -> InputError:
    """Error for a line that is no CSV."""
    return InputError(f"{path}: line {line + 1} cannot be read as CSV ({error})")
