"""Cross-validation of candidate effects: fitted on all folds but one, scored on the remaining one, from moments alone.

The held-out error of joint j in fold f is a quadratic form of the fold's moments,

    SSE_fj = d ᵀ [Y τ]ᵀ[Y τ] d,    d = (θ of the other folds, −1),

and so is the error with a candidate (`weighted_fit` gives its coefficients). A thousand candidates are scored in a
second. The evidence for a candidate is a log likelihood ratio,

    Λ = ½ Σ_j (n_j / ℓ_j) log(Q_j before / Q_j after),

with n_j rows and ℓ_j the correlation time of the residual: n_j / ℓ_j samples are *effectively independent*. Q_j is the
held-out squared error without the part that uncertain parameters alone cause (`weighted_fit`).

Source: Stone 1974, "Cross-validatory choice and assessment of statistical predictions", J. R. Stat. Soc. B 36(2).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from frischid.core.parallel import Workers
from frischid.core.text import each_of
from frischid.core.types import Array
from frischid.diagnosis.cached_motion import JointData
from frischid.diagnosis.candidate_columns import Candidate
from frischid.diagnosis.candidate_fits import CandidateFit, Fits, Score, candidate_fits
from frischid.diagnosis.criteria import DIAGNOSIS_CRITERIA, DiagnosisCriteria
from frischid.diagnosis.dataset import RegressionData
from frischid.diagnosis.model_columns import ModelColumns
from frischid.diagnosis.motion_cache import MotionCache
from frischid.diagnosis.shape_screening import screened
from frischid.diagnosis.stretches import Stretch, lasting
from frischid.diagnosis.weighted_fit import WeightedFit, counted_share, predictive_squares
from frischid.effects import Effect
from frischid.errors import InputError
from frischid.estimators.autocorrelation import Autocorrelation
from frischid.estimators.least_squares import Prior
from frischid.logs.log import Log
from frischid.logs.preprocessing import Motion
from frischid.logs.recording import Recording
from frischid.model.model import Model
from frischid.model.standstill_joints import STANDSTILL_LOG, rows_of


@dataclass(frozen=True, eq=False)
class CrossValidator:
    """A model's fit to some logs, fold by fold, ready to score candidates."""

    fit: WeightedFit
    spread: Array
    """Standard deviation of each joint's torque, N·m (N), (J,)."""
    known_residual: Array
    """NRMSE of each joint that was there before the robot changed, so it cannot be the change, (J,). Zero: all error
    counts."""
    _wider: dict[Candidate, CrossValidator] = field(init=False, repr=False, default_factory=dict)
    _fits: dict[Candidate, Fits] = field(init=False, repr=False, default_factory=dict)
    _predicted: dict[JointData, tuple[Array, Array]] = field(init=False, repr=False, default_factory=dict)

    @classmethod
    def of(
        cls,
        model: Model,
        logs: Sequence[Log | Recording],
        prior: Prior,
        *,
        criteria: DiagnosisCriteria = DIAGNOSIS_CRITERIA,
        workers: Workers | None = None,
    ) -> CrossValidator:
        """Read logs and fit the model to them.

        Parameters
        ----------
        logs : sequence of Log or Recording
            Each log is one fold; each motion of a single log is cut into folds.
        prior : Prior
            Of the p base parameters.
        workers : Workers, optional
            Processes that compute columns of candidates, this process by default.

        Raises
        ------
        InputError
            A log lacks a joint of the model or its torque, or no joint moves.
        """
        model.check(logs)
        data = RegressionData(MotionCache(model, logs, criteria, workers))
        moving = _spread(data) > 0
        if moving.any() and not moving.all():  # the motions are read again, without the rows that say nothing
            model = rows_of(model, moving)
            data = RegressionData(MotionCache(model, logs, criteria, workers))
        return cls._fitted(ModelColumns.of(data), prior, np.zeros(len(model.joints)))

    def with_motions(self, seen: Callable[[Motion], Motion]) -> CrossValidator:
        """A fit to the same stretches of other motions, under the same prior: `seen` of each motion takes its place."""
        cache = self.data.cache
        other = MotionCache(cache.model, cache.logs, cache.criteria, cache.workers, seen)
        columns = ModelColumns.of(RegressionData(other, self.data.left_out))
        return CrossValidator(
            WeightedFit.of(columns, self.fit.prior, self.spread), self.spread, np.zeros(len(self.joints))
        )

    @classmethod
    def _fitted(cls, columns: ModelColumns, prior: Prior, known_residual: Array) -> CrossValidator:
        data, joints = columns.data, columns.data.model.joints
        spread = _spread(data)
        flat = [name for name, s in zip(joints, spread, strict=True) if not s > 0]
        if flat:
            raise InputError(
                f"{', '.join(dict.fromkeys(data.sources))}: {each_of(flat)} never moves, or its torque never changes: "
                f"the model's error there cannot be judged. {STANDSTILL_LOG}"
            )
        return cls(WeightedFit.of(columns, prior, spread), spread, known_residual)

    # ------------------------------------------------------------------ the same data under other assumptions

    def with_prior(self, prior: Prior) -> CrossValidator:
        """The same data and columns under another prior."""
        return replace(self, fit=WeightedFit.of(self.columns, prior, self.spread))

    def without(self, stretches: Sequence[Stretch]) -> CrossValidator:
        """The same columns and prior without some stretches of time: (source, start, stop) each, s."""
        columns = ModelColumns.of(self.data.without(stretches), self.columns.added)
        return self._fitted(columns, self.fit.prior, self.known_residual)

    def may_leave_out(self, stretches: Sequence[Stretch]) -> bool:
        """Whether some stretches of time are the smaller part of each log, and every joint moves outside of them."""
        data = self.data
        for log in dict.fromkeys(source for source, _, _ in stretches):
            length = sum(float(t[-1] - t[0]) for s, t in zip(data.sources, data.times, strict=True) if s == log)
            if lasting([(a, b) for s, a, b in stretches if s == log]) > self.criteria.max_contact_share * length:
                return False
        return self.moves_without(stretches)

    def moves_without(self, stretches: Sequence[Stretch]) -> bool:
        """Whether every joint moves outside of some stretches of time."""
        return bool((_spread(self.data.without(stretches)) > 0).all())

    def extended(self, candidate: Candidate) -> CrossValidator:
        """The same data with a candidate added to the model; its coefficients have no prior.

        The result is kept: the stages try the same candidates together many times.
        """
        if candidate not in self._wider:
            self._wider[candidate] = self._extended(candidate)
        return self._wider[candidate]

    def _extended(self, candidate: Candidate) -> CrossValidator:
        prior = self.fit.prior
        p, k = len(prior.mean), len(candidate.signs)
        precision = np.zeros((p + k, p + k))
        precision[:p, :p] = prior.precision
        wider = Prior(np.append(prior.mean, np.zeros(k)), precision)
        return replace(self, fit=self.fit.extended(self.columns.extended(candidate), wider, self.spread))

    # ------------------------------------------------------------------ the fit

    @property
    def columns(self) -> ModelColumns:
        """Columns of the model, and of the candidates added to it."""
        return self.fit.columns

    @property
    def data(self) -> RegressionData:
        """Rows of the logs."""
        return self.fit.columns.data

    @property
    def model(self) -> Model:
        """The model as it was given."""
        return self.data.model

    @property
    def joints(self) -> tuple[str, ...]:
        """Fitted joints."""
        return self.data.model.joints

    @property
    def criteria(self) -> DiagnosisCriteria:
        """Thresholds of the diagnosis."""
        return self.data.cache.criteria

    @property
    def counts(self) -> Array:
        """Rows, (folds, J)."""
        return self.data.counts

    @property
    def theta(self) -> Array:
        """Parameters fitted on everything, (p,)."""
        return self.fit.theta

    @property
    def effective(self) -> Array:
        """Effectively independent samples of each joint, (J,)."""
        return np.asarray(self.counts.sum(axis=0) / self.fit.correlation)

    def residuals(self, row: int, theta: Array) -> Iterator[Array]:
        """Residual of a joint's rows under some parameters, motion by motion, (n,) each."""
        return self.columns.residuals(row, theta)

    def squares(self, row: int, theta: Array) -> float:
        """Sum of squared residuals of a joint's rows under some parameters."""
        return float(sum(x @ x for x in self.residuals(row, theta)))

    def predicted(self, joint: JointData) -> tuple[Array, Array]:
        """Torque of a joint's rows under the fits to the other folds, and under the fit to all, (n,) each."""
        if joint in self._predicted:
            return self._predicted[joint]
        theta = np.stack([system.theta for system in self.fit.systems])
        found = self.columns.predicted(joint, theta[:-1]), self.columns.predicted(joint, theta[-1])
        if joint.motion.in_memory:
            self._predicted[joint] = found
        return found

    # ------------------------------------------------------------------ candidates

    def candidates(
        self, effects: Sequence[Effect], progress: Callable[[str], None] = lambda _: None
    ) -> list[Candidate]:
        """Filtered columns of candidate effects over all rows."""
        return self.data.candidates(effects, progress)

    def joined(self, parts: Sequence[Candidate]) -> Candidate:
        """Several places of an effect as one candidate."""
        return self.data.cache.joined(parts)

    def screened(self, places: Sequence[Sequence[Effect]]) -> list[Sequence[Effect]]:
        """The shapes of each effect that best fit the residual, where an effect has many."""
        columns, theta = self.columns, self.theta
        return screened(self.data, places, lambda x: columns.residual(x, theta), self.fit.omega)

    def fits(self, candidates: Sequence[Candidate]) -> list[Fits]:
        """Fits of some candidates, each alone. They are kept; many candidates at once are fitted faster."""
        fresh = list(dict.fromkeys(c for c in candidates if c not in self._fits))
        found = candidate_fits(self.fit, [self.columns.moments(c) for c in fresh], fresh) if fresh else []
        self._fits.update(zip(fresh, found, strict=True))
        return [self._fits[c] for c in candidates]

    def fitted(self, candidate: Candidate, left_out: int | None = None) -> CandidateFit | None:
        """Fit a candidate on all folds but one (None: on all); None when the other columns span it."""
        return self.fits([candidate])[0][-1 if left_out is None else left_out]

    def score(self, candidates: Sequence[Candidate]) -> tuple[Score, Candidate] | None:
        """Score one effect in several shapes with the same number of columns.

        In every fold, the shape that fits the *other* folds best is scored.

        Returns
        -------
        (Score, Candidate) or None
            The candidate is the shape that fits all data best; None when the model's columns already span the effect.
        """
        fits = self.fits(candidates)
        sse, predictive = np.empty((2, self.data.folds, len(self.joints)))
        for f in range(self.data.folds):
            chosen = _best(fits, f)
            whole = None if chosen is None else fits[chosen[0]][-1]
            if chosen is None or whole is None:
                return None
            products = self._products(candidates[chosen[0]], (chosen[1], whole), f)
            sse[f], predictive[f] = np.maximum(products[:, 0, 0], 0.0), predictive_squares(products, self.fit.omega)
        chosen = _best(fits, -1)
        return None if chosen is None else (Score(sse, predictive, chosen[1].beta), candidates[chosen[0]])

    def shares(self, candidate: Candidate, fits: Sequence[CandidateFit]) -> Array:
        """Share s of each fold in the difference of its two errors that counts (`weighted_fit`), (folds,)."""
        products = (self._products(candidate, (fit, fits[-1]), fold) for fold, fit in enumerate(fits[:-1]))
        return np.array([counted_share(x, self.fit.omega) for x in products])

    def _products(self, candidate: Candidate, fits: tuple[CandidateFit, CandidateFit], fold: int) -> Array:
        """Sums of products of two residuals of a fold, (J, 2, 2): fitted to the other folds, and to all."""
        X, D = self.columns.moments(candidate)
        systems = self.fit.systems[fold], self.fit.systems[-1]
        d = np.array([np.append(s.theta + x.change, -1.0) for s, x in zip(systems, fits, strict=True)]).T
        beta = np.array([x.beta for x in fits]).T
        found = d.T @ (self.columns.gram[fold] @ d)
        for row, x in X.items():
            crossed = d.T @ x[fold] @ beta
            found[row] += crossed + crossed.T + beta.T @ D[row][fold] @ beta
        return np.asarray(found)

    # ------------------------------------------------------------------ errors and evidence

    def base_sse(self) -> Array:
        """Held-out sum of squared residuals without any candidate, (folds, J)."""
        return self.fit.held_out_sse

    def base_predictive(self) -> Array:
        """The same without the error that uncertain parameters alone cause: Q of `weighted_fit`, (folds, J)."""
        return self.fit.predictive_sse

    def base_nrmse(self) -> Array:
        """Held-out NRMSE of each joint without any candidate, (J,)."""
        return self.nrmse(self.base_sse())

    def predictive_nrmse(self) -> Array:
        """The same without the error that uncertain parameters alone cause, (J,)."""
        return self.nrmse(self.base_predictive())

    def nrmse(self, sse: Array) -> Array:
        """Held-out NRMSE of each joint from its sums of squares over the folds, (J,)."""
        # Rounding can make the sum of squares of exact data slightly negative.
        return np.asarray(np.sqrt(np.maximum(sse.sum(axis=0), 0.0) / self.counts.sum(axis=0)) / self.spread)

    def explained(self, before: Array, after: Array) -> float:
        """Fall of the sum over joints of the squared held-out NRMSE, from two sums of squares (folds, J)."""
        return float((self.nrmse(before) ** 2 - self.nrmse(after) ** 2).sum())

    @staticmethod
    def log_likelihood(before: Array, after: Array, effective: Array) -> float:
        """Log likelihood ratio of two sums of squares, (folds, J) or (J,), in independent samples, (J,)."""
        first, second = (np.maximum(np.atleast_2d(sse).sum(axis=0), 1e-300) for sse in (before, after))
        return float(0.5 * np.sum(effective * np.log(first / second)))

    def effective_with(self, candidate: Candidate) -> Array:
        """Effectively independent samples of each joint when a candidate is in the model, (J,).

        While a slow effect is missing from the model, the residual is correlated over the whole motion, so there seems
        to be hardly any evidence. So the correlation is taken from the residual with the effect in the model.
        """
        fit = self.fitted(candidate)
        effective: Array = np.array(self.effective, dtype=np.float64)
        if fit is None:
            return effective
        theta, n = self.theta + fit.change, self.counts.sum(axis=0)
        for row in candidate.columns:
            left = (x.tau - self.columns.predicted(x, theta, candidate, fit.beta) for x in self.data.motions_of(row))
            effective[row] = max(effective[row], n[row] / Autocorrelation.of(left).time)
        return effective


def _best(fits: Sequence[Fits], left_out: int) -> tuple[int, CandidateFit] | None:
    """Number of the shape that fits best in sample, and its fit."""
    possible = [(i, fit) for i, found in enumerate(fits) if (fit := found[left_out]) is not None]
    return max(possible, key=lambda x: x[1].gain, default=None)


def _spread(data: RegressionData) -> Array:
    """Standard deviation of each fitted joint's measured torque while it moves, (J,); zero where it never moves."""
    rows = range(len(data.model.joints))
    return np.array([Autocorrelation.of(x.measured for x in data.motions_of(row)).std for row in rows])
