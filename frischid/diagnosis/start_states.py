"""What friction with memory remembers from before a log: no log shows it, so a prediction is uncertain by it.

The torque β z of such friction (`frischid.effects.friction_memory`) depends on a state z between −1 and 1. An error of
the state at the first sample decays with the way s that the joint has covered since,

    Δz(s) = Δz(0) exp(−s / distance).

The columns assume that z begins at 1 or −1. If it began anywhere between them, E[Δz(0)²] = ∫ (1 − z)² dz / 2 = 4/3, so
the prediction has the variance 4/3 (β exp(−s / distance))². The hose of a robot that begins to move the other way than
it stopped is off by twice β, which is no contact.
"""

from __future__ import annotations

import numpy as np

from frischid.core.types import Array
from frischid.diagnosis.cached_motion import CachedMotion
from frischid.diagnosis.motion_cache import MotionCache
from frischid.logs.filters import decimating_filter

_ERROR = 4 / 3  # mean square of the state's error at the first sample


def variance_of_start(cache: MotionCache, motion: CachedMotion, theta: Array) -> dict[int, Array]:
    """Variance of each joint's predicted torque that comes from the unknown states before a motion.

    Parameters
    ----------
    theta : ndarray, shape (p,)
        Parameters of the model's columns.

    Returns
    -------
    dict of int to ndarray, shape (M,)
        Position of a joint among the fitted ones -> variance at the motion's filtered samples, (N·m)² (N²). Joints
        without such friction are absent.
    """
    state, lowpass = cache.state(motion), cache.model.lowpass
    place = {column.name: k for k, column in enumerate(cache.model.estimate.columns)}
    terms = [x for effect in cache.model.effects for x in effect.remembered(state) if x.column.name in place]
    if not terms:
        return {}
    low = decimating_filter(lowpass.taps(motion.step), motion.raw, lowpass.decimation(motion.step))
    found: dict[int, Array] = {}
    for term in terms:
        for joint, values in term.rows.items():
            if joint in cache.position:
                row = cache.position[joint]
                torque = theta[place[term.column.name]] * np.asarray(low @ values)
                found[row] = found.get(row, 0.0) + _ERROR * torque**2
    return found
