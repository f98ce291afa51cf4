"""Positions in degrees or millimetres, seen from the motion alone; and which joints are in degrees, by the torques.

Degrees read as radians are 57 times too large, and so implausible for a joint that moves far. A joint that moves by a
few degrees stays plausible, so that the motion cannot tell whether the implausible joints alone are in degrees or all
of them. The torques can: both readings are fitted with friction, and the score of `frischid.checks.explanation`
decides. So do the torques where the robot moves beyond limits that its URDF states wrongly.

A sliding joint is in millimetres where the range of its motion is then nearer to the URDF's.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from frischid.checks.faults import Fault, Fix
from frischid.checks.log_issue import Notebook, span
from frischid.checks.position_faults import Moved, degree_faults
from frischid.checks.row_fits import RowFits
from frischid.checks.sketch import Sketch
from frischid.checks.torque_faults import local_fits
from frischid.logs.column_units import SPARE_SHARE, in_millimetres
from frischid.logs.log import Log
from frischid.robot.robot import Robot
from frischid.robot.stated_inertials import unstated


@dataclass(frozen=True, eq=False)
class Implausible:
    """Joints whose motion is implausible in radians."""

    joints: NDArray[np.bool_]
    """Shape (J,)."""
    evidence: str
    certain: bool
    """Whether nothing but another unit moves so."""
    outside: bool
    """Whether as degrees, too, joints leave their limits: angles of motors behind gears and encoder counts do so, and a
    joint whose zero is another than the URDF's."""


def implausible_motion(
    robot: Robot, log: Log, notes: Notebook, full_turns: NDArray[np.bool_] | None = None
) -> Implausible | None:
    """Joints whose positions cannot be in radians; None without one. Report those that cannot be in degrees either.

    Such positions are far outside the robot's limits, or they move much faster than the limits allow and over more than
    a turn. Simulated robots are often faster than their URDF allows, but they stay within a turn. Joints whose recorded
    angles jumped by 360, `full_turns` (J,), are in degrees wherever they move.
    """
    jumped = np.zeros(len(robot.joints), dtype=bool) if full_turns is None else full_turns & ~robot.prismatic
    limits, criteria = robot.limits, notes.criteria
    lower, upper = limits.lower, limits.upper
    limited = np.isfinite(lower) & np.isfinite(upper)
    # a zero that is off, or the column of another joint, goes beyond the limits by no more than a turn
    room = np.where(limited, np.maximum(upper - lower, 2 * np.pi), np.inf)
    # over several samples, because stamps of arrival may be next to one another
    apart = min(criteria.degree_samples, len(log) - 1)
    typical = np.percentile(
        np.abs(log.q[apart:] - log.q[:-apart]) / (log.t[apart:] - log.t[:-apart])[:, None],
        criteria.degree_percentile,
        axis=0,
    )
    far = limited & ((log.q > upper + room) | (log.q < lower - room)).any(axis=0)
    # Without any limit to compare with, two full turns is where a joint of an arm becomes suspicious.
    turns = ~limited & ~np.isfinite(limits.velocity) & (np.ptp(log.q, axis=0) > criteria.unlimited_range)
    fast = (typical > criteria.degree_speed * limits.velocity) & (np.ptp(log.q, axis=0) > criteria.degree_range)
    found = (fast | far | turns | jumped) & ~robot.prismatic
    if not found.any():
        return None
    as_degrees = np.deg2rad(log.q)
    over = limited & ((as_degrees > upper + room) | (as_degrees < lower - room)).any(axis=0)
    largest = span(np.abs(log.q[:, found]).max(axis=0))
    if over[found].any() and not jumped.any():
        notes.add(
            "unit of positions",
            f"the positions are far outside the URDF's limits, as radians and as degrees: {largest}",
            notes.which(found),
            "certain",
            "encoder counts? set gear_ratio = counts per radian for each joint in a mapping file (and torque_factor = "
            "1/gear_ratio where the torques are those of the joints); angles of the motors? set gear_ratio",
            blocks=True,
        )
        return None
    if jumped.any():
        what = "the positions jump by 360 from one sample to the next: degrees that wrap"
        return Implausible(found, what, certain=True, outside=False)
    spare = np.where(limited, SPARE_SHARE * (upper - lower), np.inf)
    outside = bool((found & limited & ((as_degrees > upper + spare) | (as_degrees < lower - spare)).any(axis=0)).any())
    why = f"far outside the URDF's limits: {largest} rad" if far.any() else f"several full turns: {largest} rad"
    if (fast & found).any() and not far.any():
        why = f"much faster than the URDF's limits: {span(typical[fast & found])} rad/s"
    evidence = f"the motion is implausible in radians ({why}) and looks like degrees"
    evidence += ", although it leaves the limits as degrees, too" if outside else ""
    return Implausible(found, evidence, not turns[found].all(), outside)


def explained_in_radians(found: Implausible, sketch: Callable[[], Sketch | None]) -> bool:
    """Whether the torques leave no doubt that an implausible motion is in radians all the same.

    A URDF may state limits that the robot does not have.
    """
    seen = sketch()
    if seen is None or not len(seen.rows) or unstated(seen.robot):
        return False
    as_it_is = local_fits(RowFits(seen), simple=True)[0].score
    return bool(as_it_is - max(_scores(list(degree_faults(seen, found.joints)))) > np.log(seen.criteria.least_odds))


def _scores(readings: Sequence[Moved]) -> list[float]:
    """How well the torques agree with each reading of the positions, less what the reading costs."""
    return [local_fits(RowFits(x.sketch), simple=True)[0].score - x.fault.cost for x in readings]


def check_degrees(found: Implausible, sketch: Callable[[], Sketch | None], notes: Notebook) -> None:
    """Report joints in degrees, and how a mapping file undoes that.

    Parameters
    ----------
    sketch : callable
        Returns the log as it is, with the torques that can be judged; None without one.
    """
    seen = sketch()
    fault = None if seen is None else _which(found.joints, seen)
    where, fix = notes.which(found.joints), tuple[Fix, ...]()
    advice = f'set angle_unit = "deg" under [joint.{where[0]}]{" and the like" * (len(where) > 1)} in a mapping file if'
    advice += " the other joints are in radians, or under [file] if all joints are in degrees"
    if fault is not None:
        where, advice, fix = fault.where, fault.advice, fault.fix
    if found.outside:
        if seen is None or not len(seen.rows):  # nothing tells degrees from angles of motors: the reader must choose
            fix = ()
        advice += "; but if these are angles of the motors or encoder counts, set gear_ratio for each joint"
    if found.certain:
        notes.add("degrees", found.evidence, where, "likely" if found.outside else "certain", advice, blocks=True)
        notes.fix += fix
    else:
        notes.add("degrees", found.evidence, where, "likely", f"if so, {advice}")


def check_millimetres(robot: Robot, log: Log, notes: Notebook) -> bool:
    """Report sliding joints whose positions are in millimetres, and how a mapping file undoes that; whether any is."""
    motion, strokes = np.ptp(log.q, axis=0), robot.limits.stroke
    read = [in_millimetres(seen, stroke) for seen, stroke in zip(motion.tolist(), strokes.tolist(), strict=True)]
    found = np.array(read, dtype=bool) & robot.prismatic
    for joint, seen, stroke in zip(notes.which(found), motion[found], strokes[found], strict=True):
        notes.add(
            "millimetres",
            f"moves over {seen:.4g} m where the URDF's limits leave {stroke:.4g} m: positions look like millimetres",
            (joint,),
            "certain",
            f'set angle_unit = "mm" under [joint.{joint}] in a mapping file',
            blocks=True,
        )
        notes.fix += ((joint, "angle_unit", "mm"),)
    return bool(found.any())


def _which(joints: NDArray[np.bool_], sketch: Sketch) -> Fault | None:
    """The reading of these joints, or of all, that the torques leave no doubt of; None if they do."""
    readings = list(degree_faults(sketch, joints))
    if len(readings) == 1:
        return readings[0].fault
    if not len(sketch.rows) or unstated(sketch.robot):
        return None
    scores = _scores(readings)
    best, other = np.argsort(scores)[::-1]
    doubtless = scores[best] - scores[other] > np.log(sketch.criteria.least_odds)
    return readings[int(best)].fault if doubtless else None
