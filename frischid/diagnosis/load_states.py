"""When does the robot carry a body? For each moment a state, fitted in turns with the parameters.

With s(t) = 1 while the robot carries the body and 0 otherwise, φ the body's mass and first moment and Γ their columns,

    τ = Y θ + s(t) · Γ φ.

With s known, θ and φ are a least-squares fit. Of all stretches of time between the ends of short blocks, the stretch
whose φ explains most is found exactly: of each stretch, the moments of Γ are a difference of two sums, and θ is
eliminated. Then, in turns, θ and φ are fitted, and s is the best sequence of two states, which may change often, at a
price for each change (Viterbi's algorithm). The turns end where s stays the same.

Sources: Bai and Perron 1998, "Estimating and testing linear models with multiple structural changes", Econometrica
66(1); Forney 1973, "The Viterbi algorithm", Proc. IEEE 61(3).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from frischid.core.array_store import Series
from frischid.core.types import Array
from frischid.diagnosis.candidate_columns import Candidate
from frischid.diagnosis.cross_validation import CrossValidator
from frischid.effects import columns_of

States = NDArray[np.bool_]

_STRETCH_ENDS = 100  # of a log, between whose ends the first stretch is sought
_STATE_TURNS = 8  # of states and parameters; the states usually stay the same after three
_RIDGE_SHARE = 1e-4  # of a column's squared norm: a part that the model's columns span says nothing of a body


def best_stretch(validator: CrossValidator, body: Candidate) -> tuple[float, list[States]]:
    """The fall of the weighted squared error by a body that is carried over one stretch, and the states, (n,) each."""
    data, best = validator.data, (0.0, -1, 0.0, 0.0)
    moments = [_Moments.of(validator, body, number) for number in range(len(data.sources))]
    for number in range(len(moments)):
        gain, start, stop = moments[number].best()
        best = max(best, (gain, number, start, stop))
    gain, chosen, start, stop = best
    every = enumerate(data.times)
    return gain, [(t >= start) & (t < stop) if k == chosen else np.zeros(len(t), bool) for k, t in every]


@dataclass(frozen=True, eq=False)
class _Moments:
    """Weighted moments of a body's k columns over one motion, summed from its start to each end of a block."""

    ends: Array
    """Ends of the blocks, s, (B + 1,)."""
    cross: Array
    """Moments with the model's p columns, times the inverse of the factor of H, (B + 1, p, k)."""
    left: Array
    """Moments with the residual, (B + 1, k)."""
    own: Array
    """Moments of the columns, (B + 1, k, k)."""

    @classmethod
    def of(cls, validator: CrossValidator, body: Candidate, number: int) -> _Moments:
        """Sum the moments over one motion."""
        data, system = validator.data, validator.fit.systems[-1]
        t = data.cache.motions[number].t.read()
        blocks, p, k = min(_STRETCH_ENDS, max(len(t) // 2, 1)), len(system.free), len(body.signs)
        ends = np.linspace(t[0], t[-1], blocks + 1)
        ends[-1] = np.nextafter(ends[-1], np.inf)
        cross, left, own = np.zeros((blocks + 1, p, k)), np.zeros((blocks + 1, k)), np.zeros((blocks + 1, k, k))
        for row in body.columns:
            joint, active, weight = data.of_motion(row, number), data.cache.active[row], validator.fit.omega[row]
            C, error = body.over(joint), joint.tau - joint.Y @ system.free[active]
            at = np.searchsorted(t[joint.picked], ends).tolist()
            for b, rows in enumerate(map(slice, at[:-1], at[1:]), start=1):
                scaled = weight * C[rows]
                cross[b, active] += joint.Y[rows].T @ scaled
                left[b] += error[rows] @ scaled
                own[b] += C[rows].T @ scaled
        flat = np.cumsum(cross, axis=0).transpose(1, 0, 2).reshape(p, -1)
        upper, lower = system.factor
        free = linalg.solve_triangular(upper, flat, trans=0 if lower else 1, lower=lower)
        return cls(
            ends, free.reshape(p, blocks + 1, k).transpose(1, 0, 2), *(np.cumsum(x, axis=0) for x in (left, own))
        )

    def best(self) -> tuple[float, float, float]:
        """The fall of the squared error by the best stretch, and its start and stop, s."""
        best = (0.0, 0.0, 0.0)
        for i in range(len(self.ends) - 1):
            cross, left, own = (x[i + 1 :] - x[i] for x in (self.cross, self.left, self.own))
            S = own - cross.transpose(0, 2, 1) @ cross
            size = np.sqrt(np.einsum("nkk->nk", own))
            scale = np.where(size > 0, size, 1.0)  # zero where no joint has rows
            S = S / (scale[:, :, None] * scale[:, None]) + _RIDGE_SHARE * np.eye(S.shape[1])
            right = left / scale
            gains = (right * np.linalg.solve(S, right[..., None])[..., 0]).sum(axis=1)
            j = int(np.argmax(gains))
            best = max(best, (float(gains[j]), float(self.ends[i]), float(self.ends[i + 1 + j])))
        return best


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
        found.append(_two_states(gain, price))
    return found


def _two_states(gain: Array, price: float) -> States:
    """The states, (n,), with the largest sum of gains while True, less a price for each change of the state."""
    best, stays = np.zeros(2), np.empty((len(gain), 2), bool)
    for k, g in enumerate(gain.tolist()):
        other = best[::-1] - price
        stays[k] = best >= other
        best = np.maximum(best, other) + np.array([0.0, g])
    states = np.empty(len(gain), bool)
    state = int(np.argmax(best))
    for k in range(len(gain) - 1, -1, -1):
        states[k] = bool(state)
        state = state if stays[k, state] else 1 - state
    return states


def weighs(validator: CrossValidator, body: Candidate) -> bool:
    """Whether the first of the body's columns is that of its mass."""
    robot = validator.model.robot
    return columns_of(robot, [body.effect])[len(robot.columns)].unit == "kg"
