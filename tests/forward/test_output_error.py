"""Output error: planted parameters come back, bounds hold them, and what the motion does not say stays."""

from dataclasses import replace

import numpy as np
import pytest
from cases import robot

import frischid as fr
from frischid.errors import InputError
from frischid.forward.output_error import output_error
from frischid.forward.shooting import OutputErrorOptions
from frischid.model.model import Model
from frischid.motions.simulation import parameters_of
from frischid.regression.regressor import Regressor
from frischid.regression.structure import structure

EFFECTS = fr.parse_effects("viscous, offset")
TRUTH = {"fv1": 0.4, "fv2": 0.3, "off1": 0.4, "off2": -0.2}
SHORT = OutputErrorOptions(horizon=0.5, rounds=1)


def recorded(seed, noise, seconds=10.0, rate=200.0):
    machine = robot("planar2")
    motion = fr.random_fourier(machine, seconds, seed=seed)
    return fr.simulate(
        machine, motion, rate=rate, effects=EFFECTS, parameters=TRUTH, noise=noise, channels=(), seed=seed
    )


def linear(log):
    return fr.identify(robot("planar2"), [log], effects=EFFECTS, recursion="none", prior="none").model


def truth():
    machine = robot("planar2")
    mapping = structure(Regressor(machine, EFFECTS), machine.joints).mapping
    return mapping @ parameters_of(machine, EFFECTS, TRUTH)


def test_a_wrong_start_is_led_back_to_the_planted_parameters():
    log = recorded(1, fr.Noise(q=1e-7, tau=1e-5), rate=500.0)
    right = linear(log)
    e = right.estimate
    spread = 0.05 * (np.abs(truth()) + 0.05)
    wrong = replace(right, estimate=replace(e, theta=truth() + spread, covariance=np.diag(spread**2)), standard=None)
    found = output_error(wrong, [log], options=replace(SHORT, rounds=4))
    assert found.ratio < 0.1
    assert np.sqrt((((found.model.estimate.theta - truth()) / spread) ** 2).mean()) < 0.15


def test_bounds_hold_the_planted_parameters():
    held, count = 0, 0
    for seed in range(20, 32):
        log = recorded(seed, fr.Noise(q=2e-5, tau=0.02))
        e = output_error(linear(log), [log], options=SHORT).model.estimate
        held += int((np.abs(e.theta - truth()) < 1.96 * e.stderr).sum())
        count += len(e.theta)
    assert held >= 0.88 * count  # 95 % of 120, less two and a half standard errors of the share


def test_test_logs_show_the_error_before_and_after_and_decide_nothing():
    log, test = recorded(1, fr.Noise(q=2e-5, tau=0.02)), recorded(2, fr.Noise(q=2e-5, tau=0.02))
    model = linear(log)
    alone, tested = output_error(model, [log], options=SHORT), output_error(model, [log], valid=[test], options=SHORT)
    np.testing.assert_array_equal(alone.model.estimate.theta, tested.model.estimate.theta)
    assert alone.tested is None
    assert set(tested.to_dict()["held_out"]) == {"linear", "output_error"}


def test_a_still_joint_keeps_the_linear_answer_and_is_named():
    log = recorded(1, fr.Noise(q=1e-4, tau=1e-4))
    model = linear(log)
    sure = replace(model, estimate=replace(model.estimate, covariance=1e-8 * model.estimate.covariance), standard=None)
    found = output_error(sure, [log], options=SHORT)
    assert set(found.kept) == {c.name for c in model.estimate.columns}
    np.testing.assert_array_equal(found.model.estimate.theta, model.estimate.theta)


def test_a_parameter_that_moved_is_not_named_as_kept():
    """A hidden spring moves the two directions that the motion determines so far that all parameters move with them."""
    machine, spring = robot("planar2"), (*EFFECTS, *fr.parse_effects("joint_spring@joint2"))
    planted, noise = {**TRUTH, "ks2": 3.0}, fr.Noise(q=2e-5, tau=0.02)
    motion = fr.random_fourier(machine, 6.0, seed=1)
    log = fr.simulate(machine, motion, rate=100.0, effects=spring, parameters=planted, noise=noise, channels=(), seed=1)
    model = linear(log)
    e = replace(model.estimate, covariance=0.01 * model.estimate.covariance)
    found = output_error(replace(model, estimate=e, standard=None), [log], options=SHORT)
    change = np.abs(found.model.estimate.theta - e.theta) / e.stderr
    moved = {c.name for c, x in zip(e.columns, change, strict=True) if x > 1.0}
    assert moved
    assert not moved & {*found.kept}


def test_the_model_is_saved_and_loaded(tmp_path):
    log = recorded(1, fr.Noise(q=2e-5, tau=0.02), seconds=4.0)
    found = output_error(linear(log), [log], options=SHORT).model
    found.save(tmp_path / "model.json")
    again = Model.load(tmp_path / "model.json")
    np.testing.assert_array_equal(again.estimate.theta, found.estimate.theta)
    assert again.history[-1]["action"] == "output_error"
    assert again.estimate.estimator == "output_error"


@pytest.mark.parametrize("name", ["horizon", "samples"])
def test_options_that_are_not_positive_are_refused(name):
    with pytest.raises(InputError, match=name):
        OutputErrorOptions(**{name: 0})


def test_a_motion_that_runs_away_is_a_sentence():
    log = recorded(1, fr.Noise(q=2e-5, tau=0.02), seconds=4.0)
    model = linear(log)
    theta = model.estimate.theta.copy()
    names = [c.name for c in model.estimate.columns]
    theta[[names.index("fv1"), names.index("fv2")]] = -1e4
    wild = replace(model, estimate=replace(model.estimate, theta=theta), standard=None)
    with pytest.raises(InputError, match="unstable"):
        output_error(wild, [log], options=SHORT)


def test_the_values_of_all_parameters_follow_the_fitted_motion():
    log = recorded(1, fr.Noise(q=1e-5, tau=0.2), seconds=6.0)
    model = fr.identify(robot("planar2"), [log], effects=EFFECTS, recursion="none").model
    found = output_error(model, [log], options=replace(SHORT, iterations=3)).model
    mapping = structure(Regressor(found.robot, EFFECTS), found.joints).mapping
    assert np.abs(found.estimate.theta - model.estimate.theta).max() > 1e-3
    np.testing.assert_allclose(mapping @ found.prior.value, found.estimate.theta, rtol=1e-6, atol=1e-7)
    said = {x.joint: x.value for x in fr.drive_parameters(found) if x.quantity == "viscous"}
    assert said["joint1"] == pytest.approx(found.parameters["fv1"].value, rel=1e-6)
    k = found.prior.parameters.names.index("fv1")
    spread = found.prior.parameters.total_spread[k] * np.sqrt(1.0 - found.prior.from_log[k])
    assert spread == pytest.approx(found.parameters["fv1"].stderr, rel=1e-3)
    same = model.prior.moved(mapping, model.estimate.theta, model.estimate.covariance)
    np.testing.assert_allclose(same.value, model.prior.value, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(same.from_log, model.prior.from_log, atol=1e-6)


def test_the_fitted_logs_are_found_again(tmp_path):
    fr.write_log(recorded(1, fr.Noise(q=2e-5, tau=0.02)), tmp_path / "log.parquet")
    log = fr.read_log(tmp_path / "log.parquet", robot("planar2").joints)
    found = output_error(linear(log), [log], options=SHORT).model
    assert [x.identity for x in fr.own_logs(found).logs] == [log.identity]
