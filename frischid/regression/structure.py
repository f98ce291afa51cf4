"""Base parameters from the robot alone, without a log.

The combinations of parameters on which the torque depends are a property of the robot and its effects. So no log is
needed: the regressor W of a few random states has the same null space V2, ``W V2 = 0``, as that of any exciting motion.

Source: Gautier 1991, "Numerical calculation of the base inertial parameters of robots", J. Robotic Systems 8(4).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from frischid.regression.base_parameters import Reduction, reduce
from frischid.regression.regressor import Regressor

MISALIGNED = 3e-6
"""Relative singular value of a parameter that acts only because an angle is rounded (1.5708 is off by 3.7e-6 rad)."""


def structure(regressor: Regressor, torque_joints: Sequence[str], seed: int = 0) -> Reduction:
    """Base parameters of a robot with its effects, from random states; no log is needed.

    Parameters
    ----------
    regressor : Regressor
    torque_joints : sequence of str
        Joints whose torque is measured.
    seed : int

    Returns
    -------
    Reduction
    """
    robot = regressor.robot
    J, C = len(robot.joints), len(regressor.columns)
    rng = np.random.default_rng(seed)
    N = max(40, -(-3 * C // len(torque_joints)))
    lower, upper = np.maximum(robot.limits.lower, -np.pi), np.minimum(robot.limits.upper, np.pi)
    q = rng.uniform(lower, upper, (N, J))
    v, a = rng.normal(size=(2, N, J))
    # Unrelated states must be far apart in time; otherwise columns of rates of change become larger than all others.
    channels = {name for effect in regressor.effects for name in effect.channels(robot)}
    extra = {name: 30.0 * rng.uniform(0.5, 1.5, N) for name in sorted(channels)}  # temperatures, °C
    Y = regressor(0.5 * np.arange(N, dtype=np.float64), q, v, a * 3.0, extra=extra)
    index = [robot.joints.index(n) for n in torque_joints]
    return reduce(Y[:, :, index].transpose(0, 2, 1).reshape(-1, C), regressor.columns, tol=MISALIGNED)
