"""What friction with memory remembers from before a log: no log shows that motion, so the state is estimated.

The torque β z of such friction (`frischid.effects.friction_memory`) depends on a state z between −1 and 1. The columns
of a model assume that z begins at 1 or −1, or at 0 where the joint never moves clearly. The error of that state decays
with the way s that the joint has covered,

    β Δz(0) b,    b = exp(−s / distance).

If z began anywhere between the two ends, E[Δz(0)²] is at most ∫ (1 − z)² dz / 2 = 4/3. With this prior and the residual
e of the joint, whose variance is σ², the error of the state has the mean and the variance

    Δz(0) = p⁻¹ Σ β b e / σ²,    p⁻¹ = 1 / (3/4 + Σ (β b)² / σ²).

The torque of a hose that begins to move the other way than it stopped is off by twice β, and that is no contact.

Source: ridge regression as a posterior mean, Hoerl and Kennard 1970, Technometrics 12(1).
"""

from __future__ import annotations

import numpy as np

from frischid.core.types import Array
from frischid.diagnosis.cached_motion import CachedMotion
from frischid.diagnosis.motion_cache import MotionCache
from frischid.logs.filters import decimating_filter

_SPREAD = 4 / 3  # mean square of the state's error at the first sample


def remembered_torque(cache: MotionCache, motion: CachedMotion, theta: Array) -> dict[int, Array]:
    """Torque of each joint per unit of the error of a state at the first sample, β b.

    Parameters
    ----------
    theta : ndarray, shape (p,)
        Parameters of the model's columns.

    Returns
    -------
    dict of int to ndarray, shape (M, k)
        Position of a joint among the fitted ones -> torque at the motion's filtered samples, N·m (N), for each of k
        effects. Joints without such friction are absent.
    """
    effects = [effect for effect in cache.model.effects if effect.memory]
    if not effects:
        return {}
    state, lowpass = cache.state(motion), cache.model.lowpass
    place = {column.name: k for k, column in enumerate(cache.model.estimate.columns)}
    low = decimating_filter(lowpass.taps(motion.step), motion.raw, lowpass.decimation(motion.step))
    found: dict[int, list[Array]] = {}
    for term in (x for effect in effects for x in effect.remembered(state) if x.column.name in place):
        for joint, values in term.rows.items():
            if joint in cache.position:
                torque = theta[place[term.column.name]] * np.asarray(low @ values)
                found.setdefault(cache.position[joint], []).append(torque)
    return {row: np.column_stack(columns) for row, columns in found.items()}


def without_memory(error: Array, variance: Array, torque: Array) -> tuple[Array, Array]:
    """The residual without what is remembered, and its variance with the uncertainty of that, (n,) each.

    Parameters
    ----------
    error, variance : ndarray, shape (n,)
        Residual of a joint, N·m (N), and its variance.
    torque : ndarray, shape (n, k)
        As of `remembered_torque`.
    """
    weighted = torque / variance[:, None]
    covariance = np.linalg.inv(np.eye(torque.shape[1]) / _SPREAD + torque.T @ weighted)
    states = covariance @ (weighted.T @ error)
    return error - torque @ states, variance + np.einsum("ni,ij,nj->n", torque, covariance, torque)
