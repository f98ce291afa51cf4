"""Second moments of the stacked regression: least squares needs nothing else from a log.

For every joint j the sums ``G_j = Σ_k z_jk z_jkᵀ`` with ``z_jk = [y_jk ; τ_jk]`` are kept, where ``y_jk`` is the
regressor row of joint j at sample k. Sums add: chunks of a log, several logs, and logs of many machines are joined by
the same ``+``, and a cross-validation fold is left out by ``-``. Every least-squares quantity follows from the moments,

    YᵀWY = Σ_j w_j G_j[:C, :C],   YᵀWτ = Σ_j w_j G_j[:C, C],   τᵀWτ = Σ_j w_j G_j[C, C].

Another set of effects is another choice of columns.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, reduce
from typing import overload

import numpy as np
from numpy.typing import NDArray

from frischid.core.types import Array, Column
from frischid.errors import InputError, UnknownNameError

PACKED_ABOVE = 2**20
"""Bytes of moments above which a block is packed; packing a smaller block takes longer than adding it."""


@dataclass(frozen=True)
class Gram:
    """Moments of [Y τ] per joint.

    Attributes
    ----------
    columns : tuple of Column
        The C columns of Y.
    joints : tuple of str
        The J joints whose torque rows were summed.
    moments : ndarray, shape (J, C + 1, C + 1)
        ``Σ_k z_k z_kᵀ`` of each joint, torque last.
    sums : ndarray, shape (J, C + 1)
        ``Σ_k z_k`` of each joint, for means and variances.
    counts : ndarray, shape (J,)
        Samples summed for each joint.
    """

    columns: tuple[Column, ...]
    joints: tuple[str, ...]
    moments: Array
    sums: Array
    counts: Array

    @classmethod
    def zeros(cls, columns: Sequence[Column], joints: Sequence[str]) -> Gram:
        """Return the empty sum."""
        J, C = len(joints), len(columns)
        return cls(tuple(columns), tuple(joints), np.zeros((J, C + 1, C + 1)), np.zeros((J, C + 1)), np.zeros(J))

    def __add__(self, other: Gram) -> Gram:
        self._check_same(other)
        return replace(
            self,
            moments=self.moments + other.moments,
            sums=self.sums + other.sums,
            counts=self.counts + other.counts,
        )

    def __sub__(self, other: Gram) -> Gram:
        self._check_same(other)
        return replace(
            self,
            moments=self.moments - other.moments,
            sums=self.sums - other.sums,
            counts=self.counts - other.counts,
        )

    def _check_same(self, other: Gram) -> None:
        if self.columns != other.columns or self.joints != other.joints:
            raise InputError("two Grams of different columns or joints cannot be added or subtracted")

    @property
    def names(self) -> tuple[str, ...]:
        """Parameter names of the columns."""
        return tuple(c.name for c in self.columns)

    @property
    def rows(self) -> int:
        """Torque rows summed over all joints."""
        return int(self.counts.sum())

    def index(self, names: Iterable[str]) -> list[int]:
        """Column indices of parameter names.

        Raises
        ------
        UnknownNameError
            A name is not a column of this Gram.
        """
        where = {name: i for i, name in enumerate(self.names)}
        wanted = list(names)
        for name in wanted:
            if name not in where:
                raise UnknownNameError("parameter", name, where)
        return [where[name] for name in wanted]

    def select(self, indices: Sequence[int]) -> Gram:
        """Keep the columns at `indices` (and the torque)."""
        keep = np.append(np.asarray(indices, dtype=int), len(self.columns))
        return replace(
            self,
            columns=tuple(self.columns[i] for i in indices),
            moments=self.moments[:, keep[:, None], keep[None, :]],
            sums=self.sums[:, keep],
        )

    def weighted(self, weights: Array | None = None) -> Array:
        """Weighted sum of the joints' moments.

        Parameters
        ----------
        weights : ndarray, shape (J,), optional
            Weight of each joint's squared residual, ones by default.

        Returns
        -------
        ndarray, shape (C + 1, C + 1)
            ``Σ_j w_j G_j``.
        """
        if weights is None:
            return np.asarray(self.moments.sum(axis=0))
        return np.asarray(np.tensordot(weights, self.moments, axes=1))

    def residual_ss(self, theta: Array) -> Array:
        """Sum of squared residuals ``Σ_k (τ_k − y_k θ)²`` of each joint.

        Parameters
        ----------
        theta : ndarray, shape (C,)

        Returns
        -------
        ndarray, shape (J,)
        """
        direction = np.append(theta, -1.0)
        return np.asarray(np.maximum(np.einsum("a,jab,b->j", direction, self.moments, direction), 0.0))

    def torque_ss(self) -> Array:
        """Return the sum of squares of each joint's torque about its mean, shape (J,)."""
        mean = self.sums[:, -1] / np.maximum(self.counts, 1.0)
        return np.asarray(np.maximum(self.moments[:, -1, -1] - self.counts * mean**2, 0.0))


class Blocks(Sequence[Gram]):
    """Moments of consecutive stretches of time.

    Large blocks are packed, and unpacked when they are asked for. Moments are symmetric, and a joint's columns of links
    that it does not move are zero, so only a triangle over the nonzero columns is kept. For a chain of thirty joints
    that is a sixth of the numbers. Small blocks are not packed: packing takes longer than adding.
    """

    def __init__(self, grams: Iterable[Gram] = ()) -> None:
        self._kept: list[Gram | _Packed] = []
        for gram in grams:
            self.append(gram)

    def append(self, gram: Gram) -> None:
        """Append a block."""
        self._kept.append(_kept(gram))

    def merge(self, gram: Gram) -> None:
        """Add moments to the last block."""
        self._kept[-1] = _sum(self._kept[-1], _kept(gram))

    def halve(self) -> None:
        """Add each pair of neighbouring blocks; the number of blocks must be even."""
        self._kept = [_sum(a, b) for a, b in zip(self._kept[::2], self._kept[1::2], strict=True)]

    def described(self, columns: Sequence[Column]) -> Blocks:
        """The same moments with other names and units for the columns."""
        found = Blocks()
        found._kept = [replace(block, columns=tuple(columns)) for block in self._kept]
        return found

    def total(self) -> Gram:
        """Sum of all blocks; there must be at least one."""
        return _whole(reduce(_sum, self._kept))

    @property
    def nbytes(self) -> int:
        """Bytes of all blocks together."""
        return sum(block.moments.nbytes if isinstance(block, Gram) else block.nbytes for block in self._kept)

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
        found._kept = self._kept[index]
        return found


def _kept(gram: Gram) -> Gram | _Packed:
    return _Packed.of(gram) if gram.moments.nbytes > PACKED_ABOVE else gram


def _whole(block: Gram | _Packed) -> Gram:
    return block if isinstance(block, Gram) else block.whole()


def _sum(a: Gram | _Packed, b: Gram | _Packed) -> Gram | _Packed:
    if isinstance(a, _Packed) and isinstance(b, _Packed) and all(map(np.array_equal, a.where, b.where)):
        triangles = tuple(x + y for x, y in zip(a.triangles, b.triangles, strict=True))
        return replace(a, triangles=triangles, sums=a.sums + b.sums, counts=a.counts + b.counts)
    return _kept(_whole(a) + _whole(b))


@dataclass(frozen=True, eq=False)
class _Packed:
    """A Gram without its zeros and without the half that symmetry gives."""

    columns: tuple[Column, ...]
    joints: tuple[str, ...]
    where: tuple[NDArray[np.intp], ...]
    triangles: tuple[Array, ...]
    sums: Array
    counts: Array

    @classmethod
    def of(cls, gram: Gram) -> _Packed:
        where = tuple(np.flatnonzero(np.diag(M)) for M in gram.moments)
        triangles = tuple(M[own[:, None], own][_lower(len(own))] for M, own in zip(gram.moments, where, strict=True))
        return cls(gram.columns, gram.joints, where, triangles, gram.sums, gram.counts)

    def whole(self) -> Gram:
        """The Gram that was packed."""
        size = len(self.columns) + 1
        moments = np.zeros((len(self.joints), size, size))
        for M, own, triangle in zip(moments, self.where, self.triangles, strict=True):
            square = np.zeros((len(own), len(own)))
            square[_lower(len(own))] = triangle
            square.T[_lower(len(own))] = triangle
            M[own[:, None], own] = square
        return Gram(self.columns, self.joints, moments, self.sums, self.counts)

    @property
    def nbytes(self) -> int:
        return self.sums.nbytes + sum(x.nbytes + i.nbytes for x, i in zip(self.triangles, self.where, strict=True))


@lru_cache(maxsize=64)
def _lower(size: int) -> NDArray[np.bool_]:
    return np.tri(size, dtype=bool)


def total(grams: Iterable[Gram]) -> Gram:
    """Sum of at least one Gram, two in memory at a time."""
    if isinstance(grams, Blocks) and len(grams):
        return grams.total()
    result: Gram | None = None
    for part in grams:
        result = part if result is None else result + part
    if result is None:
        raise InputError("no Gram to sum: no log gave any sample")
    return result
