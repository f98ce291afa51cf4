"""Fits of many candidates beside the same parameters, without each fold in turn and on everything.

A candidate with columns C is fitted without solving for θ again (variable projection, Golub and Pereyra 1973, SIAM J.
Numer. Anal. 10(2)), with D = Σ ω_j C_jᵀ C_j:

    A = Σ ω_j Y_jᵀ C_j,   β = (D − Aᵀ H⁻¹ A)⁻¹ (Σ ω_j C_jᵀ τ_j − Aᵀ θ),   θ' = θ − H⁻¹ A β.

Candidates with the same number of columns are one array: a diagnosis fits thousands, each with one or two columns.
Where θ or β would have an impossible sign, both are corrected together (`sign_bounds`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from frischid.core.types import Array
from frischid.diagnosis.candidate_columns import Candidate
from frischid.diagnosis.dataset import Moments
from frischid.diagnosis.sign_bounds import multipliers
from frischid.diagnosis.weighted_fit import IN_SPAN, System, WeightedFit, solve

TOGETHER = 256
"""Candidates in one array; more would not fit into the processor's cache."""


class CandidateFit(NamedTuple):
    """Fit of a candidate: fall of the weighted squared error, its coefficients (k,), change of the parameters (p,)."""

    gain: float
    beta: Array
    change: Array


Fits = tuple[CandidateFit | None, ...]
"""Without each fold in turn, then of everything; None where the other columns span the candidate."""


class Score(NamedTuple):
    """Sums of squared residuals with a candidate, and its coefficients."""

    sse: Array
    """Of each fold under the fit to the others, (folds, J)."""
    predictive: Array
    """The same without the error that uncertain parameters alone cause: Q of `weighted_fit`, (folds, J)."""
    beta: Array
    """Fitted to all folds, (k,)."""


class _Sums(NamedTuple):
    """Weighted sums of S candidates with k columns: ``A`` (S, p, k), ``e`` (S, k), ``D`` (S, k, k)."""

    A: Array
    e: Array
    D: Array


def candidate_fits(
    fit: WeightedFit, moments: Sequence[tuple[Moments, Moments]], candidates: Sequence[Candidate]
) -> list[Fits]:
    """Fit candidates, each alone.

    Parameters
    ----------
    moments : sequence of (Moments, Moments)
        Of each candidate, as `ModelColumns.moments` gives them.
    """
    found: dict[int, Fits] = {}
    for width in sorted({len(c.signs) for c in candidates}):
        same = [n for n, c in enumerate(candidates) if len(c.signs) == width]
        for first in range(0, len(same), TOGETHER):
            chosen = same[first : first + TOGETHER]
            fits = _of_one_width(fit, [moments[n] for n in chosen], np.array([candidates[n].signs for n in chosen]))
            found |= dict(zip(chosen, fits, strict=True))
    return [found[n] for n in range(len(candidates))]


def _of_one_width(
    fit: WeightedFit, moments: Sequence[tuple[Moments, Moments]], signs: NDArray[np.int_]
) -> Iterator[Fits]:
    folds, p = fit.columns.data.folds, fit.columns.width
    count, k = signs.shape
    cross, own = np.zeros((folds, count, p + 1, k)), np.zeros((folds, count, k, k))
    for n, (X, D) in enumerate(moments):
        for row, x in X.items():
            cross[:, n] += fit.omega[row] * x
            own[:, n] += fit.omega[row] * D[row]
    parts = []
    for left_out, system in enumerate(fit.systems):  # the last one leaves nothing out
        train = [f for f in range(folds) if f != left_out]
        c = np.add.reduce(cross[train])
        parts.append(_fitted(fit, system, _Sums(c[:, :-1], c[:, -1], np.add.reduce(own[train])), signs))
    return zip(*parts, strict=True)


def _fitted(fit: WeightedFit, system: System, sums: _Sums, signs: NDArray[np.int_]) -> list[CandidateFit | None]:
    """Fits of S candidates with k columns on some folds."""
    A, e, D = sums
    S, p, k = A.shape
    scale = np.sqrt(np.einsum("skk->sk", D))
    nonzero = (scale > 0).all(axis=1)
    scale = np.where(nonzero[:, None], scale, 1.0)
    HA = solve(system, A.transpose(1, 0, 2).reshape(p, S * k)).reshape(p, S, k)
    matrix = (D - A.transpose(0, 2, 1) @ HA.transpose(1, 0, 2)) / (scale[:, :, None] * scale[:, None, :])
    right = (e - np.einsum("spk,p->sk", A, system.free)) / scale
    values, vectors = (matrix[:, 0], np.ones((S, 1, 1))) if k == 1 else np.linalg.eigh(matrix)
    keep = values > IN_SPAN
    V = vectors * (keep / np.sqrt(np.where(keep, values, 1.0)))[:, None, :]
    along = np.einsum("skr,sk->sr", V, right)
    beta = np.einsum("skr,sr->sk", V, along) / scale
    theta = system.free - np.einsum("psk,sk->sp", HA, beta)
    gain = np.square(along).sum(axis=1) + system.rise
    bounded = fit.columns.bounded
    impossible = (fit.columns.signs[bounded] * theta[:, bounded] < 0).any(axis=1) | (signs * beta < 0).any(axis=1)
    there = nonzero & keep.any(axis=1)
    found: list[CandidateFit | None] = []
    for n in range(S):
        if not there[n]:
            found.append(None)
        elif not impossible[n]:
            found.append(CandidateFit(float(gain[n]), beta[n], theta[n] - system.theta))
        else:
            T = V[n][:, keep[n]] / scale[n][:, None]
            free = CandidateFit(float(gain[n]), beta[n], theta[n])
            found.append(_with_signs(fit, system, free, T, HA[:, n] @ T, signs[n]))
    return found


def _with_signs(
    fit: WeightedFit, system: System, free: CandidateFit, T: Array, G: Array, signs: NDArray[np.int_]
) -> CandidateFit:
    """A fit without regard to signs, whose change holds the parameters themselves, corrected.

    The covariance of β is T Tᵀ with T (k, r); that of θ is H⁻¹ + G Gᵀ with G (p, r), and between them −G Tᵀ.
    """
    own, other = np.flatnonzero(signs), fit.columns.bounded
    known = np.vstack([-G[other], T[own]])
    C = known @ known.T
    C[: len(other), : len(other)] += system.toward[other]
    z = np.append(free.change[other], free.beta[own])
    push = multipliers(z, C, np.append(fit.columns.signs[other], signs[own]))
    theta = free.change + system.toward @ push[: len(other)] - G @ (known.T @ push)
    return CandidateFit(free.gain - float(push @ C @ push), free.beta + T @ (known.T @ push), theta - system.theta)
