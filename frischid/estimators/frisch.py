"""The Frisch scheme: the set of parameters that are compatible with data in which *every* variable is noisy.

Least squares assigns all the misfit to the torque. Any other variable may carry the misfit, with another solution.
With the second moments of the p + 1 variables z = [Y τ] (torque last, index L = p)

    Σ = E[z zᵀ],   K = Σ⁻¹,   θ_ij = −K_ij / K_Lj   (i < p),   j = 0 … p,

column j is the least-squares solution in which variable j carries all the noise: one inverse gives all p + 1
of them, and j = L is ordinary least squares. When the noises are mutually independent, Σ = Σ̂ + diag(σ²)
with Σ̂ [θ; −1] = 0, and the set of all θ so explained is the simplex of these vertices **if and only if**
they lie in one orthant (each parameter keeps its sign from vertex to vertex). Otherwise the set is not
bounded by the vertices: some parameter is too weak for the noise.

References
----------
- R. Frisch, *Statistical confluence analysis by means of complete regression systems*, Oslo, 1934.
- R. E. Kalman, *Identification from real data*, in Current Developments in the Interface, 1982.
- S. Beghelli, R. Guidorzi, U. Soverini, *The Frisch scheme in dynamic system identification*, Automatica,
  1990.
- Massaroli et al., *Frisch Scheme Identification of Robots Dynamic Parameters* (Theorem 1).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from frischid.core.types import Array, Sign
from frischid.errors import EmptyBoxError, IdentifiabilityError, InputError

CONDITION_LIMIT = 1e12
"""Largest condition number of unit-diagonal moments that leaves a solution about four correct digits."""


@dataclass(frozen=True, eq=False)
class Box:
    """Bounds ``lower ≤ θ ≤ upper``, one interval per parameter; infinite where there is no bound.

    Attributes
    ----------
    names : tuple of str
        The p parameters.
    lower, upper : ndarray, shape (p,)
        Bounds in the parameters' units.

    Raises
    ------
    EmptyBoxError
        Some lower bound lies above its upper bound.
    InputError
        The bounds are not one number per parameter.
    """

    names: tuple[str, ...]
    lower: Array
    upper: Array

    def __post_init__(self) -> None:
        p = len(self.names)
        if self.lower.shape != (p,) or self.upper.shape != (p,):
            shapes = f"{self.lower.shape} and {self.upper.shape}"
            raise InputError(f"a box of {p} parameters needs bounds of shape ({p},), not {shapes}")
        unknown = np.isnan(self.lower) | np.isnan(self.upper)
        if unknown.any():
            raise InputError(f"a bound of {self.names[int(unknown.argmax())]} is NaN; use ±inf for no bound")
        crossed = self.lower > self.upper
        if crossed.any():
            i = int(crossed.argmax())
            raise EmptyBoxError(self.names[i], float(self.lower[i]), float(self.upper[i]))

    @classmethod
    def unbounded(cls, names: Sequence[str]) -> Box:
        """Return the box that allows everything."""
        return cls(tuple(names), np.full(len(names), -np.inf), np.full(len(names), np.inf))

    @property
    def width(self) -> Array:
        """Length of each interval, shape (p,)."""
        return self.upper - self.lower

    def contains(self, theta: Array, tol: float = 0.0) -> bool:
        """Whether `theta` lies in the box, to within `tol` (in each parameter's own unit)."""
        return bool(((theta >= self.lower - tol) & (theta <= self.upper + tol)).all())

    def informs(self, other: Box) -> NDArray[np.bool_]:
        """Whether each interval is bounded and narrower than that of `other`, shape (p,)."""
        return np.isfinite(self.width) & (self.width < other.width)

    def with_signs(self, signs: Sequence[Sign]) -> Box:
        """Start intervals at zero where a sign is known: +1 nonnegative, −1 nonpositive, 0 unknown."""
        if len(signs) != len(self.names):
            raise InputError(f"{len(signs)} signs given for {len(self.names)} parameters; give one each")
        sign = np.asarray(signs)
        lower = np.where(sign > 0, np.maximum(self.lower, 0.0), self.lower)
        upper = np.where(sign < 0, np.minimum(self.upper, 0.0), self.upper)
        return Box(self.names, lower, upper)


@dataclass(frozen=True, eq=False)
class Simplex:
    """The p + 1 least-squares solutions, one for each variable that may carry the noise."""

    names: tuple[str, ...]
    """The p parameters."""
    vertices: Array
    """Column j assigns all noise to variable j, (p, p + 1); the last column assigns it to the torque. Not finite where
    the torque does not enter the regression of variable j."""
    exact: bool
    """The torque is fitted to rounding: there is no noise, and all vertices are the same solution."""
    condition: float
    """Condition number of Σ scaled to unit diagonal (of its regressor block when `exact`)."""

    @property
    def ols(self) -> Array:
        """Ordinary least squares, the torque's vertex, shape (p,)."""
        return self.vertices[:, -1]

    @property
    def disagreeing(self) -> tuple[str, ...]:
        """Parameters whose sign changes from vertex to vertex.

        One parameter that is weaker than the noise can make all parameters change their sign.
        """
        signs = np.sign(self.vertices)
        agree = (signs == signs[:, -1:]).all(axis=1)
        return tuple(name for name, same in zip(self.names, agree, strict=True) if not same)

    @property
    def same_orthant(self) -> bool:
        """Whether Theorem 1 applies: then the set of compatible parameters is exactly this simplex."""
        return not self.disagreeing

    def box(self) -> Box:
        """Return the smallest box around the vertices, open for a parameter with a vertex at infinity."""
        return Box(self.names, *extent(self.vertices))


def simplex(moments: Array, names: Sequence[str]) -> Simplex:
    """All p + 1 least-squares solutions from one inverse.

    Parameters
    ----------
    moments : ndarray, shape (p + 1, p + 1)
        Sums or means ``Σ_k z_k z_kᵀ`` of z = [y τ], torque last (`Gram.weighted`).
    names : sequence of str
        The p parameters.

    Returns
    -------
    Simplex
        With every vertex equal to the least-squares solution, and `exact` set, when the data are noise-free.

    Raises
    ------
    IdentifiabilityError
        The regressor's columns are dependent, or one of them (or the torque) is zero throughout.
    InputError
        `moments` is not a moment matrix of p + 1 variables.
    """
    p = len(names)
    scaled, rms = unit_diagonal(moments, names)
    condition = _checked_condition(scaled[:p, :p], names)
    ols = np.linalg.solve(scaled[:p, :p], scaled[:p, p])
    residual = 1.0 - scaled[:p, p] @ ols  # of the torque's unit mean square
    # dᵀΣd with d = [θ; −1] cannot be told from zero below the rounding of Σ's unit-size entries
    rounding = 64 * (p + 1) * np.finfo(float).eps * (1.0 + np.abs(ols).sum()) ** 2
    if residual < -rounding:
        raise InputError(
            "the moments imply a negative squared error of the torque, so they are no sum over samples; check that "
            "only logs that had been added were subtracted"
        )
    exact = bool(residual <= rounding)
    if exact:
        vertices = np.repeat(ols[:, None], p + 1, axis=1)
    else:
        vertices = vertices_of(np.asarray(np.linalg.inv(scaled), dtype=float))
        condition = float(np.linalg.cond(scaled))
    return Simplex(tuple(names), vertices * (rms[p] / rms[:p, None]), exact, condition)


def vertices_of(K: Array) -> Array:
    """Vertices ``−K_ij / K_Lj`` of one inverse moment matrix (or a stack), shape (..., p, p + 1)."""
    with np.errstate(divide="ignore", invalid="ignore"):  # K_Lj = 0 puts vertex j at infinity
        return np.asarray(-K[..., :-1, :] / K[..., -1:, :])


def extent(vertices: Array) -> tuple[Array, Array]:
    """Smallest and largest value of each parameter over the vertices, each of shape (..., p)."""
    finite = np.isfinite(vertices).all(axis=-1)
    lower = np.where(finite, vertices.min(axis=-1), -np.inf)
    upper = np.where(finite, vertices.max(axis=-1), np.inf)
    return lower, upper


def unit_diagonal(moments: Array, names: Sequence[str]) -> tuple[Array, Array]:
    """Scale moments so that every variable has mean square one.

    Parameters
    ----------
    moments : ndarray, shape (p + 1, p + 1)

    Returns
    -------
    scaled : ndarray, shape (p + 1, p + 1)
        ``Σ_ij / (rms_i rms_j)``, free of units.
    rms : ndarray, shape (p + 1,)
        The scales; a scaled parameter φ is ``θ_i = φ_i rms_L / rms_i``.

    Raises
    ------
    InputError
        The matrix has another shape or is not finite.
    IdentifiabilityError
        A variable is zero throughout.
    """
    n = len(names) + 1
    if n == 1:
        raise InputError("there is no parameter to identify; select at least one column")
    if moments.shape != (n, n):
        raise InputError(f"{n - 1} parameters need moments of shape ({n}, {n}), not {moments.shape}")
    if not np.isfinite(moments).all():
        raise InputError("the moments hold NaN or infinity; check the log for missing samples")
    power = np.diagonal(moments)
    if not (power > 0).all():
        i = int((~(power > 0)).argmax())
        what = "the torque" if i == n - 1 else f"the column of parameter {names[i]}"
        raise IdentifiabilityError(f"{what} is zero in all samples; leave it out or record a richer motion")
    rms = np.sqrt(power)
    return moments / np.outer(rms, rms), rms


def _checked_condition(regressor: Array, names: Sequence[str]) -> float:
    """Condition number of the scaled regressor moments; names the culprits when it is too large."""
    eigenvalues, eigenvectors = np.linalg.eigh(regressor)
    condition = float(eigenvalues[-1] / eigenvalues[0]) if eigenvalues[0] > 0 else np.inf
    if condition > CONDITION_LIMIT:
        weight = np.abs(eigenvectors[:, 0])
        culprits = [names[i] for i in np.argsort(-weight)[:6] if weight[i] > 0.1 * weight.max()]
        raise IdentifiabilityError(
            f"the regressor's columns are linearly dependent (condition number {condition:.3g} of the scaled "
            f"moments, at most {CONDITION_LIMIT:.0e}), mostly {', '.join(culprits)}; reduce to base "
            "parameters, drop one of them, or record a richer motion"
        )
    return condition
