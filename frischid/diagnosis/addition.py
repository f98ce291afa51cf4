"""One step from a model to a better one: add effects, fit again, measure the error before and after; or take it back.

The model with the effects e is

    τ = Y θ + Σ_e C_e θ_e,

and is refitted as a whole. It keeps in its history the error before and after, the finding that proposed the effect,
and the model before.

The logs given fit the parameters. Logs given as ``valid`` only test: their error is stated, and decides nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from frischid.core.text import listed
from frischid.core.threads import on_one_thread
from frischid.diagnosis.criteria import DIAGNOSIS_CRITERIA, DiagnosisCriteria
from frischid.diagnosis.findings import Finding
from frischid.diagnosis.refit import Refit, check_formulas, known_error, refitted
from frischid.diagnosis.roles import decided_situation
from frischid.diagnosis.scored_candidate import as_a_change, has_names
from frischid.diagnosis.situation import Situation, SituationOption, check_situation
from frischid.diagnosis.step import Step
from frischid.effects import Effect, check_effects, columns_of
from frischid.errors import InputError
from frischid.logs.given import Logs, as_logs
from frischid.logs.log import Log
from frischid.logs.mapping import MappingLike
from frischid.logs.recording import Recording, check_logs
from frischid.model.comparison import compare
from frischid.model.events import cross_validated_nrmse
from frischid.model.headline import Headline
from frischid.model.log_requirements import check_effects_act
from frischid.model.model import Model
from frischid.model.model_argument import check_model
from frischid.model.own_logs import fitted_entry, log_entry


@on_one_thread
def add(
    model: Model,
    effects: Sequence[Effect],
    logs: Logs,
    *,
    valid: Logs = (),
    situation: SituationOption = "auto",
    finding: Finding | None = None,
    criteria: DiagnosisCriteria = DIAGNOSIS_CRITERIA,
    mapping: MappingLike = None,
    progress: Callable[[str], None] = lambda _: None,
) -> Step:
    """Add effects to a model and refit it.

    Parameters
    ----------
    model : Model
    effects : sequence of Effect
        Effects to add. Where the robot changed, one that the model has is added as a change of itself (friction and
        offset as `friction_change` and `offset_change`, which name themselves).
    logs : sequence of Log, Recording or data frame, or one data frame
        Data to fit; the error is cross-validated on them.
    valid : sequence of Log, Recording or data frame, or one data frame
        Test logs: their error is stated, and nothing else uses them.
    situation : {"auto", "always", "changed"}
        ``"auto"`` is decided as by `diagnose`, and as by ``frischid add``. ``"always"``: all parameters are fitted
        again. ``"changed"``: the model's own parameters are kept as a prior, so that the change ends up in the effect.
    finding : Finding, optional
        The finding that proposed the effects, for the model's history.
    criteria : DiagnosisCriteria, optional
        Thresholds that decide the situation.
    mapping : LogMap, mapping or path of a TOML file, optional
        Names and units of the columns of data frames.
    progress : callable, optional
        Called with a short text before each stage.

    Returns
    -------
    Step

    Raises
    ------
    InputError
        There is no effect or no log, a log is given both to fit and to test, or lacks a joint or its torque, or two
        effects have the same columns.
    UnknownNameError
        There is no such situation.

    Examples
    --------
    >>> import frischid as fr
    >>> robot, spring = fr.Robot.load("planar2"), fr.parse_effects("joint_spring@joint2")
    >>> log = fr.simulate(robot, fr.random_fourier(robot, 8, seed=1), rate=50, effects=(*fr.BASELINE, *spring),
    ...                   parameters={"ks2": 1.5}, noise=fr.Noise(q=1e-5, tau=0.01))
    >>> model = fr.identify(robot, [log], recursion="none").model
    >>> step = fr.add(model, spring, [log])
    >>> step.error_after < 0.2 * step.error_before
    True
    >>> step.measured_on
    'cross-validated on the fitted logs'
    """
    check_model(model)
    logs, valid = as_logs(logs, model.robot.joints, mapping), as_logs(valid, model.robot.joints, mapping, "valid")
    check_logs(logs, valid)
    model.check([*logs, *valid])
    check_situation(situation)
    check_effects(effects)
    if not effects:
        raise InputError("there is no effect to add; give at least one: frischid.parse_effects('viscous@joint1')")
    if not logs:
        raise InputError("there is no log to fit; give at least one")
    check_effects_act(model.robot, model.joints, effects)
    if situation == "auto":
        progress("what changed since the model was identified (1 of 3)")
        situation = decided_situation(model, logs, criteria=criteria, valid=valid).situation
    effects = in_place(model, effects, situation)
    check_formulas(model, effects)
    progress("fitting with the effect (2 of 3)")
    step = trial(model, effects, logs, situation, finding, criteria).step()
    progress("the error before and after (3 of 3)")
    return tested(model, step, valid)


def in_place(model: Model, effects: Sequence[Effect], situation: Situation) -> list[Effect]:
    """Effects as they can be added: where the robot changed, one that the model has becomes a change of itself.

    An effect on all joints of which the model has some becomes one for each joint.

    Raises
    ------
    InputError
        A change of an effect where nothing changed.
    """
    present = {column.name for column in columns_of(model.robot, model.effects)}
    if situation == "always":
        if any(effect.changed and has_names(replace(effect, changed=0), present, model.robot) for effect in effects):
            raise InputError(
                f"{listed([str(e) for e in effects if e.changed])} describes a change of the robot, and the robot is "
                "assumed not to have changed (--situation changed)"
            )
        return [replace(effect, changed=0) for effect in effects]
    found: list[Effect] = []
    for effect in effects:
        alone = [effect]
        if effect.joints is None and type(effect).candidate == "joint":
            each = [replace(effect, joints=(name,)) for _, name, _ in effect.acts_on(model.robot)]
            known = [has_names(replace(one, changed=0), present, model.robot) for one in each]
            alone = each if any(known) and not all(known) else alone
        found += [as_a_change(one, present, model.robot) for one in alone]
    return found


def undo(model: Model) -> Model:
    """Return the model before its last step."""
    if model.previous is None:
        raise InputError("there is no step to undo: no effect was added to this model since it was identified")
    return model.previous


@dataclass(frozen=True, eq=False)
class Trial:
    """A refit of a model with some effects, before anybody accepts it."""

    model: Model
    """Without the effects."""
    effects: tuple[Effect, ...]
    logs: Sequence[Log | Recording]
    """The logs that fit."""
    situation: Situation
    finding: Finding | None
    """The finding that proposed the effects."""
    refit: Refit
    """With the effects."""
    error_before: float
    error_after: float
    """`error_before`, `error_after`: NRMSE on the logs that select."""

    def step(self) -> Step:
        """The step that accepts the trial; the model's history tells of it."""
        new, changed = self.refit.complete(), self.situation == "changed"
        how = "on the fitted logs, with the models before and after the step"
        measured_on = how if changed else "cross-validated on the fitted logs"
        event: dict[str, Any] = {
            "action": "add",
            "effects": [str(e) for e in self.effects],
            "situation": self.situation,
            "error_before": self.error_before,
            "measured_on": measured_on,
            "sentence": "" if self.finding is None else self.finding.sentence,
            "logs": [fitted_entry(log) for log in self.logs],
        }
        own = {k: v for k, v in new.history[-1].items() if k == "cross_validated"}
        # A cross-validated error is the error after the step, unless the models were compared in another way.
        stated = None if changed else cross_validated_nrmse(new.history)
        event |= own if stated is not None else {"error_after": self.error_after, **own}
        after = self.error_after if stated is None else stated  # they differ by rounding
        new = replace(new, history=(*self.model.history, event), previous=self.model)
        return Step(new, self.effects[0], self.error_before, after, measured_on, self.finding)


def trial(
    model: Model,
    effects: Sequence[Effect],
    logs: Sequence[Log | Recording],
    situation: Situation,
    finding: Finding | None,
    criteria: DiagnosisCriteria,
) -> Trial:
    """Refit with some effects, and measure the error before and after on the logs that select.

    Parameters
    ----------
    effects : sequence of Effect
        Effects to add.
    logs : sequence of Log or Recording
        The logs that fit.
    situation : {"always", "changed"}
    finding : Finding, optional
        The finding that proposed the effects.

    Raises
    ------
    InputError
        Two effects have the same columns.
    """
    together = (*model.effects, *effects)
    columns_of(model.robot, together)  # refuses two effects with the same columns before any work
    new = refitted(model, together, logs, situation, criteria)
    if situation == "changed":
        before, after = (compare(m, logs).nrmse for m in (model, new.model))
    else:
        known, after = known_error(model, logs), new.error
        before = refitted(model, model.effects, logs, situation, criteria).error if known is None else known
    return Trial(model, tuple(effects), logs, situation, finding, new, before, after)


def tested(before: Model, step: Step, valid: Sequence[Log | Recording]) -> Step:
    """The step with its error on the test logs, also in the model's history.

    Parameters
    ----------
    before : Model
        The model before the step.
    valid : sequence of Log or Recording
        Test logs; without any, the step is returned as given.
    """
    if not valid:
        return step
    tests = [Headline.of(compare(m, valid), "test") for m in (before, step.model)]
    errors = [test.nrmse for test in tests]
    *earlier, event = step.model.history
    event = {
        **event,
        "test_before": errors[0],
        "test": tests[1].to_dict(),
        "test_logs": [log_entry(log) for log in valid],
    }
    model = replace(step.model, history=(*earlier, event))
    return replace(step, model=model, test_before=errors[0], test_after=errors[1])
