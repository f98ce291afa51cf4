"""When does something act on the robot? For each moment a state, fitted in turns with the parameters.

With s(t) = 1 while it acts and 0 otherwise, C its columns (those of a body on a link, or a constant torque of each
joint) and φ their coefficients,

    τ = Y θ + s(t) · C φ.

The first states are the stretch of time that explains most, and the next follow from the parameters
(`frischid.regression.two_states`). The turns end where the states come again.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from frischid.core.array_store import Series
from frischid.core.types import Array
from frischid.diagnosis.candidate_columns import Candidate
from frischid.diagnosis.cross_validation import CrossValidator
from frischid.regression.two_states import best_stretch, likeliest_states

States = NDArray[np.bool_]

STRETCH_ENDS = 100
"""Blocks of a motion, between whose ends the first stretch is sought."""
_STATE_TURNS = 12  # of states and parameters; the states usually stay the same after three


def first_states(fit: CrossValidator, acting: Candidate) -> tuple[float, list[States]]:
    """The fall of the weighted squared error where the columns act over one stretch, and the states, (n,) each."""
    best = (0.0, -1, 0.0, 0.0)
    for number, t in enumerate(fit.data.times):
        if len(t) < 2:
            continue
        ends = np.linspace(t[0], np.nextafter(t[-1], np.inf), min(STRETCH_ENDS, len(t) // 2) + 1)
        gain, first, last = best_stretch(*_moments(fit, acting, number, ends))
        best = max(best, (gain, number, float(ends[first]), float(ends[last])))
    gain, chosen, start, stop = best
    every = enumerate(fit.data.times)
    return gain, [(t >= start) & (t < stop) if k == chosen else np.zeros(len(t), bool) for k, t in every]


def _moments(fit: CrossValidator, acting: Candidate, number: int, ends: Array) -> tuple[Array, Array, Array]:
    """Weighted moments of the columns in each block of a motion, as `best_stretch` takes them."""
    data, system = fit.data, fit.fit.systems[-1]
    blocks, p, k = len(ends) - 1, len(system.free), len(acting.signs)
    cross, left, own = np.zeros((blocks, p, k)), np.zeros((blocks, k)), np.zeros((blocks, k, k))
    for row in acting.columns:
        joint, weight = data.of_motion(row, number), fit.fit.omega[row]
        places, X = fit.columns.over(joint)
        C, error = acting.over(joint), joint.tau - X @ system.free[places]
        at = np.searchsorted(data.cache.motions[number].t.read()[joint.picked], ends).tolist()
        for b, rows in enumerate(map(slice, at[:-1], at[1:])):
            scaled = weight * C[rows]
            cross[b, places] += X[rows].T @ scaled
            left[b] += error[rows] @ scaled
            own[b] += C[rows].T @ scaled
    factor, lower = system.factor
    flat = cross.transpose(1, 0, 2).reshape(p, -1)
    free = linalg.solve_triangular(factor, flat, trans=0 if lower else 1, lower=lower)
    return free.reshape(p, blocks, k).transpose(1, 0, 2), left, own


def settled_states(
    fit: CrossValidator, acting: Candidate, states: list[States], *, positive: bool = False
) -> list[States] | None:
    """The states, found in turns with the parameters; None where the columns act always or never, or nothing settles.

    Parameters
    ----------
    positive : bool
        Whether the first coefficient is a mass. Below zero it is that of a body that is carried at the other times: the
        states change once. If it is still below zero, which a prior may cause, there are none.
    """
    seen, turned = list[list[States]](), False
    for _ in range(_STATE_TURNS):
        if all(s.all() for s in states) or not any(s.any() for s in states):
            return None
        if any(_same(states, earlier) for earlier in seen):
            return states
        seen.append(states)
        acted = fit.extended(while_acting(fit, acting, states))
        if positive and acted.theta[fit.columns.width] < 0:
            if turned:
                return None
            states, turned = [~s for s in states], True
        else:
            states = _likeliest(fit, acting, states, acted)
    return None


def _same(one: Sequence[States], other: Sequence[States]) -> bool:
    return all(np.array_equal(a, b) for a, b in zip(one, other, strict=True))


def while_acting(fit: CrossValidator, acting: Candidate, states: Sequence[States]) -> Candidate:
    """The columns, zero where the state is False."""
    cache = fit.data.cache
    columns = {row: Series(cache.store) for row in acting.columns}
    for row, series in columns.items():
        for motion, acts in zip(cache.motions, states, strict=True):
            series.append(acting.columns[row][motion.number] * acts[motion.picked[row].read(), None])
    return Candidate(acting.effect, columns, acting.signs)


def _likeliest(fit: CrossValidator, acting: Candidate, states: Sequence[States], acted: CrossValidator) -> list[States]:
    """The likeliest states under the parameters of a fit with the columns in some states, (n,) for each motion."""
    phi = acted.theta[-len(acting.signs) :]
    price = 2.0 * float(np.log(max(fit.effective.sum(), 2.0)))
    found = []
    for number, before in enumerate(states):
        gain = np.zeros(len(before))
        for row in acting.columns:
            joint = fit.data.of_motion(row, number)
            torque = acting.over(joint) @ phi
            without = acted.columns.residual(joint, acted.theta) + torque * before[joint.picked]
            gain[joint.picked] += acted.fit.omega[row] * torque * (2 * without - torque)
        found.append(likeliest_states(gain, price))
    return found
