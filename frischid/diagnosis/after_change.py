"""Effects of a robot that changed, each beside the old parameters that hold a part of it.

If a robot has not changed, all parameters of the model are fitted beside an effect, and the equation of an effect
relies on them. The angle at which a spring has no torque is in the torque offset, ks (q − q₀) = ks q + off. Presliding
friction, fh (z − sign q̇), is measured from the dry friction of the model. If the robot changed, offset and friction are
known from before the change. A new spring has a rest angle of its own, and new friction adds to the old one. So each
such effect is tried twice,

    τ = τ_before + C β     and     τ = τ_before + C β + Δoff,     τ = τ_before + C β + Δfv q̇ + Δfc sign(q̇),

and the folds left out decide between the two, less the price of the further parameters (`scored_candidate.scored`). If
one of these changes alone explains nearly as much, it is the simpler answer, and the effect is not tried beside it. Nor
is the effect tried where both changes together predict as well as with the effect: two things changed.

Dry friction that changed in one direction only is in motion an offset and a dry friction that changed by the same size
at once: fca |sign q̇| + Δfc sign q̇ with Δfc = ±fca. So direction-dependent dry friction is tried beside a change of
friction. Where the model has an offset, the effect is tried only so, and only where one direction alone explains nearly
as much. Otherwise an offset changed, or friction, or both.

Where friction or rotor inertia of one joint changed, a motor that turns with two joints explains the change as well,
with a ratio near zero. So a coupling is tried only where it predicts better than such changes of each joint alone.

Source: Theil and Goldberger 1961, International Economic Review 2(1): a prior says what is known of a parameter, and of
these two nothing is known.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from frischid.core.array_store import Series
from frischid.diagnosis.candidate_columns import Candidate
from frischid.diagnosis.cross_validation import CrossValidator
from frischid.diagnosis.scored_candidate import known_in_motion, scored, with_model_width
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
    robot, present = validator.model.robot, {c.name for c in validator.data.cache.regressor.columns}
    changes = [_changes(validator, shapes[0].effect) if shapes else () for shapes in places]
    every = list(dict.fromkeys(effect for beside in changes for effect in beside))
    found = dict(zip(every, validator.candidates(every), strict=True))
    tried: list[list[Candidate]] = []
    for shapes, beside in zip(places, changes, strict=True):
        old = bool(shapes) and known_in_motion(shapes[0].effect, present, robot)
        if shapes and _each_joint_alone(validator, shapes):
            tried.append([])
            continue
        wide = _beside(validator, shapes, [found[effect] for effect in beside], old=old)
        tried.append(wide if old else [*shapes, *wide])
    return tried


def _beside(
    validator: CrossValidator, shapes: Sequence[Candidate], more: Sequence[Candidate], *, old: bool
) -> list[Candidate]:
    """Shapes beside some changes; none where one of the changes alone explains nearly as much.

    `old`: the effect alone is a change of an old parameter too, wherever the joint moves.
    """
    if not more or not all(x.columns for x in more):
        return []
    beside = tuple(x.effect for x in more)
    wide = [replace(validator.joined([c, *more]), beside=beside) for c in shapes]
    simpler = [[x] for x in more] + [list(shapes)] * old
    best, alone = scored(validator, wide), [scored(validator, x) for x in simpler]
    known = max((x.explained for x in alone if x is not None), default=0.0)
    if len(more) > 1 and best is not None:
        pair = validator.joined(more)
        simplest = scored(validator, [pair, best.candidate])
        if simplest is None or simplest.candidate is pair:
            return []
    least = 0.0 if best is None else validator.criteria.rival_addition * best.explained
    if best is None or best.explained - known <= least:
        return []
    if old:
        one = [scored(validator, [_in_one_direction(validator, best.candidate, sign)]) for sign in (1.0, -1.0)]
        return wide if best.explained - max((x.explained for x in one if x is not None), default=0.0) <= least else []
    return wide


def _each_joint_alone(validator: CrossValidator, shapes: Sequence[Candidate]) -> bool:
    """Whether other friction and rotor inertia of each joint alone predict as well as an effect that couples joints."""
    joints = shapes[0].effect.joints or ()
    if len(joints) < 2:
        return False
    own = [kind(joints=(name,)) for name in joints for kind in (EFFECTS["friction_change"], EFFECTS["rotor_inertia"])]
    columns = validator.candidates([with_model_width(effect, validator.model.effects) for effect in own])
    if not all(c.columns and c.finite for c in columns):
        return False
    alone = validator.joined(columns)
    best = scored(validator, [alone, *shapes])
    return best is not None and best.candidate is alone


def _in_one_direction(validator: CrossValidator, candidate: Candidate, sign: float) -> Candidate:
    """Dry friction that changed in one direction only, from its two columns: the first and the last of a candidate."""
    columns = {row: Series(validator.data.cache.store) for row in candidate.columns}
    for row, series in columns.items():
        for number in range(len(candidate.columns[row])):
            C = candidate.columns[row][number]
            series.append(C[:, :1] + sign * C[:, -1:])
    return Candidate(candidate.effect, columns, (0,))


def _changes(validator: CrossValidator, effect: Effect) -> tuple[Effect, ...]:
    """Changes of old parameters that come with an effect of single joints, but for those that the model has."""
    model = validator.model
    if effect.joints is None:
        return ()
    kinds = [EFFECTS[name] for name in type(effect).after_change if name in EFFECTS]
    found = [with_model_width(kind(joints=effect.joints), model.effects) for kind in kinds]
    present = {c.name for c in validator.data.cache.regressor.columns}
    return tuple(x for x in found if present.isdisjoint(c.name for c in x.columns(model.robot)))
