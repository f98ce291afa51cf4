"""A test whether a candidate lowers the held-out error over all of the time, not in a single moment only.

With q and q' the squared errors of a row without and with the candidate, the gain of block of time b is

    g_b = Σ_{i in b} w_j (q_i − q'_i),     w_j = (n_j / ℓ_j) / Q_j,     q_i = r_i² + s_f (ê_i² − r_i²),

which is the log likelihood ratio to first order. ê is the held-out residual, r the residual of the fit to all folds,
and q the held-out squared error without the part that uncertain parameters alone cause (`weighted_fit`). Blocks last
about a second, longer than the residual's correlation. So the g_b are nearly independent, and a paired one-sided test
of their mean or ranks is valid.

An effect may act in few blocks only: a delay shows where the torque changes. With Δ the change of the prediction and
e_b = Σ w_j Δ² its energy, g_b is about Σ w_j (2 ê Δ − Δ²). For a candidate without effect the variance of g_b is
proportional to e_b, and for a true one so is its mean. So each block counts with the candidate's energy in it,

    t = Σ g_b / √(s² Σ e_b),     s² = Σ (g_b − μ e_b)² / e_b / (B − 1),     μ = Σ g_b / Σ e_b,

which is Student's test of a weighted mean (Aitken 1935, Proc. R. Soc. Edinburgh 55). A block without energy says
nothing. Blocks with hardly any energy give no variance for the one that has nearly all of it: with an energy of fewer
than two blocks, (Σ e_b)² / Σ e_b² < 2, the gain is one moment's, which nothing repeats, and the ranks alone decide.

Two candidates are compared in the same way: the difference of their gains, block by block, with the energy of the
difference of their predictions. Where it is no more than chance, the data cannot tell them apart.

Source: Wilcoxon 1945, "Individual comparisons by ranking methods", Biometrics Bulletin 1(6).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy import special

from frischid.core.types import Array
from frischid.diagnosis.cached_motion import JointData
from frischid.diagnosis.candidate_columns import Candidate
from frischid.diagnosis.cross_validation import CrossValidator
from frischid.estimators.p_values import ranks_above_zero

LEAST_BLOCKS = 3  # for a variance with two degrees of freedom
LEAST_REPEATED = 2.0  # blocks that share the energy, at least: what acted in one block alone was not seen again


class BlockGains(NamedTuple):
    """Gain of each block of time, and energy of the change of the prediction in it, (B,) each."""

    gain: Array
    energy: Array


def block_test(validator: CrossValidator, candidate: Candidate) -> float:
    """P value over blocks of time that a candidate lowers the held-out squared error: paired, one-sided.

    The result is the smaller p value of Student's t test, in which each block counts with the candidate's energy, and
    of Wilcoxon's signed-rank test. If an effect acts in some blocks only, the mean (t) shows it. If an effect acts in
    all blocks, and one block is bad for another reason, the ranks show it.
    """
    found = block_gains(validator, candidate)
    return 1.0 if found is None else p_value_of(*found)


def p_value_of(g: Array, energy: Array | None = None) -> float:
    """P value that gains of blocks of time are positive: the smaller one of Student's t and Wilcoxon's ranks.

    Parameters
    ----------
    g : ndarray, shape (B,)
        Gain of each block.
    energy : ndarray, shape (B,), optional
        Weight of each block in Student's test, to which the variance of its gain is proportional; all equal by default.
    """
    if len(g) < LEAST_BLOCKS or not g.std() > 0:
        return 1.0
    ranks = ranks_above_zero(g)
    e = np.ones(len(g)) if energy is None else energy
    g, e = g[e > 0], e[e > 0]
    if len(g) < LEAST_BLOCKS or e.sum() ** 2 < LEAST_REPEATED * (e**2).sum():
        return ranks
    spread = float(((g - g.sum() / e.sum() * e) ** 2 / e).sum()) / (len(g) - 1)
    t = float(special.stdtr(len(g) - 1, -g.sum() / np.sqrt(max(spread, 1e-300) * e.sum())))
    return min(t, ranks)


def less_error(validator: CrossValidator, one: Candidate, other: Candidate) -> float:
    """P value over blocks of time that one candidate leaves less error than another, on the joints of the first.

    Paired and one-sided: in each block of time the two held-out errors are compared. Both candidates are scored alone.
    """
    fits = _Fits.of(validator, one), _Fits.of(validator, other)
    if fits[0] is None or fits[1] is None:
        return 1.0 if fits[0] is None else 0.0
    return p_value_of(*_compared(validator, fits[1], fits[0], tuple(one.columns)))


def block_gains(validator: CrossValidator, candidate: Candidate) -> BlockGains | None:
    """Gain and energy of each block of time that has rows; None when a fold cannot fit the candidate."""
    fits = _Fits.of(validator, candidate)
    return None if fits is None else _compared(validator, None, fits, range(len(validator.joints)))


class _Fits(NamedTuple):
    """Fits of a candidate without each fold in turn, and to all folds."""

    candidate: Candidate | None
    """None: the model alone."""
    theta: Array
    beta: Array | None
    """`theta`, `beta`: The last fit leaves no fold out, (folds + 1, p) and (folds + 1, k)."""
    shares: Array
    """Share of the difference between a fold's two errors that counts, (folds,)."""

    @classmethod
    def of(cls, validator: CrossValidator, candidate: Candidate) -> _Fits | None:
        """The fits of a candidate beside the model's columns; None when a fold cannot fit the candidate."""
        fits = validator.fits([candidate])[0]
        found = [fit for fit in fits if fit is not None]
        if len(found) < len(fits):
            return None
        theta = np.stack([s.theta + fit.change for s, fit in zip(validator.fit.systems, found, strict=True)])
        return cls(candidate, theta, np.stack([fit.beta for fit in found]), validator.shares(candidate, found))

    @classmethod
    def of_model(cls, validator: CrossValidator) -> _Fits:
        """The fits of the model alone."""
        return cls(None, np.stack([s.theta for s in validator.fit.systems]), None, validator.fit.shares)

    def predicted(self, validator: CrossValidator, joint: JointData) -> tuple[Array, Array]:
        """Torque of a joint's rows under the fits to the other folds, and under the fit to all, (n,) each."""
        apart, whole = (None, None) if self.beta is None else (self.beta[:-1], self.beta[-1])
        if self.candidate is None:
            return validator.predicted(joint)
        columns = validator.columns
        return (
            columns.predicted(joint, self.theta[:-1], self.candidate, apart),
            columns.predicted(joint, self.theta[-1], self.candidate, whole),
        )


def _compared(validator: CrossValidator, before: _Fits | None, after: _Fits, rows: Sequence[int]) -> BlockGains:
    """Gain of a candidate over the model (None) or over another candidate."""
    data = validator.data
    gain, energy, there = (np.zeros(data.cache.blocks) for _ in range(3))
    weights = validator.effective / np.maximum(validator.base_predictive().sum(axis=0), 1e-300)
    fits = (_Fits.of_model(validator) if before is None else before), after
    for row in rows:
        for joint in data.motions_of(row):
            (apart, whole), (apart_after, whole_after) = (x.predicted(validator, joint) for x in fits)
            shares = [share_of_rows(joint, x.shares) for x in fits]
            first = counted_squares(joint.tau - apart, joint.tau - whole, shares[0])
            second = counted_squares(joint.tau - apart_after, joint.tau - whole_after, shares[1])
            moved = counted_squares(apart - apart_after, whole - whole_after, (shares[0] + shares[1]) / 2)
            np.add.at(gain, joint.block, weights[row] * (first - second))
            np.add.at(energy, joint.block, weights[row] * moved)
            there[joint.block] = 1.0
    return BlockGains(gain[there > 0], energy[there > 0])


def share_of_rows(joint: JointData, shares: Array) -> Array:
    """Share of the difference between the two errors of each row that counts, (n,), from that of each fold."""
    found = np.zeros(len(joint))
    for fold, own in joint.folds:
        found[own] = shares[fold]
    return found


def counted_squares(apart: Array, whole: Array, share: Array) -> Array:
    """Squares of the fit to all, and a share of their difference from those of the fits to the other folds."""
    inside = whole**2
    return np.asarray(inside + share * (apart**2 - inside))
