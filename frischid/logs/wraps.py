"""Angles that wrap at ±π: recognised, and undone.

    |q(k+1) − q(k) − 2πn| ≪ 2π,   n ≠ 0

Between two samples no joint turns by a whole turn; where a recorded angle does, it wrapped. The jump must be a multiple
of 2π up to the motion of some samples around it, in steps that are otherwise small. A joint that stands at ±π may wrap
at every other sample: an angle that never leaves one turn is judged by its steps without whole turns.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from frischid.core.types import Array
from frischid.logs.log import Log

TURN = 2 * np.pi
LARGEST_USUAL_STEP = 0.7
"""rad. A joint that turns farther between usual samples is sampled too slowly for a jump to tell anything."""

ANGLE_ROUNDING = 1e-6
"""rad. Rounding of an angle in single precision."""


def wraps_of(q: Array) -> NDArray[np.intp]:
    """Number of wraps of each angle, (J,), from positions (N, J)."""
    return np.asarray([np.count_nonzero(_turns(x)) for x in q.T], dtype=np.intp)


def degree_wraps_of(q: Array) -> NDArray[np.intp]:
    """Number of wraps at ±180° or 360° of each position, (J,): only degrees jump so. Lengths and radians have none."""
    return wraps_of(np.deg2rad(q))


def _turns(x: Array) -> Array:
    """Whole turns by which an angle jumps at each step, (N - 1,)."""
    step = np.diff(x)
    turns = np.round(step / TURN)
    rest = np.abs(step - TURN * turns)
    in_one_turn = np.ptp(x) <= TURN + ANGLE_ROUNDING
    usual = float(np.quantile(rest if in_one_turn else np.abs(step), 0.9))  # a turning joint wraps at fewer steps
    near = max(3 * usual, ANGLE_ROUNDING)
    true = (turns != 0) & (rest <= near)
    if usual > LARGEST_USUAL_STEP:
        return np.zeros_like(turns)
    # a jump that is no wrap (a lost encoder, garbage) says that the others may be none either
    return np.where(true, turns, 0.0) if true[turns != 0].all() else np.zeros_like(turns)


def unwrapped(log: Log, centres: Array | None = None) -> Log:
    """The same log with its wraps undone; the log itself if there is none.

    Of the angles that differ by whole turns, the median is put nearest to `centres`, (J,), or to that of the record.
    """
    counts = wraps_of(log.q)
    if not counts.any():
        return log
    q = np.array(log.q)
    for j in np.flatnonzero(counts):
        q[1:, j] -= TURN * np.cumsum(_turns(log.q[:, j]))
        centre = float(np.median(log.q[:, j])) if centres is None else float(centres[j])
        q[:, j] -= TURN * np.round((np.median(q[:, j]) - centre) / TURN)
    return replace(log, q=q)


def commands_unwrapped(log: Log) -> Log:
    """The same log with the wraps of positions and commands undone, and a command in the turn of its position.

    The log itself if nothing wraps.
    """
    if log.qcmd is None:
        return unwrapped(log)
    commanded = np.where(np.isnan(log.qcmd), log.q, log.qcmd)
    found, goals = unwrapped(log), unwrapped(replace(log, q=commanded)).q
    turned = (wraps_of(log.q) > 0) | (wraps_of(commanded) > 0)
    if not turned.any():
        return log
    apart = TURN * np.round(np.median(goals - found.q, axis=0) / TURN)
    return replace(found, qcmd=np.where(np.isnan(log.qcmd), np.nan, goals - np.where(turned, apart, 0.0)))


def continuous(x: Array) -> Array:
    """A column of angles (N,) in degrees or radians with its wraps undone and its median within half a turn of zero.

    Columns without wraps are returned as they are.
    """
    for turn in (360.0, TURN):
        turns = _turns(x * (TURN / turn))
        if turns.any():
            y = x - turn * np.concatenate([[0.0], np.cumsum(turns)])
            return np.asarray(y - turn * np.round(np.median(y) / turn))
    return x


def wrap_notes(log: Log) -> list[str]:
    """A note that says which angles wrap."""
    counts = wraps_of(log.q)
    names = [f"{n} ({k} times)" for n, k in zip(log.joints, counts, strict=True) if k]
    return [f"angles that wrap at whole turns are made continuous: {', '.join(names)}"] if names else []
