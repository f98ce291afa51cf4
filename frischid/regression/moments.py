"""Second moments of the stacked regression: least squares needs nothing else from a log.

For every joint j the sums ``G_j = Σ_k z_jk z_jkᵀ`` with ``z_jk = [y_jk ; τ_jk]`` are kept, where ``y_jk`` is the
regressor row of joint j at sample k. Sums add: chunks of a log, several logs, and logs of many machines are joined by
the same ``+``, and a cross-validation fold is left out by ``-``. Every least-squares quantity follows from the moments,

    YᵀWY = Σ_j w_j G_j[:C, :C],   YᵀWτ = Σ_j w_j G_j[:C, C],   τᵀWτ = Σ_j w_j G_j[C, C].

Another set of effects is another choice of columns.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from frischid.core.types import Array, Column
from frischid.errors import InputError, UnknownNameError


@dataclass(frozen=True, eq=False)
class Gram:
    """Moments of [Y τ] per joint."""

    columns: tuple[Column, ...]
    """The C columns of Y."""
    joints: tuple[str, ...]
    """The J joints whose torque rows were summed."""
    moments: Array
    """``Σ_k z_k z_kᵀ`` of each joint, torque last, (J, C + 1, C + 1)."""
    sums: Array
    """``Σ_k z_k`` of each joint, for means and variances, (J, C + 1)."""
    counts: Array
    """Samples summed for each joint, (J,)."""

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
        return np.asarray(np.maximum(self.moments @ direction @ direction, 0.0))

    def torque_ss(self) -> Array:
        """Return the sum of squares of each joint's torque about its mean, shape (J,)."""
        mean = self.sums[:, -1] / np.maximum(self.counts, 1.0)
        return np.asarray(np.maximum(self.moments[:, -1, -1] - self.counts * mean**2, 0.0))


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

    def select(self, indices: Sequence[int]) -> PackedGram:
        """Keep the columns at `indices` (and the torque)."""
        keep = np.append(np.asarray(indices, dtype=int), len(self.columns))
        place = np.full(len(self.columns) + 1, -1)
        place[keep] = np.arange(len(keep))
        left = [place[own] for own in self.where]
        kept = [np.flatnonzero(new >= 0) for new in left]
        return PackedGram(
            tuple(self.columns[i] for i in indices),
            self.joints,
            tuple(new[at] for new, at in zip(left, kept, strict=True)),
            tuple(square[at[:, None], at] for square, at in zip(self._squares(), kept, strict=True)),
            self.sums[:, keep],
            self.counts,
        )

    def whole(self) -> Gram:
        """The Gram that was packed."""
        size = len(self.columns) + 1
        moments = np.zeros((len(self.joints), size, size))
        for M, own, square in zip(moments, self.where, self._squares(), strict=True):
            M[own[:, None], own] = square
        return Gram(self.columns, self.joints, moments, self.sums, self.counts)

    def _squares(self) -> Iterator[Array]:
        """Moments of each joint's active columns, (n, n)."""
        for own, product in zip(self.where, self.products, strict=True):
            yield product if product.ndim == 2 else _square(product, len(own))

    @property
    def nbytes(self) -> int:
        """Bytes of the products and of their places."""
        return self.sums.nbytes + sum(x.nbytes + i.nbytes for x, i in zip(self.products, self.where, strict=True))


def _square(triangle: Array, size: int) -> Array:
    """The symmetric matrix of a lower triangle."""
    square = np.zeros((size, size))
    square[_lower(size)] = triangle
    square.T[_lower(size)] = triangle
    return square


@lru_cache(maxsize=64)
def _lower(size: int) -> NDArray[np.bool_]:
    return np.tri(size, dtype=bool)
