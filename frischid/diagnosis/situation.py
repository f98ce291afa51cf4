"""The situation: whether the robot changed after its model was identified.

- *always*: the robot has not changed. A missing effect was always missing: it acted in the model's training logs too.
- *changed*: the robot changed after the identification. A payload, a collision or wear acts in the new logs only.

Where the training logs are at hand, they decide (`of_the_training_logs`). A model that is no worse on the new logs than
on its own says nothing of a change. Nor does an error that its uncertainty explains, nor that of an effect which was
always missing. With E the error of a joint on the new logs under the unchanged model, E_a that under the model with the
effects of the training logs and their strength there, and E_t the largest of three (the error of the latter on training
logs that were left out, without the part that uncertain parameters cause; the sensor noise of the new logs; and the
error that the model's uncertainty explains there), the robot has not changed where on every joint whose error asks for
an explanation beside E_t

    E_a² − E_t²  <  ½ (E² − E_t²).

An error that is only at reversals asks for none (`only_at_reversals`): a joint sticks as long as its motion lets it.

Without the training logs, the robot has changed if a refit with a weak URDF prior predicts the logs better than the
unchanged model does,

    NRMSE(unchanged model)  >  1.02 · NRMSE(refit, cross-validated),

on some joint by more than an error that is negligible beside the torque. This rule also takes an effect that was always
missing for a change: on another motion a refit adapts to the effect, and the unchanged model does not.

The situation decides the prior (`change_prior`), and whether effects that can only come later, such as a payload, are
tried.

New logs of a robot that has not changed are searched under two priors where the identification predicts them better:
the URDF's and the identification. Short logs alone determine the parameters badly, and the search would take the errors
of such a fit for noise. But the identification is biased by an effect that was always missing. So the search counts
whose model with all effects predicts better.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Literal, get_args

import numpy as np

from frischid.core.parallel import Workers
from frischid.core.types import Array
from frischid.diagnosis.change_prior import (
    evidence_prior,
    prior_before_change,
    weak_urdf_prior,
)
from frischid.diagnosis.criteria import DIAGNOSIS_CRITERIA, DiagnosisCriteria
from frischid.diagnosis.cross_validation import CrossValidator
from frischid.diagnosis.floor import Floor, asks_for_explanation
from frischid.diagnosis.reversal_residuals import only_at_reversals
from frischid.effects import Effect
from frischid.errors import InputError, UnknownNameError
from frischid.estimators.least_squares import Prior
from frischid.logs.given import Logs, as_logs
from frischid.logs.log import Log
from frischid.logs.mapping import MappingLike
from frischid.logs.poses import need_motion
from frischid.logs.recording import Recording, check_logs
from frischid.model.model import Model
from frischid.model.model_argument import check_model

Situation = Literal["always", "changed"]
SituationOption = Literal["auto", "always", "changed"]


def check_situation(situation: str) -> None:
    """Refuse (UnknownNameError) a situation that does not exist."""
    if situation not in get_args(SituationOption):
        raise UnknownNameError("situation", situation, get_args(SituationOption))


def logs_to_diagnose(
    model: Any, logs: Logs, valid: Logs, situation: str, mapping: MappingLike
) -> tuple[list[Log | Recording], list[Log | Recording]]:
    """The logs and test logs of a diagnosis as a caller gives them, beside a model and a situation that exist.

    Raises
    ------
    InputError, UnknownNameError
    """
    check_model(model)
    logs, valid = as_logs(logs, model.robot.joints, mapping), as_logs(valid, model.robot.joints, mapping, "valid")
    if not logs:
        raise InputError("there is no log to diagnose; give at least one")
    check_situation(situation)
    check_logs(logs, valid)
    return logs, valid


def cross_validator(
    model: Model,
    logs: Sequence[Log | Recording],
    situation: SituationOption = "auto",
    *,
    criteria: DiagnosisCriteria = DIAGNOSIS_CRITERIA,
    workers: Workers | None = None,
) -> tuple[CrossValidator, Situation]:
    """Read logs, decide the situation, and fit the model with the prior of that situation.

    Parameters
    ----------
    situation : {"auto", "always", "changed"}
        ``"auto"``: decided from the logs.
    workers : Workers, optional
        Processes that compute columns of candidates, this process by default.

    Returns
    -------
    CrossValidator
    situation : {"always", "changed"}

    Raises
    ------
    InputError
        A log lacks a joint of the model or its torque, or no joint moves.
    """
    logs = need_motion(logs, model.robot.joints)
    validator = CrossValidator.of(model, logs, weak_urdf_prior(model, criteria), criteria=criteria, workers=workers)
    own = any(model.made_from(log) for log in logs)
    if situation == "auto":
        situation = "changed" if not own and _worse_than_refit(validator) else "always"
    if situation == "changed":
        validator = _from_before(validator)
    if not own:
        known = criteria.known_residual_factor * validator.model.estimate.sigma / validator.spread
        validator = replace(validator, known_residual=known)
    return validator, situation


def _from_before(validator: CrossValidator) -> CrossValidator:
    """The fit of a changed robot, whose residual is the evidence for a change."""
    known = prior_before_change(validator.model)
    fit = validator.with_prior(known).fit
    return validator.with_prior(evidence_prior(known, fit.information - known.precision))


def of_the_training_logs(
    own: CrossValidator, new: CrossValidator, effects: Sequence[Effect], expected: Mapping[str, float]
) -> bool:
    """Whether new logs show no error but that of a model's training logs, and that of the effects that act there.

    Parameters
    ----------
    own : CrossValidator
        Of the training logs, for a robot that has not changed.
    new : CrossValidator
        Of the new logs.
    effects : sequence of Effect
        Those that the training logs show. Where nothing is wrong on the new logs, none is needed.
    expected : mapping of str to float
        Rms error of each joint that the uncertainty of the model with these effects explains on the new logs, N·m (N).

    Notes
    -----
    A joint that never moves in one of the two may move in the other: joints are compared by name. Without motion in
    the training logs a joint has no error there, and the other two of E_t remain.
    """
    criteria, model = new.criteria, new.model
    new = new.with_prior(weak_urdf_prior(model, criteria))
    wide, narrow = new, own
    for there, here in zip(own.candidates(effects), new.candidates(effects), strict=True):
        if here.columns and here.finite and there.columns:
            wide, narrow = wide.extended(here), narrow.extended(there)
    before, after = _errors_as_it_is(new), _errors_under(wide, narrow.theta)
    trained = dict(zip(narrow.joints, (narrow.predictive_nrmse() * narrow.spread).tolist(), strict=True))
    known = [[errors.get(name, 0.0) for name in new.joints] for errors in (trained, expected)]
    usual = np.minimum(np.max([*np.nan_to_num(known), Floor.of(new).noise], axis=0) / new.spread, before)
    wrong, left = before**2 - usual**2, after**2 - usual**2
    clear = asks_for_explanation(before, usual, new)
    clear &= ~only_at_reversals(new, Floor.of(new).noise, model.estimate.theta)
    return bool((left < criteria.half_explained * wrong)[clear].all())


def priors_of(validator: CrossValidator, situation: Situation) -> list[CrossValidator]:
    """The fit, and on new logs of an unchanged robot the fit with the identification as prior, where that is better.

    Parameters
    ----------
    validator : CrossValidator
        From `cross_validator`.
    situation : {"always", "changed"}
    """
    if situation == "changed" or not validator.known_residual.any():
        return [validator]
    estimate = validator.model.estimate
    trained = validator.with_prior(Prior(estimate.theta, estimate.information))
    return (
        [validator, trained] if trained.predictive_nrmse().mean() < validator.predictive_nrmse().mean() else [validator]
    )


def _worse_than_refit(validator: CrossValidator) -> bool:
    """Whether the unchanged model is worse than a refit, and on some joint by more than a negligible error."""
    criteria, before, refit = validator.criteria, _errors_as_it_is(validator), validator.base_nrmse()
    clear = before.mean() > criteria.changed_error_ratio * refit.mean()
    return bool(clear and (before**2 - refit**2).max() > criteria.smallest_error**2)


def _errors_as_it_is(validator: CrossValidator) -> Array:
    """NRMSE of the unchanged model, (J,): no parameter is refitted."""
    return _errors_under(validator, validator.model.estimate.theta)


def _errors_under(validator: CrossValidator, theta: Array) -> Array:
    """NRMSE of each joint under some parameters, (J,)."""
    sse = np.array([[validator.squares(row, theta) for row in range(len(validator.joints))]])
    return validator.nrmse(sse)
