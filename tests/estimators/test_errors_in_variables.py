from functools import cache

import numpy as np
import pytest

import frischid as fr
from frischid.core.types import Column
from frischid.errors import IdentifiabilityError
from frischid.estimators.errors_in_variables import Samples, eiv
from frischid.estimators.state_samples import samples
from frischid.logs.filters import LowPass
from frischid.logs.preprocessing import Motion
from frischid.motions.simulation import parameters_of
from frischid.motions.trajectory import random_fourier
from frischid.regression.regressor import Regressor
from frischid.regression.structure import structure

NOTHING = LowPass(None)
LINE = (Column("k", "N·m/rad", "joint", "spring"),)


@cache
def planar():
    """Planar arm with friction, its base parameters, and 20 s of exact motion."""
    robot = fr.Robot.load("planar2", frames="far_end", known={"my1": 0.0, "my2": 0.0})
    effects = fr.parse_effects("viscous, coulomb(width=1e-6)")
    regressor = Regressor(robot, effects)
    reduction = structure(regressor, robot.joints)
    theta = parameters_of(robot, effects)
    t = np.arange(1001) / 50
    q, v, a = random_fourier(robot, 20.0, seed=1)(t)
    tau = np.einsum("ncj,c->nj", regressor(t, q, v, a), theta)
    return regressor, reduction, reduction.mapping @ theta, Motion(t, q, v, a, tau, np.zeros(q.shape, bool), "clean")


def estimate(sigma, seed=0, given=True, torque=1.0):
    """OLS and EIV of a noisy copy."""
    regressor, reduction, _, m = planar()
    rng = np.random.default_rng(seed)
    q, v, a, tau = (
        x + s * rng.normal(size=x.shape) for x, s in ((m.q, sigma), (m.v, 2 * sigma), (m.a, 2 * sigma), (m.tau, torque))
    )
    noisy = Motion(m.t, q, v, a, tau, m.standstill, "noisy")
    levels = {"q": sigma, "v": 2 * sigma, "a": 2 * sigma, "torque": torque} if given else None
    joints = regressor.robot.joints
    stretches = samples(regressor, [noisy], NOTHING, joints, reduction.base, sigma=levels)
    Y = regressor(m.t, q, v, a)[:, list(reduction.base)].transpose(0, 2, 1).reshape(-1, len(reduction.base))
    least = np.linalg.lstsq(Y, tau.ravel(), rcond=None)[0]
    return least, eiv(stretches, reduction.base_columns(), joints)


def spring(z, tau, sigma, sigma_tau):
    """A torque k·q measured with noise on both sides."""
    zero = np.zeros((len(z), 2))

    def columns(state):
        return np.stack([state[:, :1], np.zeros((len(state), 1))], axis=1)

    state = np.column_stack([z, zero])
    direction = np.array([[sigma, 0.0, 0.0]])
    return Samples(
        columns, state, columns(state), tau[:, None], np.ones((len(z), 1), bool), direction, np.ones(1),
        np.array([sigma_tau]), np.array([False]), torque_given=True,
    )  # fmt: skip


def test_a_straight_line_is_demings():
    rng = np.random.default_rng(0)
    true = rng.normal(size=4000)
    z, tau = true + 0.5 * rng.normal(size=4000), 2.0 * true + 0.7 * rng.normal(size=4000)
    found = eiv([spring(z, tau, 0.5, 0.7)], LINE, ["joint"], iterations=40)
    xx, xy, yy, ratio = z @ z, z @ tau, tau @ tau, (0.7 / 0.5) ** 2
    deming = (yy - ratio * xx + np.sqrt((yy - ratio * xx) ** 2 + 4 * ratio * xy**2)) / (2 * xy)
    assert found.theta[0] == pytest.approx(deming, rel=1e-6)
    assert abs(xy / xx - 2.0) > 0.3
    assert abs(found.theta[0] - 2.0) < 3 * found.stderr[0] < 0.15


def test_clean_data_give_the_truth():
    _, found = estimate(1e-9, torque=1e-9)
    np.testing.assert_allclose(found.theta, planar()[2], rtol=1e-6)
    assert found.estimator == "eiv"


def test_better_than_least_squares_when_sensors_are_noisy():
    theta = planar()[2]
    pairs = [estimate(0.05, seed) for seed in range(6)]
    least = np.sqrt(np.mean([(o - theta) ** 2 for o, _ in pairs], axis=0))
    errors = np.sqrt(np.mean([(e.theta - theta) ** 2 for _, e in pairs], axis=0))
    assert (errors / least).mean() < 0.7
    scores = np.array([(e.theta - theta) / e.stderr for _, e in pairs])
    assert np.abs(scores).max() < 4.5
    assert np.abs(scores.mean(axis=0)).max() < 1.8


def test_no_worse_where_they_are_not():
    theta = planar()[2]
    least, found = estimate(1e-3)
    assert np.abs(found.theta - least).max() < 0.3 * found.stderr.max()
    assert (np.abs(found.theta - theta) < 4 * found.stderr).all()


def test_noise_can_be_estimated():
    _, given = estimate(0.02)
    _, read = estimate(0.02, given=False)
    assert (np.abs(given.theta - read.theta) < 0.5 * given.stderr).all()


def test_what_the_sensors_do_not_explain_is_torque_noise():
    rng = np.random.default_rng(0)
    z = np.linspace(-1, 1, 2000)
    slow = 0.5 * np.sin(40 * z)
    data = spring(z + 1e-3 * rng.normal(size=2000), 2 * z + slow, 1e-3, 1e-3)
    unknown = Samples(**{**vars(data), "torque_given": False})
    found = eiv([unknown], LINE, ["joint"])
    assert 1 / np.sqrt(found.weights[0]) == pytest.approx(np.sqrt(np.mean(slow**2)), rel=0.1)
    assert "missing effect" in found.notes[0]


def test_rows_not_used_do_not_count():
    rng = np.random.default_rng(0)
    z = rng.normal(size=500)
    tau = 2 * z + 0.1 * rng.normal(size=500)
    spoiled = tau.copy()
    spoiled[100:200] = 1e3
    data = spring(z, spoiled, 1e-3, 0.1)
    data.used[100:200] = False
    assert eiv([data], LINE, ["joint"]).theta[0] == pytest.approx(2.0, abs=0.02)


def test_where_states_are_kept_changes_nothing(monkeypatch):
    _, here = estimate(0.02, given=False)
    monkeypatch.setattr("frischid.core.array_store.LIMIT", 0)
    _, there = estimate(0.02, given=False)
    np.testing.assert_array_equal(there.theta, here.theta)
    np.testing.assert_array_equal(there.covariance, here.covariance)


def test_the_length_of_stretches_changes_nothing(monkeypatch):
    _, long = estimate(0.02, given=False)
    monkeypatch.setattr("frischid.estimators.state_samples.STRETCH_SAMPLES", 1)
    monkeypatch.setattr("frischid.regression.regressor.Regressor.blocks.__defaults__", (50, True))
    _, short = estimate(0.02, given=False)
    np.testing.assert_allclose(short.theta, long.theta, rtol=1e-10)
    np.testing.assert_allclose(short.covariance, long.covariance, rtol=1e-7, atol=1e-12 * long.covariance.max())


def test_a_column_without_motion_is_named():
    data = spring(np.zeros(100), np.ones(100), 0.0, 1.0)
    with pytest.raises(IdentifiabilityError, match="never excites k"):
        eiv([data], LINE, ["joint"])


@pytest.mark.parametrize("estimator", ["eiv", "iv"])
def test_effects_may_read_further_channels(estimator):
    robot, plain = fr.Robot.load("planar2"), fr.parse_effects("viscous, offset")
    log = fr.simulate(robot, random_fourier(robot, 10.0, seed=1), rate=100.0, effects=plain, noise=fr.Noise(tau=0.05))
    warmth = 10.0 * np.sin(log.t)
    drift = 0.3 * warmth[:, None] * [1.0, 0.0]
    extra = {f"temperature_{n}": 25.0 + warmth for n in robot.joints}
    warm = fr.Log(log.t, log.joints, log.q, log.v, log.a, log.tau + drift, extra=extra)
    effects = fr.parse_effects("viscous, offset, torque_drift(by=temperature)")
    model = fr.identify(robot, [warm], effects=effects, estimator=estimator, recursion="none").model
    assert model.parameters["offT1"].value == pytest.approx(0.3, abs=0.03)
    assert model.parameters["offT2"].value == pytest.approx(0.0, abs=0.03)


def test_the_load_of_effects_is_that_of_the_reference():
    robot, effects = planar()[0].robot, fr.parse_effects("viscous, load_friction(width=0.1)")
    heavy = Regressor(robot, effects, {name: 3.0 * x for name, x in zip(robot.all_names, robot.nominal, strict=True)})
    (stretch, *_) = samples(heavy, [planar()[3]], NOTHING, robot.joints, range(len(heavy.columns)))
    np.testing.assert_allclose(stretch.columns(stretch.state), stretch.Y, rtol=1e-9, atol=1e-9)
