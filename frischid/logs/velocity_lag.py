"""The lag of measured velocities behind the slopes of the positions, and their factor over these slopes.

    v(t) ≈ s · q̇(t − d)

The cross-correlation of v and q̇ peaks at the delay d; s is the least-squares factor at that delay.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from frischid.core.types import Array

LONGEST_VELOCITY_LAG = 1.0
"""s. Longest lag that is searched: no filter of a drive is later."""


class VelocityLag(NamedTuple):
    """Lag of each velocity behind its own slope in s, factor over it, correlation at the lag, and error, (J,) each.

    The error is the rms difference of the velocity, without its factor, from the slope, over the rms slope.
    """

    lag: Array
    factor: Array
    correlation: Array
    error: Array


def velocity_lag(v: Array, slope: Array, step: float, longest: float = LONGEST_VELOCITY_LAG) -> VelocityLag:
    """Compare velocities (N, J) with slopes of positions (N, J) that passed the same filter, `step` seconds apart."""
    J = v.shape[1]
    lag, correlation = np.zeros(J), np.zeros(J)
    for j in range(J):
        (lag[j],), (correlation[j],) = peaks(v[:, j], slope[:, [j]], step, longest)
    factor, fine = _aligned(v, slope, lag, step)
    left = v / np.where(factor == 0, 1.0, factor) - slope
    error = np.sqrt(np.mean(left**2, axis=0) / np.maximum(np.mean(slope**2, axis=0), 1e-300))
    return VelocityLag(fine, factor, correlation, error)


def peaks(v: Array, slope: Array, step: float, longest: float = LONGEST_VELOCITY_LAG) -> tuple[Array, Array]:
    """Lag in s of a velocity (N,) behind each slope (N, K), to a fraction of a sample, and the correlation there."""
    N, K = slope.shape
    reach = min(int(longest / step), N // 4)
    size = 2 ** int(np.ceil(np.log2(N + reach)))
    v, slope = v - v.mean(), slope - slope.mean(axis=0)
    cross = np.fft.irfft(np.fft.rfft(v, size)[:, None] * np.fft.rfft(slope, size, axis=0).conj(), size, axis=0)
    scale = np.sqrt((v**2).sum() * (slope**2).sum(axis=0))
    cross = np.concatenate([cross[size - reach :], cross[: reach + 1]]) / np.maximum(scale, 1e-300)
    lag, best = np.zeros(K), np.zeros(K)
    for j in range(K):
        k = int(np.argmax(np.abs(cross[:, j])))
        shift = 0.0
        if 0 < k < 2 * reach:
            before, here, after = np.abs(cross[k - 1 : k + 2, j])
            curve = before - 2 * here + after
            shift = 0.5 * (before - after) / curve if curve < 0 else 0.0
        lag[j], best[j] = (k - reach + shift) * step, cross[k, j]
    return lag, best


def _aligned(v: Array, slope: Array, lag: Array, step: float) -> tuple[Array, Array]:
    """Factor of each measured velocity over its own slope, and its lag [s] to a fraction of a sample, (J,) each.

    The peak of a correlation is flat, so it gives the lag only to the nearest sample. The remaining lag d follows from
    ``v/s − q̇ ≈ −d q̈`` by least squares.
    """
    factors, lags = np.full((2, v.shape[1]), np.nan)
    for j, k in enumerate(np.round(lag / step).astype(int)):
        late, early = v[max(k, 0) : len(v) + min(k, 0), j], slope[max(-k, 0) : len(v) - max(k, 0), j]
        factors[j] = float(late @ early / max(float(early @ early), 1e-300))
        rate = np.gradient(early, step)
        left = late / (factors[j] or 1.0) - early
        lags[j] = k * step - float(left @ rate / max(float(rate @ rate), 1e-300))
    return factors, lags
