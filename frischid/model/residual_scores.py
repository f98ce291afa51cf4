"""How large errors are, in units of the error to expect: the distribution behind prediction intervals.

On stretches of time left out of the fit in turn, with θ fitted to all others, each torque row gives the score

    s = |τ − y θ| / sqrt(σ_j² + y C yᵀ).

An interval that is to hold a share α of the measurements reaches as far as the α quantile of the joint's scores times
the expected error of the row (split conformal prediction with a normalised score). No distribution is assumed: real
residuals have heavy tails at reversals and are small elsewhere. The score is divided by the expected error of *its*
row, so the interval widens where the motion asks for more than the fitted logs showed.

Source: Lei, G'Sell, Rinaldo, Tibshirani and Wasserman 2018, "Distribution-free predictive inference for regression",
J. Am. Stat. Assoc. 113(523), section 5.2.

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

ENOUGH = 20_000
"""Rows per joint from which quantiles are taken: the quantile at 0.99 is then sure to a few percent."""

EDGES = np.concatenate([[0.0], np.geomspace(1e-4, 1e6, 4001)])
"""Edges of the bins: each is 0.6 % wide."""


def residual_scores(problem: Problem, folds: Sequence[Fold], estimate: Estimate) -> Array:
    """Quantiles of each joint's scores.

    Parameters
    ----------
    problem : Problem
        With the motions that the folds' moments were made from.
    folds : sequence of Fold
        In the order of time.
    estimate : Estimate
        Expected error of each row.

    Returns
    -------
    ndarray, shape (L, J)
        At each of `LEVELS`; NaN for a joint without rows.
    """
    data = problem.data
    index = [data.robot.joints.index(n) for n in data.joints]
    # Rows come in the order in which the moments took them in: a joint's row belongs to the fold its number falls in.
    ends = np.cumsum([fold.out.counts for fold in folds], axis=0)
    thetas = np.stack([fold.theta for fold in folds])
    seen, counts = np.zeros(len(index)), np.zeros((len(index), len(EDGES) - 1))
    every = max(1, int(ends[-1].max(initial=0.0)) // ENOUGH)
    for motion in data.motions:
        for block in problem.regressor.blocks(motion, data.lowpass):
            Y = block.Z[:, list(problem.reduction.base)][:, :, index]
            expected = np.sqrt(estimate.error_variance(Y[::every]))
            tau, used = block.tau[:, index], block.used[:, index]
            number = seen + np.cumsum(used, axis=0) - 1
            seen = seen + used.sum(axis=0)
            for j in range(len(index)):
                some = np.flatnonzero(used[::every, j])
                rows = some * every
                fold = np.minimum(np.searchsorted(ends[:, j], number[rows, j], side="right"), len(folds) - 1)
                error = tau[rows, j] - np.einsum("np,np->n", Y[rows, :, j], thetas[fold])
                score = np.abs(error) / np.maximum(expected[some, j], 1e-300)
                counts[j] += np.histogram(np.minimum(score, EDGES[-1]), EDGES)[0]
    return np.stack([_quantiles(count) for count in counts], axis=1)


def _quantiles(counts: Array) -> Array:
    """Quantiles at `LEVELS` of counts in bins; NaN without a count."""
    if not counts.any():
        return np.full(len(LEVELS), np.nan)
    below = np.append(0.0, np.cumsum(counts)) / counts.sum()
    return np.asarray(np.interp(LEVELS, below, EDGES))
