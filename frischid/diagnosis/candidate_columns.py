"""Columns of candidate effects over motions: made by the effects, filtered, taken at the rows of each joint."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from frischid.core.array_store import Series, Store
from frischid.core.types import Array
from frischid.diagnosis.motion_cache import Part, Piece
from frischid.effects import Effect, State, Term


@dataclass(frozen=True, eq=False)
class Projection:
    """One candidate's columns over all rows: position in the joints -> for each motion, (rows, k)."""

    effect: Effect
    columns: Mapping[int, Series]
    signs: tuple[int, ...]
    finite: bool = True

    def over(self, part: Part) -> Array:
        """Columns at some rows, (n, k)."""
        return np.asarray(self.columns[part.row][part.piece.number][part.at])


@dataclass(frozen=True, eq=False)
class Work:
    """What the columns of candidates over one motion are made from."""

    state: State
    filter: sparse.csr_array
    rows: Mapping[int, int]
    picked: Sequence[NDArray[np.int32]]


@dataclass(frozen=True, eq=False)
class Columns:
    """Columns of one effect over one motion: position in the joints -> (rows, k)."""

    rows: Mapping[int, Array]
    signs: tuple[int, ...]
    finite: bool


@dataclass(eq=False)
class Gathered:
    """Columns of one effect, motion by motion; zero in a motion where the effect has none."""

    store: Store
    series: dict[int, Series] = field(default_factory=dict)
    signs: tuple[int, ...] = ()
    finite: bool = True

    def add(self, columns: Columns, pieces: Sequence[Piece]) -> None:
        """Go on by one motion, the last of `pieces`."""
        self.signs, self.finite = columns.signs, self.finite and columns.finite
        for row in sorted(self.series.keys() | columns.rows.keys()):
            series = self.series.setdefault(row, Series(self.store))
            for piece in pieces[len(series) :]:
                none = np.zeros((piece.counts[row], len(self.signs)))
                series.append(columns.rows.get(row, none) if piece is pieces[-1] else none)


def filtered(effects: Sequence[Effect], work: Work) -> list[Columns]:
    """Columns of some effects of one kind over one motion, at the rows of each joint."""
    found = []
    for terms in type(effects[0]).each(effects, work.state):
        columns = {
            row: np.asarray(work.filter @ C)[work.picked[row]]
            for row, C in columns_of(terms, work.rows, len(work.state.t)).items()
        }
        finite = all(np.isfinite(x).all() for x in columns.values())
        found.append(Columns(columns, tuple(term.column.sign for term in terms), finite))
    return found


def columns_of(terms: Sequence[Term], rows: Mapping[int, int], samples: int) -> dict[int, Array]:
    """Columns of an effect's terms by row of the fitted joints, (samples, k)."""
    columns: dict[int, Array] = {}
    for k, term in enumerate(terms):
        for j, values in term.rows.items():
            if j in rows:
                columns.setdefault(rows[j], np.zeros((samples, len(terms))))[:, k] = values
    return columns


def sampled(state: State, t: Array) -> State:
    """A motion's state at some of its samples."""
    k = np.clip(np.searchsorted(state.t, t - 1e-9), 0, len(state.t) - 1)
    parts = {name: getattr(state, name)[k] for name in ("t", "q", "v", "a", "load", "torque")}
    return replace(state, **parts, extra={name: x[k] for name, x in state.extra.items()})
