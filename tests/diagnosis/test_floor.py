"""The noise floor of a diagnosis: slow noise of drives raises it, a missing effect does not; and the fit's weights."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.signal import lfilter

from frischid.core.types import Array
from frischid.diagnosis.cross_validation import CrossValidator
from frischid.diagnosis.diagnosis import diagnose
from frischid.diagnosis.floor import Floor, error_of
from frischid.diagnosis.repeats import measured_noise
from frischid.diagnosis.situation import cross_validator
from frischid.diagnosis.slow_noise import slow_noise
from frischid.diagnosis.weighted_fit import WeightedFit
from frischid.effects import BASELINE, parse_effects
from frischid.estimators.least_squares import Prior
from frischid.logs.log import Log
from frischid.logs.repeated_motion import repeat_of
from frischid.model.identification import identify
from frischid.motions.simulation import Noise, simulate
from frischid.motions.trajectory import random_fourier
from frischid.robot.robot import Robot

ARM = Robot.load("planar2")
RATE = 200.0


@cache
def logs_of(memory: float, effect: str = "", motions: tuple[int, ...] = (1, 2), run: int = 0) -> tuple[Log, ...]:
    """Logs whose torque has noise of 2 % with a memory, s (0: white), and a spring on joint 2 if wanted."""
    found = []
    for seed in motions:
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
        found.append(noisy(log, memory, [seed, run]))
    return tuple(found)


def noisy(log: Log, memory: float, seed: list[int]) -> Log:
    """The log's positions and torques, with torque noise of 2 % with a memory, s (0: white)."""
    x = np.random.default_rng(seed).normal(size=log.tau.shape)
    if memory:
        pole = np.exp(-(log.t[1] - log.t[0]) / memory)
        x = lfilter([np.sqrt(1 - pole**2)], [1, -pole], x, axis=0)
    return Log(log.t, log.joints, log.q, tau=log.tau + 0.02 * log.tau.std(axis=0) * x, source=log.source)


def validator(logs: tuple[Log, ...]) -> CrossValidator:
    return cross_validator(identify(ARM, logs[:1], recursion="none").model, logs)[0]


@pytest.mark.parametrize("memory", [0.03, 0.1, 0.2])
def test_the_floor_contains_noise_of_drives_that_is_as_slow_as_the_motion(memory):
    v = validator(logs_of(memory))
    floor, error = Floor.of(v), error_of(v)
    assert (floor.noise < 0.8 * error).all(), "without the slow noise the error looks like a missing effect"
    np.testing.assert_allclose(floor.under(v, ()), error, rtol=0.25)


def test_slow_noise_makes_predictions_of_short_logs_more_uncertain():
    """Few rows of slow noise are independent, so the folds disagree. Healthy arms were said to lack cogging."""
    arm, slow, whole = Robot.load("z1"), [], []
    values = {f"{kind}{n}": x for n in range(1, 7) for kind, x in (("fc", 0.3), ("fv", 0.2))}
    for pair in ((1, 2), (3, 4), (5, 6)):
        logs = []
        for seed in pair:
            motion, quiet = random_fourier(arm, 15, seed=seed), Noise(q=1e-6, tau=0.0)
            log = simulate(arm, motion, rate=100, parameters=values, noise=quiet, channels=(), seed=seed)
            logs.append(noisy(log, 0.1, [seed]))
        v, _ = cross_validator(identify(arm, logs[:1], recursion="none").model, logs)
        floor, error = Floor.of(v), v.base_nrmse() * v.spread
        slow.append(np.sqrt(np.mean((slow_noise(floor.octaves, v) / error) ** 2)))
        whole.append(np.sqrt(np.mean((floor.under(v, ()) / error_of(v)) ** 2)))
    assert np.mean(slow) < 0.88, "the noise alone is no reason for this error"
    assert np.mean(whole) > 0.9


@pytest.mark.parametrize("step", [False, True])
def test_white_noise_has_no_slow_part(step):
    """Beside a slow residual, chance in the octaves above the band had made the noise five times as large."""
    v = validator(tuple(replace(log, tau=log.tau + step * _step(log)) for log in logs_of(0.0)))
    floor = Floor.of(v)
    assert (slow_noise(floor.octaves, v) < 1.15 * floor.noise).all()


def test_a_torque_with_coarse_steps_says_nothing_of_slow_noise():
    logs = []
    for log in logs_of(0.0):
        tau = np.array(log.tau)
        step = 2 * tau[:, 1].std()  # so large that most differences are zero
        tau[:, 1] = step * np.round(tau[:, 1] / step)
        logs.append(replace(log, tau=tau))
    v = validator(tuple(logs))
    floor = Floor.of(v)
    assert all((x.powers[:, 1] == 0).all() for x in floor.octaves)
    assert slow_noise(floor.octaves, v)[0] < 1.15 * floor.noise[0], "nor of that of the other joint"


@pytest.mark.parametrize(("count", "seconds", "cutoff"), [(6, 5.0, 1.0), (2, 7.0, "auto")])
def test_short_logs_leave_a_step_of_the_torque_above_the_noise(count, seconds, cutoff):
    """Their parameters absorb the low octaves, so that hardly any octave says something of noise."""
    logs = []
    for seed in range(count):
        motion = random_fourier(ARM, seconds, seed=seed)
        quiet = simulate(
            ARM, motion, rate=100.0, noise=Noise(q=1e-6, tau=0.0), channels=(), seed=seed, name=f"log {seed}"
        )
        log = noisy(quiet, 0.0, [seed])
        logs.append(replace(log, tau=log.tau + _step(log)))
    model = identify(ARM, logs, recursion="none", cutoff=cutoff).model
    v = cross_validator(model, logs)[0]
    assert (Floor.of(v).under(v, ()) < 0.5 * error_of(v)).all()


@pytest.mark.parametrize("memory", [0.0, 0.05])
def test_a_missing_effect_is_no_noise(memory):
    v = validator(logs_of(memory, "joint_spring@joint2"))
    error = error_of(v)[1]
    assert Floor.of(v).under(v, ())[1] < 0.4 * error


@pytest.mark.parametrize("memory", [0.01, 0.03, 0.1])
def test_a_step_of_the_torque_beside_slow_noise_is_no_noise(memory):
    """The slowest noise with the residual's variance would be the whole residual, but not octave by octave."""
    logs = tuple(replace(log, tau=log.tau + _step(log)) for log in logs_of(memory))
    v = validator(logs)
    assert (Floor.of(v).under(v, ()) < 0.5 * error_of(v)).all()


def _step(log: Log) -> Array:
    """A torque whose zero moves in the middle of a log, by a tenth of each joint's torque (std)."""
    return 0.05 * log.tau.std(axis=0) * np.where(log.t > log.t.mean(), 1.0, -1.0)[:, None]


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


def runs(memory: float, effect: str = "") -> list[Log]:
    """Two logs, each of which runs a motion of its own twice; the noise is another one in each run."""
    found = []
    for motion in (1, 2):
        parts = []
        for run in (0, 1):
            (log,) = logs_of(memory, effect, (motion,), run)
            parts.append(log.slice(0, len(log.t) - 1))
        t = np.arange(2 * len(parts[0].t)) / RATE
        q, tau = (np.concatenate([getattr(part, name) for part in parts]) for name in ("q", "tau"))
        found.append(Log(t, ARM.joints, q, tau=tau, source=f"/folder/two runs {motion}"))
    return found


@pytest.mark.parametrize("effect", ["", "joint_spring@joint2"])
def test_repeated_motions_measure_the_noise_whatever_is_missing(effect):
    v = validator(tuple(runs(0.1, effect)))
    measured = measured_noise(v)
    assert measured is not None
    true = np.sqrt(sum(log.tau.var(axis=0) for log in runs(0.1, effect)) / 2) * 0.02
    healthy = validator(tuple(runs(0.1)))
    np.testing.assert_allclose(measured.noise, healthy.fit.sigma, rtol=0.2)
    assert (measured.noise < true).all(), "the filter takes a part of the noise"
    assert "(two runs 1, two runs 2; " in measured.said, "without their folders"
    found = diagnose(v.model, runs(0.1, effect))
    assert measured.said in found.notes
    assert found.verdict == ("effect" if effect else "none")


def test_other_motions_do_not_repeat():
    assert measured_noise(validator(logs_of(0.0))) is None


def test_a_motion_that_comes_again_in_another_log_is_found_with_its_shift():
    one, other = runs(0.0)[0], runs(0.0)[0].slice(300, 3000)
    found = repeat_of(one.t, one.q, other.t - 7.0, other.q)
    assert found is not None
    assert found.shift % 20.0 == pytest.approx(7.0, abs=0.005)
    own = repeat_of(one.t, one.q, one.t, one.q, 5.0)
    assert own is not None
    assert own.shift == pytest.approx(20.0, abs=0.005)
    assert repeat_of(one.t, one.q, other.t, 1.05 * other.q) is None
