from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import frischid as fr
from frischid.errors import InputError
from frischid.estimators.instrumental_variables import _neighbour_taps, _simulated, _Torque, iv
from frischid.estimators.least_squares import ols
from frischid.logs.filters import LowPass
from frischid.logs.preprocessing import Motion
from frischid.motions.simulation import parameters_of
from frischid.motions.trajectory import random_fourier
from frischid.regression.accumulation import accumulate
from frischid.regression.regressor import Regressor
from frischid.regression.structure import structure

NOTHING = LowPass(None)


@cache
def planar():
    """Planar arm with friction, its base parameters, and 20 s of exact motion."""
    robot = fr.Robot.load("planar2")
    effects = fr.parse_effects("viscous, coulomb(width=0.01)")
    regressor = Regressor(robot, effects)
    reduction = structure(regressor, robot.joints)
    theta = parameters_of(robot, effects)
    trajectory = random_fourier(robot, 20.0, seed=1)
    t = np.arange(1001) / 50
    q, v, a = trajectory(t)
    tau = np.einsum("ncj,c->nj", regressor(t, q, v, a), theta)
    clean = Motion(t, q, v, a, tau, np.zeros(q.shape, bool), "clean")
    return regressor, reduction, reduction.mapping @ theta, clean, trajectory


def both(motion, lowpass=NOTHING, **options):
    """OLS and IV of a motion."""
    regressor, reduction, *_ = planar()
    grams = accumulate(regressor, [motion], lowpass, regressor.robot.joints)
    columns = reduction.base_columns()
    start = ols([replace(g.select(list(reduction.base)), columns=columns) for g in grams])
    return start, iv(regressor, [motion], lowpass, reduction.base, start, **options)


def noisy(sigma, seed):
    m, rng = planar()[3], np.random.default_rng(seed)
    q, v, a = (x + s * rng.normal(size=x.shape) for x, s in ((m.q, sigma), (m.v, 2 * sigma), (m.a, 20 * sigma)))
    return replace(m, q=q, v=v, a=a, tau=m.tau + rng.normal(size=m.tau.shape))


def test_clean_data_give_the_truth():
    theta, clean = planar()[2:4]
    for options in ({}, {"references": [planar()[4]]}):
        _, found = both(clean, **options)
        np.testing.assert_allclose(found.theta, theta, rtol=1e-6, atol=1e-6)
        assert found.estimator == "iv"


@pytest.mark.parametrize("recorded", [False, True])
def test_noise_of_the_acceleration_does_not_shrink_the_inertia(recorded):
    theta, trajectory = planar()[2], planar()[4]
    options = {"references": [trajectory]} if recorded else {}
    pairs = [both(noisy(0.02, seed), **options) for seed in range(5)]
    i = [c.name for c in planar()[1].base_columns()].index("Izz1R")
    shrunk = np.mean([o.theta[i] - theta[i] for o, _ in pairs])
    left = np.mean([e.theta[i] - theta[i] for _, e in pairs])
    assert abs(left) < 0.4 * abs(shrunk)
    scores = np.array([(e.theta - theta) / e.stderr for _, e in pairs])
    assert np.abs(scores).max() < 5


def test_filtered_logs_are_fine():
    theta, clean = planar()[2:4]
    _, found = both(clean, LowPass(6.0))
    np.testing.assert_allclose(found.theta, theta, rtol=0.02, atol=0.02)


@pytest.mark.parametrize("measured", [{"q": 1.0}, {"q": 1e-3, "v": 1e-2}, {"q": 1e-3, "v": 1e-2, "a": 0.1}])
def test_neighbours_predict_a_polynomial(measured):
    step, half = 0.02, 9
    x = np.arange(-half, half + 1) * step
    p = np.polynomial.Polynomial([0.3, -1.0, 2.0, 5.0, -3.0, 7.0])
    channels = {"q": p(x), "v": p.deriv(1)(x), "a": p.deriv(2)(x)}
    taps = _neighbour_taps(half, 0, step, measured)
    found = sum(taps[:, i] @ channels[c] for i, c in enumerate(measured))
    np.testing.assert_allclose(found, [0.3, -1.0, 4.0], rtol=1e-6)
    assert np.abs(taps[:, :, half]).max() < 1e-9 * np.abs(taps).max()


def test_the_true_model_follows_the_reference():
    regressor, reduction, theta, clean, _ = planar()
    found = _simulated(regressor, reduction.base, theta, clean)
    assert np.abs(found.q - clean.q).max() < 0.02 * np.ptp(clean.q)
    assert np.sqrt(np.mean((found.a - clean.a) ** 2)) < 0.05 * np.sqrt(np.mean(clean.a**2))


def test_the_last_second_ends_with_the_motion():
    """A last second of fewer samples had gone on at the last reference, and its end stood in the last row."""
    regressor, reduction, theta, clean, _ = planar()
    wrong, base = theta * np.linspace(0.8, 1.2, len(theta)), reduction.base
    whole = _simulated(regressor, base, wrong, clean)
    part = _simulated(regressor, base, wrong, clean.part(slice(0, 120)))
    np.testing.assert_allclose(part.a, whole.a[:120], atol=1e-9)
    np.testing.assert_allclose(part.q, whole.q[:120], atol=1e-12)


def test_mass_and_rest_make_the_torque():
    regressor, reduction, theta, clean, _ = planar()
    torque = torque_of(regressor, reduction, theta, clean)
    M, rest = torque.mass_and_rest(np.arange(len(clean.t)), clean.q, clean.v)
    np.testing.assert_allclose(np.einsum("nij,nj->ni", M, clean.a) + rest, clean.tau, atol=1e-9)
    assert (np.linalg.eigvalsh(M) > 0).all()


def torque_of(regressor, reduction, theta, motion):
    values = dict(zip((regressor.columns[k].name for k in reduction.base), theta, strict=True))
    return _Torque(regressor, values, motion)


def test_friction_that_leads_the_motion_is_no_inertia():
    regressor, reduction, theta, clean, _ = planar()
    leading = Regressor(regressor.robot, fr.parse_effects("viscous, coulomb(width=0.01, lead=0.02)"))
    at, still = np.arange(len(clean.t)), np.zeros_like(clean.v)
    plain, ahead = (
        torque_of(r, reduction, theta, clean).mass_and_rest(at, clean.q, still) for r in (regressor, leading)
    )
    np.testing.assert_allclose(ahead[0], plain[0], rtol=1e-12)


def test_an_impossible_model_falls_back_on_the_reference():
    regressor, reduction, theta, clean, _ = planar()
    assert _simulated(regressor, reduction.base, -theta, clean) is None


def test_what_cannot_be_used_is_said():
    clean, trajectory = planar()[3:5]
    with pytest.raises(InputError, match="2 references given for 1 motions"):
        both(clean, references=[trajectory, trajectory])
    part = slice(0, 15)
    names = ("t", "q", "v", "a", "tau", "standstill")
    short = replace(clean, **{n: getattr(clean, n)[part] for n in names})
    regressor, reduction, *_ = planar()
    start, _ = both(clean)
    with pytest.raises(InputError, match="too few to make a reference"):
        iv(regressor, [short], NOTHING, reduction.base, start)
