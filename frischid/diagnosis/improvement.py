"""Better models, step by step: add an effect, refit, and keep the history.

Every step is a model of its own,

    τ = Y θ + Σ_{e added so far} C_e θ_e,

refitted as a whole. It keeps the error before and after, and the finding that proposed the effect, and can be undone.
The search is greedy forward selection: after each addition the residual is diagnosed again.

The logs given fit the parameters and select the effects, by cross-validation. Logs given as ``valid`` only test: their
error is stated after everything is decided.

Source: Chen, Billings and Luo 1989, Int. J. Control 50(5).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from frischid.diagnosis.criteria import DIAGNOSIS_CRITERIA, DiagnosisCriteria
from frischid.diagnosis.diagnosis import Diagnosis, diagnose
from frischid.diagnosis.findings import Finding
from frischid.diagnosis.refit import check_formulas, fitted_error, known_error, refitted
from frischid.diagnosis.roles import always_missing, decided_situation, logs_before_change
from frischid.diagnosis.situation import Situation, SituationOption
from frischid.diagnosis.step import Refusal, Step
from frischid.diagnosis.step_acceptance import RISES_AT_STANDSTILL, reason_against, reason_against_refit
from frischid.effects import EFFECTS, Effect, check_effects, columns_of
from frischid.errors import InputError
from frischid.logs.given import Logs, as_logs
from frischid.logs.log import Log
from frischid.logs.mapping import MappingLike
from frischid.logs.recording import Recording, check_logs
from frischid.model.comparison import compare
from frischid.model.headline import Headline, headline
from frischid.model.log_requirements import check_effects_act
from frischid.model.model import Model
from frischid.model.own_logs import fitted_entry, log_entry


def add(
    model: Model,
    effects: Sequence[Effect],
    logs: Logs,
    *,
    valid: Logs = (),
    situation: SituationOption = "always",
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
        Effects to add.
    logs : sequence of Log, Recording or data frame, or one data frame
        Data to fit; the error is cross-validated on them.
    valid : sequence of Log, Recording or data frame, or one data frame
        Test logs: their error is stated, and nothing else uses them.
    situation : {"auto", "always", "changed"}
        ``"auto"`` is decided as by `diagnose`. ``"always"``: all parameters are fitted again. ``"changed"``: the
        model's own parameters are kept as a prior, so that the change ends up in the effect.
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
        A log is given both to fit and to test, or lacks a joint or its torque, or two effects have the same columns.

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
    logs, valid = as_logs(logs, model.robot.joints, mapping), as_logs(valid, model.robot.joints, mapping, "valid")
    check_logs(logs, valid)
    model.check([*logs, *valid])
    check_effects(effects)
    check_effects_act(model.robot, model.joints, effects)
    check_formulas(model, effects)
    if situation == "auto":
        progress("what changed since the model was identified (1 of 3)")
        situation = decided_situation(model, logs, criteria=criteria, valid=valid).situation
    progress("fitting with the effect (2 of 3)")
    step = _step(model, effects, logs, situation, finding, criteria)
    progress("the error before and after (3 of 3)")
    return _tested(model, step, valid)


def improve(
    model: Model,
    logs: Logs,
    *,
    valid: Logs = (),
    situation: SituationOption = "auto",
    max_steps: int = 8,
    effects: Sequence[str] | None = None,
    criteria: DiagnosisCriteria = DIAGNOSIS_CRITERIA,
    progress: Callable[[str], None] = lambda _: None,
    mapping: MappingLike = None,
) -> tuple[list[Step], Diagnosis]:
    """Diagnose and add an effect, again and again, until no effect passes; a step that does harm is refused.

    A step stays only under these conditions, all on the logs that select (`frischid.diagnosis.step_acceptance`):

    - the cross-validated error falls, tested over blocks of time, on the joints the effect acts on;
    - no joint becomes significantly worse;
    - the mean log ratio of the joints' errors falls, so that one noisy joint cannot make up for harm to the others;
    - this ratio does not rise significantly when samples at standstill count too;
    - the mean NRMSE falls;
    - no coefficient has an impossible sign;
    - the friction of each joint brakes on the logs' motion at twice its speed.

    Effects are ranked beside each other, so a refused one may hide others: where all findings are refused, the
    diagnosis is made once more without the refused effects. The last diagnosis notes each refused step and the reason.

    A robot that changed lacks two kinds of effects: those that were always missing, and the change. Where the model's
    own logs are found, the first kind is added first, by these logs.

    Parameters
    ----------
    model : Model
    logs : sequence of Log, Recording or data frame, or one data frame
        Data that fit the parameters and select the effects.
    valid : sequence of Log, Recording or data frame, or one data frame
        Test logs: their error is stated for each step, and nothing else uses them.
    situation : {"auto", "always", "changed"}
        As in `diagnose`; decided once, for all steps.
    max_steps : int
        Most effects to add; of a robot that changed, beside those that its own logs show. With 0, nothing is added.
    effects : sequence of str, optional
        Identifiers to try, the whole catalogue by default.
    criteria : DiagnosisCriteria, optional
        Every threshold that decides the diagnoses and the steps.
    progress : callable
        Called with a few words at each stage.
    mapping : LogMap, mapping or path of a TOML file, optional
        Names and units of the columns of data frames.

    Returns
    -------
    steps : list of Step
    last : Diagnosis
        The diagnosis after the last step, with the criteria that were used.

    Raises
    ------
    InputError
        As in `diagnose`.

    Examples
    --------
    >>> import frischid as fr
    >>> robot = fr.Robot.load("planar2")
    >>> log = fr.simulate(robot, fr.random_fourier(robot, 8, seed=1), rate=50, noise=fr.Noise(q=1e-5, tau=0.01))
    >>> model = fr.identify(robot, [log], recursion="none").model
    >>> steps, last = fr.improve(model, [log], max_steps=2)
    >>> len(steps), last.verdict
    (0, 'none')
    """
    logs, valid = as_logs(logs, model.robot.joints, mapping), as_logs(valid, model.robot.joints, mapping, "valid")
    steps: list[Step] = []
    refused: dict[str, Refusal] = {}
    if not logs:
        raise InputError("there is no log to diagnose; give at least one")
    check_logs(logs, valid)
    model.check([*logs, *valid])
    progress("reading logs")
    situation, found, _ = decided_situation(model, logs, situation, criteria, valid=valid)
    if situation == "changed" and found is not None and max_steps:
        steps = _before_change(model, found, valid, effects, criteria, progress)
        model = steps[-1].model if steps else model
    most = len(steps) + max_steps
    while True:
        progress(f"diagnosis {len(steps) + 1}")
        before = len(refused)
        diagnosis = diagnose(model, logs, situation=situation, effects=effects, criteria=criteria, progress=progress)
        step = next_step(model, diagnosis, logs, refused) if len(steps) < most else None
        while step is None and len(refused) > before:  # the findings were ranked beside those that are refused now
            before = len(refused)
            others = [name for name in (EFFECTS if effects is None else effects) if name not in refused]
            again = diagnose(model, logs, situation=situation, effects=others, criteria=criteria, progress=progress)
            step = next_step(model, again, logs, refused)
        if step is None:
            notes = [f"{refusal.finding.title} was not added: {refusal.reason}" for refusal in refused.values()]
            if valid:
                diagnosis = replace(diagnosis, headline=headline(model, valid))
            return steps, replace(diagnosis, notes=(*diagnosis.notes, *notes))
        steps.append(_tested(model, step, valid))
        model = steps[-1].model


def _before_change(
    model: Model,
    found: Diagnosis,
    valid: Sequence[Log | Recording],
    effects: Sequence[str] | None,
    criteria: DiagnosisCriteria,
    progress: Callable[[str], None],
) -> list[Step]:
    """Steps that add, by the model's own logs, the effects that were missing before a change of the robot."""
    shown = [f for f in always_missing(found) if effects is None or f.effect in effects]
    if not shown:
        return []
    progress("effects that were missing before the change")
    return improve(
        model,
        logs_before_change(model, valid),
        valid=valid,
        situation="always",
        max_steps=len(shown),
        effects=effects,
        criteria=criteria,
        progress=progress,
    )[0]


def next_step(
    model: Model, diagnosis: Diagnosis, logs: Sequence[Log | Recording], refused: dict[str, Refusal]
) -> Step | None:
    """The step that `improve` takes after a diagnosis: that of the first finding that is accepted.

    Parameters
    ----------
    model : Model
    diagnosis : Diagnosis
        Of this model on these logs.
    logs : sequence of Log or Recording
        The logs that select.
    refused : dict of str to Refusal
        By effect: findings that are not tried again. Those refused here are added.

    Returns
    -------
    Step or None
        None where no finding is accepted.
    """
    for finding in diagnosis.findings:
        if not (finding.pays and finding.members) or finding.effect in refused:
            continue
        step, reason = _step_with(model, diagnosis, finding, finding.members, logs)
        if step is None and reason == RISES_AT_STANDSTILL:
            step = _harmless_shape(model, diagnosis, finding, logs)
        if step is not None:
            return step
        refused[finding.effect] = Refusal(finding, reason)
    return None


def _step_with(
    model: Model, diagnosis: Diagnosis, finding: Finding, members: tuple[Effect, ...], logs: Sequence[Log | Recording]
) -> tuple[Step | None, str]:
    """The step of a finding with these effects; None where it may not stay, and why."""
    reason = reason_against(diagnosis.validator, members)
    if reason:
        return None, reason
    step = _step(model, members, logs, diagnosis.situation, finding, diagnosis.criteria)
    reason = "the error of the model does not fall after the refit" if step.error_after >= step.error_before else ""
    reason = reason or reason_against_refit(model, step.model, members, logs, diagnosis.criteria)
    return (None, reason) if reason else (step, "")


def _harmless_shape(
    model: Model, diagnosis: Diagnosis, finding: Finding, logs: Sequence[Log | Recording]
) -> Step | None:
    """The best step of the shapes on the effect's grid that do no harm at standstill.

    Samples in motion hardly decide some shapes, the distance of a hysteresis for one; samples at standstill may.
    """
    grids = [[x for x in effect.variants(effect.joints) if x.searched] for effect in finding.members if effect.searched]
    tried = (_step_with(model, diagnosis, finding, members, logs)[0] for members in zip(*grids, strict=False))
    return min((step for step in tried if step is not None), key=lambda step: step.error_after or 0.0, default=None)


def _step(
    model: Model,
    effects: Sequence[Effect],
    logs: Sequence[Log | Recording],
    situation: Situation,
    finding: Finding | None,
    criteria: DiagnosisCriteria,
) -> Step:
    """Refit with some effects, and measure the error before and after on the logs that select."""
    together = (*model.effects, *effects)
    columns_of(model.robot, together)  # refuses two effects with the same columns before any work
    new = refitted(model, together, logs, situation, criteria)
    if situation == "changed":
        before, after = (compare(m, logs).nrmse for m in (model, new))
        measured_on = "on the fitted logs, with the models before and after the step"
    else:
        known, after = known_error(model, logs), fitted_error(new)
        before = fitted_error(refitted(model, model.effects, logs, situation, criteria)) if known is None else known
        measured_on = "cross-validated on the fitted logs"
    event: dict[str, Any] = {
        "action": "add",
        "effects": [str(e) for e in effects],
        "situation": situation,
        "error_before": before,
        "measured_on": measured_on,
        "sentence": "" if finding is None else finding.sentence,
        "logs": [fitted_entry(log) for log in logs],
    }
    own = {k: v for k, v in new.history[-1].items() if k == "cross_validated"}
    # A cross-validated error is the error after the step, unless the models were compared in another way.
    event |= own if own and situation != "changed" else {"error_after": after, **own}
    new = replace(new, history=(*model.history, event), previous=model)
    return Step(new, effects[0], before, after, measured_on, finding)


def _tested(before: Model, step: Step, valid: Sequence[Log | Recording]) -> Step:
    """The step with its error on the test logs, also in the model's history."""
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


def instances(finding: Finding) -> tuple[Effect, ...]:
    """The effects of a finding, one for every joint, each with its own shape."""
    if not finding.members:
        raise InputError(f"finding '{finding.effect}' cannot be added: it names no effect of the catalogue")
    return finding.members


def undo(model: Model) -> Model:
    """Return the model before its last step."""
    if model.previous is None:
        raise InputError("there is no step to undo: no effect was added to this model since it was identified")
    return model.previous
