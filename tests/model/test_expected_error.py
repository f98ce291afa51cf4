"""The error to expect on a log: over the samples in which a joint moves, and how much of them was never fitted."""

from types import SimpleNamespace

import numpy as np
import pytest

from frischid.effects import BASELINE, parse_effects
from frischid.model.expected_error import SAMPLES, ExpectedError
from frischid.model.identification import identify
from frischid.motions.simulation import Noise, simulate
from frischid.motions.trajectory import random_fourier
from frischid.robot.robot import Robot


def model(variance=4.0, velocity=1.0, acceleration=10.0, sigma=1.0, share=1.0):
    """A model of two joints whose expected squared error is the same everywhere."""
    reach = SimpleNamespace(
        velocity=np.full(2, velocity), acceleration=np.full(2, acceleration), model_share=np.full(2, share)
    )
    estimate = SimpleNamespace(
        error_variance=lambda Y: np.full((len(Y), Y.shape[2]), variance), sigma=np.full(2, sigma)
    )
    return SimpleNamespace(
        joints=("one", "two"), torque_index=np.array([0, 1]), base=(0,), estimate=estimate, fitted=reach
    )


def block(used, v=0.5, a=1.0):
    shape = np.shape(used)
    return SimpleNamespace(
        t=np.arange(shape[0]) / 10, Z=np.ones((shape[0], 7, 2)), used=np.array(used), v=np.full(shape, v),
        a=np.full(shape, a),
    )  # fmt: skip


def test_samples_at_standstill_do_not_count():
    used = np.array([[True, True], [False, True]] * 20)
    expected = ExpectedError(model())
    expected.add(block(used))
    expected.add(block(~used))
    np.testing.assert_allclose(expected.rms, 2.0)


def test_the_part_that_is_noise_averages_out():
    expected = ExpectedError(model(variance=4.0, sigma=1.0, share=0.25))
    expected.add(block(np.ones((20, 2), bool)))
    np.testing.assert_allclose(expected.rms**2, 1.0 + 0.25 * 3.0)


@pytest.mark.parametrize(("missing", "low", "high"), [("", 0.0, 0.4), ("joint_spring", 0.9, 1.0)])
def test_the_share_that_is_the_models_error_is_measured(missing, low, high):
    """Noise alone leaves next to nothing; a missing effect leaves all."""
    robot = Robot.load("planar2")
    effects = (*BASELINE, *(parse_effects(missing) if missing else ()))
    motion = random_fourier(robot, 30.0, seed=1)
    log = simulate(
        robot, motion, rate=100.0, effects=effects, parameters={"ks1": 20.0, "ks2": 10.0} if missing else {},
        noise=Noise(tau=0.05), seed=1,
    )  # fmt: skip
    fitted = identify(robot, [log], recursion="none").model.fitted
    assert (fitted.model_share >= low).all()
    assert (fitted.model_share <= high).all()


@pytest.mark.parametrize(("v", "a", "share"), [(0.9, 9.0, 0.0), (-1.1, 1.0, 1.0), (0.5, -11.0, 1.0)])
def test_a_sample_is_outside_when_it_is_faster_or_accelerates_more(v, a, share):
    expected = ExpectedError(model())
    expected.add(block([[True, False]] * 10, v, a))
    np.testing.assert_array_equal(expected.outside_share, [share, 0.0])


def test_a_long_block_is_sampled_and_gives_the_same_mean():
    short, long = ExpectedError(model()), ExpectedError(model())
    short.add(block(np.ones((SAMPLES, 2), bool), v=2.0))
    long.add(block(np.ones((10 * SAMPLES, 2), bool), v=2.0))
    np.testing.assert_allclose(long.rms, short.rms)
    np.testing.assert_array_equal(long.outside_share, short.outside_share)
