"""The headline: the one error of a model that every surface prints.

    NRMSE = (1/J) Σ_j rms(τ_j − τ̂_j) / std(τ_j)

over the samples in which joint j moves. The error is measured on *test* logs, to which the model was not fitted.
Without a test log it is *cross-validated* on the model's own logs: every stretch is predicted by a fit to the others.
Three references stand beside it, on the same logs: the error that the sensors' noise alone would make, the URDF's links
with fitted friction, and a constant torque.

The alarms of the model and of these logs go with the error: whoever prints the one prints the others.

A *grade* (`frischid.model.grade`) places the error between the first two references. A model with a severe alarm has no
grade, because the error may be another one on the next motion.

All other errors (with standstill, of single joints, of a search for missing effects) explain this one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal

import msgspec
import numpy as np

from frischid.core.text import listed
from frischid.errors import InputError
from frischid.logs.given import Logs, as_logs
from frischid.logs.mapping import MappingLike
from frischid.model.alarms import Alarm, by_severity
from frischid.model.comparison import Comparison, compare
from frischid.model.events import measured_on, selection_errors
from frischid.model.grade import graded
from frischid.model.model import Model
from frischid.model.model_argument import check_model

Measured = Literal["test", "cross-validated", "fitted"]

_WHERE = {
    "test": "on logs it was not fitted to",
    "cross-validated": "cross-validated on its own logs",
    "fitted": "on the logs it was fitted to",
}


@dataclass(frozen=True)
class Headline:
    """A model's error with its three references; each a mean NRMSE over the joints.

    Attributes
    ----------
    nrmse : float
        The rms error over the standard deviation of the measured torque, mean over the joints.
    measured : {"test", "cross-validated", "fitted"}
        ``"fitted"``: on the logs the model was fitted to, where nobody cross-validated it. This error is too small.
    noise_floor, urdf_nrmse, constant_nrmse : float
        Of the sensors' noise alone, of the URDF's links with fitted friction, and of a constant torque.
    logs : tuple of str
        The logs it is measured on.
    joints : dict of str to float
        NRMSE of each joint.
    alarms : tuple of Alarm
        Of the fit, and of the model on test logs; the severe ones first.

    Examples
    --------
    >>> from frischid.model.headline import Headline
    >>> print(Headline(0.05, "test", 0.01, 0.2, 1.0, ("motion B",), {"elbow": 0.05}))
    NRMSE 0.0500 on logs it was not fitted to (sensors alone 0.0100, URDF with fitted friction 0.2000, constant torque
    1.0000)
    """

    nrmse: float
    measured: Measured
    noise_floor: float
    urdf_nrmse: float
    constant_nrmse: float
    logs: tuple[str, ...]
    joints: dict[str, float]
    alarms: tuple[Alarm, ...] = ()

    def __str__(self) -> str:
        return f"NRMSE {self.nrmse:.4f} {self.where} ({self.references})"

    @property
    def where(self) -> str:
        """The logs on which the error is measured, in words."""
        return _WHERE[self.measured]

    @property
    def references(self) -> str:
        """The three references, in words."""
        return (
            f"sensors alone {self.noise_floor:.4f}, URDF with fitted friction {self.urdf_nrmse:.4f}, constant torque "
            f"{self.constant_nrmse:.4f}"
        )

    @property
    def grade(self) -> str:
        """A to F (`frischid.model.grade`), or ``–`` where a severe alarm stands."""
        return "–" if self._is_alarmed else self._graded[0]

    @property
    def grade_in_words(self) -> str:
        """The grade's meaning: the error as a multiple of the reference's, and of the sensors' noise."""
        if self._is_alarmed:
            return "no grade: an alarm says not to rely on this model as it is"
        return self._graded[1]

    @property
    def _is_alarmed(self) -> bool:
        return any(alarm.severity == "severe" for alarm in self.alarms)

    @property
    def _graded(self) -> tuple[str, str]:
        return graded(self.nrmse, self.noise_floor, self.urdf_nrmse, self.constant_nrmse)

    @property
    def worst(self) -> str:
        """Name of the joint with the largest error."""
        return max(self.joints, key=lambda name: self.joints[name])

    def with_alarms(self, alarms: Sequence[Alarm]) -> Headline:
        """The same with further alarms; of an alarm that stands here too, the one here stays.

        Parameters
        ----------
        alarms : sequence of Alarm
        """
        here = {alarm.id for alarm in self.alarms}
        return replace(self, alarms=by_severity([*self.alarms, *(alarm for alarm in alarms if alarm.id not in here)]))

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON values."""
        return asdict(self) | {
            "grade": self.grade,
            "logs": list(self.logs),
            "alarms": [alarm.to_dict() for alarm in self.alarms],
        }

    @classmethod
    def of(cls, comparison: Comparison, measured: Measured, alarms: Sequence[Alarm] = ()) -> Headline:
        """The headline of a comparison.

        Parameters
        ----------
        comparison : Comparison
        measured : {"test", "fitted"}
        alarms : sequence of Alarm
            Of the fit.
        """
        found = cls(
            comparison.nrmse,
            measured,
            comparison.noise_floor,
            comparison.nominal,
            comparison.constant,
            comparison.sources,
            {name: joint.nrmse for name, joint in comparison.joints.items()},
            by_severity(comparison.alarms),
        )
        return found.with_alarms(alarms)


def headline(
    model: Model,
    logs: Logs = (),
    comparison: Comparison | None = None,
    *,
    mapping: MappingLike = None,
) -> Headline:
    """The error of a model: on those logs that it was not fitted to; without such a log, cross-validated.

    Of a model with the torque of some joints alone (``--torque-joints``), it is the error of these joints.

    Parameters
    ----------
    model : Model
    logs : sequence of Log, Recording or data frame, or one data frame
        Of the model's own logs, which are those it was fitted to, none is needed.
    comparison : Comparison, optional
        ``compare(model, logs)``, where the caller has it already.
    mapping : LogMap, mapping or path of a TOML file, optional
        Names and units of the columns of data frames.

    Returns
    -------
    Headline

    Raises
    ------
    InputError
        No log is given, and the model's file holds no cross-validated error of its joints alone; or the file is damaged
        there.

    Examples
    --------
    >>> import frischid as fr
    >>> robot = fr.Robot.load("planar2")
    >>> motions = [fr.random_fourier(robot, 5.0, seed=seed) for seed in (1, 2)]
    >>> logs = [fr.simulate(robot, motion, rate=100.0, noise=fr.Noise(tau=0.05)) for motion in motions]
    >>> model = fr.identify(robot, logs[:1], recursion="none").model
    >>> fr.headline(model, logs).nrmse == fr.compare(model, logs[1:]).nrmse
    True
    >>> fr.headline(model).measured
    'cross-validated'
    """
    check_model(model)
    logs = as_logs(logs, model.robot.joints, mapping)
    test = [log for log in logs if not model.made_from(log)]
    known, alarms = cross_validated(model.history[-1]) if model.history else None, alarms_of_fit(model.history)
    if test:
        whole = comparison is not None and len(test) == len(logs)
        here = comparison if whole and comparison is not None else compare(model, test)
        return Headline.of(here, "test", alarms)
    if known is not None and known.joints.keys() <= set(model.joints):
        return known
    if not logs:
        some = "" if known is None else f" of {listed(model.joints)} alone"
        raise InputError(f"the model's file holds no cross-validated error{some}; give a log to measure the error on")
    here = comparison or compare(model, logs)
    if known is not None and known.joints.keys() >= here.joints.keys():  # of more joints: the references are not theirs
        return from_fit(here, {name: known.joints[name] * joint.std for name, joint in here.joints.items()}, alarms)
    return Headline.of(here, "fitted", alarms)


def alarms_of_fit(history: Sequence[Mapping[str, Any]]) -> tuple[Alarm, ...]:
    """The alarms of a model whatever the logs: those of its last fit, or of a later step that states its own.

    Parameters
    ----------
    history : sequence of mapping
        `Model.history`.

    Raises
    ------
    InputError
        The history was changed by hand, and is wrong.
    """
    for event in reversed(history):
        if "alarms" in event:
            alarms: tuple[Alarm, ...] = _converted(event, "alarms", tuple[Alarm, ...])
            return alarms
        known = cross_validated(event)
        if known is not None:
            return known.alarms
    return ()


def cross_validated(event: Mapping[str, Any]) -> Headline | None:
    """The cross-validated headline in an event of a model's history; None where there is none.

    Raises
    ------
    InputError
        The event was changed by hand, and is wrong.
    """
    return _read(event, "cross_validated")


def headline_of(event: Mapping[str, Any]) -> Headline | None:
    """The headline of the model after an event of its history: on the event's test logs, where there were any.

    The alarms of the event's fit stand beside those of the test.

    Raises
    ------
    InputError
        The event was changed by hand, and is wrong.
    """
    test, own = _read(event, "test"), cross_validated(event)
    return own if test is None else test.with_alarms(() if own is None else own.alarms)


def error_after(event: Mapping[str, Any]) -> tuple[float, str] | None:
    """The model's one error after an event, NRMSE, and what it is measured on; None where nobody measured it."""
    found = headline_of(event)
    if found is not None:
        return found.nrmse, found.where
    selected = selection_errors(event)[1]
    return None if selected is None else (float(selected), measured_on(event))


def _read(event: Mapping[str, Any], key: str) -> Headline | None:
    if key not in event:
        return None
    found: Headline = _converted(event, key, Headline)
    if not found.joints:
        raise InputError(f"the model file is damaged: expected the error of each joint - at `history[].{key}.joints`")
    return found


def _converted(event: Mapping[str, Any], key: str, kind: Any) -> Any:
    try:
        return msgspec.convert(event[key], kind)
    except msgspec.ValidationError as error:
        raise InputError(f"the model file is damaged: {error} - in `history[].{key}`") from None


def from_fit(comparison: Comparison, rms: Mapping[str, float], alarms: Sequence[Alarm] = ()) -> Headline:
    """The cross-validated headline of a fit.

    Parameters
    ----------
    comparison : Comparison
        Of the model with the logs it was fitted to.
    rms : mapping of str to float
        Cross-validated rms error of each joint, N·m (N); those of joints that are not compared are not used.
    alarms : sequence of Alarm
        Of the fit.
    """
    errors = {name: float(rms[name]) / joint.std for name, joint in comparison.joints.items()}
    nrmse = float(np.mean(list(errors.values())))
    plain = Headline.of(comparison, "fitted")
    return replace(plain, nrmse=nrmse, measured="cross-validated", joints=errors, alarms=by_severity(alarms))
