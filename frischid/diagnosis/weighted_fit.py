"""Weighted least squares of a model's columns on all folds, and on all folds but one, with a prior.

Rows of joint j have weight ω_j = 1 / (σ_j² ℓ_j), with σ_j the standard deviation of the joint's residual and ℓ_j its
correlation time in samples, so that evidence counts in *effectively independent* samples. With a prior N(μ, Λ⁻¹),

    H = Σ_j ω_j Y_jᵀ Y_j + Λ,    θ = H⁻¹ (Σ_j ω_j Y_jᵀ τ_j + Λ μ).

A candidate is fitted beside these columns without solving for θ again (`candidate_fits`).

**A held-out error counts by its covariance.** The other folds predict fold f with parameters θ_f of precision H_f. So
the residual r_f has the covariance W⁻¹ + Y_f H_f⁻¹ Y_fᵀ, and not that of noise, W⁻¹ (W: the weights ω). A fold that
alone excites a parameter has a large r_f that proves nothing. With θ of all folds and the residual r of fold f under θ,

    r_fᵀ (W⁻¹ + Y_f H_f⁻¹ Y_fᵀ)⁻¹ r_f  =  r_fᵀ W r  =  rᵀ W r + (θ − θ_f)ᵀ H_f (θ − θ_f).

This is the error of fold f under the parameters of all folds, and what these parameters cost elsewhere. This cost
cannot be divided among the joints. So every joint gets the same share s of the difference between its two errors, with
s from the sum,

    Q_fj = ‖r_j‖² + s_f (‖r_fj‖² − ‖r_j‖²),     0 ≤ s_f ≤ ½     (½: the other folds determine all parameters).

**Known signs are bounds.** Dry and viscous friction, a spring of memory and many other coefficients have a known sign.
Where θ, or the coefficient of a candidate, would have an impossible sign, all are corrected together (`sign_bounds`),
for the model alone and with the candidate. So no candidate gains from other parameters that a refit would refuse.

**Weights come from residuals, and residuals from weights.** This iteration can have two ends. If the URDF is far from
the truth, a fit near the prior leaves a large and slow residual. Then the data get little weight, so the next fit is
near the prior again. From weights so large that the data alone decide, the iteration ends elsewhere. Both starts are
tried, and the fit that predicts the folds left out better is kept,

    minimum of  Σ_j N_j log Q_j,     Q_j = Σ_f Q_fj.

Source: Rasmussen and Williams 2006, Gaussian Processes for Machine Learning, section 5.4.2 (predictive likelihood).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy import linalg

from frischid.core.types import Array
from frischid.diagnosis.candidate_columns import Candidate
from frischid.diagnosis.model_columns import ModelColumns
from frischid.diagnosis.sign_bounds import multipliers
from frischid.estimators.autocorrelation import Autocorrelation
from frischid.estimators.least_squares import Prior

IN_SPAN = 1e-5  # a direction of a candidate with less of its squared norm outside the other columns is spanned by them
_TURNS = 4  # iterations of weights from residuals and residuals from weights
_FURTHER_TURNS = 2  # where a candidate was added: the weights are nearly known
(_potrs,) = linalg.get_lapack_funcs(("potrs",), dtype=np.float64)
_STARTS = (1.0, 0.01)  # first standard deviation of the residual over the torque's: the prior counts, the data alone do
_RIDGE = 1e-10  # share of each diagonal element of H that is added, against rounding


class System(NamedTuple):
    """Normal equations of the parameters on some folds, solved."""

    factor: tuple[Array, bool]
    """Cholesky factor of H."""
    theta: Array
    """Parameters, each of its known sign, (p,)."""
    free: Array
    """Parameters without regard to their signs, (p,)."""
    toward: Array
    """Columns of H⁻¹ of the m parameters of known sign, (p, m)."""
    rise: float
    """Weighted squared error of `theta` above that of `free`."""


@dataclass(frozen=True, eq=False)
class WeightedFit:
    """Fit of p columns on all folds, and on all folds but each one."""

    columns: ModelColumns
    prior: Prior
    omega: Array
    """Weight of each joint's squared residual, (J,)."""
    systems: list[System]
    """Without each fold in turn, then of everything."""
    sigma: Array
    """Standard deviation of each joint's residual, N·m (N), (J,)."""
    correlation: Array
    """Its correlation time in samples, (J,)."""

    @classmethod
    def of(cls, columns: ModelColumns, prior: Prior, spread: Array) -> WeightedFit:
        """Fit with weights from the fit's own residuals, by iteration from two starts.

        Parameters
        ----------
        spread : ndarray, shape (J,)
            Standard deviation of each joint's torque, N·m (N).
        """
        none = np.ones(len(spread))
        fits = [cls._settled(columns, prior, spread, (start * spread, none), _TURNS) for start in _STARTS]
        return min(fits, key=lambda fit: fit.held_out_cost)

    def extended(self, columns: ModelColumns, prior: Prior, spread: Array) -> WeightedFit:
        """Fit more columns, with weights that begin at this fit's."""
        return self._settled(columns, prior, spread, (self.sigma, self.correlation), _FURTHER_TURNS)

    @classmethod
    def _settled(
        cls, columns: ModelColumns, prior: Prior, spread: Array, start: tuple[Array, Array], turns: int
    ) -> WeightedFit:
        """Iterate weights and residuals from a first standard deviation and correlation time of each residual."""
        sigma, correlation = start
        for _ in range(turns):
            omega = 1.0 / (np.maximum(sigma, 1e-9 * spread) ** 2 * correlation)
            folds = range(columns.data.folds)
            weighted = np.tensordot(omega, columns.gram, axes=(0, 1))
            systems = [_solved(columns, weighted, prior, f) for f in (*folds, None)]
            left = [Autocorrelation.of(columns.residuals(row, systems[-1].theta)) for row in range(len(spread))]
            sigma, correlation = np.array([x.std for x in left]), np.array([x.time for x in left])
        return cls(columns, prior, omega, systems, sigma, correlation)

    @property
    def held_out_sse(self) -> Array:
        """Sum of squared residuals of each fold under the parameters fitted without this fold, (folds, J)."""
        d = np.column_stack([self.fold_theta, np.full(self.columns.data.folds, -1.0)])
        return np.asarray(np.einsum("fa,fjab,fb->fj", d, self.columns.gram, d))

    @cached_property
    def predictive_sse(self) -> Array:
        """`held_out_sse` without the error that uncertain parameters alone cause: Q, (folds, J)."""
        return np.array([predictive_squares(products, self.omega) for products in self._products])

    @cached_property
    def shares(self) -> Array:
        """Share s of each fold in the difference of its two errors that counts, (folds,)."""
        return np.array([counted_share(products, self.omega) for products in self._products])

    @cached_property
    def _products(self) -> Array:
        """Sums of products of two residuals of each fold, (folds, J, 2, 2): fitted to the other folds, and to all."""
        found = []
        for gram, theta in zip(self.columns.gram, self.fold_theta, strict=True):
            d = np.array([np.append(theta, -1.0), np.append(self.theta, -1.0)]).T
            found.append(d.T @ (gram @ d))
        return np.array(found)

    @property
    def held_out_cost(self) -> float:
        """Negative log likelihood of the folds left out, up to a constant: ``½ Σ_j N_j log Q_j``."""
        rows = self.columns.data.counts.sum(axis=0)
        return float(0.5 * rows @ np.log(np.maximum(self.predictive_sse.sum(axis=0), 1e-300)))

    @property
    def theta(self) -> Array:
        """Parameters fitted on everything, (p,)."""
        return self.systems[-1].theta

    @property
    def fold_theta(self) -> Array:
        """Parameters fitted without each fold in turn, (folds, p)."""
        return np.stack([system.theta for system in self.systems[:-1]])

    @property
    def information(self) -> Array:
        """Precision of the parameters given the data and the prior, (p, p)."""
        return np.asarray(np.einsum("j,fjab->ab", self.omega, self.columns.gram)[:-1, :-1] + self.prior.precision)

    @property
    def covariance(self) -> Array:
        """Covariance of the parameters given the data and the prior, (p, p): the inverse of H."""
        factor = self.systems[-1].factor
        return np.asarray(linalg.cho_solve(factor, np.eye(len(factor[0]))))

    @property
    def determined(self) -> Array:
        """Number of parameters that the rows of each joint determine, (J,): ``ν_j = tr(H⁻¹ ω_j Y_jᵀ Y_j)``."""
        rows = self.columns.gram[..., :-1, :-1]
        return np.asarray(self.omega * np.einsum("ab,fjba->j", self.covariance, rows))

    def eliminated(self, candidate: Candidate) -> tuple[Array, Array] | None:
        """Normal equations, (k, k) and (k,), of a candidate's columns of unit norm without the parameters.

        None when a column is zero.
        """
        system, (X, D), k = self.systems[-1], self.columns.moments(candidate), len(candidate.signs)
        A, e, own = np.zeros((len(system.free), k)), np.zeros(k), np.zeros((k, k))
        for row, x in X.items():
            cross = self.omega[row] * np.add.reduce(x)
            A += cross[:-1]
            e += cross[-1]
            own += self.omega[row] * np.add.reduce(D[row])
        scale = np.sqrt(own.diagonal())
        if not (scale > 0).all():
            return None
        return (own - A.T @ solve(system, A)) / (scale[:, None] * scale), (e - A.T @ system.free) / scale


def predictive_squares(products: Array, omega: Array) -> Array:
    """Q of each joint in a fold: its squared error without the error that uncertain parameters alone cause, (J,).

    Parameters
    ----------
    products : ndarray, shape (J, 2, 2)
        Sums of products of two residuals of the fold, under the fit to the other folds and under the fit to all.
    omega : ndarray, shape (J,)
        Weights.
    """
    held_out, inside = np.maximum(products[:, [0, 1], [0, 1]], 0.0).T
    return np.asarray(inside + counted_share(products, omega) * (held_out - inside))


def counted_share(products: Array, omega: Array) -> float:
    """Share s of the difference of a fold's two errors that counts; parameters as in `predictive_squares`."""
    held_out, inside = np.maximum(products[:, [0, 1], [0, 1]], 0.0).T
    pull, fall = float(omega @ (products[:, 0, 1] - inside)), float(omega @ (held_out - inside))
    return float(np.clip(pull / fall, 0.0, 0.5)) if fall > 0 else 0.0


def solve(system: System, right: Array) -> Array:
    """H⁻¹ times some columns, (p, m), as `cho_solve` does, without its checks: there are thousands of small ones."""
    return np.asarray(_potrs(system.factor[0], right, lower=system.factor[1])[0])


def _solved(columns: ModelColumns, weighted: Array, prior: Prior, left_out: int | None) -> System:
    """Solve the normal equations, whose moments ``weighted`` (folds, p + 1, p + 1) are summed over the joints."""
    M = weighted[[f for f in range(len(weighted)) if f != left_out]].sum(axis=0)
    H = M[:-1, :-1] + prior.precision
    b = M[:-1, -1] + prior.precision @ prior.mean
    H = H + _RIDGE * np.diag(np.diag(H) + 1e-300)
    factor = linalg.cho_factor(H)
    free, known = linalg.cho_solve(factor, b), columns.bounded
    toward, theta, rise = linalg.cho_solve(factor, np.eye(len(b))[:, known]), free, 0.0
    if (columns.signs[known] * free[known] < 0).any():
        push = multipliers(free[known], toward[known], columns.signs[known])
        theta, rise = free + toward @ push, float(push @ toward[known] @ push)
    return System(factor, theta, free, toward, rise)
