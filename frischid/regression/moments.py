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

HALVED_ABOVE = 2**20
"""Bytes of moments above which only a triangle is kept; a triangle of a smaller one costs time and saves little."""


@dataclass(frozen=True, eq=False)
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
            raise InputError(
                "moments of different columns or joints cannot be added or subtracted; make both with the same effects "
                "and joints"
            )

    @property
    def nbytes(self) -> int:
        """Bytes of the moments."""
        return self.moments.nbytes

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

    def _keep(self, block: Gram | PackedGram) -> None:
        self._kept.append(block)
        self.nbytes += block.nbytes

    def described(self, columns: Sequence[Column]) -> Blocks:
        """The same moments with other names and units for the columns."""
        found = Blocks()
        for block in self._kept:
            found._keep(replace(block, columns=tuple(columns)))
        return found

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


@dataclass(frozen=True, eq=False)
class PackedGram:
    """Moments without the zeros, and where they are large, without the half that symmetry gives.

    Attributes
    ----------
    columns, joints, sums, counts
        As in `Gram`.
    where : tuple of ndarray of int
        For each joint, its n active columns; the torque, last, is column C.
    products : tuple of ndarray, shape (n, n), or shape (n (n + 1) / 2,) each
        Moments of these columns, or their lower triangle.
    """

    columns: tuple[Column, ...]
    joints: tuple[str, ...]
    where: tuple[NDArray[np.intp], ...]
    products: tuple[Array, ...]
    sums: Array
    counts: Array

    @classmethod
    def of(cls, gram: Gram) -> PackedGram:
        """Pack moments: the columns that are zero are left out."""
        where = tuple(np.flatnonzero(np.diag(M)) for M in gram.moments)
        squares = tuple(M[own[:, None], own] for M, own in zip(gram.moments, where, strict=True))
        return cls(gram.columns, gram.joints, where, squares, gram.sums, gram.counts)

    def halved(self) -> PackedGram:
        """The same with triangles only."""
        return replace(self, products=tuple(x if x.ndim == 1 else x[_lower(len(x))] for x in self.products))

    def whole(self) -> Gram:
        """The Gram that was packed."""
        size = len(self.columns) + 1
        moments = np.zeros((len(self.joints), size, size))
        for M, own, product in zip(moments, self.where, self.products, strict=True):
            M[own[:, None], own] = product if product.ndim == 2 else _square(product, len(own))
        return Gram(self.columns, self.joints, moments, self.sums, self.counts)

    @property
    def nbytes(self) -> int:
        """Bytes of the products and of their places."""
        return self.sums.nbytes + sum(x.nbytes + i.nbytes for x, i in zip(self.products, self.where, strict=True))


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


def _square(triangle: Array, size: int) -> Array:
    """The symmetric matrix of a lower triangle."""
    square = np.zeros((size, size))
    square[_lower(size)] = triangle
    square.T[_lower(size)] = triangle
    return square


@lru_cache(maxsize=64)
def _lower(size: int) -> NDArray[np.bool_]:
    return np.tri(size, dtype=bool)


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
