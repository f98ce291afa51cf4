"""Summary of the logs before anything is computed from them: joints, length, faults, and a suitable filter.

The summary takes one pass over all samples; recordings are read chunk by chunk.
"""

from __future__ import annotations

import shlex
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from frischid.core.text import listed
from frischid.errors import InputError, UnknownNameError
from frischid.logs.cutoff_choice import LogSpectra, spectra_of
from frischid.logs.filters import LowPass
from frischid.logs.locked_joints import LockedMotion
from frischid.logs.log import DEAD_TORQUE, STANDSTILL_SPAN, Log, check_motion, check_torque
from frischid.logs.poses import FEWEST_POSES, is_static, poses_of
from frischid.logs.recording import Recording, chunks_of, preview_of
from frischid.logs.wraps import unwrapped
from frischid.robot.robot import Robot

Data = Log | Recording


@dataclass(frozen=True)
class LogSummary:
    """Length of some logs, a suitable filter, and locked joints that move."""

    lowpass: LowPass
    spectra: LogSpectra
    """Of the joints whose torque is fitted."""
    samples: tuple[int, ...]
    """Number of samples of each log."""
    seconds: float
    """Length of all logs together."""
    locked: LockedMotion
    """Locked joints that move nevertheless, or stand at another angle."""


def summarise(
    robot: Robot, logs: Sequence[Data], rows: Sequence[str], cutoff: float | Literal["auto"] | None = "auto"
) -> LogSummary:
    """Summarise some logs, in one pass over their samples.

    Parameters
    ----------
    rows : sequence of str
        Joints whose torque is fitted.
    cutoff : float, "auto" or None
        Cut-off of the low-pass, Hz; ``"auto"`` chooses it.

    Raises
    ------
    InputError
        A log cannot be used.
    """
    spectra = LogSpectra()
    samples, seconds = [], 0.0
    locked = LockedMotion(robot)
    for log in logs:
        count, faults = 0, []
        for number, chunk in enumerate(chunks_of(log)):
            try:
                check_usable(robot, chunk, rows, strict=True, whole=isinstance(log, Log))
            except InputError as error:
                # A recording may be at standstill for a whole chunk; a dead torque is dead in all chunks.
                faults.append(error)
            if len(faults) <= number:
                spectra += spectra_of(chunk, rows)
            locked.see(chunk)
            count += len(chunk)
            seconds += chunk.duration
        if faults and len(faults) == number + 1:
            raise faults[0]
        samples.append(count)
    lowpass = spectra.lowpass() if cutoff == "auto" else LowPass(cutoff)
    if spectra.at_rest and not spectra.joints:
        _check_poses(robot, logs)
    return LogSummary(lowpass, spectra, tuple(samples), seconds, locked)


def _check_poses(robot: Robot, logs: Sequence[Data]) -> None:
    """Refuse logs that hold nothing but a few poses."""
    static = [log.select(robot.joints) for log in logs if isinstance(log, Log)]
    poses = sum(len(poses_of(log).t) for log in static if is_static(log))
    if 0 < poses < FEWEST_POSES:
        raise InputError(
            f"{', '.join(log.source for log in logs)}: the arm stands still, at {poses} pose{'s' * (poses > 1)}: "
            f"gravity needs at least {FEWEST_POSES} different poses, inertia and friction need motion. Record more "
            "poses and give all files together, or record a motion of all joints (frischid excite plans one). frischid "
            "diagnose and frischid check say whether something pushed the arm. If the arm did move, check the position "
            "columns and their unit"
        )


def held_by(robot: Robot, logs: Sequence[Data]) -> tuple[Robot, list[str]]:
    """Lock the joints that some log does not hold."""
    if not logs:
        raise InputError("there is no log to identify from; give at least one")
    heads = [preview_of(log) for log in logs]
    held = [n for n in robot.joints if all(n in log.joints for log in heads)]
    if not held:
        holds = [f"{log.source} holds {', '.join(head.joints)}" for log, head in zip(logs, heads, strict=True)]
        shared = "the logs share no joint with the robot" if len(logs) == 1 else "no joint of the robot is in all logs"
        raise InputError(
            f"{shared}; joints of the robot are {', '.join(robot.joints)}; {'; '.join(dict.fromkeys(holds))}"
            + "; identify logs that hold the same joints, or name the columns in a mapping file (--map)"
            * (len(logs) > 1)
        )
    _refuse_torque_without_position(robot, held, heads)
    kept = _where_they_stand(lock_absent(robot, held), robot.locked, heads)
    by_angle: dict[str, list[str]] = {}
    for name, angle in kept.locked.items():
        why = "" if name in robot.locked else " (not every log has the position; --lock JOINT=ANGLE sets another angle)"
        by_angle.setdefault(f"{angle:.4g} rad (m){why}", []).append(name)
    return kept, [f"locked at {angle}: {', '.join(names)}" for angle, names in by_angle.items()]


def lock_absent(robot: Robot, held: Sequence[str]) -> Robot:
    """The robot with all joints locked that are not `held`.

    Raises
    ------
    InputError
        A parameter is known by its number, and the locks give the links other numbers and masses.
    """
    lost = [n for n in robot.joints if n not in held]
    if lost and robot.known:
        locks = " ".join(f"--lock {shlex.quote(n)}" for n in lost)
        raise InputError(
            f"not every log has the position of {', '.join(lost)}. With locked joints, links have other numbers, and "
            f"{', '.join(robot.known)} would be known of another link: give {locks} (lock=), and the names that "
            "`frischid info` lists then"
        )
    return robot.keep(held)


def _where_they_stand(robot: Robot, given: Collection[str], heads: Sequence[Log]) -> Robot:
    """The robot with the joints that only some logs hold at their median position there, but for the given locks."""
    angles = {}
    for name in robot.locked:
        known = [unwrapped(log.select([name])).q[:, 0] for log in heads if name in log.joints]
        if name not in given and known:
            angles[name] = float(np.median(known[0]))
    return replace(robot, locked={**robot.locked, **angles}) if angles else robot


def _refuse_torque_without_position(robot: Robot, held: Sequence[str], heads: Sequence[Log]) -> None:
    """Refuse to lock a joint whose torque was recorded: it probably moved, and its position is missing."""
    for log in heads:
        for name in robot.joints:
            there = [f"{c}_{name}" for c in ("tau", "current", "v") if f"{c}_{name}" in log.extra]
            if name not in held and name not in log.joints and there:
                raise InputError(
                    f"{log.source}: holds {', '.join(there)} but no position q_{name}: this joint would be locked at "
                    f"{robot.angle_at_lock(name):.3g} although it may have moved; record its position, name its column "
                    f"in a mapping file, or say --lock {shlex.quote(f'{name}=ANGLE')} if it stood still"
                )


def torque_joints(robot: Robot, logs: Sequence[Data], wanted: Sequence[str] | None, notes: list[str]) -> list[str]:
    """Joints whose torque is fitted: those wanted, or all that have a torque channel in every log."""
    if wanted is not None:
        for name in wanted:
            if name not in robot.joints:
                raise UnknownNameError("joint", name, robot.joints)
        left = [n for n in robot.joints if n not in wanted]
        if left:
            notes.append(f"torque rows left out: {', '.join(left)} (they move, their torque is not fitted)")
        return [n for n in robot.joints if n in wanted]
    there = [set(np.compress(head.has("tau"), head.joints)) for head in map(preview_of, logs)]
    have = [n for n in robot.joints if all(n in names for names in there)]
    without = [n for n in robot.joints if n not in have]
    if have and without:
        notes.append(f"no torque channel for {', '.join(without)}: these joints move, their torque rows are left out")
    return have or list(robot.joints)


def check_usable(robot: Robot, log: Log, rows: Sequence[str], *, strict: bool, whole: bool = True) -> None:
    """Raise on a log that cannot be used, or on a chunk of a longer one (not `whole`)."""
    chosen = log.select(robot.joints)
    if not (whole and is_static(chosen)):
        check_motion(chosen)
    check_torque(chosen, rows)
    size = {} if chosen.tau is None else dict(zip(chosen.joints, np.abs(chosen.tau).max(axis=0), strict=True))
    dead = [n for n in rows if size.get(n, np.inf) <= DEAD_TORQUE]
    if dead and strict:
        raise InputError(
            f"{log.source}: the torque of {', '.join(dead)} is zero throughout; {_without_torque(chosen, dead)}"
        )
    constant = _constant(chosen, rows)
    if constant and strict:
        raise InputError(
            f"{log.source}: the torque of {', '.join(constant)} never changes while the joint moves, it was probably "
            f"not measured; {_without_torque(chosen, constant)}"
        )


def _without_torque(log: Log, joints: Sequence[str]) -> str:
    """The remedy for joints whose torque is not in the log; those at standstill need not be joints of the model."""
    still = [n for n in joints if np.ptp(log.q[:, log.joints.index(n)]) < STANDSTILL_SPAN]
    lock = f"lock {listed(still)}, without motion in this log (--lock, lock=), or " if still else ""
    return f"{lock}leave the torque out (--torque-joints, torque_joints=) or record it"


def _constant(log: Log, rows: Sequence[str]) -> list[str]:
    """Joints that move while their torque keeps one value other than zero."""
    if log.tau is None:
        return []
    same = (np.ptp(log.tau, axis=0) <= DEAD_TORQUE) & (np.ptp(log.q, axis=0) >= STANDSTILL_SPAN)
    return [n for n in rows if n in log.joints and same[log.joints.index(n)]]
