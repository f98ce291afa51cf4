"""Filtered rows of some logs and of candidate columns, and what least squares needs of them.

Logs are gone through once, motion by motion. Of every motion stay its state, which candidate columns are made from,
and the filtered rows of each joint, columns that cannot act on the joint left out; both in a `Store` (see `pieces`), so
that memory does not grow with the logs. A candidate with columns C on the joints S is known by its moments

    X_j = [Y_j τ_j]ᵀ C_j,   D_j = C_jᵀ C_j,   j ∈ S,

per fold, and two candidates by C_jᵀ C'_j; all of them are sums over motions, computed once for each selection of rows.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from frischid.core.array_store import Series, Store
from frischid.core.parallel import Here, Workers
from frischid.core.types import Array
from frischid.diagnosis.candidate_columns import Gathered, Projection, Work, columns_of, filtered, sampled
from frischid.diagnosis.change_prior import reference_of
from frischid.diagnosis.motion_cache import Part, Piece, Stretch, kept
from frischid.effects import Effect, State
from frischid.logs.filters import decimating_filter
from frischid.logs.log import Log
from frischid.logs.preprocessing import Motion
from frischid.logs.recording import Recording
from frischid.model.model import Model
from frischid.regression.regressor import Regressor

Moments = Mapping[int, Array]
SCREENED = 10  # shapes of one effect that are judged in full
SINGULAR = 1e-6  # of the largest singular value of a candidate's columns, below which they are one
MOST_FOLDS = 16  # of more logs neighbours share a fold: every candidate has its moments in every fold


class Rows:
    """Filtered rows of logs under a model.

    Parameters
    ----------
    model : Model
    logs : sequence of Log or Recording
        Every log is a fold, up to `MOST_FOLDS`; of a single one each motion is cut into four.
    workers : Workers, optional
        Where candidates' columns are computed, this process by default.
    """

    def __init__(self, model: Model, logs: Sequence[Log | Recording], workers: Workers | None = None) -> None:
        self.model, self.workers = model, workers or Here()
        self.regressor = Regressor(model.robot, model.effects, reference_of(model))
        self.motions = model.motions(logs)
        self.store = Store()
        index = {j: row for row, j in enumerate(model.torque_index)}
        self._row = index
        place = {column: k for k, column in enumerate(model.base)}
        # of a joint's columns, those of the base, and its torque; their positions among the base parameters
        base = [np.array([c for c in self.regressor.active[j] if c in place], dtype=int) for j in index]
        self._columns = [np.append(columns, len(self.regressor.columns)) for columns in base]
        self.active = [np.array([place[c] for c in columns.tolist()], dtype=int) for columns in base]
        self.cuts: tuple[Stretch, ...] = ()
        self._pieces: list[Piece] = []
        self._projections: dict[str, Projection] = {}
        self.blocks = 0
        for number, log in enumerate(logs):
            fold = None if len(logs) == 1 else number * MOST_FOLDS // max(len(logs), MOST_FOLDS)
            for motion in model.motions([log]):
                self._pieces.append(self._piece(motion, fold))
                self.blocks += self._pieces[-1].blocks
        folds = (fold for row in range(len(index)) for part in self.parts(row) for fold, _ in part.folds)
        self.folds = 1 + max(folds, default=0)
        self._recount()

    def _piece(self, motion: Motion, fold: int | None) -> Piece:
        """What is kept of a motion."""
        index, lowpass = self.model.torque_index, self.model.lowpass
        times: list[Array] = []
        used: list[NDArray[np.bool_]] = []
        Z: list[list[Array]] = [[] for _ in index]
        for block in self.regressor.blocks(motion, lowpass):
            times.append(block.t)
            used.append(block.used)
            for parts, columns, j in zip(Z, self._columns, index, strict=True):
                parts.append(block.Z[:, columns, j][block.used[:, j]])
        moving = np.concatenate(used)
        return Piece(
            len(self._pieces),
            motion.source,
            motion.start,
            tuple(motion.extra),
            len(motion.t),
            motion.step,
            fold,
            self.blocks,
            max(1.0, 12 / (lowpass.cutoff or 12)),
            [int(n) for n in moving[:, index].sum(axis=0)],
            self.store.put(np.concatenate(times)),
            [self.store.put(np.concatenate(parts)) for parts in Z],
            [self.store.put(np.flatnonzero(moving[:, j]).astype(np.int32)) for j in index],
            kept(self.regressor.state(motion), self.store),
        )

    def _state(self, piece: Piece) -> State:
        if isinstance(piece.state, State):
            return piece.state
        arrays = {name: kept.read() for name, kept in piece.state.items()}
        extra = {name: arrays.pop(f"extra {name}") for name in piece.extra}
        rigid = self.regressor.reference[: len(self.model.robot.columns)]
        return State(
            self.model.robot, **arrays, start=piece.start, extra=extra, reference=rigid, dry=self.regressor.dry
        )

    def _recount(self) -> None:
        """Moments of [Y τ] of these rows; none yet of any candidate."""
        self._known: dict[Projection, tuple[Moments, Moments]] = {}
        self._between: dict[tuple[Projection, Projection], Moments] = {}
        p, J = len(self.model.base), len(self.active)
        self.counts = np.zeros((self.folds, J), int)
        self.gram = np.zeros((self.folds, J, p + 1, p + 1))
        for row in range(J):
            where = np.append(self.active[row], p)
            for part in self.parts(row):
                for f, own in part.folds:
                    self.counts[f, row] += own.stop - own.start
                    self.gram[f, row][np.ix_(where, where)] += part.Z[own].T @ part.Z[own]

    @property
    def sources(self) -> list[str]:
        """The log of each motion."""
        return [piece.source for piece in self._pieces]

    @property
    def times(self) -> Iterator[Array]:
        """Times of each motion's filtered samples, s."""
        return (piece.t.read() for piece in self._pieces)

    @property
    def channels(self) -> set[str]:
        """Further channels that every log has."""
        return set.intersection(*(set(piece.extra) for piece in self._pieces))

    def sampled(self) -> Iterator[State]:
        """The state of each motion at its filtered samples."""
        for piece in self._pieces:
            yield sampled(self._state(piece), piece.t.read())

    def without(self, stretches: Sequence[Stretch]) -> Rows:
        """Leave out rows of some stretches of time: (source, start, stop) each, s."""
        new = object.__new__(Rows)
        new.__dict__.update(self.__dict__)
        new.cuts = (*self.cuts, *stretches)
        new._recount()
        return new

    # ------------------------------------------------------------------ rows

    def part(self, row: int, number: int) -> Part:
        """Rows of a joint over one motion."""
        return Part(self._pieces[number], row, self.cuts)

    def parts(self, row: int) -> Iterator[Part]:
        """Rows of a joint, motion by motion."""
        return (self.part(row, number) for number in range(len(self._pieces)))

    def predicted(self, part: Part, theta: Array, added: Sequence[tuple[Projection, Array]] = ()) -> Array:
        """Torque of some rows, (n,).

        Parameters
        ----------
        part : Part
        theta : ndarray, shape (p,) or (folds, p)
            Base parameters; of each row's own fold where there are several.
        added : sequence of (Projection, ndarray of shape (k,) or (folds, k))
            Candidates and their coefficients.
        """
        found = _times(part.Y, theta[..., self.active[part.row]], part)
        for projection, beta in added:
            if part.row in projection.columns:
                found = found + _times(projection.over(part), beta, part)
        return found

    # ------------------------------------------------------------------ candidates

    def project(self, effects: Sequence[Effect], progress: Callable[[str], None] = lambda _: None) -> list[Projection]:
        """Filtered columns of candidate effects over all rows, and their moments."""
        fresh = list({str(e): e for e in effects if str(e) not in self._projections}.values())
        groups = [list(group) for _, group in groupby(fresh, lambda effect: effect.id)]
        gathered = [Gathered(self.store) for _ in fresh]
        lowpass = self.model.lowpass
        for number, piece in enumerate(self._pieces if fresh else ()):
            F = decimating_filter(lowpass.taps(piece.step), piece.raw, lowpass.decimation(piece.step))
            work = Work(self._state(piece), F, self._row, [picked.read() for picked in piece.picked])
            (there,) = self.workers.map(_same, [work])
            parts = []
            for group in groups:
                progress(f"trying {group[0].id}")
                parts += self.workers.map(filtered, [group], there)
            done = [columns for part in self.workers.gather(parts) for columns in part]
            for found, columns in zip(gathered, done, strict=True):
                found.add(columns, self._pieces[: number + 1])
        for effect, found in zip(fresh, gathered, strict=True):
            self._projections[str(effect)] = Projection(effect, found.series, found.signs, found.finite)
        whole = [self._projections[str(effect)] for effect in effects]
        self._sum(whole)
        return whole

    def given(self, effect: Effect, row: int, values: Sequence[Array]) -> Projection:
        """Stand for a candidate on one joint by its values at each motion's filtered samples."""
        series = Series(self.store)
        for piece, x in zip(self._pieces, values, strict=True):
            series.append(x[piece.picked[row].read(), None])
        return Projection(effect, {row: series}, (0,))

    def joined(self, parts: Sequence[Projection]) -> Projection:
        """Several places of an effect as one candidate."""
        columns: dict[int, Series] = {}
        for row in sorted({row for p in parts for row in p.columns}):
            columns[row] = Series(self.store)
            for number, piece in enumerate(self._pieces):
                none = [np.zeros((piece.counts[row], len(p.signs))) for p in parts]
                found = [p.columns[row][number] if row in p.columns else x for p, x in zip(parts, none, strict=True)]
                columns[row].append(np.column_stack(found))
        return Projection(parts[0].effect, columns, tuple(s for p in parts for s in p.signs))

    def _sum(self, projections: Sequence[Projection]) -> None:
        """Moments of candidates that are not known yet, in one go through the rows."""
        fresh = [p for p in projections if p not in self._known]
        sums: list[tuple[dict[int, Array], dict[int, Array]]] = [({}, {}) for _ in fresh]
        for row, active in enumerate(self.active):
            users = [(p, X, D) for p, (X, D) in zip(fresh, sums, strict=True) if row in p.columns]
            if not users:
                continue
            where, p0 = np.append(active, len(self.model.base)), len(self.model.base) + 1
            widths = [len(p.signs) for p, _, _ in users]
            ends = np.cumsum([0, *widths]).tolist()
            cross = np.zeros((self.folds, p0, ends[-1]))
            for p, _, D in users:
                D[row] = np.zeros((self.folds, len(p.signs), len(p.signs)))
            for part in self.parts(row):
                C = [p.over(part) for p, _, _ in users]
                together = np.column_stack(C)
                for f, own in part.folds:
                    cross[f][where] += part.Z[own].T @ together[own]
                    for (_, _, D), x in zip(users, C, strict=True):
                        D[row][f] += x[own].T @ x[own]
            for (_, X, _), start, stop in zip(users, ends[:-1], ends[1:], strict=True):
                X[row] = cross[:, :, start:stop].copy()
        self._known |= dict(zip(fresh, sums, strict=True))

    def moments(self, projection: Projection) -> tuple[Moments, Moments]:
        """Cross moments with [Y τ] and own moments, by joint: (folds, p + 1, k) and (folds, k, k)."""
        self._sum([projection])
        return self._known[projection]

    def between(self, a: Projection, b: Projection) -> Moments:
        """Moments of two candidates, by joint: (folds, k of a, k of b)."""
        if (b, a) in self._between:
            return {row: x.transpose(0, 2, 1) for row, x in self._between[b, a].items()}
        if (a, b) not in self._between:
            found = {}
            for row in a.columns:
                if row not in b.columns:
                    continue
                found[row] = np.zeros((self.folds, len(a.signs), len(b.signs)))
                for part in self.parts(row):
                    A, B = a.over(part), b.over(part)
                    for f, own in part.folds:
                        found[row][f] += A[own].T @ B[own]
            self._between[a, b] = found
        return self._between[a, b]

    def screened(
        self,
        places: Sequence[Sequence[Effect]],
        left: Callable[[Part], Array],
        omega: Array,
        keep: int = SCREENED,
    ) -> list[Sequence[Effect]]:
        """Of the many shapes of each effect those that best fit what is left, judged by unfiltered columns at the rows.

        Parameters
        ----------
        places : sequence of sequence of Effect
            Shapes of one effect in one place each.
        left : callable
            Residual of some rows.
        omega : ndarray, shape (J,)
            Weight of each joint's square.
        """
        many = [n for n, effects in enumerate(places) if len(effects) > 2 * keep and not any(e.memory for e in effects)]
        sums: dict[tuple[int, int, int], Array] = {}
        for number, state in enumerate(self.sampled() if many else ()):
            rows = [self.part(row, number) for row in range(len(self.active))]
            known = [(part.picked, left(part)) for part in rows]
            for n in many:
                for i, effect in enumerate(places[n]):
                    for row, C in columns_of(effect.terms(state), self._row, len(state.t)).items():
                        picked, x = known[row]
                        Z = np.column_stack([np.ones(len(x)), C[picked], x])
                        sums[n, i, row] = sums.get((n, i, row), 0.0) + Z.T @ Z
        gains = {n: np.zeros(len(places[n])) for n in many}
        for (n, i, row), S in sums.items():
            gains[n][i] += omega[row] * _explained(S)
        best = {n: sorted(np.argsort(gain)[::-1][:keep].tolist()) for n, gain in gains.items()}
        return [[effects[i] for i in best[n]] if n in best else effects for n, effects in enumerate(places)]


def _same(work: Work) -> Work:
    return work


def _times(columns: Array, theta: Array, part: Part) -> Array:
    """Columns times coefficients (k,), or times those of each row's fold (folds, k)."""
    if theta.ndim == 1:
        return np.asarray(columns @ theta)
    out = np.empty(len(columns))
    for f, own in part.folds:
        out[own] = columns[own] @ theta[f]
    return out


def _explained(sums: Array) -> float:
    """Squares that columns C explain of x, means taken off C, from the sums of [1 C x]ᵀ [1 C x]."""
    n, mean = sums[0, 0], sums[0, 1:-1]
    values, vectors = np.linalg.eigh(sums[1:-1, 1:-1] - np.outer(mean, mean) / n)
    along = vectors.T @ (sums[1:-1, -1] - mean * sums[0, -1] / n)
    keep = values > SINGULAR**2 * max(values[-1], 1e-300)
    return float((along[keep] ** 2 / values[keep]).sum())
