"""Files whose time starts anew: several recordings one after another, for example one for each pose.

    t' = t + shift_k        in part k,  so that part k + 1 begins `RESTART_GAP` after part k ended

A clock that falls back to where the file began, or below, has started anew. Any other step backwards is a fault of the
stamps and stays one.
"""

from __future__ import annotations

import numpy as np

from frischid.core.types import Array
from frischid.logs.log import FEWEST_SAMPLES

RESTART_GAP = 10.0
"""s. Time that is put between two parts; longer than any gap that is interpolated."""
NEAR_START = 5.0
"""Usual steps. A part begins at most so much later after its clock's zero than the first part did."""


def continued(t: Array) -> tuple[Array, int]:
    """Stamps that increase through all parts of a file, and how often its time starts anew.

    Parameters
    ----------
    t : ndarray, shape (N,)
        Stamps, s.

    Returns
    -------
    ndarray, shape (N,)
        The same array where nothing starts anew, or where stamps also fall elsewhere.
    int

    Examples
    --------
    >>> import numpy as np
    >>> from frischid.logs.restarts import continued
    >>> t, restarts = continued(np.tile(np.arange(20) / 10, 2))
    >>> t[[0, 19, 20, 39]].round(6).tolist(), restarts
    ([0.0, 1.9, 11.9, 13.8], 1)
    """
    step = np.diff(t)
    first = np.flatnonzero(step < 0) + 1
    if not len(first) or not np.isfinite(t).all():
        return t, 0
    usual = float(np.median(step))
    lengths = np.diff([0, *first.tolist(), len(t)])
    anew = (t[first] <= t[0] + NEAR_START * usual).all() and (lengths >= FEWEST_SAMPLES).all() and (step != 0).all()
    if not anew:
        return t, 0
    shift = np.zeros(len(t))
    for k in first.tolist():
        shift[k:] = t[k - 1] + shift[k - 1] + RESTART_GAP - t[k]
    return t + shift, len(first)
