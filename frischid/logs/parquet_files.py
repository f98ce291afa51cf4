"""Parquet files as tables; a column of lists becomes a column per place in the list (`frischid.logs.list_columns`)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet

from frischid.logs.arrow_columns import table_of_arrow
from frischid.logs.list_columns import flattened, names_in
from frischid.logs.log import row_place
from frischid.logs.mapping import LogMap
from frischid.logs.table import Table, check_width, place_after


def read_parquet(path: Path, _form: LogMap, _joints: Sequence[str] = ()) -> Table:
    """Read a file as a whole."""
    check_width(path, pa.parquet.read_metadata(path).num_columns)
    return table_of_arrow(flattened(pa.parquet.read_table(path), path), path)


def parquet_chunks(path: Path, _form: LogMap, rows: int, _joints: Sequence[str] = ()) -> Iterator[Table]:
    """Read a file batch by batch."""
    start = 0
    # Reading ahead would keep whole row groups in memory, which may be most of a long file.
    file = pa.parquet.ParquetFile(path, pre_buffer=False, buffer_size=1 << 16)
    check_width(path, file.metadata.num_columns)
    for batch in file.iter_batches(batch_size=rows):
        part = flattened(pa.table(batch), path)
        yield replace(table_of_arrow(part, path, place_after(start, row_place)), first=start)
        start += batch.num_rows


def parquet_names(path: Path, _form: LogMap) -> Sequence[str]:
    """Names of a file's columns."""
    return names_in(path)


def parquet_bytes(path: Path) -> int:
    """Bytes of the numbers of a file; of a column of lists, all numbers of the lists count."""
    about = pa.parquet.read_metadata(path)
    groups = [about.row_group(g) for g in range(about.num_row_groups)]
    return 8 * sum(int(g.column(c).num_values) for g in groups for c in range(g.num_columns))
