"""What is believed before logs are diagnosed: the URDF weakly, or an identification, and what it leaves possible.

    θ ~ N(θ_URDF, P),   P = diag(spread²);      base parameters θ_b = K θ ~ N(K θ_URDF, K P Kᵀ)

and what standard parameters to believe once the base parameters are identified with covariance Σ, the others being
none of the data's business (the conditional mean of a Gaussian):

    θ* = θ_URDF + P Kᵀ (K P Kᵀ + Σ)⁻¹ (θ_b − K θ_URDF).

Sources: Rasmussen and Williams 2006, Gaussian Processes for Machine Learning, appendix A.2; Gautier and Venture 2013,
"Identification of standard dynamic parameters of robots with positive definite inertia matrix", IEEE/RSJ IROS.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy import linalg

from frischid.core.types import Array
from frischid.effects import columns_of
from frischid.effects.dynamics import RigidDynamics, random_states
from frischid.estimators.least_squares import Prior
from frischid.estimators.urdf_prior import gaussian, link_spread
from frischid.model.model import Model
from frischid.regression.regressor import Regressor, nominal_parameters
from frischid.regression.structure import structure

ANYTHING = 10.0  # friction may be so many times the largest torque: nothing is known of it


def identified(model: Model) -> Prior:
    """The identification itself, for a robot that may have changed since."""
    return Prior(model.estimate.theta, model.estimate.information)


def nominal(model: Model) -> Prior:
    """A weak belief in the URDF."""
    mapping, mean, spread = _standard(model)
    return gaussian(mapping @ mean, mapping * spread)


def believed(model: Model) -> Mapping[str, float]:
    """Standard parameters closest to the URDF's that the identified base parameters leave possible.

    Returns
    -------
    dict of str to float
        Parameter -> value, for every column of the model's regressor.
    """
    mapping, mean, spread = _standard(model)
    carried = mapping * spread**2
    S = carried @ mapping.T + model.estimate.covariance
    scale = np.sqrt(np.diag(S))
    factor = linalg.cho_factor(S / np.outer(scale, scale) + 1e-9 * np.eye(len(S)))
    gain = linalg.cho_solve(factor, (model.estimate.theta - mapping @ mean) / scale) / scale
    names = (c.name for c in columns_of(model.robot, model.effects))
    return dict(zip(names, map(float, mean + carried.T @ gain), strict=True))


def reference_of(model: Model) -> Mapping[str, float] | None:
    """What effects that depend on the load are to take it from: what the model was made with, or what it found."""
    if model.reference is None and not any(effect.loaded for effect in model.effects):
        return believed(model)
    return model.reference


def _standard(model: Model) -> tuple[Array, Array, Array]:
    """Regrouping (p, C) of the model's base parameters, and the URDF's value and spread of every column (C,)."""
    regressor = Regressor(model.robot, model.effects, model.reference)
    found = structure(regressor, model.joints)
    mapping = found.mapping
    if found.base != model.base:  # columns taken in by hand, of a change
        mapping = np.linalg.pinv(mapping[:, model.base]) @ mapping
    return mapping, np.asarray(nominal_parameters(model.robot, model.effects)), _spread(model, regressor)


def _spread(model: Model, regressor: Regressor) -> Array:
    """How far each parameter may be from the URDF's."""
    effort = model.robot.limits.effort[np.isfinite(model.robot.limits.effort)]
    others = np.full(len(regressor.columns), ANYTHING * max(float(effort.max(initial=0.0)), 10.0))
    others[[c.effect == "rotor_inertia" for c in regressor.columns]] = _inertia(model)
    links = link_spread(regressor)
    return np.where(np.isnan(links), others, links)


def _inertia(model: Model) -> float:
    """Largest typical inertia of the links about a joint, kg·m² (kg): no rotor is likely to weigh much more."""
    slopes = RigidDynamics.of(model.robot, None).slopes(*random_states(model.robot, 16))
    return float(np.abs(np.einsum("njj->nj", slopes.acceleration)).mean(axis=0).max()) + 1e-9
