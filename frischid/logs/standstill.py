"""The samples at which a joint is at standstill, so that its dry friction is undetermined.

    v = 0:   −τ_c ≤ τ_friction ≤ τ_c

At standstill dry friction takes any value up to break-away. (The sign of the measured speed is then only noise.) A
model with Coulomb friction makes no prediction there, so such torque samples are left out of every fit and of every
error.

Source: H. Olsson et al., "Friction models and friction compensation", European Journal of Control 4(3), 1998.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from frischid.core.types import Array
from frischid.logs.log import STANDSTILL_SPAN

CREEPING = 0.01
"""rad/s (m/s). A joint slower than this may be at standstill."""
UNMOVED = 0.2
"""Share of the largest acceleration around. A creeping joint with less acceleration than this is not accelerated."""
PAUSE = 0.1
"""s. A joint that is not accelerated for at least this time pauses."""


def find_standstill(q: Array, v: Array, a: Array, step: float, pause: float = PAUSE) -> NDArray[np.bool_]:
    """Find the samples at which a joint holds its position, or stops and goes on without reversing.

    A joint holds its position where it moves less than `STANDSTILL_SPAN` within half a second around the sample. A
    joint stops where it creeps (slower than `CREEPING`, or than a fiftieth of its usual speed if that is less) and
    slows down to a fifth of that speed. A short stretch in which the joint reverses is not standstill: a reversal is
    motion, and carries most information on friction. But if the joint is hardly accelerated for as long as `pause`
    while it reverses, it pauses, which is standstill.

    Parameters
    ----------
    q, v, a : ndarray, shape (N, J)
        Positions, rad (m), their derivatives and second derivatives.
    step : float
        Time between samples, s.
    pause : float
        Least pause, s. The filter blurs a pause shorter than a period of its cut-off into the motion around.

    Returns
    -------
    ndarray of bool, shape (N, J)

    Examples
    --------
    A joint that waits for a second, then swings:

    >>> import numpy as np
    >>> from frischid.logs.standstill import find_standstill
    >>> t = np.arange(0, 3, 0.01)
    >>> speed = np.where(t < 1, 0.0, np.sin(4 * (t - 1)))[:, None]
    >>> found = find_standstill(np.cumsum(speed, axis=0) * 0.01, speed, np.gradient(speed, 0.01, axis=0), 0.01)
    >>> bool(found[t < 0.9].all()), bool(found[t > 1.1].any())
    (True, False)
    """
    window = 2 * max(1, round(0.25 / step)) + 1  # one sample alone does not show whether the joint moves
    travel = ndimage.maximum_filter1d(q, window, axis=0) - ndimage.minimum_filter1d(q, window, axis=0)
    found = np.asarray(travel < STANDSTILL_SPAN)
    for j in range(q.shape[1]):
        creeping = min(CREEPING, float(np.quantile(np.abs(v[:, j]), 0.9)) / 50)
        labels, count = ndimage.label(np.abs(v[:, j]) < creeping)
        for part in ndimage.find_objects(labels, count):
            slow = part[0]
            inner = slow.start > 0 and slow.stop < len(v)
            reverses = inner and v[slow.start - 1, j] * v[slow.stop, j] < 0
            brief = (slow.stop - slow.start) * step < 0.5 and not _pauses(a[:, j], slow, step, pause)
            if np.abs(v[slow, j]).min() < creeping / 5 and not (reverses and brief):
                found[slow, j] = True
    return found


def _pauses(a: Array, slow: slice, step: float, pause: float) -> bool:
    """Whether a creeping joint pauses, that is, is hardly accelerated for a while. A reversing joint is accelerated."""
    around = round(0.25 / step)
    most = np.abs(a[max(0, slow.start - around) : slow.stop + around]).max()
    runs, _ = ndimage.label(np.abs(a[slow]) < UNMOVED * most)
    return bool(np.bincount(runs)[1:].max(initial=0) * step >= pause)
