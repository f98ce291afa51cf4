"""Friction with memory in a simulation: Dahl's state z of a joint, moved along with the joint.

    f = c z,   dz/dq = (1 − z sgn q̇) / distance

The step of z is exact for the path of a step, as in `frischid.effects.friction_memory`. `hysteresis` replaces the part
fh of the dry friction by fh z; `cable_hose` adds kh q + fz z.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from frischid.core.types import Array
from frischid.effects import CableHose, Effect, Hysteresis
from frischid.robot.robot import Robot


class RememberedFriction:
    """Dahl friction of one effect with P sets of parameters.

    Parameters
    ----------
    values : ndarray, shape (P, columns)
        Coefficients of the effect's columns.
    """

    def __init__(self, robot: Robot, effect: Effect, values: Array) -> None:
        assert isinstance(effect, Hysteresis | CableHose)
        joints = [i for i, *_ in effect.acts_on(robot)]
        self.distance = effect.distance
        self.size, self.spring = np.zeros((2, len(values), len(robot.joints)))
        if isinstance(effect, Hysteresis):
            self.size[:, joints] = values
        else:
            self.spring[:, joints], self.size[:, joints] = np.split(values, 2, axis=1)
        self.replaces = isinstance(effect, Hysteresis)

    def reduce(self, which: NDArray[np.intp], forwards: Array, backwards: Array) -> None:
        """Take the part with memory off the dry friction, where the effect replaces that part."""
        if self.replaces:
            forwards -= self.size[which]
            backwards += self.size[which]

    def torque(self, which: NDArray[np.intp], q: Array, z: Array) -> Array:
        """Torque (K, J) at the state z, N·m (N)."""
        return np.asarray(self.spring[which] * q + self.size[which] * z)

    def slope(self, which: NDArray[np.intp], v: Array, z: Array) -> Array:
        """Stiffness ∂τ/∂q (K, J) of bent surfaces, N·m/rad (N/m)."""
        return np.asarray(self.spring[which] + self.size[which] * (1.0 - z * np.sign(v)) / self.distance)

    def moved(self, z: Array, path: Array) -> Array:
        """State after a path (K, J), rad (m)."""
        side = np.sign(path)
        return np.asarray(side - (side - z) * np.exp(-np.abs(path) / self.distance))


class _Build(Protocol):
    def __call__(self, robot: Robot, effect: Effect, values: Array) -> RememberedFriction: ...


REMEMBERED: dict[str, _Build] = {Hysteresis.id: RememberedFriction, CableHose.id: RememberedFriction}
"""Effects with memory that a simulation carries along: identifier -> its state."""
