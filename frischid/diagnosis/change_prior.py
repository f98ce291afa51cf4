"""Prior of the parameters in a diagnosis: a weak URDF prior, or the identification.

If the robot has not changed since it was identified (situation *always*), all parameters are fitted anew. The prior is
a weak one from the URDF, carried to the base parameters θ_b = K θ,

    θ ~ N(θ_URDF, P),   P = diag(spread²);      θ_b ~ N(K θ_URDF, K P Kᵀ).

If the robot *changed* since it was identified, the identification itself is the prior: mean θ̂, and covariance m C.
The covariance C of an identification counts all of its residual as the model's error, which does not average out over
a log. The sensors' noise does average out, so a share m of C is there on another motion (`FitRecord.model_share`, the
mean over the joints). With C itself, long new logs would count many times as much as the logs before the change, and
a fit would put the change into the old parameters before any effect is judged.

**The residual is the evidence.** Under this prior N(θ̂, P) the torque of the new logs has the covariance
σ² (I + Y P Yᵀ), with Y in units of the noise σ. So the log likelihood of a change is −½ eᵀ (I + Y P Yᵀ)⁻¹ e with
e = (τ − Y θ̂) / σ. Along an eigenvector of Y P Yᵀ with eigenvalue d, a fit under N(θ̂, P) leaves 1/(1 + d) of e. The
evidence is the square of 1/√(1 + d) of e. So the diagnosis fits under a stronger prior, P' with d' = √(1 + d) − 1 in
place of d. Then its sums of squared residuals, block by block of time too, are the evidence (`evidence_prior`). Where
the logs before the change say nothing (d → ∞), the new logs decide alone.

The most likely standard parameters, given an identification θ̂_b of covariance Σ, are the conditional mean of the first
Gaussian,

    θ* = θ_URDF + P Kᵀ (K P Kᵀ + Σ)⁻¹ (θ̂_b − K θ_URDF).

Sources: Rasmussen and Williams 2006, Gaussian Processes for Machine Learning, appendix A.2; Gautier and Venture 2013,
"Identification of standard dynamic parameters of robots with positive definite inertia matrix", IEEE/RSJ IROS.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy import linalg

from frischid.core.remembered import Remembered
from frischid.core.types import Array
from frischid.diagnosis.criteria import DIAGNOSIS_CRITERIA, DiagnosisCriteria
from frischid.effects import columns_of
from frischid.effects.dynamics import RigidDynamics, random_states
from frischid.estimators.least_squares import Prior
from frischid.estimators.urdf_prior import gaussian, link_spread
from frischid.model.model import Model
from frischid.regression.regressor import Regressor, nominal_parameters
from frischid.regression.structure import structure
from frischid.robot.stated_inertials import unstated

REGROUPING_ROUNDING = 1e-9  # of a row's length times a column's, below which their scalar product is rounding
PRECISION_ROUNDING = 1e-12  # share of the diagonal of a precision that is added
LEAST_MODEL_SHARE = 1e-6  # against division by zero: of a perfect log
_UNSTATED = 10.0  # N·m (N): torque limit of a robot whose URDF states none
_STATES = 16  # random configurations from which a joint's typical inertia is taken


def prior_before_change(model: Model) -> Prior:
    """The identification as the prior of a robot that changed afterwards, with its error on another motion."""
    share = 1.0 if model.fitted is None else float(model.fitted.model_share.mean())
    return Prior(model.estimate.theta, model.estimate.information / max(share, LEAST_MODEL_SHARE))


def evidence_prior(prior: Prior, information: Array) -> Prior:
    """Prior under which the squared residual of a fit is the evidence, as the module's text explains.

    Parameters
    ----------
    prior : Prior
        Of what was known before the change.
    information : ndarray, shape (p, p)
        Σ_j ω_j Y_jᵀY_j of the new logs.
    """
    scale = np.sqrt(np.diag(prior.precision))
    R = linalg.cholesky(prior.precision / np.outer(scale, scale) + PRECISION_ROUNDING * np.eye(len(scale)), lower=True)
    half = linalg.solve_triangular(R, information / np.outer(scale, scale), lower=True)
    d, Q = linalg.eigh(linalg.solve_triangular(R, half.T, lower=True))
    stronger = 1.0 + np.sqrt(1.0 + np.maximum(d, 0.0))  # d / (√(1 + d) − 1)
    S = scale[:, None] * (R @ Q)
    return Prior(prior.mean, np.asarray((S * stronger) @ S.T))


def weak_urdf_prior(model: Model, criteria: DiagnosisCriteria = DIAGNOSIS_CRITERIA) -> Prior:
    """Weak URDF prior of the base parameters, for a robot that has not changed since it was identified."""
    mapping, mean, spread = _standard(model, criteria)
    return gaussian(mapping @ mean, mapping * spread)


def likely_standard_parameters(model: Model, criteria: DiagnosisCriteria = DIAGNOSIS_CRITERIA) -> Mapping[str, float]:
    """Standard parameters closest to the URDF's that agree with the identified base parameters.

    Returns
    -------
    dict of str to float
        Parameter -> value, for every column of the model's regressor.
    """
    mapping, mean, spread = _standard(model, criteria)
    carried = mapping * spread**2
    S = carried @ mapping.T + model.estimate.covariance
    scale = np.sqrt(np.diag(S))
    factor = linalg.cho_factor(S / np.outer(scale, scale) + 1e-9 * np.eye(len(S)))
    gain = linalg.cho_solve(factor, (model.estimate.theta - mapping @ mean) / scale) / scale
    names = (c.name for c in columns_of(model.robot, model.effects))
    return dict(zip(names, map(float, mean + carried.T @ gain), strict=True))


def load_reference(model: Model, criteria: DiagnosisCriteria = DIAGNOSIS_CRITERIA) -> Mapping[str, float] | None:
    """Parameters that give the load to effects that depend on the load: the model's reference, or the likely ones."""
    if model.reference is None and not any(effect.loaded for effect in model.effects):
        return likely_standard_parameters(model, criteria)
    return model.reference


def _standard(model: Model, criteria: DiagnosisCriteria) -> tuple[Array, Array, Array]:
    """Regrouping (p, C) of the model's base parameters, and the URDF's value and spread of every column (C,)."""
    return _STANDARD.of(model, criteria, lambda: _regrouped(model, criteria))


_STANDARD = Remembered[tuple[Array, Array, Array]]()


def _regrouped(model: Model, criteria: DiagnosisCriteria) -> tuple[Array, Array, Array]:
    regressor = Regressor(model.robot, model.effects, model.reference)
    mapping = _regrouping(model, regressor)
    nominal = np.asarray(nominal_parameters(model.robot, model.effects))
    return mapping, nominal, _spread(model, regressor, mapping, criteria)


def _regrouping(model: Model, regressor: Regressor) -> Array:
    """Regrouping (p, C) of all parameters into the model's base parameters.

    A model without the rows of a joint that never moves keeps the base parameters of all rows; so the robot's rows are
    tried after the model's. A model with columns of a change has base parameters that no regrouping would choose.
    """
    mappings = []
    for joints in dict.fromkeys((model.joints, model.robot.joints)):
        found = structure(regressor, joints)
        if found.base == model.base:
            return found.mapping
        mappings.append(found.mapping)
    mapping = max(mappings, key=lambda m: int(np.linalg.matrix_rank(m[:, model.base])))
    inverse: Array = np.asarray(np.linalg.pinv(mapping[:, model.base]), dtype=np.float64)
    regrouped: Array = inverse @ mapping
    sizes = np.outer(np.linalg.norm(inverse, axis=1), np.linalg.norm(mapping, axis=0))
    part = np.abs(regrouped) > REGROUPING_ROUNDING * sizes  # a rounding error is no part of a base parameter
    return np.where(part, regrouped, 0.0)


def _spread(model: Model, regressor: Regressor, mapping: Array, criteria: DiagnosisCriteria) -> Array:
    """Standard deviation of each parameter from the URDF's value."""
    effort = model.robot.limits.effort[np.isfinite(model.robot.limits.effort)]
    largest = float(effort.max(initial=0.0)) or _UNSTATED
    others = np.full(len(regressor.columns), criteria.friction_prior_factor * largest)
    rotors = np.array([c.effect == "rotor_inertia" for c in regressor.columns], bool)
    identified = _identified(model, mapping)
    others[rotors] = np.maximum(_inertia(model), identified[rotors])
    links = link_spread(regressor)
    if unstated(model.robot):
        links = np.maximum(links, identified)
    return np.where(np.isnan(links), others, links)


def _inertia(model: Model) -> float:
    """Largest typical inertia of the links about a joint, kg·m² (kg): most rotors have less."""
    slopes = RigidDynamics.of(model.robot, None).slopes(*random_states(model.robot, _STATES))
    return float(np.abs(np.einsum("njj->nj", slopes.acceleration)).mean(axis=0).max()) + 1e-9


def _identified(model: Model, mapping: Array) -> Array:
    """Largest value (C,) that each parameter can have by what was identified: that of a base parameter it is part of.

    Behind a high gear, a rotor has hundreds of times the inertia of the links. And a URDF may not say what its links
    weigh.
    """
    share = np.abs(mapping)
    values = np.abs(model.estimate.theta)[:, None] / np.where(share > 0, share, np.inf)
    return np.asarray(values.max(axis=0, initial=0.0))
