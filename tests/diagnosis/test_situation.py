"""Short new logs: what the identification knows of the robot is not thrown away."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import frischid as fr
from frischid.diagnosis.change_prior import weak_urdf_prior
from frischid.diagnosis.situation import cross_validator, of_the_training_logs, priors_of

UR5 = fr.Robot.load("ur5")
DRY = {f"{name}{i}": 0.5 for name in ("fv", "fc") for i in range(1, 7)}


def log_of(seed, seconds, effects="", **values):
    hidden = (*fr.BASELINE, *fr.parse_effects(effects)) if effects else fr.BASELINE
    motion = fr.random_fourier(UR5, seconds, seed=seed)
    noise = fr.Noise(q=1e-5, tau=0.2)
    return fr.simulate(UR5, motion, rate=100, effects=hidden, parameters=DRY | values, noise=noise, seed=seed)


@cache
def model():
    return fr.identify(UR5, [log_of(seed, 40) for seed in (1, 2)], recursion="none").model


def test_a_short_log_of_the_same_robot_is_judged_with_the_identification():
    short = log_of(3, 8)
    validator, situation = cross_validator(model(), [short])
    alone, trained = priors_of(validator, situation)
    assert situation == "always"
    assert alone is validator
    assert trained.base_nrmse().mean() < 0.8 * alone.base_nrmse().mean()
    assert priors_of(validator, "changed") == [validator], "then it is the prior already"


def test_a_small_effect_in_a_short_log_is_the_most_probable_cause():
    """With the URDF as prior, a coupling of five joints was: the short log determines the parameters badly."""
    found = fr.diagnose(model(), [log_of(3, 8, "cogging(order=9)@elbow_joint", A3=1.0)])
    assert max(found.probabilities, key=found.probabilities.__getitem__) == "cogging"


@pytest.mark.parametrize("shifted", [0.0, 0.12])
def test_what_half_of_the_own_logs_leave_open_hides_no_change(shifted):
    """An encoder slipped by 2.5°, and it was said that the robot had not changed, with other friction (99 %).

    One of two own logs alone leaves parameters open. The error of such a fit on the other log is no error of the model.
    """
    own = [log_of(seed, 10) for seed in (1, 2)]
    fitted = fr.identify(UR5, own, recursion="none").model
    log = log_of(3, 20)
    tau = np.array(log.tau)
    tau[:, 3] += shifted * tau[:, 3].std()
    logs = (own, [replace(log, tau=tau)])
    before, after = (cross_validator(fitted, given, "always")[0] for given in logs)
    assert before.base_nrmse()[3] > 2 * before.predictive_nrmse()[3]
    assert of_the_training_logs(before, after, [], {}) is not bool(shifted)


def test_own_logs_keep_the_prior_of_the_urdf():
    logs = [log_of(seed, 40) for seed in (1, 2)]
    validator, situation = cross_validator(model(), logs)
    assert situation == "always"
    assert priors_of(validator, situation) == [validator]
    assert np.array_equal(validator.fit.prior.precision, weak_urdf_prior(model()).precision)


def test_an_effect_that_was_always_missing_is_found_in_new_logs():
    """The identification is biased by such an effect: with it as the prior, the spring explains half of its error."""
    machine = fr.Robot.load("planar2")
    hidden = (*fr.BASELINE, *fr.parse_effects("joint_spring@joint2"))
    values = {"fv1": 0.5, "fv2": 0.3, "fc1": 0.5, "fc2": 0.3, "ks2": 1.5}
    logs = [
        fr.simulate(machine, fr.random_fourier(machine, 30, seed=seed), rate=50, effects=hidden, parameters=values,
                    noise=fr.Noise(q=1e-5, tau=0.01), seed=seed)
        for seed in (1, 2)
    ]  # fmt: skip
    found = fr.diagnose(fr.identify(machine, logs[:1], recursion="none").model, logs[1:], situation="always")
    assert (found.verdict, found.findings[0].effect) == ("effect", "joint_spring")
    assert found.findings[0].share > 0.95


@pytest.mark.parametrize(
    "call",
    [
        lambda m, logs, **given: fr.diagnose(m, logs, **given),
        lambda m, logs, **given: fr.diagnose_in_roles(m, logs, **given),
        lambda m, logs, **given: fr.improve(m, logs, **given),
        lambda m, logs, **given: fr.add(m, fr.parse_effects("stribeck"), logs, **given),
    ],
)
def test_a_situation_that_does_not_exist_is_refused(call):
    """It had been taken for `always`."""
    log = log_of(1, 5)
    with pytest.raises(fr.InputError, match=r"unknown situation 'altered'; .* always, auto, changed"):
        call(model(), [log], situation="altered")


def test_nothing_to_add_is_said():
    with pytest.raises(fr.InputError, match="there is no effect to add"):
        fr.add(model(), [], [log_of(1, 5)])
    with pytest.raises(fr.InputError, match="there is no log to fit"):
        fr.add(model(), fr.parse_effects("stribeck"), [])


@pytest.mark.parametrize(("resting_before", "resting_after"), [([], [2]), ([2], [])])
def test_a_joint_may_rest_in_the_own_logs_or_in_the_new_ones(tmp_path, resting_before, resting_after):
    """Errors were compared joint by joint by position: three against two ended in a ValueError of NumPy."""
    machine = UR5.keep(UR5.joints[:3])

    def recorded(seed, resting):
        rng, motion = np.random.default_rng(seed), fr.random_fourier(machine, 15, seed=seed)
        t = np.arange(0, 15, 0.01)
        q, v, a = (np.array(x) for x in motion(t))
        q[:, resting], v[:, resting], a[:, resting] = 0.3, 0.0, 0.0
        noise = rng.standard_normal((2, *q.shape))
        tau = machine.inverse_dynamics(q, v, a) + 5 * v + 0.2 * noise[0]
        return fr.Log(t, machine.joints, q + 1e-6 * noise[1], tau=tau, source=f"log {seed}")

    fr.write_log(recorded(1, resting_before), tmp_path / "own.parquet")
    own = fr.read_log(tmp_path / "own.parquet", machine.joints)
    trained = fr.identify(machine, [own], recursion="none").model
    found = fr.diagnose_in_roles(trained, [recorded(2, resting_after)], effects=["joint_spring"])
    assert (found.verdict, found.situation) == ("none", "always")
