"""When does the robot carry a body? For each moment a state, fitted in turns with the parameters.

With s(t) = 1 while the robot carries the body and 0 otherwise, φ the body's mass and first moment and Γ their columns,

    τ = Y θ + s(t) · Γ φ.

The first states are the stretch of time that explains most, and the next follow from the parameters
(`frischid.regression.two_states`). The turns end where the states stay the same.
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
from frischid.effects import columns_of
from frischid.regression.two_states import best_stretch, likeliest_states

States = NDArray[np.bool_]

_STRETCH_ENDS = 100  # of a log, between whose ends the first stretch is sought
_STATE_TURNS = 8  # of states and parameters; the states usually stay the same after three


def first_states(validator: CrossValidator, body: Candidate) -> tuple[float, list[States]]:
    """The fall of the weighted squared error by a body that is carried over one stretch, and the states, (n,) each."""
    data, best = validator.data, (0.0, -1, 0.0, 0.0)
    for number, t in enumerate(data.times):
        ends = np.linspace(t[0], np.nextafter(t[-1], np.inf), min(_STRETCH_ENDS, max(len(t) // 2, 1)) + 1)
        gain, first, last = best_stretch(*_moments(validator, body, number, ends))
        best = max(best, (gain, number, float(ends[first]), float(ends[last])))
    gain, chosen, start, stop = best
    every = enumerate(data.times)
    return gain, [(t >= start) & (t < stop) if k == chosen else np.zeros(len(t), bool) for k, t in every]


def _moments(validator: CrossValidator, body: Candidate, number: int, ends: Array) -> tuple[Array, Array, Array]:
    """Weighted moments of a body's columns in each block of a motion, as `best_stretch` takes them."""
    data, system = validator.data, validator.fit.systems[-1]
    blocks, p, k = len(ends) - 1, len(system.free), len(body.signs)
    cross, left, own = np.zeros((blocks, p, k)), np.zeros((blocks, k)), np.zeros((blocks, k, k))
    for row in body.columns:
        joint, active, weight = data.of_motion(row, number), data.cache.active[row], validator.fit.omega[row]
        C, error = body.over(joint), joint.tau - joint.Y @ system.free[active]
        at = np.searchsorted(data.cache.motions[number].t.read()[joint.picked], ends).tolist()
        for b, rows in enumerate(map(slice, at[:-1], at[1:])):
            scaled = weight * C[rows]
            cross[b, active] += joint.Y[rows].T @ scaled
            left[b] += error[rows] @ scaled
            own[b] += C[rows].T @ scaled
    factor, lower = system.factor
    flat = cross.transpose(1, 0, 2).reshape(p, -1)
    free = linalg.solve_triangular(factor, flat, trans=0 if lower else 1, lower=lower)
    return free.reshape(p, blocks, k).transpose(1, 0, 2), left, own


def settled_states(fit: CrossValidator, body: Candidate, states: list[States]) -> list[States] | None:
    """The states, found in turns with the parameters; None where the robot carries the body always or never.

    A mass below zero is a body that the robot carries at the other times.
    """
    weighed, first = weighs(fit, body), fit.columns.width
    for _ in range(_STATE_TURNS):
        if all(s.all() for s in states) or not any(s.any() for s in states):
            return None
        wider_fit = fit.extended(while_carried(fit, body, states))
        if weighed and wider_fit.theta[first] < 0:
            states = [~s for s in states]
            continue
        new = _likeliest(fit, body, states, wider_fit)
        if all(np.array_equal(a, b) for a, b in zip(new, states, strict=True)):
            break
        states = new
    return states


def while_carried(fit: CrossValidator, body: Candidate, states: Sequence[States]) -> Candidate:
    """The body's columns, zero while the robot does not carry it."""
    cache = fit.data.cache
    columns = {row: Series(cache.store) for row in body.columns}
    for row, series in columns.items():
        for motion, carried in zip(cache.motions, states, strict=True):
            series.append(body.columns[row][motion.number] * carried[motion.picked[row].read(), None])
    return Candidate(body.effect, columns, body.signs)


def _likeliest(fit: CrossValidator, body: Candidate, states: Sequence[States], loaded: CrossValidator) -> list[States]:
    """The likeliest states under the parameters of a fit with the body in some states, (n,) for each motion."""
    phi = loaded.theta[-len(body.signs) :]
    price = 2.0 * float(np.log(max(fit.effective.sum(), 2.0)))
    found = []
    for number, before in enumerate(states):
        gain = np.zeros(len(before))
        for row in body.columns:
            joint = fit.data.of_motion(row, number)
            torque = body.over(joint) @ phi
            without = loaded.columns.residual(joint, loaded.theta) + torque * before[joint.picked]
            gain[joint.picked] += loaded.fit.omega[row] * torque * (2 * without - torque)
        found.append(likeliest_states(gain, price))
    return found


def weighs(validator: CrossValidator, body: Candidate) -> bool:
    """Whether the first of the body's columns is that of its mass."""
    robot = validator.model.robot
    return columns_of(robot, [body.effect])[len(robot.columns)].unit == "kg"
