"""Filtered rows of some logs and of candidate columns, and what least squares needs of them.

Logs are gone through once, motion by motion. Of every motion stay its state, which candidate columns are made from,
and the filtered rows of each joint, columns that cannot act on the joint left out; both in a `Store`, so that memory
does not grow with the logs. What grows with samples × joints is the torque and a row's fold, block and number. A
candidate with columns C on the joints S is known by its moments

    X_j = [Y_j τ_j]ᵀ C_j,   D_j = C_jᵀ C_j,   j ∈ S,

per fold, and two candidates by C_jᵀ C'_j; all of them are sums over motions, computed once for each selection of rows.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby, pairwise

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from frischid.cluster import Here, Workers
from frischid.effects import Effect, State, Term
from frischid.gram import Array
from frischid.log import Log
from frischid.model import Model
from frischid.prior import reference_of
from frischid.recording import Recording
from frischid.regressor import Regressor
from frischid.signals import Motion, decimating_filter
from frischid.store import Store, Stored

Indices = NDArray[np.intp]
Moments = Mapping[int, Array]
SCREENED = 10  # shapes of one effect that are judged in full
SINGULAR = 1e-6  # of the largest singular value of a candidate's columns, below which they are one
QUARTERS = 4  # folds of a single log
MOST_FOLDS = 16  # of more logs neighbours share a fold: every candidate has its moments in every fold


@dataclass(frozen=True, eq=False)
class JointRows:
    """Rows of one joint over all logs, n of them.

    Attributes
    ----------
    tau : ndarray, shape (n,)
    fold : ndarray of int, shape (n,)
        Part of the data the row belongs to.
    block : ndarray of int, shape (n,)
        Stretch of about a second the row belongs to.
    picked : list of ndarray of int
        For each motion, which filtered samples these rows are.
    """

    tau: Array
    fold: NDArray[np.int32]
    block: NDArray[np.int32]
    picked: list[NDArray[np.int32]]

    def parts(self) -> Iterator[slice]:
        """Rows of each motion."""
        ends = np.cumsum([0, *map(len, self.picked)]).tolist()
        return map(slice, ends[:-1], ends[1:])


@dataclass(frozen=True, eq=False)
class Projection:
    """One candidate's columns over all rows: position in the joints -> for each motion, (rows, k)."""

    effect: Effect
    columns: Mapping[int, Sequence[Stored]]
    signs: tuple[int, ...]
    finite: bool = True


@dataclass(frozen=True, eq=False)
class _Piece:
    """One motion: its state, and the filtered columns of each joint."""

    source: str
    t: Array
    state: State | Mapping[str, Stored]
    Y: Sequence[Stored]
    picked: Sequence[NDArray[np.int32]]
    start: float
    extra: Sequence[str]
    filter: tuple[Array, int, int]


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
        # of a joint's columns, those of the base; their positions among the base parameters
        self._columns = [np.array([c for c in self.regressor.active[j] if c in place], dtype=int) for j in index]
        self.active = [np.array([place[c] for c in columns.tolist()], dtype=int) for columns in self._columns]
        self._pieces: list[_Piece] = []
        self._projections: dict[str, Projection] = {}
        found: list[list[JointRows]] = [[] for _ in index]
        blocks = 0
        for number, log in enumerate(logs):
            for motion in model.motions([log]):
                piece, tau = self._piece(motion)
                quarters = np.minimum(QUARTERS * np.arange(len(piece.t)) // max(len(piece.t), 1), QUARTERS - 1)
                together = number * MOST_FOLDS // max(len(logs), MOST_FOLDS)
                fold = quarters if len(logs) == 1 else np.full(len(piece.t), together)
                second = max(1.0, 12 / (model.lowpass.cutoff or 12))
                block = blocks + ((piece.t - piece.t[:1]) / second).astype(int)
                blocks = int(block.max(initial=blocks - 1)) + 1
                self._pieces.append(piece)
                for row, keep in enumerate(piece.picked):
                    f, b = fold[keep].astype(np.int32), block[keep].astype(np.int32)
                    found[row].append(JointRows(tau[row], f, b, [keep]))
        self.joints = [
            JointRows(
                np.concatenate([part.tau for part in parts]),
                np.concatenate([part.fold for part in parts]),
                np.concatenate([part.block for part in parts]),
                [picked for part in parts for picked in part.picked],
            )
            for parts in found
        ]
        # which of the stored rows these are, by joint and motion
        self._at: list[list[Indices | slice]] = [[slice(None)] * len(self._pieces) for _ in index]
        self.folds = 1 + max(int(r.fold.max()) for r in self.joints)
        self._recount()

    def _piece(self, motion: Motion) -> tuple[_Piece, list[Array]]:
        """What is kept of a motion, and the torque of every joint's rows."""
        index = self.model.torque_index
        times: list[Array] = []
        Y: list[list[Array]] = [[] for _ in index]
        tau: list[list[Array]] = [[] for _ in index]
        used = []
        for block in self.regressor.blocks(motion, self.model.lowpass):
            times.append(block.t)
            used.append(block.used)
            for row, j in enumerate(index):
                keep = np.flatnonzero(block.used[:, j])
                Y[row].append(block.Z[:, self._columns[row], j][keep])
                tau[row].append(block.tau[keep, j])
        t, moving = np.concatenate(times), np.concatenate(used)
        lowpass, step = self.model.lowpass, motion.step
        return _Piece(
            motion.source,
            t,
            self._kept(self.regressor.state(motion)),
            [self.store.put(np.concatenate(parts)) for parts in Y],
            [np.flatnonzero(moving[:, j]).astype(np.int32) for j in index],
            motion.start,
            tuple(motion.extra),
            (lowpass.taps(step), len(motion.t), lowpass.decimation(step)),
        ), [np.concatenate(parts) for parts in tau]

    def _kept(self, state: State) -> State | Mapping[str, Stored]:
        """A state, in memory only if there is room for what effects derive from it as well (`State.slopes`)."""
        samples, joints = state.q.shape
        if self.store.takes(8 * samples * (1 + joints * (6 + 3 * joints) + len(state.extra))):
            return state
        arrays = {name: getattr(state, name) for name in ("t", "q", "v", "a", "load", "torque", "drag")}
        arrays |= {f"extra {name}": x for name, x in state.extra.items()}
        return {name: self.store.put(x) for name, x in arrays.items()}

    def _state(self, piece: _Piece) -> State:
        if isinstance(piece.state, State):
            return piece.state
        arrays = {name: kept.read() for name, kept in piece.state.items()}
        extra = {name: arrays.pop(f"extra {name}") for name in piece.extra}
        rigid = self.regressor.reference[: len(self.model.robot.columns)]
        return State(self.model.robot, **arrays, start=piece.start, extra=extra, reference=rigid)

    def _recount(self) -> None:
        """Moments of [Y τ] of these rows; none yet of any candidate."""
        self._known: dict[Projection, tuple[Moments, Moments]] = {}
        self._between: dict[tuple[Projection, Projection], Moments] = {}
        self.counts = np.array([np.bincount(r.fold, minlength=self.folds) for r in self.joints]).T
        p = len(self.model.base)
        self.gram = np.zeros((self.folds, len(self.joints), p + 1, p + 1))
        for row, r in enumerate(self.joints):
            where = np.append(self.active[row], p)
            for number, part in enumerate(r.parts()):
                Z = np.column_stack([self._Y(row, number), r.tau[part]])
                for f, own in _by_fold(r.fold[part]):
                    self.gram[f, row][np.ix_(where, where)] += Z[own].T @ Z[own]

    @property
    def sources(self) -> list[str]:
        """The log of each motion."""
        return [piece.source for piece in self._pieces]

    @property
    def times(self) -> list[Array]:
        """Times of each motion's filtered samples, s."""
        return [piece.t for piece in self._pieces]

    @property
    def channels(self) -> set[str]:
        """Further channels that every log has."""
        return set.intersection(*(set(piece.extra) for piece in self._pieces))

    def sampled(self) -> Iterator[State]:
        """The state of each motion at its filtered samples."""
        for piece in self._pieces:
            yield _sampled(self._state(piece), piece.t)

    def without(self, stretches: Sequence[tuple[str, float, float]]) -> Rows:
        """Leave out rows of some stretches of time: (source, start, stop) each, s."""
        new = object.__new__(Rows)
        new.__dict__.update(self.__dict__)
        new.joints, new._at = [], []
        for r, at in zip(self.joints, self._at, strict=True):
            kept = []
            for piece, picked in zip(self._pieces, r.picked, strict=True):
                t = piece.t[picked]
                inside = [(t >= a) & (t <= b) for source, a, b in stretches if source == piece.source]
                kept.append(~np.any(inside, axis=0) if inside else np.ones(len(t), bool))
            keep = np.concatenate(kept)
            picks = [p[k] for p, k in zip(r.picked, kept, strict=True)]
            new.joints.append(JointRows(r.tau[keep], r.fold[keep], r.block[keep], picks))
            new._at.append([np.flatnonzero(k) if isinstance(a, slice) else a[k] for a, k in zip(at, kept, strict=True)])
        new._recount()
        return new

    # ------------------------------------------------------------------ rows

    def _Y(self, row: int, number: int) -> Array:
        """The base columns that act on a joint, over its rows of one motion."""
        return self._pieces[number].Y[row].read()[self._at[row][number]]

    def _C(self, projection: Projection, row: int, number: int) -> Array:
        return projection.columns[row][number].read()[self._at[row][number]]

    def predicted(self, row: int, theta: Array, added: Sequence[tuple[Projection, Array]] = ()) -> Array:
        """Torque of a joint's rows, (n,).

        Parameters
        ----------
        row : int
            Position in the joints.
        theta : ndarray, shape (p,) or (folds, p)
            Base parameters; of each row's own fold where there are several.
        added : sequence of (Projection, ndarray of shape (k,) or (folds, k))
            Candidates and their coefficients.
        """
        r = self.joints[row]
        out = np.empty(len(r.tau))
        terms = [(p, beta) for p, beta in added if row in p.columns]
        for number, part in enumerate(r.parts()):
            found = _times(self._Y(row, number), theta[..., self.active[row]], r.fold[part])
            for p, beta in terms:
                found = found + _times(self._C(p, row, number), beta, r.fold[part])
            out[part] = found
        return out

    # ------------------------------------------------------------------ candidates

    def project(self, effects: Sequence[Effect], progress: Callable[[str], None] = lambda _: None) -> list[Projection]:
        """Filtered columns of candidate effects over all rows, and their moments."""
        fresh = list({str(e): e for e in effects if str(e) not in self._projections}.values())
        groups = [list(group) for _, group in groupby(fresh, lambda effect: effect.id)]
        gathered: list[list[_Stored]] = [[] for _ in fresh]
        for piece in self._pieces if fresh else ():
            work = _Work(self._state(piece), decimating_filter(*piece.filter), self._row, piece.picked)
            (there,) = self.workers.map(_same, [work])
            parts = []
            for group in groups:
                progress(f"trying {group[0].id}")
                parts += self.workers.map(_filtered, [group], there)
            done = [columns for part in self.workers.gather(parts) for columns in part]
            for kept, columns in zip(gathered, done, strict=True):
                rows = {row: self.store.put(x) for row, x in columns.rows.items()}
                kept.append(_Stored(rows, columns.signs, columns.finite))
        for effect, kept in zip(fresh, gathered, strict=True):
            self._projections[str(effect)] = self._whole(effect, kept)
        found = [self._projections[str(effect)] for effect in effects]
        self._sum(found)
        return found

    def _whole(self, effect: Effect, pieces: Sequence[_Stored]) -> Projection:
        """Columns of all motions; zero in a motion where the effect has none."""
        signs = pieces[-1].signs
        rows = sorted({row for piece in pieces for row in piece.rows})
        columns: dict[int, list[Stored]] = {}
        for row in rows:
            for kept, piece in zip(pieces, self._pieces, strict=True):
                none = np.zeros((len(piece.picked[row]), len(signs)))
                columns.setdefault(row, []).append(kept.rows[row] if row in kept.rows else self.store.put(none))
        return Projection(effect, columns, signs, all(piece.finite for piece in pieces))

    def given(self, effect: Effect, row: int, values: Sequence[Array]) -> Projection:
        """Stand for a candidate on one joint by its values at each motion's filtered samples."""
        columns = [self.store.put(x[piece.picked[row], None]) for piece, x in zip(self._pieces, values, strict=True)]
        return Projection(effect, {row: columns}, (0,))

    def joined(self, parts: Sequence[Projection]) -> Projection:
        """Several places of an effect as one candidate."""
        columns: dict[int, list[Stored]] = {}
        for row in sorted({row for p in parts for row in p.columns}):
            for number, piece in enumerate(self._pieces):
                n = len(piece.picked[row])
                found = [
                    p.columns[row][number].read() if row in p.columns else np.zeros((n, len(p.signs))) for p in parts
                ]
                columns.setdefault(row, []).append(self.store.put(np.column_stack(found)))
        return Projection(parts[0].effect, columns, tuple(s for p in parts for s in p.signs))

    def _sum(self, projections: Sequence[Projection]) -> None:
        """Moments of candidates that are not known yet, in one go through the rows."""
        fresh = [p for p in projections if p not in self._known]
        sums: list[tuple[dict[int, Array], dict[int, Array]]] = [({}, {}) for _ in fresh]
        for row, r in enumerate(self.joints):
            users = [(p, X, D) for p, (X, D) in zip(fresh, sums, strict=True) if row in p.columns]
            if not users:
                continue
            where, p0 = np.append(self.active[row], len(self.model.base)), len(self.model.base) + 1
            widths = [len(p.signs) for p, _, _ in users]
            ends = np.cumsum([0, *widths]).tolist()
            cross = np.zeros((self.folds, p0, ends[-1]))
            for p, _, D in users:
                D[row] = np.zeros((self.folds, len(p.signs), len(p.signs)))
            for number, part in enumerate(r.parts()):
                Z = np.column_stack([self._Y(row, number), r.tau[part]])
                C = [self._C(p, row, number) for p, _, _ in users]
                together = np.column_stack(C)
                for f, own in _by_fold(r.fold[part]):
                    cross[f][where] += Z[own].T @ together[own]
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
                r = self.joints[row]
                for number, part in enumerate(r.parts()):
                    A, B = self._C(a, row, number), self._C(b, row, number)
                    for f, own in _by_fold(r.fold[part]):
                        found[row][f] += A[own].T @ B[own]
            self._between[a, b] = found
        return self._between[a, b]

    def screened(
        self, places: Sequence[Sequence[Effect]], left: Sequence[Array], omega: Array, keep: int = SCREENED
    ) -> list[Sequence[Effect]]:
        """Of the many shapes of each effect those that best fit what is left, judged by unfiltered columns at the rows.

        Parameters
        ----------
        places : sequence of sequence of Effect
            Shapes of one effect in one place each.
        left : sequence of ndarray
            Residual of every joint's rows.
        omega : ndarray, shape (J,)
            Weight of each joint's square.
        """
        many = [n for n, effects in enumerate(places) if len(effects) > 2 * keep and not any(e.memory for e in effects)]
        sums: dict[tuple[int, int, int], Array] = {}
        for number, state in enumerate(self.sampled() if many else ()):
            for n in many:
                for i, effect in enumerate(places[n]):
                    for row, C in _columns(effect.terms(state), self._row, len(state.t)).items():
                        r = self.joints[row]
                        part = list(r.parts())[number]
                        Z = np.column_stack([np.ones(len(r.picked[number])), C[r.picked[number]], left[row][part]])
                        sums[n, i, row] = sums.get((n, i, row), 0.0) + Z.T @ Z
        gains = {n: np.zeros(len(places[n])) for n in many}
        for (n, i, row), S in sums.items():
            gains[n][i] += omega[row] * _explained(S)
        best = {n: sorted(np.argsort(gain)[::-1][:keep].tolist()) for n, gain in gains.items()}
        return [[effects[i] for i in best[n]] if n in best else effects for n, effects in enumerate(places)]


def _same(work: _Work) -> _Work:
    return work


@dataclass(frozen=True, eq=False)
class _Work:
    """What the columns of candidates over one motion are made from."""

    state: State
    filter: sparse.csr_array
    rows: Mapping[int, int]
    picked: Sequence[NDArray[np.int32]]


@dataclass(frozen=True, eq=False)
class _Columns:
    """Columns of one effect over one motion."""

    rows: Mapping[int, Array]
    signs: tuple[int, ...]
    finite: bool


@dataclass(frozen=True, eq=False)
class _Stored:
    """The same, put away."""

    rows: Mapping[int, Stored]
    signs: tuple[int, ...]
    finite: bool


def _filtered(effects: Sequence[Effect], work: _Work) -> list[_Columns]:
    """Columns of some effects over one motion, at the rows of each joint."""
    found = []
    for effect in effects:
        terms = effect.terms(work.state)
        columns = {
            row: np.asarray(work.filter @ C)[work.picked[row]]
            for row, C in _columns(terms, work.rows, len(work.state.t)).items()
        }
        finite = all(np.isfinite(x).all() for x in columns.values())
        found.append(_Columns(columns, tuple(term.column.sign for term in terms), finite))
    return found


def _columns(terms: Sequence[Term], rows: Mapping[int, int], samples: int) -> dict[int, Array]:
    """Columns of an effect's terms by row of the fitted joints, (samples, k)."""
    columns: dict[int, Array] = {}
    for k, term in enumerate(terms):
        for j, values in term.rows.items():
            if j in rows:
                columns.setdefault(rows[j], np.zeros((samples, len(terms))))[:, k] = values
    return columns


def _sampled(state: State, t: Array) -> State:
    """A motion's state at some of its samples."""
    k = np.clip(np.searchsorted(state.t, t - 1e-9), 0, len(state.t) - 1)
    parts = {name: getattr(state, name)[k] for name in ("t", "q", "v", "a", "load", "torque")}
    return replace(state, **parts, extra={name: x[k] for name, x in state.extra.items()})


def _by_fold(fold: NDArray[np.int32]) -> Iterator[tuple[int, slice]]:
    """Stretches of rows of one fold each, in order."""
    starts = [0, *(np.flatnonzero(np.diff(fold)) + 1).tolist(), len(fold)]
    for start, stop in pairwise(starts):
        if stop > start:
            yield int(fold[start]), slice(start, stop)


def _times(columns: Array, theta: Array, fold: NDArray[np.int32]) -> Array:
    """Columns times coefficients (k,), or times those of each row's fold (folds, k)."""
    if theta.ndim == 1:
        return np.asarray(columns @ theta)
    out = np.empty(len(columns))
    for f, own in _by_fold(fold):
        out[own] = columns[own] @ theta[f]
    return out


def _explained(sums: Array) -> float:
    """Squares that columns C explain of x, means taken off C, from the sums of [1 C x]ᵀ [1 C x]."""
    n, mean = sums[0, 0], sums[0, 1:-1]
    values, vectors = np.linalg.eigh(sums[1:-1, 1:-1] - np.outer(mean, mean) / n)
    along = vectors.T @ (sums[1:-1, -1] - mean * sums[0, -1] / n)
    keep = values > SINGULAR**2 * max(values[-1], 1e-300)
    return float((along[keep] ** 2 / values[keep]).sum())
