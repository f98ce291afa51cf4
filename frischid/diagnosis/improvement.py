"""Add an effect, refit, and keep the story: every step of a model's history can be looked at and undone."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from frischid.diagnosis.change_prior import reference_of
from frischid.diagnosis.diagnosis import Diagnosis, Situation, diagnose, gathered
from frischid.diagnosis.findings import Finding
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
        Mean NRMSE on the validation logs, or cross-validated on the logs themselves when there are none.
    measured_on : str
        What the errors are of.
    finding : Finding or None
        Why, when a diagnosis proposed it.
    """

    model: Model
    effect: Effect
    error_before: float
    error_after: float
    measured_on: str
    finding: Finding | None

    def __repr__(self) -> str:
        return f"Step({self.effect}: NRMSE {self.error_before:.4f} → {self.error_after:.4f}, {self.measured_on})"


def add(
    model: Model,
    effects: Sequence[Effect],
    logs: Sequence[Log | Recording],
    *,
    valid: Sequence[Log | Recording] = (),
    situation: Situation = "always",
    finding: Finding | None = None,
) -> Step:
    """Refit a model with further effects.

    Parameters
    ----------
    model : Model
    effects : sequence of Effect
        What to add.
    logs : sequence of Log or Recording
        Data to fit.
    valid : sequence of Log or Recording
        Data to measure the error on.
    situation : {"auto", "always", "changed"}
        ``"auto"`` is decided as by `diagnose`. ``"always"``: all parameters are fitted again. ``"changed"``: the
        model's own parameters are kept as a prior, so that what changed ends up in the effect.
    finding : Finding, optional

    Returns
    -------
    Step
    """
    model.check([*logs, *valid])
    check_logs(logs, valid)
    if situation == "auto":
        situation = gathered(model, [*logs, *valid])[1]
    together = (*model.effects, *effects)
    columns_of(model.robot, together)  # two effects that describe the same thing are refused before any work
    new = _refitted(model, together, logs, situation)
    if valid or situation == "changed":
        before, after = (compare(m, valid or logs).nrmse for m in (model, new))
        measured_on = "held out" if valid else "the fitted logs, with the model as it was and as it is"
    else:
        known, after = _known_error(model, logs), _cross_validated(new)
        before = _cross_validated(_refitted(model, model.effects, logs, situation)) if known is None else known
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
        "held_out_logs": [{"source": log.source, "sha256": log.identity} for log in valid],
    }
    if not valid and situation != "changed":
        event["cross_validated_nrmse"] = after
    new = replace(new, history=(*model.history, event), previous=model)
    return Step(new, effects[0], before, after, measured_on, finding)


def improve(
    model: Model,
    logs: Sequence[Log | Recording],
    *,
    valid: Sequence[Log | Recording] = (),
    situation: Situation = "auto",
    most: int = 8,
    progress: Callable[[str], None] = lambda _: None,
) -> tuple[list[Step], Diagnosis]:
    """Diagnose and add until nothing passes, or an addition no longer lowers the held-out error.

    Parameters
    ----------
    model : Model
    logs, valid : sequence of Log or Recording
        Data to fit, and data to measure the error on.
    situation : {"auto", "always", "changed"}
        As in `diagnose`; decided once, for all steps.
    most : int
        Steps.
    progress : callable

    Returns
    -------
    steps : list of Step
    last : Diagnosis
        The one that found nothing more.
    """
    steps: list[Step] = []
    refused: set[str] = set()
    if situation == "auto":
        progress("evidence")
        situation = gathered(model, [*logs, *valid])[1]
    while True:
        progress(f"diagnosis {len(steps) + 1}")
        diagnosis = diagnose(model, logs, valid=valid, situation=situation, progress=progress)
        passing = [f for f in diagnosis.findings if f.significant and f.members and f.effect not in refused]
        if not passing or len(steps) == most:
            return steps, diagnosis
        step = add(model, instances(passing[0]), logs, valid=valid, situation=situation, finding=passing[0])
        if step.error_after >= step.error_before:
            refused.add(passing[0].effect)
            continue
        steps.append(step)
        model = step.model


def searched(
    model: Model, effects: Sequence[Effect], text: str, logs: Sequence[Log | Recording], situation: Situation
) -> tuple[Effect, ...]:
    """Give effects whose shape the user did not state the shape that fits best, joint by joint.

    Parameters
    ----------
    model : Model
    effects : sequence of Effect
    text : str
        What the user wrote; an effect written with parentheses keeps its shape.
    logs : sequence of Log or Recording
    situation : {"auto", "always", "changed"}
    """
    chosen: list[Effect] = []
    for effect in effects:
        if not effect.shapes or "(" in text:
            chosen.append(effect)
            continue
        evidence, _ = gathered(model, logs, "changed" if situation == "changed" else "always")
        places = [(n,) for n in effect.joints or model.joints] if effect.candidate == "joint" else [effect.joints]
        for place in places:
            projections = [p for p in evidence.project(effect.variants(place)) if p.columns]
            scored = evidence.score(projections) if projections else None
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
    known = last.get("cross_validated_nrmse") if same and model.estimate.estimator == "wls" else None
    return None if known is None else float(known)


def _refitted(
    model: Model, effects: tuple[Effect, ...], logs: Sequence[Log | Recording], situation: Situation
) -> Model:
    if situation != "changed":
        found = identify(
            model.robot,
            logs,
            effects=effects,
            torque_joints=model.joints,
            cutoff=model.lowpass.cutoff,
            velocity=model.velocity,
            estimator="wls",
            recursion="none",
            reference=reference_of(model),
        )
        return replace(found.model, lowpass=model.lowpass)
    return _changed(model, effects, logs)


def _changed(model: Model, effects: tuple[Effect, ...], logs: Sequence[Log | Recording]) -> Model:
    evidence, _ = gathered(model, logs, "changed")
    new = effects[len(model.effects) :]
    columns = columns_of(model.robot, effects)
    added = [c for e in new for c in e.columns(model.robot)]
    for projection in evidence.project(new):
        evidence = evidence.extended(projection)
    estimate = model.estimate
    covariance = np.asarray(np.linalg.pinv(evidence.information, hermitian=True), dtype=float)
    theta = evidence.theta
    return replace(
        model,
        effects=effects,
        base=(*model.base, *(next(i for i, c in enumerate(columns) if c.name == a.name) for a in added)),
        expressions=(*model.expressions, *(c.name for c in added)),
        estimate=Estimate(
            (*estimate.columns, *added),
            theta,
            covariance,
            estimate.joints,
            evidence.sigma,
            1.0 / evidence.sigma**2,
            float(np.sqrt(np.linalg.cond(evidence.information))),
            "map",
            evidence.information,
            ("values of a changed robot: the identified parameters were kept as a prior",),
        ),
        bounds={},
        reference=reference_of(model),
        standard=None,
    )
