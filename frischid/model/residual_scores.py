"""How large errors are, in residual standard deviations: the distribution behind prediction intervals.

On stretches of time left out of the fit in turn, with θ fitted to all others, each torque row gives the score

    s = |τ − y θ| / σ_j.

On such a motion, r_j σ_j with the α quantile r_j of the joint's scores holds a share α of the measurements (split
conformal prediction). No distribution is assumed: real residuals have heavy tails at reversals and are small elsewhere.

The model's own error does not show in full there. It is a function of the motion, and the stretches of a log resemble
one another: parameters that are fitted to some of them absorb this error on all. On another motion its variance is
y C yᵀ, with C the covariance that counts the data of each joint as a few rows. If scores were divided by an expected
error that contains y C yᵀ, their quantile would take the model's error away again. So both are added,

    half width² = (r_j σ_j)² + z_α² s_j y C yᵀ,

with the share s_j of C that noise does not explain (`FitRecord.model_share`). The interval widens where the motion asks
for more than the fitted logs showed.

Source: Lei, G'Sell, Rinaldo, Tibshirani and Wasserman 2018, "Distribution-free predictive inference for regression",
J. Am. Stat. Assoc. 113(523).

Scores are counted in narrow bins, so that a log of any length takes the same memory.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from frischid.core.types import Array
from frischid.estimators.held_out import Fold
from frischid.estimators.least_squares import Estimate
from frischid.model.fit_record import LEVELS
from frischid.model.identification_stages import Problem
from frischid.regression.block import Block

ENOUGH = 20_000
"""Rows per joint from which quantiles are taken: the quantile at 0.99 is then sure to a few percent."""

EDGES = np.concatenate([[0.0], np.geomspace(1e-4, 1e6, 4001)])
"""Edges of the bins: each is 0.6 % wide."""


class ResidualScores:
    """Quantiles of each joint's scores, gathered block by block.

    Parameters
    ----------
    problem : Problem
        With the motions that the folds' moments were made from.
    folds : sequence of Fold
        In the order of time.
    estimate : Estimate
        With the standard deviation σ of each joint's residual.
    """

    def __init__(self, problem: Problem, folds: Sequence[Fold], estimate: Estimate) -> None:
        joints = problem.data.joints
        self._base, self._sigma = list(problem.reduction.base), estimate.sigma
        self._index = [problem.data.robot.joints.index(name) for name in joints]
        # Rows come in the order in which the moments took them in: the number of a row of a joint says its fold.
        self._ends = np.cumsum([fold.out.counts for fold in folds], axis=0)
        self._thetas = np.stack([fold.theta for fold in folds])
        self._every = max(1, int(self._ends[-1].max(initial=0.0)) // ENOUGH)
        self._seen, self._counts = np.zeros(len(joints)), np.zeros((len(joints), len(EDGES) - 1))

    def add(self, block: Block) -> None:
        """Take in the next block in the order of time."""
        Y, tau, used = block.Z[:, self._base][:, :, self._index], block.tau[:, self._index], block.used[:, self._index]
        number = self._seen + np.cumsum(used, axis=0) - 1
        self._seen = self._seen + used.sum(axis=0)
        for j in range(len(self._index)):
            some = np.flatnonzero(used[:: self._every, j])
            rows = some * self._every
            fold = np.searchsorted(self._ends[:, j], number[rows, j], side="right")
            theta = self._thetas[np.minimum(fold, len(self._thetas) - 1)]
            error = tau[rows, j] - np.einsum("np,np->n", Y[rows, :, j], theta)
            score = np.abs(error) / max(float(self._sigma[j]), 1e-300)
            self._counts[j] += np.histogram(np.minimum(score, EDGES[-1]), EDGES)[0]

    def quantiles(self) -> Array:
        """At each of `LEVELS`, shape (L, J); NaN for a joint without rows."""
        return np.stack([_quantiles(count) for count in self._counts], axis=1)


def _quantiles(counts: Array) -> Array:
    """Quantiles at `LEVELS` of counts in bins; NaN without a count."""
    if not counts.any():
        return np.full(len(LEVELS), np.nan)
    below = np.append(0.0, np.cumsum(counts)) / counts.sum()
    return np.asarray(np.interp(LEVELS, below, EDGES))
