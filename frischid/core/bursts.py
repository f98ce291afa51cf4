"""Bursts: stretches of time in which signals are far larger than usual.

With u_j the robust standard deviation of signal j, from the median absolute value, the smoothed energy is

    z_j(t) = mean of (x_j / u_j)² over a short time around t.

A burst is a stretch of time in which the largest z_j stays above an edge and reaches a higher level at least once.

Source: Rousseeuw and Leroy 1987, Robust Regression and Outlier Detection, Wiley.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage
from scipy.special import ndtri

from frischid.core.types import Array

MEDIAN_OF_NOISE = float(ndtri(0.75))
"""Median absolute value of Gaussian noise over its standard deviation."""
ROBUST_EFFICIENCY = 0.37
"""Efficiency of `robust_std` on Gaussian noise (Rousseeuw and Croux 1993, J. Am. Stat. Assoc. 88(424))."""


def robust_std(x: Array) -> Array:
    """Standard deviation of noise around zero, along the first axis; a few large values hardly change it.

    Parameters
    ----------
    x : ndarray, shape (N, ...)

    Returns
    -------
    ndarray, shape (...)

    Examples
    --------
    >>> float(robust_std(np.array([-0.6745, 0.6745, 0.6745, 1000.0])).round(3))
    1.0
    """
    return np.asarray(np.median(np.abs(x), axis=0) / MEDIAN_OF_NOISE)


@dataclass(frozen=True)
class BurstRule:
    """What counts as a burst.

    Examples
    --------
    >>> squares = np.ones((1000, 2))
    >>> squares[400:450, 1] = 100.0
    >>> smooth, found = BurstRule().bursts(squares, step=0.01)
    >>> found
    [slice(389, 461, None)]
    """

    seconds: float = 0.25
    """s. The energy is smoothed over this time: shorter than a contact, longer than a reversal. By judgement."""
    edge: float = 6.0
    """Squared robust standard deviations. A burst lasts, and a signal shows it, as long as the smoothed energy is above
    this. By judgement."""
    energy: float = 30.0
    """Squared robust standard deviations. A burst reaches this smoothed energy at least once. By judgement."""

    def samples(self, step: float) -> int:
        """Samples over which the energy is smoothed; `step` is the time between samples, s."""
        return max(1, round(self.seconds / step))

    def bursts(self, squares: Array, step: float) -> tuple[Array, list[slice]]:
        """Smoothed energy, and the bursts in order of time.

        Parameters
        ----------
        squares : ndarray, shape (N, J)
            Signals in robust standard deviations, squared.
        step : float
            Time between samples, s.

        Returns
        -------
        smooth : ndarray, shape (N, J)
        found : list of slice
        """
        smooth = ndimage.uniform_filter1d(squares, self.samples(step), axis=0)
        largest = smooth.max(axis=1)
        labels, count = ndimage.label(largest > self.edge)
        places = [where for (where,) in ndimage.find_objects(labels, count)]
        return smooth, [where for where in places if largest[where].max() >= self.energy]


BURSTS = BurstRule()
"""The rule of checks and of the diagnosis, where nobody gives another one."""
