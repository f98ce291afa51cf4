"""Moments without the noise of velocities, where a drive's damping is fitted.

    column of kd = q̇ − v_cmd + ε,      E[Σ ε²] = N s²

A joint that follows its commands well has a small velocity error, and the noise ε of q̇ is then a large part of the
column. Least squares would make kd too small by the share of the noise in what the other columns leave of the column
(regression dilution): with an encoder of 4096 counts per turn, by 2 to 47 %. Friction and armature would be wrong too.
ε is in the column of viscous friction as well, so N s² is taken from the four moments of the two. The residual keeps
what ε does to the torque, N s² (kd + fv)², so that standard errors hold it.

s follows from sixth differences of the positions, which pass no motion of ten times lower frequency, through the
differentiator and the filter. Their median has no part of the jerks at reversals.

Source: Fuller 1987, Measurement Error Models, Wiley, chapter 1.2.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from frischid.core.bursts import robust_std
from frischid.core.types import Array
from frischid.effects import Viscous
from frischid.effects.commands import VelocityGain
from frischid.estimators.sensor_noise import sensors_of
from frischid.logs.filters import LowPass, correlate
from frischid.logs.preprocessing import Motion
from frischid.model.noise_floor import SIXTH_DIFFERENCE
from frischid.regression.moment_blocks import Blocks, total
from frischid.regression.moments import Gram
from frischid.robot.robot import Robot

_RANK = 1e-12


def without_velocity_noise(
    blocks: Blocks, robot: Robot, motions: Sequence[Motion], lowpass: LowPass, most: float
) -> Blocks:
    """Blocks of moments, less the noise in the columns of open damping gains.

    Parameters
    ----------
    blocks : Blocks
        Of the base parameters.
    motions : sequence of Motion
        Of which the noise is measured.
    most : float
        Largest share of a column, beside the other columns, that counts as noise.
    """
    whole = total(blocks)
    if not any(c.effect == VelocityGain.id for c in whole.columns):
        return blocks
    noise = _noise(robot, motions, lowpass)
    taken = [_of_joint(whole, j, noise[robot.joints.index(name)], most) for j, name in enumerate(whole.joints)]
    found = []
    for block in blocks:
        moments = block.moments.copy()
        for j, (columns, power, damping) in enumerate(taken):
            moments[j][np.ix_(columns, columns)] -= block.counts[j] * power
            moments[j, -1, -1] += block.counts[j] * power * damping**2
        found.append(replace(block, moments=moments))
    return Blocks(found)


def _of_joint(whole: Gram, j: int, power: float, most: float) -> tuple[list[int], float, float]:
    """Columns of a joint's velocity, the noise's mean square in them, and the sum of their coefficients."""
    here = [k for k, c in enumerate(whole.columns) if c.joint == whole.joints[j]]
    columns = [k for k in here if whole.columns[k].effect in (Viscous.id, VelocityGain.id)]
    if not any(whole.columns[k].effect == VelocityGain.id for k in columns):
        return [], 0.0, 0.0
    G = whole.moments[j, :-1, :-1]
    size = np.sqrt(np.where(np.diag(G) > 0, np.diag(G), 1.0))
    inverse = np.linalg.pinv(G / np.outer(size, size), rcond=_RANK, hermitian=True) / np.outer(size, size)
    u = np.isin(np.arange(len(G)), columns).astype(float)
    taken = min(power, most / max(float(whole.counts[j] * (u @ inverse @ u)), 1e-300))
    less = G - whole.counts[j] * taken * np.outer(u, u)
    less = np.linalg.pinv(less / np.outer(size, size), rcond=_RANK, hermitian=True) / np.outer(size, size)
    return columns, taken, float(u @ less @ whole.moments[j, :-1, -1])


def _noise(robot: Robot, motions: Sequence[Motion], lowpass: LowPass) -> Array:
    """Mean square of the noise of each joint's filtered velocity, (J,)."""
    powers = []
    for motion in motions:
        F, difference = lowpass.taps(motion.step), np.linalg.norm(SIXTH_DIFFERENCE)
        power = np.zeros(len(robot.joints))
        if len(motion.t) > len(SIXTH_DIFFERENCE):
            for sensor in sensors_of(motion, robot, lowpass):
                if "v" in sensor.taps:
                    channel = getattr(motion, next(iter(sensor.taps)))[:, sensor.joint : sensor.joint + 1]
                    level = float(robust_std(correlate(SIXTH_DIFFERENCE, channel)[:, 0])) / difference
                    power[sensor.joint] = float(level * np.linalg.norm(np.convolve(sensor.taps["v"], F))) ** 2
        powers.append(power * len(motion.t))
    return np.asarray(np.sum(powers, axis=0) / sum(len(motion.t) for motion in motions))
