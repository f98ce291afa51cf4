"""Stretches of a long log that stand for the whole log where the whole is not needed: in figures, and in a diagnosis.

A report shows curves, and looks for effects, along `EXCERPT` samples at most. A longer log is read once, chunk by
chunk. Each chunk may give a stretch from its beginning. When there are more than `STRETCHES`, every second one is
dropped and from then on every second chunk gives one: the stretches stay evenly spread, whatever the log's length, and
memory does not grow. Between two stretches time jumps, so the filters treat them as they treat gaps.

Errors, bounds and headlines are not taken from an excerpt: they are sums over all samples.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from frischid.core.types import Array
from frischid.logs.log import Log
from frischid.logs.recording import RECORDING_CHUNK, Recording, joined

EXCERPT = 120_000
"""Samples of the longest log that is shown as a whole: two minutes at 1 kHz, twenty at 100 Hz."""
STRETCHES = 16
"""Most stretches of an excerpt."""


@dataclass(frozen=True, eq=False)
class Excerpt:
    """A log for figures, and the clock of the whole log."""

    log: Log
    """The stretches, or the whole log where it is not long."""
    first: Log
    """The first stretch, without a jump in time."""
    samples: int
    """Of the whole log."""
    seconds: float
    rate: float
    """`seconds`, `rate`: Of the whole log, s and Hz."""
    steps: tuple[float, float]
    """Shortest and longest time step of the whole log, s."""
    gaps: int
    """Steps above five times the usual one."""
    said: str = ""
    """What the excerpt omits; empty where it is the whole log."""


def as_recording(log: Log | Recording) -> Log | Recording:
    """A long log in memory as a recording, so that sums over it need no further memory; any other as it is."""
    if isinstance(log, Recording) or len(log) <= EXCERPT:
        return log

    def read(samples: int) -> Iterator[Log]:
        count = max(1, len(log) // samples)
        for k in range(count):  # the last chunk takes the rest
            yield log.slice(k * samples, None if k == count - 1 else (k + 1) * samples)

    return Recording(log.source, read, lambda: log.identity, log.file)


def excerpt(log: Log | Recording) -> Excerpt:
    """Evenly spread stretches of a long log, in one pass over its samples.

    Returns
    -------
    Excerpt
        With the log's name and identity; a note says what the excerpt omits.
    """
    given = as_recording(log)
    if isinstance(given, Log):
        step = np.diff(given.t)
        return Excerpt(given, given, len(given), given.duration, given.rate, _ends(step), _gaps(step))
    kept: list[Log] = []
    entire: list[Log] = []
    every, samples, steps, gaps, last, rates = 1, 0, [np.inf, 0.0], 0, None, []
    for number, chunk in enumerate(given.chunks(RECORDING_CHUNK)):
        step = np.diff(chunk.t if last is None else np.append(last, chunk.t))
        samples, last, gaps = samples + len(chunk), float(chunk.t[-1]), gaps + _gaps(step)
        steps = [min(steps[0], float(step.min())), max(steps[1], float(step.max()))]
        rates.append(chunk.rate)
        entire = [*entire, chunk] if samples <= EXCERPT else []
        if number % every == 0:
            kept.append(chunk.slice(0, EXCERPT // STRETCHES))
        if len(kept) > STRETCHES:
            kept, every = kept[::2], 2 * every
    parts = entire or kept
    whole = parts[0]
    for stretch in parts[1:]:
        whole = joined(whole, 0, stretch) if _alike(whole, stretch) else whole
    seconds = float(last or 0.0) - float(kept[0].t[0])
    said = (
        f"{log.source}: figures and the search for effects use {len(whole)} of {samples} samples, in {len(kept)} "
        "evenly spread stretches; errors are those of all samples"
    )
    said = said if len(whole) < samples else ""
    notes = (*parts[0].notes, said) if said else parts[0].notes
    whole = replace(whole, source=log.source, sha256=given.identity, notes=notes)
    ends = (float(steps[0]), float(steps[1]))
    return Excerpt(whole, parts[0], samples, seconds, float(np.median(rates)), ends, gaps, said)


def _alike(one: Log, other: Log) -> bool:
    """Whether two stretches have the same channels."""
    return one.to_table().keys() == other.to_table().keys()


def _ends(step: Array) -> tuple[float, float]:
    return float(step.min()), float(step.max())


def _gaps(step: Array) -> int:
    return int((step > 5 * np.median(step)).sum())
