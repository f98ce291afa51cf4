"""Moments of consecutive stretches of time, packed: what cross-validation and standard errors add and leave out.

    Σ_k z_k z_kᵀ over a log = Σ_b (moments of stretch b)

Stretches are added in any grouping, and one is left out by a difference. So nothing that is fitted without a part of a
log reads the log again.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import reduce
from typing import overload

import numpy as np

from frischid.core.types import Array, Column
from frischid.errors import InputError
from frischid.regression.moments import Gram, PackedGram

HALVED_ABOVE = 2**20
"""Bytes of moments above which only a triangle is kept; a triangle of a smaller one costs time and saves little."""


class Blocks(Sequence[Gram]):
    """Moments of consecutive stretches of time.

    Blocks may be packed (`PackedGram`): a joint's columns of links that it does not move are zero, so only products of
    the active columns are kept, and of a large block only a triangle, because moments are symmetric. For a chain of
    thirty joints that is a sixth of the numbers. A packed block is unpacked when it is asked for.

    Attributes
    ----------
    nbytes : int
        Bytes of all blocks together.
    """

    def __init__(self, grams: Iterable[Gram | PackedGram] = ()) -> None:
        self._kept: list[Gram | PackedGram] = []
        self.nbytes = 0
        for gram in grams:
            self.append(gram)

    def append(self, gram: Gram | PackedGram) -> None:
        """Append a block."""
        self._keep(_kept(gram))

    def merge(self, gram: Gram | PackedGram) -> None:
        """Add moments to the last block."""
        last = self._kept.pop()
        self.nbytes -= last.nbytes
        self._keep(_sum(last, _kept(gram)))

    def halve(self) -> None:
        """Add each pair of neighbouring blocks; the number of blocks must be even."""
        pairs = list(zip(self._kept[::2], self._kept[1::2], strict=True))
        self._kept, self.nbytes = [], 0
        for a, b in pairs:
            self._keep(_sum(a, b))

    def added(self, sizes: Sequence[int]) -> Blocks:
        """Moments of longer stretches: `sizes` neighbouring blocks added to one each."""
        found, start = Blocks(), 0
        for size in sizes:
            found._keep(reduce(_sum, self._kept[start : start + size]))
            start += size
        return found

    def select(self, indices: Sequence[int]) -> Blocks:
        """Keep the columns at `indices` (and the torque)."""
        return Blocks(block.select(indices) for block in self._kept)

    def _keep(self, block: Gram | PackedGram) -> None:
        self._kept.append(block)
        self.nbytes += block.nbytes

    def described(self, columns: Sequence[Column]) -> Blocks:
        """The same moments with other names and units for the columns."""
        found = Blocks()
        for block in self._kept:
            found._keep(replace(block, columns=tuple(columns)))
        return found

    @property
    def columns(self) -> tuple[Column, ...]:
        """Columns of every block; there must be at least one block."""
        return self._kept[0].columns

    @property
    def counts(self) -> Array:
        """Samples of each block and joint, (B, J)."""
        return np.array([block.counts for block in self._kept])

    def total(self) -> Gram:
        """Sum of all blocks; there must be at least one."""
        return _whole(reduce(_sum, self._kept))

    def __len__(self) -> int:
        return len(self._kept)

    @overload
    def __getitem__(self, index: int) -> Gram: ...
    @overload
    def __getitem__(self, index: slice) -> Blocks: ...
    def __getitem__(self, index: int | slice) -> Gram | Blocks:
        if isinstance(index, int):
            return _whole(self._kept[index])
        found = Blocks()
        for block in self._kept[index]:
            found._keep(block)
        return found


def _kept(gram: Gram | PackedGram) -> Gram | PackedGram:
    """How a block is kept."""
    if isinstance(gram, Gram):
        return PackedGram.of(gram).halved() if gram.moments.nbytes > HALVED_ABOVE else gram
    return gram.halved() if sum(8 * len(own) ** 2 for own in gram.where) > HALVED_ABOVE else gram


def _whole(block: Gram | PackedGram) -> Gram:
    return block if isinstance(block, Gram) else block.whole()


def _sum(a: Gram | PackedGram, b: Gram | PackedGram) -> Gram | PackedGram:
    if isinstance(a, PackedGram) and isinstance(b, PackedGram) and _alike(a, b):
        products = tuple(x + y for x, y in zip(a.products, b.products, strict=True))
        return replace(a, products=products, sums=a.sums + b.sums, counts=a.counts + b.counts)
    return _kept(_whole(a) + _whole(b))


def _alike(a: PackedGram, b: PackedGram) -> bool:
    """Whether two packed blocks have their numbers at the same places."""
    if a.columns != b.columns or a.joints != b.joints:
        return False
    if any(x.ndim != y.ndim for x, y in zip(a.products, b.products, strict=True)):
        return False
    return a.where is b.where or all(map(np.array_equal, a.where, b.where))


def total(grams: Iterable[Gram | PackedGram]) -> Gram:
    """Sum of at least one Gram, two in memory at a time."""
    if isinstance(grams, Blocks) and len(grams):
        return grams.total()
    result: Gram | None = None
    for part in grams:
        result = _whole(part) if result is None else result + _whole(part)
    if result is None:
        raise InputError("there are no moments to sum, because no log gave a sample; give longer logs")
    return result
