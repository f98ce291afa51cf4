"""Tests made at every identification and comparison, each with one sentence and one remedy.

A model can be wrong where nobody looked. The alarms look there:

- the fitted motion run twice as fast (q̇ × 2, q̈ × 4): where the logs alone and the logs with the URDF disagree about its
  torque, the logs do not determine the model;
- another log: the error to expect there is ``√(σ² + y C yᵀ)``, with the posterior covariance C, which holds the model's
  own error. Far above the error on the fitted logs, it means extrapolation; far below the error that was measured, it
  means that the robot or the sensors are not those of the fitted logs.

An alarm never changes a number. It says which numbers not to trust.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np

from frischid.core.text import listed, percent
from frischid.core.types import Array
from frischid.logs.cutoff_choice import LogSpectra

Severity = Literal["severe", "doubt"]


@dataclass(frozen=True)
class AlarmCriteria:
    """Every number that decides whether an alarm is raised.

    The experiment behind them: 26 pairs of measured logs of six robots (`benchmarks/trust.py`).

    Attributes
    ----------
    faster : float
        Factor on the speed of the fitted motion at which least squares and the fit with a prior are compared.
    disagreement : float
        Share of the torque's standard deviation (median joint) by which they may differ there. Logs that determine the
        model: at most 0.16. Logs that do not: 0.31 to 0.68.
    extrapolation : float
        Error to expect on a log over the cross-validated one, in N·m (N), beyond which the model may be wrong there.
        Twice the error is another error to a user; the measured error scatters by a third about the expected one
        (`benchmarks/trust_simulated.py`), so the alarm comes a little before.
    surprise : float
        Measured error over expected error of a joint. Ordinary pairs: at most 1.9; a tilted base or another day: 3.5 to
        7.6.
    held_out_ratio : float
        Held-out over cross-validated error, in N·m (N), for models without a prior, whose expected error is of noise
        alone.
    worse_than_urdf : float
        NRMSE over that of the URDF with fitted friction: less is no difference.
    above_noise : float
        NRMSE over the noise floor: below it the sensors' noise decides which model is better.
    outside_share : float
        Share of samples whose speed or acceleration is outside the fitted range.
    sign_errors : float
        Standard errors by which a parameter may contradict its sign.
    least_seconds : float
        s. Logs shorter than this hold too few stretches to leave one out.
    noisy_acceleration : float
        Share of the acceleration's power that is position noise (median joint) at the filter's cut-off.
    impossible_masses : float
        Factor by which the torque of a URDF's links is larger than that of commands only if the gains are wrong: the
        links of measured robots' URDFs are off by 2 at most. A gain per degree is 57 times too small.
    """

    faster: float = 2.0
    disagreement: float = 0.3
    extrapolation: float = 1.75
    surprise: float = 3.0
    held_out_ratio: float = 4.0
    worse_than_urdf: float = 1.1
    above_noise: float = 1.5
    outside_share: float = 0.3
    sign_errors: float = 2.0
    least_seconds: float = 4.0
    noisy_acceleration: float = 0.5
    impossible_masses: float = 5.0

    def to_dict(self) -> dict[str, float]:
        """Plain JSON values."""
        return asdict(self)


@dataclass(frozen=True)
class Alarm:
    """One reason not to trust a model, or an error, as it stands.

    Attributes
    ----------
    id : str
        Kind of alarm, the same for every robot.
    severity : {"severe", "doubt"}
        ``"severe"``: do not use the model for this. ``"doubt"``: read the sentence first.
    sentence : str
        What was found.
    remedy : str
        What to do.
    joints : tuple of str
        Where; empty for the whole robot.
    value, limit : float
        The figure that was compared, and the bound that it exceeded; ``value`` is None where there is no finite figure.

    Examples
    --------
    >>> from frischid.model.alarms import Alarm
    >>> print(Alarm("log-too-short", "doubt", "The logs last 2 s.", "Record longer.", (), 2.0, 4.0))
    The logs last 2 s. Record longer.
    """

    id: str
    severity: Severity
    sentence: str
    remedy: str
    joints: tuple[str, ...] = ()
    value: float | None = 0.0
    limit: float = 0.0

    def __str__(self) -> str:
        return f"{self.sentence} {self.remedy}"

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON values."""
        return asdict(self) | {"joints": list(self.joints)}

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> Alarm:
        """Inverse of `to_dict`."""
        return cls(**{**data, "joints": tuple(data["joints"])})


FAULTY_LOG = "faulty-log"
LEFT_OPEN = "log-leaves-open"
LOGS_DISAGREE = "logs-disagree"
LARGEST_PRINTED = 10.0
"""Standard deviations of the torque above which the text of an alarm gives no figure."""
CAUSES = (FAULTY_LOG, LOGS_DISAGREE, "log-too-short")
"""Alarms of the logs themselves: whatever else is wrong may follow from them, so they come first."""


def by_severity(alarms: Sequence[Alarm]) -> tuple[Alarm, ...]:
    """Alarms, the severe ones first, and of these the causes of the others."""
    return tuple(sorted(alarms, key=lambda alarm: (alarm.severity != "severe", alarm.id not in CAUSES)))


def undetermined(disagreement: Mapping[str, float], criteria: AlarmCriteria) -> list[Alarm]:
    """The logs alone do not determine the model.

    Parameters
    ----------
    disagreement : mapping of str to float
        Joint -> difference of the two fits' torques on the faster motion, over the torque's standard deviation.
    """
    middle = float(np.median([*disagreement.values()]))
    if middle <= criteria.disagreement:
        return []
    where = tuple(n for n, x in disagreement.items() if x > criteria.disagreement)
    # along directions that the logs hardly show, a fit without the URDF is as large as rounding lets it be
    apart = "more than ten times" if middle > LARGEST_PRINTED else f"{percent(middle)} of"
    return [
        Alarm(
            LEFT_OPEN,
            "severe",
            f"The logs do not determine the model: on the same motion at {criteria.faster:g} times the speed, a fit "
            f"without the URDF and the fit with the URDF differ by {apart} the torque's standard "
            "deviation (median joint). There the URDF decides, not the measurement.",
            "Trust the model only on motions like the fitted ones. Plan a motion that excites more (frischid excite), "
            "and record it.",
            where,
            middle,
            criteria.disagreement,
        )
    ]


def never_moving(joints: Sequence[str]) -> list[Alarm]:
    """Joints of which the fitted logs show no motion, or a torque that never changes."""
    if not joints:
        return []
    return [
        Alarm(
            "joint-without-motion",
            "doubt",
            f"{listed(joints)} never move{'s' * (len(joints) == 1)} in the fitted logs, or the torque there never "
            "changes: no error can be measured there, and the logs do not show the friction.",
            "Record a motion of all joints (frischid excite plans one).",
            tuple(joints),
            None,
        )
    ]


def too_short(seconds: float, criteria: AlarmCriteria) -> list[Alarm]:
    """The logs are too short for any error measured on them to mean much."""
    if seconds >= criteria.least_seconds:
        return []
    return [
        Alarm(
            "log-too-short",
            "severe",
            f"The logs last only {seconds:.1f} s in all: the cross-validated error says little.",
            "Record at least ten seconds, better a minute.",
            (),
            seconds,
            criteria.least_seconds,
        )
    ]


def noisy_cutoff(spectra: LogSpectra, cutoff: float | None, criteria: AlarmCriteria) -> list[Alarm]:
    """The filter lets position noise through that is as large as the acceleration.

    Parameters
    ----------
    spectra : LogSpectra
        Of the fitted logs.
    cutoff : float or None
        Hz.
    """
    middle = spectra.noise_share(cutoff)
    if not middle > criteria.noisy_acceleration:
        return []
    at = "no filter" if cutoff is None else f"a cut-off of {cutoff:g} Hz"
    return [
        Alarm(
            "cut-off-admits-noise",
            "severe",
            f"With {at}, {percent(middle)} of the acceleration's power is noise of the positions (median joint).",
            "Lower the cut-off (--cutoff, cutoff=), to a few times the motion's own frequencies.",
            (),
            middle,
            criteria.noisy_acceleration,
        )
    ]


def gains_from_masses(doubts: Mapping[str, float]) -> list[Alarm]:
    """Torques that are currents times gains which follow from the URDF's masses.

    Parameters
    ----------
    doubts : mapping of str to float
        Joint -> standard error of its torque per ampere, as a share of it.
    """
    if not doubts:
        return []
    known = {n: x for n, x in doubts.items() if x < 1.0}
    ends = dict.fromkeys(percent(x) for x in (min(known.values()), max(known.values()))) if known else ()
    least = f" (± {' to '.join(ends)})" if ends else ""
    unknown = [n for n in doubts if n not in known]
    more = f"; those of {', '.join(unknown)} are guessed" if unknown else ""
    return [
        Alarm(
            "gains-from-masses",
            "doubt",
            f"The torques are currents, times a torque per ampere that follows from the URDF's masses{least}{more}: "
            "relative errors and figures in amperes hold; masses and figures in N·m (N) are as doubtful as the gains.",
            "Find the gains with a weighed payload (frischid gains), and give them under [current_gain] in a mapping "
            "file.",
            tuple(doubts),
            max(doubts.values()),
            0.0,
        )
    ]


def doubtful_gains(
    joints: Sequence[str], found: tuple[Array, Array], known: tuple[Array, Array], criteria: AlarmCriteria
) -> list[Alarm]:
    """Torques that a controller with the given gains computes, but no such robot has.

    Parameters
    ----------
    joints : sequence of str
        The J joints.
    found : (ndarray, ndarray), shape (J,) each
        Largest computed torque, and its standard deviation, N·m (N).
    known : (ndarray, ndarray), shape (J,) each
        Largest torque of the drive by the URDF (infinite: not stated), and the standard deviation of the torque of the
        URDF's links along the same motion.
    """
    (largest, spread), (effort, links) = found, known
    times = largest / effort
    strong = [k for k in range(len(joints)) if times[k] > 1.0]
    weak = [k for k in range(len(joints)) if links[k] > criteria.impossible_masses * spread[k]]
    alarms = []
    if strong:
        k = max(strong, key=lambda k: times[k])
        alarms.append(
            Alarm(
                "gains-too-large",
                "doubt",
                f"With these gains the commands ask {joints[k]} for {largest[k]:.3g} N·m (N), {times[k]:.1f} times the "
                f"largest torque of its drive by the URDF ({effort[k]:.3g}).",
                "Check that kp is in N·m/rad and kd in N·m·s/rad, and that commands and positions have the same unit "
                "and sign; if the drive saturates, give its limit (--effort-limit).",
                tuple(joints[k] for k in strong),
                float(times[k]),
                1.0,
            )
        )
    if weak:
        k = max(weak, key=lambda k: links[k] / spread[k])
        share = f"{links[k] / spread[k]:.3g}" if spread[k] > 0 else "infinitely many"
        alarms.append(
            Alarm(
                "gains-too-small",
                "severe",
                f"With these gains the torque of {joints[k]} varies by {spread[k]:.3g} N·m (N), and moving the URDF's "
                f"links takes {share} times as much.",
                "Check that kp is in N·m/rad, not per degree or per count, and that the URDF's masses are in kg.",
                tuple(joints[k] for k in weak),
                float(links[k] / spread[k]) if spread[k] > 0 else None,
                criteria.impossible_masses,
            )
        )
    return alarms
