"""A load that the robot carries for a while: it takes a body within a log, and maybe puts it down again.

No effect of the catalogue acts for a while only. So the other effects imitate the body in part, or its torque counts as
a contact. A body on a link that acts for a while (`load_states`) is sought without the effects that entered and beside
them, then in turns with the effects that are missing beside the body: these are sought in the longer times, those with
the body or those without. A load is found where

- a joint's error asks for an explanation;
- the load leaves hardly any of the error above the noise that the effects of the catalogue leave together, beside the
  effects of the longer times;
- a steady push, which is a constant torque of each joint at times of its own, leaves more than twice as much;
- the mass is above zero, tested at a level that counts all stretches and links that were tried (Bonferroni): that of a
  body of mass and first moment, and that of a body with all ten parameters, which is told.

The moments at which the load changes do not count, as long as the filter spreads them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy import special

from frischid.core.text import rounded
from frischid.core.types import Array
from frischid.diagnosis.candidate_columns import Candidate
from frischid.diagnosis.cross_validation import CrossValidator
from frischid.diagnosis.effect_findings import FoundEffects
from frischid.diagnosis.floor import asks_for_explanation
from frischid.diagnosis.load_states import STRETCH_ENDS, States, first_states, settled_states, while_acting
from frischid.diagnosis.stretches import Stretch, in_words, plain, reach_of_a_step, wider
from frischid.effects import Payload, columns_of

_SEARCHES_OF_EFFECTS = 4  # in turns with the states; the second usually finds the effects of the first


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
        'a load of 1.496 ± 0.021 kg on the link behind joint6'
        """
        if self.mass is None or self.mass_error is None:
            return f"a load on the link behind {self.joint}"
        return f"a load of {rounded(self.mass, self.mass_error)} kg on the link behind {self.joint}"

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
class LoadedFit:
    """A fit of the model, some effects and a body that is carried for a while."""

    validator: CrossValidator
    """Fit to all times, without added candidates."""
    full: CrossValidator
    """The same with all effects that entered without a load."""
    noise: Array
    """NRMSE of the sensor noise of each joint, (J,)."""
    body: Candidate
    """The body's columns, as if the robot carried the body always."""
    effects: tuple[Candidate, ...]
    """Effects that the model lacks beside the load."""
    states: list[States]
    """For each motion whether the robot carries the body, (n,)."""

    @cached_property
    def stretches(self) -> tuple[Stretch, ...]:
        """The times in which the robot carries the body."""
        return _stretches(self.validator, self.states)

    @cached_property
    def left_out(self) -> tuple[Stretch, ...]:
        """The times with the body or those without, whichever are shorter together."""
        return min(self.stretches, _stretches(self.validator, [~s for s in self.states]), key=_length)

    @property
    def _reach(self) -> float:
        return reach_of_a_step(self.validator.model.lowpass)

    @cached_property
    def rest(self) -> CrossValidator:
        """Fit to the longer times, in which the load does not change."""
        return self.validator.without(wider(self.left_out, self._reach))

    @property
    def can_be_judged(self) -> bool:
        """Whether all joints move in the longer times, and between the changes of the load."""
        return all(map(self.validator.moves_without, (wider(self.left_out, self._reach), self._changes)))

    @cached_property
    def _changes(self) -> list[Stretch]:
        """The moments at which the load changes, or a steady push in its place."""
        pushed = [] if self._pushed is None else _stretches(self.validator, self._pushed)
        ends = [(source, t, t) for source, *both in (*self.stretches, *pushed) for t in both]
        return wider(ends, self._reach)

    @cached_property
    def _between(self) -> CrossValidator:
        return self.validator.without(self._changes)

    @cached_property
    def _push(self) -> Candidate:
        """A constant torque of each joint."""
        cache = self.validator.data.cache
        ones = [np.ones(motion.t.shape[0]) for motion in cache.motions]
        return cache.joined([cache.given(self.body.effect, row, ones) for row in range(len(self.validator.joints))])

    @cached_property
    def _pushed(self) -> list[States] | None:
        """The states of the steady push that explains most beside the effects."""
        beside = _extended(self.validator, self.effects)
        return settled_states(beside, self._push, first_states(beside, self._push)[1])

    def _with(self, acting: Candidate, states: list[States]) -> CrossValidator:
        return _extended(self._between, (*self.effects, while_acting(self.validator, acting, states)))

    def _above(self, fit: CrossValidator) -> float:
        """Summed squared NRMSE of a fit above the noise."""
        return float(np.maximum(fit.predictive_nrmse() ** 2 - self.noise**2, 0.0).sum())

    @cached_property
    def before(self) -> float:
        """Error that all effects that entered without a load leave."""
        return self._above(_extended(self._between, self.full.columns.added))

    @cached_property
    def left(self) -> float:
        """Error that the load and the effects beside it leave."""
        return self._above(self._with(self.body, self.states))

    @property
    def _left_by_a_push(self) -> float:
        """Error that a steady push and the effects leave."""
        if self._pushed is None:
            return self._above(_extended(self._between, self.effects))
        return self._above(self._with(self._push, self._pushed))

    def beside(self, effects: tuple[Candidate, ...]) -> LoadedFit | None:
        """The fit beside other effects, with the likeliest states there; None where there are none."""
        weighs = _weighs(self.validator, self.body)
        states = settled_states(_extended(self.validator, effects), self.body, self.states, positive=weighs)
        return None if states is None else replace(self, states=states, effects=effects)

    def agrees(self, other: LoadedFit) -> bool:
        """Whether another fit has the same stretches, up to the time over which the filter spreads a change."""
        pairs = zip(self.stretches, other.stretches, strict=False)
        near = all(a[0] == b[0] and np.abs(np.subtract(a[1:], b[1:])).max() <= self._reach for a, b in pairs)
        return len(self.stretches) == len(other.stretches) and near

    @property
    def load(self) -> CarriedLoad | None:
        """The load, where it is one: see the module."""
        criteria, (name,) = self.validator.criteria, self.body.effect.joints or ()
        if self.left > (1 - criteria.nearly_explained) * self.before:
            return None
        if self.left >= (1 - criteria.half_explained) * self._left_by_a_push:
            return None
        if not _weighs(self.validator, self.body):
            return CarriedLoad(name, None, None, self.stretches, self.left_out)
        tried = len(self.validator.model.robot.joints) * len(self.states) * STRETCH_ENDS * (STRETCH_ENDS + 1) / 2
        errors = float(special.ndtri(1 - criteria.significance / tried))  # standard errors
        for body in (self.body, *self.validator.candidates([Payload((name,), full=True)])):
            mass, error = _mass(self._with(body, self.states), body)
            if mass <= errors * error:
                return None
        return CarriedLoad(name, mass, error, self.stretches, self.left_out)


def find_load(
    validator: CrossValidator, full: CrossValidator, floor: Array, search: Callable[[CrossValidator], FoundEffects]
) -> tuple[CarriedLoad, CrossValidator, FoundEffects] | None:
    """Find the body that the robot carries for a while, in turns with the effects that are missing beside it.

    Parameters
    ----------
    validator, full : CrossValidator
        Without added candidates, and with all effects that entered.
    floor : ndarray, shape (J,)
        Sensor noise of each joint, N·m (N).
    search : callable
        Finds effects beside a fit.

    Returns
    -------
    (CarriedLoad, CrossValidator, FoundEffects) or None
        The load, the fit to the rest of the time, and what the search found there.
    """
    fit = _first(validator, full, floor / validator.spread)
    for _ in range(_SEARCHES_OF_EFFECTS):
        if fit is None or not fit.can_be_judged:
            return None
        found = search(fit.rest)
        beside = fit.beside(found.ranking.full.columns.added)
        if beside is not None and beside.agrees(fit):
            load = beside.load if beside.can_be_judged else None
            return None if load is None else (load, fit.rest, found)
        fit = beside
    return None


def _first(validator: CrossValidator, full: CrossValidator, noise: Array) -> LoadedFit | None:
    """The body that leaves least where the robot carries it for a while, without the effects that entered or with them.

    None where no joint's error asks for an explanation, or the body explains a small part of the error.
    """
    if not asks_for_explanation(full.predictive_nrmse(), noise, validator).any():
        return None
    every = [Payload((name,)) for name in validator.model.robot.joints]
    bodies, fits = [c for c in validator.candidates(every) if c.finite and c.columns], list[LoadedFit]()
    for effects in dict.fromkeys(((), full.columns.added)):
        beside = _extended(validator, effects)
        first = [(*first_states(beside, body), body) for body in bodies]
        if not first:
            return None
        _, states, body = max(first, key=lambda x: x[0])
        begun = LoadedFit(validator, full, noise, body, effects, states)
        fits += [fit for fit in [begun.beside(effects)] if fit is not None and fit.can_be_judged]
    best = min(fits, key=lambda fit: fit.left, default=None)
    return best if best is not None and best.left < validator.criteria.nearly_explained * best.before else None


def _extended(validator: CrossValidator, candidates: Sequence[Candidate]) -> CrossValidator:
    """A fit with some candidates added."""
    for candidate in candidates:
        validator = validator.extended(candidate)
    return validator


def _mass(fit: CrossValidator, body: Candidate) -> tuple[float, float]:
    """Mass of a body that was added last, and its standard error, kg."""
    k = len(body.signs)
    return float(fit.theta[-k]), float(np.sqrt(fit.fit.covariance[-k, -k]))


def _weighs(validator: CrossValidator, body: Candidate) -> bool:
    """Whether the first column is that of a mass."""
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
