"""Shapes for effects that a user names without a shape: the shape that a diagnosis would find.

Dry friction gets the friction smoothing of the model's own dry friction, as in a diagnosis.
"""

from __future__ import annotations

from collections.abc import Sequence

from frischid.core.text import listed
from frischid.diagnosis.after_change import with_old_parameters
from frischid.diagnosis.scored_candidate import scored, usable_candidates, with_model_width
from frischid.diagnosis.shape_refinement import refined
from frischid.diagnosis.situation import Situation, SituationOption, cross_validator
from frischid.effects import Effect
from frischid.effects.notation import states_shape
from frischid.errors import InputError
from frischid.logs.log import Log
from frischid.logs.recording import Recording
from frischid.model.model import Model


def searched(
    model: Model,
    effects: Sequence[Effect],
    text: str,
    logs: Sequence[Log | Recording],
    situation: SituationOption,
) -> tuple[Effect, ...]:
    """Find the best shape, joint by joint, of effects whose shape the user did not state, as `diagnose` finds it.

    Where the robot changed, the changes of old parameters that come with an effect are among the effects returned.

    Parameters
    ----------
    text : str
        The effects as the user wrote them, in the same order; one written with parentheses keeps its shape.
    situation : {"auto", "always", "changed"}

    Raises
    ------
    InputError
        An effect has no joint of this robot to act on, the model's own columns already span every effect, or the model
        was fitted to no torque on which an effect can act.
    """
    chosen: list[Effect] = []
    for effect, stated in zip(effects, states_shape(text), strict=True):
        if stated:
            chosen.append(effect)
            continue
        alternatives = _alternatives(effect, model)
        if effect.joints is None and not any(x.columns(model.robot) for shapes in alternatives for x in shapes):
            raise InputError(
                f"{effect}: on this robot, the effect acts on no joint; name its joints (frischid effects {effect.id})"
            )
        taken: Situation = "changed" if situation == "changed" else "always"
        alone = taken == "always" or not effect.after_change
        if alone and not effect.shapes and all(len(shapes) == 1 for shapes in alternatives):
            chosen.append(with_model_width(effect, model.effects))
            continue
        validator, _ = cross_validator(model, logs, taken)
        usable = usable_candidates(validator, alternatives, changed=taken == "changed")
        usable = usable if alone else with_old_parameters(validator, usable)
        best = [found for shapes in usable if shapes and (found := scored(validator, shapes)) is not None]
        chosen += [e for found in best for e in refined(validator, found).candidate.effects]
        if not (best or effect.shapes):
            chosen.append(effect)  # the refit says why it cannot be added
    unfitted = [n for effect in effects for n in effect.joints or () if n not in model.joints]
    if not chosen and unfitted:
        raise InputError(
            f"{text}: the model was not fitted to a torque of {listed(unfitted)}, so this effect cannot be "
            f"fitted there; it was fitted to those of {listed(model.joints)}"
        )
    if not chosen:
        raise InputError(f"{text}: on these logs the model's own columns span this effect; adding it changes nothing")
    return tuple(dict.fromkeys(chosen))


def _alternatives(effect: Effect, model: Model) -> list[list[Effect]]:
    """For each place that a diagnosis tries for an effect, all that it tries there: shapes, forms, ratios.

    An effect without joints has one place where it has one parameter for the whole robot, as a delay of all joints.
    """
    kind, places = type(effect), dict[tuple[str, ...] | None, list[Effect]]()
    for tried in (x for shapes in kind.candidates(model.robot) for x in shapes):
        places.setdefault(tried.joints, []).append(tried)
    if effect.joints is None and None in places:
        return [places[None]]
    names = {n for _, n, _ in effect.acts_on(model.robot) if effect.joints is not None or n in model.joints}
    found = [shapes for joints, shapes in places.items() if joints is not None and names.issuperset(joints)]
    return found or [[*kind.variants(effect.joints)]]
