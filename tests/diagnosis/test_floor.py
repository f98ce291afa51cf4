"""The noise floor of a diagnosis: slow noise of drives raises it, a missing effect does not; and the fit's weights."""

from functools import cache

import numpy as np
import pytest
from scipy.signal import lfilter

from frischid.diagnosis.cross_validation import CrossValidator
from frischid.diagnosis.floor import Floor
from frischid.diagnosis.situation import cross_validator
from frischid.diagnosis.slow_noise import slow_noise
from frischid.diagnosis.weighted_fit import WeightedFit
from frischid.effects import BASELINE, parse_effects
from frischid.estimators.least_squares import Prior
from frischid.logs.log import Log
from frischid.model.identification import identify
from frischid.motions.simulation import Noise, simulate
from frischid.motions.trajectory import random_fourier
from frischid.robot.robot import Robot

ARM = Robot.load("planar2")
RATE = 200.0


@cache
def logs_of(memory: float, effect: str = "") -> tuple[Log, ...]:
    """Two logs whose torque has noise of 2 % with a memory, s (0: white), and a spring on joint 2 if wanted."""
    found = []
    for seed in (1, 2):
        log = simulate(
            ARM,
            random_fourier(ARM, 20, seed=seed),
            rate=RATE,
            effects=(*BASELINE, *parse_effects(effect)),
            parameters={"fc1": 0.5, "fc2": 0.3, "fv1": 0.4, "fv2": 0.2} | ({"ks2": 2.0} if effect else {}),
            noise=Noise(q=1e-6, tau=0.0),
            channels=(),
            seed=seed,
            name=f"log {seed}",
        )
        x = np.random.default_rng(seed).normal(size=log.tau.shape)
        if memory:
            pole = np.exp(-1 / (RATE * memory))
            x = lfilter([np.sqrt(1 - pole**2)], [1, -pole], x, axis=0)
        found.append(Log(log.t, log.joints, log.q, tau=log.tau + 0.02 * log.tau.std(axis=0) * x, source=log.source))
    return tuple(found)


def validator(logs: tuple[Log, ...]) -> CrossValidator:
    return cross_validator(identify(ARM, logs[:1], recursion="none").model, logs)[0]


@pytest.mark.parametrize("memory", [0.03, 0.1, 0.2])
def test_the_floor_contains_noise_of_drives_that_is_as_slow_as_the_motion(memory):
    v = validator(logs_of(memory))
    floor, error = Floor.of(v), v.base_nrmse() * v.spread
    assert (floor.known < 0.8 * error).all(), "without the slow noise the error looks like a missing effect"
    np.testing.assert_allclose(floor.under(v), error, rtol=0.25)


def test_white_noise_has_no_slow_part():
    v = validator(logs_of(0.0))
    floor = Floor.of(v)
    assert (slow_noise(floor.octaves, v) < 1.15 * floor.known).all()


@pytest.mark.parametrize("memory", [0.0, 0.05])
def test_a_missing_effect_is_no_noise(memory):
    v = validator(logs_of(memory, "joint_spring@joint2"))
    error = (v.base_nrmse() * v.spread)[1]
    assert Floor.of(v).under(v)[1] < 0.4 * error


def test_a_prior_that_is_wrong_does_not_make_the_logs_count_for_nothing():
    """Weights come from residuals under the prior: a large residual gives the data no weight."""
    v = validator(logs_of(0.0))
    truth, information = v.theta, v.fit.information
    scale = np.sqrt(np.diag(information))
    wrong = Prior(truth + 400.0 / scale, np.diag((scale / 20.0) ** 2))
    believed = WeightedFit._settled(v.columns, wrong, v.spread, (v.spread, np.ones(2)), 4)
    fit = WeightedFit.of(v.columns, wrong, v.spread)
    assert fit.held_out_cost <= believed.held_out_cost
    assert (fit.sigma < 1.1 * v.fit.sigma).all()
