"""Candidate effects held against what logs say, so that a thousand columns can be judged in a second.

Of a candidate with columns C on the joints S all that least squares needs are the moments that `rows` gathers,

    X_j = [Y_j τ_j]ᵀ C_j,   D = Σ_{j∈S} ω_j C_jᵀ C_j        ω_j = 1 / (σ_j² ℓ_j)

per fold, with σ_j the residual spread of joint j and ℓ_j its correlation time in samples, so that evidence is counted
in *effectively independent* samples. With the parameters eliminated (variable projection, Golub and Pereyra 1973),

    A = Σ ω_j Y_jᵀ C_j,   β = (D − Aᵀ H⁻¹ A)⁻¹ (Σ ω_j C_jᵀ τ_j − Aᵀ θ),   θ' = θ − H⁻¹ A β,

where H contains a prior. Everything is fitted on all folds but one and scored on that one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass

import numpy as np
from scipy import linalg

from frischid.core.parallel import Workers
from frischid.core.text import each_of
from frischid.core.types import Array
from frischid.diagnosis.candidate_columns import Projection
from frischid.diagnosis.dataset import Rows
from frischid.diagnosis.motion_cache import Part, Stretch
from frischid.effects import Effect
from frischid.errors import InputError
from frischid.estimators.autocorrelation import Autocorrelation
from frischid.estimators.least_squares import Prior
from frischid.logs.log import Log
from frischid.logs.preprocessing import Motion
from frischid.logs.recording import Recording
from frischid.model.model import Model

LOOKED_AT = 50_000  # rows of a joint, spread evenly, on which medians and dependences are judged
IN_SPAN = 1e-5  # share of a candidate's norm left by the base columns below which it is one of them


def thinned(parts: Iterable[Array], every: int) -> Array:
    """Every so many of the values that come in parts."""
    kept, passed = [], 0
    for x in parts:
        kept.append(x[-passed % every :: every].copy())
        passed += len(x)
    return np.concatenate(kept)


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
    logs : sequence of Log or Recording
        Every log is a fold; of a single one each motion is cut into four.
    prior : Prior
    workers : Workers, optional
        Where candidates' columns are computed, this process by default.

    Raises
    ------
    InputError
        A log lacks a joint of the model or its torque, or a joint never moves.

    Attributes
    ----------
    missed : ndarray, shape (J,)
        NRMSE that was missing before, when these logs show what is new; zero: everything counts.
    """

    def __init__(
        self, model: Model, logs: Sequence[Log | Recording], prior: Prior, workers: Workers | None = None
    ) -> None:
        self.model, self.prior = model, prior
        self.joints = model.joints
        self.missed = np.zeros(len(self.joints))
        model.check(logs)
        self.data = Rows(model, logs, workers)
        self._added: tuple[Projection, ...] = ()
        self._on(self.data)

    def _on(self, data: Rows) -> None:
        """Take these rows."""
        self.data, self.counts = data, data.counts
        self.spread = np.array(
            [Autocorrelation.of(p.tau for p in data.parts(row)).std for row in range(len(self.joints))]
        )
        flat = [name for name, spread in zip(self.joints, self.spread, strict=True) if not spread > 0]
        if flat:
            raise InputError(
                f"{', '.join(dict.fromkeys(data.sources))}: {each_of(flat)} never moves, or its torque never changes: "
                "nothing can be said of what the model misses; take a log in which every joint moves"
            )
        self.G = data.gram
        added, self._added = self._added, ()
        for candidate in added:
            self._take(candidate)
        self._weigh()

    def _take(self, candidate: Projection) -> None:
        """Put a candidate's columns behind the others: their moments beside those already there."""
        X, D = self.moments(candidate)
        p, k = self.G.shape[-1] - 1, len(candidate.signs)
        G = np.zeros((*self.G.shape[:2], p + k + 1, p + k + 1))
        old, new = np.append(np.arange(p), p + k), np.arange(p, p + k)
        G[:, :, old[:, None], old] = self.G
        for row, x in X.items():
            G[:, row][:, old[:, None], new] = x
            G[:, row][:, new[:, None], old] = x.transpose(0, 2, 1)
            G[:, row][:, new[:, None], new] = D[row]
        self.G, self._added = G, (*self._added, candidate)

    @property
    def folds(self) -> int:
        """Parts of the data."""
        return self.data.folds

    @property
    def motions(self) -> Iterable[Motion]:
        """Motions of the logs, one at a time, each time anew."""
        return self.data.motions

    @property
    def sources(self) -> list[str]:
        """The log of each motion."""
        return self.data.sources

    @property
    def times(self) -> Iterator[Array]:
        """Times of each motion's filtered samples, s."""
        return self.data.times

    def _weigh(self) -> None:
        """From the base model's residuals: their spread, correlation time, effective samples."""
        sigma, self.correlation = self.spread.copy(), np.ones(len(self.joints))
        for _ in range(4):
            self.omega = 1.0 / (np.maximum(sigma, 1e-9 * self.spread) ** 2 * self.correlation)
            self.systems = [self._solve(f) for f in (*range(self.folds), None)]
            self.theta = self.systems[-1][1]
            left = [Autocorrelation.of(self.residuals(row, self.theta)) for row in range(len(self.joints))]
            sigma, self.correlation = np.array([x.std for x in left]), np.array([x.time for x in left])
        self.sigma = sigma
        self.effective = self.counts.sum(axis=0) / self.correlation

    def _solve(self, left_out: int | None) -> tuple[tuple[Array, bool], Array]:
        train = [f for f in range(self.folds) if f != left_out]
        M = np.einsum("j,fjab->ab", self.omega, self.G[train])
        H = M[:-1, :-1] + self.prior.precision
        b = M[:-1, -1] + self.prior.precision @ self.prior.mean
        H = H + 1e-10 * np.diag(np.diag(H) + 1e-300)
        factor = linalg.cho_factor(H)
        return factor, linalg.cho_solve(factor, b)

    # ------------------------------------------------------------------ candidates

    def project(self, effects: Sequence[Effect], progress: Callable[[str], None] = lambda _: None) -> list[Projection]:
        """Filtered columns of candidate effects over all rows."""
        return self.data.project(effects, progress)

    def joined(self, parts: Sequence[Projection]) -> Projection:
        """Several places of an effect as one candidate."""
        return self.data.joined(parts)

    def screened(self, places: Sequence[Sequence[Effect]]) -> list[Sequence[Effect]]:
        """Of the many shapes of each effect those that best fit what is left."""
        return self.data.screened(places, lambda part: part.tau - self.predicted(part, self.theta), self.omega)

    def moments(self, candidate: Projection) -> tuple[Mapping[int, Array], Mapping[int, Array]]:
        """Cross moments with [Y τ] and own moments, by joint: (folds, p + 1, k) and (folds, k, k)."""
        X, D = self.data.moments(candidate)
        if not self._added:
            return X, D
        between = [self.data.between(a, candidate) for a in self._added]
        k = len(candidate.signs)
        cross = {}
        for row, x in X.items():
            none = [np.zeros((self.folds, len(a.signs), k)) for a in self._added]
            others = [found.get(row, zero) for found, zero in zip(between, none, strict=True)]
            cross[row] = np.concatenate([x[:, :-1], *others, x[:, -1:]], axis=1)
        return cross, D

    def base_sse(self) -> Array:
        """Held-out sum of squared residuals without any candidate, (folds, J)."""
        out = np.empty((self.folds, len(self.joints)))
        for f in range(self.folds):
            d = np.append(self.systems[f][1], -1.0)
            out[f] = np.einsum("a,jab,b->j", d, self.G[f], d)
        return out

    def score(self, candidates: Sequence[Projection]) -> tuple[Score, Projection] | None:
        """Score one candidate in several shapes of as many columns: in every fold the one that fits the *others* best.

        Returns
        -------
        (Score, Projection) or None
            The projection is the shape that fits everything best; None when the base columns already span the
            candidate.
        """
        moments = [self.moments(c) for c in candidates]
        sse = np.empty((self.folds, len(self.joints)))
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
        return max(possible, key=lambda x: x[1].gain, default=None)

    def fit(
        self, X: Mapping[int, Array], D: Mapping[int, Array], candidate: Projection, left_out: int | None
    ) -> Fit | None:
        """In-sample gain, β and the change of θ, on all folds but one."""
        eliminated = self.eliminated(X, D, candidate, left_out)
        if eliminated is None:
            return None
        S, g, scale, HA = eliminated
        values, vectors = linalg.eigh(S)
        keep = values > IN_SPAN
        if not keep.any():
            return None
        V = vectors[:, keep] / np.sqrt(values[keep])
        beta = V @ (V.T @ g) / scale
        if len(beta) == 1 and candidate.signs[0] * beta[0] < 0:
            return Fit(0.0, np.zeros(1), np.zeros(len(HA)))
        return Fit(float(((V.T @ g) ** 2).sum()), beta, -HA @ beta)

    def eliminated(
        self, X: Mapping[int, Array], D: Mapping[int, Array], candidate: Projection, left_out: int | None
    ) -> tuple[Array, Array, Array, Array] | None:
        """A candidate's normal equations without the parameters, on all folds but one, for columns of unit norm.

        Returns
        -------
        (ndarray (k, k), ndarray (k,), ndarray (k,), ndarray (p, k)) or None
            Matrix, right side, the columns' norms, H⁻¹ A; None when a column is zero.
        """
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
        return (own - A.T @ HA) / np.outer(scale, scale), (e - A.T @ theta) / scale, scale, HA

    def _held_out(self, X: Mapping[int, Array], D: Mapping[int, Array], fit: Fit, fold: int) -> Array:
        beta = fit.beta
        d = np.append(self.systems[fold][1] + fit.change, -1.0)
        sse = np.einsum("a,jab,b->j", d, self.G[fold], d)
        for row in X:
            sse[row] += 2 * d @ X[row][fold] @ beta + beta @ D[row][fold] @ beta
        return np.asarray(np.maximum(sse, 0.0))

    def believing(self, prior: Prior) -> Evidence:
        """The same rows under another prior."""
        new = copy(self)
        new.prior = prior
        new._weigh()
        return new

    def comparing(self, missed: Array) -> Evidence:
        """The same rows, to be judged by what is missing beyond what was missing before: NRMSE of each joint, (J,)."""
        new = copy(self)
        new.missed = missed
        return new

    def without(self, stretches: Sequence[Stretch]) -> Evidence:
        """The same evidence with some stretches of time left out: (source, start, stop) each, s."""
        new = copy(self)
        new._on(self.data.without(stretches))
        return new

    def extended(self, candidate: Projection) -> Evidence:
        """The same rows with a candidate's columns taken into the base."""
        new = copy(self)
        new._take(candidate)
        p, k = len(self.prior.mean), len(candidate.signs)
        precision = np.zeros((p + k, p + k))
        precision[:p, :p] = self.prior.precision
        new.prior = Prior(np.append(self.prior.mean, np.zeros(k)), precision)
        new._weigh()
        return new

    def speeds(self) -> Iterator[Array]:
        """Speeds of the fitted joints at each motion's filtered samples, over their root mean square, (N, J)."""
        for state in self.data.sampled():
            v = state.v[:, list(self.model.torque_index)]
            yield np.asarray(v / np.maximum(np.sqrt((v**2).mean(axis=0)), 1e-12))

    def variables(self, row: int, every: int) -> dict[str, Array]:
        """What a joint's residual may depend on, at every so many of its rows: ``q1``, ``v1``, ``a1``, ..., and t."""
        numbers = [str(self.model.robot.numbers[name]) for name in self.model.robot.joints]
        pieces: dict[str, list[Array]] = {}
        passed = 0
        for state, part in zip(self.data.sampled(), self.data.parts(row), strict=True):
            picked = part.picked[-passed % every :: every]
            passed += len(part)
            pieces.setdefault("t", []).append(state.t[picked] - state.start)
            for symbol, values in (("q", state.q), ("v", state.v), ("a", state.a)):
                for number, x in zip(numbers, values.T, strict=True):
                    pieces.setdefault(symbol + number, []).append(x[picked])
        return {name: np.concatenate(parts) for name, parts in pieces.items()}

    def predicted(
        self, part: Part, theta: Array, candidate: Projection | None = None, beta: Array | None = None
    ) -> Array:
        """Torque of some rows, (n,); of parameters (p,), or of those of each row's fold (folds, p).

        Parameters
        ----------
        part : Part
        theta : ndarray, shape (p,) or (folds, p)
        candidate : Projection, optional
        beta : ndarray, shape (k,) or (folds, k), optional
            Coefficients of the candidate.
        """
        ends = np.cumsum([len(self.model.base), *(len(a.signs) for a in self._added)]).tolist()
        added = [(a, theta[..., start:stop]) for a, start, stop in zip(self._added, ends[:-1], ends[1:], strict=True)]
        if candidate is not None and beta is not None:
            added.append((candidate, beta))
        return self.data.predicted(part, theta[..., : ends[0]], added)

    def residuals(self, row: int, theta: Array) -> Iterator[Array]:
        """Residual of a joint's rows under some parameters, motion by motion, (n,) each."""
        for part in self.data.parts(row):
            yield part.tau - self.predicted(part, theta)

    def squares(self, row: int, theta: Array) -> float:
        """Sum of squared residuals of a joint's rows under some parameters."""
        return float(sum(x @ x for x in self.residuals(row, theta)))

    def block_gains(self, candidate: Projection) -> Array | None:
        """By how much the candidate lowers the squared held-out error, block of time by block of time.

        Every joint counts as in `log_likelihood`, to first order: its independent samples over its squares held out.
        None when in some fold it cannot be fitted.
        """
        X, D = self.moments(candidate)
        fits = [self.fit(X, D, candidate, fold) for fold in range(self.folds)]
        found = [fit for fit in fits if fit is not None]
        if len(found) < self.folds:
            return None
        theta = np.stack([self.systems[fold][1] for fold in range(self.folds)])
        changed = theta + np.stack([fit.change for fit in found])
        beta = np.stack([fit.beta for fit in found])
        gain, there = np.zeros(self.data.blocks), np.zeros(self.data.blocks, bool)
        weights = self.effective / np.maximum(self.base_sse().sum(axis=0), 1e-300)
        for row, weight in enumerate(weights):
            for part in self.data.parts(row):
                before = part.tau - self.predicted(part, theta)
                after = part.tau - self.predicted(part, changed, candidate, beta)
                np.add.at(gain, part.block, weight * (before**2 - after**2))
                there[part.block] = True
        return np.asarray(gain[there])

    @property
    def information(self) -> Array:
        """Precision of the parameters given everything, (p, p)."""
        return np.asarray(np.einsum("j,fjab->ab", self.omega, self.G)[:-1, :-1] + self.prior.precision)

    def nrmse(self, sse: Array) -> Array:
        """Held-out NRMSE of each joint from its sums of squares over the folds, (J,)."""
        # Moments of exact data may miss zero by their last digit.
        return np.asarray(np.sqrt(np.maximum(sse.sum(axis=0), 0.0) / self.counts.sum(axis=0)) / self.spread)

    def log_likelihood(self, before: Array, after: Array, effective: Array) -> float:
        """Held-out log likelihood ratio, in effectively independent samples of each joint (J,)."""
        ratio = np.maximum(before.sum(axis=0), 1e-300) / np.maximum(after.sum(axis=0), 1e-300)
        return float(0.5 * np.sum(effective * np.log(ratio)))

    def effective_with(self, candidate: Projection) -> Array:
        """Effectively independent samples of each joint once a candidate is in the model, (J,).

        A slow effect makes the residual correlated over the whole motion, as if there were hardly any evidence; what
        counts is the correlation of what is left when it is explained.
        """
        X, D = self.moments(candidate)
        fit = self.fit(X, D, candidate, None)
        effective: Array = np.array(self.effective, dtype=np.float64)
        if fit is None:
            return effective
        theta, n = self.theta + fit.change, self.counts.sum(axis=0)
        for row in candidate.columns:
            left = (p.tau - self.predicted(p, theta, candidate, fit.beta) for p in self.data.parts(row))
            effective[row] = max(effective[row], n[row] / Autocorrelation.of(left).time)
        return effective
