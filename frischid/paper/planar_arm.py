"""The paper's planar arm with its nine base columns, as published and as corrected.

The torque of an arm with dependent columns Γ_l2 = Γ_l1 B is, with θ_d = θ_l1 + B θ_l2,

    Γ_l1 θ_l1 + Γ_l2 θ_l2 = Γ_l1 (θ_l1 + B θ_l2) = Γ_l1 θ_d.

So the base columns are the independent ones as they are, Γ_d = Γ_l1. Theorem 3, eq. (16), prints instead

    Γ_d = Γ_l1 + Γ_l2 Bᵀ        (in the paper's letters Γ_l1 − Γ_l2 (V21 V22⁻¹)ᵀ),

which counts the dependent columns a second time: `regrouping_error` measures by how much its torque is wrong. The
authors' code computes with (16), and with two different arms, neither of which is quite the one of the paper's text:

    Table 2          links of 0.5 m, gears of 0.1 and 0.1; dependent m1, m2, I1m
    Tables 3 and 4   links of 1 m, gears of 4 and 2; dependent m1, I1z, m2 r2x
                     with the reference values of the first arm, in the order of the table

"As published" follows the authors. "As corrected" takes Γ_d = Γ_l1 and one arm, `urdf/planar2_paper.urdf`, for all
tables. All columns come from the URDF through Pinocchio.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from frischid.core.types import Array, Sign
from frischid.effects import parse_effects
from frischid.motions.simulation import parameters_of
from frischid.paper.printed import PRINTED_PARAMETERS
from frischid.regression.base_parameters import Reduction
from frischid.regression.regressor import Regressor
from frischid.regression.structure import structure
from frischid.robot.robot import Robot
from frischid.robot.scale import SI

_ALONE = ("fv1", "fv2", "fc1", "fc2", "Im2")
_LINK = 'xyz="0.5 0 0"'  # how the URDF writes the length of its links
SIGNS: tuple[Sign, ...] = (1, 1, 1, 1, 1, 0, 0, 0, 0)
"""Parameters that the authors know to be positive: friction and the rotor inertia."""


@dataclass(frozen=True, eq=False)
class PlanarArm:
    """The arm, and the nine columns that the paper's torque is regressed on."""

    title: str
    regressor: Regressor
    """All columns, dependent ones included."""
    independent: tuple[str, ...]
    dependent: tuple[str, ...]
    """`independent`, `dependent`: Columns of Γ_l1 and Γ_l2."""
    as_printed: bool
    """Whether Γ_d is that of eq. (16) as printed."""
    theta: Array
    """True values, in the order of the paper's Table 3, (9,)."""

    @cached_property
    def names(self) -> tuple[str, ...]:
        """The nine columns, friction first."""
        return (*_ALONE, *self.independent)

    @cached_property
    def _index(self) -> dict[str, int]:
        return {column.name: i for i, column in enumerate(self.regressor.columns)}

    @cached_property
    def regrouping(self) -> Array:
        """B of Γ_l2 = Γ_l1 B, shape (4, 3), from random states: a property of the arm."""
        rng = np.random.default_rng(0)
        q, v, a = rng.normal(size=(3, 40, 2))
        Y = self._all_rows(np.arange(40.0), q, v, a)
        B = np.linalg.lstsq(self._of(Y, self.independent), self._of(Y, self.dependent))[0]
        return np.asarray(np.round(B, 12))

    def _all_rows(self, t: Array, q: Array, v: Array, a: Array) -> Array:
        """Every column, rows sample by sample, shape (2N, C)."""
        Y = self.regressor(t, q, v, a)
        return np.ascontiguousarray(Y.transpose(0, 2, 1)).reshape(-1, Y.shape[1])

    def _of(self, Y: Array, names: Sequence[str]) -> Array:
        return Y[:, [self._index[name] for name in names]]

    def rows(self, t: Array, q: Array, v: Array, a: Array) -> Array:
        """Base regressor, rows sample by sample, joint 1 before joint 2.

        Parameters
        ----------
        t : ndarray, shape (N,)
        q, v, a : ndarray, shape (N, 2)

        Returns
        -------
        ndarray, shape (2N, 9)
        """
        Y = self._all_rows(t, q, v, a)
        base = self._of(Y, self.independent)
        if self.as_printed:
            base = base + self._of(Y, self.dependent) @ self.regrouping.T
        return np.hstack([self._of(Y, _ALONE), base])


def _robot(length: float) -> Robot:
    robot = Robot.load("planar2_paper", frames="far_end", known={"my1": 0.0, "my2": 0.0})
    if length == 0.5:
        return robot
    return Robot.from_dict({**robot.to_dict(), "urdf": robot.urdf.replace(_LINK, f'xyz="{length:g} 0 0"')})


def _regressor(length: float, gears: tuple[float, float]) -> Regressor:
    rotors = ", ".join(f"rotor_inertia(coupled=true, ratio={k:g})@joint{j}" for j, k in enumerate(gears, start=1))
    return Regressor(_robot(length), parse_effects(f"viscous, coulomb(width=1e-6), {rotors}"))


def points_arm(*, as_published: bool) -> PlanarArm:
    """The arm of Table 2; corrected, it is the arm of all tables."""
    regressor = _regressor(0.5, (0.1, 0.1))
    printed = np.array([row.reference for row in PRINTED_PARAMETERS])
    independent, dependent = ("mx1", "Izz1", "mx2", "Izz2"), ("m1", "m2", "Im1")
    title = f"links of 0.5 m, gears of 0.1; eq. (16) {'as printed' if as_published else 'corrected'}"
    arm = PlanarArm(title, regressor, independent, dependent, as_published, printed)
    if as_published:
        return arm
    return PlanarArm(title, regressor, independent, dependent, False, _urdf_values(arm))


def study_arm(*, as_published: bool) -> PlanarArm:
    """The arm of the Monte Carlo study, Tables 3 and 4."""
    if not as_published:
        return points_arm(as_published=False)
    printed = np.array([row.reference for row in PRINTED_PARAMETERS])
    return PlanarArm(
        "links of 1 m, gears of 4 and 2; eq. (16) as printed",
        _regressor(1.0, (4.0, 2.0)),
        ("mx1", "Im1", "m2", "Izz2"),
        ("m1", "Izz1", "mx2"),
        True,
        printed,
    )


def reduction(arm: PlanarArm) -> Reduction:
    """Base parameters by frischid's own reduction (eqs. 11 to 15 and 17, and Γ_d = Γ_l1 in the place of 16), in SI."""
    return structure(arm.regressor, arm.regressor.robot.joints, scale=SI)


def _urdf_values(arm: PlanarArm) -> Array:
    """Base parameters of the URDF's links with the paper's rotors: θ_l1 + B θ_l2."""
    regressor = arm.regressor
    values = parameters_of(regressor.robot, regressor.effects, {"Im1": 12.10, "Im2": 21.18})
    theta = {column.name: float(x) for column, x in zip(regressor.columns, values, strict=True)}
    alone, first, second = (
        np.array([theta[name] for name in names]) for names in (_ALONE, arm.independent, arm.dependent)
    )
    return np.concatenate([alone, first + arm.regrouping @ second])


def regrouping_error(arm: PlanarArm, t: Array, q: Array, v: Array, a: Array) -> float:
    """Largest error of the base form's torque, as a share of the largest torque of all columns.

    Parameters
    ----------
    t : ndarray, shape (N,)
    q, v, a : ndarray, shape (N, 2)
    """
    rng = np.random.default_rng(1)
    names = (*_ALONE, *arm.independent, *arm.dependent)
    theta = rng.uniform(0.5, 2.0, len(names))
    full = arm._of(arm._all_rows(t, q, v, a), names) @ theta
    alone, first, second = np.split(theta, [len(_ALONE), len(_ALONE) + len(arm.independent)])
    base = arm.rows(t, q, v, a) @ np.concatenate([alone, first + arm.regrouping @ second])
    return float(np.abs(base - full).max() / np.abs(full).max())
