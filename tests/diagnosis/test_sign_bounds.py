"""Known signs in the search: the fit of every candidate is that of a bounded least-squares solver."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear

import frischid as fr
from frischid.diagnosis.sign_bounds import multipliers
from frischid.diagnosis.situation import cross_validator
from frischid.effects import EFFECTS

KINDS = ("stribeck", "load_friction", "cogging", "hysteresis", "drive_gain", "asymmetric_viscous", "rotor_inertia")


@pytest.fixture(scope="module")
def validator():
    """A robot with a strong Stribeck peak and hardly any viscous friction: without signs, fv1 is far below zero."""
    machine = fr.Robot.load("planar2")
    hidden = (*fr.BASELINE, *fr.parse_effects("stribeck@joint1"))
    values = {"fs1": 2.0, "fv1": 0.01, "fv2": 0.05, "fc1": 0.1, "fc2": 0.1}
    noise = fr.Noise(q=1e-5, tau=0.05)
    logs = [
        fr.simulate(
            machine, fr.random_fourier(machine, 12, seed=s), rate=100, effects=hidden, parameters=values, noise=noise
        )
        for s in (1, 2)
    ]
    return cross_validator(fr.identify(machine, logs, recursion="none").model, logs)[0]


def solved(validator, candidate, left_out):
    """Least cost, its parameters, and the cost, by a general solver on the whole normal equations."""
    wider = validator.columns.extended(candidate)
    p, k = validator.columns.width, len(candidate.signs)
    train = [f for f in range(validator.data.folds) if f != left_out]
    M = np.einsum("j,fjab->ab", validator.fit.omega, wider.gram[train])
    H, b = M[:-1, :-1].copy(), M[:-1, -1].copy()
    H[:p, :p] += validator.fit.prior.precision
    b[:p] += validator.fit.prior.precision @ validator.fit.prior.mean
    scale = 1 / np.sqrt(np.diag(H))
    L = np.linalg.cholesky(H * np.outer(scale, scale) + 1e-11 * np.eye(p + k))
    low, high = np.where(wider.signs > 0, 0.0, -np.inf), np.where(wider.signs < 0, 0.0, np.inf)
    x = lsq_linear(L.T, np.linalg.solve(L, b * scale), (low, high), method="bvls", tol=1e-14).x * scale
    return x, lambda y: y @ H @ y - 2 * b @ y


def test_friction_of_the_model_alone_is_not_negative(validator):
    free, theta = validator.fit.systems[-1].free, validator.theta
    names = [c.name for c in validator.model.estimate.columns]
    assert free[names.index("fv1")] < -0.1
    assert (theta * validator.columns.signs > -1e-6).all()
    assert validator.fit.systems[-1].rise > 0


@pytest.mark.parametrize("name", KINDS)
def test_every_candidate_has_the_best_fit_of_possible_signs(validator, name):
    effects = [e for shapes in EFFECTS[name].candidates(validator.model.robot) for e in shapes[:3]]
    tried = 0
    for candidate in validator.candidates(effects):
        for left_out in (None, 0):
            fit = validator.fitted(candidate, left_out)
            if fit is None:
                continue
            x, cost = solved(validator, candidate, left_out)
            base = validator.fit.systems[-1 if left_out is None else left_out].theta
            mine = np.append(base + fit.change, fit.beta)
            fall = cost(np.append(base, np.zeros(len(fit.beta)))) - cost(x)
            assert cost(mine) - cost(x) == pytest.approx(0.0, abs=1e-4 * (1 + fall))
            assert fit.gain == pytest.approx(fall, abs=1e-4 * (1 + fall))
            tried += 1
    assert tried


def test_a_candidate_that_was_added_keeps_its_sign(validator):
    (stribeck,) = validator.candidates([EFFECTS["stribeck"](("joint1",))])
    wider = validator.extended(stribeck)
    assert wider.theta[-1] > 1.0
    assert wider.columns.signs[-1] == 1
    assert wider.theta[[c.name for c in validator.model.estimate.columns].index("fv1")] >= -1e-6


def test_a_model_without_a_prior_was_fitted_without_signs():
    machine = fr.Robot.load("planar2")
    log = fr.simulate(machine, fr.random_fourier(machine, 12, seed=1), rate=50, noise=fr.Noise(q=1e-5, tau=0.05))
    model = fr.identify(machine, [log], prior="none", recursion="none").model
    assert not cross_validator(model, [log])[0].columns.signs.any()


def test_two_parameters_that_the_data_cannot_tell_apart():
    z, C = np.array([-1.0, -1.0]), np.array([[1.0, -1.0], [-1.0, 1.0]]) + 1e-3
    x = z + C @ multipliers(z, C, np.array([1, 1]))
    assert (x > -1e-4).all()
