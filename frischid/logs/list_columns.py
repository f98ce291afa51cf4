"""Columns of lists, one list per sample: data sets of robot learning store q = [q1, q2, ...] in one Parquet column.

A column `state` of lists of n numbers becomes the columns `state_0` to `state_{n-1}`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute
import pyarrow.parquet

from frischid.logs.table import check_width


def flattened(arrow: Any, source: object) -> Any:
    """A table without columns of lists, where all lists of a column have the same length and hold numbers."""
    found: dict[str, Any] = {}
    for name, column in zip(arrow.column_names, arrow.columns, strict=True):
        block = _block(column)
        if block is None or any(f"{name}_{k}" in arrow.column_names for k in range(block.shape[1])):
            found[name] = column
        else:
            check_width(source, len(found) + block.shape[1])
            found |= {f"{name}_{k}": pa.array(x) for k, x in enumerate(block.T)}
    return pa.table(found) if list(found) != arrow.column_names else arrow


def names_in(path: Path) -> list[str]:
    """Names of a Parquet file's columns, as its table has them."""
    file = pa.parquet.ParquetFile(path)
    if not any(_is_list(kind) for kind in file.schema_arrow.types):
        return list(file.schema_arrow.names)
    first = next(file.iter_batches(batch_size=1), None)
    return list(file.schema_arrow.names if first is None else flattened(pa.table(first), path).column_names)


def _is_list(kind: Any) -> bool:
    return bool(pa.types.is_list(kind) or pa.types.is_large_list(kind) or pa.types.is_fixed_size_list(kind))


def _block(column: Any) -> Any:
    """Numbers (N, n) of a column of lists of n numbers; None for other columns."""
    kind = column.type
    if not _is_list(kind) or column.null_count or not len(column):
        return None
    if not (pa.types.is_integer(kind.value_type) or pa.types.is_floating(kind.value_type)):
        return None
    lengths = np.asarray(pa.compute.list_value_length(column))
    if lengths[0] < 1 or (lengths != lengths[0]).any():
        return None
    values = np.asarray(pa.compute.list_flatten(column), dtype=float)
    return values.reshape(-1, int(lengths[0]))
