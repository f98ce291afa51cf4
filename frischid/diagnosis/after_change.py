"""Effects of a robot that changed, each beside the old parameters that hold a part of it.

If a robot has not changed, all parameters of the model are fitted beside an effect, and the equation of an effect
relies on them. The angle at which a spring has no torque is in the torque offset, ks (q − q₀) = ks q + off. Presliding
friction, fh (z − sign q̇), is measured from the dry friction of the model. If the robot changed, offset and friction are
known from before the change. A new spring has a rest angle of its own, and new friction adds to the old one. So each
such effect is tried twice,

    τ = τ_before + C β     and     τ = τ_before + C β + Δoff,     τ = τ_before + C β + Δfv q̇ + Δfc sign(q̇),

and the folds left out decide between the two, less the price of the further parameters (`scored_candidate.scored`). If
one of these changes alone explains nearly as much, it is the simpler answer, and the effect is not tried beside it.

Source: Theil and Goldberger 1961, International Economic Review 2(1): a prior says what is known of a parameter, and of
these two nothing is known.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from frischid.diagnosis.candidate_columns import Candidate
from frischid.diagnosis.cross_validation import CrossValidator
from frischid.diagnosis.scored_candidate import scored, with_model_width
from frischid.effects import EFFECTS, Effect


def with_old_parameters(validator: CrossValidator, places: Sequence[Sequence[Candidate]]) -> list[list[Candidate]]:
    """Shapes of effects, and each shape again beside the changes of old parameters that come with the effect.

    Parameters
    ----------
    validator : CrossValidator
        Of a robot that changed.
    places : sequence of sequence of Candidate
        The shapes of one effect in one place each.
    """
    changes = [_changes(validator, shapes[0].effect) if shapes else () for shapes in places]
    every = list(dict.fromkeys(effect for beside in changes for effect in beside))
    found = dict(zip(every, validator.candidates(every), strict=True))
    pairs = [(shapes, [found[effect] for effect in beside]) for shapes, beside in zip(places, changes, strict=True)]
    wide = [_beside(validator, shapes, more) for shapes, more in pairs]
    return [[*shapes, *more] for shapes, more in zip(places, wide, strict=True)]


def _beside(validator: CrossValidator, shapes: Sequence[Candidate], more: Sequence[Candidate]) -> list[Candidate]:
    """Shapes beside some changes; none where one of the changes alone explains nearly as much."""
    if not more or not all(x.columns for x in more):
        return []
    beside = tuple(x.effect for x in more)
    wide = [replace(validator.joined([c, *more]), beside=beside) for c in shapes]
    best, alone = scored(validator, wide), [scored(validator, [x]) for x in more]
    known = max((x.explained for x in alone if x is not None), default=0.0)
    adds = best is not None and best.explained - known > validator.criteria.rival_addition * best.explained
    return wide if adds else []


def _changes(validator: CrossValidator, effect: Effect) -> tuple[Effect, ...]:
    """Changes of old parameters that come with an effect of single joints, but for those that the model has."""
    model = validator.model
    if effect.joints is None:
        return ()
    kinds = [EFFECTS[name] for name in type(effect).after_change if name in EFFECTS]
    found = [with_model_width(kind(joints=effect.joints), model.effects) for kind in kinds]
    present = {c.name for c in validator.data.cache.regressor.columns}
    return tuple(x for x in found if present.isdisjoint(c.name for c in x.columns(model.robot)))
