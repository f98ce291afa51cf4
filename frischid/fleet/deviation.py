"""Whether one robot differs from the others, from moments alone.

The parameters θ₀ are fitted to all *other* robots, with moments H₀ = Y₀ᵀWY₀, W the joints' weights. A prior of the
parameters acts like a further log of the others: its precision is part of H₀. One robot's own
moments are H = YᵀWY. Its score s = YᵀW(τ − Yθ₀) gives the change of parameters that fits this robot best, δ = H⁺s. Its
variance is that of the robot and that of the others, H⁺ + H₀⁻¹. So the statistic is

    Λ = δᵀ (H⁺ + H₀⁻¹)⁺ δ = sᵀ (H + H₀)⁻¹ H₀ δ   ~   κ χ²(ν)      if the robot is like the others.

The statistic needs no separate estimate of the robot: H⁺ leaves out the directions that its motion never excited. In
theory ν is the rank of H and κ = 1. But residuals are correlated in time (κ from the block jackknife), and robots are
never quite alike: some parameters vary more than others. A robot is significant when it differs more than robots of
this fleet usually do.

- In a fleet of a dozen robots or more, κ and ν are chosen to match the fleet's own median and upper quartile of Λ. This
  is the empirical null (Devlin and Roeder 1999, Biometrics 55(4); Efron 2004, JASA 99(465)).
- In a smaller fleet, κ for one robot is the mean of Λ/ν of the R − 1 others among themselves, where that is larger.
  Then Λ/νκ has Fisher's distribution with J and J (R − 2) degrees of freedom: friction varies from robot to robot,
  joint by joint, and most of Λ comes from J directions. (With 2 J, one simulated fleet of 12 in fact alike raised an
  alarm.) Two robots leave no others to compare with: Λ says only whether the two differ by more than noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import linalg, special

from frischid.core.types import Array
from frischid.errors import IdentifiabilityError
from frischid.estimators.least_squares import Estimate, Prior, wls
from frischid.estimators.normal_equations import NormalEquations
from frischid.regression.moment_blocks import total
from frischid.regression.moments import Gram

EXCITED = 1e-8  # eigenvalue of the column-scaled moments over the largest, below which a direction was not excited
CHANGES_NAMED = 4  # changes of one robot at most
LEAST_ROBOTS = 12  # fewest robots for an empirical null


@dataclass(frozen=True, eq=False)
class Deviation:
    """Comparison of one robot with the others."""

    own: Estimate | None
    """Its own parameters; None when its logs do not determine all of them."""
    reason: str
    """Why its logs do not determine all parameters; empty where they do."""
    statistic: float
    """Λ before κ."""
    rank: int
    """Number of parameter directions that its motion excited."""
    inflation: float
    """κ of its own residuals; NaN when it has too few blocks of time."""
    shift: Array
    """δ = H⁺s, the difference of its parameters from the others', (p,)."""
    error_fleet: Array
    error_own: Array
    """`error_fleet`, `error_own`: Rms residual with the parameters of the others, and with its own, over the torque's
    standard deviation, (J,)."""
    pull: Array
    """Change of the fleet's parameters when this robot is left out, (p,): its part in their jackknife."""
    usual: float = np.nan
    """In a small fleet, the mean of Λ over its rank of the other robots among themselves; otherwise NaN."""


@dataclass(frozen=True, eq=False)
class Centre:
    """The centre that the robots of a fleet are compared with: parameters fitted to all of them."""

    weights: Array
    """Weights of the joints, (J,)."""
    prior: Prior | None
    """A prior of the parameters, which acts like one further log; None: the logs alone."""
    theta: Array
    """Least squares of the whole fleet with both, (p,)."""

    @classmethod
    def of(cls, whole: Gram, weights: Array, prior: Prior | None = None) -> Centre:
        """Fit to the sum of all robots' moments.

        Raises
        ------
        IdentifiabilityError
            The logs, and the prior, do not determine the parameters.
        """
        return cls(weights, prior, _fitted(whole, weights, prior).theta)


def _fitted(whole: Gram, weights: Array, prior: Prior | None) -> NormalEquations:
    moments = whole.weighted(weights)
    return NormalEquations(moments if prior is None else moments + prior.moments, whole.names)


def deviation(blocks: Sequence[Gram], fleet: Gram, centre: Centre, included: bool) -> Deviation:
    """Compare a robot with the rest of its fleet.

    Parameters
    ----------
    blocks : sequence of Gram
        The robot's moments, by stretches of time.
    fleet : Gram
        Sum over the fleet.
    centre : Centre
        Fitted to `fleet`.
    included : bool
        Whether the robot is part of the fleet's sum.
    """
    whole, prior = total(blocks), centre.prior
    others = fleet - whole if included else fleet
    theta0 = _fitted(others, centre.weights, prior).theta if included else centre.theta
    own, reason = _own(blocks, prior)
    spread = np.sqrt(np.maximum(whole.torque_ss() / np.maximum(whole.counts, 1), 1e-300))
    shift, statistic, rank = _shift(whole, others, theta0, centre)
    inflation = np.nan
    if own is not None:
        plain = _fitted(whole, 1.0 / own.sigma**2, prior).inverse
        inflation = float(np.median(np.diag(own.covariance) / np.diag(plain)))
    return Deviation(
        own=own,
        reason=reason,
        statistic=statistic,
        rank=rank,
        inflation=inflation,
        shift=shift,
        error_fleet=_rms(whole, theta0) / spread,
        error_own=_rms(whole, theta0 + shift) / spread,
        pull=centre.theta - theta0,
    )


def _own(blocks: Sequence[Gram], prior: Prior | None) -> tuple[Estimate | None, str]:
    try:
        return wls(blocks, prior=prior), ""
    except IdentifiabilityError as error:
        return None, str(error)


def usual_deviation(robots: Sequence[Gram], centre: Centre) -> float:
    """How much robots differ among themselves: the mean of Λ over its rank, each robot against the others.

    Parameters
    ----------
    robots : sequence of Gram
        At least two; otherwise the result is NaN.
    centre : Centre
        Weights of the joints, and a prior.
    """
    if len(robots) < 2:
        return np.nan
    found, whole = [], total(robots)
    for one in robots:
        others = whole - one
        try:
            theta0 = _fitted(others, centre.weights, centre.prior).theta
        except IdentifiabilityError:  # the others' logs leave a parameter open
            continue
        _, statistic, rank = _shift(one, others, theta0, centre)
        found.append(statistic / max(rank, 1))
    return float(np.mean(found)) if found else np.nan


def _shift(whole: Gram, others: Gram, theta0: Array, centre: Centre) -> tuple[Array, float, int]:
    """δ = H⁺s, Λ and the rank of H, on columns scaled to unit norm."""
    moments, known = whole.weighted(centre.weights), others.weighted(centre.weights)[:-1, :-1]
    if centre.prior is not None:
        known = known + centre.prior.precision
    scale = np.sqrt(np.diag(moments)[:-1])
    scale = 1.0 / np.where(scale > 0, scale, np.inf)
    H = moments[:-1, :-1] * np.outer(scale, scale)
    s = (moments[:-1, -1] - moments[:-1, :-1] @ theta0) * scale
    values, vectors = linalg.eigh(H)
    keep = values > EXCITED * values[-1]
    along = vectors[:, keep].T @ s
    delta = vectors[:, keep] @ (along / values[keep])
    H0 = known * np.outer(scale, scale)
    weighed = linalg.lstsq(H + H0, H0 @ delta)[0]  # (H + H₀)⁻¹ H₀ δ
    return delta * scale, max(float(s @ weighed), 0.0), int(keep.sum())


def _rms(whole: Gram, theta: Array) -> Array:
    return np.asarray(np.sqrt(whole.residual_ss(theta) / np.maximum(whole.counts, 1.0)))


@dataclass(frozen=True)
class Null:
    """Distribution of Λ among robots that are alike: Λ per excited direction is ``scale χ²(freedom) / freedom``."""

    scale: float
    """κ: mean of Λ over its rank."""
    freedom: float | None
    """ν; None: the rank of each robot's own moments."""
    within: float
    """Part of κ that comes from the correlation of residuals in time."""

    @classmethod
    def of(cls, found: Sequence[Deviation], robots: int) -> Null:
        """Estimate the distribution from robots that are assumed to be alike, in a fleet of so many `robots`.

        A fleet of a dozen stays one of a dozen when robots that differ are taken out.
        """
        known = [d.inflation for d in found if np.isfinite(d.inflation)]
        within = max(1.0, float(np.median(known))) if known else 1.0
        if robots < LEAST_ROBOTS:
            return cls(within, None, within)
        median, upper = np.quantile([d.statistic / d.rank for d in found], [0.5, 0.75])
        degrees = np.geomspace(1.0, max(d.rank for d in found), 200)
        ratios = special.gammaincinv(degrees / 2, 0.75) / special.gammaincinv(degrees / 2, 0.5)
        freedom = float(degrees[np.abs(ratios - upper / median).argmin()])
        return cls(max(1.0, float(median * freedom / (2 * special.gammaincinv(freedom / 2, 0.5)))), freedom, within)

    def p_value(self, found: Deviation, robots: int) -> float:
        """P value of a Λ at least this large, corrected (Bonferroni) for all robots."""
        if np.isfinite(found.usual):
            joints = len(found.error_fleet)
            chance = special.fdtrc(joints, joints * (robots - 2), self.excess(found))
        else:
            freedom = self.freedom or found.rank
            chance = special.chdtrc(freedom, freedom * self.excess(found))
        return min(1.0, robots * float(chance))

    def excess(self, found: Deviation) -> float:
        """Λ as a multiple of the usual Λ in this fleet."""
        usual = max(self.scale, found.usual) if np.isfinite(found.usual) else self.scale
        return found.statistic / max(found.rank, 1) / usual


@dataclass(frozen=True)
class Change:
    """Parameters of one effect on one joint that differ from the fleet's."""

    effect: str
    joint: str
    values: dict[str, tuple[float, float]]
    """Parameter -> value in the fleet, value in this robot."""
    error_after: float
    """Mean NRMSE when these parameters, and those of earlier changes, are fitted to this robot."""


def changes(whole: Gram, theta0: Array, inflation: float) -> list[Change]:
    """Effects whose parameters changed, the one with the largest gain in likelihood first.

    A group is the parameters of one effect on one joint. The rigid links form no group: their parameters change
    together, and the diagnosis explains them. A group of k parameters must gain more log likelihood than ``½ k log n``
    on n effectively independent samples.
    """
    groups: dict[tuple[str, str], list[int]] = {}
    for i, column in enumerate(whole.columns):
        if column.effect != "rigid":
            groups.setdefault((column.effect, column.joint), []).append(i)
    spread = np.sqrt(np.maximum(whole.torque_ss() / np.maximum(whole.counts, 1), 1e-300))
    independent = whole.counts / max(inflation, 1.0)
    found: list[Change] = []
    chosen: list[int] = []
    theta = theta0
    while len(found) < CHANGES_NAMED and groups:
        before = np.maximum(whole.residual_ss(theta), 1e-300)
        scored = []
        for key, columns in groups.items():
            trial = _refitted(whole, theta0, [*chosen, *columns], before / np.maximum(whole.counts, 1.0))
            after = np.maximum(whole.residual_ss(trial), 1e-300)
            price = 0.5 * len(columns) * np.log(max(float(independent.sum()), 2.0))
            scored.append((0.5 * float(independent @ np.log(before / after)) - price, key, trial))
        gain, key, trial = max(scored, key=lambda x: x[0])
        if gain <= 0:
            break
        columns = groups.pop(key)
        chosen += columns
        theta = trial
        values = {whole.names[i]: (float(theta0[i]), float(theta[i])) for i in columns}
        found.append(Change(*key, values, float(np.mean(_rms(whole, theta) / spread))))
    return found


def _refitted(whole: Gram, theta0: Array, columns: Sequence[int], variance: Array) -> Array:
    """The parameters, some of them fitted to this robot and the others unchanged."""
    moments = whole.weighted(1.0 / np.maximum(variance, 1e-300))
    s = moments[:-1, -1] - moments[:-1, :-1] @ theta0
    index = np.asarray(columns)
    H = moments[np.ix_(index, index)]
    theta = np.array(theta0, dtype=float)
    scale = np.sqrt(np.maximum(np.diag(H), 1e-300))
    theta[index] += np.linalg.lstsq(H / np.outer(scale, scale), s[index] / scale, rcond=1e-10)[0] / scale
    return theta
