"""Least squares from moments, with uncertainties that respect correlated residuals.

Ordinary and weighted least squares minimise ``Σ_j w_j Σ_k (τ_jk − y_jk θ)²``; with H = Σ_j w_j Y_jᵀY_j,

    θ = H⁻¹ Σ_j w_j Y_jᵀτ_j.

OLS has w = 1. WLS iterates w_j = 1/σ_j² with σ_j the joint's residual standard deviation, so that a strong base joint
does not hide the wrist (Swevers, Verdonck and De Schutter 2007). Residuals of a robot are correlated over tenths of a
second, so the textbook covariance σ²H⁻¹ is several times too small. The covariance here is the delete-one-block
jackknife,

    C = (B−1)/B Σ_b δ_b δ_bᵀ,   δ_b = θ − θ_(−b) = (H − H_b)⁻¹ s_b,   s_b = Σ_j w_j Y_jbᵀ(τ_jb − Y_jb θ),

which needs only the blocks' moments, is valid when blocks are longer than the correlation, and takes leverage into
account (Wu 1986, Annals of Statistics 14(4); CR3 of Cameron and Miller 2015). All parameters together say how far
correlation widens each variance (`frischid.estimators.moderation`).

A prior N(μ, Λ⁻¹) acts like further rows of data: ``H + Λ`` and ``Σ_j w_j Y_jᵀτ_j + Λμ`` (maximum a posteriori, MAP).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import linalg

from frischid.core.types import Array, Column
from frischid.errors import IdentifiabilityError
from frischid.estimators.held_out import Fold, held_out_stretches
from frischid.estimators.moderation import moderated, satterthwaite
from frischid.estimators.normal_equations import NormalEquations
from frischid.estimators.precision import precision_of
from frischid.regression.moment_blocks import total
from frischid.regression.moments import Gram

JACKKNIFE_BLOCKS = 10  # with fewer blocks of data, their scatter does not show the correlation
SINGULAR_PIVOT = 1e-7  # least pivot of a Cholesky factor over the largest, below which its matrix is taken as singular
WEIGHT_PASSES = 8  # iterations of the joints' weights at most
ROUNDING_SHARE = 1e-9  # share of a joint's torque below which a residual is rounding, not noise
HARDLY_KNOWN = 0.5  # share from the logs below, or standard error over value above, which a parameter is hardly known
LEAST_RELATIVE_RESIDUAL = 1e-3  # a joint's relative residual counts as at least this share of the median joint's


ESTIMATOR_TITLES = {
    "wls": "weighted least squares", "ols": "least squares", "map": "least squares with the URDF as a prior",
    "frisch": "point of the Frisch box by eq. (24)", "frisch_squared": "least squares in the Frisch box",
    "sensorwise": "sensor-wise Frisch scheme", "eiv": "errors in variables",
    "iv": "instrumental variables", "output_error": "output error of the simulated motion",
}  # fmt: skip
"""Each estimator in words; `map` is `wls` with a prior."""


@dataclass(frozen=True, eq=False)
class Estimate:
    """Estimated parameters and their uncertainty.

    Attributes
    ----------
    columns : tuple of Column
        The estimated columns: names, units, joints, known signs.
    theta : ndarray, shape (p,)
        Values, in the units of `columns`.
    covariance : ndarray, shape (p, p)
        Of `theta`, in products of these units.
    joints : tuple of str
        Joints whose torque was fitted.
    sigma : ndarray, shape (J,)
        Residual standard deviation of each joint, N·m (N), per sample kept.
    weights : ndarray, shape (J,)
        Weight of each joint's squared residual.
    condition : float
        Condition number of the column-scaled, weighted regressor.
    estimator : str
    information : ndarray, shape (p, p)
        Precision of the parameters from the data, ``Σ_j Y_jᵀY_j / σ_j²`` divided by the factor by which correlation
        inflates variances. Another fit may use it as the precision of a prior.
    notes : tuple of str
        Reasons to be careful with the numbers.
    from_data : ndarray, shape (p,), or None
        Share of each parameter's information that comes from the logs and not from a prior:
        1 − posterior variance / prior variance. None: there was no prior.
    """

    columns: tuple[Column, ...]
    theta: Array
    covariance: Array
    joints: tuple[str, ...]
    sigma: Array
    weights: Array
    condition: float
    estimator: str
    information: Array
    notes: tuple[str, ...] = ()
    from_data: Array | None = None

    def __repr__(self) -> str:
        count, joints = len(self.columns), len(self.joints)
        return (
            f"Estimate({self.estimator}: {count} parameters of {joints} joints, condition number {self.condition:.3g})"
        )

    @property
    def stderr(self) -> Array:
        """Standard error of each parameter, shape (p,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def hardly_known(self) -> tuple[str, ...]:
        """Names of the parameters that the logs say little of: less than half of what is known comes from them.

        Without a prior, those whose standard error is more than half of their value.
        """
        if self.from_data is not None:
            weak = self.from_data < HARDLY_KNOWN
        else:
            weak = self.stderr > HARDLY_KNOWN * np.abs(self.theta)
        return tuple(column.name for column, yes in zip(self.columns, weak, strict=True) if yes)

    def error_variance(self, Y: Array) -> Array:
        """Expected squared error of torque rows, ``σ_j² + y C yᵀ``.

        Parameters
        ----------
        Y : ndarray, shape (M, p, J)
            Base columns of the fitted joints.

        Returns
        -------
        ndarray, shape (M, J)
            (N·m)² (N²). With a prior, C contains the model's own error, so the formula is valid away from the fitted
            motion too; without a prior, C is that of noise alone.
        """
        return self.parameter_variance(Y) + self.sigma**2

    def parameter_variance(self, Y: Array) -> Array:
        """The part ``y C yᵀ`` of `error_variance`, which the uncertainty of the parameters causes, shape (M, J)."""
        rows = Y.transpose(0, 2, 1).reshape(-1, Y.shape[1])  # one product of matrices for all rows
        spread = np.einsum("rp,rp->r", rows @ self.covariance, rows).reshape(len(Y), -1)
        return np.asarray(np.maximum(spread, 0.0))


@dataclass(frozen=True, eq=False)
class Prior:
    """Gaussian prior of p parameters."""

    mean: Array
    """Shape (p,)."""
    precision: Array
    """Inverse covariance, (p, p)."""

    @property
    def moments(self) -> Array:
        """Moments of rows of [Y τ] with the same information, shape (p + 1, p + 1)."""
        pull = self.precision @ self.mean
        return np.block([[self.precision, pull[:, None]], [pull[None, :], np.array([[self.mean @ pull]])]])


def ols(blocks: Sequence[Gram]) -> Estimate:
    """Ordinary least squares over all joints' rows.

    Parameters
    ----------
    blocks : sequence of Gram
        Moments of consecutive stretches of time, base columns only.

    Raises
    ------
    IdentifiabilityError
        There are fewer rows than parameters, or the data do not determine some combination of parameters.
    """
    return _finish(blocks, np.ones(len(blocks[0].joints)), "ols")


def wls(blocks: Sequence[Gram], prior: Prior | None = None) -> Estimate:
    """Least squares with every joint weighted by its own residual variance, iterated; see `ols`.

    With a prior, maximum a posteriori; the covariance is then the posterior's, widened for correlated residuals.
    """
    weights = joint_weights(total(blocks), prior)
    return _finish(blocks, weights, "wls") if prior is None else _posterior(blocks, weights, prior)


def joint_weights(whole: Gram, prior: Prior | None = None) -> Array:
    """Weights of `wls`: the inverse of each joint's residual variance, (J,)."""
    weights = np.ones(len(whole.joints))
    for _ in range(WEIGHT_PASSES):
        theta = _solve(whole, weights, prior).theta
        updated = 1.0 / np.maximum(_variance(whole, theta), 1e-150)
        done = bool(np.allclose(updated, weights, rtol=1e-4))
        weights = updated
        if done:
            break
    return weights


def _variance(whole: Gram, theta: Array) -> Array:
    """Residual variance of each joint; the parameters are shared, so they cost each joint its share of them.

    A joint without a row (always at standstill) has none: its variance of 1 multiplies nothing.
    """
    seen = whole.counts > 0
    share = np.count_nonzero(np.diagonal(whole.moments, axis1=1, axis2=2)[:, :-1], axis=1) * len(theta)
    cost = share / max(1, share.sum())
    torque = np.maximum(whole.moments[:, -1, -1], 1e-300)
    left = whole.residual_ss(theta)
    # A joint that happens to fit exactly must not take all the weight and leave the others' parameters undetermined.
    usual = np.median((left / torque)[seen]) if seen.any() else 0.0
    floor = np.maximum(ROUNDING_SHARE, LEAST_RELATIVE_RESIDUAL * np.sqrt(usual)) ** 2 * torque
    return np.where(seen, np.maximum(left, floor) / np.maximum(whole.counts - cost * len(theta), 1.0), 1.0)


def _solve(whole: Gram, weights: Array, prior: Prior | None = None) -> NormalEquations:
    moments = whole.weighted(weights)
    if prior is not None:
        return NormalEquations(moments + prior.moments, whole.names)
    return _solved(moments, whole.names, whole.rows)


def _solved(moments: Array, names: tuple[str, ...], rows: int) -> NormalEquations:
    """The fit to weighted moments of so many torque rows."""
    if rows < len(names) + 1:
        raise IdentifiabilityError(
            f"{rows} torque rows cannot determine {len(names)} parameters; record longer, or raise the cut-off"
        )
    return NormalEquations(moments, names)


def _finish(blocks: Sequence[Gram], weights: Array, estimator: str) -> Estimate:
    whole = total(blocks)
    system = _solve(whole, weights)
    variance = _variance(whole, system.theta)
    covariance, notes = _jackknife(blocks, weights, system, weights**2 * variance)
    if covariance is None:
        # With too few blocks, correlation cannot be measured: the textbook formula is used, with a note.
        inside = np.einsum("j,jab->ab", weights**2 * variance, whole.moments[:, :-1, :-1])
        covariance = system.solve(system.solve(inside).T)
    plain = whole.weighted(1.0 / variance)[:-1, :-1]
    inflation = np.median(
        np.diag(covariance) / np.diag(NormalEquations(whole.weighted(1.0 / variance), whole.names).inverse)
    )
    return Estimate(
        columns=whole.columns,
        theta=system.theta,
        covariance=covariance,
        joints=whole.joints,
        sigma=np.sqrt(variance),
        weights=weights,
        condition=system.condition,
        estimator=estimator,
        information=plain / max(1.0, float(inflation)),
        notes=notes,
    )


def _posterior(blocks: Sequence[Gram], weights: Array, prior: Prior) -> Estimate:
    whole = total(blocks)
    system = _solve(whole, weights, prior)
    H, inverse = whole.weighted(weights)[:-1, :-1], system.inverse
    spread, notes = _jackknife(blocks, weights, system, weights**2 * _variance(whole, system.theta))
    # variance from the data with correlated residuals, over that with independent residuals
    caused = np.diag(inverse @ H @ inverse)
    felt = caused > 1e-9 * np.diag(inverse)
    inflation = max(1.0, 1.0 if spread is None else float(np.median(np.diag(spread)[felt] / caused[felt])))
    before = np.diag(np.linalg.inv(prior.precision))
    return Estimate(
        columns=whole.columns,
        theta=system.theta,
        covariance=inflation * inverse,
        joints=whole.joints,
        sigma=np.sqrt(_variance(whole, system.theta)),
        weights=weights,
        condition=system.condition,
        estimator="map",
        information=precision_of(inverse) / inflation,
        notes=notes,
        from_data=np.clip(1.0 - np.diag(inverse) / before, 0.0, 1.0),
    )


def _jackknife(
    blocks: Sequence[Gram], weights: Array, system: NormalEquations, inside: Array
) -> tuple[Array | None, tuple[str, ...]]:
    """Covariance from leaving out each block; `inside`: w²σ² of each joint, (J,)."""
    if len(blocks) < JACKKNIFE_BLOCKS:
        short = f"only {len(blocks)} blocks of data: standard errors take residuals as uncorrelated and are too small"
        return None, (short,)
    changes, expected = [], []
    unit = np.outer(system.scale, system.scale)
    for block in blocks:
        moments = block.weighted(weights)
        score = (moments[:-1, -1] - moments[:-1, :-1] @ system.theta) * system.scale
        try:
            factor, lower = linalg.cho_factor(system.H - moments[:-1, :-1] * unit, check_finite=False)
            if np.diag(factor).min() < SINGULAR_PIVOT * np.diag(factor).max():
                raise linalg.LinAlgError
            changes.append(linalg.cho_solve((factor, lower), score, check_finite=False) * system.scale)
        except linalg.LinAlgError:
            lost = (
                "one stretch of the log alone determines some parameter: standard errors take residuals as uncorrelated"
            )
            return None, (lost,)
        felt = np.tensordot(inside, block.moments[:, :-1, :-1], axes=1) * unit
        # The mean of δ_b δ_bᵀ for independent errors: H⁻¹ Var(Y_bᵀe_b) (H − H_b)⁻¹, as the fit makes residuals small.
        once = linalg.cho_solve((factor, lower), felt, check_finite=False)
        expected.append(np.diag(linalg.cho_solve(system.factor, once.T, check_finite=False)) * system.scale**2)
    D, shares = np.array(changes), np.maximum(np.array(expected), 0.0)
    found = (len(blocks) - 1) / len(blocks) * D.T @ D
    own, usual = np.diag(found), shares.sum(axis=0)
    said = (own > 0) & (usual > 0)  # the logs say nothing of the other parameters, and a prior alone holds them
    grow = np.ones(len(own))
    ratios = moderated(own[said] / usual[said], satterthwaite(shares[:, said] / usual[said]))
    grow[said] = np.sqrt(ratios * usual[said] / own[said])
    return found * np.outer(grow, grow), ()


def least_squares_folds(blocks: Sequence[Gram], weights: Array) -> tuple[Fold, ...]:
    """Fits without each stretch of time in turn, with these weights of the joints.

    Raises
    ------
    IdentifiabilityError
        The log is too short to hold any of it out, or the other stretches do not determine the parameters.
    """
    whole = total(blocks)
    every, folds = whole.weighted(weights), []
    for out in held_out_stretches(blocks):
        left = _solved(every - out.weighted(weights), whole.names, whole.rows - out.rows)
        folds.append(Fold(out, left.theta))
    return tuple(folds)
