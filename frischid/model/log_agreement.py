"""Whether the logs of one fit are of one robot: each log is held against a fit to all others.

With the fit to the other logs, residual variance σ_j² and covariance C of the parameters, the error to expect on log l
is that of every motion (`frischid.model.expected_error`),

    ε_j² = σ_j² + m_j ⟨y C yᵀ⟩_l,

with the share m_j of C that is the model's own error. A log of another robot, load or mounting has a larger error, and
the fit to all logs hides this: it lies between the robots, and each log has a part of the error. The limit of the ratio
is that of ``unlike-the-fitted-logs``, which asks the same of a log that was not fitted.

A log may also show an effect that the others hardly show. Then the others do not explain this log, but a fit to this
log explains the others. So the others are held against a fit to this log as well, and the smaller ratio counts.

The fits keep the prior, its scales and κ of the fit to all logs. Only parameters and noise are found again.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from frischid.core.text import listed
from frischid.core.types import Array
from frischid.estimators.map_estimate import MapEstimate
from frischid.estimators.map_problem import MapProblem
from frischid.logs.preprocessing import Motion
from frischid.model.alarms import LOGS_DISAGREE, Alarm, AlarmCriteria
from frischid.model.comparison_alarms import SMALLEST_ERROR, times_of
from frischid.model.identification_stages import Problem
from frischid.regression.accumulation import accumulate
from frischid.regression.moment_blocks import total
from frischid.regression.moments import Gram

NOISE_ROUNDS = 6
"""Most iterations of parameters and noise, as many as `friction_alone` makes."""
NOISE_FOUND = 0.01
"""Relative change of the variances below which the noise is found: half a percent of an error whose limit is 3."""


def disagreeing_logs(problem: Problem, fit: MapEstimate, share: Array, criteria: AlarmCriteria) -> list[Alarm]:
    """The alarm that some of the fitted logs are not of the robot of the others; empty for one log.

    Parameters
    ----------
    fit : MapEstimate
        To all logs.
    share : ndarray, shape (J,)
        Share of the parameters' covariance that is the model's own error.
    """
    ratios = {k: r for k, r in surprises(problem, fit, share).items() if r.max(initial=0.0) > criteria.surprise}
    if not ratios:
        return []
    worst = np.max([*ratios.values()], axis=0)
    where = tuple(n for n, x in zip(problem.data.joints, worst, strict=True) if x > criteria.surprise)
    names = listed([Path(source).name for source in ratios])
    which = f"{names} is" if len(ratios) == 1 else f"each of {names} is"
    return [
        Alarm(
            LOGS_DISAGREE,
            "severe",
            f"The fitted logs are not of one robot in one state: {which} unlike the other logs on {listed(where)}. The "
            f"error there is {times_of(float(worst.max()))} times the error that the uncertainty of a fit to the "
            "others explains. The robot, its base, its load or its sensors changed between the logs.",
            "Identify from the logs of one state. Then run frischid diagnose on the other logs to find the change.",
            where,
            float(worst.max()),
            criteria.surprise,
        )
    ]


def surprises(problem: Problem, fit: MapEstimate, share: Array) -> dict[str, Array]:
    """Log -> measured error over expected error of each joint (J,): the smaller one of both directions.

    0 for a joint that this log or all others do not move. Logs of poses are left out: dry friction may hold any torque
    up to its own size there.
    """
    moments = _by_log(problem, [m for m in problem.data.some_motions if not m.at_poses])
    if len(moments) < 2:
        return {}
    whole, found = total([*moments.values()]), {}
    for source, log in moments.items():
        others = whole - log
        pairs = ((log, others), (others, log))
        found[source] = np.min([_surprise(problem, fit, share, *pair) for pair in pairs], axis=0)
    return found


def _by_log(problem: Problem, motions: Sequence[Motion]) -> dict[str, Gram]:
    """Log -> moments of its motions; without logs in which no joint has a torque row."""
    data, reduction = problem.data, problem.reduction
    names = list(dict.fromkeys(motion.source for motion in motions))
    if len(names) < 2:
        return {}
    found = {}
    for name in names:
        own = [motion for motion in motions if motion.source == name]
        found[name] = total(
            accumulate(problem.regressor, own, data.lowpass, data.joints, base=reduction.base).described(
                reduction.base_columns()
            )
        )
    return {name: log for name, log in found.items() if log.rows}


def _surprise(problem: Problem, whole_fit: MapEstimate, share: Array, held: Gram, fitted: Gram) -> Array:
    """Measured over expected error of each joint on some logs, of a fit to others."""
    theta, covariance, variance = _fit(MapProblem(fitted, problem.reduction.mapping, whole_fit.prior), whole_fit)
    rows = np.maximum(held.counts, 1.0)
    uncertain = np.einsum("jab,ba->j", held.moments[:, :-1, :-1], covariance) / rows
    least = np.maximum(SMALLEST_ERROR**2 * held.torque_ss() / rows, 1e-300)
    expected = np.maximum(variance + share * np.maximum(uncertain, 0.0), least)
    known = (held.counts > 0) & (fitted.counts > 0)
    return np.asarray(np.where(known, np.sqrt(held.residual_ss(theta) / rows / expected), 0.0))


def _fit(some: MapProblem, whole_fit: MapEstimate) -> tuple[Array, Array, Array]:
    """Base parameters of some logs, their covariance and the residual variances (J,)."""
    kappa, variance = whole_fit.rows, whole_fit.variance
    precision = some.precision(whole_fit.prior.scales)
    for _ in range(NOISE_ROUNDS):
        before = variance
        weights = kappa / (some.counts * variance)
        equations = some.rows(weights, precision)
        x, root = equations.solve(), equations.root()
        used = weights * np.einsum("jab,ba->j", some.G, root @ root.T)
        variance = some.squares(x) / some.counts * kappa / np.maximum(kappa - used, 0.05 * kappa)
        variance = np.maximum(variance, 1e-300 + SMALLEST_ERROR**4 * whole_fit.variance)
        if np.allclose(variance, before, rtol=NOISE_FOUND, atol=0.0):
            break
    base = some.A @ root
    return some.A @ x, base @ base.T, variance
