"""Alarms of a model on logs that it was not fitted to.

The error to expect there is ``√(σ² + y C yᵀ)`` (`frischid.model.expected_error`), with the posterior covariance C. Far
above the error on the fitted logs, it means extrapolation. If this error and the noise of the sensors on these logs are
both far below the error that was measured, the robot or the sensors are not those of the fitted logs.

Errors on two motions are compared in N·m (N), as shares of the torque of the *fitted* logs. Relative to its own torque,
the error on a gentle motion is large although the model is as good there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from frischid.core.text import listed, percent
from frischid.core.types import Array
from frischid.model.alarms import Alarm, AlarmCriteria

SMALLEST_ERROR = 1e-4
"""Share of the torque's standard deviation below which an error is none. Measured logs have noise floors above 1e-3.
Logs simulated without noise have errors of 1e-12 to 3e-5, from rounding and derivatives; their ratios mean nothing."""


UNLIKE = "unlike-the-fitted-logs"
"""Alarm: the error on some logs is more than the uncertainty of the model explains."""


@dataclass(frozen=True, eq=False)
class Elsewhere:
    """A model on logs that it was not fitted to."""

    joints: tuple[str, ...]
    spread: Array
    """Standard deviation of the torque on these logs, N·m (N), (J,)."""
    fitted_spread: Array
    """Standard deviation of the torque on the fitted logs, N·m (N), (J,); 0 for a joint without a torque row there."""
    held: Array
    """Torque with which dry friction may hold the joint where the arm stands still, rms, N·m (N), (J,)."""
    expected: Array
    measured: Array
    """`expected`, `measured`: Root mean square error on these logs, (J,): to be expected from the model's uncertainty
    (NaN for a model without a prior, whose uncertainty is of noise alone), and measured, N·m (N)."""
    floors: Array
    """Error that the sensors' noise alone causes, N·m (N), (J,)."""
    outside: Array
    """Share of samples whose speed or acceleration the fitted logs do not reach, (J,)."""
    nrmse: float
    noise_floor: float
    """`nrmse`, `noise_floor`: Mean NRMSE on these logs, and of the sensors' noise alone."""
    cross_validated: float
    """Mean NRMSE, cross-validated on the fitted logs; NaN if unknown."""
    urdf: float
    """Mean NRMSE of the URDF with fitted friction on these logs; NaN if unknown."""

    def of_fitted(self, torques: Array) -> Array:
        """Torques (J,) as shares of the torque of the fitted logs; NaN for a joint without a torque row there."""
        known = np.where(self.fitted_spread > 0, self.fitted_spread, np.nan)
        return np.asarray(torques / known)

    @property
    def usual(self) -> float:
        """Error to take for usual here: the cross-validated one, and at poses also the dry friction that may hold."""
        return float(np.maximum(np.hypot(self.cross_validated, mean(self.of_fitted(self.held))), SMALLEST_ERROR))


def mean(shares: Array) -> float:
    """Mean over the joints whose share is known; NaN without one."""
    known = shares[np.isfinite(shares)]
    return float(known.mean()) if len(known) else np.nan


def elsewhere(seen: Elsewhere, criteria: AlarmCriteria) -> list[Alarm]:
    """Alarms of a model on logs that it was not fitted to."""
    before = _extrapolation(seen, criteria)
    after = _surprise(seen, criteria) or _unexpected(seen, before, criteria)
    found = [*before, *after, *_useless(seen, criteria)]
    if is_worse(seen.nrmse, seen.urdf, seen.noise_floor, criteria):
        found.append(
            Alarm(
                "worse-than-urdf",
                "severe",
                f"On these logs the URDF with fitted friction has a smaller error (NRMSE {seen.urdf:.4f}) "
                f"than the model ({seen.nrmse:.4f}).",
                "Do not use the model for such motions. Identify from logs with such motions.",
                (),
                seen.nrmse,
                seen.urdf,
            )
        )
    return found


def is_worse(nrmse: float, urdf: float, noise_floor: float, criteria: AlarmCriteria) -> bool:
    """Whether an error is above that of the URDF with fitted friction, and above the sensors' noise."""
    return nrmse > max(criteria.worse_than_urdf * urdf, criteria.above_noise * noise_floor, SMALLEST_ERROR)


def _extrapolation(seen: Elsewhere, criteria: AlarmCriteria) -> list[Alarm]:
    found = []
    share = seen.of_fitted(seen.expected)
    ratio = mean(share) / seen.usual
    if ratio > criteria.extrapolation:
        found.append(
            Alarm(
                "extrapolation",
                # The torque was measured here: an error that did not come makes the warning a doubt.
                "severe" if mean(seen.of_fitted(seen.measured)) > criteria.extrapolation * seen.usual else "doubt",
                "The motion of these logs goes beyond the motion of the fitted logs: the expected error here is "
                f"{ratio:.1f} times the cross-validated error (both in N·m or N).",
                "Identify from logs with such motions.",
                tuple(n for n, x in zip(seen.joints, share, strict=True) if x > criteria.extrapolation * seen.usual),
                ratio,
                criteria.extrapolation,
            )
        )
    wide = float(np.median(seen.outside))
    if wide > criteria.outside_share:
        found.append(
            Alarm(
                "faster-than-fitted",
                "doubt",
                f"{percent(wide)} of the samples are faster, or accelerate more, than any fitted sample (median "
                "joint).",
                "Identify from logs as fast as these.",
                tuple(n for n, x in zip(seen.joints, seen.outside, strict=True) if x > criteria.outside_share),
                wide,
                criteria.outside_share,
            )
        )
    return found


def _useless(seen: Elsewhere, criteria: AlarmCriteria) -> list[Alarm]:
    """Joints whose torque the model predicts worse than a constant torque does, by more than the sensors' noise."""
    share = seen.measured / np.maximum(seen.spread, 1e-300)
    bad = (share > 1.0) & (seen.measured > criteria.above_noise * seen.floors)
    where = tuple(n for n, x in zip(seen.joints, bad, strict=True) if x)
    if not where:
        return []
    those = "these joints" if len(where) > 1 else "this joint"
    return [
        Alarm(
            "worse-than-constant",
            "severe",
            f"On these logs a constant torque has a smaller error than the model on {listed(where)} (NRMSE up to "
            f"{float(share[bad].max()):.2f}; the mean torque of these logs has 1).",
            f"Do not use the model for {those}. Run frischid diagnose: an effect on {those} may be missing.",
            where,
            float(share[bad].max()),
            1.0,
        )
    ]


def _surprise(seen: Elsewhere, criteria: AlarmCriteria) -> list[Alarm]:
    least = np.maximum(SMALLEST_ERROR * seen.spread, 1e-300)
    ratio = seen.measured / np.maximum(np.maximum(np.hypot(seen.expected, seen.held), seen.floors), least)
    where = tuple(n for n, x in zip(seen.joints, ratio, strict=True) if x > criteria.surprise)
    if not where:
        return []
    return [
        Alarm(
            UNLIKE,
            "severe",
            f"The error on {', '.join(where)} is {times_of(float(ratio.max()))} times the error that the "
            "uncertainty of the model and the noise of the sensors explain. Either the robot, its base, its load or "
            "its sensors have changed, or these logs show an effect that the fitted logs hardly show.",
            "Run frischid diagnose on these logs to find the change or the effect.",
            where,
            float(ratio.max()),
            criteria.surprise,
        )
    ]


def times_of(ratio: float) -> str:
    """A ratio in the digits that say something.

    Examples
    --------
    >>> times_of(3.84), times_of(1128159.8)
    ('3.8', '1130000')
    """
    return f"{ratio:.1f}" if ratio < 100 else f"{float(f'{ratio:.3g}'):.0f}"


def _unexpected(seen: Elsewhere, before: list[Alarm], criteria: AlarmCriteria) -> list[Alarm]:
    """An error far above the cross-validated one and the sensors' noise, which no alarm of the motion announces."""
    error = mean(seen.of_fitted(seen.measured))
    usual = np.fmax(np.hypot(seen.usual, mean(seen.of_fitted(seen.floors))), seen.usual)
    if not any(alarm.id == "extrapolation" for alarm in before) and error > criteria.held_out_ratio * usual:
        times = error / max(seen.cross_validated, SMALLEST_ERROR)
        return [
            Alarm(
                "held-out-error",
                "severe",
                f"The error on these logs is {times:.1f} times the cross-validated error "
                f"({error:.4f} and {seen.cross_validated:.4f} of the torque of the fitted logs).",
                "Do not trust the cross-validated error. Identify from logs like these, or with the URDF as prior.",
                (),
                times,
                criteria.held_out_ratio,
            )
        ]
    return []
