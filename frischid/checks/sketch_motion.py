"""The motion of a sketch, and all that follows from the motion alone: computed once for all hypotheses about torques.

Hundreds of hypotheses about a log differ in its torques or in a torque that is added, not in its motion. They share
the rigid torque, the torque of gravity along each axis, and the factored columns of each joint's own fit,

    min ‖A_j x − y‖,  x ≥ 0:      A_j = Q R,      ‖A_j x − y‖² = ‖R x − Qᵀy‖² + ‖y‖² − ‖Qᵀy‖²,

so that another right side y costs one product with Q and a fit of a few rows (Lawson and Hanson 1974, chapter 23).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from frischid.core.types import Array
from frischid.effects.state import SIGN_WIDTH
from frischid.robot.robot import Robot

SPRING: Final = "spring"
"""A torque in proportion to the joint's position."""
COUNTERBALANCE: Final = "counterbalance"
"""A torque that is a sine of the joint's angle, of any phase."""
MOTION_ARRAYS: Final = ("q", "v", "a", "sign", "used")
"""Arrays of a motion, (M, J)."""
Beside = Literal["spring", "counterbalance"] | int
"""A term fitted beside a joint's friction: a spring, a counterbalance, or the other joint that its motor turns."""


@dataclass(frozen=True, eq=False)
class SignedFit:
    """Least squares with coefficients that cannot be negative, on the samples `use`; factored for many right sides."""

    use: NDArray[np.bool_]
    Q: Array
    R: Array
    scale: Array

    @classmethod
    def of(cls, use: NDArray[np.bool_], columns: Array) -> SignedFit:
        """Factor the columns (M, P) on the samples `use` (M,)."""
        A = columns[use]
        scale = np.maximum(np.sqrt(np.einsum("np,np->p", A, A)), 1e-300)
        Q, R = np.linalg.qr(A / scale)
        return cls(use, Q, R, scale)

    def solve(self, y: Array) -> tuple[float, Array]:
        """RMS that the columns leave of a torque y at the used samples, and their coefficients."""
        b = self.Q.T @ y
        x, norm = nnls(self.R, b, maxiter=50 * self.R.shape[1])
        rest = max(float(y @ y) - float(b @ b), 0.0)
        return float(np.sqrt((norm**2 + rest) / len(y))), x / self.scale


@dataclass(frozen=True, eq=False)
class SketchMotion:
    """Filtered samples of the motion of one log. Its arrays must not change."""

    robot: Robot
    q: Array
    v: Array
    a: Array
    """`q`, `v`, `a`: Positions, velocities, accelerations, (M, J): rad, rad/s, rad/s² (m, ...)."""
    sign: Array
    """Smoothed sign of the velocity, filtered like the torque, (M, J)."""
    used: NDArray[np.bool_]
    """False where the joint stands still, (M, J)."""
    fewest_moving: int
    """A joint that moves in fewer samples is judged on all samples."""
    _thinned: dict[int, SketchMotion] = field(default_factory=dict, init=False, repr=False)
    _bodies: dict[str, Array] = field(default_factory=dict, init=False, repr=False)
    _columns: dict[tuple[int, Beside | None], Array] = field(default_factory=dict, init=False, repr=False)
    _fits: dict[tuple[int, Beside | None], SignedFit] = field(default_factory=dict, init=False, repr=False)

    def __len__(self) -> int:
        return len(self.q)

    def changed(self, **changes: Any) -> SketchMotion:
        """Another motion or robot. It shares the factored columns of every joint whose motion is the same."""
        other = replace(self, **changes)
        same = [(getattr(self, name) == getattr(other, name)).all(axis=0) for name in MOTION_ARRAYS]
        alike = np.logical_and.reduce(same)

        def shared(j: int, beside: Beside | None) -> bool:
            return bool(alike[j] and (not isinstance(beside, int) or alike[beside]))

        other._columns.update({key: x for key, x in self._columns.items() if shared(*key)})
        other._fits.update({key: x for key, x in self._fits.items() if shared(*key)})
        return other

    def thinned(self, every: int) -> SketchMotion:
        """Every n-th sample."""
        if every not in self._thinned:
            self._thinned[every] = replace(self, **{name: getattr(self, name)[::every] for name in MOTION_ARRAYS})
        return self._thinned[every]

    @cached_property
    def rigid(self) -> Array:
        """Rigid torque of the URDF's own parameters, (M, J)."""
        return self.robot.inverse_dynamics(self.q, self.v, self.a)

    @cached_property
    def gravity_torques(self) -> Array:
        """Torque of a gravity of 1 m/s² along each axis of the base, (3, M, J)."""
        still = np.zeros_like(self.q)
        turned = [replace(self.robot, gravity=(x, y, z)) for x, y, z in np.eye(3).tolist()]
        return np.array([robot.inverse_dynamics(self.q, still, still) for robot in turned])

    def regressor(self) -> Array:
        """Columns of all links' parameters, (M, C, J); not kept, because they are many."""
        Y = np.empty((len(self), len(self.robot.columns), len(self.robot.joints)))
        self.robot.regressor(self.q, self.v, self.a, Y)
        return Y

    def body(self, joint: str) -> Array:
        """Columns of the parameters of the link that a joint moves, (M, P, J)."""
        if joint not in self._bodies:
            own = [i for i, column in enumerate(self.robot.columns) if column.joint == joint]
            self._bodies[joint] = self.regressor()[:, own]
        return self._bodies[joint]

    def uses(self, j: int) -> NDArray[np.bool_]:
        """Samples on which joint j is judged, (M,)."""
        use = self.used[:, j]
        return use if use.sum() >= self.fewest_moving else np.ones(len(self), bool)

    def friction(self, j: int) -> Array:
        """Columns of the joint's own parameters: fv, fc, Ia ≥ 0, and the offset with both signs, (M, 5)."""
        return self.columns(j, None)

    def columns(self, j: int, beside: Beside | None) -> Array:
        """Columns of the joint's own parameters (None), or those of either sign that are fitted beside them, (M, P)."""
        if (j, beside) not in self._columns:
            self._columns[j, beside] = self._formed(j, beside)
        return self._columns[j, beside]

    def _formed(self, j: int, beside: Beside | None) -> Array:
        q, v, a = self.q[:, j], self.v[:, j], self.a[:, j]
        if beside is None:
            one = np.ones(len(self))
            return np.column_stack([v, self.sign[:, j], a, one, -one])
        if isinstance(beside, str):
            return q[:, None] if beside == SPRING else np.column_stack([np.sin(q), np.cos(q)])
        w = self.v[:, beside]
        both = [np.tanh((v + w) / SIGN_WIDTH), np.tanh((v - w) / SIGN_WIDTH)]
        return np.column_stack([w, self.a[:, beside], *both])

    def fit(self, j: int, beside: Beside | None = None) -> SignedFit:
        """The fit of joint j's friction, alone or beside further columns, which follow with both signs."""
        key = (j, beside)
        if key not in self._fits:
            own = self.friction(j)
            more = np.empty((len(self), 0)) if beside is None else self.columns(j, beside)
            self._fits[key] = SignedFit.of(self.uses(j), np.column_stack([own, more, -more]))
        return self._fits[key]
