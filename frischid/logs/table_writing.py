"""Tables as files: CSV, Parquet and NPZ."""

from __future__ import annotations

import csv
import io
import zipfile
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import IO

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from frischid.core.files import written
from frischid.core.text import shortened
from frischid.core.types import Array
from frischid.errors import InputError

TABLE_FILES = (".csv", ".parquet", ".npz")
"""Endings of the files that `write_table` writes."""


def write_table(table: Mapping[str, Array], path: Path) -> None:
    """Write a CSV, Parquet or NPZ file; it appears under its name only when it is complete."""
    writers = dict(zip(TABLE_FILES, (_write_csv, _write_parquet, _write_npz), strict=True))
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
