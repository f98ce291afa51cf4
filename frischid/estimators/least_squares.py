"""Least squares from moments, with uncertainties that respect correlated residuals.

Ordinary and weighted least squares minimise ``Σ_j w_j Σ_k (τ_jk − y_jk θ)²``; with H = Σ_j w_j Y_jᵀY_j,

    θ = H⁻¹ Σ_j w_j Y_jᵀτ_j.

OLS has w = 1; WLS repeats w_j = 1/σ_j² with σ_j the joint's residual spread, so that a strong base joint does not drown
the wrist (Swevers, Verdonck and De Schutter 2007). Residuals of a robot are correlated over tenths of a second: what
the textbook σ²H⁻¹ says is several times too small. The covariance here is the delete-one-block jackknife,

    C = (B−1)/B Σ_b δ_b δ_bᵀ,   δ_b = θ − θ_(−b) = (H − H_b)⁻¹ s_b,   s_b = Σ_j w_j Y_jbᵀ(τ_jb − Y_jb θ),

which needs nothing but the blocks' moments, is right when blocks are longer than the correlation, and counts leverage
(Wu 1986, Annals of Statistics 14(4); CR3 of Cameron and Miller 2015).

A prior N(μ, Λ⁻¹) is a few more rows of data: ``H + Λ`` and ``Σ_j w_j Y_jᵀτ_j + Λμ`` (maximum a posteriori, MAP).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import linalg

from frischid.core.types import Array, Column
from frischid.errors import IdentifiabilityError
from frischid.regression.moments import Gram, total

WORST_CONDITION = 1e6  # of the column-scaled regressor; its square leaves four digits in the moments
JACKKNIFE_BLOCKS = 10  # of data below which their scatter says nothing of correlation
SINGULAR_PIVOT = 1e-7  # least pivot of a Cholesky factor over the largest, below which its matrix is taken as singular
ROUNDING_SHARE = 1e-9  # share of a joint's torque below which a residual is rounding, not noise
LEAST_RELATIVE_RESIDUAL = 1e-3  # a joint's relative residual counts as at least this share of the median joint's


@dataclass(frozen=True, eq=False)
class Estimate:
    """Estimated parameters and their uncertainty.

    Attributes
    ----------
    columns : tuple of Column
        What was estimated: names, units, joints, known signs.
    theta : ndarray, shape (p,)
    covariance : ndarray, shape (p, p)
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
        What the data say of the parameters, ``Σ_j Y_jᵀY_j / σ_j²`` divided by how much correlation inflates
        variances: the
        precision with which another log may take these values as given.
    notes : tuple of str
        What a reader must know to trust the numbers.
    from_data : ndarray, shape (p,), or None
        Share of what is known of each parameter that came from the logs, not from a prior:
        1 − posterior variance / prior variance. None: there was no prior, all came from the logs.
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

    def error_variance(self, Y: Array) -> Array:
        """Expected squared error of torque rows, ``σ_j² + y C yᵀ``.

        Parameters
        ----------
        Y : ndarray, shape (M, p, J)
            Base columns of the fitted joints.

        Returns
        -------
        ndarray, shape (M, J)
            (N·m)² (N²). With a prior, C holds the model's own error, and the formula holds away from the fitted motion
            too; without one, C is of noise alone.
        """
        spread = np.einsum("mpj,mpj->mj", Y, np.einsum("pr,mrj->mpj", self.covariance, Y, optimize=True))
        return np.asarray(np.maximum(spread, 0.0) + self.sigma**2)


@dataclass(frozen=True, eq=False)
class Prior:
    """Gaussian knowledge of p parameters.

    Attributes
    ----------
    mean : ndarray, shape (p,)
    precision : ndarray, shape (p, p)
        Inverse covariance.
    """

    mean: Array
    precision: Array

    @property
    def moments(self) -> Array:
        """Moments of rows of [Y τ] that say the same, shape (p + 1, p + 1)."""
        pull = self.precision @ self.mean
        return np.block([[self.precision, pull[:, None]], [pull[None, :], np.array([[self.mean @ pull]])]])


class NormalEquations:
    """``H θ = b`` on columns scaled to unit norm, with its conditioning tested.

    Parameters
    ----------
    moments : ndarray, shape (p + 1, p + 1)
        Weighted moments of [Y τ].
    names : sequence of str
        Parameter names, for the error.

    Raises
    ------
    IdentifiabilityError
        The data leave some combination of parameters undetermined; the message names its parameters.
    """

    def __init__(self, moments: Array, names: Sequence[str]) -> None:
        diagonal = np.sqrt(np.diag(moments)[:-1])
        if (diagonal == 0).any():
            blind = [n for n, d in zip(names, diagonal, strict=True) if d == 0]
            raise IdentifiabilityError(
                f"the log never excites {', '.join(blind)}; leave the effect out or move the joint"
            )
        self.scale = 1.0 / diagonal
        self.H = moments[:-1, :-1] * np.outer(self.scale, self.scale)
        values, vectors = linalg.eigh(self.H)
        self.condition = float(np.sqrt(values[-1] / max(values[0], 1e-300)))
        if self.condition > WORST_CONDITION:
            worst = np.abs(vectors[:, 0])
            blind = [names[i] for i in np.argsort(-worst)[:6] if worst[i] > 0.1 * worst.max()]
            raise IdentifiabilityError(
                f"this log cannot tell {', '.join(blind)} apart (condition number {self.condition:.1e} of the "
                "column-scaled regressor); record a motion that moves these joints more, or leave an effect out"
            )
        self.factor = linalg.cho_factor(self.H)
        self.theta = self.solve(moments[:-1, -1])

    def solve(self, b: Array) -> Array:
        """H⁻¹ b in the parameters' own units."""
        scaled = b * (self.scale if b.ndim == 1 else self.scale[:, None])
        x = linalg.cho_solve(self.factor, scaled)
        return np.asarray(x * (self.scale if b.ndim == 1 else self.scale[:, None]))

    @property
    def inverse(self) -> Array:
        """H⁻¹ in the parameters' own units, shape (p, p)."""
        return self.solve(np.eye(len(self.scale)))


def ols(blocks: Sequence[Gram]) -> Estimate:
    """Ordinary least squares over all joints' rows.

    Parameters
    ----------
    blocks : sequence of Gram
        Moments of consecutive stretches of time, base columns only.

    Raises
    ------
    IdentifiabilityError
        Fewer rows than parameters, or a direction the data do not determine.
    """
    return _finish(blocks, np.ones(len(blocks[0].joints)), "ols")


def wls(blocks: Sequence[Gram], iterations: int = 8, prior: Prior | None = None) -> Estimate:
    """Least squares with every joint weighted by its own residual variance, iterated; see `ols`.

    With a prior, maximum a posteriori; the covariance is then the posterior's, widened for correlated residuals.
    """
    whole = total(blocks)
    weights = np.ones(len(whole.joints))
    for _ in range(iterations):
        theta = _solve(whole, weights, prior).theta
        # a joint without a row (it rests throughout) has no variance and needs no weight
        updated = np.where(whole.counts > 0, 1.0 / np.maximum(_variance(whole, theta), 1e-150), 1.0)
        done = bool(np.allclose(updated, weights, rtol=1e-4))
        weights = updated
        if done:
            break
    return _finish(blocks, weights, "wls") if prior is None else _posterior(blocks, weights, prior)


def _variance(whole: Gram, theta: Array) -> Array:
    """Residual variance of each joint; the parameters are shared, so they cost each joint its share of them."""
    share = np.count_nonzero(np.diagonal(whole.moments, axis1=1, axis2=2)[:, :-1], axis=1) * len(theta)
    cost = share / max(1, share.sum())
    torque = np.maximum(whole.moments[:, -1, -1], 1e-300)
    left = whole.residual_ss(theta)
    # A joint that happens to fit exactly must not take all the weight and leave the others' parameters undetermined.
    floor = np.maximum(ROUNDING_SHARE, LEAST_RELATIVE_RESIDUAL * np.sqrt(np.median(left / torque))) ** 2 * torque
    return np.asarray(np.maximum(left, floor) / np.maximum(whole.counts - cost * len(theta), 1.0))


def _solve(whole: Gram, weights: Array, prior: Prior | None = None) -> NormalEquations:
    if prior is not None:
        return NormalEquations(whole.weighted(weights) + prior.moments, whole.names)
    if whole.rows < len(whole.columns) + 1:
        raise IdentifiabilityError(
            f"{whole.rows} torque rows cannot determine {len(whole.columns)} parameters; record longer, or raise the "
            "cut-off"
        )
    return NormalEquations(whole.weighted(weights), whole.names)


def _finish(blocks: Sequence[Gram], weights: Array, estimator: str) -> Estimate:
    whole = total(blocks)
    system = _solve(whole, weights)
    variance = _variance(whole, system.theta)
    covariance, notes = _jackknife(blocks, weights, system)
    if covariance is None:
        # Without enough blocks correlation cannot be measured: the textbook formula, and the reader is told.
        inside = np.einsum("j,jab->ab", weights**2 * variance, whole.moments[:, :-1, :-1])
        covariance = system.solve(system.solve(inside).T)
    plain = whole.weighted(1.0 / variance)[:-1, :-1]
    inflation = np.median(
        np.diag(covariance) / np.diag(NormalEquations(whole.weighted(1.0 / variance), whole.names).inverse)
    )
    return Estimate(
        whole.columns,
        system.theta,
        covariance,
        whole.joints,
        np.sqrt(variance),
        weights,
        system.condition,
        estimator,
        plain / max(1.0, float(inflation)),
        notes,
    )


def _posterior(blocks: Sequence[Gram], weights: Array, prior: Prior) -> Estimate:
    whole = total(blocks)
    system = _solve(whole, weights, prior)
    H, inverse = whole.weighted(weights)[:-1, :-1], system.inverse
    spread, notes = _jackknife(blocks, weights, system)
    # what correlation adds to the variance that the data cause, over what independent residuals would
    caused = np.diag(inverse @ H @ inverse)
    felt = caused > 1e-9 * np.diag(inverse)
    inflation = max(1.0, 1.0 if spread is None else float(np.median(np.diag(spread)[felt] / caused[felt])))
    before = np.diag(np.linalg.inv(prior.precision))
    return Estimate(
        whole.columns,
        system.theta,
        inflation * inverse,
        whole.joints,
        np.sqrt(_variance(whole, system.theta)),
        weights,
        system.condition,
        "map",
        np.asarray(np.linalg.inv(inverse) / inflation, dtype=float),
        notes,
        np.clip(1.0 - np.diag(inverse) / before, 0.0, 1.0),
    )


def _jackknife(blocks: Sequence[Gram], weights: Array, system: NormalEquations) -> tuple[Array | None, tuple[str, ...]]:
    if len(blocks) < JACKKNIFE_BLOCKS:
        short = f"only {len(blocks)} blocks of data: standard errors take residuals as uncorrelated and are too small"
        return None, (short,)
    changes = []
    for block in blocks:
        moments = block.weighted(weights)
        score = (moments[:-1, -1] - moments[:-1, :-1] @ system.theta) * system.scale
        rest = system.H - moments[:-1, :-1] * np.outer(system.scale, system.scale)
        try:
            factor, lower = linalg.cho_factor(rest, check_finite=False)
            if np.diag(factor).min() < SINGULAR_PIVOT * np.diag(factor).max():
                raise linalg.LinAlgError
            changes.append(linalg.cho_solve((factor, lower), score, check_finite=False) * system.scale)
        except linalg.LinAlgError:
            lost = (
                "one stretch of the log alone determines some parameter: standard errors take residuals as uncorrelated"
            )
            return None, (lost,)
    D = np.array(changes)
    return (len(blocks) - 1) / len(blocks) * D.T @ D, ()


def cross_validated(blocks: Sequence[Gram], estimate: Estimate, folds: int = 5, prior: Prior | None = None) -> Array:
    """Held-out residual variance of each joint from contiguous folds: moments subtract, so no data are needed again.

    Returns
    -------
    ndarray, shape (J,)
    """
    if len(blocks) < 2:
        raise IdentifiabilityError(
            "the log is too short to hold any of it out of the fit; record longer than two seconds"
        )
    whole = total(blocks)
    held = np.zeros(len(whole.joints))
    for fold in np.array_split(np.arange(len(blocks)), min(folds, len(blocks))):
        out = total(blocks[fold[0] : fold[-1] + 1])
        theta = _solve(whole - out, estimate.weights, prior).theta
        held += out.residual_ss(theta)
    return np.asarray(held / whole.counts)
