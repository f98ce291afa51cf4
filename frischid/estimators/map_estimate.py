"""Maximum a posteriori parameters: a prior that is always on, and data that count for no more than their motion shows.

    minimise  Σ_j κ / (n_j σ_j²) ‖τ_j − Y_j θ‖²  +  Σ_c (θ_c − μ_c)² / (s_l d_c)²   over   θ_c ≥ 0 of known sign

*Data.* A model is never exact. Its error is a function of the motion, so the error does not average out: twice as long
a log of the same motion repeats it. To second order in r effective shapes of the motion such an error can take
κ = r (r + 1) / 2 forms, and no log can tell it from the model's own columns in more than κ ways. So every joint's rows,
however many, count as κ rows. The shapes are counted on the joint's own columns, scaled to unit norm: with eigenvalues
λ of their correlation, r = (Σ λ)² / Σ λ² (the participation ratio). κ takes the median joint's r.

*Prior.* Each parameter has a mean μ and a standard deviation d. The scale s_l of a link says how good the prior is for
this link. It is read off the data by evidence (automatic relevance determination): with posterior covariance C of the
link's p_l parameters, ``s_l² = (Σ ((θ − μ)² + C_cc) / d² + ν) / (p_l + ν)``.

*Noise.* σ_j² is the residual variance, corrected for the γ_j of κ rows that the parameters used up. Where a
cross-validated fit with the unscaled prior has a smaller variance, σ_j² is that one.

Sources: MacKay 1992, Bayesian interpolation, Neural Computation 4(3), for evidence and γ; Tipping 2001, Sparse Bayesian
learning and the relevance vector machine, JMLR 1, for the scales; Stark and Parker 1995, Bounded-variable least
squares, Computational Statistics 10, for the signs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, optimize

from frischid.core.types import Array
from frischid.errors import IdentifiabilityError
from frischid.regression.moments import Gram, total

ROUNDS = 60
"""Most rounds of scales and noise; they settle in about ten."""
SETTLED = 1e-3
"""Relative change of scales and noise below which the rounds end."""
EXACT = 1e-10
"""Residual variance over the torque's power below which a joint fits exactly: rounding, not noise."""
HELD = 1e-4
"""Share of its standard deviation within which a parameter is held; its inverse leaves a parameter free."""
FOLDS = 5
"""Stretches of time that cross-validation leaves out in turn."""


@dataclass(frozen=True, eq=False)
class ParameterPrior:
    """What is known of C parameters before any log, each independent of the others.

    Attributes
    ----------
    names : tuple of str
    mean : ndarray, shape (C,)
        Each in its parameter's unit.
    spread : ndarray, shape (C,)
        Standard deviations d.
    group : tuple of str
        Link whose scale the parameter shares; empty for a parameter without a scale of its own.
    nonnegative : ndarray of bool, shape (C,)
        Parameters whose sign is known.
    negative : ndarray, shape (C,)
        Standard deviation on the negative side of a parameter that is positive as a rule but not by law; zero
        elsewhere. Such a parameter is the difference of two nonnegative ones.
    scales : dict of str to float
        Scale s of each group; those that are missing are 1.
    """

    names: tuple[str, ...]
    mean: Array
    spread: Array
    group: tuple[str, ...]
    nonnegative: NDArray[np.bool_]
    negative: Array
    scales: dict[str, float]

    @property
    def scaled_spread(self) -> Array:
        """Standard deviations at the groups' scales, shape (C,)."""
        return np.asarray(self.spread * [self.scales.get(g, 1.0) for g in self.group])

    @property
    def total_spread(self) -> Array:
        """Standard deviations with the negative side, shape (C,)."""
        return np.asarray(np.hypot(self.scaled_spread, self.negative))


@dataclass(frozen=True)
class ScaleRule:
    """How the scale of a link's prior follows from the data.

    Attributes
    ----------
    freedom : float
        ν, parameters' worth of belief that the scale is 1. Four of a link's ten parameters: a link that the log hardly
        moves keeps its scale.
    least, most : float
        Bounds of the scale: no URDF is right to three percent of its usual error, none is wrong by ten times.
    """

    freedom: float = 4.0
    least: float = 0.03
    most: float = 10.0


@dataclass(frozen=True, eq=False)
class MapEstimate:
    """Parameters under a prior, with a covariance that holds the model's own error.

    Attributes
    ----------
    theta : ndarray, shape (p,)
        Base parameters.
    covariance : ndarray, shape (p, p)
    full : ndarray, shape (C,)
        Every parameter of the prior.
    full_covariance : ndarray, shape (C, C)
    variance : ndarray, shape (J,)
        Residual variance σ² of each joint.
    rows : float
        κ, rows that each joint's data count for.
    prior : ParameterPrior
        With the scales that the data gave.
    condition : float
        Square root of the condition number of the scaled normal equations.
    contradicted : tuple of (str, float)
        Parameters of known sign that the data would rather give the other sign, by so many standard errors.
    """

    theta: Array
    covariance: Array
    full: Array
    full_covariance: Array
    variance: Array
    rows: float
    prior: ParameterPrior
    condition: float
    contradicted: tuple[tuple[str, float], ...]

    @property
    def from_log(self) -> Array:
        """Share of each parameter's knowledge that came from the log, 1 − posterior / prior variance, (C,)."""
        return np.asarray(np.clip(1.0 - np.diag(self.full_covariance) / self.prior.total_spread**2, 0.0, 1.0))


def shapes(correlated: Array) -> float:
    """Number of independent shapes among columns: the participation ratio of their correlation's eigenvalues.

    Parameters
    ----------
    correlated : ndarray, shape (C, C)
        Moments of the columns, YᵀY; columns of zeros do not count.

    Returns
    -------
    float
        1 when all columns are alike, their number when they are orthogonal, 0 when there is none.

    Examples
    --------
    >>> import numpy as np
    >>> from frischid.estimators.map_estimate import shapes
    >>> shapes(np.diag([1.0, 4.0, 0.0]))
    2.0
    """
    power = np.diag(correlated)
    felt = power > 1e-12 * power.max(initial=0.0)
    if not felt.any():
        return 0.0
    unit = correlated[np.ix_(felt, felt)] / np.sqrt(np.outer(power[felt], power[felt]))
    return float(np.trace(unit) ** 2 / np.sum(unit**2))


class _Problem:
    """The moments seen from nonnegative and free variables x: θ_b = A x."""

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
        """Of each variable under the prior at some scales, (m,)."""
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
        scale = 1.0 / np.sqrt(np.diag(H))
        try:
            L = linalg.cholesky(H * np.outer(scale, scale), lower=True)
        except linalg.LinAlgError as error:
            raise IdentifiabilityError("the log and the prior together leave a parameter undetermined") from error
        target = linalg.solve_triangular(L, b * scale, lower=True)
        x = linalg.solve_triangular(L, target, lower=True, trans="T")
        if (x[self.bounded] < 0).any():
            lower = np.where(self.bounded, 0.0, -np.inf)
            x = optimize.lsq_linear(L.T, target, (lower, np.inf), method="bvls").x
            x[self.bounded] = np.maximum(x[self.bounded], 0.0)
        return np.asarray(x * scale)

    def covariance(self, H: Array, free: NDArray[np.bool_] | None = None) -> Array:
        """H⁻¹, of the free variables only where they are given."""
        scale = 1.0 / np.sqrt(np.diag(H))
        kept = np.arange(len(H)) if free is None else np.flatnonzero(free)
        C = np.zeros_like(H)
        unit = (H * np.outer(scale, scale))[np.ix_(kept, kept)]
        C[np.ix_(kept, kept)] = linalg.cho_solve(linalg.cho_factor(unit), np.eye(len(kept)))
        return np.asarray(C * np.outer(scale, scale))


def map_estimate(
    blocks: Sequence[Gram], mapping: Array, prior: ParameterPrior, rule: ScaleRule | None = None
) -> MapEstimate:
    """Fit base parameters under a prior of all parameters.

    Parameters
    ----------
    blocks : sequence of Gram
        Moments of consecutive stretches of time, base columns only.
    mapping : ndarray, shape (p, C)
        Regrouping of all parameters into base parameters, ``θ_b = K θ``.
    prior : ParameterPrior
        At scale 1.
    rule : ScaleRule, optional

    Returns
    -------
    MapEstimate

    Raises
    ------
    IdentifiabilityError
        No joint has a torque row.
    """
    rule, whole = rule or ScaleRule(), total(blocks)
    if not whole.counts.any():
        raise IdentifiabilityError("no joint has a torque row: every joint rests, or the log is too short to filter")
    problem = _Problem(whole, mapping, prior)
    rows = effective_rows(problem.G[:, : len(prior.names), : len(prior.names)])
    floor = EXACT * problem.torque / problem.counts + 1e-300
    variance, limit = _first_noise(problem, blocks, floor)
    scales = {g: 1.0 for g in prior.group if g}
    for _ in range(ROUNDS):
        weights = rows / (problem.counts * variance)
        H, b = problem.normal(weights, problem.precision(scales))
        x = problem.solve(H, b)
        C = problem.covariance(H, ~problem.bounded | (x > 0))
        used = weights * np.einsum("jab,ba->j", problem.G, C)
        residual = problem.squares(x) / problem.counts * rows / np.maximum(rows - used, 0.05 * rows)
        updated = np.maximum(np.minimum(residual, limit), floor)
        fresh = _scales(problem, x, C, rule)
        done = np.allclose(updated, variance, rtol=SETTLED) and all(
            abs(fresh[g] - s) <= SETTLED * s for g, s in scales.items()
        )
        variance, scales = updated, fresh
        if done:
            break
    return _finish(problem, replace(prior, scales=scales), variance, rows)


def effects_alone(blocks: Sequence[Gram], mapping: Array, prior: ParameterPrior) -> Array:
    """Base parameters of the prior's links with nothing but friction and offsets fitted: what a careful user has.

    Parameters
    ----------
    blocks : sequence of Gram
        Base columns only.
    mapping : ndarray, shape (p, C)
    prior : ParameterPrior
        Links keep its mean; parameters with a negative side (rotors) stay at zero.

    Returns
    -------
    ndarray, shape (p,)
    """
    held = np.array([bool(g) for g in prior.group]) | (prior.negative > 0)
    spread = prior.spread * np.where(held, HELD, 1.0 / HELD)
    problem = _Problem(total(blocks), mapping, replace(prior, spread=spread, negative=np.zeros(len(spread))))
    precision = problem.precision({})
    floor = EXACT * problem.torque / problem.counts + 1e-300
    variance = np.maximum(0.1 * problem.torque / problem.counts, floor)
    for _ in range(6):
        x = problem.solve(*problem.normal(1.0 / variance, precision))
        variance = np.maximum(problem.squares(x) / problem.counts, floor)
    return np.asarray(problem.A @ x)


def effective_rows(G: Array) -> float:
    """κ, the rows that a joint's data count for, from the moments (J, m, m) of its columns; see the module's text."""
    found = [r for r in (shapes(g) for g in G) if r > 0]
    r = float(np.median(found)) if found else 1.0
    return r * (r + 1) / 2


def _first_noise(problem: _Problem, blocks: Sequence[Gram], floor: Array) -> tuple[Array, Array]:
    """Residual variances to start from, and the cross-validated ones that limit them, under the unscaled prior."""
    precision = problem.precision({})
    variance = np.maximum(0.1 * problem.torque / problem.counts, floor)
    for _ in range(6):
        x = problem.solve(*problem.normal(1.0 / variance, precision))
        variance = np.maximum(problem.squares(x) / problem.counts, floor)
    if len(blocks) < 2:
        return variance, np.full(len(variance), np.inf)
    return variance, np.maximum(_held_out(problem, blocks, 1.0 / variance, precision), floor)


def _held_out(problem: _Problem, blocks: Sequence[Gram], weights: Array, precision: Array) -> Array:
    """Residual variance of each joint on stretches left out of the fit in turn, (J,)."""
    squares = np.zeros(len(problem.counts))
    for fold in np.array_split(np.arange(len(blocks)), min(FOLDS, len(blocks))):
        out = total(blocks[fold[0] : fold[-1] + 1])
        kept = np.maximum(1.0 - out.counts / problem.counts, 1e-3)
        x = problem.solve(*problem.normal(weights / kept, precision, out))
        squares += out.residual_ss(problem.A @ x)
    return squares / problem.counts


def cross_validated_map(blocks: Sequence[Gram], mapping: Array, estimate: MapEstimate) -> Array:
    """Held-out residual variance of each joint under the estimate's prior, scales and noise.

    Parameters
    ----------
    blocks : sequence of Gram
        Those the estimate was made from; five contiguous parts of them are left out in turn.
    mapping : ndarray, shape (p, C)
    estimate : MapEstimate

    Returns
    -------
    ndarray, shape (J,)

    Raises
    ------
    IdentifiabilityError
        The log is too short to hold any of it out.
    """
    if len(blocks) < 2:
        raise IdentifiabilityError(
            "the log is too short to hold any of it out of the fit; record longer than two seconds"
        )
    problem = _Problem(total(blocks), mapping, estimate.prior)
    weights = estimate.rows / (problem.counts * estimate.variance)
    return _held_out(problem, blocks, weights, problem.precision(estimate.prior.scales))


def _scales(problem: _Problem, x: Array, C: Array, rule: ScaleRule) -> dict[str, float]:
    """Scale of each group by evidence."""
    prior, found = problem.prior, {}
    known = np.diag(C)[: len(prior.names)]
    off = ((x[: len(prior.names)] - prior.mean) ** 2 + known) / prior.spread**2
    for group in dict.fromkeys(g for g in prior.group if g):
        own = off[[g == group for g in prior.group]]
        squared = (own.sum() + rule.freedom) / (len(own) + rule.freedom)
        found[group] = float(np.clip(np.sqrt(squared), rule.least, rule.most))
    return found


def _finish(problem: _Problem, prior: ParameterPrior, variance: Array, rows: float) -> MapEstimate:
    weights = rows / (problem.counts * variance)
    H, b = problem.normal(weights, problem.precision(prior.scales))
    x, C = problem.solve(H, b), problem.covariance(H)  # a bound cuts the distribution off, it does not make it certain
    scale = 1.0 / np.sqrt(np.diag(H))
    values = linalg.eigvalsh(H * np.outer(scale, scale))
    return MapEstimate(
        problem.A @ x,
        problem.A @ C @ problem.A.T,
        problem.pick @ x,
        problem.pick @ C @ problem.pick.T,
        variance,
        rows,
        prior,
        float(np.sqrt(values[-1] / max(values[0], 1e-300))),
        _contradicted(problem, x, H, b, C),
    )


def _contradicted(problem: _Problem, x: Array, H: Array, b: Array, C: Array) -> tuple[tuple[str, float], ...]:
    """Parameters held at zero by their sign: how far beyond the data would put them, in standard errors."""
    found, push = [], H @ x - b
    for k, name in enumerate(problem.prior.names):
        if problem.prior.nonnegative[k] and x[k] <= 0 and push[k] > 0:
            among = (~problem.bounded) | (x > 0)
            among[k] = True
            alone = problem.covariance(H, among)[k, k]  # of this parameter with all others that are free
            found.append((name, float(push[k] * np.sqrt(alone))))
    return tuple(found)
