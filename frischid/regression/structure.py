"""Base parameters from the robot alone, without a log.

The combinations of parameters on which the torque depends are a property of the robot and its effects. So no log is
needed: the regressor W of a few random states has the same null space V2, ``W V2 = 0``, as that of any exciting motion.

All comparisons are made in the robot's own units (`frischid.robot.scale`), so the answer does not depend on those of
the URDF: parameters θ̃ = D⁻¹θ, states that last its characteristic time, and torques as a share of their joint's,

    W̃_j = W_j D / ‖W_j D‖.

A URDF with rounded angles (1.5708 for π/2) has relations that hold nearly, and parameters that nearly do not act. They
are merged and left out as long as this costs no joint more than `MERGED_SHARE` of its torque: the coarsest tolerance of
`reduce` is taken for which

    cost = max_j max( ‖W̃_j − W̃_j[:, base] K‖,  ‖(W_j − W_j[:, base] K) θ_URDF‖ / ‖W_j θ_URDF‖ )

stays below that share, and for which the base columns W̃[:, base] are independent.

Source: Gautier 1991, "Numerical calculation of the base inertial parameters of robots", J. Robotic Systems 8(4).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from frischid.core.types import Array
from frischid.regression.base_parameters import Reduction, reduce
from frischid.regression.regressor import Regressor, nominal_parameters
from frischid.robot.scale import RobotScale

MERGED_SHARE = 1e-4
"""Share of a joint's torque, rms, that merging near-dependencies may cost: a tenth of the error of the best torque
sensors, which is 1e-3 of their range."""
TOLERANCES = (3e-6, 3e-8, 3e-10, 3e-12)
"""Rank tolerances of `reduce`, coarse to fine. The first merges what a rounded angle leaves (1.5708 is off by 3.7e-6
rad); the last is a hundred times the rounding of W."""


def structure(
    regressor: Regressor, torque_joints: Sequence[str], seed: int = 0, scale: RobotScale | None = None
) -> Reduction:
    """Base parameters of a robot with its effects, from random states; no log is needed.

    Parameters
    ----------
    torque_joints : sequence of str
        Joints whose torque is measured.
    scale : RobotScale, optional
        Units in which parameters are compared with one another; by default the robot's own.

    Returns
    -------
    Reduction
        Its `cost` says what merging costs.
    """
    scale = scale or RobotScale.of(regressor.robot)
    sizes = np.array([scale.size(column.unit) for column in regressor.columns])
    nominal = nominal_parameters(regressor.robot, regressor.effects) / sizes
    W = _random_rows(regressor, torque_joints, scale, seed) * sizes
    levels = _joint_levels(W, np.array([column.effect == "rigid" for column in regressor.columns]))
    W = W / levels[:, None, None]
    root = np.asarray(np.linalg.qr(W.reshape(-1, W.shape[2]), mode="r"))
    for tol in TOLERANCES:
        found = reduce(root, regressor.columns, tol=tol)
        cost = _cost(W, nominal, found)
        if cost <= MERGED_SHARE and _is_regular(root[:, list(found.base)], tol):
            break
    base = sizes[list(found.base)]
    return replace(found, mapping=base[:, None] * found.mapping / sizes, cost=cost)


def _is_regular(base: Array, tol: float) -> bool:
    """Whether base columns are independent. Columns that take part in a relation by less than its error can hide it."""
    values = np.linalg.svd(base / np.linalg.norm(base, axis=0), compute_uv=False)
    return bool(values[-1] > tol / 10.0 * values[0])


def _random_rows(regressor: Regressor, joints: Sequence[str], scale: RobotScale, seed: int) -> Array:
    """Rows of W at random states, shape (joints, N, C)."""
    robot = regressor.robot
    J, C = len(robot.joints), len(regressor.columns)
    rng = np.random.default_rng(seed)
    N = max(40, -(-3 * C // len(joints)))
    far = np.where(robot.prismatic, scale.length, 1.0)
    lower, upper = robot.limits.within(np.pi * far)
    q = rng.uniform(lower, upper, (N, J))
    # A third of √(g/L): gravity, centrifugal and inertial torques are then alike, at some 1 rad/s for an arm of 1 m.
    v, a = rng.normal(size=(2, N, J)) * far / (3.0 * scale.time)
    a /= scale.time
    # Unrelated states must be far apart in time; otherwise columns of rates of change become larger than all others.
    t = 0.5 * scale.time * np.arange(N, dtype=np.float64)
    channels = {name for effect in regressor.effects for name in effect.channels(robot)}
    extra = {name: 30.0 * rng.uniform(0.5, 1.5, N) for name in sorted(channels)}  # temperatures, °C
    index = [robot.joints.index(n) for n in joints]
    return np.ascontiguousarray(regressor(t, q, v, a, extra=extra)[:, :, index].transpose(2, 0, 1)).reshape(-1, N, C)


def _joint_levels(W: Array, rigid: Array) -> Array:
    """Norm of each joint's rigid columns, (joints,): the level of its torque. Without any, that of all columns."""
    own, every = np.linalg.norm(W[:, :, rigid], axis=(1, 2)), np.linalg.norm(W, axis=(1, 2))
    level = np.where(own > 0.0, own, every)
    return np.where(level > 0.0, level, 1.0)


def _cost(W: Array, nominal: Array, found: Reduction) -> float:
    """Largest share of a joint's torque that a reduction changes, for parameters of natural size and for the URDF's."""
    error = W - W[:, :, list(found.base)] @ found.mapping
    generic = np.linalg.norm(error, axis=(1, 2))
    felt = np.linalg.norm(W @ nominal, axis=1)
    own = np.linalg.norm(error @ nominal, axis=1)
    # A joint without torque (balanced, or without inertials) has no share of its own.
    counts = felt > np.sqrt(np.finfo(float).eps) * felt.max(initial=0.0)
    return float(max(generic.max(initial=0.0), (own[counts] / felt[counts]).max(initial=0.0)))
