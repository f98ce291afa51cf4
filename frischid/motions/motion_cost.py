"""A criterion at the samples of a motion, with its gradient.

A cost f of the base regressor Π at N samples has a cheap gradient. The rows of a sample depend only on the 3J numbers
q, q̇, q̈ of that sample. So 3J displaced regressors give the derivative at all N samples at once,

    ∂f/∂(q, q̇, q̈) = ⟨∂f/∂Π, ∂Π⟩.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from frischid.core.types import Array
from frischid.effects import Effect
from frischid.errors import InputError
from frischid.motions.limits import STATE_STEP
from frischid.motions.optimality import UNSMOOTHED, Criterion
from frischid.regression.regressor import Regressor
from frischid.regression.structure import structure
from frischid.robot.robot import Robot
from frischid.robot.scale import SI


class Cost:
    """A criterion at the samples of a motion, with its gradient; `evaluations` counts regressors of all N samples.

    Parameters
    ----------
    t : ndarray, shape (N,)
        Times of the samples, s.
    seed : int
        Seed of the noise that a criterion may add.

    Raises
    ------
    InputError
        The samples are too few for the base parameters.
    """

    def __init__(self, robot: Robot, effects: Sequence[Effect], t: Array, criterion: Criterion, seed: int) -> None:
        self.regressor, self.criterion, self.t = Regressor(robot, effects), criterion, t
        # A criterion of columns that are not scaled means those of the URDF's own units.
        scale = None if criterion.scaled else SI
        reduction = structure(self.regressor, robot.joints, scale=scale)
        self.base = np.array(reduction.base)
        self.names = tuple(column.name for column in reduction.base_columns())
        rows = len(t) * len(robot.joints)
        if rows <= len(self.base):
            enough = -(-3 * len(self.base) // len(robot.joints))
            raise InputError(
                f"{len(t)} samples of {len(robot.joints)} joints give {rows} equations for {len(self.base)} base "
                f"parameters; use {enough} samples or more (family 'points', one point per second: a duration of "
                f"{enough - 1} s or more)"
            )
        shifts = criterion.displacements(len(t), len(robot.joints), seed)
        self.shifts = np.concatenate([np.zeros((1, *shifts.shape[1:])), shifts])
        self.evaluations = 0

    def __call__(self, states: Array, exponent: float = UNSMOOTHED) -> float:
        """Cost of q, q̇, q̈ at the samples, (3, N, J)."""
        return self.criterion(self._full(states)[:, :, self.base], exponent)[0]

    def base_regressor(self, t: Array, states: Array) -> Array:
        """Base regressor of q, q̇, q̈ at other times t, (3, M, J) states, shape (M, p, J)."""
        return np.asarray(self.regressor(t, *states)[:, self.base])

    def gradient(self, states: Array, exponent: float) -> tuple[float, Array]:
        """Cost, and its derivative with respect to the states, (3, N, J)."""
        here = self._full(states)
        cost, slope = self.criterion(here[:, :, self.base], exponent)
        direction = np.zeros_like(here)
        direction[:, :, self.base] = slope
        gradient = np.empty_like(states)
        there = np.empty_like(here)
        for order, j in np.ndindex(3, states.shape[2]):
            moved = states.copy()
            moved[order, :, j] += STATE_STEP
            change = np.subtract(self._full(moved, there), here, out=there)
            gradient[order, :, j] = np.einsum("dncj,dncj->n", change, direction) / STATE_STEP
        return cost, gradient

    def _full(self, states: Array, out: Array | None = None) -> Array:
        """Regressor at the motion and at its displaced copies, (1 + D, N, C, J)."""
        if out is None:
            out = np.empty((len(self.shifts), len(self.t), len(self.regressor.columns), states.shape[2]))
        for Y, shift in zip(out, self.shifts, strict=True):
            q, v, a = states + shift
            self.regressor(self.t, q, v, a, out=Y)
        self.evaluations += len(self.shifts)
        return out
