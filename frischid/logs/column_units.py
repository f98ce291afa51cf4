"""Units in a proposed mapping: velocities against slopes of positions, degrees against the URDF's limits."""

from __future__ import annotations

import numpy as np

from frischid.core.types import Array
from frischid.logs.proposal import Proposal
from frischid.logs.table import Table
from frischid.robot.robot import Robot

DEGREES_PER_RADIAN = 180 / np.pi


def check_velocities(table: Table, t: Array, found: Proposal) -> None:
    """Keep a velocity only where it is the slope of its position, and note how well the two agree."""
    for columns in found.joints.values():
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
            found.reasons.append(
                f"{columns['v']} is {factor:.3g} times the slope of {columns['q']}: other unit or sign? left out"
            )
            del columns["v"]


def propose_degrees(table: Table, robot: Robot, found: Proposal) -> None:
    """Propose degrees where positions are far outside the limits, but inside when divided by 57.3."""
    limits = dict(
        zip(robot.joints, zip(robot.limits.lower, robot.limits.upper, robot.prismatic, strict=True), strict=True)
    )
    outside = inside = 0
    for joint, columns in found.joints.items():
        low, high, slides = limits[joint]
        if slides or not np.isfinite(low) or not np.isfinite(high):
            low, high = -2 * np.pi, 2 * np.pi
        if slides:
            continue
        q = np.asarray(table.numeric[columns["q"]], dtype=float)
        room = 0.1 * (high - low)
        outside += bool((q < low - room).any() or (q > high + room).any())
        inside += bool((q / DEGREES_PER_RADIAN >= low - room).all() and (q / DEGREES_PER_RADIAN <= high + room).all())
    if outside and outside > len(found.joints) / 3 and inside == sum(not limits[j][2] for j in found.joints):
        found.file["angle_unit"] = "deg"
        found.reasons.append("angles in degrees: as radians they are far outside the URDF's limits, as degrees within")
        if sliding := [j for j in found.joints if limits[j][2]]:
            found.reasons.append(
                f'{", ".join(sliding)} slide: give them angle_unit = "m" if their columns are in metres'
            )
