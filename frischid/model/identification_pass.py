"""The pass of a fitted model over its own logs: errors, quantiles of the error, share of the URDF, lag of the torque.

    fit → folds (cross-validation) → one pass: e = τ − Y θ → error, floor, quantiles of |e| / σ, lag d

All of them need the residuals sample by sample, so the logs are evaluated once for all. The cross-validated error needs
the moments and the torque alone: a refit that is refused makes no pass.

Least squares is fitted again without each stretch. The other estimators (the Frisch point, sensor-wise, EIV, IV) move
the parameters away from least squares by Δ. Their folds are those of least squares moved by the same Δ, so the error is
that of the model's own values.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from frischid.core.types import Array
from frischid.errors import InputError
from frischid.estimators.held_out import Fold, held_out_variance
from frischid.estimators.least_squares import least_squares_folds
from frischid.estimators.map_estimate import map_folds
from frischid.estimators.urdf_prior import UrdfPrior
from frischid.logs.filters import decimate
from frischid.model.comparison import Comparison, ModelErrors
from frischid.model.fit_record import FitRecord
from frischid.model.identification_alarms import fit_record, model_share
from frischid.model.identification_bounds import Bounds, recursion_record
from frischid.model.joint_fit import TorqueSums
from frischid.model.lag_sums import LagSums
from frischid.model.model import Model
from frischid.model.residual_scores import ResidualScores
from frischid.model.torque_lag import TorqueLag, torque_lag

LEAST_SPREAD = 1e-150
"""N·m (N). Spread of a torque that never changes: its error is not divided by zero."""


@dataclass(frozen=True, eq=False)
class Folded:
    """A fit, and the same fit without each stretch of its logs."""

    bounds: Bounds
    folds: tuple[Fold, ...]

    @cached_property
    def variance(self) -> Array:
        """Mean square error of each joint on stretches left out of the fit, (N·m)² (N²), (J,)."""
        return held_out_variance(self.folds)

    @cached_property
    def nrmse(self) -> float:
        """NRMSE on stretches left out of the fit, mean over the joints that move, as `assess` states it."""
        torque = _measured_torque(self.bounds)
        compared = torque.changing if torque.changing.any() else np.ones(torque.joints, bool)
        return float(np.mean((np.sqrt(self.variance) / np.maximum(torque.std, LEAST_SPREAD))[compared]))

    @cached_property
    def model(self) -> Model:
        """The fitted model, as yet without a history and without a record of its logs."""
        return _model(self.bounds, None)


def folded(bounds: Bounds) -> Folded:
    """Fit again without each stretch of the logs."""
    fit, problem = bounds.fit, bounds.fit.problem
    problem.data.journal.stage("cross-validation")
    if fit.posterior is not None:
        return Folded(bounds, map_folds(problem.blocks, problem.reduction.mapping, fit.posterior))
    folds = least_squares_folds(problem.blocks, bounds.estimate.weights)
    return Folded(bounds, _moved(folds, bounds.estimate.theta - fit.estimate.theta))


@dataclass(frozen=True, eq=False)
class Measured:
    """A model after the pass over its own logs."""

    bounds: Bounds
    variance: Array
    """Mean square error of each joint on stretches left out of the fit, (N·m)² (N²), (J,)."""
    model: Model
    """As yet without a history."""
    there: Comparison | None
    """With its own logs; None where no torque changes."""
    lag: TorqueLag | None
    """Of these logs."""
    spread: Array
    """Standard deviation of each joint's measured torque, N·m (N), (J,)."""


def measured(found: Folded, *, with_lag: bool = True) -> Measured:
    """The model with its record, its comparison with its own logs, and the lag of their torque if it is asked for."""
    bounds, problem = found.bounds, found.bounds.fit.problem
    problem.data.journal.stage("comparison")
    lags = LagSums(problem, bounds.estimate, wanted=with_lag)
    model, there, spread = _compared(bounds, ResidualScores(problem, found.folds, bounds.estimate), lags)
    return Measured(bounds, found.variance, model, there, torque_lag(problem, bounds.estimate, lags), spread)


def _moved(folds: Sequence[Fold], step: Array) -> tuple[Fold, ...]:
    """Folds with their parameters moved by a step (p,)."""
    return tuple(replace(fold, theta=fold.theta + step) for fold in folds)


def _compared(bounds: Bounds, scores: ResidualScores, lags: LagSums) -> tuple[Model, Comparison | None, Array]:
    """The model with its record, its comparison with its own logs (None where no torque changes), the torques' spread.

    Mean and spread are those of the torque as measured: the moments lack the torque of known parameters.
    """
    fit, data, record = bounds.fit, bounds.fit.problem.data, fit_record(bounds.fit)
    model = _model(bounds, record)
    errors = ModelErrors(model, residuals_kept=1)
    for block, fitted in model.evaluate(lags.watch(errors.noise.watch(data.motions))):
        errors.add(block, fitted)
        scores.add(block)
        lags.add(block)
    mean, spread = errors.own_torque()
    model, record = replace(model, mean_torque=mean), replace(record, scores=scores.quantiles(), spread=spread)
    try:
        there = errors.comparison(tuple(log.source for log in data.logs))
    except InputError:
        return replace(model, fitted=record), None, spread
    if fit.posterior is not None:
        record = replace(record, model_share=model_share(fit.problem, there, fit.posterior.rows))
    return replace(model, fitted=record), there, spread


def _measured_torque(bounds: Bounds) -> TorqueSums:
    """Sums of the measured torque of the samples that the pass compares."""
    problem, data = bounds.fit.problem, bounds.fit.problem.data
    index = [data.robot.joints.index(name) for name in data.joints]
    sums = TorqueSums(len(index))
    for motion in data.motions:
        taps, every = data.lowpass.taps(motion.step), data.lowpass.decimation(motion.step)
        used = problem.regressor.counted(decimate(abs(taps), motion.standstill.astype(float), every))
        sums.add_torque(decimate(taps, motion.tau[:, index], every), used[:, index].astype(float))
    return sums


def _model(bounds: Bounds, record: FitRecord | None) -> Model:
    """The model, as yet without a history."""
    fit, problem, data = bounds.fit, bounds.fit.problem, bounds.fit.problem.data
    return Model(
        robot=data.robot,
        effects=problem.effects,
        lowpass=data.lowpass,
        velocity=data.options.velocity,
        base=problem.reduction.base,
        expressions=tuple(problem.reduction.expressions()),
        estimate=bounds.estimate,
        mean_torque=np.zeros(len(data.joints)),
        bounds=bounds.boxes,
        reference=data.options.reference,
        recursion=recursion_record(bounds, data.options.criteria),
        prior=None if fit.posterior is None else UrdfPrior.of(fit.posterior),
        fitted=record,
        controller=data.options.controller,
        currents=data.options.currents,
    )
