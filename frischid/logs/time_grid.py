"""Samples at their true time stamps, interpolated to a uniform grid; and gaps, which are not interpolated.

    x(t) = Σ_k c_k B_k(t),   x(t_i) = x_i

Cubic splines go through the samples at their stamps. A gap in the stamps ends one stretch of motion and begins another,
because a spline across the gap would invent samples.

Source: C. de Boor, "A Practical Guide to Splines", 1978.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline

from frischid.core.types import Array
from frischid.logs.filters import LowPass
from frischid.logs.log import Log


def largest_gap(step: float, lowpass: LowPass) -> float:
    """Longest time between two stamps that still is no gap, s: four steps, or a tenth of the cut-off's period."""
    return max(4 * step, 0.1 / lowpass.cutoff if lowpass.cutoff else 0.0)


def breaks_of(log: Log, lowpass: LowPass) -> NDArray[np.intp]:
    """First sample of every stretch without a gap: zero, and each sample after a gap."""
    steps = np.diff(log.t)
    return np.append(0, np.flatnonzero(steps > largest_gap(float(np.median(steps)), lowpass)) + 1)


def uniform(t: Array, *channels: Array) -> tuple[Array, ...]:
    """Interpolate channels (N, J) to a uniform grid of the median step by cubic splines; all-NaN columns stay NaN."""
    step = float(np.median(np.diff(t)))
    count = int((t[-1] - t[0]) / step * (1 + 1e-12)) + 1
    grid = t[0] + step * np.arange(count)
    if count == len(t) and np.abs(grid - t).max() < 1e-6 * step:
        return (t, *channels)
    out = []
    for x in channels:
        y = np.full((count, x.shape[1]), np.nan)
        present = ~np.isnan(x).any(axis=0)
        if present.any():
            y[:, present] = make_interp_spline(t, x[:, present], k=3)(np.minimum(grid, t[-1]))
        out.append(y)
    return (grid, *out)
