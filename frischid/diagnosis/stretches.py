"""Stretches of time in logs: (log, start, stop) each, s. A diagnosis leaves some of them out, and names them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from frischid.core.text import listed
from frischid.logs.filters import LowPass

Stretch = tuple[str, float, float]

_MOST_NAMED = 3  # in a sentence


def lasting(spans: Iterable[tuple[float, float]]) -> float:
    """Length of the union of spans of time (start, stop), s.

    Examples
    --------
    >>> from frischid.diagnosis.stretches import lasting
    >>> lasting([(0.0, 2.0), (5.0, 6.0), (1.0, 3.0)])
    4.0
    """
    length, reached = 0.0, -float("inf")
    for start, stop in sorted(spans):
        length += max(stop - max(start, reached), 0.0)
        reached = max(reached, stop)
    return length


def reach_of(lowpass: LowPass) -> float:
    """Time by which a filter spreads an error that grows from zero, s to each side: a period of its cut-off."""
    return 0.0 if lowpass.cutoff is None else 1.0 / lowpass.cutoff


def reach_of_a_step(lowpass: LowPass) -> float:
    """Time by which a filter spreads an error that comes at once, s to each side: half of the filter's length."""
    if lowpass.cutoff is None:
        return 0.0
    step = 0.02 / lowpass.cutoff  # any short one
    return len(lowpass.taps(step)) // 2 * step


def wider(stretches: Iterable[Stretch], margin: float) -> list[Stretch]:
    """The stretches, longer by a margin to each side, s."""
    return [(source, start - margin, stop + margin) for source, start, stop in stretches]


def in_words(stretches: Sequence[Stretch], log_starts: Mapping[str, float]) -> str:
    """Names of the logs and times, counted from the first sample of each log as ``frischid cut`` does.

    Parameters
    ----------
    log_starts : mapping of str to float
        Log -> its first time stamp, s; 0 without one.

    Examples
    --------
    >>> from frischid.diagnosis.stretches import in_words
    >>> in_words([("logs/a.csv", 101.0, 102.5)], {"logs/a.csv": 100.0})
    'a.csv from 1.00 to 2.50 s'
    """
    since = [(s, log_starts.get(s, 0.0), a, b) for s, a, b in stretches[:_MOST_NAMED]]
    where = listed([f"{Path(s).name} from {a - t0:.2f} to {b - t0:.2f} s" for s, t0, a, b in since])
    more = len(stretches) - _MOST_NAMED
    return f"{where} and {more} more times" if more > 0 else where


def plain(stretches: Iterable[Stretch], log_starts: Mapping[str, float]) -> list[dict[str, Any]]:
    """Plain JSON values."""
    return [{"source": s, "start": a, "stop": b, "log_start": log_starts.get(s, 0.0)} for s, a, b in stretches]
