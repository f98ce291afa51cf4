"""Checks of logs before they are fitted: whether they can be used with a robot, and suspicious findings.

The checks themselves are in `frischid.checks`; this module applies them to the logs of an identification.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from frischid.checks import LogIssue, LogReport, inspect
from frischid.checks.long_log import examine_long, is_long
from frischid.core.remembered import Remembered
from frischid.effects import BASELINE
from frischid.errors import InputError
from frischid.logs.controller import PDController
from frischid.logs.current_gains import CurrentGains
from frischid.logs.cutoff_choice import choose_lowpass
from frischid.logs.driven import driven
from frischid.logs.filters import HIGHEST_CUTOFF, LowPass
from frischid.logs.given import Logs, as_logs
from frischid.logs.locked_joints import LockedMotion, lock_there, places_of, remedy, spans_of
from frischid.logs.log import Log
from frischid.logs.mapping import MappingLike
from frischid.logs.preprocessing import Motion, prepare
from frischid.logs.recording import brief, chunks_of, moving_part, preview_of
from frischid.logs.summary import Data, check_usable, held_by
from frischid.model.identify_options import Cutoff, IdentifyOptions
from frischid.model.model_parts import robot_text
from frischid.model.unknown_drive import known_controller
from frischid.regression.base_parameters import Reduction
from frischid.regression.regressor import Regressor
from frischid.regression.structure import structure
from frischid.robot.robot import Robot
from frischid.robot.urdf_doubts import urdf_doubts

_REPORTS = Remembered[LogReport]()  # of logs, by the robot and the way in which the log was prepared


def check(
    robot: Robot,
    logs: Logs,
    *,
    controller: PDController | None = None,
    currents: CurrentGains | None = None,
    torque_joints: Sequence[str] | None = None,
    mapping: MappingLike = None,
    progress: Callable[[str], None] = lambda _: None,
) -> list[LogReport]:
    """Check that logs can be used with a robot, and report suspicious findings.

    Parameters
    ----------
    robot : Robot
    logs : sequence of Log, Recording or data frame, or one data frame
        A long one is examined piece by piece: see `frischid.checks.long_log`.
    controller : PDController, optional
        Makes the torque of logs that hold commanded positions and no torque.
    currents : CurrentGains, optional
        Torque per ampere, or per volt, of joints whose logs hold such a signal and no torque.
    torque_joints : sequence of str, optional
        Joints whose torque is judged, all by default; the others only move.
    mapping : LogMap, mapping or path of a TOML file, optional
        Names and units of the columns of data frames.
    progress : callable
        Called with the number of each log.

    Returns
    -------
    list of LogReport
        One per log.

    Raises
    ------
    InputError
        A log cannot be used at all.

    Examples
    --------
    >>> import frischid as fr
    >>> robot = fr.Robot.load("planar2")
    >>> log = fr.simulate(robot, fr.random_fourier(robot, 20, seed=1), rate=100, noise=fr.Noise(q=1e-5, tau=0.01))
    >>> (report,) = fr.check(robot, [log])
    >>> report.issues
    ()
    """
    check_robot(robot)
    logs = as_logs(logs, robot.joints, mapping)
    if controller is not None:
        controller.check_joints((*robot.joints, *robot.locked))
    found: list[str] = []
    logs = driven(logs, known_controller(robot, logs, IdentifyOptions(controller=controller), found), currents)
    robot, locked = held_by(robot, logs)
    locked += found
    absent = {n: head.source for head in map(preview_of, logs[::-1]) for n in robot.locked if n not in head.joints}

    @cache
    def reduction() -> Reduction:
        return structure(Regressor(robot, BASELINE), robot.joints)

    rows = tuple(robot.joints if torque_joints is None else torque_joints)
    if left := [n for n in robot.joints if n not in rows]:
        locked += [f"torque not judged: {', '.join(left)}"]
    reports = []
    for k, log in enumerate(logs, 1):
        progress(f"checking log {k} of {len(logs)}")
        reports.append(_checked(robot, log, reduction, locked, rows, absent, alone=len(logs) == 1))
    return reports


def check_robot(robot: Any) -> None:
    """Refuse what is no robot, such as its name.

    Raises
    ------
    InputError
        `robot` is no `Robot`.
    """
    if not isinstance(robot, Robot):
        raise InputError(f"robot must be a frischid.Robot, got {robot!r}: robot=frischid.Robot.load(path or name)")


def _checked(
    robot: Robot,
    log: Data,
    reduction: Callable[[], Reduction],
    locked: Sequence[str],
    rows: Sequence[str],
    absent: Mapping[str, str],
    *,
    alone: bool,
) -> LogReport:
    """The report on one log, with notes on what is done to it before a fit; an error if no part of it can be used."""
    said: list[str] = []
    faults: list[InputError | None] = []
    motion = LockedMotion(robot)

    def examine(part: Log) -> LogReport:
        motion.see(part)
        part = _with_torque_of(part, rows)
        faults.append(_fault(robot, part, whole=not is_long(log)))
        if faults[-1] is not None and not is_long(log):
            raise faults[-1]
        report = inspect(robot, part.select(robot.joints), reduction, alone=alone)
        wanted = tuple(x for x in report.issues if x.kind != "no torque" or set(x.where) & set(rows))
        report = replace(report, issues=wanted)  # torques that nobody wants judged are not missing
        said.extend(part.notes)
        if not report.blocked and len(faults) == 1:  # of a long log, the notes on its beginning
            with suppress(InputError):  # `identify` refuses a log that is too short for the filters
                lowpass = choose_lowpass([part], robot.joints)
                said.extend(prepare(part.select(robot.joints), lowpass, velocity="derived").notes)
        return report

    report = examine_long(log, robot.joints, examine) if is_long(log) else examine(next(chunks_of(log)))
    if all(faults) and faults[0] is not None:
        raise faults[0]
    if moving := motion.moving:
        what = f"locked but moving in the log: {spans_of(moving)}"
        report = report.with_issue(LogIssue("locked joint moves", what, (), "certain", remedy(moving, absent)))
    if off := motion.elsewhere:
        report = report.with_issue(LogIssue("locked joint elsewhere", places_of(off), (), "certain", lock_there(off)))
    doubts = [f"{robot.source}, {doubt}" for doubt in urdf_doubts(robot.urdf)]
    notes = [*doubts, *locked, *(brief(said, log.source) if is_long(log) else said)]
    return replace(report, facts={**report.facts, "joints": list(robot.joints), "notes": notes})


def _with_torque_of(log: Log, joints: Sequence[str]) -> Log:
    """The log without the torques of other joints."""
    if log.tau is None or set(log.joints) <= set(joints):
        return log
    judged = np.array([n in joints for n in log.joints])
    return replace(log, tau=np.where(judged, log.tau, np.nan), sha256=log.identity)


def _fault(robot: Robot, log: Log, *, whole: bool) -> InputError | None:
    """Why a log, or a piece of a longer one (not `whole`), cannot be used; None where it can."""
    chosen = log.select(robot.joints)
    with_torque = [n for n in robot.joints if chosen.select([n]).has("tau")[0]]
    if not with_torque and (chosen.has("current") | chosen.has("qcmd")).any():
        return None  # clock, positions and currents can be checked; the report says that torques cannot
    try:
        check_usable(robot, log, with_torque or list(robot.joints), strict=False, whole=whole)
    except InputError as error:
        return error
    return None


def report_issues(
    robot: Robot, logs: Sequence[Data], prepared: tuple[LowPass, Sequence[Sequence[Motion]]] | None = None
) -> list[LogReport]:
    """Issues of every log; of a recording those of its first chunk in motion.

    Parameters
    ----------
    prepared : LowPass and sequence of sequence of Motion, optional
        Filter and motions of each log, where the caller has them: the checks are then brief.
    """

    @cache
    def reduction() -> Reduction:
        return structure(Regressor(robot, BASELINE), robot.joints)

    def report(log: Log, own: tuple[LowPass, Sequence[Motion]] | None) -> LogReport:
        alone = len(logs) == 1
        motions = () if own is None else tuple(own[1])
        key = (robot_text(robot), alone, own and own[0].cutoff, motions)
        return _REPORTS.of(
            log, key, lambda: inspect(robot, log.select(robot.joints), reduction, alone=alone, prepared=own)
        )

    each = [None] * len(logs) if prepared is None else [(prepared[0], motions) for motions in prepared[1]]
    return [report(moving_part(log, robot.joints), own) for log, own in zip(logs, each, strict=True)]


def refuse_worthless(reports: Sequence[LogReport]) -> None:
    """Stop at an issue that is certain and leaves nothing to identify.

    Raises
    ------
    InputError
    """
    for report in reports:
        for issue in report.issues:
            if issue.blocks and issue.sure == "certain":
                raise InputError(f"{report.source}: {issue}. To identify anyway: --force (force=True)")


def check_cutoff(cutoff: Cutoff, logs: Sequence[Data]) -> None:
    """Refuse (InputError) a cut-off that a log's rate does not allow."""
    if not isinstance(cutoff, int | float):
        return
    for log in map(preview_of, logs):
        if cutoff >= HIGHEST_CUTOFF * log.rate * (1 - 1e-6):
            raise InputError(
                f"{log.source}: a cut-off of {cutoff:g} Hz is not below {HIGHEST_CUTOFF:g} times its rate of "
                f"{log.rate:.4g} Hz, so it would filter nothing; take at most {0.2 * log.rate:.3g} Hz, or "
                "--cutoff none (None) to filter nothing on purpose"
            )
