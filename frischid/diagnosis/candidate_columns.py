"""Columns of candidate effects over the motions: computed by the effect, filtered, and taken at each joint's rows.

    C_j = S_j F c_j(q, q̇, q̈, ...)

with c_j the effect's columns on joint j over the unfiltered motion, F the model's low-pass filter and decimation, and
S_j the selection of the samples at which joint j is used. Columns and torque pass the same filter, so the filter does
not bias the coefficients (Gautier 1997, IEEE ICRA).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from frischid.core.array_store import Series, Store
from frischid.core.types import Array
from frischid.diagnosis.cached_motion import CachedMotion, JointData
from frischid.effects import Effect, State, Term

FILTERED_AT_ONCE = 300_000
"""Numbers of unfiltered columns that are filtered together, 2.4 MB."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """Columns of one effect in one place and shape over all motions."""

    effect: Effect
    columns: Mapping[int, Series]
    """Position of the joint among the fitted ones -> for each motion an array (rows, k)."""
    signs: tuple[int, ...]
    """Known signs of the k coefficients; 0 where unknown."""
    finite: bool = True
    """Whether all values are finite."""
    beside: tuple[Effect, ...] = ()
    """Changes of old parameters whose columns follow those of the effect (`after_change`)."""

    @property
    def effects(self) -> tuple[Effect, ...]:
        """The effect, and the changes beside it."""
        return (self.effect, *self.beside)

    def over(self, data: JointData) -> Array:
        """Columns at the rows of a joint, (n, k)."""
        return np.asarray(self.columns[data.row][data.motion.number][data.at])


@dataclass(frozen=True, eq=False)
class ColumnTask:
    """The data of one motion that a worker process needs to compute columns."""

    state: State
    filter: sparse.csr_array
    """Shape (filtered samples, N)."""
    rows: Mapping[int, int]
    """Joint of the robot -> position among the fitted ones."""
    picked: Sequence[NDArray[np.int32]]
    """Filtered samples of each fitted joint's rows."""


@dataclass(frozen=True, eq=False)
class MotionColumns:
    """Columns of one effect over one motion: position of the joint -> (rows, k)."""

    rows: Mapping[int, Array]
    signs: tuple[int, ...]
    finite: bool


@dataclass(eq=False)
class GatheredColumns:
    """Columns of one effect, gathered motion by motion; zero over a motion where the effect has none."""

    store: Store
    series: dict[int, Series] = field(default_factory=dict)
    signs: tuple[int, ...] = ()
    finite: bool = True

    def add(self, columns: MotionColumns, motions: Sequence[CachedMotion]) -> None:
        """Add the columns over the last of `motions`."""
        self.signs, self.finite = columns.signs, self.finite and columns.finite
        for row in sorted(self.series.keys() | columns.rows.keys()):
            series = self.series.setdefault(row, Series(self.store))
            for motion in motions[len(series) :]:
                none = np.zeros((motion.counts[row], len(self.signs)))
                series.append(columns.rows.get(row, none) if motion is motions[-1] else none)


def filtered_columns(effects: Sequence[Effect], task: ColumnTask) -> list[MotionColumns]:
    """Columns of some effects of one kind over one motion, at the rows of each joint."""
    found: list[MotionColumns] = []
    waiting: list[tuple[Sequence[Term], dict[int, Array]]] = []
    samples = len(task.state.t)
    for terms in type(effects[0]).each(effects, task.state):
        waiting.append((terms, columns_by_joint(terms, task.rows, samples)))
        if sum(len(terms) * len(columns) for terms, columns in waiting) * samples >= FILTERED_AT_ONCE:
            found += _filtered(waiting, task)
            waiting = []
    return found + _filtered(waiting, task)


def _filtered(waiting: Sequence[tuple[Sequence[Term], dict[int, Array]]], task: ColumnTask) -> list[MotionColumns]:
    """The same for effects whose columns are known: the sparse filter takes many columns faster than each alone."""
    raw = [C for _, columns in waiting for C in columns.values()]
    if not raw:
        return [MotionColumns({}, tuple(term.column.sign for term in terms), True) for terms, _ in waiting]
    ends = np.cumsum([C.shape[1] for C in raw])[:-1]
    outputs = iter(np.split(np.asarray(task.filter @ np.concatenate(raw, axis=1)), ends, axis=1))
    found = []
    for terms, columns in waiting:
        rows = {row: next(outputs)[task.picked[row]] for row in columns}
        finite = all(np.isfinite(x).all() for x in rows.values())
        found.append(MotionColumns(rows, tuple(term.column.sign for term in terms), finite))
    return found


def columns_by_joint(terms: Sequence[Term], rows: Mapping[int, int], samples: int) -> dict[int, Array]:
    """Unfiltered columns of an effect's terms, by position of the fitted joint, (samples, k)."""
    columns: dict[int, Array] = {}
    for k, term in enumerate(terms):
        for j, values in term.rows.items():
            if j in rows:
                columns.setdefault(rows[j], np.zeros((samples, len(terms))))[:, k] = values
    return columns


def sampled(state: State, t: Array) -> State:
    """State of a motion at some of its samples, given by their times t, s."""
    k = np.clip(np.searchsorted(state.t, t - 1e-9), 0, len(state.t) - 1)
    parts = {name: getattr(state, name)[k] for name in ("t", "q", "v", "a", "load", "torque")}
    return replace(state, **parts, extra={name: x[k] for name, x in state.extra.items()})
