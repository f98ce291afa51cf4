"""File formats: CSV, Parquet and NPZ, each as one table of named columns, and back.

Nothing here knows what a column means; a `Table` only says which of its columns are numbers, why the others
are not, and where in the file a row lies.
"""

from __future__ import annotations

import csv
import io
import itertools
import os
import zipfile
import zlib
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet
from numpy.typing import NDArray

from frischid.errors import InputError, UnknownNameError, close_names
from frischid.log import CHANNELS, Array, Place, row_place
from frischid.mapping import LogMap


@dataclass(frozen=True)
class Table:
    """A file's columns in their order; `unusable` says why a column is not numbers."""

    source: str
    names: Sequence[str]
    numeric: Mapping[str, NDArray[Any]]
    unusable: Mapping[str, str]
    place: Place = row_place
    named: bool = True

    def find(self, reference: str | int) -> str:
        """Name of a column given by name, or by number from 0."""
        if isinstance(reference, int) and 0 <= reference < len(self.names):
            return self.names[reference]
        if reference not in self.names:
            raise UnknownNameError("column", str(reference), self.names, self.source)
        return str(reference)

    def values(self, name: str) -> NDArray[Any]:
        """Numbers of a column; `InputError` if it holds something else."""
        if name in self.unusable:
            raise InputError(f"{self.source}: column '{name}' is not numeric: {self.unusable[name]}")
        return self.numeric[name]


def read_table(path: Path, form: LogMap) -> Table:
    """Read a CSV (.csv, .tsv, .txt), Parquet or NPZ file as a table; `form` says what a CSV looks like."""
    readers = dict.fromkeys((".csv", ".tsv", ".txt"), _read_csv) | {
        ".parquet": _read_parquet,
        ".npz": _read_npz,
    }
    if path.is_dir():
        raise InputError(f"{path}: is a folder; give one file ({', '.join(readers)})")
    if not path.exists():
        close = close_names(path.name, (p.name for p in path.parent.glob("*")))
        hint = f"; did you mean {', '.join(close)}?" if close else ""
        raise InputError(f"{path}: there is no such file{hint}")
    if path.suffix.lower() not in readers:
        raise InputError(f"{path}: cannot read '{path.suffix}' files; supported are {', '.join(readers)}")
    if path.stat().st_size == 0:
        raise InputError(f"{path}: the file is empty")
    try:
        return readers[path.suffix.lower()](path, form)
    except (OSError, ValueError, EOFError, zipfile.BadZipFile, zlib.error, pa.ArrowException) as error:
        kind = path.suffix.lower()[1:]
        raise InputError(f"{path}: cannot be read as {kind} ({error}); was it copied completely?") from error


def _read_csv(path: Path, form: LogMap) -> Table:
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        before, line = next(((k, line) for k, line in enumerate(file) if line.strip()), (0, ""))
    # The separator is whichever of the usual ones the first line has most of.
    delimiter = form.delimiter or max(",;\t ", key=lambda c: line.strip(" ").count(c) if c != " " else 0.5)
    cells = [cell.strip() for cell in next(csv.reader([line.strip("\r\n")], delimiter=delimiter), [])]
    if not cells:
        raise InputError(f"{path}: the file holds only empty lines")
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
    skip = before + 1 if form.header else before
    options = pa.csv.ReadOptions(column_names=names, skip_rows=skip)
    try:
        arrow = pa.csv.read_csv(path, options, pa.csv.ParseOptions(delimiter=delimiter))
    except pa.ArrowInvalid as error:
        raise InputError(f"{path}: {_ragged_line(path, delimiter, len(names), skip) or error}") from error
    return _from_arrow(arrow, path, _line_place(path, skip), named=form.header or bool(form.columns))


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _line_place(path: Path, skip: int) -> Place:
    """Rows as lines of the file, in which empty lines count but hold no row."""

    def place(row: int) -> str:
        with path.open("rb") as file:
            filled = (k for k, line in enumerate(file) if k >= skip and line.strip(b"\r\n"))
            return f"line {next(itertools.islice(filled, row, None)) + 1}"

    return place


def _ragged_line(path: Path, delimiter: str, width: int, skip: int) -> str | None:
    """Which line has too few or too many cells."""
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


def _read_parquet(path: Path, form: LogMap) -> Table:
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


def _read_npz(path: Path, form: LogMap) -> Table:
    """Columns by name, or 2-D blocks (N, J) called q, v, a, tau, current beside the names `joints`."""
    if not zipfile.is_zipfile(path):
        raise InputError(f"{path}: is not an NPZ archive; write it with numpy.savez or frischid.write_log")
    with np.load(path, allow_pickle=False) as file:
        arrays = dict(file.items())
    joints = arrays.pop("joints").tolist() if arrays.get("joints", np.empty(0)).dtype.kind == "U" else []
    for channel in CHANNELS:
        if arrays.get(channel, np.empty(0)).ndim == 2:
            block = arrays.pop(channel)
            if block.shape[1] != len(joints):
                raise InputError(
                    f"{path}: {channel} has {block.shape[1]} columns, but the string array 'joints' names "
                    f"{len(joints)}: {', '.join(joints) or '(none)'}"
                )
            arrays |= {f"{channel}_{joint}": block[:, j] for j, joint in enumerate(joints)}
    # The length most columns have is the log's.
    shape = Counter(x.shape for x in arrays.values() if x.ndim == 1).most_common(1)
    if not shape:
        raise InputError(f"{path}: holds no columns (1-D arrays), only {', '.join(arrays) or 'nothing'}")
    numeric, unusable = {}, {}
    for name, values in arrays.items():
        if values.dtype.kind not in "iufb" or values.shape != shape[0][0]:
            unusable[name] = f"it has type {values.dtype} and shape {values.shape}"
        else:
            numeric[name] = values
    return Table(str(path), tuple(arrays), numeric, unusable)


def write_table(table: Mapping[str, Array], path: Path) -> None:
    """Write a CSV, Parquet or NPZ file; it appears under its name only when it is complete."""
    writers = {".csv": _write_csv, ".parquet": _write_parquet, ".npz": _write_npz}
    if path.suffix.lower() not in writers:
        raise InputError(f"{path}: cannot write '{path.suffix}' files; use one of {', '.join(writers)}")
    if not path.parent.is_dir():
        raise InputError(f"{path}: there is no folder {path.parent}")
    scratch = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        with scratch.open("wb") as file:
            writers[path.suffix.lower()](table, file)
        scratch.replace(path)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror})") from error
    finally:
        scratch.unlink(missing_ok=True)


def _write_csv(table: Mapping[str, Array], file: IO[bytes]) -> None:
    header = io.StringIO()
    csv.writer(header, lineterminator="\n").writerow(table)
    file.write(header.getvalue().encode())
    # Arrow prints the shortest digits that read back to the same double.
    pa.csv.write_csv(pa.table(dict(table)), file, pa.csv.WriteOptions(include_header=False))


def _write_parquet(table: Mapping[str, Array], file: IO[bytes]) -> None:
    pa.parquet.write_table(pa.table(dict(table)), file, compression="zstd")


def _write_npz(table: Mapping[str, Array], file: IO[bytes]) -> None:
    # np.savez takes names as keywords, but a column may be called "file"; a fixed date keeps hashes equal.
    with zipfile.ZipFile(file, "w") as archive:
        for name, values in table.items():
            with archive.open(zipfile.ZipInfo(f"{name}.npy"), "w", force_zip64=True) as member:
                np.lib.format.write_array(member, np.ascontiguousarray(values))
