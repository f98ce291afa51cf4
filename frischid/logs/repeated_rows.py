"""Rows that were recorded repeatedly: a recorder that is faster than the controller writes the same message again.

A row repeats the one before if stamp and values are the same. It holds no news and is left out. A row with the same
stamp and other values stays: then the stamps are wrong.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from frischid.logs.table import Table


def without_repeats(table: Table, time: str, columns: Sequence[str], notes: list[str]) -> Table:
    """The table without the rows that repeat the row before; a note says how many.

    Parameters
    ----------
    time : str
        Column of the stamps.
    columns : sequence of str
        Columns that a log takes from the table.
    notes : list of str
        The note is added here.
    """
    used = [table.numeric[name] for name in (time, *columns) if name in table.numeric]
    again = repeats(used)
    if not again.any():
        return table
    kept, place = np.flatnonzero(~again), table.place
    notes.append(f"{again.sum()} rows left out, the first at {place(int(again.argmax()))}: they repeat the row before")
    numeric = {name: x[kept] for name, x in table.numeric.items()}
    return replace(table, numeric=numeric, place=lambda row: place(int(kept[row])))


def repeats(columns: Sequence[NDArray[np.generic]]) -> NDArray[np.bool_]:
    """Rows whose values are those of the row before in each of the columns, (N,)."""
    if not columns or not len(columns[0]):
        return np.zeros(0, bool)
    same = np.ones(len(columns[0]) - 1, bool)
    for x in columns:
        same &= x[1:] == x[:-1]
        if not same.any():
            break
    return np.append(False, same)
