import numpy as np
import pytest
from cases import EFFECT_CASES, Reference, exact_log, robot

from frischid.effects import parse_effects
from frischid.errors import InputError, UnknownNameError
from frischid.motions.simulation import Noise, parameters_of, simulate, torque
from frischid.motions.trajectory import Quintic, random_fourier
from frischid.regression.regressor import Regressor

PLANAR = robot("planar2")
MOTION = random_fourier(PLANAR, 10.0, seed=1)


def test_without_effects_the_torque_is_inverse_dynamics():
    for name in ("ur10", "kinova continuous", "mixed mimic"):
        machine = robot(name)
        log = exact_log(machine, (), seconds=1.0, rate=20.0)
        np.testing.assert_allclose(log.tau, Reference(machine)(log.q, log.v, log.a), atol=1e-9)


def test_motion_is_the_trajectory():
    log = simulate(PLANAR, MOTION, rate=50.0)
    assert len(log) == 501
    np.testing.assert_allclose(log.t, np.arange(501) / 50)
    for x, y in zip((log.q, log.v, log.a), MOTION(log.t), strict=True):
        np.testing.assert_array_equal(x, y)
    points = Quintic(np.array([0.0, 1.0]), *np.random.default_rng(0).normal(size=(3, 2, 2)))
    assert len(simulate(PLANAR, points, rate=100.0)) == 101


def test_the_urdf_says_friction():
    names = [*PLANAR.all_names, "fv1", "fv2", "fc1", "fc2"]
    theta = dict(zip(names, parameters_of(PLANAR, parse_effects("viscous,coulomb")), strict=True))
    assert [theta[k] for k in ("fv1", "fv2", "fc1", "fc2")] == [0.1434, 0.1391, 0.3302, 0.3576]
    bare, rubbing = (simulate(PLANAR, MOTION, rate=50.0, effects=e) for e in ((), parse_effects("viscous,coulomb")))
    expected = bare.v * [0.1434, 0.1391] + np.tanh(bare.v / 0.005) * [0.3302, 0.3576]
    np.testing.assert_allclose(rubbing.tau - bare.tau, expected, atol=1e-10)


def test_values_replace_the_urdfs():
    effects = parse_effects("viscous,offset")
    bare = simulate(PLANAR, MOTION, rate=50.0, effects=effects, parameters={"fv1": 0.0, "fv2": 0.0})
    more = simulate(
        PLANAR, MOTION, rate=50.0, effects=effects, parameters={"fv1": 2.0, "fv2": 0.0, "off2": -3.0, "Izz2": 1.0}
    )
    usual = parameters_of(PLANAR, effects)[PLANAR.all_names.index("Izz2")]
    total = bare.a.sum(axis=1, keepdims=True) * (1.0 - usual)
    np.testing.assert_allclose(
        more.tau - bare.tau, np.c_[2.0 * bare.v[:, 0], np.full(len(bare), -3.0)] + total, atol=1e-9
    )


def test_friction_feels_the_load_of_the_simulated_links():
    """It had felt the URDF's links, whatever the values given."""
    machine, motion = robot("planar2"), random_fourier(robot("planar2"), 5.0, seed=0)
    heavy = {"mx2": 3 * float(machine.nominal[machine.all_names.index("mx2")])}
    bare = simulate(machine, motion, rate=100.0, effects=(), parameters=heavy)
    rubbing = parse_effects("load_friction(width=0.01)")
    log = simulate(machine, motion, rate=100.0, effects=rubbing, parameters=heavy | {"fl1": 0.2, "fl2": 0.1})
    friction = np.array([0.2, 0.1]) * np.abs(bare.tau) * np.tanh(bare.v / 0.01)
    np.testing.assert_allclose(log.tau, bare.tau + friction, atol=1e-9 * np.abs(bare.tau).max())


def test_unknown_parameter():
    with pytest.raises(UnknownNameError, match=r"unknown parameter 'fv3'.*fv1"):
        simulate(PLANAR, MOTION, rate=50.0, parameters={"fv3": 1.0})


def test_a_parameter_or_a_channel_that_is_none_is_refused():
    """A torque of NaN in all rows would be a log without torque."""
    with pytest.raises(InputError, match="parameter fv1 must be a finite number, got nan"):
        simulate(PLANAR, MOTION, rate=50.0, parameters={"fv1": np.nan})
    with pytest.raises(UnknownNameError, match="unknown channel 'w'"):
        simulate(PLANAR, MOTION, rate=50.0, channels=("v", "w"))


def test_noise_has_the_asked_size():
    exact = simulate(PLANAR, MOTION, rate=500.0)
    noise = Noise(q=1e-3, v=2e-2, a=0.3, tau=0.1)
    noisy = simulate(PLANAR, MOTION, rate=500.0, noise=noise, seed=3)
    for channel in ("q", "v", "a"):
        error = getattr(noisy, channel) - getattr(exact, channel)
        np.testing.assert_allclose(error.std(axis=0), getattr(noise, channel), rtol=0.05)
    np.testing.assert_allclose((noisy.tau - exact.tau).std(axis=0), 0.1 * exact.tau.std(axis=0), rtol=0.05)
    # the motion is exact: the torque does not feel the sensors' noise
    sensors = simulate(PLANAR, MOTION, rate=500.0, noise=Noise(q=1e-3, v=2e-2, a=0.3))
    np.testing.assert_array_equal(sensors.tau, exact.tau)


def test_seed_makes_the_log():
    first, again, other = (simulate(PLANAR, MOTION, rate=50.0, noise=Noise(q=1e-3, tau=0.1), seed=s) for s in (1, 1, 2))
    np.testing.assert_array_equal(first.q, again.q)
    np.testing.assert_array_equal(first.tau, again.tau)
    assert not np.array_equal(first.q, other.q)


def test_quantisation():
    log = simulate(PLANAR, MOTION, rate=50.0, noise=Noise(quantum=0.01))
    np.testing.assert_allclose(log.q / 0.01, np.round(log.q / 0.01), atol=1e-9)
    assert np.abs(log.q - MOTION(log.t)[0]).max() <= 0.005 + 1e-12


def test_channels():
    assert simulate(PLANAR, MOTION, rate=50.0, channels=()).v is None
    only = simulate(PLANAR, MOTION, rate=50.0, channels=("v",))
    assert only.v is not None
    assert only.a is None
    assert "simulated, 501 samples at 50 Hz" in only.notes[0]


@pytest.mark.parametrize("rate", [0.0, -1.0, np.nan, np.inf])
def test_rate_must_be_positive(rate):
    with pytest.raises(InputError, match="rate must be a positive number"):
        simulate(PLANAR, MOTION, rate=rate)


@pytest.mark.parametrize("options", [{"q": -1.0}, {"tau": np.nan}, {"quantum": np.inf}])
def test_noise_must_be_a_size(options):
    with pytest.raises(InputError, match=f"noise {next(iter(options))}"):
        Noise(**options)


def test_a_motion_of_another_robot():
    with pytest.raises(InputError, match="moves 2 joints, ur10 has 6"):
        simulate(robot("ur10"), MOTION, rate=50.0)


@pytest.mark.parametrize("effect", EFFECT_CASES.values(), ids=EFFECT_CASES)
def test_long_motions_are_simulated_as_a_whole(effect):
    # whatever an effect remembers, and whenever it takes the log to begin, pieces must not show
    t = np.arange(4500) * 0.002
    q, v, a = MOTION(t)
    regressor = Regressor(PLANAR, (effect,))
    theta = np.linspace(1.0, 2.0, len(regressor.columns))
    expected = np.einsum("ncj,c->nj", regressor(t, q, v, a), theta)
    found = torque(PLANAR, (effect,), theta, t, q, v, a)
    np.testing.assert_allclose(found, expected, atol=1e-9 * np.abs(expected).max())
