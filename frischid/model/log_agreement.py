"""Whether the logs of one fit are of one robot: each log is held against a fit to all others (`log_moments`).

A log of another robot, load or mounting has a larger error than the fit to the others lets expect, and the fit to all
logs hides this: it lies between the robots, and each log has a part of the error. The limit of the ratio is that of
``unlike-the-fitted-logs``, which asks the same of a log that was not fitted.

A log may also show an effect that the others hardly show, and an effect that the model lacks biases each fit another
way. So the smallest of three ratios counts (`surprise_of_both`).
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from frischid.core.text import listed
from frischid.core.types import Array
from frischid.estimators.map_estimate import MapEstimate
from frischid.model.alarms import LOGS_DISAGREE, Alarm, AlarmCriteria
from frischid.model.comparison_alarms import times_of
from frischid.model.identification_stages import Problem
from frischid.model.log_moments import surprise_of_both
from frischid.regression.moment_blocks import total
from frischid.regression.moments import Gram


def disagreeing_logs(
    problem: Problem, logs: Mapping[str, Gram], fit: MapEstimate, share: Array, criteria: AlarmCriteria
) -> list[Alarm]:
    """The alarm that some of the fitted logs are not of the robot of the others; empty for one log.

    Parameters
    ----------
    fit : MapEstimate
        To all logs.
    share : ndarray, shape (J,)
        Share of the parameters' covariance that is the model's own error.
    """
    ratios = {k: r for k, r in surprises(problem, logs, fit, share).items() if r.max(initial=0.0) > criteria.surprise}
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


def surprises(problem: Problem, logs: Mapping[str, Gram], fit: MapEstimate, share: Array) -> dict[str, Array]:
    """Log -> measured error over expected error of each joint (J,): the smallest of three (`surprise_of_both`)."""
    if len(logs) < 2:
        return {}
    every = total(logs.values())
    return {name: surprise_of_both(problem, fit, share, log, every - log) for name, log in logs.items()}
