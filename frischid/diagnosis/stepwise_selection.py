"""Candidates that explain the data together: forward selection, then an exchange of each.

A real robot has several small effects beside the large one. So candidates enter the model one after another. The
candidate that explains most, given those already in the model, enters next if it passes every test. Afterwards each
chosen candidate is replaced by another one where the other explains more. An effect's own part of the error is

    own_e = Σ_j NRMSE_j²(all but e) − Σ_j NRMSE_j²(all),

so an error that two effects explain equally well counts for neither of them.

Source: Chen, Billings and Luo 1989, "Orthogonal least squares methods and their application to non-linear system
identification", Int. J. Control 50(5).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from frischid.diagnosis.cross_validation import CrossValidator
from frischid.diagnosis.scored_candidate import ScoredCandidate, passes, scored


class OwnPart(NamedTuple):
    """Error that only one candidate explains, in summed squared NRMSE.

    ``unique`` is all of this error; ``new`` is its part beyond the residual that was known before. ``new`` is zero
    where no residual was known before.
    """

    unique: float
    new: float


class Selection(NamedTuple):
    """Candidates that explain the data together, and the cross-validator of the model with all of them."""

    chosen: list[ScoredCandidate]
    full: CrossValidator


def selected(validator: CrossValidator, pool: Sequence[ScoredCandidate], tried: int) -> Selection:
    """Let candidates enter one after another, then exchange each for a better one.

    Parameters
    ----------
    validator : CrossValidator
    pool : sequence of ScoredCandidate
        Each scored alone.
    tried : int
        Candidates that were tried in all.
    """
    rest = _most_promising(validator, pool)
    chosen: list[ScoredCandidate] = []
    now = validator
    while rest and len(chosen) < validator.criteria.max_entered:
        now.fits([c.candidate for c in rest])
        fresh = [(c, x) for c in rest if (x := scored(now, [c.candidate])) is not None and passes(now, x, tried)]
        if not fresh:
            break
        best = max(fresh, key=lambda pair: pair[1].explained)[0]
        rest = [c for c, _ in fresh if c is not best]
        extended = now.extended(best.candidate)
        if not _better(now, extended):
            continue  # under the new weights of the joints the candidate does harm
        chosen.append(best)
        rest = [c for c in rest if not excluded(c, best)]
        now = extended
    return _exchanged(validator, pool, chosen, now)


def _most_promising(validator: CrossValidator, pool: Sequence[ScoredCandidate]) -> list[ScoredCandidate]:
    return sorted((c for c in pool if c.gain > 0), key=lambda c: -c.explained)[: validator.criteria.max_pool]


def excluded(candidate: ScoredCandidate, chosen: ScoredCandidate) -> bool:
    """Whether a model cannot have a candidate beside a chosen one of the same kind.

    The kind acts in one place only, or both act on the same joints, so that their parameters have the same names.
    """
    one, other = candidate.effect, chosen.effect
    return type(one) is type(other) and (one.single or (one.joints == other.joints and not one.several))


def _exchanged(
    validator: CrossValidator, pool: Sequence[ScoredCandidate], chosen: list[ScoredCandidate], full: CrossValidator
) -> Selection:
    """Replace every chosen candidate, in turn and once, by another one where the other explains more."""
    if len(chosen) < 2:
        return Selection(chosen, full)
    likely = _most_promising(validator, pool)
    for k in range(len(chosen)):
        rest = [c for i, c in enumerate(chosen) if i != k]
        without = with_all(validator, rest)
        others = [c for c in likely if not any(c is x or excluded(c, x) for x in rest)]
        without.fits([c.candidate for c in others])
        found = [(c, x) for c in others if (x := scored(without, [c.candidate])) is not None]
        if not found:
            continue
        best = max(found, key=lambda pair: pair[1].explained)[0]
        if best is not chosen[k] and _better(full, extended := without.extended(best.candidate)):
            chosen[k], full = best, extended
    return Selection(chosen, full)


def _better(before: CrossValidator, after: CrossValidator) -> bool:
    """Whether the held-out error, summed over the joints and without what uncertain parameters cause, is smaller."""
    return before.explained(before.base_predictive(), after.base_predictive()) > 0


def with_all(validator: CrossValidator, chosen: Iterable[ScoredCandidate]) -> CrossValidator:
    """The cross-validator with some candidates taken into the model."""
    for c in chosen:
        validator = validator.extended(c.candidate)
    return validator


def own_part(
    validator: CrossValidator, chosen: Sequence[ScoredCandidate], one: ScoredCandidate, full: CrossValidator
) -> OwnPart:
    """Rise of the summed squared NRMSE when one of the chosen is taken away, and the part of it that is new."""
    without = with_all(validator, [c for c in chosen if c is not one])
    before, after = (e.predictive_nrmse() ** 2 for e in (without, full))
    unique = float((before - after).sum())
    known = validator.known_residual**2
    new = float((np.maximum(before, known) - np.maximum(after, known)).sum()) if known.any() else 0.0
    return OwnPart(unique, max(new, 0.0))
