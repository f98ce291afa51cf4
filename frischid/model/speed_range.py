"""How much faster than its logs a model may move: the error to expect at multiples of their speed.

Along the fitted motion run faster by a factor f, ``(q, f q̇, f² q̈)``, the error to expect of joint j is that of every
motion (`frischid.model.expected_error`),

    ε_j(f)² = σ_j² + m_j ⟨y C yᵀ⟩_f,

with the share m_j of the covariance C that is the model's own error. Slow logs show gravity and friction, and leave the
inertias to the prior, so ε grows soon. The factor told is the one at which the mean of ε over the joints passes the
limit of the alarm ``extrapolation``. Another path adds to the error: on twelve simulated arms with random paths the
measured error at this factor was 1.5 to 3.8 times, in the mean 2.3 times, the cross-validated one.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from frischid.logs.preprocessing import Motion
from frischid.model.alarms import AlarmCriteria
from frischid.model.comparison_alarms import mean
from frischid.model.identification_alarms import run_faster
from frischid.model.model import Model
from frischid.regression.regressor import Regressor

LARGEST_FACTOR = 100.0
"""Factor beyond which no motion is asked for; joints without a speed limit in the URDF have no other end."""
HALVINGS = 7
"""Of the logarithm of the factor: to 1 % of it."""


class SpeedRange(NamedTuple):
    """Speeds up to which the error of a model is usual."""

    doubles: float
    """Multiple of the speed of the fitted logs at which the error is expected to double, at most `allowed`."""
    allowed: float
    """Multiple that the speed limits of the URDF allow, at most `LARGEST_FACTOR`."""

    def __str__(self) -> str:
        """In a sentence.

        Examples
        --------
        >>> print(SpeedRange(3.02, 33.1))
        on the path of the fitted logs, the cross-validated error is expected to double at about 3 times their speed;
        the URDF's speed limits allow 33 times
        >>> print(SpeedRange(1.8, 1.8))
        on the path of the fitted logs, the cross-validated error is not expected to double up to the URDF's speed
        limits, 1.8 times their speed
        >>> print(SpeedRange(1.0, 1.0))
        the fitted logs reach the URDF's speed limits
        """
        limited = self.allowed < LARGEST_FACTOR
        if f"{self.allowed:.2g}" == "1":
            return "the fitted logs reach the URDF's speed limits"
        if self.doubles >= self.allowed:
            limits = "the URDF's speed limits, " if limited else ""
            end = f"not expected to double up to {limits}{self.allowed:.2g} times their speed"
        else:
            limits = f"; the URDF's speed limits allow {self.allowed:.2g} times" if limited else ""
            end = f"expected to double at about {self.doubles:.2g} times their speed{limits}"
        return f"on the path of the fitted logs, the cross-validated error is {end}"


def speed_range(model: Model, motions: Sequence[Motion], usual: float, criteria: AlarmCriteria) -> SpeedRange | None:
    """The speeds up to which the error of a model is usual.

    Parameters
    ----------
    motions : sequence of Motion
        Of the logs that the model was fitted to.
    usual : float
        Cross-validated NRMSE on these logs, mean over the joints.
    criteria : AlarmCriteria
        Limit of the error.

    Returns
    -------
    SpeedRange or None
        None without a prior, because the covariance is then of noise alone; None too where nothing moves, or where the
        error to expect is not usual on the logs themselves.
    """
    record = model.fitted
    if model.prior is None or record is None or not (record.velocity > 0).any():
        return None
    index = model.torque_index
    limits = model.robot.limits.velocity[index]
    spare = [limit / v for limit, v in zip(limits, record.velocity, strict=True) if v > 0 and 0 < limit < np.inf]
    allowed = float(np.clip(min(spare, default=LARGEST_FACTOR), 1.0, LARGEST_FACTOR))
    regressor, noise = Regressor(model.robot, model.effects, model.reference), model.estimate.sigma**2

    def usual_at(factor: float) -> bool:
        """Whether the error to expect at a multiple of the speed is still usual."""
        blocks = [Y[:, list(model.base)][:, :, index] for Y, _ in run_faster(regressor, motions, factor)]
        squares = np.concatenate([model.estimate.parameter_variance(Y) for Y in blocks]).mean(axis=0)
        expected = np.sqrt(noise + record.model_share * squares)
        return mean(expected / np.where(record.spread > 0, record.spread, np.nan)) <= criteria.extrapolation * usual

    if usual_at(allowed):
        return SpeedRange(allowed, allowed)
    if not usual_at(1.0):
        return None
    low, high = 0.0, float(np.log(allowed))
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if usual_at(float(np.exp(middle))) else (low, middle)
    return SpeedRange(float(np.exp(low)), allowed)
