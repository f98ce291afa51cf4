"""Units in a proposed mapping: velocities against slopes of positions, degrees and millimetres against URDF limits."""

from __future__ import annotations

import re

import numpy as np

from frischid.core.types import Array
from frischid.logs.column_words import unit_of
from frischid.logs.proposal import Proposal
from frischid.logs.table import Table
from frischid.logs.wraps import TURN
from frischid.robot.robot import Robot

DEGREES_PER_RADIAN = 180 / np.pi
TURNS_PER_MINUTE = 30 / np.pi
"""Revolutions per minute in 1 rad/s."""
VELOCITY_UNITS = (
    ("degrees per second", DEGREES_PER_RADIAN),
    ("radians per second", 1 / DEGREES_PER_RADIAN),
    ("revolutions per minute", TURNS_PER_MINUTE),
    ("revolutions per minute", TURNS_PER_MINUTE / DEGREES_PER_RADIAN),
    ("millimetres per second", 1e3),
    ("metres per second", 1e-3),
)
"""Velocity over the slope of its position, where the two have different units: rad, deg, m or mm."""
SAME_FACTOR = 0.02
"""Share by which the measured factor of a velocity may differ from that of its unit."""
SPARE_SHARE = 0.1
"""Share of the range between a joint's limits by which its angles may leave them: a zero is seldom exact."""


def check_velocities(table: Table, t: Array, found: Proposal) -> None:
    """Keep a velocity only where it is the slope of its position, in a known unit, and note how well the two agree."""
    for joint, columns in found.joints.items():
        if "v" not in columns or len(t) < 20:
            continue
        slope = np.gradient(
            np.asarray(table.numeric[columns["q"]], dtype=float), np.maximum.accumulate(t) + 1e-12 * np.arange(len(t))
        )
        v = np.asarray(table.numeric[columns["v"]], dtype=float)
        if v.std() == 0 or slope.std() == 0:
            continue
        # a moving mean over both, because slopes of noisy positions are noise; late velocities still correlate
        window = np.ones(max(1, len(t) // 200)) / max(1, len(t) // 200)
        v, slope = (np.convolve(x, window, mode="valid") for x in (v, slope))
        likeness = float(np.corrcoef(v, slope)[0, 1])
        if abs(likeness) < 0.5:
            found.reasons.append(
                f"{columns['v']} is not the slope of {columns['q']} (correlation {likeness:.2f}): left out"
            )
            del columns["v"]
        elif abs(float(v @ slope) / float(slope @ slope) - 1) > 0.2:
            factor = float(v @ slope) / float(slope @ slope)
            what = f"{columns['v']} is {factor:.3g} times the slope of {columns['q']}"
            known = next(((name, x) for name, x in VELOCITY_UNITS if abs(factor / x - 1) < SAME_FACTOR), None)
            if known is not None:
                found.reasons.append(f"{what}: it is in {known[0]}")
                found.units.setdefault(joint, {})["velocity_factor"] = float(f"{1 / known[1]:.6g}")
                continue
            found.reasons.append(f"{what}: other unit or sign? left out")
            del columns["v"]


def propose_degrees(table: Table, robot: Robot, found: Proposal) -> None:
    """Propose degrees where names say so, where angles jump by 360, or where only degrees fit the limits."""
    outside, degrees = _outside_limits(table, robot, found)
    turning = [j for j, slides in zip(robot.joints, robot.prismatic, strict=True) if not slides and j in found.joints]
    named = [j for j in turning if unit_of(found.joints[j].get("q", ""))[0] in ("deg", "°")]
    if named and not degrees:
        found.reasons.append(f"{found.joints[named[0]]['q']}{' ...' * (len(named) > 1)} in degrees, by the name")
        if named == turning:
            found.file["angle_unit"] = "deg"
        else:
            found.units |= {j: found.units.get(j, {}) | {"angle_unit": "deg"} for j in named}
    elif degrees:
        found.file["angle_unit"] = "deg"
        jumping = _jumping(found)
        found.reasons.append(
            f"angles in degrees: {jumping[0]}{' ...' * (len(jumping) > 1)} jumps by 360 from one row to the next"
            if jumping
            else "angles in degrees: as radians they are more than a turn outside the URDF's limits, as degrees within"
        )
    elif outside:
        found.guesses.append(
            "as radians the positions are more than a turn outside the URDF's limits, and as degrees they are outside "
            'too; for degrees with another zero, write angle_unit = "deg" under [file]; for angles of motors behind '
            "gears, write gear_ratio = that of the gear under each joint; for encoder counts, write "
            "under each joint gear_ratio = counts per radian, and torque_factor = 1/gear_ratio where the torques are "
            "those of the joints"
        )


def propose_lengths(table: Table, robot: Robot, found: Proposal) -> None:
    """Propose millimetres for sliding joints whose columns say so by name, or move so far; metres beside degrees."""
    said = []
    for joint, columns in found.joints.items():
        k = robot.joints.index(joint)
        if not robot.prismatic[k] or "q" not in columns:
            continue
        q = np.asarray(table.numeric[columns["q"]], dtype=float)
        by_name, seen = unit_of(columns["q"])[0] == "mm", q[np.isfinite(q)]
        if by_name or (len(seen) and in_millimetres(float(np.ptp(seen)), float(robot.limits.stroke[k]))):
            found.units.setdefault(joint, {})["angle_unit"] = "mm"
            said.append(f"{columns['q']} in millimetres, by {'its name' if by_name else 'the range of its motion'}")
        elif found.file.get("angle_unit") == "deg":
            found.units.setdefault(joint, {})["angle_unit"] = "m"
            said.append(f"{columns['q']} in metres: the joint slides, the degrees are those of the others")
    found.reasons += [", ".join(said)] if said else []


def in_millimetres(span: float, stroke: float) -> bool:
    """Whether a range of motion is nearer to a sliding joint's stroke as millimetres than as metres.

    Both readings are compared by the ratio of range and stroke. Without a stroke in the URDF there is no answer.

    Parameters
    ----------
    span : float
        Range of the recorded positions, in their unit.
    stroke : float
        Range between the joint's limits, m; infinite without limits.

    Examples
    --------
    >>> in_millimetres(230.0, 0.4), in_millimetres(0.23, 0.4), in_millimetres(0.9, 0.4)
    (True, False, False)
    """
    if not 0 < stroke < np.inf or span <= 0:
        return False
    metres = abs(np.log(span / stroke))
    return bool(abs(np.log(span / 1000 / stroke)) < metres)


def radians_per_unit(table: Table, robot: Robot, found: Proposal) -> float:
    """Factor of the positions of the joints found so far: of degrees, or 1."""
    return 1 / DEGREES_PER_RADIAN if _outside_limits(table, robot, found)[1] else 1.0


def _jumping(found: Proposal) -> list[str]:
    """Position columns that jump by 360."""
    return [c["q"] for c in found.joints.values() if c.get("q") in found.full_turns]


def _outside_limits(table: Table, robot: Robot, found: Proposal) -> tuple[bool, bool]:
    """Whether the positions are more than a turn outside the URDF's limits, and whether as degrees they are within.

    A joint with another zero than the URDF's is outside its limits too, but by at most a turn. Angles that jump by 360
    are in degrees, whatever the limits are.
    """
    if _jumping(found):
        return True, True
    limits = dict(
        zip(robot.joints, zip(robot.limits.lower, robot.limits.upper, robot.prismatic, strict=True), strict=True)
    )
    outside = inside = turning = 0
    for joint, columns in found.joints.items():
        low, high, slides = limits[joint]
        if slides or "q" not in columns:
            continue
        turning += 1
        if not np.isfinite(low) or not np.isfinite(high):
            low, high = -TURN, TURN
        q = np.asarray(table.numeric[columns["q"]], dtype=float)
        q, room = q[np.isfinite(q)], SPARE_SHARE * (high - low)
        outside += bool((q < low - TURN).any() or (q > high + TURN).any())
        radians = q / DEGREES_PER_RADIAN
        if len(radians) and np.abs(q).max() <= 360:  # 0° to 360° or -180° to 180°: the same angles
            middle = (low + high) / 2
            radians = radians - TURN * np.round((np.median(radians) - middle) / TURN)
        inside += bool((radians >= low - room).all() and (radians <= high + room).all())
    far = outside > len(found.joints) / 3
    return far, far and inside == turning


UNITS_OF_TORQUE = {"mnm": 1e-3, "nmm": 1e-3, "ncm": 1e-2, "n·cm": 1e-2, "n·mm": 1e-3, "knm": 1e3, "kn": 1e3}
"""N·m (N) per unit that the name of a torque column says."""


def propose_effort_units(found: Proposal) -> None:
    """Factors of torques and currents whose names say another unit than N·m and A."""
    percent, milli = [], []
    for joint, columns in found.joints.items():
        for channel in ("tau", "current"):
            if channel not in columns:
                continue
            unit = unit_of(columns[channel])[0]
            if channel == "tau" and unit in UNITS_OF_TORQUE:
                found.units.setdefault(joint, {})["torque_factor"] = UNITS_OF_TORQUE[unit]
            elif channel == "current" and unit == "ma":
                found.units.setdefault(joint, {})["current_factor"] = 1e-3
                milli.append(columns[channel])
            elif re.search(r"%|percent|pct|rated|permille|‰", columns[channel].lower()):
                percent.append(columns[channel])
    ungeared = [c["tau"] for c in found.joints.values() if c.get("tau", "").startswith("actuator_force")]
    if ungeared:
        found.guesses.append(
            f"{ungeared[0]} ...: MuJoCo's forces of actuators are before the gear; write under each joint "
            "torque_factor = gear of its actuator, or record qfrc_actuator"
        )
    if milli:
        found.reasons.append(f"{milli[0]} ...: milliamperes, by the name")
    if percent:
        found.guesses.append(
            f"{percent[0]} ...: a share of a rated value, by the name; write under each joint torque_factor (N·m per "
            "unit of the column), or current_factor (A per unit): rated value / 100 for percent"
        )
