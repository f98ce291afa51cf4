"""Candidates judged against each other, because a real robot hides more than one thing.

1.  Every effect in every place and shape is scored alone, on data it was not fitted to:

        Δ log L = ½ Σ_j n_j/ℓ_j · log(SSE_j before / SSE_j after)  −  ½ k log n

    with n_j/ℓ_j the *effectively independent* samples of joint j and k the parameters it costs.
2.  They enter together, the one that removes most first, as long as the best of the rest passes; then each that
    entered is held against every other in its place.
3.  What an effect is worth is what the error rises by when it alone is taken away again: what others can explain as
    well is not counted for it. The ranking is by that; on logs the model was not made from, first by how much of it
    was not missing on the model's own.

So a hidden effect is found beside a background of small ones, and what merely resembles it does not share its rank.
Source of step 2: Orthogonal least squares, Chen, Billings and Luo 1989, Int. J. Control 50(5).
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from frischid.core.types import Array
from frischid.diagnosis.candidate_columns import Projection
from frischid.diagnosis.cross_validation import Evidence, Score
from frischid.effects import Coulomb, Effect

TOGETHER = 6  # effects in one place each that may enter together
POOL = 40  # candidates that go on after the first round
CONTENDS, CONTENDERS = 0.5, 6  # share of what the best removes, and how many, in shapes finer than the grid's
REFINEMENTS = (0.5, 0.25, 0.125)  # of the way to the next value of a shape's grid
MOVES = 4  # of each of these lengths
WAYS = (0.0, -1.0, 1.0)  # nothing, back, forth
SIGNIFICANCE = 0.01
TRIFLE = 0.004  # of a joint's torque: what explains less is not worth a parameter, however significant
MOSTLY = 0.3  # share of what an effect explains that must be new for it to be what changed
STEADY = 0.05  # p value over blocks of time that a finding must reach, so that no single moment makes it
SAME = 0.9  # a rival that removes this share of what the best removes, and adds nothing to it, is the same finding


@dataclass(frozen=True, eq=False)
class Judged:
    """One effect in one place, in the shape that fits best.

    Attributes
    ----------
    projection : Projection
    score : Score
    ratio : float
        Log likelihood ratio on held-out data.
    price : float
        What its parameters cost.
    removed : float
        What it takes off the sum of the joints' squared held-out NRMSE.
    """

    projection: Projection
    score: Score
    ratio: float
    price: float
    removed: float

    @property
    def effect(self) -> Effect:
        """The effect, in its place and shape."""
        return self.projection.effect

    @property
    def gain(self) -> float:
        """Log likelihood it adds, less its price."""
        return self.ratio - self.price

    @property
    def costs(self) -> int:
        """Its parameters: coefficients and shapes."""
        return len(self.projection.signs) + len(self.effect.searched)

    def chance(self, tried: int) -> float:
        """P value of a likelihood ratio at least this large, corrected for what was tried (Bonferroni)."""
        if self.gain <= 0:
            return 1.0
        return min(1.0, tried * float(stats.chi2.sf(2 * self.ratio, self.costs)))


@dataclass(frozen=True, eq=False)
class Ranked:
    """An effect at all its places.

    Attributes
    ----------
    places : tuple of Judged
        The best first, each as it is alone.
    together : Projection
        All places at once.
    score : Score
        Of all places at once.
    gain, removed, unique : float
        Log likelihood less its price, what it takes off the summed squared NRMSE alone, and beside the others.
    new : float
        What it takes off, beside the others, of what was not missing before; zero where that is but a part of it.
    p_value : float
    entered : bool
        Whether it is one of those that explain the data together.
    rivals : tuple of str
        Effects that explain these data as well.
    """

    places: tuple[Judged, ...]
    together: Projection
    score: Score
    gain: float
    removed: float
    unique: float
    new: float
    p_value: float
    entered: bool
    rivals: tuple[str, ...] = ()

    @property
    def kind(self) -> type[Effect]:
        """The effect's class."""
        return type(self.together.effect)


@dataclass(frozen=True, eq=False)
class Ranking:
    """Every effect that can act on this robot, judged.

    Attributes
    ----------
    effects : list of Ranked
        The one that explains most first.
    full, without_first : Evidence
        With all that entered in the model, and with all but the first of them.
    """

    effects: list[Ranked]
    full: Evidence
    without_first: Evidence


def ranking(
    evidence: Evidence, kinds: Iterable[type[Effect]], progress: Callable[[str], None] = lambda _: None
) -> Ranking:
    """Every effect that can act on this robot, the one that explains most first."""
    places = [alternatives for kind in kinds for alternatives in kind.candidates(evidence.model.robot)]
    scored = (judged(evidence, shapes) for shapes in distinct(evidence, places, progress) if shapes)
    pool = [found for found in scored if found is not None]
    tried = len(pool)
    progress("judging candidates against each other")
    pool = _sharpened(evidence, pool)
    chosen, full = _together(evidence, pool, tried)
    unique = {id(c): _worth(evidence, chosen, c, full) for c in chosen}
    first = max(chosen, key=lambda c: unique[id(c)][::-1], default=None)
    others = [c for c in chosen if first is not None and type(c.effect) is not type(first.effect)]
    return Ranking(_ranked(evidence, pool, chosen, unique, tried), full, _extended(evidence, others))


def distinct(
    evidence: Evidence, places: Sequence[Sequence[Effect]], progress: Callable[[str], None] = lambda _: None
) -> list[list[Projection]]:
    """Projections of the shapes of candidates that are not in the model, whose columns have a row here.

    All of them at once, because each time the motions are gone through.
    """
    robot, measured = evidence.model.robot, evidence.data.channels
    present = {c.name for c in evidence.data.regressor.columns}

    def fresh(effect: Effect) -> bool:
        return measured.issuperset(effect.channels(robot)) and not any(
            column.name in present for column in effect.columns(robot)
        )

    dry = ([as_dry(effect, evidence.model.effects) for effect in alternatives] for alternatives in places)
    kept = evidence.screened([[effect for effect in alternatives if fresh(effect)] for alternatives in dry])
    found = iter(evidence.project([effect for effects in kept for effect in effects], progress))
    return [[p for p in itertools.islice(found, len(effects)) if p.columns and p.finite] for effects in kept]


def as_dry(effect: Effect, known: Sequence[Effect]) -> Effect:
    """The effect with the sign of the speed smoothed as the model's dry friction has it."""
    width = next((e.width for e in known if isinstance(e, Coulomb)), None)
    return effect if width is None else effect.with_sign_width(width)


def judged(evidence: Evidence, projections: Sequence[Projection]) -> Judged | None:
    """One candidate in its best shape, held against the evidence; None when the model's columns span it.

    Between shapes of as many columns the fit decides, between others the held-out data: while a slow effect is not in
    the model there seems to be hardly any evidence (see `Evidence.effective_with`), and a price for more columns would
    rule out all but the fewest.
    """
    widths = {len(p.signs) for p in projections}
    tried = (_judged(evidence, [p for p in projections if len(p.signs) == width]) for width in sorted(widths))
    found = [j for j in tried if j is not None]
    if len(found) < 2:
        return found[0] if found else None
    before, effective = evidence.base_sse(), np.max([evidence.effective_with(j.projection) for j in found], axis=0)
    return max(found, key=lambda j: evidence.log_likelihood(before, j.score.sse, effective) - j.price)


def _judged(evidence: Evidence, projections: Sequence[Projection]) -> Judged | None:
    scored = evidence.score(projections)
    if scored is None:
        return None
    score, projection = scored
    before = evidence.base_sse()
    effective = evidence.effective
    ratio = evidence.log_likelihood(before, score.sse, effective)
    if ratio > 0:
        ratio = evidence.log_likelihood(before, score.sse, evidence.effective_with(projection))
    rows = float(evidence.counts.sum(axis=0)[list(projection.columns)].sum())
    costs = len(projection.signs) + len(projection.effect.searched)
    price = 0.5 * costs * float(np.log(max(rows, 2.0)))
    return Judged(projection, score, ratio, price, removed(evidence, before, score.sse))


def removed(evidence: Evidence, before: Array, after: Array) -> float:
    """What is taken off the sum over joints of the squared held-out NRMSE."""
    return float((evidence.nrmse(before) ** 2 - evidence.nrmse(after) ** 2).sum())


# ---------------------------------------------------------------------- several at once


def _sharpened(evidence: Evidence, pool: Sequence[Judged]) -> list[Judged]:
    """Those that may be the best in the shapes that fit best: a coarse grid must not decide between two effects."""
    likely = [c for c in pool if c.gain > 0 and c.effect.searched]
    bar = CONTENDS * max((c.removed for c in pool if c.gain > 0), default=0.0)
    contenders = sorted((c for c in likely if c.removed > bar), key=lambda c: -c.removed)[:CONTENDERS]
    return [refined(evidence, c) if any(c is x for x in contenders) else c for c in pool]


def _together(evidence: Evidence, pool: Sequence[Judged], tried: int) -> tuple[list[Judged], Evidence]:
    """Candidates that explain the data together, and the evidence with all of them in the model."""
    rest = sorted((c for c in pool if c.gain > 0), key=lambda c: -c.removed)[:POOL]
    chosen: list[Judged] = []
    now = evidence
    while rest and len(chosen) < TOGETHER:
        fresh = [(c, j) for c in rest if (j := judged(now, [c.projection])) is not None and _passes(now, j, tried)]
        if not fresh:
            break
        best = max(fresh, key=lambda pair: pair[1].removed)[0]
        rest = [c for c, _ in fresh if c is not best]
        extended = now.extended(best.projection)
        if not _better(now, extended):
            continue  # once joints are weighed anew it does harm
        chosen.append(best)
        rest = [c for c in rest if not _excluded(c, best)]
        now = extended
    return _exchanged(evidence, pool, chosen, now)


def _passes(evidence: Evidence, candidate: Judged, tried: int) -> bool:
    if candidate.removed < TRIFLE**2 or candidate.chance(tried) > SIGNIFICANCE:
        return False
    if np.abs(candidate.score.beta).max() < type(candidate.effect).least:
        return False
    return block_test(evidence, candidate.projection) < STEADY


def _excluded(candidate: Judged, chosen: Judged) -> bool:
    """An effect that acts in one place only is not looked for in another."""
    return type(candidate.effect) is type(chosen.effect) and candidate.effect.single


def _exchanged(
    evidence: Evidence, pool: Sequence[Judged], chosen: list[Judged], full: Evidence
) -> tuple[list[Judged], Evidence]:
    """Hold every chosen candidate against all others in its place, once round."""
    if len(chosen) < 2:
        return chosen, full
    likely = sorted((c for c in pool if c.gain > 0), key=lambda c: -c.removed)[:POOL]
    for k in range(len(chosen)):
        rest = [c for i, c in enumerate(chosen) if i != k]
        without = _extended(evidence, rest)
        others = [c for c in likely if not any(c is x or _excluded(c, x) for x in rest)]
        scored = [(c, j) for c in others if (j := judged(without, [c.projection])) is not None]
        if not scored:
            continue
        best = max(scored, key=lambda pair: pair[1].removed)[0]
        if best is not chosen[k] and _better(full, extended := without.extended(best.projection)):
            chosen[k], full = best, extended
    return chosen, full


def _better(before: Evidence, after: Evidence) -> bool:
    """Whether the held-out error is smaller in all."""
    return removed(before, before.base_sse(), after.base_sse()) > 0


def _extended(evidence: Evidence, chosen: Iterable[Judged]) -> Evidence:
    for c in chosen:
        evidence = evidence.extended(c.projection)
    return evidence


def _worth(evidence: Evidence, chosen: Sequence[Judged], one: Judged, full: Evidence) -> tuple[float, float]:
    """What the summed squared NRMSE rises by when one of those chosen is taken away; and how much of that is new."""
    without = _extended(evidence, [c for c in chosen if c is not one])
    before, after = (evidence.nrmse(e.base_sse()) ** 2 for e in (without, full))
    unique = float((before - after).sum())
    known = evidence.missed**2
    new = float((np.maximum(before, known) - np.maximum(after, known)).sum()) if known.any() else 0.0
    return unique, new if new > MOSTLY * unique else 0.0


# ---------------------------------------------------------------------- effects


def _ranked(
    evidence: Evidence,
    pool: Sequence[Judged],
    chosen: Sequence[Judged],
    unique: dict[int, tuple[float, float]],
    tried: int,
) -> list[Ranked]:
    """Gather places into effects and put them in order: those that entered, by their worth; then the others."""
    found = []
    for kind in dict.fromkeys(type(c.effect) for c in pool):
        entered = sorted((c for c in chosen if type(c.effect) is kind), key=lambda c: -unique[id(c)][0])
        worths = [unique[id(c)] for c in entered]
        worth = max((x for x, _ in worths), default=0.0), max((x for _, x in worths), default=0.0)
        places = [refined(evidence, c) for c in entered] or _best_places(
            evidence, [c for c in pool if type(c.effect) is kind]
        )
        found.append(_joined(evidence, places, worth, tried, bool(entered)))
    found.sort(key=lambda r: (not r.entered, -r.new, -r.unique, r.p_value > SIGNIFICANCE, -r.removed, -r.gain))
    return _told_apart(evidence, found)


def refined(evidence: Evidence, candidate: Judged) -> Judged:
    """The candidate with its shape parameters between the grid's values, where that fits better: a pattern search."""
    kind = type(candidate.effect)
    shapes = candidate.effect.searched
    steps = {name: _step(values, float(candidate.effect.parameters[name])) for name, values in shapes.items()}
    for share in REFINEMENTS if steps else ():
        for _ in range(MOVES):
            now = candidate.effect
            values = {n: [float(now.parameters[n]) + way * share * step for way in WAYS] for n, step in steps.items()}
            near = [
                kind(joints=now.joints, **now.parameters | dict(zip(values, chosen, strict=True)))
                for chosen in itertools.product(*values.values())
                if all(_same_side(x, float(now.parameters[n])) for n, x in zip(values, chosen, strict=True))
            ]
            (projections,) = distinct(evidence, [near])
            better = judged(evidence, projections) if projections else None
            if better is None or better.removed <= candidate.removed:
                break
            candidate = better
    return candidate


def _same_side(x: float, now: float) -> bool:
    """Whether a shape parameter may go from one value to another: not through zero, and from zero upwards."""
    return x * now > 0 or now == 0 <= x


def _step(values: Sequence[float], x: float) -> float:
    """Distance from a value to the nearest other value of the grid."""
    return min((abs(v - x) for v in values if abs(v - x) > 1e-9 * max(abs(v), 1.0)), default=0.0)


def _best_places(evidence: Evidence, places: Sequence[Judged]) -> list[Judged]:
    """The best place of an effect, and further ones while each pays for itself."""
    ordered = sorted(places, key=lambda c: -c.gain)
    best = ordered[:1]
    if ordered[0].gain > 0 and not ordered[0].effect.single:
        best += [c for c in ordered[1:] if c.gain > 0 and c.removed > TRIFLE**2]
    return best


def _joined(
    evidence: Evidence, places: Sequence[Judged], worth: tuple[float, float], tried: int, entered: bool
) -> Ranked:
    """All places of an effect as one candidate."""
    together = places[0].projection if len(places) == 1 else evidence.joined([p.projection for p in places])
    whole = places[0] if len(places) == 1 else judged(evidence, [together])
    if whole is None or len(places) == 1 or whole.gain <= places[0].gain:
        places, whole = places[:1], places[0]
    worthy = np.abs(whole.score.beta).max(initial=0.0) >= type(whole.effect).least
    steady = worthy and whole.gain > 0 and (entered or block_test(evidence, whole.projection) < STEADY)
    return Ranked(
        tuple(places),
        whole.projection,
        whole.score,
        whole.gain,
        whole.removed,
        *worth,
        min(place.chance(tried) for place in places) if steady else 1.0,
        entered,
    )


def _told_apart(evidence: Evidence, found: list[Ranked]) -> list[Ranked]:
    """Name the rivals of the best: those that remove nearly as much alone, and add nothing to it."""
    if not found or not found[0].entered:
        return found
    top, given = found[0], evidence.extended(found[0].together)
    rivals = []
    for other in found[1:]:
        if other.removed < SAME * top.removed or other.gain <= 0:
            continue
        after = judged(given, [other.together])
        if after is None or after.gain <= 0 or after.removed < 0.1 * top.removed:
            rivals.append(other)
    names = {type(r.together.effect).id for r in rivals}
    simpler = [r for r in rivals if r.kind.id in top.kind.generalises]
    first = simpler[0] if simpler else top
    rest = [r for r in found if r is not first]
    names |= {top.kind.id}
    result = [replace(first, rivals=tuple(sorted(names - {first.kind.id})), entered=True)]
    for r in rest:
        result.append(replace(r, rivals=(first.kind.id,)) if r in rivals or (r is top and simpler) else r)
    return result


def block_test(evidence: Evidence, projection: Projection) -> float:
    """P value over blocks of time that the held-out squared error is smaller: paired, one-sided.

    The smaller of Student's t and Wilcoxon's signed ranks: an effect may act in some of the blocks only, where the mean
    tells, or in all of them while one moment goes wrong for other reasons, where the ranks do.
    """
    g = evidence.block_gains(projection)
    if g is None or len(g) < 3 or not g.std() > 0:
        return 1.0
    t = float(stats.t.sf(g.mean() / (g.std(ddof=1) / np.sqrt(len(g))), len(g) - 1))
    return min(t, float(stats.wilcoxon(g, alternative="greater").pvalue))
