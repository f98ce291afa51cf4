"""Candidates that explain the data together: forward selection, then an exchange of each.

A real robot has several small effects beside the large one. So candidates enter the model one after another. The
candidate that explains most, given those already in the model, enters next if it passes every test. Afterwards each
chosen candidate is replaced by another one where the other explains more.

With E(S) = Σ_j NRMSE_j² of the model with the set S of candidates, the error that only candidate e explains is

    unique_e = E(all but e) − E(all),

so an error that two candidates explain equally well counts for neither. Its *part* is the Shapley value, the mean over
all orders in which the candidates may enter,

    part_e = mean over orders of E(those before e) − E(those before e, and e),

so such an error counts half for each. The parts add up to all that is explained.

Sources: Chen, Billings and Luo 1989, "Orthogonal least squares methods and their application to non-linear system
identification", Int. J. Control 50(5); Grömping 2007, "Estimators of relative importance in linear regression based on
variance decomposition", The American Statistician 61(2).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import combinations
from math import factorial
from typing import NamedTuple

import numpy as np

from frischid.core.types import Array
from frischid.diagnosis.cross_validation import CrossValidator
from frischid.diagnosis.scored_candidate import ScoredCandidate, passes, scored


class OwnPart(NamedTuple):
    """Error that a candidate explains beside the others, in summed squared NRMSE."""

    unique: float = 0.0
    """Error that only this candidate explains."""
    part: float = 0.0
    """Its Shapley value."""
    new: float = 0.0
    """The same of the error beyond the residual that was known before; zero where no residual was known."""


class Selection(NamedTuple):
    """Candidates that explain the data together, and the cross-validator of the model with all of them."""

    chosen: list[ScoredCandidate]
    full: CrossValidator


def selected(validator: CrossValidator, pool: Sequence[ScoredCandidate], tried: int) -> Selection:
    """Let candidates enter one after another, then exchange each for a better one.

    Parameters
    ----------
    pool : sequence of ScoredCandidate
        Each scored alone.
    tried : int
        Candidates that were tried in all.
    """
    entered = _entered(Selection([], validator), _most_promising(validator, pool), tried)
    exchanged = _exchanged(validator, pool, entered, tried)
    return _entered(exchanged, [c for c in entered.chosen if c not in exchanged.chosen], tried)


def _entered(before: Selection, rest: Sequence[ScoredCandidate], tried: int) -> Selection:
    """Let candidates enter one after another beside those in the model, as long as one of them passes every test."""
    chosen, now = list(before.chosen), before.full
    rest = [c for c in rest if not any(excluded(c, x) for x in chosen)]
    while rest and len(chosen) < now.criteria.max_entered:
        now.fits([c.candidate for c in rest])
        fresh = [(c, x) for c in rest if (x := scored(now, [c.candidate])) is not None and passes(now, x, tried)]
        if not fresh:
            break
        best = likeliest(now, fresh)
        rest = [c for c, _ in fresh if c is not best]
        extended = now.extended(best.candidate)
        if not _better(now, extended):
            continue  # under the new weights of the joints the candidate does harm
        chosen.append(best)
        rest = [c for c in rest if not excluded(c, best)]
        now = extended
    return Selection(chosen, now)


def likeliest(validator: CrossValidator, fresh: Sequence[tuple[ScoredCandidate, ScoredCandidate]]) -> ScoredCandidate:
    """The candidate that explains most, where the places of an effect count together against one of all their joints.

    A delay acts on all joints with one coefficient; hysteresis has a place of its own at each joint. What the one
    explains at all joints is compared with what the other explains there.

    Parameters
    ----------
    fresh : sequence of (ScoredCandidate, ScoredCandidate)
        Each candidate, and the same candidate scored beside those in the model.
    """
    best, alone = max(fresh, key=lambda pair: pair[1].explained)
    joints, most = best.candidate.columns.keys(), alone.explained
    for kind in dict.fromkeys(type(c.effect) for c, _ in fresh if type(c.effect) is not type(best.effect)):
        places = [(c, x) for c, x in fresh if type(c.effect) is kind and c.candidate.columns.keys() < joints]
        if len(places) < 2:
            continue
        together = scored(validator, [validator.joined([c.candidate for c, _ in places])])
        if together is not None and together.explained > most:
            best, most = max(places, key=lambda pair: pair[1].explained)[0], together.explained
    return best


def _most_promising(validator: CrossValidator, pool: Sequence[ScoredCandidate]) -> list[ScoredCandidate]:
    return sorted((c for c in pool if c.gain > 0), key=lambda c: -c.explained)[: validator.criteria.max_pool]


def excluded(candidate: ScoredCandidate, chosen: ScoredCandidate) -> bool:
    """Whether a model cannot have a candidate beside a chosen one.

    Both are of a kind that acts in one place only, or that has the same names of parameters on the same joints. Or both
    have the same change of old parameters.
    """
    one, other = candidate.effect, chosen.effect
    if not {*candidate.candidate.beside}.isdisjoint(chosen.candidate.effects) or one in chosen.candidate.beside:
        return True
    return type(one) is type(other) and (one.single or (one.joints == other.joints and not one.several))


def _exchanged(validator: CrossValidator, pool: Sequence[ScoredCandidate], entered: Selection, tried: int) -> Selection:
    """Replace every chosen candidate, in turn and once, by another one where the other explains more.

    The other one must pass the tests that the chosen one has passed.
    """
    chosen, full = list(entered.chosen), entered.full
    if len(chosen) < 2:
        return Selection(chosen, full)
    likely = _most_promising(validator, pool)
    for k in range(len(chosen)):
        rest = [c for i, c in enumerate(chosen) if i != k]
        without = with_all(validator, rest)
        others = [c for c in likely if not any(c is x or excluded(c, x) for x in rest)]
        without.fits([c.candidate for c in others])
        found = [(c, x) for c in others if (x := scored(without, [c.candidate])) is not None]
        best = likeliest_passing(without, found, chosen[k], tried)
        if best is None:
            continue
        if best is not chosen[k] and _better(full, extended := without.extended(best.candidate)):
            chosen[k], full = best, extended
    return Selection(chosen, full)


def likeliest_passing(
    validator: CrossValidator,
    found: list[tuple[ScoredCandidate, ScoredCandidate]],
    chosen: ScoredCandidate,
    tried: int,
) -> ScoredCandidate | None:
    """The likeliest candidate that passes, or the chosen one where none is likelier."""
    while found:
        best = likeliest(validator, found)
        beside = next(x for c, x in found if c is best)
        if best is chosen or passes(validator, beside, tried):
            return best
        found = [(c, x) for c, x in found if c is not best]
    return None


def _better(before: CrossValidator, after: CrossValidator) -> bool:
    """Whether the held-out error, summed over the joints and without what uncertain parameters cause, is smaller."""
    return before.explained(before.base_predictive(), after.base_predictive()) > 0


def with_all(validator: CrossValidator, chosen: Iterable[ScoredCandidate]) -> CrossValidator:
    """The cross-validator with some candidates taken into the model."""
    for c in chosen:
        validator = validator.extended(c.candidate)
    return validator


def own_parts(validator: CrossValidator, chosen: Sequence[ScoredCandidate]) -> list[OwnPart]:
    """The error that each of the chosen explains beside the others."""
    known, everyone = validator.known_residual**2, range(len(chosen))

    def errors(members: Iterable[int]) -> Array:
        squares = with_all(validator, [chosen[k] for k in members]).predictive_nrmse() ** 2
        return np.array([squares.sum(), np.maximum(squares, known).sum() if known.any() else 0.0])

    error = {frozenset(m): errors(m) for size in range(len(chosen) + 1) for m in combinations(everyone, size)}
    return [_own_part(error, frozenset(everyone), k) for k in everyone]


def _own_part(error: Mapping[frozenset[int], Array], everyone: frozenset[int], one: int) -> OwnPart:
    """Of one candidate; `error`: E of every set of candidates, in all and beyond the known residual."""
    others = everyone - {one}
    falls = {before: error[before] - error[before | {one}] for before in error if one not in before}
    orders = {before: factorial(len(before)) * factorial(len(others) - len(before)) for before in falls}
    part, new = np.sum([orders[m] * falls[m] for m in falls], axis=0) / factorial(len(everyone))
    return OwnPart(float(falls[others][0]), float(part), max(float(new), 0.0))
