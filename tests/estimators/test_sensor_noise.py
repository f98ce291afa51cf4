from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import frischid as fr
from frischid.errors import InputError
from frischid.estimators.sensor_noise import Probe, moved, noise_levels, sensor_moments, sensors_of
from frischid.estimators.state_samples import samples
from frischid.logs.filters import LowPass
from frischid.logs.log import Log
from frischid.logs.preprocessing import Motion, prepare
from frischid.motions.trajectory import random_fourier
from frischid.regression.accumulation import accumulate
from frischid.regression.regressor import Regressor
from frischid.regression.structure import structure

NOTHING = LowPass(None)


@cache
def planar():
    """Regressor, base columns, and 20 s of motion of the planar arm."""
    robot = fr.Robot.load("planar2")
    regressor = Regressor(robot, fr.parse_effects("viscous, coulomb(width=1e-6)"))
    base = structure(regressor, robot.joints).base
    t = np.arange(1001) / 50
    q, v, a = random_fourier(robot, 20.0, seed=1)(t)
    tau = np.einsum("ncj,c->nj", regressor(t, q, v, a), regressor.reference)
    return regressor, base, Motion(t, q, v, a, tau, np.zeros(q.shape, bool), "clean")


def derived(channels=()):
    """The same motion as a log that lacks some channels, prepared with a low-pass."""
    regressor, _, m = planar()
    kept = {c: getattr(m, c) for c in channels}
    lowpass = LowPass(5.0)
    log = Log(m.t, regressor.robot.joints, m.q, tau=m.tau, source="log", notes=(), **kept)
    return prepare(log, lowpass, velocity="measured" if "v" in channels else "derived").motions[0], lowpass


def moments(motion, lowpass=NOTHING):
    regressor, base, _ = planar()
    grams = accumulate(regressor, [motion], lowpass, regressor.robot.joints)
    return sum(g.select(list(base)).weighted() for g in grams)


@pytest.mark.parametrize(
    ("channels", "expected"),
    [
        (("v", "a"), {"q": "q", "v": "v", "a": "a"}),
        (("v",), {"q": "q", "v": "va"}),
        ((), {"q": "qva"}),
    ],
)
def test_channels_are_traced_to_their_sensors(channels, expected):
    motion, lowpass = derived(channels)
    found = {s.name: "".join(s.taps) for s in sensors_of(motion, planar()[0].robot, lowpass)}
    assert found == {f"{c} {j}": taps for j in ("joint1", "joint2") for c, taps in expected.items()}


def test_acceleration_enters_linearly():
    regressor, base, m = planar()
    data = sensor_moments(regressor, [m], NOTHING, regressor.robot.joints, base)
    s = data.sensors.index("a joint2")
    slope = regressor(m.t, m.q, m.v, m.a + np.array([0.0, 1.0])) - regressor(m.t, m.q, m.v, m.a)
    slope = np.concatenate([slope[:, list(base)], np.zeros((len(m.t), 1, 2))], axis=1)
    assert data.sensors[-1] == "torque"
    np.testing.assert_allclose(data.noise[s].sum(axis=0), np.tensordot(slope, slope, ([0, 2], [0, 2])), atol=1e-6)
    np.testing.assert_allclose(data.moments.sum(axis=0), moments(m))
    assert data.noise[-1, :, -1, -1].sum() == 2 * len(m.t)


def test_square_of_a_sign_has_no_noise():
    regressor, base, m = planar()
    turning = replace(m, v=m.v + 1e-4)  # at rest the sign would be zero
    data = sensor_moments(regressor, [turning], NOTHING, regressor.robot.joints, base)
    fc = data.names.index("fc1")
    assert np.abs(data.noise[:, :, fc, fc]).max() < 1e-6


@pytest.mark.parametrize("sensor", ["q joint1", "v joint2"])
def test_noise_adds_what_is_predicted(sensor):
    regressor, base, m = planar()
    data = sensor_moments(regressor, [m], NOTHING, regressor.robot.joints, base, probe=Probe(step=0.01))
    owner = next(s for s in sensors_of(m, regressor.robot, NOTHING) if s.name == sensor)
    sigma, rng = 0.03, np.random.default_rng(0)
    added = []
    for _ in range(15):
        errors = sigma * rng.normal(size=len(m.t))
        added += [moments(moved(m, owner, e)) - moments(m) for e in (errors, -errors)]
    smooth = [i for i, n in enumerate(data.names) if not n.startswith("fc")] + [len(data.names)]
    predicted = sigma**2 * data.noise[data.sensors.index(sensor)].sum(axis=0)[np.ix_(smooth, smooth)]
    found = np.mean(added, axis=0)[np.ix_(smooth, smooth)]
    assert np.abs(found - predicted).max() < 0.1 * np.abs(predicted).max()


def test_derived_and_filtered_noise_is_followed_through_the_pipeline():
    regressor, base, _ = planar()
    motion, lowpass = derived()
    data = sensor_moments(regressor, [motion], lowpass, regressor.robot.joints, base, probe=Probe(repeats=4))
    owner = sensors_of(motion, regressor.robot, lowpass)[0]
    sigma, rng, added = 1e-3, np.random.default_rng(0), []
    reach = max(len(t) for t in owner.taps.values()) // 2
    for _ in range(30):
        errors = sigma * rng.normal(size=len(motion.t) + 2 * reach)
        added += [moments(moved(motion, owner, e), lowpass) for e in (errors, -errors)]
    found = np.mean(added, axis=0) - moments(motion, lowpass)
    i = data.names.index("Izz1")
    assert found[i, i] == pytest.approx(sigma**2 * data.noise[0].sum(axis=0)[i, i], rel=0.15)


def test_states_know_the_covariance_of_their_errors():
    regressor, base, _ = planar()
    motion, lowpass = derived()
    plan = (lowpass, regressor.robot.joints, base)
    found = list(samples(regressor, [motion], *plan, sigma={"q": 1e-3, "torque": 1.0}))
    owner = sensors_of(motion, regressor.robot, lowpass)[0]
    reach = max(len(t) for t in owner.taps.values()) // 2
    errors = 1e-3 * np.random.default_rng(0).normal(size=len(motion.t) + 2 * reach)
    noisy = list(samples(regressor, [moved(motion, owner, errors)], *plan, sigma={"q": 1e-3}))
    change = np.concatenate([n.state - f.state for n, f in zip(noisy, found, strict=True)])[:, [0, 2, 4]]
    directions = found[0].directions[:, [0, 2, 4]]
    expected = np.sqrt(np.diag(directions.T @ directions))
    np.testing.assert_allclose(change.std(axis=0), expected, rtol=0.25)
    assert found[0].torque_given
    assert not noisy[0].torque_given


def test_noise_levels_are_read_off_the_log():
    regressor, base, m = planar()
    rng = np.random.default_rng(0)
    levels = noise_levels([replace(m, q=m.q + 0.01 * rng.normal(size=m.q.shape))], regressor.robot, NOTHING)
    assert levels["q joint1"] == pytest.approx(0.01, rel=0.1)
    assert levels["v joint1"] < 1e-3
    with pytest.raises(InputError, match="sensors of this log are q joint1"):
        samples(regressor, [m], NOTHING, regressor.robot.joints, base, sigma={"w": 1.0})


def test_motions_are_gone_through_one_at_a_time():
    """Moments of the sensors' noise need no list of motions, and are the same without one."""

    class Passing:
        def __iter__(self):
            return iter(motions)

        def __len__(self):
            raise AssertionError("nobody needs to know how many there are")

    regressor, base, motion = planar()
    motions = [motion, motion]
    joints = regressor.robot.joints
    held, passing = (sensor_moments(regressor, m, NOTHING, joints, base) for m in (motions, Passing()))
    np.testing.assert_array_equal(held.noise, passing.noise)
    np.testing.assert_array_equal(held.moments, passing.moments)
