"""One motion in the cache of a diagnosis: its state, and the filtered torque and columns of each joint.

The arrays are in a `Store`: in memory while they are small, then in a temporary file. The object itself holds little: a
name, a length and the places of its arrays. The fold and the block of time of a row follow from the row's sample and
time, so they are computed when a stage asks for them.

    fold of row i  =  the log's fold, or ⌊k · (sample of i) / N⌋ where a single log is cut into k folds
    block of row i =  first block of the motion + ⌊(t_i − t_0) / block length⌋
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from frischid.core.array_store import Store, Stored
from frischid.core.types import Array
from frischid.diagnosis.stretches import Stretch
from frischid.effects import State
from frischid.estimators.held_out import MOST_OF_A_JOINT

Indices = NDArray[np.intp]
Picked = NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class CachedMotion:
    """One motion with N filtered samples."""

    number: int
    """Position among all motions."""
    source: str
    """The log."""
    start: float
    """Time at which the log begins, s."""
    extra: Sequence[str]
    """Further channels of the log."""
    raw: int
    """Samples before the filter."""
    step: float
    """Time between these, s."""
    fold: int | None
    """Fold of all its rows; None where the motion is cut into several folds."""
    cuts: int
    """Number of folds that the motion is cut into where `fold` is None."""
    block: int
    """Number of its first block of time, counted over all motions."""
    seconds: float
    """Length of a block."""
    counts: Sequence[int]
    """Rows of each joint."""
    t: Stored
    """Times of the filtered samples, s."""
    Z: Sequence[Stored]
    """For each joint the k columns that act on the joint, and its torque less `known`, (rows, k + 1)."""
    known: Sequence[Stored]
    """For each joint the torque of known parameters, (rows,); empty for a robot without any."""
    jumps: Sequence[Stored]
    """For each joint the variance of its torque's jumps (`noise_floor.variance_of_jumps`), (rows,)."""
    picked: Sequence[Stored]
    """Filtered samples of each joint's rows."""
    state: State | Mapping[str, Stored]
    """Unfiltered motion, from which effects make their columns."""

    @property
    def in_memory(self) -> bool:
        """Whether its rows are in memory, so that an object that refers to them needs hardly any more."""
        return all(rows.held is not None for rows in self.Z)

    @property
    def blocks(self) -> int:
        """Number of its blocks of time."""
        t = self.t.read()
        return 1 + int((t[-1] - t[0]) / self.seconds) if len(t) else 0


@dataclass(eq=False)
class JointData:
    """Torque and columns of one joint over one motion, n rows; read when a stage asks for them."""

    motion: CachedMotion
    row: int
    """Position of the joint among the fitted ones."""
    left_out: Sequence[Stretch] = ()
    """Stretches of time that are left out: source, start, stop, s."""

    @cached_property
    def at(self) -> Indices | slice:
        """Positions of these rows among the stored ones."""
        own = [(a, b) for source, a, b in self.left_out if source == self.motion.source]
        if not own:
            return slice(None)
        t = self.motion.t.read()[self.motion.picked[self.row].read()]
        return np.flatnonzero(~np.any([(t >= a) & (t <= b) for a, b in own], axis=0))

    def __len__(self) -> int:
        return self.motion.counts[self.row] if isinstance(self.at, slice) else len(self.at)

    @cached_property
    def Z(self) -> Array:
        """Columns that act on the joint, and its torque, (n, k + 1)."""
        return np.asarray(self.motion.Z[self.row].read()[self.at])

    @cached_property
    def jumps(self) -> Array:
        """Variance of the torque's jumps, (n,)."""
        return np.asarray(self.motion.jumps[self.row].read()[self.at])

    @property
    def Y(self) -> Array:
        """Columns that act on the joint, (n, k)."""
        return self.Z[:, :-1]

    @property
    def tau(self) -> Array:
        """Torque less that of known parameters, (n,)."""
        return self.Z[:, -1]

    @property
    def measured(self) -> Array:
        """Torque as measured, (n,): with that of known parameters."""
        known = self.motion.known
        return np.asarray(self.tau + known[self.row].read()[self.at]) if known else self.tau

    @cached_property
    def picked(self) -> Picked:
        """Filtered samples of these rows, (n,)."""
        return np.asarray(self.motion.picked[self.row].read()[self.at])

    @cached_property
    def block(self) -> Indices:
        """Block of time of each row, (n,)."""
        t = self.motion.t.read()
        return self.motion.block + ((t[self.picked] - t[:1]) / self.motion.seconds).astype(int)

    @cached_property
    def folds(self) -> list[tuple[int, slice]]:
        """Folds of the data that have rows here, and these rows."""
        if self.motion.fold is not None:
            return [(self.motion.fold, slice(0, len(self)))] if len(self) else []
        samples, cuts = self.motion.t.shape[0], self.motion.cuts
        first = [-(-fold * samples // cuts) for fold in range(cuts + 1)]
        ends = np.searchsorted(self.picked, first).tolist()
        if np.diff(ends).max() > MOST_OF_A_JOINT * len(self):  # the joints move one after another: cut by own rows
            ends = [len(self) * fold // cuts for fold in range(cuts + 1)]
        found = zip(range(cuts), map(slice, ends[:-1], ends[1:]), strict=True)
        return [(fold, own) for fold, own in found if own.stop > own.start]


def stored_state(state: State, store: Store) -> State | Mapping[str, Stored]:
    """Keep a state; in memory only if the derivatives that effects compute from it (`State.slopes`) fit there too."""
    samples, joints = state.q.shape
    if store.takes(8 * samples * (1 + joints * (5 + 3 * joints) + len(state.extra))):
        return state
    arrays = {name: getattr(state, name) for name in ("t", "q", "v", "a", "load", "torque")}
    arrays |= {f"extra {name}": x for name, x in state.extra.items()}
    return {name: store.put(x) for name, x in arrays.items()}
