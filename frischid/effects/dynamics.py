"""Rigid-body torque of reference parameters, and its derivatives by the state and by gravity.

A flexible joint, a gap or a tilted base moves the links by a small δ away from the measured positions. To first order

    Δτ = ∂τ/∂q δ + ∂τ/∂q̇ δ̇ + M δ̈,

with the derivatives of inverse dynamics that Pinocchio has in closed form (Carpentier and Mansard 2018, RSS). The
reference may be identified base parameters. They contain links with first moments but without mass, and no Pinocchio
model can hold such links. But torque is linear in θ. A point mass θ_c on every joint, large enough to keep all masses
positive, gives

    τ(θ) = τ(θ + θ_c) − τ(θ_c),   and the same for every derivative.

Where every link has its own mass, θ alone is such a model.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from frischid.core.types import Array
from frischid.robot.robot import Robot

LEAST_FELT = 1e-9  # N·m; a torque up to this size counts as zero
OWN_MASS = 1e-3  # share of the heaviest mass from which a centre of mass loses at most three digits to rounding


class Slopes(NamedTuple):
    """Derivatives of the torque by position, velocity and acceleration, each (N, J, J): torque row, joint moved."""

    position: Array
    velocity: Array
    acceleration: Array


@dataclass(frozen=True, eq=False)
class RigidDynamics:
    """Rigid-body torque of any parameters.

    Attributes
    ----------
    theta : ndarray, shape (10 L,)
        Values of ``robot.all_names``, in the user's frames.
    """

    robot: Robot
    theta: Array

    @classmethod
    def of(cls, robot: Robot, reference: Array | None = None) -> RigidDynamics:
        """Dynamics with values of ``robot.columns`` (None: the URDF's values), and the robot's known parameters."""
        values = dict(zip(robot.all_names, robot.nominal, strict=True))
        if reference is not None:
            values |= dict(zip((c.name for c in robot.columns), reference, strict=True))
        return cls(robot, np.array(list((values | dict(robot.known)).values())))

    @classmethod
    def generic(cls, robot: Robot) -> RigidDynamics:
        """Dynamics of generic parameters: where their torque is zero, the torque of any parameters is zero."""
        return cls(robot, np.random.default_rng(0).normal(size=len(robot.all_names)))

    @cached_property
    def _models(self) -> tuple[tuple[float, Any], ...]:
        """The one or two models whose difference has the parameters `theta`, each with its sign."""
        blocks = self.theta.reshape(-1, 10)
        if self.robot.transforms is not None:
            blocks = (self.robot.transforms @ blocks[:, :, None])[:, :, 0]
        masses, point = blocks[:, 0], np.zeros(10)
        if (masses > OWN_MASS * np.abs(masses).max()).all():
            return ((1.0, self._with(blocks)),)
        point[0] = 1.0 + np.abs(masses).max()
        return (1.0, self._with(blocks + point)), (-1.0, self._with(np.tile(point, (len(blocks), 1))))

    def _with(self, blocks: Array) -> Any:
        """The robot's Pinocchio model with these links (L, 10), and without rotors."""
        model = self.robot.model.copy()
        model.armature = np.zeros(model.nv)
        for index, block in enumerate(blocks, start=1):
            model.inertias[index] = pin.Inertia.FromDynamicParameters(block)
        return model

    @cached_property
    def _followers(self) -> Array:
        """Speed of every body's joint per speed of each independent joint, (L, J): mimic joints follow."""
        robot = self.robot
        out = np.zeros((len(robot.bodies), len(robot.joints)))
        for row, name in enumerate(robot.bodies):
            leader, factor, _ = robot.mimics.get(name, (name, 1.0, 0.0))
            out[row, robot.joints.index(leader)] = factor
        return out

    def torque(self, q: Array, v: Array, a: Array) -> Array:
        """Torque (N, J) of a motion, N·m (N)."""
        G = self._followers
        states = (self.robot.configuration(q), v @ G.T, a @ G.T)
        columns, out = [np.asfortranarray(x.T) for x in states], np.zeros((len(G), len(q)))
        for sign, model in self._models if len(q) else ():
            if hasattr(pin, "rneaInParallel"):  # one call for all samples, on one thread, costs half of a call for each
                found = pin.rneaInParallel(1, pin.ModelPool(model, 1), *columns)
            else:  # a Pinocchio without OpenMP
                data = model.createData()
                found = np.array([pin.rnea(model, data, *state) for state in zip(*states, strict=True)]).T
            out += sign * found.reshape(out.shape)  # one row or column comes as a vector
        return np.asarray(out.T @ G)

    def gravity_torque(self, q: Array, gravity: Array) -> Array:
        """Torque (N, J) that holds the arm still under a gravity vector in the base frame, m/s²."""
        still = np.zeros(q.shape)
        try:
            for _, model in self._models:
                model.gravity.linear = gravity
            return self.torque(q, still, still)
        finally:
            for _, model in self._models:
                model.gravity.linear = np.array(self.robot.gravity)

    def slopes(self, q: Array, v: Array, a: Array) -> Slopes:
        """Derivatives of the torque along a motion."""
        G = self._followers
        states = (self.robot.configuration(q), v @ G.T, a @ G.T)
        found = np.zeros((3, len(q), len(G), len(G)))
        for sign, model in self._models:
            data, here = model.createData(), np.empty(found.shape)
            position, velocity, acceleration = here
            for n, state in enumerate(zip(*states, strict=True)):
                position[n], velocity[n], acceleration[n] = pin.computeRNEADerivatives(model, data, *state)
            found += sign * here
        return Slopes(*(G.T @ found @ G))

    @cached_property
    def spread(self) -> Array:
        """Typical size (J,) of the torque, N·m (N): its standard deviation over all poses in moderate motion."""
        q, v, a = random_states(self.robot, 64)
        return np.asarray(self.torque(q, v, 2.0 * a).std(axis=0))

    @cached_property
    def inertia(self) -> Array:
        """Mean inertia (J,) about each joint over all poses, kg·m² (kg)."""
        mean = np.diagonal(self.slopes(*random_states(self.robot, 64)).acceleration, axis1=1, axis2=2).mean(axis=0)
        return np.asarray(np.maximum(mean, 1e-12))


def random_states(robot: Robot, count: int) -> tuple[Array, Array, Array]:
    """Random positions within the limits, velocities and accelerations, the same in every call; each (count, J)."""
    rng = np.random.default_rng(0)
    lower, upper = robot.limits.within(np.pi)
    q = rng.uniform(lower, upper, (count, len(robot.joints)))
    v, a = rng.normal(size=(2, *q.shape))
    return q, v, a


@lru_cache(maxsize=64)
def felt_slopes(robot: Robot) -> NDArray[np.bool_]:
    """Whether the torque of a joint (row) depends on the position of a joint (column), (J, J)."""
    slopes = RigidDynamics.generic(robot).slopes(*random_states(robot, 8))
    return np.asarray((np.abs(slopes.position) > LEAST_FELT).any(axis=0))
