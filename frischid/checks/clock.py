"""Times at which the samples were really taken.

The positions are a second clock. Between two samples they advance by ``Δq = q̇ Δt``. The speed q̇ is known from the
samples around, as the mean v̄. So every pair of samples k tells the time ε_k that passed between them, from all moving
joints j at once:

    ε_k = Σ_j (Δq_jk v̄_jk / σ_j²) / Σ_j (v̄_jk² / σ_j²)

(least squares, with σ_j the noise of the positions). If the stamps are the times of measurement, ε follows the steps of
the stamps with slope one. If the stamps are times of arrival at a computer, the stamps jitter and the positions do not:
the slope is zero. If the samples were read from a buffer, the positions stand still for one step and move by two steps
in the next.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy import ndimage

from frischid.checks.channels import resolved_noise, testifies
from frischid.checks.check_criteria import CheckCriteria
from frischid.checks.log_issue import Notebook
from frischid.core.text import percent, rounded
from frischid.core.types import Array
from frischid.logs.filters import polynomial_taps
from frischid.logs.log import CHANNELS, Log
from frischid.logs.mapping_rules import TICKS_PER_SECOND
from frischid.logs.repeated_motion import LEAST_OVERLAP, repeat_of


def check_clock(log: Log, notes: Notebook, *, still: bool = False) -> None:
    """Rate, jitter, gaps, repeated samples, repeated motions, stamps of arrival, unit of time.

    An arm that stands `still` is no clock, and the gaps between its poses cost nothing.
    """
    step = np.diff(log.t)
    usual = float(np.median(step))
    notes.facts |= {
        "samples": len(log),
        "seconds": log.duration,
        "rate_hz": 1 / usual,
        "mean_rate_hz": (len(log) - 1) / log.duration,
        "steps_ms": [1e3 * float(x) for x in (step.min(), usual, step.max())],
    }
    mean = log.duration / (len(log) - 1)
    criteria = notes.criteria
    if 1 / min(usual, mean) < criteria.slowest_rate or 1 / max(usual, mean) > criteria.fastest_rate:
        _wrong_unit(log, 1 / mean, notes)
        return
    if still:
        return
    repeated = _repeats(log, criteria)
    notes.facts["repeated_share"] = float(repeated.mean())
    if repeated.mean() > criteria.repeated_share:
        notes.add(
            "repeated samples",
            f"{int(repeated.sum())} rows ({percent(repeated.mean(), 1)}) repeat the row before under a new stamp while "
            "the robot moves",
            (),
            "certain",
            "record each controller cycle once, or delete the repeats; derivatives of such positions are spikes",
        )
    _gaps(step, usual, notes)
    again = repeat_of(log.t, log.q, log.t, log.q, LEAST_OVERLAP) if np.isfinite(log.q).all() else None
    if again is not None:
        notes.facts |= {"comes_again_after": again.shift, "repeated_seconds": again.overlap}
    _arrival(log, step, usual, notes)


def _wrong_unit(log: Log, rate: float, notes: Notebook) -> None:
    """Report a wrong unit of time, and the unit with which the rate would be that of a robot.

    With such a unit the joints move as joints can. Else the rows are no samples of a motion, such as a table of poses.
    """
    low, high = notes.criteria.likely_rates
    stride = _usual_stride(log)
    units = {name: rate * factor for name, factor in TICKS_PER_SECOND.items() if low <= rate * factor <= high}
    apart = bool(units) and all(stride * hz > notes.criteria.jump_speed for hz in units.values())
    guess = ", ".join(f"{name} ({hz:.4g} Hz)" for name, hz in units.items())
    hint = f"; it looks like {guess}" if guess and rate < notes.criteria.slowest_rate and not apart else ""
    hint = f"; in {next(iter(units))} the joints would move as no joint can" if apart else hint
    advice = 'give the stamps in seconds, or say time_unit = "ms", "us" or "ns" under [file] in a mapping file'
    notes.add(
        "unit of time",
        f"the stamps are {1 / rate:.4g} s apart, {rate:.3g} samples per second{hint}",
        (),
        "certain" if guess and not apart else "likely",
        "a motion needs 100 samples per second or so; of a table with one row for each pose, write each row ten times, "
        "0.1 s apart, and the next pose 10 s later: gravity can be fitted then"
        if apart
        else advice,
        blocks=True,
    )


def _usual_stride(log: Log) -> float:
    """Median way of the fastest joint from row to row, rad (m); joints that seem to turn several times as degrees."""
    turns = np.ptp(log.q, axis=0) > 4 * np.pi
    return float(np.median((np.abs(np.diff(log.q, axis=0)) * np.where(turns, np.pi / 180, 1.0)).max(axis=1)))


def _repeats(log: Log, criteria: CheckCriteria) -> np.ndarray:
    """Rows equal to the row before in every channel, although the joints are moving, (N - 1,)."""
    same = np.ones(len(log) - 1, bool)
    for channel in CHANNELS:
        values = getattr(log, channel)
        if values is not None:
            same &= (np.diff(np.nan_to_num(values), axis=0) == 0).all(axis=1)
    advance = np.abs(ndimage.uniform_filter1d(np.diff(log.q, axis=0), criteria.position_window, axis=0))
    finest = np.array([_finest(q) for q in log.q.T])
    return np.asarray(same & (advance > criteria.repeat_motion * finest).any(axis=1))


def _finest(x: Array) -> float:
    """Smallest change of a channel: a smaller motion of the joint cannot be seen."""
    changes = np.abs(np.diff(x))
    return float(changes[changes > 0].min()) if changes.any() else np.inf


def _gaps(step: Array, usual: float, notes: Notebook) -> None:
    wide = step > notes.criteria.gap_steps * usual
    lost = float(np.round(step[step > 1.5 * usual] / usual - 1).sum()) / len(step)
    notes.facts |= {"gaps": int(wide.sum()), "missing_share": lost}
    if not wide.any():
        return
    at = "" if len(step) == 1 else f", after sample {int(step.argmax()) + 1}"
    notes.add(
        "gap",
        f"{int(wide.sum())} gap{'s' * (int(wide.sum()) > 1)} in the time stamps, the longest "
        f"{1e3 * step.max():.3g} ms{at} (usual "
        f"step {1e3 * usual:.3g} ms)",
        (),
        "certain",
        "long gaps split the log and cost data on both sides; record without losses, or on the controller itself",
    )


class _Clocks(NamedTuple):
    """The steps of the stamps beside those that the positions tell, less the mean step around each, in usual steps."""

    jitter: float
    """Rms deviation of the stamps' steps."""
    slope: float
    error: float
    """`slope`, `error`: Factor by which the positions follow these deviations, with its standard error; 1 for times of
    measurement."""
    off: float
    expected: float
    """`off`, `expected`: Rms difference of both clocks, and that which the noise of the positions causes."""
    still: float
    double: float
    """`still`, `double`: Shares of the steps over which the positions stand still, and advance by two."""


def _clocks(log: Log, step: Array, usual: float, criteria: CheckCriteria) -> _Clocks | None:
    """Compare the stamps with the positions; None where too few positions move."""
    window = criteria.position_window
    inside = slice(window, -window)
    able = testifies(log.q, criteria) if len(log) >= 10 * window else np.zeros(log.q.shape[1], bool)
    if not able.any():
        return None
    told, weight, steps = (x[inside] for x in (*_told_by_positions(log.q[:, able], log.t, criteria), step))
    mean = ndimage.uniform_filter1d(steps, window)
    # Beside a gap that is longer than the window, the mean step and the mean speed are those of nothing.
    whole = ndimage.maximum_filter1d(step, 2 * window + 1)[inside] < window * step.mean()
    use = (steps < 3 * usual) & (weight > np.median(weight)) & (weight > 0) & whole
    if use.sum() < criteria.enough_samples:
        return None
    w = np.minimum(weight[use], np.quantile(weight[use], 0.9))
    x, y = (steps - mean)[use] / usual, (told - mean)[use] / usual
    jitter, off = (float(np.sqrt(np.average(z**2, weights=w))) for z in (x, y - x))
    expected = float(np.sqrt(np.average(2 / weight[use], weights=w))) / usual
    slope, error = np.nan, np.inf
    if jitter > 1e-4:
        slope = float(np.sum(w * x * y) / np.sum(w * x**2))
        error = float(np.sqrt(np.sum((w * x * (y - slope * x)) ** 2)) / np.sum(w * x**2))
    still, double = (float(np.mean(np.abs(y + mean[use] / usual - k) < 0.25)) for k in (0, 2))
    return _Clocks(jitter, slope, error, off, expected, still, double)


def _arrival(log: Log, step: Array, usual: float, notes: Notebook) -> None:
    """Report stamps that are not the times of measurement."""
    criteria = notes.criteria
    found = _clocks(log, step, usual, criteria)
    if found is None:
        return
    notes.facts["jitter"] = found.jitter
    clear = found.error < criteria.clear_slope_error
    if clear:
        notes.facts |= {"stamps_follow": found.slope, "stamps_follow_error": found.error}
    advice = (
        "record the controller's own cycle count or time (header.stamp, not the time of arrival); if the controller's "
        "cycle is known, rebuild the stamps from it. Until then a regular clock is used where it fits better"
    )
    words = f"steps between {1e3 * step.min():.3g} and {1e3 * step.max():.3g} ms (usual {1e3 * usual:.3g} ms)"
    arrived = found.slope + criteria.significant_errors * found.error < criteria.host_slope
    if found.jitter > criteria.host_jitter and clear and arrived:
        what = (
            f"{words}, a jitter of {percent(found.jitter, 1)} of a step that the positions do not show (they follow "
            f"the jitter by a factor of {rounded(found.slope, found.error)}; a real jitter has 1): the stamps are "
            "times of arrival, not of measurement"
        )
        notes.add("host clock", what, (), "certain", advice)
    elif found.off > criteria.buffer_jitter and found.off > criteria.buffer_noise * found.expected:
        what = (
            f"{words}; the positions stand still over {percent(found.still, 1)} of the steps and advance by two over "
            f"{percent(found.double, 1)}, and the stamps do not show this: samples were read from a buffer, not when "
            "they were measured"
        )
        notes.add("host clock", what, (), "certain", advice)
    elif found.jitter > criteria.unclear_jitter and not clear:
        what = f"{words}; the positions cannot tell whether the stamps are the times of measurement"
        notes.add("jitter", what, (), "possible", "prefer stamps made where the positions are measured")


def _told_by_positions(q: Array, t: Array, criteria: CheckCriteria) -> tuple[Array, Array]:
    """Time between samples computed from the positions [s], and 1 / variance of this time [1/s²], both (N - 1,)."""
    taps = polynomial_taps(criteria.position_window // 2, 3, 1)
    slope = ndimage.correlate1d(q, taps, axis=0, mode="nearest")
    speed = slope / ndimage.correlate1d(t, taps, mode="nearest")[:, None]
    noise = resolved_noise(q, criteria)
    seen = (noise > 0) & (np.ptp(q, axis=0) > 0)
    if not seen.any():
        noise, seen = np.maximum(noise, 1e-12), np.ptp(q, axis=0) > 0
    speed = ((speed[1:] + speed[:-1]) / 2 / np.where(seen, noise, np.inf))[:, seen]
    advance = np.diff(q, axis=0)[:, seen] / noise[seen]
    weight = np.sum(speed**2, axis=1)
    return np.sum(speed * advance, axis=1) / np.maximum(weight, 1e-300), weight
