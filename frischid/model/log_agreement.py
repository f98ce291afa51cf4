"""Whether the logs of one fit are of one robot: each log is held against a fit to all others.

With the fit to the other logs, residual variance σ_j² and covariance C of the parameters, the error to expect on a log
is that of every motion (`frischid.model.expected_error`),

    ε_j² = σ_j² + m_j ⟨y C yᵀ⟩,

with the share m_j of C that is the model's own error. The *surprise* is the measured error over ε_j. A log of another
robot, load or mounting has a large surprise, and the fit to all logs hides this: it lies between the robots, and each
log has a part of the error. The limit is that of ``unlike-the-fitted-logs``, which asks the same of a log that was not
fitted.

A log may also show an effect that the others hardly show, and an effect that the model lacks biases each fit another
way. So the smallest of three ratios counts (`surprise_of_both`).

The fits keep the prior and its scales of the fit to all logs. Parameters, noise and κ are found again: some logs show
fewer shapes of motion than all.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from frischid.core.text import listed
from frischid.core.types import Array
from frischid.errors import IdentifiabilityError
from frischid.estimators.map_estimate import MapEstimate, effective_rows
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


class PartFit(NamedTuple):
    """A fit to some rows: base parameters (p,), their covariance (p, p) and the residual variances (J,)."""

    theta: Array
    covariance: Array
    variance: Array


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
    """Log -> measured error over expected error of each joint (J,): the smallest of three (`surprise_of_both`)."""
    logs = _moments_by_log(problem)
    if len(logs) < 2:
        return {}
    every = total(logs.values())
    return {name: surprise_of_both(problem, fit, share, log, every - log) for name, log in logs.items()}


def _moments_by_log(problem: Problem) -> dict[str, Gram]:
    """Log -> its moments; without logs in which no joint has a torque row.

    Logs of poses are left out: dry friction may hold any torque up to its own size there.
    """
    data, reduction = problem.data, problem.reduction
    motions: dict[str, list[Motion]] = {}
    for motion in data.some_motions:
        if not motion.at_poses:
            motions.setdefault(motion.source, []).append(motion)
    if len(motions) < 2:
        return {}
    found = {}
    for name, own in motions.items():
        blocks = accumulate(problem.regressor, own, data.lowpass, data.joints, base=reduction.base)
        found[name] = total(blocks.described(reduction.base_columns()))
    return {name: log for name, log in found.items() if log.rows}


def surprise_of_both(problem: Problem, whole_fit: MapEstimate, share: Array, one: Gram, other: Gram) -> Array:
    """The smallest of three surprises of each joint, (J,): 0 for a joint that one of the two parts does not move.

    Of `one` to a fit to `other`, and the reverse: a part may show an effect that the other part hardly shows. Then the
    other part does not explain this one, but a fit to this part explains the other one. And of both parts to the fit to
    all logs, beside a fit to each: where one fit explains both as well as two, there are no two robots. A part that
    does not determine the parameters is no surprise.

    Parameters
    ----------
    whole_fit : MapEstimate
        To all logs.
    share : ndarray, shape (J,)
        Share of the parameters' covariance that is the model's own error.
    one, other : Gram
        Moments of both parts.
    """
    rows = one.counts + other.counts
    try:
        fits = [_fit(MapProblem(part, problem.reduction.mapping, whole_fit.prior), whole_fit) for part in (one, other)]
    except IdentifiabilityError:  # a few samples without noise: what they leave open, they cannot speak against
        return np.zeros(len(rows))
    crossed = [surprise(share, held, fit) for held, fit in zip((other, one), fits, strict=True)]
    apart = (one.counts * fits[0].variance + other.counts * fits[1].variance) / np.maximum(rows, 1.0)
    together = (one.residual_ss(whole_fit.theta) + other.residual_ss(whole_fit.theta)) / np.maximum(rows, 1.0)
    found = np.min([*crossed, np.sqrt(together / np.maximum(apart, _least(one + other)))], axis=0)
    return np.asarray(np.where((one.counts > 0) & (other.counts > 0), found, 0.0))


def surprise(share: Array, held: Gram, fit: PartFit) -> Array:
    """Measured over expected error of each joint on some rows, of a fit to others, (J,)."""
    rows = np.maximum(held.counts, 1.0)
    uncertain = np.einsum("jab,ba->j", held.moments[:, :-1, :-1], fit.covariance) / rows
    expected = np.maximum(fit.variance + share * np.maximum(uncertain, 0.0), _least(held))
    return np.asarray(np.sqrt(held.residual_ss(fit.theta) / rows / expected))


def _least(held: Gram) -> Array:
    """Squared error that is none, (J,)."""
    return np.maximum(SMALLEST_ERROR**2 * held.torque_ss() / np.maximum(held.counts, 1.0), 1e-300)


def _fit(some: MapProblem, whole_fit: MapEstimate) -> PartFit:
    """Fit some rows."""
    count = len(some.prior.names)
    kappa = effective_rows(some.G[:, :count, :count] * np.outer(some.prior.spread, some.prior.spread))
    variance = whole_fit.variance
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
    return PartFit(some.A @ x, base @ base.T, variance)
