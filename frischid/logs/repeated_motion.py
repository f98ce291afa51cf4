"""Is a motion run again? The shift in time after which the positions come back.

    D(s) = Σ_j mean_t (q_j(t + s) − p_j(t))² / var(q_j)

with p the positions of another motion, or of the same motion. Where D is nearly zero over a long overlap, the second
run repeats the first. All shifts are tried at once: the sums are correlations, which the FFT computes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy import fft

from frischid.core.types import Array

SAME_PATH = 0.01
"""Root of D up to which a run repeats another: one part in a hundred of each joint's motion. A drive comes back to its
path within this; two different motions differ by more than one."""
LEAST_OVERLAP = 5.0
"""s. Shortest repeated stretch: the difference of two shorter ones says little about noise."""
LONGEST = 7200.0
"""s. Longest motion that is searched: two hours make a correlation of a second."""
STEP_OF_SEARCH = 0.02
"""s. Step of the positions in the search; the shift is refined between the steps."""


class Repeat(NamedTuple):
    """A run that comes again: ``shift`` is the time from a moment of the second motion to that of the first, s.

    ``overlap`` is the length of the repeated stretch, s.
    """

    shift: float
    overlap: float


def repeat_of(t: Array, q: Array, other_t: Array, other_q: Array, least_shift: float = 0.0) -> Repeat | None:
    """Find the shift after which a motion repeats another one.

    Parameters
    ----------
    t : ndarray, shape (N,)
        Uniform times, s.
    q : ndarray, shape (N, J)
    other_t, other_q : ndarray, shape (M,) and (M, J)
        The other motion; the same one to look for its period.
    least_shift : float
        With the motion itself, only later shifts than this count, s, because zero shift is no repeat.

    Returns
    -------
    Repeat or None
        The best shift, so that ``q(t + shift) ≈ other_q(t)``; None where the motion does not come again.

    Examples
    --------
    >>> import numpy as np
    >>> from frischid.logs.repeated_motion import repeat_of
    >>> t = 0.01 * np.arange(3000)
    >>> found = repeat_of(t, np.sin(2 * np.pi * t / 10)[:, None], t, np.sin(2 * np.pi * t / 10)[:, None], 1.0)
    >>> round(found.shift, 3), round(found.overlap)
    (10.0, 20)
    """
    spread = q.std(axis=0)
    moves = spread > 0
    lengths = t[-1] - t[0], other_t[-1] - other_t[0]
    if not moves.any() or min(lengths) < LEAST_OVERLAP or max(lengths) > LONGEST:
        return None
    scaled = ((x, (y[:, moves] - q[:, moves].mean(axis=0)) / spread[moves]) for x, y in ((t, q), (other_t, other_q)))
    a, b = (_gridded(*motion) for motion in scaled)
    lags = np.arange(1 - len(b), len(a))
    size = fft.next_fast_len(len(lags), real=True)
    spectrum = (fft.rfft(a, size, axis=0) * fft.rfft(b, size, axis=0).conj()).sum(axis=1)
    cross = fft.irfft(spectrum, size)[lags]  # Σ_i a_{i+lag} b_i; negative lags stand at the end
    first, last = np.maximum(lags, 0), np.minimum(lags + len(b), len(a))  # the part of a that overlaps
    power_a, power_b = (np.append(0.0, np.cumsum((x**2).sum(axis=1))) for x in (a, b))
    squares = power_a[last] - power_a[first] + power_b[last - lags] - power_b[first - lags] - 2 * cross
    count = last - first
    later = lags * STEP_OF_SEARCH > least_shift if least_shift else np.ones(len(lags), bool)
    distance = np.where(
        (count * STEP_OF_SEARCH >= LEAST_OVERLAP) & later,
        squares / np.maximum(count, 1) / a.shape[1],
        np.inf,
    )
    k = int(np.argmin(distance))
    part = a[first[k] : last[k]]
    if distance[k] > SAME_PATH**2 or (part.std(axis=0) < 0.5).all():
        return None
    offset = 0.0
    if 0 < k < len(lags) - 1 and np.isfinite(distance[k - 1 : k + 2]).all():  # the least of a parabola
        below, here, above = distance[k - 1 : k + 2]
        offset = 0.5 * float(below - above) / max(float(below - 2 * here + above), 1e-300)
    shift = float(t[0] - other_t[0] + (lags[k] + np.clip(offset, -0.5, 0.5)) * STEP_OF_SEARCH)
    return Repeat(shift, float(count[k] * STEP_OF_SEARCH))


def _gridded(t: Array, x: Array) -> Array:
    """Channels on a grid of `STEP_OF_SEARCH`."""
    grid = np.arange(t[0], t[-1], STEP_OF_SEARCH)
    return np.stack([np.interp(grid, t, y) for y in x.T], axis=1)
