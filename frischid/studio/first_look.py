"""The logs of the studio's first findings: stretches of several logs, together as long as the shortest log.

One log alone cannot tell what changes with its time from what changes with its motion. On the UR10e's shortest log,
warming up is the most probable cause (68 %); on all its logs, that probability is 0 %. Stretches of three logs name
causes that all logs name too, but the findings come a second later: these stretches must be filtered first. A stretch
must hold some periods of the motion: where the shortest log has too few of them for several stretches, that log is
looked at as a whole.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from frischid.logs.filters import LowPass
from frischid.logs.log import Log

MOST_STRETCHES = 3  # more cost more time: each needs the filters' ends
PERIODS = 40  # of the cut-off in a stretch; a cut-off is usually ten times the motion's bandwidth


def first_look(logs: Sequence[Log], lowpass: LowPass) -> list[Log]:
    """Stretches from the middle of at most three logs, evenly chosen; or the shortest log.

    Parameters
    ----------
    lowpass : LowPass
        The filter of the model.

    Returns
    -------
    list of Log
        Together about as long as the shortest of `logs`.
    """
    shortest = min(logs, key=lambda log: log.duration)
    held = 0 if lowpass.cutoff is None else round(shortest.duration * lowpass.cutoff / PERIODS)
    count = min(MOST_STRETCHES, len(logs), held)
    if count < 2:
        return [shortest]
    return [_middle(logs[round(k)], shortest.duration / count) for k in np.linspace(0, len(logs) - 1, count)]


def _middle(log: Log, seconds: float) -> Log:
    start = 0.5 * (log.t[0] + log.t[-1] - seconds)
    first, last = np.searchsorted(log.t, [start, start + seconds])
    return replace(log.slice(int(first), int(last) + 1), sha256=log.identity)  # it stands for the whole log
