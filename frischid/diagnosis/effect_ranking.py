"""Effects in order: all places of an effect as one, by the error that no other effect explains.

1.  Every effect in every place and shape is scored alone (`scored_candidate`).
2.  Candidates enter the model together (`stepwise_selection`).
3.  Places of one effect are joined. Effects that entered come first, by the error that only they explain; on logs the
    model was not made from, first by the part of it that was not known before. Then the others, by their own evidence.
4.  An effect that explains nearly as much as the first and adds nothing beside it is a *rival*: these data do not tell
    the two apart. The simpler of two rivals comes first.

So a hidden effect is found beside a background of small ones, and an effect that merely resembles it ranks lower.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

from frischid.diagnosis.block_test import block_test
from frischid.diagnosis.candidate_columns import Candidate
from frischid.diagnosis.cross_validation import CrossValidator, Score
from frischid.diagnosis.scored_candidate import ScoredCandidate, scored, usable_candidates
from frischid.diagnosis.shape_refinement import refined, with_refined_contenders
from frischid.diagnosis.stepwise_selection import OwnPart, own_part, selected, with_all
from frischid.effects import Effect


@dataclass(frozen=True, eq=False)
class ScoredEffect:
    """An effect at all its places.

    Attributes
    ----------
    places : tuple of ScoredCandidate
        Best first, each scored alone.
    together : Candidate
        All places at once.
    score : Score
        Of all places at once.
    gain : float
        Log likelihood less the price, alone.
    explained : float
        Fall of the summed squared NRMSE, alone.
    own : OwnPart
        Error that only this effect explains; zero unless it entered.
    p_value : float
    entered : bool
        Whether it is one of the effects that explain the data together.
    rivals : tuple of str
        Effects that explain these data as well.
    """

    places: tuple[ScoredCandidate, ...]
    together: Candidate
    score: Score
    gain: float
    explained: float
    own: OwnPart
    p_value: float
    entered: bool
    rivals: tuple[str, ...] = ()

    @property
    def kind(self) -> type[Effect]:
        """Class of the effect."""
        return type(self.together.effect)


@dataclass(frozen=True, eq=False)
class Ranking:
    """Every effect that can act on this robot, scored.

    Attributes
    ----------
    effects : list of ScoredEffect
        In order.
    full, without_first : CrossValidator
        With all that entered in the model, and with all but the first effect.
    """

    effects: list[ScoredEffect]
    full: CrossValidator
    without_first: CrossValidator


def ranking(
    validator: CrossValidator, kinds: Iterable[type[Effect]], progress: Callable[[str], None] = lambda _: None
) -> Ranking:
    """Score every effect of some kinds that can act on this robot, and put them in order."""
    places = [alternatives for kind in kinds for alternatives in kind.candidates(validator.model.robot)]
    alone = (scored(validator, shapes) for shapes in usable_candidates(validator, places, progress) if shapes)
    pool = [found for found in alone if found is not None]
    tried = len(pool)
    progress("comparing candidates")
    pool = with_refined_contenders(validator, pool)
    chosen, full = selected(validator, pool, tried)
    own = {id(c): own_part(validator, chosen, c, full) for c in chosen}
    first = max(chosen, key=lambda c: own[id(c)][::-1], default=None)
    others = [c for c in chosen if first is not None and type(c.effect) is not type(first.effect)]
    effects = []
    for kind in dict.fromkeys(type(c.effect) for c in pool):
        entered = sorted((c for c in chosen if type(c.effect) is kind), key=lambda c: -own[id(c)].unique)
        parts = [own[id(c)] for c in entered]
        part = OwnPart(max((x.unique for x in parts), default=0.0), max((x.new for x in parts), default=0.0))
        found = [refined(validator, c) for c in entered]
        best = found or _best_places([c for c in pool if type(c.effect) is kind], validator.criteria.smallest_error)
        effects.append(_joined(validator, best, part, tried, bool(entered)))
    level = validator.criteria.significance
    effects.sort(key=lambda e: (not e.entered, -e.own.new, -e.own.unique, e.p_value > level, -e.explained, -e.gain))
    return Ranking(_with_rivals(validator, effects), full, with_all(validator, others))


def _best_places(places: Sequence[ScoredCandidate], smallest_error: float) -> list[ScoredCandidate]:
    """The best place of an effect that did not enter, and further ones that pay for themselves."""
    ordered = sorted(places, key=lambda c: -c.gain)
    best = ordered[:1]
    if ordered[0].gain > 0 and not ordered[0].effect.single:
        best += [c for c in ordered[1:] if c.gain > 0 and c.explained > smallest_error**2]
    return best


def _joined(
    validator: CrossValidator, places: Sequence[ScoredCandidate], own: OwnPart, tried: int, entered: bool
) -> ScoredEffect:
    """All places of an effect as one candidate, or the best place alone where that has as much evidence."""
    together = places[0].candidate if len(places) == 1 else validator.joined([p.candidate for p in places])
    whole = places[0] if len(places) == 1 else scored(validator, [together])
    if whole is None or len(places) == 1 or whole.gain <= places[0].gain:
        places, whole = places[:1], places[0]
    steady = (
        whole.worth_its_name
        and whole.gain > 0
        and (entered or block_test(validator, whole.candidate) < validator.criteria.block_p_value)
    )
    return ScoredEffect(
        tuple(places),
        whole.candidate,
        whole.score,
        whole.gain,
        whole.explained,
        own,
        min(place.p_value(tried) for place in places) if steady else 1.0,
        entered,
    )


def _with_rivals(validator: CrossValidator, found: list[ScoredEffect]) -> list[ScoredEffect]:
    """Name the rivals of the first effect: those that explain nearly as much alone, and add nothing to it."""
    if not found or not found[0].entered:
        return found
    criteria, top = validator.criteria, found[0]
    given = validator.extended(top.together)
    rivals = []
    for other in found[1:]:
        if other.explained < criteria.rival_share * top.explained or other.gain <= 0:
            continue
        beside = scored(given, [other.together])
        if beside is None or beside.gain <= 0 or beside.explained < criteria.rival_addition * top.explained:
            rivals.append(other)
    simpler = [r for r in rivals if r.kind.id in top.kind.generalises]
    first = simpler[0] if simpler else top
    names = {top.kind.id, *(r.kind.id for r in rivals)} - {first.kind.id}
    result = [replace(first, rivals=tuple(sorted(names)), entered=True)]
    for e in found:
        if e is not first:
            alike = any(e is r for r in rivals) or (e is top and simpler)
            result.append(replace(e, rivals=(first.kind.id,)) if alike else e)
    return result
