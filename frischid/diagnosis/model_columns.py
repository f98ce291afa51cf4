"""The columns of a model over the data: its own base columns Y, and the columns C_i of candidates added to it.

Least squares needs only their moments, in each fold and for each joint:

    [Y  C_1  C_2 ...  τ]ᵀ [Y  C_1  C_2 ...  τ].

An added candidate puts its columns behind the others. Its moments are known (`dataset`), so no row is read again.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from frischid.core.types import Array
from frischid.diagnosis.cached_motion import JointData
from frischid.diagnosis.candidate_columns import Candidate
from frischid.diagnosis.dataset import Moments, RegressionData


@dataclass(frozen=True, eq=False)
class ModelColumns:
    """Columns of a model with some candidates added, p columns in all."""

    data: RegressionData
    gram: Array
    """Moments of all columns and the torque, (folds, J, p + 1, p + 1)."""
    added: tuple[Candidate, ...] = ()
    """Candidates that were added, in order."""

    @classmethod
    def of(cls, data: RegressionData, added: tuple[Candidate, ...] = ()) -> ModelColumns:
        """Columns of the model over some data, with candidates added one after another."""
        columns = cls(data, data.gram)
        for candidate in added:
            columns = columns.extended(candidate)
        return columns

    @property
    def width(self) -> int:
        """Number of columns."""
        return int(self.gram.shape[-1]) - 1

    @cached_property
    def signs(self) -> NDArray[np.int_]:
        """Known sign of each column's coefficient, (p,); 0 where unknown.

        As in `identify`, parameters of links have none, and a rotor may be negative (behind a torque sensor). A model
        without a prior was fitted without signs.
        """
        model = self.data.model
        free = {"rigid", "rotor_inertia"} if model.prior is not None else {c.effect for c in model.estimate.columns}
        own = [0 if c.effect in free else c.sign for c in model.estimate.columns]
        return np.array([*own, *(sign for a in self.added for sign in a.signs)], dtype=int)

    @cached_property
    def bounded(self) -> NDArray[np.intp]:
        """Positions of the columns of known sign."""
        return np.flatnonzero(self.signs)

    def extended(self, candidate: Candidate) -> ModelColumns:
        """Add a candidate."""
        X, D = self.moments(candidate)
        p, k = self.width, len(candidate.signs)
        gram = np.zeros((*self.gram.shape[:2], p + k + 1, p + k + 1))
        old, new = np.append(np.arange(p), p + k), np.arange(p, p + k)
        gram[:, :, old[:, None], old] = self.gram
        for row, x in X.items():
            gram[:, row][:, old[:, None], new] = x
            gram[:, row][:, new[:, None], old] = x.transpose(0, 2, 1)
            gram[:, row][:, new[:, None], new] = D[row]
        return replace(self, gram=gram, added=(*self.added, candidate))

    def moments(self, candidate: Candidate) -> tuple[Moments, Moments]:
        """Cross moments with [Y C_1 ... τ] and own moments, by joint: (folds, p + 1, k) and (folds, k, k)."""
        X, D = self.data.moments(candidate)
        if not self.added:
            return X, D
        between = [self.data.between(a, candidate) for a in self.added]
        k = len(candidate.signs)
        cross = {}
        for row, x in X.items():
            none = [np.zeros((self.data.folds, len(a.signs), k)) for a in self.added]
            others = [found.get(row, zero) for found, zero in zip(between, none, strict=True)]
            cross[row] = np.concatenate([x[:, :-1], *others, x[:, -1:]], axis=1)
        return cross, D

    def predicted(
        self, data: JointData, theta: Array, candidate: Candidate | None = None, beta: Array | None = None
    ) -> Array:
        """Torque of a joint's rows, (n,).

        Parameters
        ----------
        theta : ndarray, shape (p,) or (folds, p)
            Parameters; where there are several sets, each row takes that of its own fold.
        candidate : Candidate, optional
            A further candidate that was not added.
        beta : ndarray, shape (k,) or (folds, k), optional
            Coefficients of that candidate.
        """
        ends = np.cumsum([len(self.data.model.base), *(len(a.signs) for a in self.added)]).tolist()
        added = [(a, theta[..., start:stop]) for a, start, stop in zip(self.added, ends[:-1], ends[1:], strict=True)]
        if candidate is not None and beta is not None:
            added.append((candidate, beta))
        return self.data.predicted(data, theta[..., : ends[0]], added)

    def over(self, data: JointData) -> tuple[NDArray[np.intp], Array]:
        """Positions of the k columns that act on a joint, (k,), and their values at its rows, (n, k)."""
        places, values, start = [self.data.cache.active[data.row]], [data.Y], len(self.data.model.base)
        for candidate in self.added:
            if data.row in candidate.columns:
                places.append(np.arange(start, start + len(candidate.signs)))
                values.append(candidate.over(data))
            start += len(candidate.signs)
        return np.concatenate(places), np.concatenate(values, axis=1)

    def residual(self, data: JointData, theta: Array) -> Array:
        """Residual of a joint's rows over one motion under some parameters, (n,)."""
        return np.asarray(data.tau - self.predicted(data, theta))

    def residuals(self, row: int, theta: Array) -> Iterator[Array]:
        """The same motion by motion."""
        return (self.residual(data, theta) for data in self.data.motions_of(row))
