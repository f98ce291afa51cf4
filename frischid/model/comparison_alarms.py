"""Alarms of a model on logs that it was not fitted to.

The error to expect there is ``√(σ² + y C yᵀ)`` (`frischid.model.expected_error`), with the posterior covariance C. Far
above the error on the fitted logs, it means extrapolation. Far below the error that was measured, it means that the
robot or the sensors are not those of the fitted logs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from frischid.core.text import listed
from frischid.core.types import Array
from frischid.model.alarms import Alarm, AlarmCriteria

SMALLEST_ERROR = 1e-12
"""Share of the torque's standard deviation that rounding leaves of a perfect model; a smaller error is none."""


@dataclass(frozen=True, eq=False)
class Elsewhere:
    """A model on logs that it was not fitted to.

    Attributes
    ----------
    joints : tuple of str
    spread : ndarray, shape (J,)
        Standard deviation of the torque on these logs, N·m (N).
    held : ndarray, shape (J,)
        Torque with which dry friction may hold the joint where the arm stands still, rms, N·m (N).
    expected, measured : ndarray, shape (J,)
        Root mean square error on these logs: to be expected from the model's uncertainty (NaN for a model without a
        prior, whose uncertainty is of noise alone), and measured, N·m (N).
    floors : ndarray, shape (J,)
        Error that the sensors' noise alone causes, N·m (N).
    outside : ndarray, shape (J,)
        Share of samples whose speed or acceleration the fitted logs do not reach.
    nrmse, noise_floor : float
        Mean NRMSE on these logs, and of the sensors' noise alone.
    cross_validated : float
        Mean NRMSE, cross-validated on the fitted logs; NaN if unknown.
    urdf : float
        Mean NRMSE of the URDF with fitted friction on these logs; NaN if unknown.
    """

    joints: tuple[str, ...]
    spread: Array
    held: Array
    expected: Array
    measured: Array
    floors: Array
    outside: Array
    nrmse: float
    noise_floor: float
    cross_validated: float
    urdf: float

    @property
    def usual(self) -> float:
        """Error to take for usual here: the cross-validated one, and at poses also the dry friction that may hold."""
        return float(np.hypot(self.cross_validated, np.mean(self.held / np.maximum(self.spread, 1e-300))))


def elsewhere(seen: Elsewhere, criteria: AlarmCriteria) -> list[Alarm]:
    """Alarms of a model on logs that it was not fitted to."""
    found = [*_extrapolation(seen, criteria), *_surprise(seen, criteria), *_useless(seen, criteria)]
    if seen.nrmse > max(criteria.worse_than_urdf * seen.urdf, criteria.above_noise * seen.noise_floor):
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


def _extrapolation(seen: Elsewhere, criteria: AlarmCriteria) -> list[Alarm]:
    found = []
    share = seen.expected / np.maximum(seen.spread, 1e-300)
    ratio = float(np.mean(share)) / max(seen.usual, 1e-300)
    if ratio > criteria.extrapolation:
        found.append(
            Alarm(
                "extrapolation",
                # The torque was measured here: an error that did not come makes the warning a doubt.
                "severe" if seen.nrmse > criteria.extrapolation * seen.usual else "doubt",
                "The motion of these logs goes beyond the motion of the fitted logs: the expected error here is "
                f"{ratio:.1f} times the cross-validated error.",
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
                f"{wide:.0%} of the samples are faster, or accelerate more, than any fitted sample (median joint).",
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
            f"{float(share[bad].max()):.2f}; a constant torque has 1).",
            f"Do not use the model for {those}. Run frischid diagnose: an effect on {those} may be missing.",
            where,
            float(share[bad].max()),
            1.0,
        )
    ]


def _surprise(seen: Elsewhere, criteria: AlarmCriteria) -> list[Alarm]:
    ratio = seen.measured / np.maximum(np.hypot(seen.expected, seen.held), 1e-300)
    where = tuple(n for n, x in zip(seen.joints, ratio, strict=True) if x > criteria.surprise)
    if where:
        return [
            Alarm(
                "unlike-the-fitted-logs",
                "severe",
                f"The error on {', '.join(where)} is {float(ratio.max()):.1f} times the error that the "
                "uncertainty of the model explains. Either the robot, its base, its load or its sensors have "
                "changed, or these logs show an effect that the fitted logs hardly show.",
                "Run frischid diagnose on these logs to find the change or the effect.",
                where,
                float(ratio.max()),
                criteria.surprise,
            )
        ]
    if seen.nrmse > criteria.held_out_ratio * seen.usual:
        times = seen.nrmse / max(seen.cross_validated, SMALLEST_ERROR)
        return [
            Alarm(
                "held-out-error",
                "severe",
                f"The error on these logs is {times:.1f} times the cross-validated error "
                f"({seen.nrmse:.4f} and {seen.cross_validated:.4f}).",
                "Do not trust the cross-validated error. Identify from logs like these, or with the URDF as prior.",
                (),
                times,
                criteria.held_out_ratio,
            )
        ]
    return []
