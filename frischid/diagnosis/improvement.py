"""Better models, step by step: diagnose, add an effect, refit, and diagnose again.

The search is greedy forward selection over models with more and more effects e,

    τ = Y θ + Σ_{e added so far} C_e θ_e,

where each step (`frischid.diagnosis.addition`) stays only if it does no harm. After each addition the residual is
diagnosed again.

The logs given fit the parameters and select the effects, by cross-validation. Logs given as ``valid`` only test: their
error is stated after everything is decided.

Source: Chen, Billings and Luo 1989, Int. J. Control 50(5).
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import replace

from frischid.core.arguments import check_number
from frischid.core.threads import on_one_thread
from frischid.diagnosis.addition import Trial, tested, trial
from frischid.diagnosis.criteria import DIAGNOSIS_CRITERIA, DiagnosisCriteria
from frischid.diagnosis.diagnosis import diagnose
from frischid.diagnosis.findings import Finding, with_members
from frischid.diagnosis.result import Diagnosis
from frischid.diagnosis.roles import always_missing, decided_situation, logs_before_change
from frischid.diagnosis.situation import SituationOption, logs_to_diagnose
from frischid.diagnosis.step import Refusal, Step
from frischid.diagnosis.step_acceptance import (
    RISES_AT_STANDSTILL,
    harmless,
    helped,
    reason_against,
    reason_against_refit,
)
from frischid.effects import EFFECTS, Effect
from frischid.logs.given import Logs
from frischid.logs.log import Log
from frischid.logs.mapping import MappingLike
from frischid.logs.recording import Recording
from frischid.model.headline import headline
from frischid.model.model import Model


@on_one_thread
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

    An effect that would make some joints worse is added on the others alone, if this passes.

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
    InputError, UnknownNameError
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
    logs, valid = logs_to_diagnose(model, logs, valid, situation, mapping)
    check_number("max_steps", max_steps)
    model.check([*logs, *valid])
    steps: list[Step] = []
    refused: dict[str, Refusal] = {}
    progress("reading logs")
    situation, found, *_ = decided_situation(model, logs, situation, criteria, valid=valid)
    if situation == "changed" and found is not None and max_steps:
        steps = _before_change(model, found, valid, effects, criteria, progress)
        model = steps[-1].model if steps else model
    most = len(steps) + max_steps
    while True:
        progress(f"diagnosis {len(steps) + 1}")
        before = len(refused)
        diagnosis = diagnose(model, logs, situation=situation, effects=effects, criteria=criteria, progress=progress)
        tried = next_trial(model, diagnosis, logs, refused) if len(steps) < most else None
        while tried is None and len(refused) > before:  # the findings were ranked beside those that are refused now
            before = len(refused)
            others = [name for name in (EFFECTS if effects is None else effects) if name not in refused]
            again = diagnose(model, logs, situation=situation, effects=others, criteria=criteria, progress=progress)
            tried = next_trial(model, again, logs, refused)
        if tried is None:
            notes = [f"{refusal.finding.title} was not added: {refusal.reason}" for refusal in refused.values()]
            if valid:
                diagnosis = replace(diagnosis, headline=headline(model, valid))
            return steps, replace(diagnosis, notes=(*diagnosis.notes, *notes))
        steps.append(tested(model, tried.step(), valid))
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


def next_trial(
    model: Model, diagnosis: Diagnosis, logs: Sequence[Log | Recording], refused: dict[str, Refusal]
) -> Trial | None:
    """The trial of the step that `improve` takes after a diagnosis: that of the first finding that is accepted.

    Parameters
    ----------
    diagnosis : Diagnosis
        Of this model on these logs.
    logs : sequence of Log or Recording
        The logs that select.
    refused : dict of str to Refusal
        By effect: findings that are not tried again. Those refused here are added.

    Returns
    -------
    Trial or None
        None where no finding is accepted.
    """
    for finding in diagnosis.findings:
        if not (finding.pays and finding.members) or finding.effect in refused:
            continue
        tried, reason = _accepted(model, diagnosis, finding, finding.members, logs)
        if tried is None and reason == RISES_AT_STANDSTILL:
            tried = _harmless_shape(model, diagnosis, finding, logs)
        if tried is None and len(finding.members) > 1:
            tried = _harmless_part(model, diagnosis, finding, logs)
        if tried is not None:
            return tried
        refused[finding.effect] = Refusal(finding, reason)
    return None


def _accepted(
    model: Model, diagnosis: Diagnosis, finding: Finding, members: tuple[Effect, ...], logs: Sequence[Log | Recording]
) -> tuple[Trial | None, str]:
    """The trial of a finding with these effects; None where it may not stay, and why."""
    reason = reason_against(diagnosis.validator, members)
    if reason:
        return None, reason
    tried = trial(model, members, logs, diagnosis.situation, finding, diagnosis.criteria)
    reason = "the error of the model does not fall after the refit" if tried.error_after >= tried.error_before else ""
    reason = reason or reason_against_refit(model, tried.refit.model, members, logs, diagnosis.criteria)
    return (None, reason) if reason else (tried, "")


def _harmless_part(
    model: Model, diagnosis: Diagnosis, finding: Finding, logs: Sequence[Log | Recording]
) -> Trial | None:
    """The trial of an effect on a part of its joints; None where no part is a step.

    Its places on the joints that it would make worse are left out first. Where the rest is no step, only its places on
    the joints that it helps are kept, and then a single one of these: a joint that it does not help must not hide a
    joint that it does.
    """
    before = finding.members
    while 0 < len(left := harmless(diagnosis.validator, before)) < len(before):
        tried, _ = _accepted(model, diagnosis, with_members(finding, left, model.robot), left, logs)
        if tried is not None:
            return tried
        before = left
    kept = helped(diagnosis.validator, finding.members)
    for left in (kept, *((effect,) for effect in kept)):
        if 0 < len(left) < len(finding.members):
            tried, _ = _accepted(model, diagnosis, with_members(finding, left, model.robot), left, logs)
            if tried is not None:
                return tried
    return None


def _harmless_shape(
    model: Model, diagnosis: Diagnosis, finding: Finding, logs: Sequence[Log | Recording]
) -> Trial | None:
    """The best trial of the shapes on the effect's grid that do no harm at standstill.

    Samples in motion hardly decide some shapes, the distance of a hysteresis for one; samples at standstill may.
    """
    if not any(effect.searched for effect in finding.members):
        return None
    grids = [
        [x for x in effect.variants(effect.joints) if x.searched] if effect.searched else itertools.repeat(effect)
        for effect in finding.members
    ]
    tried = (_accepted(model, diagnosis, finding, members, logs)[0] for members in zip(*grids, strict=False))
    return min((x for x in tried if x is not None), key=lambda x: x.error_after, default=None)
