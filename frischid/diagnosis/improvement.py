"""Better models step by step: add an effect, refit, and keep the history.

Every step is a model of its own,

    τ = Y θ + Σ_{e added so far} C_e θ_e,

refitted as a whole, with the error before and after and the finding that proposed the effect. A step can be undone. The
search is greedy forward selection over diagnoses: after each addition the residual is diagnosed again.

The logs given fit the parameters and select the effects, by cross-validation. Logs given as ``valid`` only test: the
error on them is stated after everything is decided.

Source: Chen, Billings and Luo 1989, Int. J. Control 50(5).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from frischid.core.text import listed
from frischid.diagnosis.change_prior import load_reference
from frischid.diagnosis.criteria import DIAGNOSIS_CRITERIA, DiagnosisCriteria
from frischid.diagnosis.diagnosis import Diagnosis, diagnose
from frischid.diagnosis.findings import Finding
from frischid.diagnosis.situation import Situation, SituationOption, cross_validator
from frischid.diagnosis.step_acceptance import impossible_coefficients, reason_against, worse_with_standstill
from frischid.effects import Effect, columns_of
from frischid.errors import InputError
from frischid.estimators.least_squares import Estimate
from frischid.logs.log import Log
from frischid.logs.recording import Recording, check_logs, chunks_of
from frischid.model.comparison import compare
from frischid.model.identification import identify
from frischid.model.model import Model


@dataclass(frozen=True, eq=False)
class Step:
    """One effect added.

    Attributes
    ----------
    model : Model
        With the effect.
    effect : Effect
    error_before, error_after : float
        Mean NRMSE on the logs that select, as `measured_on` says.
    measured_on : str
        How these errors are measured: cross-validated, or for a changed robot with the model as it was and as it is.
    finding : Finding or None
        The finding that proposed it, where a diagnosis did.
    test_before, test_after : float or None
        Mean NRMSE on the test logs, which decide nothing; None without test logs.
    """

    model: Model
    effect: Effect
    error_before: float
    error_after: float
    measured_on: str
    finding: Finding | None
    test_before: float | None = None
    test_after: float | None = None

    def __repr__(self) -> str:
        return f"Step({self.effect}: NRMSE {self.error_before:.4f} → {self.error_after:.4f}, {self.measured_on})"


def add(
    model: Model,
    effects: Sequence[Effect],
    logs: Sequence[Log | Recording],
    *,
    valid: Sequence[Log | Recording] = (),
    situation: SituationOption = "always",
    finding: Finding | None = None,
    criteria: DiagnosisCriteria = DIAGNOSIS_CRITERIA,
) -> Step:
    """Add effects to a model and refit it.

    Parameters
    ----------
    model : Model
    effects : sequence of Effect
        Effects to add.
    logs : sequence of Log or Recording
        Data to fit; the error is cross-validated on them.
    valid : sequence of Log or Recording
        Test logs: the error on them is stated too, and nothing else uses them.
    situation : {"auto", "always", "changed"}
        ``"auto"`` is decided as by `diagnose`. ``"always"``: all parameters are fitted again. ``"changed"``: the
        model's own parameters are kept as a prior, so that the change ends up in the effect.
    finding : Finding, optional
        The finding that proposed the effects, for the model's history.
    criteria : DiagnosisCriteria, optional
        Thresholds that decide the situation.

    Returns
    -------
    Step

    Raises
    ------
    InputError
        A log is both fitted and a test log, or lacks a joint or its torque, or two effects describe the same thing.

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
    model.check([*logs, *valid])
    check_logs(logs, valid)
    if situation == "auto":
        situation = cross_validator(model, logs, criteria=criteria)[1]
    return _tested(model, _step(model, effects, logs, situation, finding, criteria), valid)


def improve(
    model: Model,
    logs: Sequence[Log | Recording],
    *,
    valid: Sequence[Log | Recording] = (),
    situation: SituationOption = "auto",
    max_steps: int = 8,
    criteria: DiagnosisCriteria = DIAGNOSIS_CRITERIA,
    progress: Callable[[str], None] = lambda _: None,
) -> tuple[list[Step], Diagnosis]:
    """Diagnose and add until no effect passes; an addition that does harm is refused.

    A step stays only if the logs that select say so: the cross-validated error falls block by block on the joints the
    effect acts on; no joint becomes significantly worse; the mean log ratio of the joints' errors falls, so that one
    noisy joint cannot pay for the others, and it does not rise with samples at standstill; the mean NRMSE falls; and no
    coefficient has an impossible sign (`frischid.diagnosis.step_acceptance`). The last diagnosis notes what was
    refused, and why.

    Parameters
    ----------
    model : Model
    logs : sequence of Log or Recording
        Data that fit the parameters and select the effects.
    valid : sequence of Log or Recording
        Test logs: the error on them is stated for each step, and nothing else uses them.
    situation : {"auto", "always", "changed"}
        As in `diagnose`; decided once, for all steps.
    max_steps : int
        Most effects to add.
    criteria : DiagnosisCriteria, optional
        Every threshold that decides the diagnoses and the steps.
    progress : callable
        Called with a few words at each stage.

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
    steps: list[Step] = []
    refused: dict[str, str] = {}
    if not logs:
        raise InputError("there is no log to diagnose")
    model.check([*logs, *valid])
    check_logs(logs, valid)
    if situation == "auto":
        progress("reading logs")
        situation = cross_validator(model, logs, criteria=criteria)[1]
    while True:
        progress(f"diagnosis {len(steps) + 1}")
        diagnosis = diagnose(model, logs, situation=situation, criteria=criteria, progress=progress)
        step = _next_step(model, diagnosis, logs, refused) if len(steps) < max_steps else None
        if step is None:
            notes = [f"{effect} was not added: {reason}" for effect, reason in refused.items()]
            test_error = compare(model, valid).nrmse if valid else None
            return steps, replace(diagnosis, notes=(*diagnosis.notes, *notes), test_error=test_error)
        steps.append(_tested(model, step, valid))
        model = steps[-1].model


def _next_step(
    model: Model, diagnosis: Diagnosis, logs: Sequence[Log | Recording], refused: dict[str, str]
) -> Step | None:
    """The first finding that may stay, added; those that may not go to `refused` with the reason."""
    for finding in diagnosis.findings:
        if not (finding.significant and finding.members) or finding.effect in refused:
            continue
        reason = reason_against(diagnosis.validator, finding.members)
        if not reason:
            step = _step(model, finding.members, logs, diagnosis.situation, finding, diagnosis.criteria)
            reason = _reason_against_step(model, step, finding.members, logs, diagnosis.criteria)
            if not reason:
                return step
        refused[finding.effect] = reason
    return None


def _reason_against_step(
    model: Model,
    step: Step,
    effects: Sequence[Effect],
    logs: Sequence[Log | Recording],
    criteria: DiagnosisCriteria,
) -> str:
    """Why a refitted model may not stay; empty where it may."""
    if step.error_after >= step.error_before:
        return "the error of the refitted model does not fall"
    impossible = impossible_coefficients(step.model, effects, criteria)
    if impossible:
        return f"the sign of {listed(impossible)} is physically impossible"
    worse = worse_with_standstill(model, step.model, logs, criteria)
    return "the error would rise where samples at standstill count" if worse else ""


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
    columns_of(model.robot, together)  # two effects that describe the same thing are refused before any work
    new = _refitted(model, together, logs, situation, criteria)
    if situation == "changed":
        before, after = (compare(m, logs).nrmse for m in (model, new))
        measured_on = "the fitted logs, with the model as it was and as it is"
    else:
        known, after = _known_error(model, logs), _cross_validated(new)
        before = (
            _cross_validated(_refitted(model, model.effects, logs, situation, criteria)) if known is None else known
        )
        measured_on = "cross-validated on the fitted logs"
    event: dict[str, Any] = {
        "action": "add",
        "effects": [str(e) for e in effects],
        "situation": situation,
        "error_before": before,
        "error_after": after,
        "measured_on": measured_on,
        "sentence": "" if finding is None else finding.sentence,
        "logs": [
            {"source": log.source, "sha256": log.identity, "samples": sum(map(len, chunks_of(log)))} for log in logs
        ],
    }
    if situation != "changed":
        event["cross_validated_nrmse"] = after
    new = replace(new, history=(*model.history, event), previous=model)
    return Step(new, effects[0], before, after, measured_on, finding)


def _tested(before: Model, step: Step, valid: Sequence[Log | Recording]) -> Step:
    """The step with its error on the test logs, also in the model's history."""
    if not valid:
        return step
    errors = [compare(m, valid).nrmse for m in (before, step.model)]
    *earlier, event = step.model.history
    event = {
        **event,
        "test_before": errors[0],
        "test_after": errors[1],
        "test_logs": [{"source": log.source, "sha256": log.identity} for log in valid],
    }
    model = replace(step.model, history=(*earlier, event))
    return replace(step, model=model, test_before=errors[0], test_after=errors[1])


def searched(
    model: Model,
    effects: Sequence[Effect],
    text: str,
    logs: Sequence[Log | Recording],
    situation: SituationOption,
    criteria: DiagnosisCriteria = DIAGNOSIS_CRITERIA,
) -> tuple[Effect, ...]:
    """Give effects whose shape the user did not state the shape that fits best, joint by joint.

    Parameters
    ----------
    model : Model
    effects : sequence of Effect
    text : str
        The user's words; an effect written with parentheses keeps its shape.
    logs : sequence of Log or Recording
    situation : {"auto", "always", "changed"}
    criteria : DiagnosisCriteria, optional

    Raises
    ------
    InputError
        The model's own columns already span every effect.
    """
    chosen: list[Effect] = []
    for effect in effects:
        if not effect.shapes or "(" in text:
            chosen.append(effect)
            continue
        taken: Situation = "changed" if situation == "changed" else "always"
        validator, _ = cross_validator(model, logs, taken, criteria=criteria)
        places = [(n,) for n in effect.joints or model.joints] if effect.candidate == "joint" else [effect.joints]
        for place in places:
            candidates = [c for c in validator.candidates(effect.variants(place)) if c.columns]
            scored = validator.score(candidates) if candidates else None
            if scored is not None:
                chosen.append(scored[1].effect)
    if not chosen:
        raise InputError(f"{text}: on these logs the model's own columns already span this effect; nothing to add")
    return tuple(chosen)


def instances(finding: Finding) -> tuple[Effect, ...]:
    """The effects of a finding, one for every joint with its own shape."""
    if not finding.members:
        raise InputError(f"finding '{finding.effect}' cannot be added: it names no effect of the catalogue")
    return finding.members


def undo(model: Model) -> Model:
    """Return the model before its last step."""
    if model.previous is None:
        raise InputError("there is no step to undo: this model has only been identified")
    return model.previous


def _cross_validated(model: Model) -> float:
    return float(model.history[-1]["cross_validated_nrmse"])


def _known_error(model: Model, logs: Sequence[Log | Recording]) -> float | None:
    """Cross-validated error on these very logs, if the model's last step measured it there."""
    last = model.history[-1] if model.history else {}
    same = [x["sha256"] for x in last.get("logs", ())] == [log.identity for log in logs]
    known = last.get("cross_validated_nrmse") if same and model.estimate.estimator in {"wls", "map"} else None
    return None if known is None else float(known)


def _refitted(
    model: Model,
    effects: tuple[Effect, ...],
    logs: Sequence[Log | Recording],
    situation: Situation,
    criteria: DiagnosisCriteria,
) -> Model:
    if situation == "changed":
        return _changed(model, effects, logs, criteria)
    found = identify(
        model.robot,
        logs,
        effects=effects,
        torque_joints=model.joints,
        cutoff=model.lowpass.cutoff,
        velocity=model.velocity,
        estimator="wls",
        prior="none" if model.prior is None else "urdf",
        recursion="none",
        reference=load_reference(model, criteria),
    )
    return replace(found.model, lowpass=model.lowpass)


def _changed(
    model: Model, effects: tuple[Effect, ...], logs: Sequence[Log | Recording], criteria: DiagnosisCriteria
) -> Model:
    """The model with the columns of a change, and its own parameters as a prior."""
    validator, _ = cross_validator(model, logs, "changed", criteria=criteria)
    new = effects[len(model.effects) :]
    columns = columns_of(model.robot, effects)
    added = [c for e in new for c in e.columns(model.robot)]
    for candidate in validator.candidates(new):
        validator = validator.extended(candidate)
    estimate, information = model.estimate, validator.fit.information
    return replace(
        model,
        effects=effects,
        base=(*model.base, *(next(i for i, c in enumerate(columns) if c.name == a.name) for a in added)),
        expressions=(*model.expressions, *(c.name for c in added)),
        estimate=Estimate(
            (*estimate.columns, *added),
            validator.theta,
            np.asarray(np.linalg.pinv(information, hermitian=True), dtype=float),
            estimate.joints,
            validator.fit.sigma,
            1.0 / validator.fit.sigma**2,
            float(np.sqrt(np.linalg.cond(information))),
            "map",
            information,
            ("values of a changed robot: the identified parameters were kept as a prior",),
        ),
        bounds={},
        reference=load_reference(model, criteria),
        standard=None,
        prior=None if model.prior is None else model.prior.extended(added, validator.theta[-len(added) :]),
        fitted=None if model.fitted is None else model.fitted.extended(len(added)),
    )
