"""The content of a report, computed once: the model along the logs, where it fails, missing effects, the data."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from frischid.core.text import listed
from frischid.core.types import Array
from frischid.diagnosis.findings import Finding
from frischid.diagnosis.improvement import next_trial
from frischid.diagnosis.result import Diagnosis
from frischid.diagnosis.rivals import suspect_of
from frischid.diagnosis.roles import diagnose_with, roles
from frischid.diagnosis.step import Refusal
from frischid.errors import FrischidError, InputError
from frischid.export.consistency import Consistency, make_consistent
from frischid.forward.simulated_beside import SimulatedBeside, simulated_beside
from frischid.logs.driven import driven
from frischid.logs.excerpt import as_recording, excerpt
from frischid.logs.log import Log
from frischid.logs.recording import Recording, check_logs
from frischid.model.comparison import Comparison, compare
from frischid.model.headline import Headline, cross_validated, headline
from frischid.model.identification_alarms import HARDLY_PREDICTED
from frischid.model.identification_criteria import IdentificationCriteria
from frischid.model.log_quality import Quality, quality
from frischid.model.model import Model
from frischid.model.model_argument import check_model
from frischid.model.prediction import Prediction, predict
from frischid.regression.base_parameters import Reduction
from frischid.regression.regressor import Regressor, nominal_parameters
from frischid.regression.structure import structure
from frischid.reports.others import OtherModel, SideBySide, earlier_steps, further_models, side_by_side

STEP_FOLLOWS = ("effect", "several", "contact")
"""Verdicts after which an effect may be added; with an unknown cause, a person looks first."""


@dataclass(frozen=True, eq=False)
class Study:
    """The content of a report: a model on some logs.

    Attributes
    ----------
    model : Model
    logs : tuple of Log
        Of a long log an excerpt: see `frischid.logs.excerpt`.
    held_out : tuple of str
        Sources of the logs the model was not fitted to.
    roles : tuple of str
        ``"fitted"`` or ``"test"``, of each log in their order: two logs of one name may have different roles.
    prediction : Prediction
        Along all logs, in their order.
    headline : Headline
        The model's error: on the logs it was not fitted to, or cross-validated without any.
    comparison : Comparison
        On all logs.
    verdict : Comparison
        On the held-out logs if there are any, otherwise on all logs.
    diagnosis : Diagnosis or None
        The model's own logs select, the others test: see `frischid.diagnosis.roles`.
    qualities : tuple of Quality
    reduction : Reduction or None
        The identifiable parameters; None when they are not those of the model (another version made the model).
    nominal, truth : ndarray, shape (p,), or None
        Base parameters of the URDF, and of a simulated robot.
    physical : Consistency or str
        Links that could exist and have the base parameters, or the reason why there are none.
    others : tuple of OtherModel
        Models whose curves stand beside those of this one: its earlier steps, then the further models.
    by_log : tuple of Comparison
        The model on each log alone, in their order.
    beside : SideBySide or None
        The errors of this model and of further ones on the same logs; None without a further model.
    proposed : Finding or None
        The finding that `improve` would add next: not every effect that is called missing may become a step.
    refused : tuple of Refusal
        More probable findings that `improve` would not add.
    simulated : SimulatedBeside, str or None
        Simulated positions along one log, held out if there is one; or why the model cannot be simulated.
    """

    model: Model
    logs: tuple[Log, ...]
    held_out: tuple[str, ...]
    roles: tuple[str, ...]
    prediction: Prediction
    headline: Headline
    comparison: Comparison
    verdict: Comparison
    diagnosis: Diagnosis | None
    qualities: tuple[Quality, ...]
    reduction: Reduction | None
    nominal: Array | None
    truth: Array | None
    physical: Consistency | str
    others: tuple[OtherModel, ...] = ()
    by_log: tuple[Comparison, ...] = ()
    beside: SideBySide | None = None
    proposed: Finding | None = None
    refused: tuple[Refusal, ...] = ()
    simulated: SimulatedBeside | str | None = None

    def sliding(self, joint: str) -> bool:
        """Whether a joint is prismatic."""
        robot = self.model.robot
        return bool(robot.prismatic[robot.joints.index(joint)])

    def unit_of(self, joint: str) -> str:
        """Unit of a joint's torque or force."""
        return "N" if self.sliding(joint) else "N·m"

    @property
    def impossible(self) -> list[str]:
        """Parameters whose estimate has the impossible sign, by more than two standard errors."""
        e = self.model.estimate
        return [c.name for c, x, s in zip(e.columns, e.theta, e.stderr, strict=True) if c.sign * x < -2 * s]

    @property
    def refusals(self) -> list[str]:
        """Why `improve` would not add the findings that are more probable than the proposed one."""
        return [f"frischid improve would not add {r.finding.title}: {r.reason}" for r in self.refused]

    @property
    def passed_over(self) -> list[str]:
        """Effects that are more probable than the proposed one, and that `improve` would not add."""
        suspect = None if self.diagnosis is None else suspect_of(self.diagnosis.findings, self.diagnosis.probabilities)
        return [*([] if suspect is None else [suspect.effect]), *(x.finding.effect for x in self.refused)]

    def warnings(self) -> list[str]:
        """Reasons to doubt the model beside its alarms, most serious first."""
        found = []
        alarmed = {(alarm.id, joint) for alarm in self.headline.alarms for joint in alarm.joints}
        if not self.held_out:
            found.append("Every log here was used to fit the model: its error on new motion may be larger.")
        limit = IdentificationCriteria().unexplained_nrmse
        identified: Mapping[str, Any] = next((e for e in reversed(self.model.history) if "warnings" in e), {})
        told = {name for alarm, name in alarmed if alarm == "worse-than-constant"}
        kept = [w for w in identified.get("warnings", ()) if not self._ended(w, identified, limit)]
        if any(HARDLY_PREDICTED in w for w in kept):
            told |= set(identified.get("unpredicted", ()))
        hopeless = [n for n, j in self.verdict.joints.items() if j.nrmse > limit and n not in told]
        if hopeless:
            found.append(
                f"The model hardly predicts the torque of {listed(hopeless)}: check for swapped columns, a wrong sign, "
                "a dead channel, or a missing effect."
            )
        worse = [name for name in self.verdict.behind_urdf if self.verdict.joints[name].nrmse <= limit]
        if worse:
            found.append(f"The URDF with fitted friction predicts {listed(worse)} better than this model does.")
        if self.impossible and all(alarm.id != "impossible-sign" for alarm in self.headline.alarms):
            found.append(f"The sign of {listed(self.impossible)} is physically impossible.")
        of_logs = [f"{Path(q.source).name}: {w}" for q in self.qualities for w in q.warnings]
        answered = {f"{Path(q.source).name}: {w}" for q in self.qualities for w in q.answered}
        earlier = [self.brief(w) for w in kept]
        found += [f"At identification: {w}" for w in earlier if w not in of_logs and w not in answered]
        return list(dict.fromkeys([*found, *of_logs]))

    def _ended(self, warning: str, identified: Mapping[str, Any], limit: float) -> bool:
        """Whether a warning of joints that the identified model hardly predicted holds no more, after added effects."""
        now = cross_validated(self.model.history[-1])
        if HARDLY_PREDICTED not in warning or now is None:
            return False
        names = identified.get("unpredicted", ())
        return bool(names) and all(now.joints.get(name, np.inf) <= limit for name in names)

    def brief(self, text: str) -> str:
        """A message with the names of its logs instead of their paths, which say nothing elsewhere."""
        for event in self.model.history:
            for log in event.get("logs", ()):
                text = text.replace(log["source"], Path(log["source"]).name)
        return text


def study(
    models: Model | Mapping[str, Model],
    logs: Sequence[Log | Recording],
    *,
    valid: Sequence[Log | Recording] = (),
    diagnosis: Diagnosis | None = None,
    diagnosed: bool = True,
    situation: Literal["auto", "always", "changed"] = "auto",
    truth: Array | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> Study:
    """Compute the content of a report.

    Parameters
    ----------
    models : Model or mapping of str to Model
        Models by name: the report is on the first, and compares the others with it.
    logs : sequence of Log or Recording
        The model's history says which of them it was fitted to.
    valid : sequence of Log or Recording
        Test logs in any case: they select no effect.
    diagnosis : Diagnosis, optional
        Diagnosis of this model on those of these logs that are not held out, if there is one already.
    diagnosed : bool
        Whether to diagnose if `diagnosis` is None.
    situation : {"auto", "always", "changed"}
        Whether the robot changed since it was identified, as in `frischid.diagnosis.diagnosis.diagnose`.
    truth : ndarray, shape (p,), optional
        True base parameters of a simulated robot.
    progress : callable
        Called with the name of each step of the work.
    """
    named = _checked(models, logs, valid, truth)
    selecting, logs = len(logs), [*logs, *valid]
    model = next(iter(named.values()))
    progress("comparing (stage 1 of 5)")
    recorded = sorted(logs, key=model.made_from)
    logs = driven(logs, model.controller, model.currents)
    excerpts = [excerpt(log) for log in logs]
    shown, whole = [part.log for part in excerpts], [as_recording(log) for log in logs]
    held = whole[selecting:] or [log for log in whole if not model.made_from(log)]
    # Of logs in memory, one evaluation serves both; a long one is evaluated once more along its excerpt.
    short = all(isinstance(log, Log) for log in whole)
    evaluated = [list(model.blocks([log])) for log in shown]
    comparison = compare(model, whole, [b for part in evaluated for b in part] if short else None)
    prediction = predict(model, shown, evaluated)
    given = None
    if diagnosed or diagnosis is not None:
        given = roles(model, shown[:selecting], valid=shown[selecting:], situation=situation)
    if diagnosis is None and given is not None:
        diagnosis = diagnose_with(model, given, progress=progress)
    refused: dict[str, Refusal] = {}
    proposed = None
    if diagnosis is not None and given is not None and diagnosis.verdict in STEP_FOLLOWS:
        progress("trying the next step (stage 3 of 5)")
        proposed = next_trial(given.before or model, diagnosis, given.select, refused)
    further = [(name, other) for name, other in named.items() if other is not model]
    others = [*earlier_steps(model, shown, prediction), *further_models(further, shown, prediction)]
    progress("parameters (stage 4 of 5)")
    reduction = _reduction(model)
    verdict = compare(model, held) if held and len(held) < len(whole) else comparison
    return Study(
        model=model,
        logs=tuple(shown),
        held_out=tuple(log.source for log in held),
        roles=tuple("fitted" if model.made_from(log) else "test" for log in whole),
        prediction=prediction,
        headline=headline(model, held or whole, verdict),
        comparison=comparison,
        verdict=verdict,
        diagnosis=diagnosis,
        qualities=tuple(quality(model, excerpts)),
        reduction=reduction,
        nominal=_nominal(model, reduction),
        truth=truth,
        physical=_physical(model),
        others=tuple(others),
        by_log=tuple(compare(model, [log], part) for log, part in zip(shown, evaluated, strict=True)) if short else (),
        beside=side_by_side(named, whole) if further else None,
        proposed=None if proposed is None else proposed.finding,
        refused=tuple(refused.values()),
        simulated=simulated_beside(model, recorded),
    )


def _checked(
    models: Model | Mapping[str, Model],
    logs: Sequence[Log | Recording],
    valid: Sequence[Log | Recording],
    truth: Array | None,
) -> Mapping[str, Model]:
    """The models by name; what makes no report is refused."""
    if not logs:
        raise InputError("there is no log to report on; give at least one")
    check_logs(logs, valid)
    named = models if isinstance(models, Mapping) else {"model": models}
    if not named:
        raise InputError("there is no model to report on; give at least one")
    for model in named.values():
        check_model(model)
        model.check([*logs, *valid])
    first = next(iter(named.values()))
    if truth is not None and np.shape(truth) != (len(first.base),):
        raise InputError(f"truth must hold the {len(first.base)} base parameters, got the shape {np.shape(truth)}")
    return named


def _physical(model: Model) -> Consistency | str:
    try:
        return make_consistent(model)
    except FrischidError as error:
        return str(error)


def _reduction(model: Model) -> Reduction | None:
    reduction = structure(Regressor(model.robot, model.effects, model.reference), model.joints)
    return reduction if reduction.base == model.base else None


def _nominal(model: Model, reduction: Reduction | None) -> Array | None:
    """Base parameters of the URDF, (p,)."""
    if reduction is None:
        return None
    return np.asarray(reduction.mapping @ nominal_parameters(model.robot, model.effects))
