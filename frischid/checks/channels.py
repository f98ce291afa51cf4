"""Limits of each channel: noise, resolution, dead bands, saturation, jumps, standstill."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from frischid.checks.check_criteria import DEFAULT_CRITERIA, CheckCriteria
from frischid.checks.log_issue import Notebook, span
from frischid.core.types import Array
from frischid.logs.filters import noise_level
from frischid.logs.log import DEAD_TORQUE, STANDSTILL_SPAN, Log
from frischid.logs.time_grid import retimed


def check_channels(log: Log, notes: Notebook, *, figures: bool = True, still: bool = False) -> None:
    """Report dead, coarse, saturated and held channels and joints that do not move; note each channel's noise.

    Where the whole arm stands `still`, its torque takes few values, and `check_standing` says that it does not move.
    """
    moving = np.ptp(log.q, axis=0) >= STANDSTILL_SPAN
    t = retimed(log).t  # with another clock, a joint that moves would seem noisy
    notes.facts["channels"] = [c for c in ("v", "a", "tau", "current") if log.has(c).any()]
    for channel in ("q", "v", "tau", "current") if figures else ():
        values, present = getattr(log, channel), log.has(channel)
        if values is None:
            continue
        quanta = quanta_of(values, notes.criteria)
        noise = np.maximum(noise_level(np.nan_to_num(values), t), quanta / np.sqrt(12))
        notes.per_joint(f"noise_{channel}", np.where(present, noise, np.nan))
        notes.per_joint(f"quantum_{channel}", np.where(quanta > 0, quanta, np.nan))
    if still:
        return
    if not moving.all():
        notes.add(
            "no motion",
            f"range below {STANDSTILL_SPAN:g} rad (m): the log tells nothing about the parameters of this joint",
            notes.which(~moving),
            "certain",
            "move it, lock it (--lock), or check its position column",
        )
    _velocity(log, moving, notes)
    for channel, unit in (("tau", "N·m (N)"), ("current", "A")):
        if getattr(log, channel) is not None and (channel == "tau" or not log.has("tau").any()):
            _effort(log, channel, unit, moving, notes)


def testifies(q: Array, criteria: CheckCriteria) -> NDArray[np.bool_]:
    """Joints that moved far enough, compared with the noise and resolution of their positions, to testify; q (N, J)."""
    finest = np.maximum(noise_level(q), quanta_of(q, criteria))
    return np.asarray((np.ptp(q, axis=0) > criteria.testimony_steps * finest) & (np.ptp(q, axis=0) >= STANDSTILL_SPAN))


def quanta_of(x: Array, criteria: CheckCriteria) -> Array:
    """`quantum` of each channel of x (N, J), (J,)."""
    return np.array([quantum(channel, criteria) for channel in x.T])


def resolved_noise(x: Array, criteria: CheckCriteria) -> Array:
    """Standard deviation of the noise of each channel of x (N, J) while it changes, (J,): at least that of rounding.

    A coarse channel of a joint that rests or creeps repeats its values, and repeated values show no noise.
    """
    return np.asarray(np.maximum(noise_level(x), quanta_of(x, criteria) / np.sqrt(12)))


def quantum(x: Array, criteria: CheckCriteria = DEFAULT_CRITERIA) -> float:
    """Step of a channel whose values all lie on a grid; zero where there is no grid."""
    levels = np.unique(x)
    if len(levels) < 2 or len(levels) > criteria.grid_share * len(x):
        return 0.0
    step = float(np.diff(levels).min())
    # binary rounding of decimals splits one level into neighbouring numbers
    while step < 1e-9 * np.ptp(levels) and len(levels) > 2:
        levels = levels[np.append(True, np.diff(levels) > 1e-9 * np.ptp(levels))]
        step = float(np.diff(levels).min())
    off = np.abs((levels - levels[0]) / step - np.round((levels - levels[0]) / step))
    return step if np.median(off) < criteria.grid_deviation else 0.0


def _velocity(log: Log, moving: NDArray[np.bool_], notes: Notebook) -> None:
    if log.v is None:
        return
    dead = log.has("v") & moving & (np.ptp(np.nan_to_num(log.v), axis=0) == 0)
    if dead.any():
        notes.add(
            "dead velocity",
            "the measured velocity never changes while the joint moves",
            notes.which(dead),
            "certain",
            "leave the column out: the velocity is then derived from the positions",
        )


def _effort(log: Log, channel: str, unit: str, moving: NDArray[np.bool_], notes: Notebook) -> None:
    """Report torques that are missing, dead or have a dead band; then check their resolution."""
    values, present, name = getattr(log, channel), log.has(channel), {"tau": "torque"}.get(channel, channel)
    criteria = notes.criteria
    empty = ~present & np.array([f"{channel}_{joint}" in log.empty for joint in log.joints])
    for missing, what in (
        (~present & ~empty, f"no {name} column, while other joints have one"),
        (empty, f"its {name} column is empty, while those of other joints are not"),
    ):
        if missing.any():
            notes.add(
                "no torque",
                what,
                notes.which(missing),
                "certain",
                "its torque row is left out of the fit; record it, or lock the joint if it does not move",
            )
    dead = present & (np.ptp(np.nan_to_num(values), axis=0) <= DEAD_TORQUE)
    if dead.any():
        notes.add(
            "dead torque",
            f"the {name} never changes, it was probably not measured",
            notes.which(dead),
            "certain",
            "leave its torque row out (--torque-joints), or record it",
        )
    live = present & ~dead
    zeros = np.where(live, (values == 0).mean(axis=0), 0.0)
    band = live & moving & np.array([_dead_band(x, share, criteria) for x, share in zip(values.T, zeros, strict=True)])
    notes.per_joint(f"zero_{channel}", np.where(zeros > 0.01, zeros, np.nan))
    if band.any():
        notes.add(
            "dead band",
            f"the {name} is exactly zero in {span(100 * zeros[band], ' %')} of the samples while the joint moves",
            notes.which(band),
            "certain",
            "leave its torque row out (--torque-joints): small torques are missing from it",
        )
    _resolution(values, live & ~band, (name, unit), notes)


def _resolution(values: Array, good: NDArray[np.bool_], quantity: tuple[str, str], notes: Notebook) -> None:
    """Report channels that are coarse, saturated or held; `quantity` is the name and the unit."""
    criteria, (name, unit) = notes.criteria, quantity
    levels = np.array([_levels(x, criteria) for x in values.T])
    coarse = good & (levels < criteria.coarse_steps)
    if coarse.any():
        notes.add(
            "coarse torque",
            f"the {name} takes {span(levels[coarse])} steps over the middle 90 % of its samples",
            notes.which(coarse),
            "certain",
            "record it with more digits; rounding errors of half a step are not noise, and averaging does not reduce "
            "them",
        )
    share = np.array([_saturated(x, criteria) if ok else 0.0 for x, ok in zip(values.T, good, strict=True)])
    if (share > 0).any():
        extremes = np.abs(values[:, share > 0]).max(axis=0)
        notes.add(
            "saturated torque",
            f"the {name} stays at its extreme, {span(extremes)} {unit}, in {span(100 * share[share > 0], ' %')} "
            "of the samples",
            notes.which(share > 0),
            "likely",
            "there the drive or the recording is at its limit: slow the motion down, or leave these stretches out",
        )
    held = np.array([_held(x, criteria) if ok else 1 for x, ok in zip(values.T, good, strict=True)])
    if (held > 1).any():
        notes.add(
            "held torque",
            f"the {name} changes only every {span(held[held > 1])} samples: it is measured at a lower rate than "
            "the log's",
            notes.which(held > 1),
            "certain",
            "record at the rate at which the torque is measured; a held torque is late by half the time between its "
            "changes",
        )


def _dead_band(x: Array, zeros: float, criteria: CheckCriteria) -> bool:
    """Whether zero occurs more often, compared with the levels beside it, than rounding to zero explains."""
    if zeros < criteria.dead_band_share:
        return False
    step = quantum(x, criteria) or 1e-3 * float(np.ptp(x))
    beside = np.mean((np.abs(x) > 0.5 * step) & (np.abs(x) < 2.5 * step)) / 4
    return zeros > criteria.dead_band_ratio * float(beside)


def _levels(x: Array, criteria: CheckCriteria) -> float:
    """Number of steps of its grid that a channel spans most of the time; infinite without a grid."""
    step, tail = quantum(x, criteria), criteria.tail_share
    return float(np.ptp(np.quantile(x, [tail, 1 - tail])) / step) if step else np.inf


def _saturated(x: Array, criteria: CheckCriteria) -> float:
    """Share of samples at the extreme value, where they are too many for a signal that just turns back; else zero."""
    worst = 0.0
    step = max(quantum(x, criteria), 1e-6 * float(np.ptp(x)))
    for y in (x, -x):
        top = float(y.max())
        at = int(np.sum(y > top - 0.5 * step))
        below = int(np.sum((y > top - 2.5 * step) & (y <= top - 0.5 * step)))
        if at >= criteria.saturated_samples and at > criteria.saturated_ratio * max(below, 1):
            worst = max(worst, at / len(y))
    return worst


def _held(x: Array, criteria: CheckCriteria) -> int:
    """Samples between two changes of a channel that is recorded more often than it is measured; else one."""
    changes = np.flatnonzero(np.diff(x) != 0)
    if len(changes) < criteria.held_changes or len(changes) > criteria.held_share * len(x):
        return 1
    sizes, gaps = np.abs(np.diff(x))[changes], np.diff(changes)
    usual = int(np.median(gaps))
    # a channel with a coarse grid also stays constant at times, but it moves by one step and has no rhythm
    steps = np.median(sizes) / max(quantum(x, criteria), 1e-12)
    rhythm = np.mean(gaps % usual == 0)
    return usual if usual > 1 and steps > criteria.held_jump and rhythm > criteria.held_rhythm else 1


def check_jumps(log: Log, notes: Notebook) -> bool:
    """Report positions that jump as no joint can move: values that stand for a lost reading."""
    criteria = notes.criteria
    step = np.diff(log.t)
    # Two stamps that nearly coincide are an error of the clock: between the samples themselves passed a usual step.
    speed = np.abs(np.diff(log.q, axis=0)) / np.maximum(step, np.median(step))[:, None]
    usual = np.percentile(speed, criteria.jump_percentile, axis=0)
    jumps = (speed > criteria.jump_speed) & (speed > criteria.jump_ratio * usual)
    if not jumps.any():
        return False
    row, column = np.argwhere(jumps)[0]
    where = np.asarray(jumps.any(axis=0))
    notes.add(
        "position jumps",
        f"the positions jump {span(jumps.sum(axis=0)[where].astype(float))} times as no joint can move, first "
        f"after sample {row + 1}: from {log.q[row, column]:.4g} to {log.q[row + 1, column]:.4g}",
        notes.which(where),
        "certain",
        "values such as -9999 or 0 that stand for a lost reading: remove these rows; between poses that were recorded "
        "one by one, leave a gap of 10 s in the time",
        blocks=True,
    )
    return True
