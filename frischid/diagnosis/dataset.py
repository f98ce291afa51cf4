"""Regression data of a diagnosis: the rows that are used, and the moments that least squares needs.

Of a candidate with columns C on the joints S, least squares needs the moments

    X_j = [Y_j τ_j]ᵀ C_j,   D_j = C_jᵀ C_j,   j ∈ S,

in each fold; of a pair of candidates it needs C_jᵀ C'_j. All moments are sums over motions, computed once for each
selection of rows. So a candidate is tried many times without reading its rows again.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np

from frischid.core.types import Array
from frischid.diagnosis.cached_motion import JointData
from frischid.diagnosis.candidate_columns import Candidate
from frischid.diagnosis.motion_cache import MotionCache
from frischid.diagnosis.stretches import Stretch
from frischid.effects import Effect
from frischid.model.model import Model

Moments = Mapping[int, Array]


class RegressionData:
    """Rows of a motion cache, without some stretches of time.

    Parameters
    ----------
    left_out : sequence of (str, float, float), optional
        Stretches of time: source, start, stop, s.

    Attributes
    ----------
    folds : int
        Parts of the data for cross-validation.
    counts : ndarray of int, shape (folds, J)
        Rows.
    gram : ndarray, shape (folds, J, p + 1, p + 1)
        Moments of [Y τ].
    """

    def __init__(self, cache: MotionCache, left_out: Sequence[Stretch] = ()) -> None:
        self.cache, self.left_out = cache, tuple(left_out)
        self.folds = cache.folds
        self._joints: dict[tuple[int, int], JointData] = {}
        self._known: dict[Candidate, tuple[Moments, Moments]] = {}
        self._between: dict[tuple[Candidate, Candidate], Moments] = {}
        p, J = len(cache.model.base), len(cache.active)
        self.counts = np.zeros((self.folds, J), int)
        self.gram = np.zeros((self.folds, J, p + 1, p + 1))
        for row in range(J):
            where = np.append(cache.active[row], p)
            for data in self.motions_of(row):
                for f, own in data.folds:
                    self.counts[f, row] += own.stop - own.start
                    self.gram[f, row][np.ix_(where, where)] += data.Z[own].T @ data.Z[own]

    @property
    def model(self) -> Model:
        """The model whose columns these are."""
        return self.cache.model

    @property
    def sources(self) -> list[str]:
        """Log of each motion."""
        return [motion.source for motion in self.cache.motions]

    @property
    def times(self) -> Iterator[Array]:
        """Times of each motion's filtered samples, s."""
        return (motion.t.read() for motion in self.cache.motions)

    def without(self, stretches: Sequence[Stretch]) -> RegressionData:
        """Leave out the rows of some further stretches of time: (source, start, stop) each, s."""
        left_out = (*self.left_out, *stretches)
        found = RegressionData(self.cache, left_out)
        # A log that is left out as a whole is a fold without rows: one fold alone predicts nothing.
        if self.folds > 1 and np.count_nonzero(found.counts.all(axis=1)) < 2:
            return RegressionData(self.cache.cut_anew(), left_out)
        return found

    # ------------------------------------------------------------------ rows

    def of_motion(self, row: int, number: int) -> JointData:
        """Rows of a joint over one motion; the object is kept where the rows are in memory."""
        if (row, number) in self._joints:
            return self._joints[row, number]
        joint = self.cache.joint(row, number, self.left_out)
        if joint.motion.in_memory:
            self._joints[row, number] = joint
        return joint

    def motions_of(self, row: int) -> Iterator[JointData]:
        """Rows of a joint, motion by motion."""
        return (self.of_motion(row, number) for number in range(len(self.cache.motions)))

    def predicted(self, data: JointData, theta: Array, added: Sequence[tuple[Candidate, Array]] = ()) -> Array:
        """Torque of a joint's rows, (n,).

        Parameters
        ----------
        theta : ndarray, shape (p,) or (folds, p)
            Base parameters; where there are several sets, each row takes that of its own fold.
        added : sequence of (Candidate, ndarray of shape (k,) or (folds, k))
            Candidates and their coefficients.
        """
        found = _times(data.Y, theta[..., self.cache.active[data.row]], data)
        for candidate, beta in added:
            if data.row in candidate.columns:
                found = found + _times(candidate.over(data), beta, data)
        return found

    # ------------------------------------------------------------------ candidates

    def candidates(
        self, effects: Sequence[Effect], progress: Callable[[str], None] = lambda _: None
    ) -> list[Candidate]:
        """Filtered columns of candidate effects, with their moments summed in one pass over the rows."""
        found = self.cache.candidates(effects, progress)
        self._sum(found)
        return found

    def _sum(self, candidates: Sequence[Candidate]) -> None:
        """Sum the moments of candidates that are not known yet, in one pass over the rows."""
        fresh = [c for c in candidates if c not in self._known]
        sums: list[tuple[dict[int, Array], dict[int, Array]]] = [({}, {}) for _ in fresh]
        for row, active in enumerate(self.cache.active):
            users = [(c, X, D) for c, (X, D) in zip(fresh, sums, strict=True) if row in c.columns]
            if not users:
                continue
            where, width = np.append(active, len(self.model.base)), len(self.model.base) + 1
            ends = np.cumsum([0, *(len(c.signs) for c, _, _ in users)]).tolist()
            cross = np.zeros((self.folds, width, ends[-1]))
            for c, _, D in users:
                D[row] = np.zeros((self.folds, len(c.signs), len(c.signs)))
            for data in self.motions_of(row):
                columns = [c.over(data) for c, _, _ in users]
                together = np.column_stack(columns)
                for f, own in data.folds:
                    cross[f][where] += data.Z[own].T @ together[own]
                    for (_, _, D), x in zip(users, columns, strict=True):
                        D[row][f] += x[own].T @ x[own]
            for (_, X, _), start, stop in zip(users, ends[:-1], ends[1:], strict=True):
                X[row] = cross[:, :, start:stop].copy()
        self._known |= dict(zip(fresh, sums, strict=True))

    def moments(self, candidate: Candidate) -> tuple[Moments, Moments]:
        """Cross moments with [Y τ] and own moments, by joint: (folds, p + 1, k) and (folds, k, k)."""
        self._sum([candidate])
        return self._known[candidate]

    def between(self, a: Candidate, b: Candidate) -> Moments:
        """Moments of two candidates, by joint: (folds, k of a, k of b)."""
        if (b, a) in self._between:
            return {row: x.transpose(0, 2, 1) for row, x in self._between[b, a].items()}
        if (a, b) not in self._between:
            found = {}
            for row in a.columns:
                if row not in b.columns:
                    continue
                found[row] = np.zeros((self.folds, len(a.signs), len(b.signs)))
                for data in self.motions_of(row):
                    A, B = a.over(data), b.over(data)
                    for f, own in data.folds:
                        found[row][f] += A[own].T @ B[own]
            self._between[a, b] = found
        return self._between[a, b]


def _times(columns: Array, theta: Array, data: JointData) -> Array:
    """Columns times coefficients (k,), or times those of each row's fold (folds, k)."""
    if theta.ndim == 1:
        return np.asarray(columns @ theta)
    out = np.empty(len(columns))
    for f, own in data.folds:
        out[own] = columns[own] @ theta[f]
    return out
