"""Mass matrix and bias torque of links that may exist as base parameters only.

    τ = M(q) q̈ + h(q, q̇)

Pinocchio computes both from links (Featherstone 2008, chapter 6), but base parameters hold first moments without a
mass, and no Pinocchio model can hold such links. The torque depends on θ through W θ alone, with W the regressor of
many states. So any θ + n with W n = 0 has the same M and h. The one nearest to the URDF's links is taken,

    θ' = θ_URDF + V Vᵀ (θ − θ_URDF),   the columns of V span the rows of W,

whose masses are those of the URDF wherever no torque shows them.

Source: Gautier 1991, J. Robotic Systems 8(4), on the null space of W.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from frischid.core.types import Array
from frischid.robot.robot import Robot

ROUNDING_LEVEL = 1e-10
"""Singular value of W, relative to the largest, that is rounding: columns of unit norm."""
LEAST_MASS = 1e-6
"""kg. A lighter link of the URDF counts as one of 1 kg before the projection, so that its centre of mass is finite."""


class MassMatrices:
    """Mass matrices and bias torques of one robot with several sets of link parameters.

    Parameters
    ----------
    columns : ndarray, shape (P, R)
        Values of ``robot.columns``, one row per set of parameters. Known parameters keep their known values.

    Examples
    --------
    >>> import numpy as np
    >>> import frischid as fr
    >>> from frischid.robot.mass_matrix import MassMatrices
    >>> robot = fr.Robot.load("planar2")
    >>> rigid = MassMatrices(robot, robot.nominal[None])
    >>> M, h = rigid(np.zeros(1, int), np.ones((1, 2)), np.zeros((1, 2)))
    >>> bool(np.allclose(h, robot.inverse_dynamics(np.ones((1, 2)), np.zeros((1, 2)), np.zeros((1, 2)))))
    True
    """

    def __init__(self, robot: Robot, columns: Array) -> None:
        self.robot = robot
        self._models = [_pinocchio(robot, theta) for theta in _with_masses(robot, _whole(robot, columns))]
        followers = np.zeros((len(robot.bodies), len(robot.joints)))
        for row, name in enumerate(robot.bodies):
            rule = robot.mimics.get(name)
            leader = name if rule is None else rule.leader
            followers[row, robot.joints.index(leader)] = 1.0 if rule is None else rule.factor
        self._followers = followers if robot.mimics else None
        self._plain = self._followers is None and robot.model.nq == robot.model.nv

    def __call__(self, which: NDArray[np.intp], q: Array, v: Array) -> tuple[Array, Array]:
        """Mass matrix and bias torque of K states.

        Parameters
        ----------
        which : ndarray of int, shape (K,)
            Set of parameters of each state.
        q, v : ndarray, shape (K, J)
            Positions, rad (m), and velocities.

        Returns
        -------
        mass : ndarray, shape (K, J, J)
            kg·m² (kg).
        bias : ndarray, shape (K, J)
            Torque at zero acceleration, N·m (N).
        """
        x = np.ascontiguousarray(q) if self._plain else self.robot.configuration(q)
        rates = v if self._followers is None else self.robot.full_rates(v)
        L = len(self.robot.bodies)
        mass, bias = np.empty((len(q), L, L)), np.empty((len(q), L))
        for k, p in enumerate(which.tolist()):
            model, data = self._models[p]
            mass[k] = pin.crba(model, data, x[k])
            bias[k] = pin.nonLinearEffects(model, data, x[k], rates[k])
        if self._followers is None:
            return mass, bias
        return self._followers.T @ mass @ self._followers, bias @ self._followers

    def slopes(self, which: NDArray[np.intp], q: Array, v: Array, a: Array) -> tuple[Array, Array]:
        """Derivatives of the torque of the links by position and by velocity, each (K, J, J).

        Parameters
        ----------
        which : ndarray of int, shape (K,)
            Set of parameters of each state.
        q, v, a : ndarray, shape (K, J)
            Positions, rad (m), velocities and accelerations.
        """
        x = np.ascontiguousarray(q) if self._plain else self.robot.configuration(q)
        rates, seconds = (y if self._followers is None else self.robot.full_rates(y) for y in (v, a))
        L = len(self.robot.bodies)
        by_q, by_v = np.empty((2, len(q), L, L))
        for k, p in enumerate(which.tolist()):
            model, data = self._models[p]
            by_q[k], by_v[k], _ = pin.computeRNEADerivatives(model, data, x[k], rates[k], seconds[k])
        if self._followers is None:
            return by_q, by_v
        F = self._followers
        return F.T @ by_q @ F, F.T @ by_v @ F


def _whole(robot: Robot, columns: Array) -> Array:
    """Values of ``robot.all_names``, (P, 10 L), from those of ``robot.columns``."""
    out = np.empty((len(columns), len(robot.all_names)))
    unknown = {c.name: k for k, c in enumerate(robot.columns)}
    known: Mapping[str, float] = robot.known
    for place, name in enumerate(robot.all_names):
        out[:, place] = columns[:, unknown[name]] if name in unknown else known[name]
    return out


def _with_masses(robot: Robot, thetas: Array) -> Array:
    """Links of the same torque that are nearest to the URDF's, (P, 10 L)."""
    bare = replace(robot, known={})
    rng, J, R = np.random.default_rng(0), len(robot.joints), len(robot.all_names)
    lower, upper = robot.limits.within(np.pi)
    N = max(40, 3 * R // J + 1)
    Y = np.empty((N, R, J))
    v, a = rng.normal(size=(2, N, J))
    bare.regressor(rng.uniform(lower, upper, (N, J)), v, a, Y)
    W = Y.transpose(0, 2, 1).reshape(-1, R)
    scale = np.linalg.norm(W, axis=0)
    scale = np.where(scale > 0.0, scale, 1.0)
    _, sizes, rows = np.linalg.svd(W / scale, full_matrices=False)
    seen = rows[sizes > ROUNDING_LEVEL * sizes[0]] * scale  # rows that span those of W, in the parameters' units
    basis = np.linalg.qr(seen.T)[0]
    near = robot.nominal.reshape(-1, 10).copy()
    near[:, 0] = np.where(np.abs(near[:, 0]) < LEAST_MASS, 1.0, near[:, 0])
    home = near.ravel()
    return np.asarray(home + (thetas - home) @ basis @ basis.T)


def _pinocchio(robot: Robot, theta: Sequence[float] | Array) -> tuple[Any, Any]:
    model = robot.pinocchio(np.asarray(theta))
    return model, model.createData()
