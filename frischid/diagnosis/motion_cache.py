"""What a diagnosis keeps of one motion: its state, and the filtered rows of each joint, all in a `Store`.

A row's fold and its block of time follow from which sample it is and when that was; they are made when asked for. What
stays in memory of a motion are its name, its length and where its arrays are.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from frischid.core.array_store import Store, Stored
from frischid.core.types import Array
from frischid.effects import State

Indices = NDArray[np.intp]
Picked = NDArray[np.int32]
Stretch = tuple[str, float, float]
QUARTERS = 4  # folds of a single log


@dataclass(frozen=True, eq=False)
class Piece:
    """One motion with N filtered samples.

    Attributes
    ----------
    number : int
        Which motion it is.
    source : str
        The log.
    start : float
        Time at which the log begins, s.
    extra : sequence of str
        Further channels of the log.
    raw : int
        Samples before the filter.
    step : float
        Time between these, s.
    fold : int or None
        Part of the data it is; None where it is cut into `QUARTERS`.
    block : int
        First of its blocks of time in the count of all motions.
    seconds : float
        Length of a block.
    counts : sequence of int
        Rows of each joint.
    t : Stored
        Times of the filtered samples, s.
    Z : sequence of Stored
        For each joint the columns that act on it and its torque, (rows, k + 1).
    picked : sequence of Stored
        Which filtered samples the rows of each joint are.
    state : State or mapping of str to Stored
    """

    number: int
    source: str
    start: float
    extra: Sequence[str]
    raw: int
    step: float
    fold: int | None
    block: int
    seconds: float
    counts: Sequence[int]
    t: Stored
    Z: Sequence[Stored]
    picked: Sequence[Stored]
    state: State | Mapping[str, Stored]

    @property
    def blocks(self) -> int:
        """Blocks of time it has."""
        t = self.t.read()
        return 1 + int((t[-1] - t[0]) / self.seconds) if len(t) else 0


@dataclass(eq=False)
class Part:
    """Rows of one joint over one motion, n of them; read when asked for.

    Attributes
    ----------
    piece : Piece
    row : int
        Position of the joint among those fitted.
    cuts : sequence of (str, float, float)
        Stretches of time that are left out: source, start, stop, s.
    """

    piece: Piece
    row: int
    cuts: Sequence[Stretch] = ()

    @cached_property
    def at(self) -> Indices | slice:
        """Which of the stored rows these are."""
        own = [(a, b) for source, a, b in self.cuts if source == self.piece.source]
        if not own:
            return slice(None)
        t = self.piece.t.read()[self.piece.picked[self.row].read()]
        return np.flatnonzero(~np.any([(t >= a) & (t <= b) for a, b in own], axis=0))

    def __len__(self) -> int:
        return self.piece.counts[self.row] if isinstance(self.at, slice) else len(self.at)

    @cached_property
    def Z(self) -> Array:
        """Columns that act on the joint, and its torque, (n, k + 1)."""
        return np.asarray(self.piece.Z[self.row].read()[self.at])

    @property
    def Y(self) -> Array:
        """Columns that act on the joint, (n, k)."""
        return self.Z[:, :-1]

    @property
    def tau(self) -> Array:
        """Torque, (n,)."""
        return self.Z[:, -1]

    @property
    def picked(self) -> Picked:
        """Which filtered samples these are, (n,)."""
        return np.asarray(self.piece.picked[self.row].read()[self.at])

    @property
    def block(self) -> Indices:
        """Stretch of about a second each row belongs to, (n,)."""
        t = self.piece.t.read()
        return self.piece.block + ((t[self.picked] - t[:1]) / self.piece.seconds).astype(int)

    @cached_property
    def folds(self) -> list[tuple[int, slice]]:
        """Parts of the data there are here, and their rows."""
        if self.piece.fold is not None:
            return [(self.piece.fold, slice(0, len(self)))] if len(self) else []
        samples = self.piece.t.shape[0]
        first = [-(-quarter * samples // QUARTERS) for quarter in range(QUARTERS + 1)]
        ends = np.searchsorted(self.picked, first).tolist()
        found = zip(range(QUARTERS), map(slice, ends[:-1], ends[1:]), strict=True)
        return [(fold, own) for fold, own in found if own.stop > own.start]


def kept(state: State, store: Store) -> State | Mapping[str, Stored]:
    """A state, in memory only if there is room for what effects derive from it as well (`State.slopes`)."""
    samples, joints = state.q.shape
    if store.takes(8 * samples * (1 + joints * (5 + 3 * joints) + len(state.extra))):
        return state
    arrays = {name: getattr(state, name) for name in ("t", "q", "v", "a", "load", "torque")}
    arrays |= {f"extra {name}": x for name, x in state.extra.items()}
    return {name: store.put(x) for name, x in arrays.items()}
