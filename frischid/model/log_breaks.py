"""Whether a log is of one robot in one state from its beginning to its end: the log is cut where two fits say most.

A robot that grasps a body in the middle of a log is another robot after that. One fit to the whole log lies between the
two, and each part has a part of the error. With weights w_j from the joints' noise in the fit to all logs, the log is
cut at the block b that leaves the least error of two fits,

    b* = argmin_b  min_θ Σ_j w_j ‖τ_j − Y_j θ‖²(before b)  +  min_θ Σ_j w_j ‖τ_j − Y_j θ‖²(from b on),

each with the prior of the fit. Then each part is held against a fit to the other part, as two logs are
(`frischid.model.log_agreement`), with the same limit. A drift, as of a joint that warms up, is no cut: two fits leave
much of its error, too.

Source: Chow 1960, "Tests of equality between sets of coefficients in two linear regressions", Econometrica 28(3).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import isqrt
from pathlib import Path

import numpy as np

from frischid.core.text import listed
from frischid.core.types import Array
from frischid.errors import IdentifiabilityError
from frischid.estimators.map_estimate import MapEstimate
from frischid.estimators.map_problem import MapProblem
from frischid.model.alarms import LOG_CHANGES, Alarm, AlarmCriteria
from frischid.model.comparison_alarms import times_of
from frischid.model.identification_stages import Problem
from frischid.model.log_moments import LogMoments, surprise_of_both


@dataclass(frozen=True, eq=False)
class Break:
    """Where a log is cut."""

    time: float
    """Since the log's first sample, s."""
    surprise: Array
    """Measured error over expected error of each joint, (J,), of one part held against a fit to the other."""


def changing_logs(
    problem: Problem, logs: Mapping[str, LogMoments], fit: MapEstimate, share: Array, criteria: AlarmCriteria
) -> list[Alarm]:
    """An alarm for each log in the middle of which the robot changed.

    Parameters
    ----------
    fit : MapEstimate
        To all logs.
    share : ndarray, shape (J,)
        Share of the parameters' covariance that is the model's own error.
    """
    found = {name: cut for name, log in logs.items() if (cut := break_of(problem, log, fit, share)) is not None}
    broken = {k: cut for k, cut in found.items() if cut.surprise.max(initial=0.0) > criteria.surprise}
    if not broken:
        return []
    worst = np.max([cut.surprise for cut in broken.values()], axis=0)
    where = tuple(n for n, x in zip(problem.data.joints, worst, strict=True) if x > criteria.surprise)
    places = listed([f"at about {cut.time:.1f} s of {Path(name).name or 'the log'}" for name, cut in broken.items()])
    return [
        Alarm(
            LOG_CHANGES,
            "severe",
            f"The fitted logs are not of one robot in one state: {places} something changes. The torque before is "
            f"unlike the torque after on {listed(where)}. The error there is {times_of(float(worst.max()))} times the "
            "error that the uncertainty of a fit to the other part explains. The robot took or put down a load, or its "
            "base, a brake or a sensor changed.",
            "Cut the log there (frischid cut LOG --until TIME) and identify from one part; frischid diagnose finds the "
            "change on the other part.",
            where,
            float(worst.max()),
            criteria.surprise,
        )
    ]


def break_of(problem: Problem, log: LogMoments, fit: MapEstimate, share: Array) -> Break | None:
    """The best cut of a log; None where the log is a single block."""
    cuts = len(log.blocks) - 1
    if not cuts:
        return None
    both = log.blocks.total()
    weights = fit.rows / (np.maximum(both.counts, 1.0) * fit.variance)
    whole = MapProblem(both, problem.reduction.mapping, fit.prior)
    precision, each = whole.precision(fit.prior.scales), [block.weighted(weights) for block in log.blocks]
    before, after = np.cumsum(each[:-1], axis=0), np.cumsum(each[:0:-1], axis=0)[::-1]

    def error(part: Array) -> float:
        """Weighted squared error of the fit to the rows with these weighted moments, (p + 1, p + 1).

        Infinite where they do not determine the parameters.
        """
        try:
            x = whole.rows_of(part[:-1, :-1], part[:-1, -1], precision).solve()
        except IdentifiabilityError:
            return np.inf
        theta = np.append(whole.A @ x, -1.0)
        return float(theta @ part @ theta)

    best = least_of(cuts, lambda k: error(before[k]) + error(after[k]))
    part = log.blocks[: best + 1].total()
    return Break(float(log.starts[best + 1]), surprise_of_both(problem, fit, share, part, both - part))


def least_of(count: int, error: Callable[[int], float]) -> int:
    """The number k < count with the least error, looked for among few numbers first, then beside the best of these.

    The error of two fits falls from both sides towards the moment of a change.

    >>> least_of(40, lambda k: abs(k - 17))
    17
    """
    step = isqrt(count)
    best = min(range(step // 2, count, step), key=error)
    return min(range(max(0, best - step + 1), min(count, best + step)), key=error)
