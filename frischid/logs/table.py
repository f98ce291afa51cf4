"""A file's columns under their names: those that are numbers, and the reason why others are not."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from frischid.errors import InputError, UnknownNameError
from frischid.logs.log import Place, row_place


@dataclass(frozen=True, eq=False)
class Table:
    """A file's columns in their order; `unusable` gives the reason why a column is not numeric.

    `first` is the number of the file's rows before this table.
    """

    source: str
    names: Sequence[str]
    numeric: Mapping[str, NDArray[Any]]
    unusable: Mapping[str, str]
    place: Place = row_place
    named: bool = True
    notes: tuple[str, ...] = ()
    first: int = 0

    @property
    def rows(self) -> int:
        """Number of rows."""
        return len(next(iter(self.numeric.values()), ()))

    def find(self, reference: str | int, asked: str = "") -> str:
        """Name of a column given by name, or by number from 0; `asked` says who names it, for messages."""
        if isinstance(reference, int) and 0 <= reference < len(self.names):
            return self.names[reference]
        if reference not in self.names:
            where = f"{self.source} ({asked})" if asked else self.source
            raise UnknownNameError("column", str(reference), self.names, where)
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


def place_after(start: int, place: Place) -> Place:
    """Places of the rows from `start` on, where `place` gives those of the whole file."""
    return lambda row: place(start + row)


MOST_COLUMNS = 10_000
"""Columns of a file. A robot of a hundred joints has some thousand; each costs time and memory before any is used."""


def check_width(source: object, count: int) -> None:
    """Refuse (InputError) a file of more columns than a log can have."""
    if count > MOST_COLUMNS:
        raise InputError(
            f"{source}: has {count} columns, a log has at most {MOST_COLUMNS}; is it the right file, or transposed?"
        )
