"""Mass matrix of a model, from its regressor alone.

    M(q) e_k = τ(q, 0, e_k) − τ(q, 0, 0)

A robot has a positive definite M: its kinetic energy ½ q̇ᵀ M q̇ is positive. Identified parameters need not have one, and
then no motion follows from a torque.

Effects that remember, or that belong to the recording and not to the robot, are no part of M. Dry friction is no part
of M either, although its sign may follow the acceleration (`Coulomb.lead`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np

from frischid.core.types import Array
from frischid.effects import columns_of
from frischid.effects.state import NO_SIGN
from frischid.model.model import Model
from frischid.regression.regressor import Regressor
from frischid.robot.robot import Robot

POSES_DRAWN = 200
"""Poses drawn where there is no motion: where the inertia of some joint is negative, it is so at most poses."""

Poses = tuple[Array, Mapping[str, Array]]
"""Positions (N, J), rad (m), and the further channels (N,) or (N, J) that effects read."""


class LeastInertia(NamedTuple):
    """The least eigenvalue of a model's mass matrix at some poses."""

    value: float
    """kg·m² (kg)."""
    joint: str
    """The joint with the largest part in its eigenvector."""
    position: float
    """Of this joint, rad (m)."""
    share: float
    """Share of the poses at which the mass matrix is not positive definite."""


def mass_matrices(model: Model, poses: Poses) -> Array:
    """Mass matrices at N poses, shape (N, J, J), kg·m² (kg), of the J joints whose torque the model was fitted to."""
    (q, extra), robot, index = poses, model.robot, model.torque_index
    kept = [e for e in model.effects if not (e.memory or e.of_recording) and set(e.channels(robot)).issubset(extra)]
    effects = [e.with_sign_width(NO_SIGN) for e in kept]
    regressor, names = Regressor(robot, effects, model.reference), {c.name for c in columns_of(robot, effects)}
    columns = columns_of(robot, model.effects)
    theta = np.array([x for c, x in zip(columns, model.full_theta, strict=True) if c.name in names])
    t, still = np.zeros(len(q)), np.zeros_like(q)

    def torque(a: Array) -> Array:
        known, own = robot.known_torque(q, still, a), theta @ regressor(t, q, still, a, extra=dict(extra))
        return np.asarray(own if known is None else own + known)

    rest, units = torque(still), np.eye(len(robot.joints))
    M = np.stack([torque(still + units[k]) - rest for k in index], axis=2)[:, index]
    return np.asarray((M + M.transpose(0, 2, 1)) / 2.0)


def least_inertia(model: Model, poses: Iterable[Poses]) -> LeastInertia:
    """The least eigenvalue of the mass matrix at all of these poses, at least one."""
    found, wrong, count = LeastInertia(np.inf, "", 0.0, 0.0), 0, 0
    for some in poses:
        values, vectors = np.linalg.eigh(mass_matrices(model, some))
        worst = int(values[:, 0].argmin())
        k = int(np.abs(vectors[worst, :, 0]).argmax())
        wrong, count = wrong + int((values[:, 0] <= 0.0).sum()), count + len(values)
        if values[worst, 0] < found.value:
            position = float(some[0][worst, model.torque_index[k]])
            found = LeastInertia(float(values[worst, 0]), model.joints[k], position, 0.0)
    return found._replace(share=wrong / max(count, 1))


def drawn_poses(robot: Robot) -> Poses:
    """Poses within the joints' limits, at most half a turn from zero."""
    lower, upper = robot.limits.within(np.pi)
    return np.random.default_rng(0).uniform(lower, upper, (POSES_DRAWN, len(robot.joints))), {}
