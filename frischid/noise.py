"""What the sensors alone would leave: the floor below which no model can push the error.

A torque row's noise after the parallel filter F has two sources, both read off the log itself (see `noise_level`):

    floor_j² = σ_τj² ‖h‖²  +  Σ_i M̄_ji² σ_qi² ‖h * d₂‖²

with h the filter's taps, d₂ those of the second derivative, and M̄_ji² the mean square of the mass matrix along the
motion: noise of the positions reaches the torque mostly through the accelerations. It is a floor of *white* noise:
drives
whose torque wanders slowly have a higher one, and the difference then counts as unexplained.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pinocchio as pin

from frischid.gram import Array
from frischid.model import Model
from frischid.signals import Motion, derivative_taps, noise_level

POSES = 30


def noise_floor(model: Model, motions: Iterable[Motion]) -> Array:
    """Standard deviation of each fitted joint's filtered torque that sensor noise explains, N·m (N), shape (J,)."""
    total, count = np.zeros(len(model.joints)), 0
    for motion in motions:
        total += len(motion.t) * noise_variance(model, motion)
        count += len(motion.t)
    return np.asarray(np.sqrt(total / count))


def noise_variance(model: Model, motion: Motion) -> Array:
    """Squared noise floor of one motion, shape (J,)."""
    index = model.torque_index
    taps = model.lowpass.taps(motion.step)
    second = np.convolve(taps, derivative_taps(2, motion.step, model.lowpass.cutoff))
    torque = noise_level(motion.tau[:, index]) * np.linalg.norm(taps)
    acceleration = noise_level(motion.q) * np.linalg.norm(second)
    return np.asarray(torque**2 + _mean_square_mass(model, motion)[index] @ acceleration**2)


def _mean_square_mass(model: Model, motion: Motion) -> Array:
    """Mean of the squared entries of the nominal mass matrix over some poses of a motion, (J, J)."""
    robot = model.robot
    poses = np.linspace(0, len(motion.t) - 1, min(POSES, len(motion.t))).astype(int)
    total = np.zeros((len(robot.joints), len(robot.joints)))
    for q in robot.configuration(motion.q[poses]):
        mass = pin.crba(robot.model, robot.data, q)
        mass = np.triu(mass) + np.triu(mass, 1).T
        total += robot.project_mass(mass) ** 2
    return total / len(poses)
