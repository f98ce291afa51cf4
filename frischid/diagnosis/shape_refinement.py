"""Shape parameters between the values of an effect's grid: a compass search for the largest explained held-out error.

One shape parameter moves back or forth, the one whose move explains most, by ½ of the distance to the grid's next
value, then ¼, then ⅛, as long as the explained error grows.

Source: Kolda, Lewis and Torczon 2003, "Optimization by direct search", SIAM Review 45(3).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from frischid.diagnosis.after_change import with_old_parameters
from frischid.diagnosis.cross_validation import CrossValidator
from frischid.diagnosis.scored_candidate import ScoredCandidate, parameters_of, scored, usable_candidates
from frischid.effects import Effect

_FRACTIONS = (0.5, 0.25, 0.125)  # of the distance to the next value of a shape's grid
_MOVES = 4  # at most, of each fraction


def with_refined_contenders(validator: CrossValidator, pool: Sequence[ScoredCandidate]) -> list[ScoredCandidate]:
    """Refine the shapes of candidates that may be the best: a coarse grid must not decide between two effects."""
    criteria = validator.criteria
    likely = [c for c in pool if c.gain > 0 and _may_move(c.effect)]
    bar = criteria.contender_share * max((c.explained for c in pool if c.gain > 0), default=0.0)
    contenders = sorted((c for c in likely if c.explained > bar), key=lambda c: -c.explained)[: criteria.max_contenders]
    return [refined(validator, c) if any(c is x for x in contenders) else c for c in pool]


def refined(validator: CrossValidator, found: ScoredCandidate) -> ScoredCandidate:
    """The candidate with its shape parameters between the grid's values, where that explains more."""
    shapes = found.effect.shapes
    steps = {name: _step(values, float(found.effect.parameters[name])) for name, values in shapes.items()}
    for fraction in _FRACTIONS if any(steps.values()) else ():
        for _ in range(_MOVES):
            near = [
                moved for name, step in steps.items() if step for moved in _beside(found.effect, name, fraction * step)
            ]
            (candidates,) = usable_candidates(validator, [[x for x in near if x.searched]])
            if found.candidate.beside:
                (candidates,) = with_old_parameters(validator, [candidates])
            better = scored(validator, candidates) if candidates else None
            if better is None or better.explained <= found.explained or not _pays(validator, better, found):
                break
            found = better
    return found


def _may_move(effect: Effect) -> bool:
    """Whether a shape is searched, or another value of the shape would be, as that of a coupling with ratio 1."""
    return bool(effect.searched) or any(x.searched for x in effect.variants(effect.joints))


def _pays(validator: CrossValidator, better: ScoredCandidate, found: ScoredCandidate) -> bool:
    """Whether held-out data pay for a shape that has more parameters, as a ratio that is not 1."""
    if parameters_of(better.candidate) == parameters_of(found.candidate):
        return True
    best = scored(validator, [found.candidate, better.candidate])
    return best is not None and best.candidate is better.candidate


def _beside(effect: Effect, name: str, step: float) -> list[Effect]:
    """The effect with one shape parameter moved back and forth by a step, within the grid's range and on its side of 0.

    Beyond the grid's range a shape is no longer that of the effect: heat that flows off within a second is none.
    """
    now, grid = float(effect.parameters[name]), effect.shapes[name]
    moved = (_rounded(now - step), _rounded(now + step))
    kept = [x for x in moved if min(grid) <= x <= max(grid) and (x * now > 0 or now == 0 <= x)]
    shapes: list[dict[str, Any]] = [{name: x} for x in kept]
    return [replace(effect, **shape) for shape in shapes]


def _rounded(x: float) -> float:
    """Without the noise of double precision, which a user would read as a value (0.30000000000000004)."""
    return float(f"{x:.12g}")


def _step(values: Sequence[float], x: float) -> float:
    """Distance from a value to the nearest other value of the grid."""
    return min((abs(v - x) for v in values if abs(v - x) > 1e-9 * max(abs(v), 1.0)), default=0.0)
