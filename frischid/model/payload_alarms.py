"""Whether a body explains how the logs with it differ from the model of the bare robot.

    rms error with the body  ≤  3 √((k σ_j)² + mean y C yᵀ),      k = max(1, torque with the body / torque without)

with σ and C of the model, as for every model on new logs (`frischid.model.comparison_alarms`). The factor k of the
spreads is there because a wrist bears much more with a body, and errors of gears and sensors are in part shares of the
torque. Parameters that the fit of the body may change, friction above all, only lower the error. Beyond this limit the
logs differ in another way, too. The fit then puts a part of that into the body, and its bounds, which know noise,
friction and the model's own error, are too narrow.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from frischid.core.text import listed
from frischid.core.types import Array
from frischid.logs.summary import Data
from frischid.model.alarms import Alarm, AlarmCriteria
from frischid.model.comparison_alarms import UNLIKE, times_of
from frischid.model.log_faults import faulty_new_logs
from frischid.model.model import Model
from frischid.regression.moments import Gram

DIFFERENT = "; these logs differ from the model in another way: frischid diagnose MODEL LOG"
"""Ending of the sentence that there is no body, where the logs are unlike the model's."""


def unlike_with_body(model: Model, whole: Gram, theta: Array) -> dict[str, float]:
    """Joints whose error with the body is larger than the uncertainty of the model explains.

    Parameters
    ----------
    model : Model
        Of the robot without the body, with p parameters.
    whole : Gram
        Moments of the logs; the first p columns are the model's.
    theta : ndarray, shape (C,)
        The parameters fitted with the body.

    Returns
    -------
    dict of str to float
        Joint -> measured over expected rms error; empty where the body explains the difference.

    Examples
    --------
    >>> import frischid as fr
    >>> from frischid.model.payload_alarms import unlike_with_body
    >>> from frischid.regression.accumulation import accumulate
    >>> from frischid.regression.moment_blocks import total
    >>> from frischid.regression.regressor import Regressor
    >>> robot = fr.Robot.load("planar2")
    >>> log = fr.simulate(robot, fr.random_fourier(robot, 6.0, seed=1), rate=100, noise=fr.Noise(tau=0.01))
    >>> model = fr.identify(robot, [log], recursion="none").model
    >>> regressor = Regressor(robot, model.effects, model.reference)
    >>> moments = total(accumulate(regressor, list(model.motions([log])), model.lowpass, model.joints, base=model.base))
    >>> unlike_with_body(model, moments, model.estimate.theta)
    {}
    """
    p, criteria = len(model.base), AlarmCriteria()
    count = np.maximum(whole.counts, 1.0)
    spread = np.einsum("ab,jab->j", model.estimate.covariance, whole.moments[:, :p, :p]) / count
    share, loaded = np.ones((2, len(count)))
    if (record := model.fitted) is not None:
        share, torque = record.model_share, np.sqrt(whole.torque_ss() / count)
        loaded = np.fmax(1.0, torque / np.where(record.spread > 0, record.spread, np.inf))
    expected = np.sqrt((loaded * model.estimate.sigma) ** 2 + share * np.maximum(spread, 0.0))
    measured = np.sqrt(whole.residual_ss(theta) / count)
    ratios = zip(model.joints, measured / np.maximum(expected, 1e-300), strict=True)
    # without a prior, C is of noise alone
    limit = criteria.held_out_ratio if model.prior is None else criteria.surprise
    return {name: float(ratio) for name, ratio in ratios if ratio > limit}


def alarms_with_body(model: Model, logs: Sequence[Data], unlike: dict[str, float]) -> tuple[Alarm, ...]:
    """Alarms of an identified body; none where the body explains the difference between the logs and the model.

    Parameters
    ----------
    logs : sequence of Log or Recording
        With the body.
    unlike : dict of str to float
        Of `unlike_with_body`.

    Examples
    --------
    >>> from frischid.model.payload_alarms import alarms_with_body
    >>> alarms_with_body(None, [], {})
    ()
    """
    if not unlike:
        return ()
    ratio, where = max(unlike.values()), tuple(unlike)
    return (
        *faulty_new_logs(model, logs, where),
        Alarm(
            UNLIKE,
            "severe",
            f"Even with this body, the error on {listed(where)} is {times_of(ratio)} times the error that the "
            "uncertainty of the model explains. These logs differ from the model in another way, too, so the bounds "
            "of the body are too narrow.",
            "Do not enter the numbers. Run frischid check and frischid diagnose on these logs.",
            where,
            ratio,
            AlarmCriteria().surprise,
        ),
    )
