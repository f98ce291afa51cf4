"""The jobs of a fleet, functions of picklable arguments that run on the workers that read the logs.

A job does not raise an error for a log that cannot be used: it returns a `Skipped` with the reason.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

import numpy as np

from frischid.checks import inspect
from frischid.checks.position_faults import JOINT_ZERO
from frischid.diagnosis.diagnosis import diagnose
from frischid.diagnosis.findings import Finding
from frischid.effects import BASELINE, Effect
from frischid.errors import FrischidError, InputError
from frischid.fleet.deviation import Centre, Change, Deviation, changes, deviation
from frischid.fleet.log_paths import LogPath, local
from frischid.logs.cutoff_choice import LogSpectra, spectra_of
from frischid.logs.filters import LowPass
from frischid.logs.log import Log
from frischid.logs.mapping import LogMap
from frischid.logs.preprocessing import prepare
from frischid.logs.readers import read_log
from frischid.logs.recording import Motions, Recording, moving_part, preview_of
from frischid.logs.summary import summarise
from frischid.model.identification import identify
from frischid.model.identify_options import IdentifyOptions
from frischid.model.log_faults import faults_of
from frischid.model.model import Model
from frischid.regression.accumulation import accumulate
from frischid.regression.moment_blocks import total
from frischid.regression.moments import Gram
from frischid.regression.regressor import Regressor
from frischid.regression.structure import structure
from frischid.robot.robot import Robot

_BLOCKS = 32  # blocks of time of a robot: enough for a jackknife, few enough to send
_WHOLE_FILE = 32 * 2**20  # bytes: a larger file is read chunk by chunk
_DIAGNOSED_SAMPLES = 30_000  # samples of a robot that are diagnosed: minutes of motion, seconds of computation
_EXPLAINS_MOST = 0.5  # share of a robot's error that an effect must explain to be named as the change

# Errors from a faulty log, of any reader and any stage: one broken log of ten thousand must not stop the others.
_LOG_FAULTS = (
    FrischidError, ArithmeticError, AssertionError, AttributeError, EOFError, LookupError, MemoryError, OSError,
    RuntimeError, TypeError, ValueError,
)  # fmt: skip


@dataclass(frozen=True)
class Job:
    """Everything needed to compute moments from a log; the same for all logs."""

    robot: str
    effects: tuple[Effect, ...]
    rows: tuple[str, ...]
    base: tuple[int, ...]
    lowpass: LowPass
    velocity: str
    mapping: LogMap | None = field(compare=False, default=None)


@dataclass(frozen=True)
class Skipped:
    """A log that does not count, and the reason."""

    robot: str
    address: str
    reason: str


@dataclass(frozen=True, eq=False)
class LogMoments:
    """Moments of one log."""

    address: str
    blocks: tuple[Gram, ...]
    samples: int
    seconds: float
    warnings: tuple[str, ...]
    faults: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class RobotMoments:
    """Moments of one robot of the fleet."""

    name: str
    blocks: tuple[Gram, ...]
    addresses: tuple[str, ...]
    samples: int
    seconds: float
    skipped: tuple[Skipped, ...]
    warnings: tuple[str, ...]
    faults: tuple[str, ...] = ()


@lru_cache(maxsize=4)
def tools(robot: str, effects: tuple[Effect, ...]) -> tuple[Robot, Regressor]:
    """The robot and its regressor, built once per process."""
    built = Robot.from_dict(json.loads(robot))
    return built, Regressor(built, effects)


def _open(path: Any, address: str, joints: Sequence[str], mapping: LogMap | None) -> Log | Recording:
    """A log named by its address: in memory if it is small, otherwise a recording that is read chunk by chunk."""
    if path.is_file() and path.stat().st_size > _WHOLE_FILE:
        return replace(Recording.open(path, joints, mapping), source=address)
    return replace(read_log(path, joints, mapping), source=address)


@dataclass(frozen=True)
class Look:
    """First look at a log: its joints, the joints with a torque, and the spectra that decide the filter."""

    joints: tuple[str, ...]
    torques: tuple[str, ...]
    spectra: LogSpectra

    def holds(self, joints: Sequence[str], torques: Sequence[str]) -> bool:
        """Whether the log has these joints, and the torques of those."""
        return set(joints) <= set(self.joints) and set(torques) <= set(self.torques)


def look(
    log_path: LogPath, joints: tuple[str, ...], rows: tuple[str, ...] | None, mapping: LogMap | None
) -> Look | Skipped:
    """Read the joints of a log and the spectra of its motion."""
    try:
        with local(log_path.address) as path:
            log = _open(path, log_path.address, joints, mapping)
            head = preview_of(log)
            torques = tuple(str(n) for n in np.compress(head.has("tau"), head.joints))
            moving = moving_part(log, [n for n in joints if n in head.joints])
            spectra = spectra_of(moving, [n for n in (rows or torques) if n in torques])
            return Look(head.joints, torques, spectra)
    except _LOG_FAULTS as error:
        return _skipped(log_path, error)


def torque_lag(log_paths: Sequence[LogPath], job: Job, prior: str) -> tuple[float, list[str]]:
    """The lag that `identify` takes back on some logs, s, and a note; zero where the logs say nothing of a lag."""
    robot, _ = tools(job.robot, job.effects)
    names = (*robot.joints, *robot.locked)
    try:
        with ExitStack() as opened:
            paths = [opened.enter_context(local(one.address)) for one in log_paths]
            logs = [_open(p, one.address, names, job.mapping) for p, one in zip(paths, log_paths, strict=True)]
            options = IdentifyOptions(
                torque_joints=job.rows, cutoff=job.lowpass.cutoff, velocity=job.velocity, prior=prior, recursion="none"
            )
            found = identify(robot, logs, effects=job.effects, options=options)
    except _LOG_FAULTS as error:
        return 0.0, [f"the lag of the torque was not estimated: {_skipped(log_paths[0], error).reason}"]
    lag = found.torque_lag
    return found.model.lowpass.torque_lag, [] if lag is None or not lag.said else [f"{lag.said}, on {len(logs)} logs"]


def measure(log_path: LogPath, job: Job) -> LogMoments | Skipped:
    """Moments of one log, or the reason why the log cannot be used."""
    try:
        robot, regressor = tools(job.robot, job.effects)
        with local(log_path.address) as path:
            log = _open(path, log_path.address, (*robot.joints, *robot.locked), job.mapping)
            seen = summarise(robot, [log], job.rows, job.lowpass.cutoff)
            missing = [n for n in job.rows if not preview_of(log).select([n]).has("tau")[0]]
            if missing:
                raise InputError(f"no torque for {', '.join(missing)}, which the other logs have")
            pieces = Motions([log], robot.joints, job.lowpass, job.velocity)
            motions = pieces if isinstance(log, Recording) else list(pieces)
            seconds = seen.seconds if isinstance(log, Recording) else None
            grams = accumulate(regressor, motions, job.lowpass, job.rows, seconds=seconds, base=job.base)
            merged = tuple(_merged(grams, _BLOCKS))
            if not total(merged).rows:
                raise InputError(f"no torque to fit: {', '.join(job.rows)} at standstill in the whole log")
            first = moving_part(log, robot.joints).select(robot.joints)
            known = motions if isinstance(motions, list) else prepare(first, job.lowpass, velocity=job.velocity).motions
            report = inspect(
                robot,
                first,
                lambda: structure(Regressor(robot, BASELINE), robot.joints),
                alone=False,
                prepared=(job.lowpass, known),
            )
            warnings = tuple(f"{log_path.address}: {issue.short}" for issue in report.issues)
            # a wrong centre of mass of the URDF looks like a wrong zero of an angle, in the logs of all robots
            wrong = [issue for issue in faults_of(report) if issue.kind != JOINT_ZERO]
            faults = tuple(f"{log_path.address}: {issue.short}" for issue in wrong)
            return LogMoments(log_path.address, merged, seen.samples[0], seen.seconds, warnings, faults)
    except _LOG_FAULTS as error:
        return _skipped(log_path, error)


def _skipped(log_path: LogPath, error: Exception) -> Skipped:
    reason = str(error).removeprefix(f"{log_path.address}: ")
    return Skipped(log_path.robot, log_path.address, reason if isinstance(error, FrischidError) else f"{error!r}")


def _merged(grams: Sequence[Gram], most: int) -> list[Gram]:
    """At most `most` blocks; neighbouring ones are added."""
    size = -(-len(grams) // most)
    return [total(grams[i : i + size]) for i in range(0, len(grams), max(1, size))]


def combine(name: str, parts: Sequence[LogMoments | Skipped]) -> RobotMoments:
    """Moments of one robot from those of its logs, in order."""
    good = [p for p in parts if isinstance(p, LogMoments)]
    return RobotMoments(
        name,
        tuple(_merged([g for p in good for g in p.blocks], _BLOCKS)) if good else (),
        tuple(p.address for p in good),
        sum(p.samples for p in good),
        sum(p.seconds for p in good),
        tuple(p for p in parts if isinstance(p, Skipped)),
        tuple(w for p in good for w in p.warnings)[:3],
        tuple(fault for p in good for fault in p.faults),
    )


def summary(one: RobotMoments) -> RobotMoments:
    """The results of a robot without its moments, which are large."""
    return replace(one, blocks=())


def moments(one: RobotMoments) -> Gram:
    """Sum of a robot's moments."""
    return total(one.blocks)


def add(a: Gram, b: Gram) -> Gram:
    """Sum of the moments of two robots."""
    return a + b


def against(question: tuple[RobotMoments, bool], fleet: Gram, centre: Centre) -> Deviation:
    """Compare one robot with the others; the flag beside the robot says whether the fleet's sum includes it."""
    one, included = question
    return deviation(one.blocks, fleet, centre, included)


def paired(one: RobotMoments, flag: bool) -> tuple[RobotMoments, bool]:
    """A robot and its flag, as one argument."""
    return one, flag


@dataclass(frozen=True)
class Explaining:
    """Options for explaining a robot that differs."""

    mapping: LogMap | None
    inflation: float
    """Number of samples that count as one, κ of the fleet (`frischid.fleet.deviation.Null`)."""


def explain(
    question: tuple[RobotMoments, bool], model: Mapping[str, Any], how: Explaining
) -> tuple[list[Change], Finding | None, str]:
    """The change of a robot: parameters of the model and, if the robot is to be diagnosed, a missing effect."""
    one, diagnosed = question
    fleet = Model.from_dict(model)
    whole = total(one.blocks)
    changed = changes(whole, fleet.estimate.theta, how.inflation)
    if not diagnosed:
        return changed, None, ""
    try:
        found = diagnose(fleet, _excerpt(one, fleet, how.mapping), situation="changed").findings
    except _LOG_FAULTS as error:  # one robot that cannot be diagnosed must not stop the others
        return changed, None, str(error) if isinstance(error, FrischidError) else f"{error!r}"
    # The comparison with the fleet has shown that the robot differs; the diagnosis only finds the effect.
    return changed, next((f for f in found if f.gain > 0 and f.share > _EXPLAINS_MOST), None), ""


def _excerpt(one: RobotMoments, fleet: Model, mapping: LogMap | None) -> list[Log]:
    """The first logs of a robot, of long ones the first chunk in motion, up to `_DIAGNOSED_SAMPLES`."""
    logs: list[Log] = []
    for address in one.addresses:
        if logs and sum(map(len, logs)) + len(logs[-1]) > _DIAGNOSED_SAMPLES:
            break
        with local(address) as path:
            opened = _open(path, address, (*fleet.robot.joints, *fleet.robot.locked), mapping)
            logs.append(moving_part(opened, fleet.robot.joints))
    return logs
