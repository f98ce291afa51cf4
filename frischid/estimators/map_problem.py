"""Least squares under a prior, over variables that are free or not negative.

    minimise ½ ‖Sx − t‖²,   SᵀS = H = Σ_j w_j AᵀG_jA + diag(prior precision),   θ_b = A x,   x_k ≥ 0 of known sign

A parameter with a negative side is the difference of two variables that are not negative.

Source: Stark and Parker 1995, Bounded-variable least squares, Computational Statistics 10.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, optimize

from frischid.core.types import Array
from frischid.errors import IdentifiabilityError
from frischid.estimators.parameter_prior import ParameterPrior
from frischid.regression.moments import Gram

UNDETERMINED = (
    "the logs and the prior together do not determine every parameter; record a motion that moves all joints, or "
    "leave an effect out"
)


class MapProblem:
    """The moments in terms of nonnegative and free variables x: θ_b = A x."""

    def __init__(self, whole: Gram, mapping: Array, prior: ParameterPrior) -> None:
        self.split = np.flatnonzero(prior.negative > 0)
        self.pick = np.hstack([np.eye(len(prior.names)), -np.eye(len(prior.names))[:, self.split]])  # θ = pick x
        self.A = mapping @ self.pick
        self.prior, self.counts = prior, np.maximum(whole.counts, 1.0)
        self.mean = np.append(prior.mean, np.zeros(len(self.split)))
        self.bounded = np.append(prior.nonnegative, np.ones(len(self.split), bool))
        self.bounded[self.split] = True  # the positive side of a difference
        self.groups = (*prior.group, *("" for _ in self.split))
        self.torque = whole.moments[:, -1, -1]
        self.moments, self.with_torque = whole.moments[:, :-1, :-1], whole.moments[:, :-1, -1]
        self.G, self.b = self.A.T @ self.moments @ self.A, self.with_torque @ self.A  # (J, m, m) and (J, m)

    def precision(self, scales: dict[str, float]) -> Array:
        """Prior precision of each variable at some scales, (m,)."""
        spread = np.append(self.prior.spread, self.prior.negative[self.split])
        return np.asarray(1.0 / (spread * [scales.get(g, 1.0) for g in self.groups]) ** 2)

    def squares(self, x: Array) -> Array:
        """Residual squares of each joint, (J,)."""
        return np.asarray(np.maximum(self.torque - 2 * self.b @ x + x @ (self.G @ x).T, 0.0))

    def rows(self, weights: Array, precision: Array, less: Gram | None = None) -> WeightedRows:
        """Log and prior as rows; without the rows of `less`."""
        moments, torque = np.tensordot(weights, self.moments, axes=1), weights @ self.with_torque
        if less is not None:
            left_out = less.weighted(weights)
            moments, torque = moments - left_out[:-1, :-1], torque - left_out[:-1, -1]
        root, target = _square_root(moments, torque)
        of_prior = np.sqrt(precision)
        return WeightedRows.of(
            np.vstack([root @ self.A, np.diag(of_prior)]), np.append(target, of_prior * self.mean), self.bounded
        )


@dataclass(frozen=True, eq=False)
class WeightedRows:
    """Rows S and their right-hand side t, with H = SᵀS and b = Sᵀt, as the triangle R and Qᵀt of S = QR.

    H itself is never formed: it squares the ratio of the log's weight to the prior's. On a log without noise, this
    ratio is 10⁸, and its square is beyond double precision.
    """

    triangle: Array
    """R, in columns of unit length, (m, m)."""
    target: Array
    """Qᵀt, (m,)."""
    scale: Array
    """A variable over its scaled one, (m,)."""
    bounded: NDArray[np.bool_]
    """Variables that are not negative, (m,)."""

    @classmethod
    def of(cls, rows: Array, target: Array, bounded: NDArray[np.bool_]) -> WeightedRows:
        """Reduce rows S (r, m) and t (r,) to a triangle."""
        scale, m = 1.0 / np.linalg.norm(rows, axis=0), rows.shape[1]
        reduced: Array = np.asarray(np.linalg.qr(np.column_stack([rows * scale, target]), mode="r"))
        return cls(reduced[:m, :m], reduced[:m, m], scale, bounded)

    def solve(self) -> Array:
        """Minimise ½ ‖Sx − t‖² over the variables' bounds, (m,)."""
        R, target = self.triangle, self.target
        if (np.abs(np.diag(R)) <= len(R) * np.finfo(float).eps).any():
            raise IdentifiabilityError(UNDETERMINED)
        return _nearest(R, target, self.bounded) * self.scale

    def root(self) -> Array:
        """L with ``L Lᵀ = H⁻¹``, (m, m)."""
        return np.asarray(linalg.solve_triangular(self.triangle, np.eye(len(self.scale))) * self.scale[:, None])

    def covariance(self, free: NDArray[np.bool_]) -> Array:
        """H⁻¹ of the free variables, (m, m); the others are certain."""
        part = WeightedRows.of(self.triangle[:, free] / self.scale[free], self.target, self.bounded[free])
        root = part.root()
        C = np.zeros((len(free),) * 2)
        C[np.ix_(free, free)] = root @ root.T
        return C

    def gradient(self, x: Array) -> Array:
        """H x − b, (m,)."""
        return np.asarray(self.triangle.T @ (self.triangle @ (x / self.scale) - self.target) / self.scale)

    @property
    def condition(self) -> float:
        """Square root of the condition number of H in columns of unit length."""
        return float(np.linalg.cond(self.triangle))


def _square_root(moments: Array, torque: Array) -> tuple[Array, Array]:
    """Rows F and right-hand side f with ``FᵀF`` = `moments` and ``Fᵀf`` = `torque`."""
    size = np.sqrt(np.diag(moments))
    size = np.where(size > 0, size, 1.0)
    values, axes = linalg.eigh(moments / np.outer(size, size))
    felt = values > len(values) * np.finfo(float).eps * values.max(initial=0.0)  # others are rounding
    root = np.sqrt(values[felt])
    return (root * axes[:, felt]).T * size, (axes[:, felt].T @ (torque / size)) / root


def bounded_minimum(H: Array, b: Array, bounded: NDArray[np.bool_]) -> Array:
    """Minimise ½ xᵀHx − bᵀx over x with x ≥ 0 where `bounded`.

    Raises
    ------
    IdentifiabilityError
        H is singular.
    """
    scale = 1.0 / np.sqrt(np.diag(H))
    try:
        L = linalg.cholesky(H * np.outer(scale, scale), lower=True)
    except linalg.LinAlgError as error:
        raise IdentifiabilityError(UNDETERMINED) from error
    return _nearest(L.T, linalg.solve_triangular(L, b * scale, lower=True), bounded) * scale


def _nearest(R: Array, target: Array, bounded: NDArray[np.bool_]) -> Array:
    """Minimise ‖R x − t‖ with a triangle R over x with x ≥ 0 where `bounded`.

    With the free variables first, the triangle of the bounded ones stands alone: they follow without the free ones
    (Lawson and Hanson 1974, "Solving Least Squares Problems", chapter 23), and the free ones from them.
    """
    x = linalg.solve_triangular(R, target)
    if (x[bounded] < 0).any():
        free, n = int((~bounded).sum()), len(target)
        order = np.argsort(bounded, kind="stable")
        triangle: Array = np.asarray(np.linalg.qr(np.column_stack([R[:, order], target]), mode="r"))
        x[order[free:]] = optimize.nnls(triangle[free:n, free:n], triangle[free:n, n], maxiter=50 * n)[0]
        left = triangle[:free, n] - triangle[:free, free:n] @ x[order[free:]]
        x[order[:free]] = linalg.solve_triangular(triangle[:free, :free], left)
    return np.asarray(x)
