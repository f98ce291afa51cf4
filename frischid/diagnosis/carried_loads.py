"""A load that the robot carries for a while: it takes a body within a log, and maybe puts it down again.

No effect of the catalogue acts for a while only. So the other effects imitate the body in part, or its torque counts as
a contact. A body on a link that acts for a while (`load_states`) is sought in turns with the effects that are missing
beside it: these are sought in the longer times, those with the body or those without. A load is found where

- a joint's error asks for an explanation;
- the load leaves hardly any of the error above the noise that the effects of the catalogue leave together, beside the
  effects of the longer times;
- a steady push, a constant torque of each joint at the same times, leaves more than twice as much;
- the mass is above zero by two standard errors, where torques depend on the mass.

The moments at which the load changes do not count, as long as the filter spreads them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from frischid.core.text import rounded
from frischid.core.types import Array
from frischid.diagnosis.candidate_columns import Candidate
from frischid.diagnosis.cross_validation import CrossValidator
from frischid.diagnosis.effect_ranking import Ranking
from frischid.diagnosis.findings import Finding
from frischid.diagnosis.floor import asks_for_explanation
from frischid.diagnosis.load_states import States, first_states, settled_states, weighs, while_carried
from frischid.diagnosis.stretches import Stretch, in_words, plain, reach_of_a_step, wider
from frischid.effects import Payload

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
    body: Candidate
    """The body's columns, as if the robot carried the body always."""
    states: list[States]
    """For each motion whether the robot carries the body, (n,)."""
    effects: tuple[Candidate, ...]
    """Effects that the model lacks beside the load."""
    before: float
    """Summed squared NRMSE above the noise that the effects of the catalogue leave together, without a load."""
    noise: Array
    """NRMSE of the sensor noise of each joint, (J,)."""

    @cached_property
    def stretches(self) -> tuple[Stretch, ...]:
        """The times in which the robot carries the body."""
        return _stretches(self.validator, self.states)

    @cached_property
    def left_out(self) -> tuple[Stretch, ...]:
        """The times with the body or those without, whichever are shorter together."""
        return min(self.stretches, _stretches(self.validator, [~s for s in self.states]), key=_length)

    @cached_property
    def rest(self) -> CrossValidator:
        """Fit to the longer times, in which the load does not change."""
        return self.validator.without(wider(self.left_out, reach_of_a_step(self.validator.model.lowpass)))

    def left_by(self, carried: Candidate) -> float:
        """The share of the error that the effects leave with columns that act for a while; the changes do not count."""
        return _above(self._with(carried), self.noise) / self.before

    def _with(self, carried: Candidate) -> CrossValidator:
        changes = [(source, t, t) for source, *ends in self.stretches for t in ends]
        fit = self.validator.without(wider(changes, reach_of_a_step(self.validator.model.lowpass)))
        return _extended(fit, (*self.effects, carried))

    @cached_property
    def carried(self) -> Candidate:
        """The body's columns, zero while the robot does not carry it."""
        return while_carried(self.validator, self.body, self.states)

    @cached_property
    def push(self) -> Candidate:
        """A constant torque of each joint while the robot carries the body: that of a steady push."""
        cache, values = self.validator.data.cache, [s.astype(float) for s in self.states]
        return cache.joined([cache.given(self.body.effect, row, values) for row in range(len(self.validator.joints))])

    def beside(self, effects: tuple[Candidate, ...]) -> LoadedFit | None:
        """The fit beside other effects, with the likeliest states there; None where they are always the same."""
        states = settled_states(_extended(self.validator, effects), self.body, self.states)
        return None if states is None else replace(self, states=states, effects=effects)

    @property
    def load(self) -> CarriedLoad | None:
        """The load; None where it may weigh nothing, leaves more than hardly any error, or is no better than a push."""
        criteria, left, (name,) = self.validator.criteria, self.left_by(self.carried), self.body.effect.joints or ()
        if left > 1 - criteria.nearly_explained or left > (1 - criteria.half_explained) * self.left_by(self.push):
            return None
        if not weighs(self.validator, self.body):
            return CarriedLoad(name, None, None, self.stretches, self.left_out)
        fit, k = self._with(self.carried), len(self.body.signs)
        mass, error = float(fit.theta[-k]), float(np.sqrt(fit.fit.covariance[-k, -k]))
        return CarriedLoad(name, mass, error, self.stretches, self.left_out) if mass > 2 * error else None


Search = Callable[[CrossValidator], tuple[list[Finding], Ranking, Array]]
"""Effects that a model lacks: their findings, the ranking, and the floor, as `effect_findings.find_effects`."""


def find_load(
    validator: CrossValidator, full: CrossValidator, floor: Array, search: Search
) -> tuple[CarriedLoad, CrossValidator, tuple[list[Finding], Ranking, Array]] | None:
    """Find the body that the robot carries for a while, in turns with the effects that are missing beside it.

    Parameters
    ----------
    validator, full : CrossValidator
        Without added candidates, and with all effects that entered.
    floor : ndarray, shape (J,)
        Sensor noise of each joint, N·m (N).
    search : callable

    Returns
    -------
    (CarriedLoad, CrossValidator, tuple) or None
        The load, the fit to the rest of the time, and what the search found there.
    """
    fit = _first(validator, full, floor / validator.spread)
    for _ in range(_SEARCHES_OF_EFFECTS):
        if fit is None or not validator.moves_without(wider(fit.left_out, reach_of_a_step(validator.model.lowpass))):
            return None
        found = search(fit.rest)
        beside = fit.beside(found[1].full.columns.added)
        if beside is not None and beside.stretches == fit.stretches:
            return None if beside.load is None else (beside.load, fit.rest, found)
        fit = beside
    return None


def _first(validator: CrossValidator, full: CrossValidator, noise: Array) -> LoadedFit | None:
    """The body whose torque explains most where the robot carries it over one stretch of time, beside no effects.

    None where no joint's error asks for an explanation, or the body explains a small part of the error.
    """
    if not asks_for_explanation(full.predictive_nrmse(), noise, validator).any():
        return None
    bodies = [Payload((name,)) for name in validator.model.robot.joints]
    found = [c for c in validator.candidates(bodies) if c.finite and c.columns]
    first = [first_states(validator, body) for body in found]
    if not first:
        return None
    body, (_, states) = max(zip(found, first, strict=True), key=lambda x: x[1][0])
    settled = settled_states(validator, body, states)
    if settled is None:
        return None
    fit = LoadedFit(validator, body, settled, (), _above(full, noise), noise)
    return fit if fit.left_by(fit.carried) < validator.criteria.nearly_explained else None


def _extended(validator: CrossValidator, candidates: Sequence[Candidate]) -> CrossValidator:
    for candidate in candidates:
        validator = validator.extended(candidate)
    return validator


def _above(fit: CrossValidator, noise: Array) -> float:
    """Summed squared NRMSE of a fit above the noise."""
    return float(np.maximum(fit.predictive_nrmse() ** 2 - noise**2, 0.0).sum())


def _stretches(validator: CrossValidator, states: Sequence[States]) -> tuple[Stretch, ...]:
    """The stretches of time in which the states are True."""
    found = list[Stretch]()
    for source, t, carried in zip(validator.data.sources, validator.data.times, states, strict=True):
        ends = np.flatnonzero(np.diff(carried.astype(int), prepend=0, append=0)).reshape(-1, 2)
        found += [(source, float(t[a]), float(t[b - 1])) for a, b in ends.tolist()]
    return tuple(found)


def _length(stretches: Sequence[Stretch]) -> float:
    return sum(stop - start for _, start, stop in stretches)
