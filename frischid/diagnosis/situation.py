"""The situation: whether the robot changed after its model was identified.

- *always*: the robot has not changed. A missing effect was always missing: it acted in the model's training logs too.
- *changed*: the robot changed after the identification. A payload, a collision or wear acts in the new logs only.

The robot counts as changed when none of the logs is a training log of the model, and a refit with a weak URDF prior
predicts the logs better than the unchanged model does:

    NRMSE(unchanged model)  >  1.02 · NRMSE(refit, cross-validated).

The situation decides the prior (`change_prior`), and whether effects that can only come later, such as a payload, are
tried.

New logs of a robot that has not changed are searched under two priors where the identification predicts them better:
the URDF's and the identification. Short logs alone determine the parameters badly, and the search would take the errors
of such a fit for noise. But the identification is biased by an effect that was always missing. So the search counts
whose model with all effects predicts better.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from frischid.core.parallel import Workers
from frischid.diagnosis.change_prior import (
    evidence_prior,
    identification_prior,
    prior_before_change,
    weak_urdf_prior,
)
from frischid.diagnosis.criteria import DIAGNOSIS_CRITERIA, DiagnosisCriteria
from frischid.diagnosis.cross_validation import CrossValidator
from frischid.logs.log import Log
from frischid.logs.poses import need_motion
from frischid.logs.recording import Recording
from frischid.model.model import Model

Situation = Literal["always", "changed"]
SituationOption = Literal["auto", "always", "changed"]


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
    model : Model
    logs : sequence of Log or Recording
    situation : {"auto", "always", "changed"}
        ``"auto"``: decided from the logs.
    criteria : DiagnosisCriteria, optional
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
        refit = float(validator.base_nrmse().mean())
        changed = not own and _error_as_it_is(validator) > criteria.changed_error_ratio * refit
        situation = "changed" if changed else "always"
    if situation == "changed":
        validator = _from_before(validator)
    if not own:
        known = criteria.known_residual_factor * validator.model.estimate.sigma / validator.spread
        validator = validator.with_known_residual(known)
    return validator, situation


def _from_before(validator: CrossValidator) -> CrossValidator:
    """The fit of a changed robot, whose residual is the evidence for a change."""
    known = prior_before_change(validator.model)
    fit = validator.with_prior(known).fit
    return validator.with_prior(evidence_prior(known, fit.information - known.precision))


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
    trained = validator.with_prior(identification_prior(validator.model))
    return (
        [validator, trained] if trained.predictive_nrmse().mean() < validator.predictive_nrmse().mean() else [validator]
    )


def _error_as_it_is(validator: CrossValidator) -> float:
    """Mean NRMSE of the unchanged model: no parameter is refitted."""
    theta = validator.model.estimate.theta
    sse = np.array([[validator.squares(row, theta) for row in range(len(validator.joints))]])
    return float(validator.nrmse(sse).mean())
