"""The noise floor: what the sensors alone leave of a model's error."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import lfilter

from frischid.effects import parse_effects
from frischid.logs.filters import LowPass, noise_level
from frischid.logs.log import Log
from frischid.logs.preprocessing import prepare
from frischid.model.comparison import compare
from frischid.model.identification import identify
from frischid.model.noise_floor import NoiseFloor, octaves_above, sampled_jumps, torque_noise
from frischid.model.noisy_motion import _encoder_step
from frischid.motions.simulation import Noise, simulate
from frischid.motions.trajectory import random_fourier
from frischid.robot.robot import Robot

STEP, LOWPASS = 0.004, LowPass(5.0)
T = STEP * np.arange(15_000)
MOTION = 20 * np.sin(2 * np.pi * 0.3 * T) + 5 * np.sign(np.sin(2 * np.pi * 0.4 * T))  # gravity, and dry friction
FRICTION = {"fv": 0.5, "fc": 1.0, "off": 0.2, "Ia": 0.1}


def level_within(x, direction, step, lowpass):
    return torque_noise(x, octaves_above(x, direction, step, lowpass), lowpass)


def level(x, lowpass=LOWPASS):
    """Level of one channel."""
    direction = np.sign(np.sin(2 * np.pi * 0.4 * T[: len(x)]))
    return level_within(x[:, None], direction[:, None], STEP, lowpass)[0]


@given(st.floats(1e-3, 1.0), st.integers(0, 1000))
def test_white_noise_is_measured_beside_a_motion(size, seed):
    noise = size * np.random.default_rng(seed).normal(size=len(T))
    assert level(MOTION + noise) == pytest.approx(size, rel=0.25)


def test_noise_with_a_memory_is_measured_where_the_filter_passes():
    noise = lfilter([1.0], [1.0, -0.7], np.random.default_rng(1).normal(size=len(T)))
    taps = LOWPASS.taps(STEP)
    passed = np.convolve(noise, taps, "valid").std()
    assert level(MOTION + noise) * np.linalg.norm(taps) == pytest.approx(passed, rel=0.15)
    assert noise_level(noise) * np.linalg.norm(taps) < 0.5 * passed  # as white noise it would be far too small


@pytest.mark.parametrize("ripple", [0.5, 2.0, 50.0])
def test_ripple_of_any_size_raises_the_noise_only_as_far_as_the_other_octaves_allow(ripple):
    noise = 0.1 * np.random.default_rng(4).normal(size=len(T))
    assert level(MOTION + noise + ripple * np.sin(2 * np.pi * 11.0 * T)) < 0.6  # in its octave it is 5 ripple


@pytest.mark.parametrize("height", [0.0, 3.0, 30.0])
def test_jumps_between_two_samples_are_measured_beside_noise_and_motion(height):
    rng = np.random.default_rng(6)
    jumps = np.cumsum(height * rng.choice([-1.0, 1.0], len(T)) * (np.arange(len(T)) % 250 == 0))
    x = 20 * np.sin(2 * np.pi * 0.3 * T) + jumps + 0.1 * rng.normal(size=len(T))
    measured = sampled_jumps(x[:, None], np.ones((len(T), 1)))[0]
    assert measured == pytest.approx(height**2 / 250, rel=0.05, abs=1e-3)


def test_a_jump_of_dry_friction_at_a_reversal_does_not_count():
    direction = np.sign(np.sin(2 * np.pi * 0.4 * T))[:, None]
    assert sampled_jumps(5 * direction, direction)[0] == pytest.approx(0.0, abs=1e-12)


def test_without_a_filter_or_with_few_samples_all_noise_counts():
    noise = np.random.default_rng(2).normal(size=200)
    assert level(noise, LowPass(None)) == noise_level(noise)
    assert level(noise[:30]) == noise_level(noise[:30])


@pytest.mark.parametrize("rounding", [0.0, 1e-16])
def test_a_drive_that_is_quiet_at_rest_is_as_noisy_in_motion_as_it_is(rounding):
    rng, rests = np.random.default_rng(3), T % 20 > 8
    path = np.cumsum(np.where(rests, 0.0, np.sin(2 * np.pi * 0.25 * T)))[:, None] * STEP
    noise = np.where(rests, 0.01, 1.0) * rng.normal(size=len(T))
    seen = prepare(Log(T, ("joint",), path, tau=(20 * np.cos(path[:, 0]) + noise)[:, None]), LOWPASS).motions[0]
    at_rest = rounding * rng.normal(size=seen.v.shape)  # its sign says nothing
    seen = replace(seen, v=np.where(seen.standstill, at_rest, seen.v))
    assert seen.standstill.mean() > 0.5
    assert level_within(seen.tau, seen.direction, STEP, LOWPASS)[0] == pytest.approx(1.0, rel=0.3)


ARMS = {
    "positions only": ("ur5", Noise(q=2e-5, tau=0.01), ()),
    "quantised": ("ur5", Noise(quantum=2e-4, tau=0.003), ()),
    "tachometers": ("panda", Noise(q=2e-5, v=0.01, tau=0.005), ("v",)),
    "accelerometers": ("ur5", Noise(q=1e-4, v=0.005, a=0.2, tau=0.005), ("v", "a")),
}


def logs_of(robot, noise, channels, count=2):
    """Logs of a robot whose dry friction changes sign at once, as a real one's does."""
    effects = parse_effects("viscous, coulomb(width=0.0002), offset, rotor_inertia")
    values = {f"{kind}{k}": size for k in robot.numbers.values() for kind, size in FRICTION.items()}
    motions = [random_fourier(robot, 20.0, seed=k) for k in range(count)]
    return [
        simulate(robot, m, rate=250, effects=effects, parameters=values, noise=noise, channels=channels, seed=k)
        for k, m in enumerate(motions)
    ]


@pytest.mark.parametrize("arm", ARMS)
def test_a_healthy_robots_error_is_the_floor(arm):
    name, noise, channels = ARMS[arm]
    robot = Robot.load(name) if name != "panda" else Robot.load(name, lock=["panda_finger_joint1"])
    fit, held_out = logs_of(robot, noise, channels)
    found = compare(identify(robot, [fit], recursion="none").model, [held_out])
    assert 0.8 < found.nrmse / found.noise_floor < 1.25


def test_the_floor_does_not_rise_with_what_the_model_misses():
    robot = Robot.load("ur5")
    fit, held_out = logs_of(robot, Noise(q=2e-5, tau=0.01), ())
    model = identify(robot, [fit], recursion="none").model
    missing = replace(held_out, tau=held_out.tau + 0.1 * held_out.tau.std(axis=0) * np.sin(3 * held_out.q))
    floors = []
    for log in (held_out, missing):
        noise = NoiseFloor(model)
        assert list(noise.watch(model.motions([log])))
        floors.append(noise.under(np.full(6, np.inf)))
    assert np.allclose(floors[1], floors[0], rtol=0.02)
    assert compare(model, [missing]).nrmse > 3 * compare(model, [missing]).noise_floor


def test_a_smooth_friction_has_a_lower_floor_than_a_sharp_one():
    robot = Robot.load("ur5")
    effects = parse_effects("viscous, coulomb(width=0.005), offset, rotor_inertia")
    values = {f"{kind}{k}": size for k in robot.numbers.values() for kind, size in FRICTION.items()}
    logs = [
        simulate(
            *(robot, random_fourier(robot, 20.0, seed=s)),
            **{"rate": 250, "effects": effects, "parameters": values, "channels": ("v",), "seed": s},
            noise=Noise(q=2e-5, v=1e-3, tau=0.003),
        )
        for s in range(2)
    ]
    model = identify(robot, logs[:1], recursion="none").model
    found, noise = compare(model, logs[1:]), NoiseFloor(model)
    assert list(noise.watch(model.motions(logs[1:])))
    smooth, sharp = (noise.under(np.full(6, x)) for x in (0.0, np.inf))
    assert (sharp > 1.2 * smooth).any()
    assert 0.8 < found.nrmse / found.noise_floor < 1.25


def test_of_many_motions_some_stand_for_the_rest():
    robot = Robot.load("planar2")
    log = simulate(robot, random_fourier(robot, 10.0, seed=1), rate=100, noise=Noise(q=2e-5, tau=0.01), channels=())
    model = identify(robot, [log], recursion="none").model
    motions = list(model.motions([log]))
    few, many = NoiseFloor(model), NoiseFloor(model)
    assert len(list(few.watch(motions))) == 1
    assert len(list(many.watch(100 * motions))) == 100
    assert many.samples == 18 * few.samples  # sixteen, the 32nd and the 64th
    assert np.allclose(many.under(np.ones(2)), few.under(np.ones(2)))


def test_positions_are_as_noisy_in_each_stretch_as_they_are():
    robot = Robot.load("ur5")

    def late(log, seed):
        """Each joint read up to a millisecond before or after its stamp."""
        shift = np.random.default_rng(seed).uniform(-1e-3, 1e-3, log.q.shape)
        return replace(log, q=log.q + shift * np.gradient(log.q, log.t, axis=0))

    logs = [late(log, seed) for seed, log in enumerate(logs_of(robot, Noise(tau=0.003), ()))]
    model = identify(robot, logs[:1], recursion="none", cutoff=5.0).model
    found = compare(model, logs[1:])
    assert all(0.7 < joint.nrmse / joint.noise_floor < 1.2 for joint in found.joints.values())


def test_positions_that_ring_out_at_rest_have_no_encoder_step():
    """A spline through the rest of a log without some rows: each is a quarter of the one before, down to 1e-310."""
    q = 1e-5 * (-0.268) ** np.arange(560.0)
    with np.errstate(all="raise", under="ignore"):
        assert _encoder_step(q) == 0.0
    assert _encoder_step(0.001 * np.round(300 * np.sin(T / 5))) == pytest.approx(0.001)


def test_a_coarse_torque_does_not_make_the_noise_of_another_joint_white():
    """Steps of 0.5 N·m leave no power in an octave: the other joint had a noise of 0.080 instead of 0.087 N·m."""
    x = lfilter([1], [1, -np.exp(-2 * np.pi * 20 / 500)], 0.02 * np.random.default_rng(0).normal(size=10_000))
    both = np.column_stack([x, np.round(2 * x) / 2])
    alone = level_within(both[:, :1], np.ones((len(x), 1)), 0.002, LowPass(5.0))
    assert level_within(both, np.ones_like(both), 0.002, LowPass(5.0))[0] == pytest.approx(alone[0])
