"""Frisch boxes of windows that slide over the rows, for the bounding-box recursion.

Moments of a window follow from those of the window before by adding the new rows and subtracting the old ones. ``K`` is
the inverse of the moments; its columns give the window's vertices.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len

from frischid.core.types import Array
from frischid.estimators.frisch import CONDITION_LIMIT, extent, vertices_of

Flags = NDArray[np.bool_]

BATCH = 256
"""Windows whose moments are updated from one anchor: enough to amortise it, too few to drift."""


class Extents(NamedTuple):
    """Boxes of a batch of windows, ``(n, p)`` each, and which of them had usable moments, ``(n,)``."""

    lower: Array
    upper: Array
    usable: Flags


def window_moments(rows: Array, window: int, stride: int) -> Iterator[Array]:
    """Mean moments of the sliding windows, in batches of shape (n, p + 1, p + 1).

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
        moments = np.empty((len(batch), width, width))
        moments[0] = rows[old:new].T @ rows[old:new]
        moments[1:] = entering.mT @ entering - leaving.mT @ leaving
        yield np.cumsum(moments, axis=0, out=moments) / window


def sample_extents(rows: Array, window: int, stride: int) -> Iterator[Extents]:
    """Boxes around the vertices of each window, in batches."""
    for moments in window_moments(rows, window, stride):
        K, rms, usable = inverses(moments)
        lower, upper = extent(vertices_of(K))
        unit = rms[:, -1:] / rms[:, :-1]
        yield Extents(lower * unit, upper * unit, usable)


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
