"""File formats of logs: CSV, Parquet and NPZ, each as one table of named columns.

Each format is one entry of `TABLE_FORMATS`, and its functions are in a module of their own. Nothing here depends on the
meaning of a column. Long files are read as several tables of consecutive rows. Bags of messages are in
`frischid.logs.bags`.
"""

from __future__ import annotations

import lzma
import zipfile
import zlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pyarrow as pa

from frischid.errors import InputError, close_names
from frischid.logs.bags import BAG_SUFFIXES
from frischid.logs.csv_files import CSV, csv_chunks, csv_names, read_csv
from frischid.logs.log_file import size_of
from frischid.logs.mapping import LogMap
from frischid.logs.npz_arrays import npz_bytes, npz_chunks, npz_names, read_npz
from frischid.logs.parquet_files import parquet_bytes, parquet_chunks, parquet_names, read_parquet
from frischid.logs.table import Table


@dataclass(frozen=True)
class TableFormat:
    """How the files of one format become tables.

    Errors of the libraries that read the files may come through; `read_table` turns them into an `InputError`.
    """

    suffixes: tuple[str, ...]
    """In lower case."""
    read: Callable[[Path, LogMap, Sequence[str]], Table]
    """The whole file. The mapping describes the layout of a CSV; the joints name 2-D arrays without names."""
    chunks: Callable[[Path, LogMap, int, Sequence[str]], Iterator[Table]]
    """The file as tables of about so many consecutive rows."""
    names: Callable[[Path, LogMap], Sequence[str]]
    """Names of the columns, as the table has them, if possible without reading the numbers."""
    content_bytes: Callable[[Path], int]
    """Bytes that the numbers need in memory, without reading them: a compressed file is larger than it looks."""


TABLE_FORMATS = (
    TableFormat(CSV, read_csv, csv_chunks, csv_names, size_of),
    TableFormat((".parquet",), read_parquet, parquet_chunks, parquet_names, parquet_bytes),
    TableFormat((".npz",), read_npz, npz_chunks, npz_names, npz_bytes),
)
LOG_SUFFIXES = (*(suffix for form in TABLE_FORMATS for suffix in form.suffixes), *BAG_SUFFIXES)
"""Ends of the names of all files that can be a log."""
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
_SCHEMA_WITHIN = 200  # bytes of a model file that hold its schema


def format_of(path: Path) -> TableFormat | None:
    """The format of a file by the end of its name; None for bags and for files that cannot be read."""
    return next((form for form in TABLE_FORMATS if path.suffix.lower() in form.suffixes), None)


def read_table(path: Path, form: LogMap, order: Sequence[str] = ()) -> Table:
    """Read a CSV (.csv, .tsv, .txt), Parquet or NPZ file as a table.

    `form` describes the layout of a CSV; `order` names the columns of 2-D arrays whose file names no joints.
    """
    with _reading(path) as found:
        return found.read(path, form, order)


def read_tables(path: Path, form: LogMap, rows: int, order: Sequence[str] = ()) -> Iterator[Table]:
    """Read such a file as tables of about `rows` consecutive rows; an NPZ file is in memory as a whole."""
    with _reading(path) as found:
        yield from found.chunks(path, form, rows, order)


def column_names(path: Path, form: LogMap) -> Sequence[str]:
    """Names of a file's columns, as its table will have them."""
    with _reading(path) as found:
        return found.names(path, form)


def _checked(path: Path) -> TableFormat:
    """The format of a file that can be read; otherwise an error with the reason."""
    supported = ", ".join(LOG_SUFFIXES)
    if path.is_dir():
        raise InputError(
            f"{path}: is a folder; {_logs_within(path)} (log files are {supported}, or the folder of a ROS 2 bag)"
        )
    if not path.exists():
        close = close_names(path.name, (p.name for p in path.parent.glob("*")))
        hint = f"; did you mean {', '.join(close)}?" if close else ""
        if not path.parent.is_dir():
            hint = f", and no folder {path.parent}; check the path"
        elif any(sign in path.name for sign in "*?["):
            hint = "; write the pattern without quotes: the shell then puts the names of the files in its place"
        raise InputError(f"{path}: there is no such file{hint}")
    found = format_of(path)
    if found is None:
        if path.suffix.lower() == ".json" and _is_model(path):
            raise InputError(f"{path}: a model, not a log; give the recordings here ({supported})")
        hint = f"; {how}" if (how := OTHER_FORMATS.get(path.suffix.lower())) else ""
        raise InputError(f"{path}: cannot read '{path.suffix}' files; supported are {supported}{hint}")
    if path.stat().st_size == 0:
        raise InputError(f"{path}: the file is empty")
    return found


def _is_model(path: Path) -> bool:
    """Whether a JSON file is a model of frischid."""
    with path.open("rb") as file:
        return b'"frischid.model/' in file.read(_SCHEMA_WITHIN)


def _logs_within(folder: Path) -> str:
    """What to give in place of a folder."""
    suffixes = sorted({p.suffix for p in folder.glob("*") if p.suffix.lower() in LOG_SUFFIXES})
    if not suffixes:
        return "no log is in it; give the files of the logs"
    return f"give its files, for example {' '.join(str(folder / f'*{suffix}') for suffix in suffixes)}"


@contextmanager
def _reading(path: Path) -> Iterator[TableFormat]:
    """The format of a file that is read meanwhile: errors of the libraries become an `InputError` with a remedy."""
    found, kind = _checked(path), path.suffix.lower()[1:]
    try:
        yield found
    except (OSError, ValueError, EOFError, zipfile.BadZipFile, zlib.error, pa.ArrowException) as error:
        raise InputError(f"{path}: cannot be read as {kind} ({error}); was it copied completely?") from error
    except (RuntimeError, lzma.LZMAError) as error:  # encrypted, or of a compression that Python does not know
        raise InputError(f"{path}: cannot be read as {kind} ({error}); write it without password") from error
    except MemoryError as error:
        raise InputError(f"{path}: its columns do not fit into memory ({error}); is it damaged?") from error
