"""Spinning rotors on moving links: the torque of a motor's rotor inertia, gyroscopic terms included.

A symmetric rotor of inertia I about its axis spins at ``ratio · q̇_i`` about joint i's axis z_i, mounted on link i−1.
Its angular momentum ``h = I ratio q̇_i z_i`` adds the torque z_j·ḣ to the joints j before i, and the torque balance of
the motor itself to joint i:

    row j < i:  I ratio (q̈_i z_j·z_i + q̇_i z_j·(ω_{i−1} × z_i))
    row i:      I (ratio² q̈_i + ratio z_i·ω̇_{i−1})

The inertia of the rotor when it does not spin against link i−1 belongs to the parameters of that link.

Source: L. Sciavicco, B. Siciliano and L. Villani, "Lagrange and Newton-Euler dynamic modeling of a gear-driven robot
manipulator with inclusion of motor inertia effects", Advanced Robotics 10(3), 1996.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from frischid.core.types import Array
from frischid.robot.robot import Robot


def rotor_coupling(robot: Robot, q: Array, v: Array, a: Array, joint: str, ratio: float) -> Array:
    """Torque of a unit rotor inertia carried by the previous link, on every joint.

    Parameters
    ----------
    q, v, a : ndarray, shape (N, J)
        Positions, rad (m), velocities and accelerations.
    joint : str
        The joint that the motor drives.
    ratio : float
        Turns of the rotor per turn of the joint.

    Returns
    -------
    ndarray, shape (N, J)
        Torque per motor-side rotor inertia, N·m/(kg·m²).
    """
    model, index = robot.model, robot.numbers[joint]
    axes = np.empty((len(q), 3, model.nv))
    for row, x in zip(axes, robot.configuration(q), strict=True):
        row[...] = pin.computeJointJacobians(model, robot.data, x).reshape(6, -1)[3:]  # flat for a single joint
    full_v, full_a = robot.full_rates(v)[:, :, None], robot.full_rates(a)[:, :, None]
    chain = [model.joints[k].idx_v for k in model.supports[index] if 0 < k < index]
    omega, alpha = np.zeros((2, len(q), 3))
    for k in chain:  # angular velocity and acceleration of the link that carries the motor
        alpha += axes[:, :, k] * full_a[:, k] + np.cross(omega, axes[:, :, k]) * full_v[:, k]
        omega += axes[:, :, k] * full_v[:, k]
    i = model.joints[index].idx_v
    axis = axes[:, :, i]
    rate = full_a[:, i] * axis + full_v[:, i] * np.cross(omega, axis)
    out = np.zeros((len(q), model.nv))
    out[:, chain] = ratio * np.einsum("nck,nc->nk", axes[:, :, chain], rate)
    out[:, i] = ratio**2 * full_a[:, i, 0] + ratio * np.einsum("nc,nc->n", axis, alpha)
    return robot.project(out, axis=1)
