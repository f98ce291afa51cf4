"""Samples at their true times, interpolated to a uniform grid; and gaps, which are not interpolated.

    x(t) = Σ_k c_k B_k(t),   x(t_i) = x_i

Cubic splines go through the samples at their stamps. A gap in the stamps ends one stretch of motion and begins another,
because a spline across the gap would invent samples.

**Stamps that jitter.** A controller often samples at a regular rate, but the stamps are made later, on a busy computer.
An error ε of the stamp then looks like an error ``q̇ ε`` of the position. A position that moves smoothly tells the two
cases apart: with the stamps, or with a regular clock, it has less noise. A joint at rest says nothing, so the noise of
each joint is that of its fast samples (`noise_in_motion`). The clock counts steps and is fitted to the
stamps, ``t_i ≈ t_0 + h k_i`` with k_i the steps so far, so lost samples stay lost. The count is right only if the
stamps jitter about the clock, and do not move away from it for longer. Each stretch without a long gap has its own
clock, and the longest stretch decides: across such a gap there is no noise to compare, and no step to count.

Source: C. de Boor, "A Practical Guide to Splines", 1978.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from statistics import median

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.interpolate import make_interp_spline

from frischid.core.bursts import robust_std
from frischid.core.remembered import Remembered
from frischid.core.types import Array
from frischid.logs.filters import QUARTIC, LowPass, fourth_differences
from frischid.logs.log import FEWEST_SAMPLES, Log

LEAST_JITTER = 1e-3
"""Jitter of the steps, share of the median step, below which stamps count as regular: rounding in a file."""
CLOCK_NOISE = 0.5
"""Share of the positions' noise power, in the median joint, that must vanish before a regular clock replaces stamps."""
AVERAGED_STAMPS = 64
"""Samples over which the distance of the stamps from a clock is averaged: jitter vanishes in this mean."""
BESIDE_LOSS = 8
"""Samples before and after a step that tell whether samples were lost in it."""
LONGEST_BURST = 100
"""Mean steps. A busy computer stamps so many samples late, all at once; in a longer step nothing was sampled."""


def largest_gap(step: float, lowpass: LowPass) -> float:
    """Longest time between two stamps that still is no gap, s: four steps, or a tenth of the cut-off's period."""
    return max(4 * step, 0.1 / lowpass.cutoff if lowpass.cutoff else 0.0)


def breaks_of(log: Log, lowpass: LowPass) -> NDArray[np.intp]:
    """First sample of every stretch without a gap: zero, and each sample after a gap."""
    steps = np.diff(log.t)
    return np.append(0, np.flatnonzero(steps > largest_gap(float(np.median(steps)), lowpass)) + 1)


def retimed(log: Log) -> Log:
    """The log with the times of a regular clock, where the positions say that the stamps jitter and the samples do not.

    Returns
    -------
    Log
        The same object where the stamps are regular, or true.

    Examples
    --------
    >>> import numpy as np
    >>> from frischid import Log
    >>> from frischid.logs.time_grid import retimed
    >>> t = 0.01 * np.arange(500)
    >>> stamps = t + 0.001 * np.random.default_rng(0).uniform(-1, 1, 500)
    >>> regular = Log(stamps, ("a",), np.sin(t)[:, None])  # sampled regularly, stamped late
    >>> bool(np.abs(retimed(regular).t - t).max() < 1e-4)
    True
    >>> true = Log(stamps, ("a",), np.sin(stamps)[:, None])  # sampled when stamped
    >>> retimed(true) is true
    True
    """
    regular = _REGULAR.of(log, "times", lambda: _regular(log))
    return log if regular is None else replace(log, t=regular)


_REGULAR = Remembered[Array | None]()


def _regular(log: Log) -> Array | None:
    """Times of the log's samples on a regular clock; None where the stamps are regular, or true."""
    steps = np.diff(log.t)
    if len(steps) < 2 or np.abs(steps / np.median(steps) - 1).max() < LEAST_JITTER:
        return None
    moving = np.ptp(log.q, axis=0) > 0
    if not moving.any():
        return None
    stretches = _stretches(log.t, LONGEST_BURST * float(steps.mean()))
    regular = np.concatenate([_clock(log.t[stretch], float(np.median(steps))) for stretch in stretches])
    longest = max(stretches, key=lambda stretch: stretch.stop - stretch.start)
    q = log.q[longest][:, moving]
    stamped, clocked = (noise_in_motion(uniform(t[longest], q)[1]) for t in (log.t, regular))
    share = np.median(clocked**2 / np.maximum(stamped**2, 1e-300))
    right = share < 1 - CLOCK_NOISE and _is_jitter(log.t[longest] - regular[longest])
    return regular if right else None


def noise_in_motion(q: Array) -> Array:
    """Noise of evenly sampled positions (N, J) where each joint is faster than its own rms speed, rad (m), (J,).

    An error ε of a stamp adds ``q̇ ε`` to the position. So the samples above the rms speed hold most of what wrong
    stamps add, and a joint that rests for most of a log is judged by the rest of the log.

    Examples
    --------
    >>> import numpy as np
    >>> from frischid.logs.time_grid import noise_in_motion
    >>> jog = np.clip(np.linspace(-5, 6, 2000), 0, 1)[:, None]  # nine tenths at rest
    >>> late = np.interp(np.arange(2000) + np.random.default_rng(0).normal(0, 0.1, 2000), np.arange(2000), jog[:, 0])
    >>> bool(noise_in_motion(late[:, None])[0] > 1e-4 > noise_in_motion(jog)[0])
    True
    """
    fourth, speed = fourth_differences(q), np.abs(q[QUARTIC:] - q[:-QUARTIC])
    fast = speed >= np.sqrt(np.mean(speed**2, axis=0))
    return np.array([robust_std(y[here]) for y, here in zip(fourth.T, fast.T, strict=True)])


def _is_jitter(late: Array) -> bool:
    """Whether stamps jitter about a clock: a late stamp moves itself alone, a wrong count of steps all later stamps."""
    slow = ndimage.uniform_filter1d(late, AVERAGED_STAMPS)
    return bool(slow.std() <= (late - slow).std())


def even_times(t: Array, longest: float) -> Array:
    """Even steps in place of stamps (N,), s, from gap to gap; a gap is a step of more than `longest` mean ones.

    Examples
    --------
    >>> import numpy as np
    >>> from frischid.logs.time_grid import even_times
    >>> t = np.append(0.01 * np.arange(500), 7.0 + 0.01 * np.arange(500))  # with a gap of two seconds
    >>> stamps = t + 0.001 * np.random.default_rng(0).uniform(-1, 1, 1000)
    >>> bool(np.abs(even_times(stamps, 30.0) - t).max() < 0.002)
    True
    """
    parts = _stretches(t, longest * float(np.diff(t).mean()))
    return np.concatenate([np.linspace(t[part][0], t[part][-1], len(t[part])) for part in parts])


def _stretches(t: Array, longest: float) -> list[slice]:
    """Stretches of stamps without a step above `longest`, s."""
    bounds = [0, *(np.flatnonzero(np.diff(t) > longest) + 1).tolist(), len(t)]
    return [slice(a, b) for a, b in pairwise(bounds)]


def _clock(t: Array, step: float) -> Array:
    """The regular clock nearest to the stamps of a stretch without a gap; lost samples are counted."""
    if len(t) < FEWEST_SAMPLES:
        return t
    for _ in range(2):  # the second time with the step that follows from the first count
        counted = np.arange(len(t)) + _lost(t, step)
        clock = np.polynomial.Polynomial.fit(counted, t, 1)
        step = float(clock.deriv()(counted[0]))
    return np.asarray(clock(counted))


def _lost(t: Array, step: float) -> NDArray[np.intp]:
    """Samples lost before each sample, (N,): a loss moves all later stamps, and a late stamp only itself.

    The stamps less the steps so far rise by a whole step at a loss. The lowest of the next `BESIDE_LOSS` and the lowest
    of those before tell this from a burst of late stamps, and the medians from jitter to both sides.
    """
    moved, n = t / step - np.arange(len(t)), min(BESIDE_LOSS, len(t) - 1)
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(moved, n, mode="reflect"), n)
    low, middle = windows.min(axis=1), np.median(windows, axis=1)
    # at each sample, from the n samples before it to the n from it on
    rises = np.minimum(low[n:] - low[:-n], middle[n:] - middle[:-n])[: len(t)]
    counts, values = np.zeros(len(t), dtype=np.intp), moved.tolist()
    before: list[float] = []  # of each sample so far, less the samples lost before it
    total = 0
    for k in np.flatnonzero(rises > 0.5).tolist():
        before += [value - total for value in values[len(before) : k]]
        if not before:
            continue
        earlier, later = before[-n:], [value - total for value in values[k : k + n]]
        count = min(round(min(later) - min(earlier)), round(median(later) - median(earlier)))
        if count > 0:
            counts[k] = count
            total += count
    return np.cumsum(counts)


def uniform(t: Array, *channels: Array) -> tuple[Array, ...]:
    """Interpolate channels (N, J) to a uniform grid of the median step by cubic splines; all-NaN columns stay NaN."""
    step = float(np.median(np.diff(t)))
    count = int((t[-1] - t[0]) / step * (1 + 1e-12)) + 1
    grid = t[0] + step * np.arange(count)
    if count == len(t) and np.abs(grid - t).max() < 1e-6 * step:
        return (t, *channels)
    return (grid, *(at_times(t, x, grid) for x in channels))


def at_times(t: Array, x: Array, times: Array) -> Array:
    """A channel (N, J) at other times (M,), by cubic splines; (M, J), all-NaN columns stay NaN.

    Before the first and after the last sample, the channel keeps its value.
    """
    found = np.full((len(times), x.shape[1]), np.nan)
    present = ~np.isnan(x).any(axis=0)
    if present.any():
        found[:, present] = make_interp_spline(t, x[:, present], k=3)(np.clip(times, t[0], t[-1]))
    return found
