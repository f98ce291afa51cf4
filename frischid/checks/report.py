"""All checks of one log. A fault that an early check finds can make the later checks meaningless."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cache

import numpy as np

from frischid.checks.channels import check_channels, check_jumps
from frischid.checks.check_criteria import DEFAULT_CRITERIA, CheckCriteria
from frischid.checks.clock import check_clock
from frischid.checks.degrees import check_degrees, check_millimetres, explained_in_radians, implausible_motion
from frischid.checks.excitation import FreeFit, check_excitation, free_fit
from frischid.checks.lag import check_lag
from frischid.checks.log_issue import LogReport, Notebook, span
from frischid.checks.physics import check_physics
from frischid.checks.sketch import Sketch
from frischid.checks.standing import check_pushes, check_standing
from frischid.checks.unsigned import check_unsigned
from frischid.checks.velocity import check_velocity
from frischid.core.types import Array
from frischid.errors import InputError
from frischid.logs.cutoff_choice import choose_lowpass
from frischid.logs.filters import LowPass
from frischid.logs.log import Log
from frischid.logs.poses import is_static
from frischid.logs.preprocessing import Motion, prepare
from frischid.logs.time_grid import even_times
from frischid.logs.wraps import degree_wraps_of, unwrapped, wraps_of
from frischid.regression.base_parameters import Reduction
from frischid.robot.robot import Robot

_USELESS_TORQUE = {"dead band", "dead torque", "no torque", "saturated torque"}
"""Issues that make a joint's torque useless for the checks of the physics."""


def inspect(
    robot: Robot,
    log: Log,
    reduction: Callable[[], Reduction],
    *,
    alone: bool = True,
    prepared: tuple[LowPass, Sequence[Motion]] | None = None,
    criteria: CheckCriteria = DEFAULT_CRITERIA,
) -> LogReport:
    """Run all checks on a log: its issues and its figures.

    Parameters
    ----------
    robot : Robot
        The robot whose joints are in the log.
    reduction : callable
        Returns the base parameters of the robot with the baseline effects (`frischid.model.identification.structure`);
        called only if needed.
    alone : bool
        Whether no other log helps to identify the robot.
    prepared : LowPass and sequence of Motion, optional
        The log, if it is prepared already. Figures that no issue needs are then left out.
    criteria : CheckCriteria
        The numbers that decide.

    Examples
    --------
    >>> import frischid as fr
    >>> from dataclasses import replace
    >>> from frischid.checks import inspect
    >>> robot = fr.Robot.load("planar2")
    >>> log = fr.simulate(robot, fr.random_fourier(robot, 5.0, seed=1), rate=100.0)
    >>> report = inspect(robot, replace(log, t=1e3 * log.t), lambda: None)
    >>> [(issue.kind, issue.blocks) for issue in report.issues]
    [('unit of time', True)]
    """
    log, brief = log.select(robot.joints), prepared is not None
    notes = Notebook(robot.joints, criteria)
    if (wraps := wraps_of(log.q)).any():
        what = f"the angle jumps by a whole turn {span(wraps[wraps > 0].astype(float))} times, where it wraps"
        advice = "nothing to do: frischid makes such angles continuous when it reads them"
        notes.add("wrapped angle", what, notes.which(wraps > 0), "certain", advice)
        log = unwrapped(log, _middle(robot))
    if (full_turns := degree_wraps_of(log.q) > 0).any():
        log = replace(log, q=np.rad2deg(unwrapped(replace(log, q=np.deg2rad(log.q)), _middle(robot)).q))
    _note_other_channels(log, notes)
    if check_jumps(log, notes) or check_millimetres(robot, log, notes):
        return notes.report(log.source)
    still = is_static(log)
    check_clock(log, notes, still=still)
    check_channels(log, notes, figures=not brief, still=still)
    check_unsigned(log, notes)
    check_pushes(log, notes)
    if still:
        check_standing(log, notes)
        return notes.report(log.source)
    if any(f.blocks for f in notes.issues):
        return notes.report(log.source)
    if notes.facts.get("stamps_follow", 1.0) < criteria.untrusted_slope:
        # Stamps of arrival are worse than even ones: the later checks use the mean step between gaps.
        log, prepared = replace(log, t=even_times(log.t, criteria.position_window)), None
    lowpass = choose_lowpass([log], robot.joints) if prepared is None else prepared[0]
    coarse = LowPass(min(lowpass.cutoff or criteria.sketch_cutoff, criteria.sketch_cutoff))
    check_velocity(log, coarse, notes)

    @cache
    def sketch() -> Sketch | None:
        with suppress(InputError):  # `identify` refuses a log that is too short for the filters
            motions = prepare(log, coarse).motions if prepared is None else prepared[1]
            notes.per_joint("standstill", np.concatenate([m.standstill for m in motions]).mean(axis=0))
            return Sketch.of(robot, motions, coarse, _rows(log, notes), criteria)
        return None

    degrees = None if _has(notes, "degrees") else implausible_motion(robot, log, notes, full_turns)
    if degrees is not None and not full_turns.any() and explained_in_radians(degrees, sketch):
        degrees = None
    surely = degrees is not None and degrees.certain
    if not surely and not any(f.blocks for f in notes.issues) and (seen := sketch()) is not None:
        _dynamics(log, seen, reduction, notes, alone, brief)
    if degrees is not None and not _has(notes, "degrees"):  # the torques may have told it
        check_degrees(degrees, sketch, notes)
    return notes.report(log.source)


def _note_other_channels(log: Log, notes: Notebook) -> None:
    """Report a log without torques, whose currents or commands become torques later."""
    if log.tau is not None:
        return
    if log.current is not None:
        what = (
            "the log has currents and no torques: the clock, positions, velocities and currents are checked, the "
            "torques against the URDF are not"
        )
        advice = (
            "identify takes this log in amperes; for N·m, give the torque per ampere under [current_gain] in a mapping "
            "file: frischid gains finds it from logs with and without a known payload"
        )
        notes.add("currents only", what, (), "certain", advice)
    elif log.qcmd is not None:
        what = (
            "the log has commanded positions and no torques: the clock, positions and velocities are checked, the "
            "torques against the URDF are not"
        )
        advice = "name the controller that turns commands into torque: --controller pd --kp ... --kd ..."
        notes.add("commands only", what, (), "certain", advice)


def _middle(robot: Robot) -> Array:
    """The middle between the limits of each joint, (J,); 0 for a joint without limits."""
    low, high = robot.limits.lower, robot.limits.upper
    limited = np.isfinite(low) & np.isfinite(high)
    return np.asarray((np.where(limited, low, 0.0) + np.where(limited, high, 0.0)) / 2)


def _has(notes: Notebook, kind: str) -> bool:
    """Whether an issue of this kind is noted."""
    return any(issue.kind == kind for issue in notes.issues)


def _rows(log: Log, notes: Notebook) -> list[str]:
    """Joints whose torque the checks of the physics can use."""
    dead = {name for f in notes.issues if f.kind in _USELESS_TORQUE for name in f.where}
    return [n for n, yes in zip(log.joints, log.has("tau"), strict=True) if yes and n not in dead]


def _dynamics(
    log: Log, sketch: Sketch, reduction: Callable[[], Reduction], notes: Notebook, alone: bool, brief: bool
) -> None:
    if len(sketch.rows) == 0 or len(sketch) < notes.criteria.fewest_samples:
        return

    @cache
    def structure() -> Reduction:
        return reduction()

    @cache
    def fit(seen: Sketch) -> FreeFit | None:
        return free_fit(seen, structure())

    def free(seen: Sketch) -> Array:
        found = fit(seen)
        return np.full(len(seen.rows), np.nan) if found is None else found.errors

    corrected = check_physics(sketch, free, notes)
    check_lag(corrected, notes)
    if brief:
        return
    for label, values in (
        ("nominal_nrmse", sketch.asis),
        ("friction_nrmse", sketch.without),
        ("free_nrmse", free(sketch)),
    ):
        whole = np.full(len(log.joints), np.nan)
        whole[sketch.rows] = values
        notes.per_joint(label, whole)
    check_excitation(sketch, structure(), fit(sketch), notes, alone=alone)
