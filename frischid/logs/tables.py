"""File formats: CSV, Parquet and NPZ, each as one table of named columns, and back.

Nothing here depends on the meaning of a column. A `Table` holds the columns that are numbers, the reason why others are
not, and the place of each row in the file. Long files are read as several tables of consecutive rows.
"""

from __future__ import annotations

import csv
import io
import itertools
import lzma
import zipfile
import zlib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
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
from frischid.core.types import Array
from frischid.errors import InputError, UnknownNameError, close_names
from frischid.logs.log import CHANNELS, Place, row_place
from frischid.logs.mapping import LogMap

MUJOCO = {"qpos": "q", "qvel": "v", "qacc": "a", "qfrc_actuator": "tau", "time": "t"}
CSV = (".csv", ".tsv", ".txt")


@dataclass(frozen=True)
class Table:
    """A file's columns in their order; `unusable` gives the reason why a column is not numeric."""

    source: str
    names: Sequence[str]
    numeric: Mapping[str, NDArray[Any]]
    unusable: Mapping[str, str]
    place: Place = row_place
    named: bool = True
    notes: tuple[str, ...] = ()

    @property
    def rows(self) -> int:
        """Number of rows."""
        return len(next(iter(self.numeric.values()), ()))

    def find(self, reference: str | int) -> str:
        """Name of a column given by name, or by number from 0."""
        if isinstance(reference, int) and 0 <= reference < len(self.names):
            return self.names[reference]
        if reference not in self.names:
            raise UnknownNameError("column", str(reference), self.names, self.source)
        return str(reference)

    def values(self, name: str) -> NDArray[Any]:
        """Numbers of a column; `InputError` if the column is not numeric."""
        if name in self.unusable:
            raise InputError(f"{self.source}: column '{name}' is not numeric: {self.unusable[name]}")
        return self.numeric[name]


def joined(tables: Sequence[Table]) -> Table:
    """Join tables of consecutive rows to one table."""
    first = tables[0]
    unusable = {name: why for table in tables for name, why in table.unusable.items()}
    names = [name for name in first.names if name not in unusable]
    columns = {name: np.concatenate([table.numeric[name] for table in tables]) for name in names}
    return replace(first, numeric=columns, unusable=unusable, notes=tables[-1].notes)


def read_table(path: Path, form: LogMap) -> Table:
    """Read a CSV (.csv, .tsv, .txt), Parquet or NPZ file as a table; `form` describes the layout of a CSV."""
    readers = dict.fromkeys(CSV, _read_csv) | {".parquet": _read_parquet, ".npz": _read_npz}
    kind = _kind(path)
    with _reading(path, kind):
        return readers[kind](path, form)


def read_tables(path: Path, form: LogMap, rows: int) -> Iterator[Table]:
    """Read such a file as tables of about `rows` consecutive rows; an NPZ file is in memory as a whole."""
    kind = _kind(path)
    with _reading(path, kind):
        if kind == ".npz":
            whole = _read_npz(path, form)
            for start in range(0, whole.rows, rows):
                part = {name: x[start : start + rows] for name, x in whole.numeric.items()}
                yield replace(whole, numeric=part, place=_after(start, whole.place))
        elif kind == ".parquet":
            start = 0
            # Reading ahead would keep whole row groups in memory, which may be most of a long file.
            file = pa.parquet.ParquetFile(path, pre_buffer=False, buffer_size=1 << 16)
            for batch in file.iter_batches(batch_size=rows):
                yield _from_arrow(pa.table(batch), path, _after(start, row_place))
                start += batch.num_rows
        else:
            yield from _csv_tables(path, form, rows)


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
            yield _from_arrow(pa.table(batch), path, _after(start, place), named=layout.named)
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
            return f"line {next(itertools.islice(filled, row, None)) + 1}"

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
    notes = _mujoco_names(arrays)
    joints = arrays.pop("joints").tolist() if arrays.get("joints", np.empty(0)).dtype.kind == "U" else list(form.joints)
    for name in [name for name, x in arrays.items() if x.ndim == 2]:
        if arrays[name].shape[1] == len(joints):
            block = arrays.pop(name)
            arrays |= {f"{name}_{joint}": block[:, j] for j, joint in enumerate(joints)}
        elif name in CHANNELS:
            raise InputError(
                f"{path}: {name} has {arrays[name].shape[1]} columns, but the string array 'joints' names "
                f"{len(joints)}: {', '.join(joints) or '(none)'}; store such an array, or list the columns' joints in "
                "order as joints = [...] under [file] in a mapping file"
            )
    # The log's length is that of most columns.
    shape = Counter(x.shape for x in arrays.values() if x.ndim == 1).most_common(1)
    if not shape:
        raise InputError(f"{path}: holds no columns (1-D arrays), only {', '.join(arrays) or 'nothing'}")
    numeric, unusable = {}, {}
    for name, values in arrays.items():
        if values.dtype.kind not in "iufb" or values.shape != shape[0][0]:
            unusable[name] = f"it has type {values.dtype} and shape {values.shape}"
        else:
            numeric[name] = values
    return Table(str(path), tuple(arrays), numeric, unusable, notes=notes)


def _mujoco_names(arrays: dict[str, NDArray[Any]]) -> tuple[str, ...]:
    """Rename arrays with MuJoCo's names (qpos, qvel, qacc, qfrc_actuator, time); return a note on them."""
    renamed = (
        {old: new for old, new in MUJOCO.items() if old in arrays and new not in arrays} if "qpos" in arrays else {}
    )
    for old, new in renamed.items():
        arrays[new] = np.squeeze(arrays.pop(old)) if new == "t" else arrays.pop(old)
    return (f"MuJoCo's {', '.join(renamed)} taken as {', '.join(renamed.values())}",) if renamed else ()


def write_table(table: Mapping[str, Array], path: Path) -> None:
    """Write a CSV, Parquet or NPZ file; it appears under its name only when it is complete."""
    writers = {".csv": _write_csv, ".parquet": _write_parquet, ".npz": _write_npz}
    if path.suffix.lower() not in writers:
        raise InputError(f"{path}: cannot write '{path.suffix}' files; use one of {', '.join(writers)}")
    with written(path) as scratch, scratch.open("wb") as file:
        writers[path.suffix.lower()](table, file)


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
