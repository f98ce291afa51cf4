"""Maximum a posteriori parameters: with a prior, and with data that count as many rows as their motion has shapes.

    minimise  Σ_j κ / (n_j σ_j²) ‖τ_j − Y_j θ‖²  +  Σ_c (θ_c − μ_c)² / (s_l d_c)²   over   θ_c ≥ 0 of known sign

*Data.* A model is never exact. Its error is a function of the motion, so the error does not average out: a log of the
same motion that is twice as long repeats the error. To second order in r effective shapes of the motion, such an error
can take κ = r (r + 1) / 2 forms, and no log can distinguish it from the model's own columns in more than κ ways. So any
number of rows of a joint counts as κ rows. The shapes are counted on the joint's own columns, scaled to unit norm: with
eigenvalues λ of their correlation, r = (Σ λ)² / Σ λ² (the participation ratio). κ uses the median joint's r.

*Prior.* Each parameter has a mean μ and a standard deviation d. The scale s_l of a link or a rotor says how good the
prior is for it. The data give the scale by evidence (automatic relevance determination): with posterior covariance C of
its p_l parameters, ``s_l² = (S_l + ν s²) / (p_l + ν)``, ``S_l = Σ ((θ − μ)² + C_cc) / d²``. One person or one CAD
model made all links of a URDF, so the links share a scale s of the whole URDF, ``s² = (Σ S_l + ν) / (Σ p_l + ν)`` over
all links. A link that the log hardly moves takes this scale from the links that the log moves. A URDF does not hold
rotors: their s is 1.

*Noise.* σ_j² is the residual variance, corrected for the γ_j of the κ rows that determine parameters. If a
cross-validated fit has a smaller variance, with all links at scale 1 or at the widest scale, σ_j² is that variance.

Sources: MacKay 1992, Bayesian interpolation, Neural Computation 4(3), for evidence and γ; Tipping 2001, Sparse Bayesian
learning and the relevance vector machine, JMLR 1, for the scales; Gelman et al. 2013, Bayesian Data Analysis, chapter
5, for a common scale of scales; Stark and Parker 1995, Bounded-variable least squares, Computational Statistics 10,
for the signs.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from frischid.core.types import Array
from frischid.errors import IdentifiabilityError
from frischid.estimators.held_out import Fold, held_out_stretches, held_out_variance
from frischid.estimators.least_squares import Estimate
from frischid.estimators.map_problem import MapProblem, WeightedRows
from frischid.estimators.parameter_prior import ParameterPrior, ScaleRule
from frischid.estimators.precision import precision_of
from frischid.regression.moment_blocks import total
from frischid.regression.moments import Gram

ROUNDS = 60
"""Most iterations of scales and noise; they converge in about ten."""
SETTLED = 1e-3
"""Relative change of scales and noise below which the iterations end."""
EXACT_FIT = 1e-10
"""Residual variance over the torque's power below which a joint fits exactly: rounding, not noise."""
HELD = 1e-4
"""Share of its standard deviation within which a parameter is held; its inverse leaves a parameter free."""


@dataclass(frozen=True, eq=False)
class MapEstimate:
    """Parameters fitted with a prior, with a covariance that contains the model's own error."""

    theta: Array
    """Base parameters, (p,)."""
    covariance: Array
    """Shape (p, p)."""
    full: Array
    """Every parameter of the prior, (C,)."""
    full_covariance: Array
    """Shape (C, C)."""
    variance: Array
    """Residual variance σ² of each joint, (J,)."""
    rows: float
    """κ, rows that each joint's data count for."""
    prior: ParameterPrior
    """The prior with the scales from the data."""
    condition: float
    """Square root of the condition number of the scaled normal equations."""
    contradicted: tuple[tuple[str, float], ...]
    """Parameters of known sign to which the data would give the other sign, and by how many standard errors."""

    @property
    def from_log(self) -> Array:
        """Share of each parameter's knowledge that came from the log, 1 − posterior / prior variance, (C,)."""
        return np.asarray(np.clip(1.0 - np.diag(self.full_covariance) / self.prior.total_spread**2, 0.0, 1.0))

    def base_estimate(self, whole: Gram, mapping: Array) -> Estimate:
        """The base parameters of the fit, as an estimate.

        Parameters
        ----------
        whole : Gram
            Moments that were fitted.
        mapping : ndarray, shape (p, C)
            Regrouping of all parameters into base parameters.
        """
        before = np.einsum("pc,c,pc->p", mapping, self.prior.total_spread**2, mapping)
        return Estimate(
            columns=whole.columns,
            theta=self.theta,
            covariance=self.covariance,
            joints=whole.joints,
            sigma=np.sqrt(self.variance),
            weights=1.0 / self.variance,
            condition=self.condition,
            estimator="map",
            information=precision_of(self.covariance),
            notes=(),
            from_data=np.clip(1.0 - np.diag(self.covariance) / before, 0.0, 1.0),
        )


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


def map_estimate(
    blocks: Sequence[Gram],
    mapping: Array,
    prior: ParameterPrior,
    rule: ScaleRule | None = None,
) -> MapEstimate:
    """Fit base parameters with a prior of all parameters.

    Parameters
    ----------
    blocks : sequence of Gram
        Moments of consecutive stretches of time, base columns only.
    mapping : ndarray, shape (p, C)
        Regrouping of all parameters into base parameters, ``θ_b = K θ``.
    prior : ParameterPrior
        At scale 1.

    Raises
    ------
    IdentifiabilityError
        No joint has a torque row.
    """
    rule, whole = rule or ScaleRule(), total(blocks)
    if not whole.counts.any():
        raise IdentifiabilityError(
            "no joint has a torque row: all are at standstill, or the log is too short to filter"
        )
    problem = MapProblem(whole, mapping, prior)
    count = len(prior.names)  # columns in units of the torque at the prior's spread: no unit decides which one acts
    rows = effective_rows(problem.G[:, :count, :count] * np.outer(prior.spread, prior.spread))
    # A joint without a row (always at standstill) has no noise to measure; its weight of 1 multiplies nothing.
    floor = np.where(whole.counts > 0, EXACT_FIT * problem.torque / problem.counts + 1e-300, 1.0)
    variance, limit = _first_noise(problem, blocks, floor, rule)
    scales = {g: 1.0 for g in prior.group if g}
    for _ in range(ROUNDS):
        weights = rows / (problem.counts * variance)
        equations = problem.rows(weights, problem.precision(scales))
        x = equations.solve()
        C = equations.covariance(~problem.bounded | (x > 0))
        used = weights * np.einsum("jab,ba->j", problem.G, C)
        residual = problem.squares(x) / problem.counts * rows / np.maximum(rows - used, 0.05 * rows)
        updated = np.maximum(np.minimum(residual, limit), floor)
        fresh = link_scales(prior, x[:count] - prior.mean, np.diag(C)[:count], rule)
        done = np.allclose(updated, variance, rtol=SETTLED) and all(
            abs(fresh[g] - s) <= SETTLED * s for g, s in scales.items()
        )
        variance, scales = updated, fresh
        if done:
            break
    return _finish(problem, replace(prior, scales=scales), variance, rows)


def friction_alone(blocks: Sequence[Gram], mapping: Array, prior: ParameterPrior, fitted: Collection[str]) -> Array:
    """Base parameters of the prior's links with only friction and offsets fitted: the model of a careful URDF user.

    Parameters
    ----------
    blocks : sequence of Gram
        Base columns only.
    mapping : ndarray, shape (p, C)
    prior : ParameterPrior
        All parameters that are not fitted keep its mean.
    fitted : collection of str
        Names of the parameters of friction and offsets.

    Returns
    -------
    ndarray, shape (p,)
    """
    held = np.array([name not in fitted for name in prior.names])
    spread = prior.spread * np.where(held, HELD, 1.0 / HELD)
    problem = MapProblem(total(blocks), mapping, replace(prior, spread=spread, negative=np.zeros(len(spread))))
    precision = problem.precision({})
    floor = EXACT_FIT * problem.torque / problem.counts + 1e-300
    variance = np.maximum(0.1 * problem.torque / problem.counts, floor)
    for _ in range(6):
        x = problem.rows(1.0 / variance, precision).solve()
        variance = np.maximum(problem.squares(x) / problem.counts, floor)
    return np.asarray(problem.A @ x)


def effective_rows(G: Array) -> float:
    """κ, the rows that a joint's data count for, from the moments (J, m, m) of its columns; see the module's text."""
    found = [r for r in (shapes(g) for g in G) if r > 0]
    r = float(np.median(found)) if found else 1.0
    return r * (r + 1) / 2


def _first_noise(problem: MapProblem, blocks: Sequence[Gram], floor: Array, rule: ScaleRule) -> tuple[Array, Array]:
    """Residual variances to start from, and the cross-validated ones that limit them, at the best common scale.

    A URDF that is altogether wrong is not a reason to take the torque for noise: links at the widest scale may explain
    the torque of stretches left out, where links at scale 1 cannot.
    """
    variance, limit = _noise_at(problem, blocks, floor, 1.0)
    try:
        wide = _noise_at(problem, blocks, floor, rule.most)
    except IdentifiabilityError:  # so wide a prior determines no more than the log, and the log leaves something open
        return variance, limit
    return np.minimum(variance, wide[0]), np.minimum(limit, wide[1])


def _noise_at(problem: MapProblem, blocks: Sequence[Gram], floor: Array, scale: float) -> tuple[Array, Array]:
    """The same with every link at one scale."""
    precision = problem.precision({g: scale for g in problem.prior.group if g})
    variance = np.maximum(0.1 * problem.torque / problem.counts, floor)
    for _ in range(6):
        x = problem.rows(1.0 / variance, precision).solve()
        variance = np.maximum(problem.squares(x) / problem.counts, floor)
    if len(blocks) < 2:
        return variance, np.full(len(variance), np.inf)
    return variance, np.maximum(held_out_variance(tuple(_folds(problem, blocks, 1.0 / variance, precision))), floor)


def _folds(problem: MapProblem, blocks: Sequence[Gram], weights: Array, precision: Array) -> Iterator[Fold]:
    """Fits without each stretch of time in turn."""
    for out in held_out_stretches(blocks):
        kept = np.maximum(1.0 - out.counts / problem.counts, 1e-3)
        yield Fold(out, problem.A @ problem.rows(weights / kept, precision, out).solve())


def map_folds(blocks: Sequence[Gram], mapping: Array, estimate: MapEstimate) -> tuple[Fold, ...]:
    """Fits without each stretch of time in turn, under the estimate's prior, scales and noise.

    Parameters
    ----------
    blocks : sequence of Gram
        Moments that the estimate was made from; five contiguous parts of them are left out in turn.
    mapping : ndarray, shape (p, C)

    Raises
    ------
    IdentifiabilityError
        The log is too short to hold any of it out.
    """
    problem = MapProblem(total(blocks), mapping, estimate.prior)
    weights = estimate.rows / (problem.counts * estimate.variance)
    return tuple(_folds(problem, blocks, weights, problem.precision(estimate.prior.scales)))


def link_scales(prior: ParameterPrior, off: Array, known: Array, rule: ScaleRule) -> dict[str, float]:
    """Scale of each link's and rotor's prior by evidence; the links share the scale of their URDF.

    Parameters
    ----------
    off : ndarray, shape (C,)
        Parameters less their prior means.
    known : ndarray, shape (C,)
        Their posterior variances.
    """
    squares, links = (off**2 + known) / prior.spread**2, prior.of_links
    common = (squares[links].sum() + rule.freedom) / (links.sum() + rule.freedom)
    found = {}
    for group in dict.fromkeys(g for g in prior.group if g):
        own = np.array([g == group for g in prior.group])
        expected = common if links[own].any() else 1.0
        squared = (squares[own].sum() + rule.freedom * expected) / (own.sum() + rule.freedom)
        found[group] = float(np.clip(np.sqrt(squared), rule.least, rule.most))
    return found


def _finish(problem: MapProblem, prior: ParameterPrior, variance: Array, rows: float) -> MapEstimate:
    weights = rows / (problem.counts * variance)
    equations = problem.rows(weights, problem.precision(prior.scales))
    x, root = equations.solve(), equations.root()  # a bound cuts the distribution off, it does not make it certain
    base, full = problem.A @ root, problem.pick @ root
    return MapEstimate(
        theta=problem.A @ x,
        covariance=base @ base.T,
        full=problem.pick @ x,
        full_covariance=full @ full.T,
        variance=variance,
        rows=rows,
        prior=prior,
        condition=equations.condition,
        contradicted=_contradicted(problem, x, equations),
    )


def _contradicted(problem: MapProblem, x: Array, equations: WeightedRows) -> tuple[tuple[str, float], ...]:
    """Parameters held at zero by their sign: how far beyond the data would put them, in standard errors."""
    found, push = [], equations.gradient(x)
    for k, name in enumerate(problem.prior.names):
        if problem.prior.nonnegative[k] and x[k] <= 0 and push[k] > 0:
            among = (~problem.bounded) | (x > 0)
            among[k] = True
            alone = equations.covariance(among)[k, k]  # of this parameter with all others that are free
            found.append((name, float(push[k] * np.sqrt(alone))))
    return tuple(found)
