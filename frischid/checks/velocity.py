"""The measured velocity of a joint compared with the slope of its measured position.

    v(t) ≈ s · q̇(t − d)

The delay d and the factor s are those of `frischid.logs.velocity_lag`. A delay comes from a filter in the drive. A
factor of 57.3 means degrees, -1 means a wrong sign, and a gear ratio means that the velocity is that of the motor. If
the slope of another joint's position correlates best, the velocity column belongs to that joint.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from frischid.checks.channels import testifies
from frischid.checks.log_issue import Notebook, span
from frischid.core.types import Array
from frischid.logs.column_units import DEGREES_PER_RADIAN, TURNS_PER_MINUTE
from frischid.logs.derivatives import LATE_VELOCITY
from frischid.logs.filters import LowPass, correlate, derivative_taps, noise_level
from frischid.logs.log import Log
from frischid.logs.mapping_rules import TICKS_PER_SECOND
from frischid.logs.time_grid import uniform
from frischid.logs.velocity_lag import VelocityLag, peaks, velocity_lag

_LAG_ERRORS = 3.0
"""A lag within so many standard errors of zero is noise."""
_ADVICE = (
    "set velocity_factor = {value:.4g} under {table} in a mapping file, or leave the column out; frischid does not "
    "use it now"
)


def check_velocity(log: Log, lowpass: LowPass, notes: Notebook) -> None:
    """Report late, scaled, negated, exchanged and unrelated velocities."""
    criteria = notes.criteria
    moving = testifies(log.q, criteria)
    which = np.flatnonzero(log.has("v") & moving & (np.ptp(np.nan_to_num(_measured(log)), axis=0) > 0))
    if len(which) == 0:
        return
    step, v, slope, reliability = _both(log, lowpass)
    if len(v) < criteria.fewest_samples:
        return
    found = velocity_lag(v, slope, step, criteria.longest_velocity_lag)
    share = np.sqrt(np.maximum(np.outer(*reliability), criteria.velocity_signal**2))
    own = found.correlation / np.diag(share)
    factor, late = found.factor, found.lag
    seen = np.zeros(len(log.joints), bool)
    seen[which] = (reliability[:, which] > criteria.velocity_signal).all(axis=0)
    good = seen & (np.abs(own) > criteria.related_correlation)
    notes.per_joint("velocity_lag", np.where(good, late, np.nan))
    notes.per_joint("velocity_factor", np.where(good, factor, np.nan))
    independent = 2 * (lowpass.cutoff or 0.5 / step) * step * len(v)
    scatter = np.sqrt((1 - reliability).sum(axis=0) / max(independent, 1.0))
    _late(found, slope, step, good, scatter, notes)
    _scaled(factor, good, notes)
    for i in map(int, np.flatnonzero(seen & ~good)):
        _unrelated(i, peaks(v[:, i], slope, step, criteria.longest_velocity_lag)[1] / share[i], seen, notes)


def _measured(log: Log) -> Array:
    return np.zeros_like(log.q) if log.v is None else log.v


def _both(log: Log, lowpass: LowPass) -> tuple[float, Array, Array, Array]:
    """Time step, measured and derived velocity of the longest stretch without a gap, through the same filter.

    The last result is the share of the variance of each velocity that is not white noise, (2, J).
    """
    breaks = np.flatnonzero(np.diff(log.t) > 0.1 + 4 * np.median(np.diff(log.t))) + 1
    edges = np.concatenate([[0], breaks, [len(log)]])
    longest = int(np.argmax(np.diff(edges)))
    start, stop = int(edges[longest]), int(edges[longest + 1])
    part = log.slice(start, stop)
    t, q, v = uniform(part.t, part.q, np.nan_to_num(_measured(part)))
    step = float((t[-1] - t[0]) / (len(t) - 1))
    slopes = derivative_taps(1, step, lowpass.cutoff)
    smooth = np.asarray(lowpass.taps(step))
    half = len(slopes) // 2
    if len(t) < len(slopes) + len(smooth) + 50:
        return step, v[:0], v[:0], np.zeros((2, v.shape[1]))
    derived = correlate(slopes, q - q[0])
    both = [correlate(smooth, x) for x in (v[half : len(v) - half], derived)]
    levels = noise_level(v) * np.linalg.norm(smooth), noise_level(q) * np.linalg.norm(np.convolve(slopes, smooth))
    reliability = [1 - (level / np.maximum(x.std(axis=0), 1e-300)) ** 2 for level, x in zip(levels, both, strict=True)]
    return step, both[0], both[1], np.clip(reliability, 0.0, 1.0)


def _late(
    found: VelocityLag, slope: Array, step: float, good: NDArray[np.bool_], scatter: Array, notes: Notebook
) -> None:
    """Report lags; `scatter` is the standard error that noise leaves in the error of each velocity, (J,)."""
    lag = found.lag
    acceleration = np.gradient(slope, step, axis=0).std(axis=0)
    error = np.abs(lag) * acceleration / np.maximum(slope.std(axis=0), 1e-300)
    late = (
        good
        & (error > np.maximum(LATE_VELOCITY, _LAG_ERRORS * scatter))
        & (np.abs(lag) > notes.criteria.late_velocity_steps * step)
    )
    if not late.any():
        return
    way = "lags its own position" if np.median(lag[late]) > 0 else "runs ahead of its own position"
    notes.add(
        "late velocity",
        f"the measured velocity {way} by {span(np.abs(lag[late]))} s (median "
        f"{np.median(np.abs(lag[late])):.2g} s), an error of {span(100 * found.error[late], ' %')}",
        notes.which(late),
        "certain",
        "it is not used: velocities are derived from the positions; record it unfiltered, or leave the columns out",
    )


def _scaled(factor: Array, good: NDArray[np.bool_], notes: Notebook) -> None:
    """Report a factor other than one, with its likely cause: a unit, a sign or a gear."""
    near = notes.criteria.factor_tolerance
    odd = good & (np.abs(factor - 1) > near)
    everywhere = odd[good].all() and good.any()
    for unit, scale in TICKS_PER_SECOND.items():
        hit = odd & ((np.abs(factor / scale - 1) < near) | (np.abs(factor * scale - 1) < near))
        if scale > 1 and everywhere and hit[good].all():
            advice = "correct time_unit in a mapping file"
            _say(notes, hit, factor, "unit of time", f"the stamps are in {unit}", advice, True)
            return
    in_degrees = "positions are in degrees, velocities are not"
    cases = [
        (DEGREES_PER_RADIAN, "degrees", "velocities are in degrees", _ADVICE, False),
        (1 / DEGREES_PER_RADIAN, "degrees", in_degrees, "convert the positions", True),
        (-1.0, "velocity sign", "it has the wrong sign", _ADVICE, False),
        (TURNS_PER_MINUTE, "velocity scale", "velocities are in revolutions per minute", _ADVICE, False),
    ]
    for known, kind, words, advice, blocks in cases:
        hit = odd & (np.abs(factor / known - 1) < near)
        _say(notes, hit, factor, kind, words, advice, blocks)
        odd &= ~hit
    _say(notes, odd, factor, "velocity scale", "a gear ratio or a unit", _ADVICE, False)


def _say(
    notes: Notebook, hit: NDArray[np.bool_], factor: Array, kind: str, words: str, advice: str, blocks: bool
) -> None:
    if hit.any():
        what = f"the measured velocity is {span(factor[hit])} times the slope of the position: {words}"
        where = notes.which(hit)
        table = f"[joint.{where[0]}]{' and the like' * (len(where) > 1)}"
        advice = advice.format(table=table, value=1 / float(factor[hit][0]))
        notes.add(kind, what, where, "certain", advice, blocks=blocks)


def _unrelated(i: int, correlation: Array, seen: NDArray[np.bool_], notes: Notebook) -> None:
    """Report that the velocity column of joint i belongs to another joint or to none; its correlations, (J,)."""
    j = int(np.argmax(np.where(seen, np.abs(correlation), 0.0)))
    if j != i and abs(correlation[j]) > notes.criteria.related_correlation:
        what, kind = f"the measured velocity belongs to {notes.names[j]}", "exchanged velocity"
    else:
        what = f"the measured velocity is not the slope of the position (correlation {correlation[i]:.2f})"
        kind = "unrelated velocity"
    notes.add(kind, what, (notes.names[i],), "certain", "check the column names; frischid does not use it now")
