"""Frisch boxes of windows that slide over the rows, for the bounding-box recursion.

Moments of a window follow from those of the window before by adding the new rows and subtracting the old ones. ``K`` is
the inverse of the moments; its columns give the window's vertices. With U the new and old rows, and C = ±1 for new and
old ones, the inverse follows too (Woodbury 1950, "Inverting modified matrices"):

    (M + Uᵀ C U)⁻¹ = K − K Uᵀ (C + U K Uᵀ)⁻¹ U K,

which costs n² where an inverse costs n³. Rounding accumulates, so the last inverse of each batch is compared with a new
one, and a batch where the two differ is inverted window by window.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import linalg
from scipy.fft import next_fast_len

from frischid.core.types import Array
from frischid.estimators.frisch import CONDITION_LIMIT, extent, vertices_of

Flags = NDArray[np.bool_]

BATCH = 256
"""Windows whose moments are updated from one anchor: enough to amortise it, too few to drift."""
CACHED = 2**17
"""Numbers that a processor's cache holds beside others: 1 MB."""
_LOST_DIGITS = 1e-9  # relative error of an inverse that followed from others


class Extents(NamedTuple):
    """Boxes of a batch of windows, ``(n, p)`` each, and which of them had usable moments, ``(n,)``."""

    lower: Array
    upper: Array
    usable: Flags


class Batch(NamedTuple):
    """Windows that follow one another."""

    moments: Array
    """Mean moments of each window, (n, p + 1, p + 1)."""
    changes: Array
    """Rows that enter each window but the first, then rows that leave, (n − 1, 2 stride, p + 1)."""


def window_moments(rows: Array, window: int, stride: int) -> Iterator[Batch]:
    """Mean moments of the sliding windows.

    The first of a batch is summed from its rows; the others follow by adding the new rows and subtracting the old ones.
    A fresh sum every `BATCH` windows limits the accumulation of rounding errors, and the memory.
    """
    starts = range(0, len(rows) - window + 1, stride)
    width = rows.shape[1]
    for first in range(0, len(starts), BATCH):
        batch = starts[first : first + BATCH]
        old, new = batch[0], batch[0] + window
        moved = (len(batch) - 1) * stride
        leaving = rows[old : old + moved].reshape(-1, stride, width)
        entering = rows[new : new + moved].reshape(-1, stride, width)
        changes = np.concatenate([entering, leaving], axis=1)
        moments = np.empty((len(batch), width, width))
        moments[0] = rows[old:new].T @ rows[old:new]
        for (before, after), u, v in zip(
            itertools.pairwise(moments), changes, changes * _signs(stride)[:, None], strict=True
        ):
            np.matmul(u.T, v, out=after)
            after += before
        moments /= window
        yield Batch(moments, changes)


def _signs(stride: int) -> Array:
    """+1 for each row that enters, −1 for each row that leaves."""
    return np.repeat([1.0, -1.0], stride)


def sample_extents(rows: Array, window: int, stride: int) -> Iterator[Extents]:
    """Boxes around the vertices of each window, in batches."""
    for batch in window_moments(rows, window, stride):
        K = _followed(batch, window)
        usable = None if K is None else _usable(batch.moments, K)
        if K is None or usable is None or not usable[[0, -1]].all():
            K, rms, usable = inverses(batch.moments)
            K /= rms[:, :, None] * rms[:, None, :]
        boxes = [extent(vertices_of(K[part])) for part in _parts(K)]
        lower, upper = (np.concatenate(side) for side in zip(*boxes, strict=True))
        yield Extents(lower, upper, usable)


def _parts(stack: Array) -> Iterator[slice]:
    """Slices of a stack of matrices that are small enough for the processor's cache, at least one matrix each."""
    step = max(1, CACHED // stack[0].size)
    return (slice(first, first + step) for first in range(0, len(stack), step))


def _followed(batch: Batch, window: int) -> Array | None:
    """Inverses of the moments, each from the one before; None where this is no cheaper or has lost digits."""
    moments, changes = batch
    rank, width = changes.shape[1:]
    if len(moments) < 3 or 4 * rank > width:
        return None
    scaled = changes / np.sqrt(window)
    C = np.diag(_signs(rank // 2))
    K = np.empty_like(moments)
    try:
        K[0], last = np.linalg.inv(moments[[0, -1]])
    except np.linalg.LinAlgError:
        return None
    for (before, after), u in zip(itertools.pairwise(K), scaled, strict=True):
        seen = u @ before
        _, _, x, singular = linalg.lapack.dgesv(C + seen @ u.T, seen)
        if singular:
            return None
        np.matmul(seen.T, x, out=after)
        np.subtract(before, after, out=after)
    error = float(np.linalg.norm(K[-1] - last) / np.linalg.norm(last))
    return K if error < _LOST_DIGITS else None


def _usable(moments: Array, K: Array) -> Flags:
    """Whether each inverse has correct digits, as `inverses` says; all others become the identity."""
    power = np.diagonal(moments, axis1=-2, axis2=-1)
    rms = np.sqrt(np.where(power > 0, power, 1.0))[:, None, :]
    norms = [
        np.concatenate([((np.abs(x[i]) @ d[i].mT).mT * d[i]).max(axis=(-2, -1)) for i in _parts(x)])
        for x, d in ((moments, 1 / rms), (K, rms))
    ]
    positive = (np.diagonal(K, axis1=-2, axis2=-1) > 0).all(axis=-1)
    usable = np.asarray(positive & (norms[0] * norms[1] < CONDITION_LIMIT * np.clip(power.min(axis=-1), 0.0, 1.0)))
    K[~usable] = np.eye(K.shape[-1])
    return usable


def calibrated_extents(rows: Array, window: int, stride: int, block: int, quantile: float) -> Iterator[Extents]:
    """Boxes around the vertices widened by `quantile` standard errors, a window at a time."""
    blocks = -(-window // block)
    padding = np.zeros((blocks * block - window, rows.shape[1]))  # the last block may be a shorter one
    sizes = np.full(blocks, block) - np.append(np.zeros(blocks - 1, dtype=int), len(padding))
    for start in range(0, len(rows) - window + 1, stride):
        x = np.vstack([rows[start : start + window], padding]).reshape(blocks, block, -1)
        sums = x.mT @ x
        K, rms, usable = inverses(sums.sum(axis=0)[None] / window)
        inverse, scale = K[0], rms[0]
        theta = vertices_of(inverse)
        yy = inverse @ (sums / np.outer(scale, scale)) @ inverse  # Σ y yᵀ over each block, y = K x
        denominator = yy[:, -1, :] - sizes[:, None] * inverse[-1]
        doubtful = np.abs(inverse[-1]) <= quantile * _standard_error(denominator, window)
        with np.errstate(divide="ignore", invalid="ignore"):  # K_Lj = 0: the vertex is at infinity already
            influence = (yy[:, :-1, :] + theta * yy[:, -1:, :]) / inverse[-1]
            spread = np.where(doubtful, np.inf, quantile * _standard_error(influence, window))
            lower, upper = extent(theta - spread)[0], extent(theta + spread)[1]
        unit = scale[-1] / scale[:-1]
        yield Extents((lower * unit)[None], (upper * unit)[None], usable)


def _standard_error(block_sums: Array, window: int) -> Array:
    """Return the standard error of a window's mean from its blocks' sums of terms that add up to zero."""
    blocks = len(block_sums)
    return np.asarray(np.sqrt((block_sums**2).sum(axis=0) * blocks / (blocks - 1)) / window)


def inverses(moments: Array) -> tuple[Array, Array, Flags]:
    """Inverses K of a stack of moments, each scaled to unit diagonal.

    Parameters
    ----------
    moments : ndarray, shape (n, p + 1, p + 1)
        Moments of variables whose mean square over the complete log is one.

    Returns
    -------
    K : ndarray, shape (n, p + 1, p + 1)
        Inverses of the scaled moments, meaningless where not usable.
    rms : ndarray, shape (n, p + 1)
        The scales.
    usable : ndarray of bool, shape (n,)
        Whether K has correct digits. A variable that hardly moves in a window keeps the rounding of the
        samples it was summed with, so its weakness counts against the condition number.
    """
    power = np.diagonal(moments, axis1=-2, axis2=-1)
    rms = np.sqrt(np.where(power > 0, power, 1.0))
    scaled = moments / (rms[:, :, None] * rms[:, None, :])
    try:
        K = np.linalg.inv(scaled)
    except np.linalg.LinAlgError:  # some window is exactly singular; it must not take its batch with it
        singular = ~(np.linalg.cond(scaled, 1) < CONDITION_LIMIT)
        K = np.linalg.inv(np.where(singular[:, None, None], np.eye(scaled.shape[-1]), scaled))
        K[singular] = np.inf
    condition = np.linalg.norm(scaled, 1, axis=(-2, -1)) * np.linalg.norm(K, 1, axis=(-2, -1))
    positive = (np.diagonal(K, axis1=-2, axis2=-1) > 0).all(axis=-1)
    usable = positive & (condition < CONDITION_LIMIT * np.clip(power.min(axis=-1), 0.0, 1.0))
    K[~usable] = np.eye(scaled.shape[-1])
    return K, rms, usable


def correlation_length(rows: Array, window: int) -> int:
    """Rows that form one block: twice the lag at which the slowest regression residual is no longer correlated.

    The residuals are those of all p + 1 regressions, K x up to scale: the influence functions are their
    products, and the ones that blame a column are often slower than the torque's.
    """
    K, _, usable = inverses((rows.T @ rows / len(rows))[None])
    residuals = rows @ K[0] if usable[0] else rows
    length = next_fast_len(2 * len(rows))
    spectra = np.fft.rfft(residuals, length, axis=0)
    covariance = np.fft.irfft(np.abs(spectra) ** 2, length, axis=0)[: max(1, window // 8)]
    noticeable = np.abs(covariance) > max(0.1, 3 / np.sqrt(len(rows))) * covariance[0]
    last = int(np.flatnonzero(noticeable.any(axis=1)).max(initial=0))
    return int(np.clip(2 * last + 1, -(-window // 64), max(1, window // 8)))
