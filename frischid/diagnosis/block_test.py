"""A test whether a candidate lowers the held-out error over all of the time, not in a single moment only.

With ê and ê' the held-out residuals without and with the candidate, the gain of block of time b is

    g_b = Σ_{i in b} w_j (ê_i² − ê'_i²),     w_j = (n_j / ℓ_j) / SSE_j,

which is the log likelihood ratio to first order. Blocks last about a second, longer than the residual's correlation, so
the g_b are nearly independent, and a paired one-sided test of their mean or ranks is valid.

Two candidates are compared in the same way: the difference of their gains, block by block. Where it is no more than
chance, the data cannot tell them apart.

Source: Wilcoxon 1945, "Individual comparisons by ranking methods", Biometrics Bulletin 1(6).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import stats

from frischid.core.types import Array
from frischid.diagnosis.candidate_columns import Candidate
from frischid.diagnosis.cross_validation import CrossValidator

LEAST_BLOCKS = 3  # for a variance with two degrees of freedom


def block_test(validator: CrossValidator, candidate: Candidate) -> float:
    """P value over blocks of time that a candidate lowers the held-out squared error: paired, one-sided.

    The result is the smaller p value of Student's t test and Wilcoxon's signed-rank test. If an effect acts in some
    blocks only, the mean (t) shows it. If an effect acts in all blocks, and one block is bad for another reason, the
    ranks show it.
    """
    gains = block_gains(validator, candidate)
    return 1.0 if gains is None else p_value_of(gains)


def p_value_of(g: Array) -> float:
    """P value that gains of blocks of time are positive, (B,): the smaller one of Student's t and Wilcoxon's ranks."""
    if len(g) < LEAST_BLOCKS or not g.std() > 0:
        return 1.0
    t = float(stats.t.sf(g.mean() / (g.std(ddof=1) / np.sqrt(len(g))), len(g) - 1))
    return min(t, float(stats.wilcoxon(g, alternative="greater").pvalue))


def less_error(validator: CrossValidator, one: Candidate, other: Candidate) -> float:
    """P value over blocks of time that one candidate leaves less error than another, on the joints of the first.

    Paired and one-sided: in each block of time the two held-out errors are compared. Both candidates are scored alone.

    Parameters
    ----------
    validator : CrossValidator
    one, other : Candidate
    """
    rows = tuple(one.columns)
    gains = block_gains(validator, one, rows), block_gains(validator, other, rows)
    return 1.0 if gains[0] is None else 0.0 if gains[1] is None else p_value_of(gains[0] - gains[1])


def block_gains(validator: CrossValidator, candidate: Candidate, rows: Sequence[int] | None = None) -> Array | None:
    """Gain of each block of time that has rows, (B,); None when a fold cannot fit the candidate.

    Parameters
    ----------
    validator : CrossValidator
    candidate : Candidate
    rows : sequence of int, optional
        Joints whose error counts, all by default.
    """
    data = validator.data
    fits = [validator.fitted(candidate, fold) for fold in range(data.folds)]
    found = [fit for fit in fits if fit is not None]
    if len(found) < data.folds:
        return None
    theta = validator.fit.fold_theta
    changed = theta + np.stack([fit.change for fit in found])
    beta = np.stack([fit.beta for fit in found])
    gain, there = np.zeros(data.cache.blocks), np.zeros(data.cache.blocks, bool)
    weights = validator.effective / np.maximum(validator.base_sse().sum(axis=0), 1e-300)
    for row in range(len(weights)) if rows is None else rows:
        for joint in data.motions_of(row):
            before = joint.tau - validator.columns.predicted(joint, theta)
            after = joint.tau - validator.columns.predicted(joint, changed, candidate, beta)
            np.add.at(gain, joint.block, weights[row] * (before**2 - after**2))
            there[joint.block] = True
    return np.asarray(gain[there])
