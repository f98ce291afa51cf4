"""A shift in time that explains the error no better than the opposite shift is no delay: it smooths the torque.

The column of a delay d is C(d) = (τ(t − d) − τ(t))/d. To first order a delay and its opposite have the same column,
C(−d) = C(d). The two parts of the column,

    (C(d) + C(−d))/2 = (τ(t − d) − τ(t + d))/2d,        (C(d) − C(−d))/2 = (τ(t − d) − 2 τ(t) + τ(t + d))/2d,

are the time derivative of the torque and its second difference. A delay is the first part. If the second part explains
more, the model's torque needs smoothing: noise of the positions is in its accelerations, because the cut-off of the
filter is too high. No delay is named then.
"""

from __future__ import annotations

from collections.abc import Sequence

from frischid.diagnosis.cross_validation import CrossValidator
from frischid.diagnosis.scored_candidate import ScoredCandidate, scored


def without_smoothing(
    validator: CrossValidator, pool: Sequence[ScoredCandidate]
) -> tuple[list[ScoredCandidate], list[ScoredCandidate]]:
    """Part candidates that only smooth the torque from all others.

    Parameters
    ----------
    pool : sequence of ScoredCandidate
        Each scored alone.
    """
    smoothing = [c for c in pool if c.gain > 0 and _smooths(validator, c)]
    return [c for c in pool if not any(c is x for x in smoothing)], smoothing


def _smooths(validator: CrossValidator, found: ScoredCandidate) -> bool:
    """Whether the symmetric part of a shift explains more than the antisymmetric part."""
    reverse = found.effect.reverse
    if reverse is None:
        return False
    (opposite,) = validator.candidates([reverse])
    if not opposite.finite or opposite.columns.keys() != found.candidate.columns.keys():
        return False
    parts = (scored(validator, [validator.data.cache.halved(found.candidate, opposite, s)]) for s in (1.0, -1.0))
    shift, smooth = (0.0 if part is None else part.explained for part in parts)
    return smooth > shift
