"""A model fitted again with further effects: all parameters anew, or with the old parameters as a prior.

If the robot has not changed since it was identified, every parameter is fitted to the logs anew. If the robot changed,
the identified parameters θ̂ with their information Λ are the prior, so that the change ends up in the columns C of the
new effects,

    minimise  ‖τ − Y θ − C β‖²_ω + (θ − θ̂)ᵀ Λ (θ − θ̂).

Source: Theil and Goldberger 1961, International Economic Review 2(1), on a prior as further rows of data.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from frischid.diagnosis.change_prior import load_reference
from frischid.diagnosis.criteria import DIAGNOSIS_CRITERIA, DiagnosisCriteria
from frischid.diagnosis.situation import Situation, cross_validator
from frischid.effects import Effect, Formula, columns_of
from frischid.errors import InputError
from frischid.estimators.least_squares import Estimate
from frischid.logs.log import Log
from frischid.logs.recording import Recording
from frischid.model.comparison import compare
from frischid.model.events import cross_validated_nrmse, measured_within
from frischid.model.headline import cross_validated, from_fit
from frischid.model.identification import assess_again, identify_again
from frischid.model.identification_stages import read_logs
from frischid.model.identify_options import IdentifyOptions
from frischid.model.log_data import Journal
from frischid.model.model import Model
from frischid.regression.regressor import Regressor
from frischid.regression.structure import structure


def check_formulas(model: Model, effects: Sequence[Effect]) -> None:
    """Refuse (InputError) formulas that can change nothing: zero, or a combination of columns that the model has."""
    formulas = tuple(effect for effect in effects if isinstance(effect, Formula))
    if not formulas:
        return
    reference = load_reference(model)
    have = structure(Regressor(model.robot, model.effects, reference), model.joints).rank
    for effect in formulas:
        more = structure(Regressor(model.robot, (*model.effects, effect), reference), model.joints)
        if more.rank <= have:
            names = {column.name for column in effect.columns(model.robot)}
            zero = names <= {more.columns[i].name for i in more.none}
            why = "is zero" if zero else "is a combination of columns that the model has"
            raise InputError(f"{effect} changes nothing: its torque {why}, whatever the motion; nothing was added")


def fitted_error(model: Model) -> float:
    """Cross-validated NRMSE that the identification of a model measured."""
    error = cross_validated_nrmse(model.history[-1:])
    assert error is not None  # every identification measures one
    return error


def known_error(model: Model, logs: Sequence[Log | Recording]) -> float | None:
    """Cross-validated error on these very logs, if the model's last step measured it there, on its joints alone."""
    last = model.history[-1] if model.history else {}
    same = [x["sha256"] for x in last.get("logs", ())] == [log.identity for log in logs]
    always = last.get("situation") != "changed" and measured_within(last, model.joints)
    return cross_validated_nrmse([last]) if same and always and model.estimate.estimator in {"wls", "map"} else None


@dataclass(frozen=True, eq=False)
class Refit:
    """A model fitted again. Most refits are refused, so record, alarms and history wait until they are asked for."""

    model: Model
    """Without a history and a record of its logs; of a changed robot, as `complete` gives it."""
    error: float
    """Cross-validated NRMSE on the logs of the fit."""
    complete: Callable[[], Model]
    """The model with its record, and with a history of one event, which states this error."""


def refitted(
    model: Model,
    effects: tuple[Effect, ...],
    logs: Sequence[Log | Recording],
    situation: Situation,
    criteria: DiagnosisCriteria,
) -> Refit:
    """Fit a model again with other effects.

    Parameters
    ----------
    effects : tuple of Effect
        The model's own, followed by the added ones.
    logs : sequence of Log or Recording
        Data to fit.
    situation : {"always", "changed"}
        ``"changed"``: the model's own parameters are a prior.
    """
    if situation == "changed":
        changed = _changed(model, effects, logs, criteria)
        return Refit(changed, fitted_error(changed), lambda: changed)
    again = identify_again(model.robot, logs, effects, _options(model, criteria))
    return Refit(
        replace(again.model, lowpass=model.lowpass),
        again.nrmse,
        lambda: replace(assess_again(again).model, lowpass=model.lowpass),
    )


def examine(model: Model, logs: Sequence[Log | Recording], criteria: DiagnosisCriteria = DIAGNOSIS_CRITERIA) -> None:
    """Examine logs as a refit does. Nothing is returned: a refit that follows finds the results remembered."""
    read_logs(model.robot, logs, (), _options(model, criteria), Journal(lambda _: None))


def _options(model: Model, criteria: DiagnosisCriteria) -> IdentifyOptions:
    """How a model was identified, but for its effects."""
    return IdentifyOptions(
        torque_joints=model.joints,
        cutoff=model.lowpass.cutoff,
        torque_lag=model.lowpass.torque_lag,
        velocity=model.velocity,
        estimator="wls",
        prior="none" if model.prior is None else "urdf",
        recursion="none",
        reference=load_reference(model, criteria),
        controller=model.controller,
        currents=model.currents,
    )


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
    # not a pseudo-inverse, which has no variance in directions that these logs leave open
    estimate, information, covariance = model.estimate, validator.fit.information, validator.fit.covariance
    sigma = estimate.sigma.copy()
    sigma[np.isin(estimate.joints, validator.joints)] = validator.fit.sigma  # of a joint that never moves it stays
    changed = replace(
        model,
        effects=effects,
        base=(*model.base, *(next(i for i, c in enumerate(columns) if c.name == a.name) for a in added)),
        expressions=(*model.expressions, *(c.name for c in added)),
        estimate=Estimate(
            columns=(*estimate.columns, *added),
            theta=validator.theta,
            covariance=(covariance + covariance.T) / 2,
            joints=estimate.joints,
            sigma=sigma,
            weights=1.0 / sigma**2,
            condition=float(np.sqrt(np.linalg.cond(information))),
            estimator="map",
            information=information,
            notes=("values of a changed robot: the identified parameters were kept as a prior",),
        ),
        bounds={},
        reference=load_reference(model, criteria),
        standard=None,
        prior=None if model.prior is None else model.prior.extended(added, validator.theta[-len(added) :]),
        fitted=None if model.fitted is None else model.fitted.extended(len(added)),
        history=(),
    )
    known = cross_validated(model.history[-1]) if model.history else None
    rms = dict(zip(validator.joints, validator.base_nrmse() * validator.spread, strict=True))
    own = from_fit(compare(changed, logs), rms, () if known is None else known.alarms)
    return replace(changed, history=({"cross_validated": own.to_dict()},))
