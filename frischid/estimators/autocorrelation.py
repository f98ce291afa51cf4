"""Correlation time of a residual: the number of consecutive samples that count as one independent sample.

With ρ_k the correlation of samples at lag k, the mean over n samples varies like the mean over n/ℓ independent ones,

    ℓ = 1 + 2 Σ_k ρ_k,

with ℓ the integrated autocorrelation time, summed up to the lag where the correlation is below its own noise (Sokal
1997). The sums of products in ρ_k are formed over consecutive parts, each together with the end of the part before, so
a residual of any length is processed part by part.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from scipy import fft

from frischid.core.types import Array

CORRELATION_LAGS = 400
LOST = 0.05  # correlation below which the rest is noise
FEWEST = 10
SAMPLES_AT_ONCE = 20_000  # one transform of many short parts is faster than many transforms


class Autocorrelation:
    """Spread and correlation of a sequence that comes in parts.

    Parameters
    ----------
    lags : int
        Largest lag, in samples.
    """

    def __init__(self, lags: int = CORRELATION_LAGS) -> None:
        self.count, self.total = 0, 0.0
        self.products = np.zeros(lags)  # Σ x_i x_{i−k}
        self._first, self._last = np.empty(0), np.empty(0)
        self._shift: float | None = None

    @classmethod
    def of(cls, parts: Iterable[Array]) -> Autocorrelation:
        """Autocorrelation of all parts, in order."""
        found = cls()
        waiting: list[Array] = []
        for x in parts:
            waiting.append(x)
            if sum(map(len, waiting)) > SAMPLES_AT_ONCE:
                found.add(np.concatenate(waiting))
                waiting.clear()
        if waiting:
            found.add(np.concatenate(waiting))
        return found

    def add(self, x: Array) -> None:
        """Add the next samples."""
        if not len(x):
            return
        lags = len(self.products)
        if self._shift is None:
            self._shift = float(x.mean())  # near the mean of all, so that squares lose no digits
        x = x - self._shift
        before = np.concatenate([self._last, x])
        size = fft.next_fast_len(len(before) + lags, real=True)
        here = np.zeros(size)
        here[len(self._last) : len(before)] = x
        self.products += fft.irfft(fft.rfft(here) * fft.rfft(before, size).conj(), size)[:lags]
        self.count, self.total = self.count + len(x), self.total + float(x.sum())
        self._first = np.append(self._first, x[: lags - len(self._first)])
        self._last = before[-lags:].copy()

    @property
    def covariances(self) -> Array:
        """Sums of products of samples at lag k, less the mean of all, (lags,)."""
        k, mean = np.arange(len(self.products)), self.total / max(self.count, 1)
        first, last = (np.append(0.0, np.cumsum(x))[np.minimum(k, len(x))] for x in (self._first, self._last[::-1]))
        # of both sums over the n − k pairs: all samples but the last k, and all but the first
        sums = (self.total - first) + (self.total - last)
        return np.asarray(self.products - mean * sums + np.maximum(self.count - k, 0) * mean**2)

    @property
    def std(self) -> float:
        """Standard deviation."""
        return float(np.sqrt(max(self.covariances[0], 0.0) / max(self.count, 1)))

    @property
    def time(self) -> float:
        """Integrated autocorrelation time ℓ, in samples."""
        c = self.covariances
        if self.count < FEWEST or not c[0] > 0:
            return 1.0
        rho = c[: self.count // 2] / c[0]
        below = np.flatnonzero(rho <= LOST)
        stop = int(below[0]) if len(below) else len(rho)
        return float(max(1.0, 1 + 2 * rho[1:stop].sum()))


def correlation_time(x: Array) -> float:
    """Integrated autocorrelation time of a residual, in samples."""
    return Autocorrelation.of([x]).time
