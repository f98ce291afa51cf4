"""Effects in order of the error that no other effect explains; all places of an effect count as one.

1.  Every effect in every place and shape is scored alone (`scored_candidate`).
2.  Candidates enter the model together (`stepwise_selection`).
3.  Places of one effect are joined. Effects that entered come first, in order of their part of the error that all of
    them explain. On new logs, only the part beyond the known residual counts: the residual on the training logs was
    there before. Effects that did not enter follow, in order of their own evidence.
4.  An effect that explains nearly as much as the first, and adds nothing beside the first, is a *rival*: these data
    cannot distinguish the two. The simpler of two rivals comes first, or the one with more gain after its price. An
    effect that the first contains is no rival where the first explains more over blocks of time, beside all others that
    entered: a hose contains a spring, and the friction in the hose is no part of a spring.
5.  An effect is named as confused with the first, too, where the first leaves no less error on its own joints than that
    effect does: a paired test over blocks of time (`block_test.less_error`).
    One that entered beside the first, at joints where the first explains less, is named at all places that it would
    have instead of the first.
6.  Where the first effect has one place, the other joints are named at which the same effect is a rival of the first.

So a hidden effect is found beside several small ones, and an effect that only resembles it ranks lower.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from frischid.diagnosis.after_change import with_old_parameters
from frischid.diagnosis.block_test import block_test, less_error
from frischid.diagnosis.candidate_columns import Candidate
from frischid.diagnosis.candidate_fits import Score
from frischid.diagnosis.cross_validation import CrossValidator
from frischid.diagnosis.scored_candidate import ScoredCandidate, Watcher, price, scored, usable_candidates
from frischid.diagnosis.shape_refinement import refined, with_refined_contenders
from frischid.diagnosis.stepwise_selection import OwnPart, excluded, own_parts, selected, with_all
from frischid.diagnosis.symmetric_shifts import without_smoothing
from frischid.effects import Effect

_Scored = TypeVar("_Scored", "ScoredEffect", ScoredCandidate)


@dataclass(frozen=True, eq=False)
class ScoredEffect:
    """An effect at all its places."""

    places: tuple[ScoredCandidate, ...]
    """Best first, each scored alone."""
    together: Candidate
    """All places at once."""
    score: Score
    """Of all places at once."""
    gain: float
    """Rise of the log likelihood less the price, with this effect alone."""
    explained: float
    """Fall of the summed squared NRMSE, with this effect alone."""
    own: OwnPart
    """Error that only this effect explains; zero unless it entered."""
    p_value: float
    entered: bool
    """Whether it is one of the effects that explain the data together."""
    rivals: tuple[str, ...] = ()
    """Effects that explain these data nearly as well."""
    elsewhere: tuple[str, ...] = ()
    """Joints on each of which the same effect instead explains these data nearly as well."""

    @property
    def kind(self) -> type[Effect]:
        """Class of the effect."""
        return type(self.together.effect)

    @property
    def contains(self) -> set[str]:
        """Effects that this one contains: those of its equation, and the changes of old parameters beside it."""
        return {*self.kind.generalises, *(type(e).id for place in self.places for e in place.candidate.beside)}


@dataclass(frozen=True, eq=False)
class Ranking:
    """Every effect that can act on this robot, scored."""

    effects: list[ScoredEffect]
    """In order."""
    full: CrossValidator
    without_first: CrossValidator
    """`full`, `without_first`: Of the model with all effects that entered, and with all of these but the first."""
    entered: tuple[Effect, ...] = ()
    """The effects that entered, place by place, in their order."""
    smoothing: tuple[ScoredCandidate, ...] = ()
    """Shifts in time that are no delays (`symmetric_shifts`); they are not among the effects."""


def ranking(
    validator: CrossValidator,
    kinds: Iterable[type[Effect]],
    progress: Callable[[str], None] = lambda _: None,
    *,
    changed: bool = False,
) -> Ranking:
    """Score every effect of some kinds that can act on this robot, and put them in order.

    `changed`: the robot changed, and the parameters of the model are those from before.
    """
    places = [alternatives for kind in kinds for alternatives in kind.candidates(validator.model.robot)]
    usable = usable_candidates(validator, places, progress, changed=changed)
    usable = with_old_parameters(validator, usable) if changed else usable
    validator.fits([c for shapes in usable for c in shapes])
    alone = (scored(validator, shapes) for shapes in usable if shapes)
    pool = [_told(validator, found, progress) for found in alone if found is not None]
    tried = len(pool)
    pool, smoothing = without_smoothing(validator, pool)
    progress("comparing candidates")
    pool = with_refined_contenders(validator, pool)
    chosen, full = selected(validator, pool, tried)
    own = dict(zip(map(id, chosen), own_parts(validator, chosen), strict=True))
    first = max(chosen, key=lambda c: (own[id(c)].new, own[id(c)].part), default=None)
    others = [c for c in chosen if first is not None and type(c.effect) is not type(first.effect)]
    effects = []
    for kind in dict.fromkeys(type(c.effect) for c in pool):
        entered = sorted((c for c in chosen if type(c.effect) is kind), key=lambda c: -own[id(c)].part)
        parts = [own[id(c)] for c in entered]
        part = OwnPart(*map(max, zip(*parts, strict=True))) if parts else OwnPart()
        found = [refined(validator, c) for c in entered]
        best = found or _best_places([c for c in pool if type(c.effect) is kind], validator.criteria.smallest_error)
        effects.append(_joined(validator, best, part, tried, bool(entered)))
    level = validator.criteria.significance
    effects.sort(key=lambda e: (not e.entered, -e.own.new, -e.own.part, e.p_value > level, -e.explained, -e.gain))
    every = tuple(effect for c in chosen for effect in c.candidate.effects)
    effects = _with_other_places(validator, _with_rivals(validator, _instead_of_first(validator, effects, pool)), pool)
    return Ranking(effects, full, with_all(validator, others), every, tuple(smoothing))


def _told(
    validator: CrossValidator, found: ScoredCandidate, progress: Callable[[str], None] | Watcher
) -> ScoredCandidate:
    """The same candidate, after a watcher has heard of it."""
    if isinstance(progress, Watcher):
        before, after = validator.predictive_nrmse().mean(), validator.nrmse(found.score.predictive).mean()
        progress.scored(found, float(after / before - 1.0) if before > 0 else 0.0)
    return found


def _best_places(places: Sequence[ScoredCandidate], smallest_error: float) -> list[ScoredCandidate]:
    """The best place of an effect that did not enter, and further ones that pay for themselves."""
    ordered = sorted(places, key=lambda c: -c.gain)
    best = ordered[:1]
    if ordered[0].gain > 0 and not ordered[0].effect.single:
        for c in ordered[1:]:
            if c.gain > 0 and c.explained > smallest_error**2 and not any(excluded(c, x) for x in best):
                best.append(c)
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


def _instead_of_first(
    validator: CrossValidator, found: list[ScoredEffect], pool: Sequence[ScoredCandidate]
) -> list[ScoredEffect]:
    """The effects; a rival that entered beside the first stands at the places that it would have instead of the first.

    What entered beside the first is the rest that the first left to it.
    """
    if not found or not found[0].entered:
        return found
    return [found[0], *(_instead_at(validator, found[0], e, pool) for e in found[1:])]


def _instead_at(
    validator: CrossValidator, top: ScoredEffect, other: ScoredEffect, pool: Sequence[ScoredCandidate]
) -> ScoredEffect:
    if not other.entered or other.kind.single:
        return other
    places = _best_places([c for c in pool if type(c.effect) is other.kind], validator.criteria.smallest_error)
    alone = replace(_joined(validator, places, other.own, 1, True), p_value=other.p_value)
    better = alone.gain > 0 and alone.explained > other.explained
    rival = better and (_instead(validator, top, [alone]) or _as_good(validator, top, alone))
    return alone if rival else other


def _as_good(validator: CrossValidator, top: ScoredEffect, other: ScoredEffect) -> bool:
    """Whether blocks of time cannot tell that the first effect explains the error of its joints better than another."""
    criteria = validator.criteria
    sure = other.gain > 0 and other.p_value <= criteria.significance
    return sure and less_error(validator, top.together, other.together) > criteria.block_p_value


def _with_rivals(validator: CrossValidator, found: list[ScoredEffect]) -> list[ScoredEffect]:
    """Name the rivals of the first effect: those that explain nearly as much alone, and nothing beside the first."""
    if not found or not found[0].entered:
        return found
    criteria, top = validator.criteria, found[0]
    rivals = [r for r in _instead(validator, top, found[1:]) if not _is_a_part(validator, r, top, found)]
    wider = [r for r in rivals if top.kind.id in r.contains]
    over = {r.kind.id: _over(validator, r, top) for r in rivals}
    sure = [r for r in rivals if over[r.kind.id] > 0 and r.p_value <= criteria.significance and r not in wider]
    simpler = [r for r in rivals if r.kind.id in top.contains] + sure
    first = max(simpler, key=lambda r: over[r.kind.id], default=top)
    names = {top.kind.id, *(r.kind.id for r in rivals)} - {first.kind.id}
    result = [replace(first, rivals=tuple(sorted(names)), entered=True, own=top.own)]
    for e in found:
        if e is top and simpler:  # the simpler effect takes its place; beside that one nothing is its own
            result.append(replace(e, rivals=(first.kind.id,), entered=False, own=OwnPart()))
        elif e is not first:
            result.append(replace(e, rivals=(first.kind.id,)) if any(e is r for r in rivals) else e)
    return _with_as_good(validator, result)


def _instead(validator: CrossValidator, top: ScoredEffect, others: Sequence[_Scored]) -> list[_Scored]:
    """Those of some effects that explain nearly as much as the first, and nothing beside the first."""
    criteria, found = validator.criteria, []
    near = [x for x in others if x.explained >= criteria.rival_share * top.explained and x.gain > 0]
    given = validator.extended(top.together) if near else validator
    for other in near:
        beside = scored(given, [other.together])
        if beside is None or beside.gain <= 0 or beside.explained < criteria.rival_addition * top.explained:
            found.append(other)
    return found


def _is_a_part(validator: CrossValidator, part: ScoredEffect, whole: ScoredEffect, found: list[ScoredEffect]) -> bool:
    """Whether an effect is only a part of another one, which explains more: by more than chance, and in most blocks."""
    if part.kind.id not in whole.contains:
        return False
    criteria = validator.criteria
    for other in found:  # a friction of its own is no part of a hose
        if other.entered and other is not whole and other is not part:
            validator = validator.extended(other.together)
    more, less = scored(validator, [whole.together]), scored(validator, [part.together])
    if more is None or less is None or more.explained - less.explained <= criteria.smallest_error**2:
        return False
    if _over(validator, more, less) <= 0:
        return False
    return less_error(validator, whole.together, part.together) <= criteria.block_p_value


def _with_other_places(
    validator: CrossValidator, found: list[ScoredEffect], pool: Sequence[ScoredCandidate]
) -> list[ScoredEffect]:
    """Name the other joints at which the first effect explains these data nearly as well, if it has one place."""
    if not found or not found[0].entered or len(found[0].places) > 1:
        return found
    top = found[0]
    others = [c for c in pool if type(c.effect) is top.kind and c.effect.joints != top.places[0].effect.joints]
    places = [c.effect.joints or () for c in _instead(validator, top, others)]
    alone = dict.fromkeys(joints[0] for joints in places if len(joints) == 1)  # a body comes small and large on a link
    return [replace(top, elsewhere=tuple(alone)), *found[1:]]


def _over(
    validator: CrossValidator, one: ScoredEffect | ScoredCandidate, other: ScoredEffect | ScoredCandidate
) -> float:
    """Log likelihood of one effect over that of another, less the difference of their prices.

    Both count the same independent samples. Their gains do not, because each gain takes the correlation of what its own
    effect leaves.
    """
    effective = np.maximum(validator.effective_with(one.together), validator.effective_with(other.together))
    ratio = validator.log_likelihood(other.score.predictive, one.score.predictive, effective)
    return ratio - price(validator, one.together) + price(validator, other.together)


def _with_as_good(validator: CrossValidator, found: list[ScoredEffect]) -> list[ScoredEffect]:
    """Name effects too that explain the error of the first one's joints as well, as far as blocks of time can tell.

    Such an effect may add something beside the first, and the model may need both. But the first has no better claim to
    its part of the error: on other logs of the same robot the order may be the reverse.
    """
    top = found[0]
    as_good = [e for e in found[1:] if _as_good(validator, top, e)]
    named = [e for e in found[1:] if e.kind.id in top.rivals or any(e is x for x in as_good)]
    names = tuple(e.kind.id for e in sorted(named, key=lambda e: -e.explained))
    others = [
        replace(e, rivals=(top.kind.id,)) if any(e is x for x in as_good) and not e.rivals else e for e in found[1:]
    ]
    return [replace(top, rivals=names), *others]
