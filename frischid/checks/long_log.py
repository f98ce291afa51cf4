"""One report on a long log, from reports on its pieces: memory does not grow with the log.

A long log is examined piece by piece, `PIECE` samples at a time. A piece is longer than every filter and holds minutes
of motion, so every check works on it as on a log of its own. The pieces' reports become one:

- a figure is the median of the pieces', a count is their sum;
- a *certain* issue counts wherever it is found, and says in how many pieces that is;
- a *likely* or *possible* issue counts if half of the pieces have it: each test errs now and then, and a hundred
  pieces would always hold an error;
- that a joint does not move, or the motion is weak, counts only if it is so in every piece.

Samples are counted once. The step from one piece to the next is examined too, because a piece begins with the last
sample of the piece before.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from frischid.checks.log_issue import LogIssue, LogReport, Notebook
from frischid.logs.log import Log
from frischid.logs.recording import Recording, joined

PIECE = 60_000
"""Samples of a piece: a minute at 1 kHz. A hundred columns then take 50 MB, and the checks some times that."""
WHOLE = 2 * PIECE
"""Samples of the longest log in memory that is examined as a whole."""
_ONLY_TOGETHER = {"no motion", "weak excitation", "too short"}
"""Issues that say what a log lacks: another piece of the same log may have it."""


def is_long(log: Log | Recording) -> bool:
    """Whether a log is examined piece by piece."""
    return isinstance(log, Recording) or len(log) > WHOLE


def pieces_of(log: Log | Recording) -> Iterator[Log]:
    """Pieces of a long log, each with the last sample of the piece before."""
    before: Log | None = None
    for piece in log.chunks(PIECE) if isinstance(log, Recording) else _slices(log):
        yield piece if before is None else joined(before, len(before) - 1, piece)
        before = piece


def _slices(log: Log) -> Iterator[Log]:
    count = len(log) // PIECE
    for k in range(count):  # the last one takes the rest
        yield log.slice(k * PIECE, None if k == count - 1 else (k + 1) * PIECE)


@dataclass(frozen=True)
class Examined:
    """Report on one piece, and where the piece lies."""

    report: LogReport
    start: float
    end: float
    """`start`, `end`: First and last stamp, s."""


def examine_long(log: Log | Recording, names: Sequence[str], examine: Callable[[Log], LogReport]) -> LogReport:
    """Examine a long log piece by piece.

    Parameters
    ----------
    names : sequence of str
        The robot's joints.
    examine : callable
        Examines one piece.

    Returns
    -------
    LogReport
        As of a log that is examined as a whole.
    """
    found = [Examined(examine(piece), float(piece.t[0]), float(piece.t[-1])) for piece in pieces_of(log)]
    reports = [piece.report for piece in found]
    notes = Notebook(names, reports[0].criteria)
    notes.facts = _facts(found)
    for name in names:
        figures = [report.joints.get(name, {}) for report in reports]
        keys = dict.fromkeys(key for values in figures for key in values)
        if keys:
            notes.joints[name] = {k: float(np.median([v[k] for v in figures if k in v])) for k in keys}
    notes.issues = list(_issues(found, names))
    notes.fix = Counter(report.fix for report in reports).most_common(1)[0][0]  # what most pieces say
    return notes.report(log.source)


def _facts(found: Sequence[Examined]) -> dict[str, Any]:
    """Figures of the whole log."""
    facts = [piece.report.facts for piece in found]
    whole: dict[str, Any] = {}
    for key in dict.fromkeys(key for one in facts for key in one):
        values = [one[key] for one in facts if key in one]
        whole[key] = _together(values)
    seconds = found[-1].end - found[0].start
    samples = sum(one["samples"] for one in facts if "samples" in one) - (len(found) - 1)
    whole |= {"samples": samples, "seconds": seconds}
    if "mean_rate_hz" in whole:
        whole["mean_rate_hz"] = (samples - 1) / seconds
    if "steps_ms" in whole:
        low, usual, high = zip(*(one["steps_ms"] for one in facts if "steps_ms" in one), strict=True)
        whole["steps_ms"] = [min(low), float(np.median(usual)), max(high)]
    if "gaps" in whole:
        whole["gaps"] = sum(one.get("gaps", 0) for one in facts)
    if "unseen_parameters" in whole:  # a parameter is unseen if no piece shows it
        lists = [one["unseen_parameters"] for one in facts if "unseen_parameters" in one]
        whole["unseen_parameters"] = [name for name in lists[0] if all(name in other for other in lists)]
    return whole


def _together(values: Sequence[Any]) -> Any:
    """Median of numbers; of anything else the first."""
    if all(isinstance(x, int | float) and not isinstance(x, bool) for x in values):
        median = float(np.median(values))
        return round(median) if all(isinstance(x, int) for x in values) else median
    return values[0]


def _issues(found: Sequence[Examined], names: Sequence[str]) -> Iterable[LogIssue]:
    """Issues of the whole log, in the order in which they were found."""
    groups: dict[tuple[str, str], list[tuple[LogIssue, Examined]]] = {}
    for piece in found:
        for issue in piece.report.issues:
            for name in issue.where or ("",):
                groups.setdefault((issue.kind, name), []).append((issue, piece))
    merged: dict[str, list[tuple[str, list[tuple[LogIssue, Examined]]]]] = {}
    for (kind, name), group in groups.items():
        if len(group) >= _needed(kind, [issue for issue, _ in group], len(found)):
            merged.setdefault(kind, []).append((name, group))
    for parts in merged.values():
        group = max((group for _, group in parts), key=len)
        first, piece = group[0]
        share = len(group) / len(found)
        where = "" if share == 1 else f" (in {len(group)} of {len(found)} pieces, first from {piece.start:.5g} s on)"
        joints = {name for name, _ in parts}
        yield replace(
            first,
            what=first.what + where,
            where=tuple(name for name in names if name in joints),
            blocks=first.blocks and share >= 0.5,
        )


def _needed(kind: str, issues: Sequence[LogIssue], pieces: int) -> float:
    """Number of pieces in which an issue must be found."""
    if kind in _ONLY_TOGETHER:
        return pieces
    return 1 if any(issue.sure == "certain" for issue in issues) else pieces / 2
