"""The whole pipeline: logs in, a model with bounds out.

    read_logs → form_moments → set_prior → fit_parameters → bound_parameters → assess

One cut-off filters torque and regressor, τ = Y θ becomes moments of [Y τ] over the base parameters, least squares gives
values and standard errors, the Frisch scheme gives bounds, and the last stage measures the model's error: by
cross-validation on the logs that were fitted, and on the logs held out. Where the residuals show that the torque is
late by less than sampling explains, all stages run again with the torque in time (`frischid.model.torque_lag`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Unpack

import numpy as np

from frischid.core.shown import Shown
from frischid.core.threads import on_one_thread
from frischid.effects import Effect
from frischid.errors import InputError
from frischid.estimators.bbrf import Recursion
from frischid.estimators.box_qp import Selection
from frischid.estimators.frisch import Box, Simplex
from frischid.logs.given import Logs, as_logs
from frischid.logs.mapping import MappingLike
from frischid.logs.summary import Data
from frischid.model.alarms import LEFT_OPEN, Alarm
from frischid.model.amperes import JointCurrents, in_amperes
from frischid.model.comparison import Comparison, compare
from frischid.model.headline import Headline, from_fit
from frischid.model.identification_alarms import fit_alarms, held_at_poses, unpredicted
from frischid.model.identification_bounds import bound_parameters
from frischid.model.identification_pass import LEAST_SPREAD, Folded, Measured, folded, measured
from frischid.model.identification_stages import (
    fit_parameters,
    form_moments,
    read_logs,
    set_prior,
)
from frischid.model.identify_options import IdentifyChoices, IdentifyOptions
from frischid.model.log_data import Journal, LogData
from frischid.model.log_examination import check_robot
from frischid.model.model import Model
from frischid.model.own_logs import log_entry
from frischid.model.speed_range import SpeedRange, speed_range
from frischid.model.torque_lag import TorqueLag, described, refused
from frischid.regression.base_parameters import Reduction
from frischid.robot.robot import Robot


@dataclass(frozen=True, eq=False)
class Identification(Shown):
    """Result of `identify`.

    Attributes
    ----------
    model : Model
    reduction : Reduction
        The identifiable parameters and combinations of parameters.
    simplex : Simplex or None
        The p + 1 least-squares solutions; None where the logs alone do not determine the parameters.
    recursion : Recursion or None
        BBRF; None when not asked for, or when the log is too short for two windows.
    selection : Selection or None
        The point chosen in the box, for the estimators ``"frisch"`` and ``"frisch_squared"``.
    headline : Headline or None
        The model's error: on the validation logs, or cross-validated without any; None where a joint's torque never
        changes.
    cross_validation : dict of str to float
        NRMSE of each joint on stretches of the identification logs that were left out of the fit; without joints that
        never move there.
    comparison : Comparison or None
        Errors on the validation logs.
    samples : int
        Number of fitted filtered samples.
    notes : tuple of str
        Changes of the data.
    warnings : tuple of str
        Reasons to doubt the result.
    amperes : tuple of JointCurrents
        Friction, rotor inertia and gravity in A of the joints whose logs hold currents and no torque.
    alarms : tuple of Alarm
        Of the fit, and of the model on the validation logs; most severe first.
    torque_lag : TorqueLag or None
        Lag of the torque behind the motion; None where the model has a delay of its own, or the logs are too short.
    speed_range : SpeedRange or None
        Speeds up to which the error is usual; None without a prior, and where the logs leave parameters open.

    Examples
    --------
    >>> import frischid as fr
    >>> robot = fr.Robot.load("planar2")
    >>> log = fr.simulate(robot, fr.random_fourier(robot, 5.0, seed=1), rate=100.0)
    >>> found = fr.identify(robot, [log], recursion="none")
    >>> sorted(found.cross_validation)
    ['joint1', 'joint2']
    >>> found.model.joints
    ('joint1', 'joint2')
    """

    model: Model
    reduction: Reduction
    simplex: Simplex | None
    recursion: Recursion | None
    selection: Selection | None
    headline: Headline | None
    cross_validation: dict[str, float]
    comparison: Comparison | None
    samples: int
    notes: tuple[str, ...]
    warnings: tuple[str, ...]
    alarms: tuple[Alarm, ...]
    amperes: tuple[JointCurrents, ...] = ()
    torque_lag: TorqueLag | None = None
    speed_range: SpeedRange | None = None

    def __repr__(self) -> str:
        error = "" if self.headline is None else f", NRMSE {self.headline.nrmse:.4f} {self.headline.where}"
        return f"Identification({self.model!r}{error}, warnings: {len(self.warnings)})"

    @property
    def narrowest_box(self) -> Box:
        """The narrowest box there is: BBRF's, or the one-shot Frisch box.

        Raises
        ------
        InputError
            The logs alone do not determine the parameters, so there are no Frisch bounds.
        """
        for kind in ("bbrf", "frisch"):
            if kind in self.model.bounds:
                return self.model.bounds[kind]
        raise InputError("the logs alone do not determine the parameters, so there are no Frisch bounds")


@on_one_thread
def identify(
    robot: Robot,
    logs: Logs,
    *,
    valid: Logs = (),
    effects: Sequence[Effect] | None = None,
    options: IdentifyOptions | None = None,
    progress: Callable[[str], None] = lambda _: None,
    mapping: MappingLike = None,
    **choices: Unpack[IdentifyChoices],
) -> Identification:
    """Identify a robot's dynamic parameters from logs.

    Parameters
    ----------
    robot : Robot
        Joints that some log does not hold are locked, and a note says so.
    logs : sequence of Log, Recording or data frame, or one data frame
        Logs to fit, each on its own; a `Recording` is read chunk by chunk and never held as a whole.
    valid : sequence of Log, Recording or data frame, or one data frame
        Logs to measure the error on.
    effects : sequence of Effect, optional
        Effects besides the rigid links. By default `BASELINE`, its friction smoothing (the speed over which dry
        friction changes its direction) chosen by cross-validation.
    options : IdentifyOptions, optional
        Options of the identification; the defaults of `IdentifyOptions` if not given.
    progress : callable
        Called with a few words at each stage.
    mapping : LogMap, mapping or path of a TOML file, optional
        Names and units of the columns of data frames.
    **choices
        Single fields of `IdentifyOptions`, which override `options`: ``torque_joints``, ``cutoff``, ``torque_lag``,
        ``velocity``, ``estimator``, ``prior``, ``recursion``, ``window``, ``reference``, ``force``, ``controller``,
        ``currents``, ``criteria``, ``prior_criteria``, ``alarm_criteria``.

    Returns
    -------
    Identification

    Raises
    ------
    InputError
        A log or an option is not usable.
    IdentifiabilityError
        The logs do not determine the parameters.
    EmptyBoxError
        The estimator takes a point of the box, and BBRF contradicted itself.

    Examples
    --------
    >>> import frischid as fr
    >>> robot = fr.Robot.load("planar2")
    >>> motions = [fr.random_fourier(robot, 5.0, seed=seed) for seed in (1, 2)]
    >>> logs = [fr.simulate(robot, motion, rate=100.0, noise=fr.Noise(tau=0.05)) for motion in motions]
    >>> found = fr.identify(robot, logs[:1], valid=logs[1:], recursion="none")
    >>> found.comparison.nrmse < 0.05
    True
    """
    check_robot(robot)
    logs, valid = as_logs(logs, robot.joints, mapping), as_logs(valid, robot.joints, mapping, "valid")
    settings = replace(options or IdentifyOptions(), **choices)
    found = measured(_folded(robot, logs, valid, effects, settings, Journal(progress)))
    lag = found.lag
    if settings.torque_lag == "auto" and lag is not None and lag.below_grain:
        progress(f"again, with a torque that is {1e3 * lag.lag:.3g} ms late")
        settings = replace(settings, torque_lag=lag.lag)
        again = measured(_folded(robot, logs, valid, effects, settings, Journal(progress)))
        found = again if _left_out(again) < _left_out(found) else _as_recorded(found, lag)
    motions = found.bounds.fit.problem.data.some_motions
    return assess(found, speed_range(found.model, motions, _left_out(found), settings.alarm_criteria))


def _left_out(found: Measured) -> float:
    """NRMSE on stretches that were left out of the fit, mean over the joints."""
    return float(np.mean(_nrmse(found)))


def _as_recorded(found: Measured, lag: TorqueLag) -> Measured:
    """The fit to the torque as recorded: a lag that raises the error on stretches left out is the model's error."""
    found.bounds.fit.problem.data.journal.notes.append(refused(lag))
    return replace(found, lag=replace(lag, significant=False))


def identify_again(robot: Robot, logs: Sequence[Data], effects: Sequence[Effect], options: IdentifyOptions) -> Folded:
    """The fit of `identify` to logs that were identified from before.

    `assess_again` makes its model with record, alarms and history.
    """
    return _folded(robot, logs, (), effects, options, Journal(lambda _: None))


def assess_again(found: Folded) -> Identification:
    """The rest of `identify`: the lag of the logs' torque is known already."""
    return assess(measured(found, with_lag=False))


def _folded(
    robot: Robot,
    logs: Sequence[Data],
    valid: Sequence[Data],
    effects: Sequence[Effect] | None,
    options: IdentifyOptions,
    journal: Journal,
) -> Folded:
    """Stages 1 to 5, and the fits of the cross-validation."""
    problem = form_moments(read_logs(robot, logs, valid, options, journal), effects)
    return folded(bound_parameters(fit_parameters(set_prior(problem))))


def assess(found: Measured, speeds: SpeedRange | None = None) -> Identification:
    """Stage 6: the model, its error on stretches and logs that were left out, and its history."""
    bounds, model, there = found.bounds, found.model, found.there
    problem, data = bounds.fit.problem, bounds.fit.problem.data
    still = () if there is None else there.not_compared
    cross_validation = _by_joint(found)
    before = fit_alarms(bounds.fit, model, still, cross_validation, there)
    speeds = None if any(alarm.id == LEFT_OPEN for alarm in before) else speeds
    own = None if there is None else from_fit(there, _rms(found), before)
    event = _event(data, problem.effects, cross_validation, own)
    comparison = compare(replace(model, history=(event,)), data.valid) if data.valid else None
    headline = own if comparison is None else Headline.of(comparison, "test", before)
    bad, notes, warnings = _remarks(found, cross_validation)
    if comparison is not None and headline is not None:
        event |= {"test": headline.to_dict(), "test_logs": [log_entry(log) for log in data.valid]}
    event |= {"notes": list(notes), "warnings": list(warnings)} | ({"unpredicted": bad} if bad else {})
    event |= {} if found.lag is None else {"torque_lag": found.lag.to_dict()}
    event |= {} if speeds is None else {"speed_range": speeds._asdict()}
    if model.prior is not None:
        kept = model.prior.to_dict()
        event["prior"] = {key: kept[key] for key in ("kind", "rows", "scales")}
    event["criteria"] = data.options.criteria_used
    return Identification(
        model=replace(model, history=(event,)),
        reduction=problem.reduction,
        simplex=bounds.simplex,
        recursion=bounds.recursion,
        selection=bounds.selection,
        headline=headline,
        cross_validation=cross_validation,
        comparison=comparison,
        samples=int(problem.whole.counts.max()),
        notes=notes,
        warnings=warnings,
        alarms=before if headline is None else headline.alarms,
        amperes=in_amperes(model, data.motions),
        torque_lag=found.lag,
        speed_range=speeds,
    )


def _remarks(found: Measured, errors: Mapping[str, float]) -> tuple[list[str], tuple[str, ...], tuple[str, ...]]:
    """Joints that are hardly predicted, the notes and the warnings; `errors` are the cross-validated ones."""
    data, there, lag = found.bounds.fit.problem.data, found.there, found.lag
    journal, limit = data.journal, data.options.criteria.unexplained_nrmse
    held = [] if there is None or there.poses != there.samples else [held_at_poses(there)]
    bad = [] if held else [name for name, x in errors.items() if x > limit]
    late = [] if lag is None or not lag.warning else [lag.warning]
    warnings = [*unpredicted(bad, limit, journal.explained), *late, *journal.warnings]
    notes = [*journal.notes, *held, *described(lag)]
    return bad, tuple(dict.fromkeys(notes)), tuple(dict.fromkeys(warnings))


def _event(
    data: LogData, effects: Sequence[Effect], errors: Mapping[str, float], own: Headline | None
) -> dict[str, Any]:
    """Entry of the model's history; the mean of the joints' errors where they make no headline."""
    logs = [log_entry(log, count) for log, count in zip(data.logs, data.summary.samples, strict=True)]
    event: dict[str, Any] = {"action": "identify", "effects": [str(e) for e in effects], "logs": logs}
    return event | (
        {"error_after": float(np.mean(list(errors.values())))} if own is None else {"cross_validated": own.to_dict()}
    )


def _rms(found: Measured) -> dict[str, float]:
    """Joint -> rms error on stretches left out of the fit, N·m (N)."""
    return dict(zip(found.bounds.fit.problem.data.joints, np.sqrt(found.variance).tolist(), strict=True))


def _by_joint(found: Measured) -> dict[str, float]:
    """Joint -> error on stretches left out of the fit; without the joints that never move."""
    still = () if found.there is None else found.there.not_compared
    pairs = zip(found.bounds.fit.problem.data.joints, _nrmse(found), strict=True)
    return {name: x for name, x in pairs if name not in still}


def _nrmse(found: Measured) -> list[float]:
    """Error of each joint on stretches left out of the fit, over the standard deviation of its measured torque."""
    spread = np.maximum(found.spread, LEAST_SPREAD)
    return [float(x) for x in np.sqrt(found.variance) / spread]
