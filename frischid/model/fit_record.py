"""The record that a model keeps of the logs it was fitted to, for later comparisons with other logs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from statistics import NormalDist
from typing import Any

import numpy as np

from frischid.core.types import Array
from frischid.estimators.least_squares import Estimate

LEVELS = (0.5, 0.6827, 0.8, 0.9, 0.95, 0.99)
"""Shares of the measurements at which quantiles of the error are kept; the normal's are stretched between them."""


@dataclass(frozen=True, eq=False)
class FitRecord:
    """The reach of the fitted logs, and the reference that a model must beat.

    Examples
    --------
    >>> import numpy as np
    >>> from frischid.model.fit_record import FitRecord
    >>> record = FitRecord(np.ones(2), np.ones(2), np.zeros(3), np.ones((6, 2)), np.ones(2), np.ones(2))
    >>> FitRecord.from_dict(record.to_dict()).urdf.shape
    (3,)
    """

    velocity: Array
    acceleration: Array
    """`velocity`, `acceleration`: Speed and acceleration of the fitted joints below which 99 % of the samples are,
    rad/s (m/s), rad/s² (m/s²), (J,)."""
    urdf: Array
    """Base parameters of the URDF's links with friction and offsets fitted to the same logs, (p,): the model of a
    careful user of the URDF. A simulator's damping is not used."""
    scores: Array
    """Quantiles of each joint's error on stretches left out of the fit, in standard deviations of its residual, (L, J);
    NaN for a joint without rows (`frischid.model.residual_scores`)."""
    model_share: Array
    """Share of the parameters' covariance that is there on another motion, (J,). The prior's covariance holds the
    model's own error, as if all of the residual were that. Where the sensors' noise causes a part w of the residual,
    that part averages out over the n independent rows of the log: the share is ``1 − w + w κ/n``."""
    spread: Array
    """Standard deviation of the torque on the fitted logs, N·m (N), (J,); NaN if unknown. Errors on two motions are
    compared in this unit: a gentle motion has a large relative error from the same noise."""

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON values."""
        return {
            "velocity": [float(x) for x in self.velocity],
            "acceleration": [float(x) for x in self.acceleration],
            "urdf": [float(x) for x in self.urdf],
            "scores": [[float(x) if np.isfinite(x) else None for x in row] for row in self.scores],
            "model_share": [float(x) for x in self.model_share],
            "spread": [float(x) if np.isfinite(x) else None for x in self.spread],
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> FitRecord:
        """Inverse of `to_dict`."""
        known = {key: np.array(data[key], dtype=float) for key in ("velocity", "acceleration", "urdf", "scores")}
        share = data.get("model_share") or np.ones(len(known["velocity"]))
        spread = data.get("spread") or np.full(len(known["velocity"]), np.nan)
        return cls(**known, model_share=np.array(share, dtype=float), spread=np.array(spread, dtype=float))

    def extended(self, count: int) -> FitRecord:
        """The same for a model with further parameters, which the URDF knows nothing of."""
        return replace(self, urdf=np.append(self.urdf, np.zeros(count)))

    def interval_reach(self, interval: float) -> Array:
        """Half width of a prediction interval on the fitted motion, in standard deviations of the residual, (J,).

        Parameters
        ----------
        interval : float
            Share of the measurements that the interval is to hold, between 0 and 1.
        """
        normal, known = normal_reach(interval), np.array([normal_reach(level) for level in LEVELS])
        stretches = np.where(np.isfinite(self.scores), self.scores / known[:, None], 1.0).T
        return np.array([normal * np.interp(normal, known, stretch) for stretch in stretches])


def normal_reach(interval: float) -> float:
    """Half width of the interval that holds a share of a normal distribution, in standard deviations."""
    return NormalDist().inv_cdf(0.5 + 0.5 * interval)


def half_width(estimate: Estimate, record: FitRecord | None, Y: Array, interval: float) -> Array:
    """Half width ``sqrt((r_j σ_j)² + z² s_j y C yᵀ)`` of the interval that holds a share of the measurements, (M, J).

    r_j is the reach that held this share of the torque of joint j on stretches left out of the fit, in residual
    standard deviations σ_j. z is that of a normal distribution, and takes the place of r_j without such a fit. s_j is
    the share of the parameters' covariance that is there on another motion (`FitRecord.model_share`).

    Parameters
    ----------
    Y : ndarray, shape (M, p, J)
        Base columns of the fitted joints.
    interval : float
        Share, between 0 and 1.
    """
    normal, uncertain = normal_reach(interval), estimate.parameter_variance(Y)
    if record is None:
        return np.asarray(normal * np.sqrt(estimate.sigma**2 + uncertain))
    own = (record.interval_reach(interval) * estimate.sigma) ** 2
    return np.asarray(np.sqrt(own + normal**2 * record.model_share * uncertain))
