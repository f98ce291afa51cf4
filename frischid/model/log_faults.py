"""Faults of logs that can be undone: a wrong sign, a wrong unit, exchanged joints.

A model explains the fault of a new log in its own words, as a change of the robot: exchanged torques become another
motor constant, a reversed joint other friction. So where a model's error on new logs is unlike that on its own logs,
the check of logs is asked first. It knows the URDF alone, and names a fault only where the fault explains the torque
better than what may happen to a robot.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from contextlib import suppress

from frischid.checks import LogIssue, LogReport
from frischid.errors import InputError
from frischid.logs.driven import driven
from frischid.logs.summary import Data
from frischid.model.alarms import FAULTY_LOG, Alarm
from frischid.model.log_examination import report_issues
from frischid.model.model import Model

WHAT_TO_UNDO = (
    "`frischid check ROBOT LOG -o map.toml` says what to do, and writes the mapping that undoes the fault, if one "
    "does; "
)
"""First part of the remedy of a faulty log."""


def faults_of(report: LogReport) -> list[LogIssue]:
    """The issues of a log that make a wrong model: those that block, and those that a mapping file can undo.

    Examples
    --------
    >>> from dataclasses import replace
    >>> import frischid as fr
    >>> from frischid.model.log_faults import faults_of
    >>> robot = fr.Robot.load("planar2")
    >>> log = fr.simulate(robot, fr.random_fourier(robot, 8, seed=1), rate=100, noise=fr.Noise(q=1e-5, tau=0.01))
    >>> (report,) = fr.check(robot, [replace(log, tau=-log.tau)])
    >>> [issue.kind for issue in faults_of(report)]
    ['torque sign']
    """
    undone = {joint for joint, *_ in report.fix}
    return [x for x in report.issues if x.blocks or (x.where and undone.issuperset(x.where))]


def faulty_logs(
    faults: Sequence[str],
    harm: str = "makes a wrong model",
    remedy: str = f"{WHAT_TO_UNDO}identify again with --map map.toml.",
) -> list[Alarm]:
    """The logs have faults: a wrong sign, a wrong unit, exchanged joints.

    Parameters
    ----------
    harm : str
        What such a fault does.
    """
    if not faults:
        return []
    more = f" (and {len(faults) - 1} more)" if len(faults) > 1 else ""
    return [
        Alarm(
            FAULTY_LOG,
            "severe",
            f"A log has a fault that {harm}: {faults[0]}{more}.",
            remedy,
            (),
            float(len(faults)),
            0.0,
        )
    ]


def faulty_new_logs(model: Model, logs: Sequence[Data], unlike: Collection[str]) -> list[Alarm]:
    """The alarm that logs a model was not fitted to have a fault; empty where none is found.

    Parameters
    ----------
    unlike : collection of str
        Joints on which the model's error there is larger than its uncertainty explains; a fault of other joints is not
        the reason.

    Examples
    --------
    >>> from dataclasses import replace
    >>> import frischid as fr
    >>> from frischid.model.log_faults import faulty_new_logs
    >>> robot = fr.Robot.load("planar2")
    >>> motions = [fr.random_fourier(robot, 8, seed=seed) for seed in (1, 2)]
    >>> log, new = (fr.simulate(robot, motion, rate=100, noise=fr.Noise(q=1e-5, tau=0.01)) for motion in motions)
    >>> model = fr.identify(robot, [log], recursion="none").model
    >>> [alarm.id for alarm in faulty_new_logs(model, [replace(new, tau=-new.tau)], robot.joints)]
    ['faulty-log']
    """
    reports: list[LogReport] = []
    with suppress(InputError):  # a log that the check cannot read is compared all the same
        reports = report_issues(model.robot, driven(logs, model.controller, model.currents))
    found = [
        f"{r.source}: {x.short}" for r in reports for x in faults_of(r) if not x.where or set(x.where) & set(unlike)
    ]
    return faulty_logs(found, "causes errors", f"{WHAT_TO_UNDO}give it with --map map.toml.")
