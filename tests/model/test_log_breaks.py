"""A log in the middle of which the robot takes a load raises an alarm with the time; a log of one robot does not."""

import re
from dataclasses import replace

import numpy as np
import pytest

import frischid as fr
from frischid.diagnosis.clause import missing
from frischid.model import log_moments
from frischid.model.alarms import LOG_CHANGES
from frischid.model.identification_stages import form_moments, read_logs
from frischid.model.identify_options import IdentifyOptions
from frischid.model.log_data import Journal
from frischid.model.log_moments import moments_by_log

NOISE = fr.Noise(q=1e-5, tau=0.02)
LOADED = {"m2": 3.0, "mx2": 1.0}


@pytest.fixture(scope="module")
def arm():
    return fr.Robot.load("planar2")


def log_of(robot, seed, taken=None, effects=fr.BASELINE, **parameters):
    """A log of 20 s; from the time `taken` on, the robot has other parameters."""
    motion = fr.random_fourier(robot, 20.0, seed=seed)
    before, after = (
        fr.simulate(robot, motion, rate=100, noise=NOISE, seed=seed, name="log", effects=effects, parameters=known)
        for known in ({}, parameters)
    )
    tau = np.where(before.t[:, None] < (np.inf if taken is None else taken), before.tau, after.tau)
    return fr.Log(before.t, before.joints, q=before.q, tau=tau, source="log")


def changes(robot, logs, **options):
    found = fr.identify(robot, logs, recursion="none", **options)
    return [alarm for alarm in found.alarms if alarm.id == LOG_CHANGES]


@pytest.mark.parametrize(("taken", "seed"), [(5.0, 3), (8.0, 2), (12.0, 2)])
@pytest.mark.parametrize("prior", ["urdf", "none"])
def test_a_load_that_is_taken_in_the_middle_of_a_log_is_an_alarm_with_the_time(arm, prior, taken, seed):
    (alarm,) = changes(arm, [log_of(arm, seed, taken, **LOADED)], prior=prior)
    assert alarm.severity == "severe"
    assert "joint2" in alarm.joints
    assert alarm.value > 1.3 * alarm.limit
    assert float(re.search(r"at about ([\d.]+) s of log", alarm.sentence)[1]) == pytest.approx(taken, abs=1.5)


def test_the_time_counts_from_the_first_sample_as_that_of_cut_does(arm):
    log = log_of(arm, 2, 8.0, **LOADED)
    (alarm,) = changes(arm, [replace(log, t=log.t + 1000.0)])
    assert float(re.search(r"at about ([\d.]+) s of log", alarm.sentence)[1]) == pytest.approx(8.0, abs=1.5)


def test_a_log_of_many_parts_is_kept_in_few_stretches(arm, monkeypatch):
    """A hundred gaps had given a thousand blocks, and two fits for each."""
    log = log_of(arm, 2, 8.0, **LOADED)
    kept = np.arange(len(log)) % 100 < 70
    parts = replace(log, t=log.t[kept], q=log.q[kept], tau=log.tau[kept])
    monkeypatch.setattr(log_moments, "STRETCHES", 8)
    options = IdentifyOptions(recursion="none", cutoff=15.0)
    problem = form_moments(read_logs(arm, [parts], (), options, Journal(print)), fr.BASELINE)
    assert len(problem.blocks) >= 19  # one of each part, or more
    (found,) = moments_by_log(problem).values()
    assert len(found.starts) == len(found.blocks)
    assert 6 <= len(found.blocks) <= 9
    assert (np.diff(found.starts) > 0).all()
    np.testing.assert_allclose(found.blocks.total().counts, problem.whole.counts)
    (alarm,) = changes(arm, [parts], cutoff=15.0)
    assert float(re.search(r"at about ([\d.]+) s of log", alarm.sentence)[1]) == pytest.approx(8.0, abs=2.5)


def test_the_load_may_be_taken_in_one_of_two_logs(arm):
    (alarm,) = changes(arm, [log_of(arm, 2, 8.0, **LOADED), log_of(arm, 1)])
    assert len(re.findall(r"at about", alarm.sentence)) == 1


def test_a_log_of_one_robot_does_not_change(arm):
    assert changes(arm, [log_of(arm, seed) for seed in (1, 2)]) == []


def test_an_effect_that_the_model_lacks_all_the_time_is_no_change(arm):
    effects = (*fr.BASELINE, *fr.parse_effects("joint_spring"))
    motion = fr.random_fourier(arm, 20.0, seed=3)
    log = fr.simulate(arm, motion, rate=100, noise=NOISE, effects=effects, parameters={"ks2": 1.0})
    assert changes(arm, [log]) == []


def test_joints_that_move_one_after_the_other_are_no_change(arm):
    """Each part of the log shows parameters that the other part does not show."""
    t = np.arange(0.0, 20.0, 0.01)
    w, own = 2 * np.pi / 2.5, np.column_stack([t < 10.0, t >= 10.0])
    q, v, a = (np.where(own, x[:, None], 0.0) for x in (1 - np.cos(w * t), w * np.sin(w * t), w**2 * np.cos(w * t)))
    tau = arm.inverse_dynamics(q, v, a) + 0.3 * v + np.random.default_rng(0).normal(0.0, 0.02, q.shape)
    assert changes(arm, [fr.Log(t, arm.joints, q=q, tau=tau)]) == []


def test_a_verdict_on_such_a_log_presumes_that_the_change_is_none(arm):
    log = log_of(arm, 2, 8.0, **LOADED)
    model = fr.identify(arm, [log], recursion="none").model
    said = missing(fr.diagnose(model, [log], effects=["torque_drift", "gravity_tilt"]))
    assert said.startswith("Unless the robot changes in the middle of a log, as the alarm says, ")


def test_two_fits_that_an_effect_biases_are_no_two_robots(arm):
    """One fit explains both parts of joint1 as well as two, although neither part explains the other."""
    effects = (*fr.BASELINE, *fr.parse_effects("load_friction@joint2"))
    logs = [log_of(arm, seed, effects=effects, fl2=0.3) for seed in (1, 2)]
    assert changes(arm, logs) == []


def test_a_fit_that_explains_both_parts_as_well_as_two_is_no_surprise(arm, monkeypatch):
    monkeypatch.setattr(log_moments, "surprise", lambda *_: np.array([9.0, 9.0]))
    assert changes(arm, [log_of(arm, 1)]) == []
