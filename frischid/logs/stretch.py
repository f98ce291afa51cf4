"""A part of a log by time: the stretch to fit, and the stretch to hold out."""

from __future__ import annotations

import numpy as np

from frischid.errors import InputError
from frischid.logs.log import FEWEST_SAMPLES, Log


def stretch(log: Log, start: float | None = None, stop: float | None = None) -> Log:
    """The samples of a log with ``start <= t - t[0] < stop``.

    Parameters
    ----------
    log : Log
    start, stop : float, optional
        Seconds after the first sample; the log's ends by default.

    Returns
    -------
    Log
        With a hash of its own: two stretches of one log are two logs, of which one can be held out.

    Raises
    ------
    InputError
        The stretch holds too few samples.

    Examples
    --------
    >>> import numpy as np
    >>> import frischid as fr
    >>> t = np.arange(100.0, 110.0, 0.01)
    >>> log = fr.Log(t, ("elbow",), q=np.sin(t)[:, None])
    >>> fitted, held = fr.stretch(log, stop=7.0), fr.stretch(log, start=7.0)
    >>> len(fitted), len(held), fitted.identity == held.identity
    (700, 300, False)
    """
    if start is not None and stop is not None and stop <= start:
        raise InputError(
            f"{log.source}: from {start:g} s until {stop:g} s: the end (--until, stop=) must be later than the "
            "beginning (--from, start=)"
        )
    seconds = log.t - log.t[0]
    # a stamp that is a rounding error before the border belongs behind it
    near = 1e-6 / log.rate
    first = 0 if start is None else int(np.searchsorted(seconds, start - near))
    last = len(log) if stop is None else int(np.searchsorted(seconds, stop - near))
    if last - first < FEWEST_SAMPLES:
        until = log.duration if stop is None else stop
        raise InputError(
            f"{log.source}: from {start or 0.0:g} s until {until:g} s there are {max(0, last - first)} samples of this "
            f"log of {log.duration:.4g} s, and a log needs at least {FEWEST_SAMPLES}; --from and --until count seconds "
            "from the log's first sample"
        )
    return log.slice(first, last)
