"""A load that the robot carries for a while: it takes a body within a log, and maybe puts it down again.

While the robot carries a body on link k, the torque is

    τ = Y θ + s(t) · Γ_k φ,      s(t) = 1 while the body is carried, 0 otherwise,

with φ the body's mass and first moment. No effect of the catalogue acts for a while only. So the other effects imitate
the body in part, or its torque counts as a contact.

With s known, θ and φ are a least-squares fit. Of all stretches of time between the ends of short blocks, the stretch
whose φ explains most is found exactly: of each stretch, the moments of Γ_k are a difference of two sums, and θ is
eliminated. Then, in turns, θ and φ are fitted, and s is the best sequence of two states, which may change often, at a
price for each change (Viterbi's algorithm). The turns end where s stays the same.

A load is found where a joint's error asks for an explanation, and the load leaves hardly any of the error above the
noise that the effects of the catalogue leave together.

Sources: Bai and Perron 1998, "Estimating and testing linear models with multiple structural changes", Econometrica
66(1); Forney 1973, "The Viterbi algorithm", Proc. IEEE 61(3).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from frischid.core.array_store import Series
from frischid.core.text import rounded
from frischid.core.types import Array
from frischid.diagnosis.candidate_columns import Candidate
from frischid.diagnosis.cross_validation import CrossValidator
from frischid.diagnosis.floor import asks_for_explanation
from frischid.diagnosis.stretches import Stretch, in_words, plain, reach_of_a_step, wider
from frischid.effects import Payload, columns_of

States = NDArray[np.bool_]

_BLOCKS = 100  # of a log, between whose ends the first stretch is sought
_TURNS = 8  # of states and parameters; the states usually stay the same after three
_RIDGE_SHARE = 1e-4  # of a column's squared norm: a part that the model's columns span says nothing of a body


@dataclass(frozen=True)
class CarriedLoad:
    """A body that the robot carries for a while."""

    joint: str
    """Joint behind which the body is."""
    mass: float | None
    """kg; None where no torque depends on the mass."""
    mass_error: float | None
    """Its standard error, kg."""
    stretches: tuple[Stretch, ...]
    """Log, start and stop, s: where the robot carries the body."""
    left_out: tuple[Stretch, ...]
    """The times with the body or those without, whichever are shorter together: the search leaves them out."""
    log_starts: Mapping[str, float] = field(default_factory=dict)
    """Log -> its first time stamp, s; none for a recording that is read in pieces."""

    @property
    def words(self) -> str:
        """The body with its mass.

        >>> CarriedLoad("joint6", 1.4961, 0.0213, (), ()).words
        'a load of 1.496 ± 0.021 kg behind joint6'
        """
        if self.mass is None or self.mass_error is None:
            return f"a load behind {self.joint}"
        return f"a load of {rounded(self.mass, self.mass_error)} kg behind {self.joint}"

    def __str__(self) -> str:
        without = "" if self.left_out == self.stretches else "out"
        return (
            f"the robot carries {self.words} for a while, in {in_words(self.stretches, self.log_starts)}. The times "
            f"with{without} the load are left out of the search"
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON values."""
        weight = {"mass": self.mass, "mass_error": self.mass_error}
        return {"joint": self.joint, **weight, "stretches": plain(self.stretches, self.log_starts)}


@dataclass(frozen=True, eq=False)
class FoundLoad:
    """A load that explains most of the error, with the fits that judge it."""

    load: CarriedLoad
    validator: CrossValidator
    """Fit to all times, without added candidates."""
    before: float
    """Summed squared NRMSE above the noise that the effects of the catalogue leave together."""
    body: Candidate
    """The body's columns, zero while the robot does not carry it."""
    noise: Array
    """NRMSE of the sensor noise of each joint, (J,)."""

    @property
    def rest(self) -> CrossValidator:
        """Fit to the times in which the robot's load does not change."""
        return self.validator.without(wider(self.load.left_out, reach_of_a_step(self.validator.model.lowpass)))

    def fitted(self, effects: Sequence[Candidate], carried: Candidate) -> CrossValidator:
        """Fit with some effects and what acts for a while, without the moments at which the load changes."""
        changes = [(source, t, t) for source, *ends in self.load.stretches for t in ends]
        fit = self.validator.without(wider(changes, reach_of_a_step(self.validator.model.lowpass)))
        for candidate in (*effects, carried):
            fit = fit.extended(candidate)
        return fit

    @cached_property
    def push(self) -> Candidate:
        """A constant torque of each joint while the robot carries the load: that of a steady push."""
        cache, inside = self.validator.data.cache, list[Array]()
        for motion in cache.motions:
            t, own = motion.t.read(), [(a, b) for source, a, b in self.load.stretches if source == motion.source]
            inside.append(np.array(sum(((t >= a) & (t <= b) for a, b in own), np.zeros(len(t)))))
        rows = range(len(self.validator.joints))
        return cache.joined([cache.given(self.body.effect, row, inside) for row in rows])

    def left_by(self, fit: CrossValidator) -> float:
        """The share of the error that a fit with the load leaves."""
        return _above(fit, self.noise) / self.before

    def beside(self, full: CrossValidator) -> CarriedLoad | None:
        """The load, weighed beside some effects; None where it may weigh nothing, or leaves more than hardly any error.

        Parameters
        ----------
        full : CrossValidator
            Fit to the rest, with the effects that entered there.
        """
        criteria, effects = self.validator.criteria, full.columns.added
        fit = self.fitted(effects, self.body)
        left = self.left_by(fit)
        if left > 1 - criteria.nearly_explained:
            return None
        if left > (1 - criteria.half_explained) * self.left_by(self.fitted(effects, self.push)):
            return None
        if not _weighed(self.validator, self.body):
            return self.load
        k = len(self.body.signs)
        mass, error = float(fit.theta[-k]), float(np.sqrt(fit.fit.covariance[-k, -k]))
        return replace(self.load, mass=mass, mass_error=error) if mass > 2 * error else None


def find_load(validator: CrossValidator, full: CrossValidator, floor: Array) -> FoundLoad | None:
    """Find the body that the robot carries for a while; None where none explains most of the error.

    Parameters
    ----------
    validator, full : CrossValidator
        Without added candidates, and with all effects that entered.
    floor : ndarray, shape (J,)
        Sensor noise of each joint, N·m (N).
    """
    noise = floor / validator.spread
    if not asks_for_explanation(full.predictive_nrmse(), noise, validator).any():
        return None
    bodies = [Payload((name,)) for name in validator.model.robot.joints]
    found = [c for c in validator.candidates(bodies) if c.finite and c.columns]
    first = [_best_stretch(validator, body) for body in found]
    if not first:
        return None
    body, (_, states) = max(zip(found, first, strict=True), key=lambda x: x[1][0])
    settled = _settled(validator, body, states)
    return None if settled is None else _judged(validator, full, noise, body, settled)


def _best_stretch(validator: CrossValidator, body: Candidate) -> tuple[float, list[States]]:
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
        blocks, p, k = min(_BLOCKS, max(len(t) // 2, 1)), len(system.free), len(body.signs)
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


def _settled(validator: CrossValidator, body: Candidate, states: list[States]) -> list[States] | None:
    """The states, found in turns with the parameters; None where the body is carried always or never."""
    for _ in range(_TURNS):
        if all(s.all() for s in states) or not any(s.any() for s in states):
            return None
        wider = validator.extended(_while(validator, body, states))
        new = _likeliest(validator, body, wider)
        if all(np.array_equal(a, b) for a, b in zip(new, states, strict=True)):
            break
        states = new
    return states


def _while(validator: CrossValidator, body: Candidate, states: Sequence[States]) -> Candidate:
    """The body's columns, zero while the robot does not carry it."""
    cache = validator.data.cache
    columns = {row: Series(cache.store) for row in body.columns}
    for row, series in columns.items():
        for motion, carried in zip(cache.motions, states, strict=True):
            series.append(body.columns[row][motion.number] * carried[motion.picked[row].read(), None])
    return Candidate(body.effect, columns, body.signs)


def _likeliest(validator: CrossValidator, body: Candidate, wider: CrossValidator) -> list[States]:
    """The most likely states under the parameters of a fit with the body, (n,) for each motion."""
    data, k = validator.data, len(body.signs)
    theta, phi = wider.theta[:-k], wider.theta[-k:]
    price = 2.0 * float(np.log(max(validator.effective.sum(), 2.0)))
    found = []
    for number, t in enumerate(data.times):
        gain = np.zeros(len(t))
        for row in body.columns:
            joint = data.of_motion(row, number)
            torque = body.over(joint) @ phi
            error = joint.tau - joint.Y @ theta[data.cache.active[row]]
            gain[joint.picked] += wider.fit.omega[row] * torque * (2 * error - torque)
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


def _judged(
    validator: CrossValidator, full: CrossValidator, noise: Array, body: Candidate, states: list[States]
) -> FoundLoad | None:
    """The load, where it explains most of the error that the effects of the catalogue leave together."""
    carried = _while(validator, body, states)
    if (
        _weighed(validator, body) and validator.extended(carried).theta[-len(body.signs)] < 0
    ):  # the robot carries it at the other times
        states = [~s for s in states]
        carried = _while(validator, body, states)
    stretches, without = _stretches(validator, states), _stretches(validator, [~s for s in states])
    (name,) = body.effect.joints or ()
    load = CarriedLoad(name, None, None, stretches, min(stretches, without, key=_length))
    found = FoundLoad(load, validator, _above(full, noise), carried, noise)
    if not validator.moves_without(wider(load.left_out, reach_of_a_step(validator.model.lowpass))):
        return None
    left = min(found.left_by(found.fitted(effects, carried)) for effects in ((), full.columns.added))
    return found if left < 1 - validator.criteria.half_explained else None


def _above(fit: CrossValidator, noise: Array) -> float:
    """Summed squared NRMSE of a fit above the noise."""
    return float(np.maximum(fit.predictive_nrmse() ** 2 - noise**2, 0.0).sum())


def _weighed(validator: CrossValidator, body: Candidate) -> bool:
    """Whether the first of the body's columns is that of its mass."""
    robot = validator.model.robot
    return columns_of(robot, [body.effect])[len(robot.columns)].unit == "kg"


def _stretches(validator: CrossValidator, states: Sequence[States]) -> tuple[Stretch, ...]:
    """The stretches of time in which the states are True."""
    found = list[Stretch]()
    for source, t, carried in zip(validator.data.sources, validator.data.times, states, strict=True):
        ends = np.flatnonzero(np.diff(carried.astype(int), prepend=0, append=0)).reshape(-1, 2)
        found += [(source, float(t[a]), float(t[b - 1])) for a, b in ends.tolist()]
    return tuple(found)


def _length(stretches: Sequence[Stretch]) -> float:
    return sum(stop - start for _, start, stop in stretches)
