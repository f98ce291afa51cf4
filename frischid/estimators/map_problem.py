"""Normal equations under a prior, over variables that are free or not negative.

    minimise ½ xᵀHx − bᵀx,   H = Σ_j w_j AᵀG_jA + diag(prior precision),   θ_b = A x,   x_k ≥ 0 of known sign

A parameter with a negative side is the difference of two variables that are not negative.

Source: Stark and Parker 1995, Bounded-variable least squares, Computational Statistics 10.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, optimize

from frischid.core.types import Array
from frischid.errors import IdentifiabilityError
from frischid.estimators.parameter_prior import ParameterPrior
from frischid.regression.moments import Gram


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
        self.G, self.b = self.seen(whole)

    def seen(self, gram: Gram) -> tuple[Array, Array]:
        """Moments of the columns (J, m, m) and with the torque (J, m)."""
        A, moments = self.A, gram.moments
        return A.T @ moments[:, :-1, :-1] @ A, moments[:, :-1, -1] @ A

    def precision(self, scales: dict[str, float]) -> Array:
        """Prior precision of each variable at some scales, (m,)."""
        spread = np.append(self.prior.spread, self.prior.negative[self.split])
        return np.asarray(1.0 / (spread * [scales.get(g, 1.0) for g in self.groups]) ** 2)

    def squares(self, x: Array) -> Array:
        """Residual squares of each joint, (J,)."""
        return np.asarray(np.maximum(self.torque - 2 * self.b @ x + x @ (self.G @ x).T, 0.0))

    def normal(self, weights: Array, precision: Array, less: Gram | None = None) -> tuple[Array, Array]:
        """Normal equations, (m, m) and (m,); without the rows of `less`."""
        G, b = self.G, self.b
        if less is not None:
            out = self.seen(less)
            G, b = G - out[0], b - out[1]
        return np.einsum("j,jab->ab", weights, G) + np.diag(precision), weights @ b + precision * self.mean

    def solve(self, H: Array, b: Array) -> Array:
        """Minimise ½ xᵀHx − bᵀx over the variables' bounds."""
        return bounded_minimum(H, b, self.bounded)

    def covariance(self, H: Array, free: NDArray[np.bool_] | None = None) -> Array:
        """H⁻¹, of the free variables only where they are given."""
        scale = 1.0 / np.sqrt(np.diag(H))
        kept = np.arange(len(H)) if free is None else np.flatnonzero(free)
        C = np.zeros_like(H)
        unit = (H * np.outer(scale, scale))[np.ix_(kept, kept)]
        C[np.ix_(kept, kept)] = linalg.cho_solve(linalg.cho_factor(unit), np.eye(len(kept)))
        return np.asarray(C * np.outer(scale, scale))


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
        raise IdentifiabilityError("the log and the prior together leave a parameter undetermined") from error
    target = linalg.solve_triangular(L, b * scale, lower=True)
    x = linalg.solve_triangular(L, target, lower=True, trans="T")
    if (x[bounded] < 0).any():
        lower = np.where(bounded, 0.0, -np.inf)
        x = optimize.lsq_linear(L.T, target, (lower, np.inf), method="bvls").x
        x[bounded] = np.maximum(x[bounded], 0.0)
    return np.asarray(x * scale)
