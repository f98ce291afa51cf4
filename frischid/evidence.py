"""Filtered rows of some logs, arranged so that a thousand candidate columns can be judged in a second.

The rows of a model are kept joint by joint with their fold. For a candidate with columns C on the joints S, all that
least squares needs are the moments

    X_j = [Y_j τ_j]ᵀ C_j,   D = Σ_{j∈S} ω_j C_jᵀ C_j        ω_j = 1 / (σ_j² ℓ_j)

per fold, with σ_j the residual spread of joint j and ℓ_j its correlation time in samples, so that evidence is counted
in *effectively independent* samples. With the parameters eliminated (variable projection, Golub and Pereyra 1973),

    A = Σ ω_j Y_jᵀ C_j,   β = (D − Aᵀ H⁻¹ A)⁻¹ (Σ ω_j C_jᵀ τ_j − Aᵀ θ),   θ' = θ − H⁻¹ A β,

where H contains a prior. Everything is fitted on all folds but one and scored on that one.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from frischid.conditions import correlation_time
from frischid.effects import Effect, State, Term
from frischid.estimate import Prior
from frischid.gram import Array
from frischid.log import Log
from frischid.model import Model
from frischid.prior import reference_of
from frischid.regressor import Regressor
from frischid.signals import Motion, decimating_filter, prepare

Indices = NDArray[np.intp]
SCREENED = 10  # shapes of one effect that are judged in full
IN_SPAN = 1e-5  # share of a candidate's norm left by the base columns below which it is one of them


@dataclass(frozen=True, eq=False)
class JointRows:
    """Rows of one joint over all logs.

    Attributes
    ----------
    Y : ndarray, shape (n, p)
    tau : ndarray, shape (n,)
    fold : ndarray of int, shape (n,)
        Part of the data the row belongs to.
    block : ndarray of int, shape (n,)
        Stretch of about a second the row belongs to.
    picked : list of ndarray of int
        For each motion, which filtered samples these rows are.
    """

    Y: Array
    tau: Array
    fold: Indices
    block: Indices
    picked: list[Indices]


@dataclass(frozen=True, eq=False)
class Projection:
    """One candidate's columns over all rows: position in the joints -> (n_j, k)."""

    effect: Effect
    columns: Mapping[int, Array]
    signs: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class Score:
    """What a candidate does to the held-out error.

    Attributes
    ----------
    sse : ndarray, shape (folds, J)
        Held-out sum of squared residuals.
    beta : ndarray, shape (k,)
        Coefficients fitted on everything.
    """

    sse: Array
    beta: Array


@dataclass(frozen=True, eq=False)
class Fit:
    """A candidate fitted: in-sample gain, its coefficients (k,), and the change of the base parameters (p,)."""

    gain: float
    beta: Array
    change: Array


class Evidence:
    """Rows of logs under a model, ready to score candidates.

    Parameters
    ----------
    model : Model
    logs : sequence of Log
        Every log is a fold; a single log is cut into four.
    prior : Prior
    """

    def __init__(self, model: Model, logs: Sequence[Log], prior: Prior) -> None:
        self.model, self.prior = model, prior
        self.joints = model.joints
        self.regressor = Regressor(model.robot, model.effects, reference_of(model))
        self.motions: list[Motion] = []
        folds: list[int] = []
        for number, log in enumerate(logs):
            prepared = prepare(log.select(model.robot.joints), model.lowpass, velocity=model.velocity).motions
            self.motions += prepared
            folds += [number] * len(prepared)
        self._states = [self.regressor.state(m) for m in self.motions]
        self._row = {j: row for row, j in enumerate(model.torque_index)}
        self._filtered: dict[str, tuple[list[dict[int, Array]], tuple[int, ...]]] = {}
        self._filters = [
            decimating_filter(model.lowpass.taps(m.step), len(m.t), model.lowpass.decimation(m.step))
            for m in self.motions
        ]
        self.rows = self._rows(folds, len(logs))
        self._sparse = [_at(state, t) for state, t in zip(self._states, self.times, strict=True)]
        self.folds = 1 + max(int(r.fold.max()) for r in self.rows)
        self._weigh()

    # ------------------------------------------------------------------ rows

    def _rows(self, folds: Sequence[int], logs: int) -> list[JointRows]:
        base = list(self.model.base)
        index = self.model.torque_index
        Y: list[list[Array]] = [[] for _ in index]
        tau: list[list[Array]] = [[] for _ in index]
        fold: list[list[Indices]] = [[] for _ in index]
        block: list[list[Indices]] = [[] for _ in index]
        picked: list[list[Indices]] = [[] for _ in index]
        self.times: list[Array] = []
        blocks = 0
        for motion, number in zip(self.motions, folds, strict=True):
            pieces = list(self.regressor.blocks(motion, self.model.lowpass))
            t = np.concatenate([p.t for p in pieces])
            used = np.concatenate([p.used for p in pieces])
            self.times.append(t)
            parts = np.minimum(4 * np.arange(len(t)) // len(t), 3) if logs == 1 else np.full(len(t), number)
            seconds = blocks + ((t - t[0]) / max(1.0, 12 / (self.model.lowpass.cutoff or 12))).astype(int)
            blocks = int(seconds.max()) + 1
            for row, j in enumerate(index):
                keep = np.flatnonzero(used[:, j])
                Y[row].append(np.concatenate([p.Y[:, base, j] for p in pieces])[keep])
                tau[row].append(np.concatenate([p.tau[:, j] for p in pieces])[keep])
                fold[row].append(parts[keep])
                block[row].append(seconds[keep])
                picked[row].append(keep)
        return [
            JointRows(
                np.concatenate(Y[row]),
                np.concatenate(tau[row]),
                np.concatenate(fold[row]),
                np.concatenate(block[row]),
                picked[row],
            )
            for row in range(len(index))
        ]

    def _weigh(self) -> None:
        """Moments, and from the base model's residuals: their spread, correlation time, effective samples."""
        J = len(self.rows)
        self.counts = np.array([[np.count_nonzero(r.fold == f) for r in self.rows] for f in range(self.folds)])
        self.spread = np.array([r.tau.std() for r in self.rows])
        self.G = np.stack([self._moments(f) for f in range(self.folds)])
        sigma, self.correlation = self.spread.copy(), np.ones(J)
        for _ in range(4):
            self.omega = 1.0 / (np.maximum(sigma, 1e-9 * self.spread) ** 2 * self.correlation)
            self.systems = [self._solve(f) for f in (*range(self.folds), None)]
            self.theta = self.systems[-1][1]
            residuals = [r.tau - r.Y @ self.theta for r in self.rows]
            sigma = np.array([x.std() for x in residuals])
            self.correlation = np.array([correlation_time(x) for x in residuals])
        self.sigma = sigma
        self.effective = self.counts.sum(axis=0) / self.correlation

    def _moments(self, fold: int) -> Array:
        """Moments of [Y τ] of every joint in one part of the data, (J, p + 1, p + 1)."""
        parts = [np.column_stack([r.Y, r.tau])[r.fold == fold] for r in self.rows]
        return np.stack([Z.T @ Z for Z in parts])

    def _solve(self, left_out: int | None) -> tuple[tuple[Array, bool], Array]:
        train = [f for f in range(self.folds) if f != left_out]
        M = np.einsum("j,fjab->ab", self.omega, self.G[train])
        H = M[:-1, :-1] + self.prior.precision
        b = M[:-1, -1] + self.prior.precision @ self.prior.mean
        H = H + 1e-10 * np.diag(np.diag(H) + 1e-300)
        factor = linalg.cho_factor(H)
        return factor, linalg.cho_solve(factor, b)

    # ------------------------------------------------------------------ candidates

    def project(self, effects: Sequence[Effect]) -> list[Projection]:
        """Filtered columns of candidate effects over all rows."""
        fresh = [effect for effect in effects if str(effect) not in self._filtered]
        for effect in fresh:
            signs: tuple[int, ...] = ()
            columns: list[dict[int, Array]] = []
            for state, F in zip(self._states, self._filters, strict=True):
                terms = effect.terms(state)
                signs = tuple(term.column.sign for term in terms)
                columns.append({row: np.asarray(F @ C) for row, C in self._columns(terms, len(state.t)).items()})
            self._filtered[str(effect)] = columns, signs
        return [self._collect(effect, *self._filtered[str(effect)]) for effect in effects]

    def _columns(self, terms: Sequence[Term], samples: int) -> dict[int, Array]:
        """Columns of an effect's terms by row of the fitted joints, (samples, k)."""
        columns: dict[int, Array] = {}
        for k, term in enumerate(terms):
            for j, values in term.rows.items():
                if j in self._row:
                    columns.setdefault(self._row[j], np.zeros((samples, len(terms))))[:, k] = values
        return columns

    def screened(self, effects: Sequence[Effect], keep: int = SCREENED) -> Sequence[Effect]:
        """Those of many shapes of one effect that best fit what is left, judged by unfiltered columns at the rows."""
        if len(effects) <= 2 * keep or any(effect.memory for effect in effects):
            return effects
        left = dict(self.residuals())
        gains = [self._rough_gain(effect, left) for effect in effects]
        best = sorted(np.argsort(gains)[::-1][:keep].tolist())
        return [effects[i] for i in best]

    def _rough_gain(self, effect: Effect, left: Mapping[int, Array]) -> float:
        found = [self._columns(effect.terms(state), len(state.t)) for state in self._sparse]
        gain = 0.0
        for row in found[0]:
            picked = [m[row][keep] for m, keep in zip(found, self.rows[row].picked, strict=True)]
            C = np.concatenate(picked)
            C = C - C.mean(axis=0)
            fitted = C @ np.linalg.lstsq(C, left[row], rcond=1e-6)[0]
            gain += self.omega[row] * float(left[row] @ fitted)
        return gain

    def _collect(self, effect: Effect, per_motion: Sequence[Mapping[int, Array]], signs: tuple[int, ...]) -> Projection:
        rows = sorted({row for m in per_motion for row in m})
        columns = {
            row: np.concatenate(
                [
                    m[row][keep] if row in m else np.zeros((len(keep), len(signs)))
                    for m, keep in zip(per_motion, self.rows[row].picked, strict=True)
                ]
            )
            for row in rows
        }
        return Projection(effect, columns, signs)

    def moments(self, candidate: Projection) -> tuple[dict[int, Array], dict[int, Array]]:
        """Cross moments with [Y τ] and own moments, by joint: (folds, p + 1, k) and (folds, k, k)."""
        X, D = {}, {}
        for row, C in candidate.columns.items():
            r = self.rows[row]
            Z = np.column_stack([r.Y, r.tau])
            parts = [np.flatnonzero(r.fold == f) for f in range(self.folds)]
            X[row] = np.stack([Z[i].T @ C[i] for i in parts])
            D[row] = np.stack([C[i].T @ C[i] for i in parts])
        return X, D

    def base_sse(self) -> Array:
        """Held-out sum of squared residuals without any candidate, (folds, J)."""
        out = np.empty((self.folds, len(self.rows)))
        for f in range(self.folds):
            d = np.append(self.systems[f][1], -1.0)
            out[f] = np.einsum("a,jab,b->j", d, self.G[f], d)
        return out

    def score(self, candidates: Sequence[Projection]) -> tuple[Score, Projection] | None:
        """Score one candidate given in several shapes: in every fold the shape that fits the *other* folds best.

        Returns
        -------
        (Score, Projection) or None
            The projection is the shape that fits everything best; None when the base columns already span the
            candidate.
        """
        moments = [self.moments(c) for c in candidates]
        sse = np.empty((self.folds, len(self.rows)))
        for f in range(self.folds):
            chosen = self._best(candidates, moments, f)
            if chosen is None:
                return None
            sse[f] = self._held_out(*moments[chosen[0]], chosen[1], f)
        chosen = self._best(candidates, moments, None)
        return None if chosen is None else (Score(sse, chosen[1].beta), candidates[chosen[0]])

    def _best(
        self,
        candidates: Sequence[Projection],
        moments: Sequence[tuple[Mapping[int, Array], Mapping[int, Array]]],
        left_out: int | None,
    ) -> tuple[int, Fit] | None:
        """The shape that fits best in sample, and its fit."""
        fits = [self.fit(X, D, c, left_out) for (X, D), c in zip(moments, candidates, strict=True)]
        possible = [(i, fit) for i, fit in enumerate(fits) if fit is not None]
        price = np.log(max(float(self.counts.sum(axis=0).max()), 2.0))
        return max(possible, key=lambda x: x[1].gain - price * len(candidates[x[0]].signs), default=None)

    def fit(
        self, X: Mapping[int, Array], D: Mapping[int, Array], candidate: Projection, left_out: int | None
    ) -> Fit | None:
        """In-sample gain, β and the change of θ, on all folds but one."""
        factor, theta = self.systems[-1 if left_out is None else left_out]
        train = [f for f in range(self.folds) if f != left_out]
        k = len(candidate.signs)
        A, e, own = np.zeros((len(theta), k)), np.zeros(k), np.zeros((k, k))
        for row, x in X.items():
            cross = self.omega[row] * x[train].sum(axis=0)
            A += cross[:-1]
            e += cross[-1]
            own += self.omega[row] * D[row][train].sum(axis=0)
        scale = np.sqrt(np.diag(own))
        if not (scale > 0).all():
            return None
        HA = linalg.cho_solve(factor, A)
        S = (own - A.T @ HA) / np.outer(scale, scale)
        g = (e - A.T @ theta) / scale
        values, vectors = linalg.eigh(S)
        keep = values > IN_SPAN
        if not keep.any():
            return None
        V = vectors[:, keep] / np.sqrt(values[keep])
        beta = V @ (V.T @ g) / scale
        if k == 1 and candidate.signs[0] * beta[0] < 0:
            return Fit(0.0, np.zeros(1), np.zeros(len(theta)))
        return Fit(float(((V.T @ g) ** 2).sum()), beta, -HA @ beta)

    def _held_out(self, X: Mapping[int, Array], D: Mapping[int, Array], fit: Fit, fold: int) -> Array:
        beta = fit.beta
        d = np.append(self.systems[fold][1] + fit.change, -1.0)
        sse = np.einsum("a,jab,b->j", d, self.G[fold], d)
        for row in X:
            sse[row] += 2 * d @ X[row][fold] @ beta + beta @ D[row][fold] @ beta
        return np.asarray(np.maximum(sse, 0.0))

    def believing(self, prior: Prior) -> Evidence:
        """The same rows under another prior."""
        new = object.__new__(Evidence)
        new.__dict__.update(self.__dict__)
        new.prior = prior
        new._weigh()
        return new

    def without(self, stretches: Sequence[tuple[str, float, float]]) -> Evidence:
        """The same evidence with some stretches of time left out: (source, start, stop) each, s."""
        new = object.__new__(Evidence)
        new.__dict__.update(self.__dict__)
        new.rows = []
        for r in self.rows:
            kept = []
            for motion, t, picked in zip(self.motions, self.times, r.picked, strict=True):
                inside = [(t[picked] >= a) & (t[picked] <= b) for source, a, b in stretches if source == motion.source]
                kept.append(~np.any(inside, axis=0) if inside else np.ones(len(picked), bool))
            keep = np.concatenate(kept)
            left = [p[k] for p, k in zip(r.picked, kept, strict=True)]
            new.rows.append(JointRows(r.Y[keep], r.tau[keep], r.fold[keep], r.block[keep], left))
        new._weigh()
        return new

    def extended(self, candidate: Projection) -> Evidence:
        """The same rows with a candidate's columns taken into the base."""
        new = object.__new__(Evidence)
        new.__dict__.update(self.__dict__)
        k = len(candidate.signs)
        new.rows = [
            replace(r, Y=np.column_stack([r.Y, candidate.columns.get(row, np.zeros((len(r.tau), k)))]))
            for row, r in enumerate(self.rows)
        ]
        p = len(self.prior.mean)
        precision = np.zeros((p + k, p + k))
        precision[:p, :p] = self.prior.precision
        new.prior = Prior(np.append(self.prior.mean, np.zeros(k)), precision)
        new._weigh()
        return new

    def speeds(self, motion: int) -> Array:
        """Speeds of the fitted joints at a motion's filtered samples, over their root mean square, (N, J)."""
        v = self._sparse[motion].v[:, list(self.model.torque_index)]
        return np.asarray(v / np.maximum(np.sqrt((v**2).mean(axis=0)), 1e-12))

    def variables(self, row: int) -> dict[str, Array]:
        """What a joint's residual may depend on, at its rows: ``q1``, ``v1``, ``a1``, ..., and t in its log."""
        numbers = [str(self.model.robot.numbers[name]) for name in self.model.robot.joints]
        pieces: dict[str, list[Array]] = {}
        for state, picked in zip(self._sparse, self.rows[row].picked, strict=True):
            pieces.setdefault("t", []).append(state.t[picked] - state.start)
            for symbol, values in (("q", state.q), ("v", state.v), ("a", state.a)):
                for number, x in zip(numbers, values.T, strict=True):
                    pieces.setdefault(symbol + number, []).append(x[picked])
        return {name: np.concatenate(parts) for name, parts in pieces.items()}

    def residuals(self) -> Iterator[tuple[int, Array]]:
        """Residual of every joint's rows with the parameters fitted to everything."""
        for row, r in enumerate(self.rows):
            yield row, r.tau - r.Y @ self.theta

    @property
    def information(self) -> Array:
        """Precision of the parameters given everything, (p, p)."""
        return np.asarray(np.einsum("j,fjab->ab", self.omega, self.G)[:-1, :-1] + self.prior.precision)

    def nrmse(self, sse: Array) -> Array:
        """Held-out NRMSE of each joint from its sums of squares over the folds, (J,)."""
        return np.asarray(np.sqrt(sse.sum(axis=0) / self.counts.sum(axis=0)) / self.spread)

    def log_likelihood(self, before: Array, after: Array, effective: Array) -> float:
        """Held-out log likelihood ratio, in effectively independent samples of each joint (J,)."""
        ratio = np.maximum(before.sum(axis=0), 1e-300) / np.maximum(after.sum(axis=0), 1e-300)
        return float(0.5 * np.sum(effective * np.log(ratio)))

    def effective_with(self, candidate: Projection) -> Array:
        """Effectively independent samples of each joint once a candidate is in the model, (J,).

        A slow effect makes the residual correlated over the whole motion, as if there were hardly any evidence; what
        counts
        is the correlation of what is left when it is explained.
        """
        X, D = self.moments(candidate)
        fit = self.fit(X, D, candidate, None)
        effective: Array = np.array(self.effective, dtype=np.float64)
        if fit is None:
            return effective
        for row, C in candidate.columns.items():
            r = self.rows[row]
            left = r.tau - r.Y @ (self.theta + fit.change) - C @ fit.beta
            effective[row] = max(effective[row], len(left) / correlation_time(left))
        return effective


def _at(state: State, t: Array) -> State:
    """A motion's state at some of its samples."""
    k = np.clip(np.searchsorted(state.t, t - 1e-9), 0, len(state.t) - 1)
    parts = {name: getattr(state, name)[k] for name in ("t", "q", "v", "a", "load", "torque")}
    return replace(state, **parts, extra={name: x[k] for name, x in state.extra.items()})
