"""The lag of the torque is estimated with every fit; friction and noise are not taken for a lag."""

import json
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.interpolate import make_interp_spline

import frischid as fr
from frischid.cli import main
from frischid.effects import parse_effects
from frischid.logs.readers import write_log

ROBOT = fr.Robot.load("planar2")
FRICTION = {"fv1": 1.0, "fv2": 0.8, "fc1": 1.2, "fc2": 0.9, "Ia1": 1.0, "Ia2": 0.6}


def recorded(seed, rate=200.0, effects=fr.BASELINE, **more):
    return fr.simulate(
        ROBOT, fr.random_fourier(ROBOT, 20.0, seed=seed), rate=rate, effects=effects, parameters=FRICTION | more,
        noise=fr.Noise(q=1e-5, tau=0.02), channels=(), seed=seed,
    )  # fmt: skip


def late(log, by):
    """The log with its torque `by` seconds late: one number, or one for each joint."""
    tau = np.stack(
        [
            make_interp_spline(log.t, x, k=3)(np.clip(log.t - d, log.t[0], log.t[-1]))
            for x, d in zip(log.tau.T, np.broadcast_to(by, log.tau.shape[1]), strict=True)
        ],
        axis=1,
    )
    return replace(log, tau=tau)


def fitted(log, **options):
    return fr.identify(ROBOT, [log], recursion="none", **options)


@pytest.mark.parametrize(("rate", "by"), [(200.0, 0.0025), (500.0, 0.001), (200.0, -0.005)])
def test_a_lag_of_about_a_sample_is_measured_said_and_taken_back(rate, by):
    found = fitted(late(recorded(2, rate), by))
    lag = found.torque_lag
    assert lag.significant
    assert lag.sampling == (by > 0)
    for value in (lag.lag, lag.taken, found.model.lowpass.torque_lag):
        assert abs(value - by) < max(4 * lag.error, 0.1 * abs(by))
    assert lag.step == pytest.approx(1 / rate)
    assert lag.said in found.notes
    assert not lag.warning
    assert ("behind" if by > 0 else "ahead of") in lag.said


def test_a_lag_far_below_a_sample_step_is_taken_back_and_no_effect_is_missing():
    """A current filter of 0.4 ms in a log at 100 Hz."""
    log = fr.simulate(
        ROBOT, fr.random_fourier(ROBOT, 40.0, seed=2), rate=100.0, effects=fr.BASELINE, parameters=FRICTION,
        noise=fr.Noise(q=1e-5, tau=0.005), channels=(), seed=2,
    )  # fmt: skip
    found = fitted(late(log, 0.0004))
    assert found.torque_lag.taken == pytest.approx(0.0004, abs=4 * found.torque_lag.error)
    assert found.torque_lag.said in found.notes
    assert fr.diagnose(found.model, [late(log, 0.0004)]).verdict == "none"


def test_a_lag_that_is_taken_back_leaves_no_error():
    true = recorded(2)
    clean, taken = fitted(true, cutoff=5.0), fitted(late(true, 0.0025), cutoff=5.0)
    left = fitted(late(true, 0.0025), cutoff=5.0, torque_lag=0.0)
    wrong, right = (np.abs(x.model.estimate.theta - clean.model.estimate.theta) for x in (left, taken))
    assert (right <= np.maximum(0.3 * wrong, clean.model.estimate.stderr)).all()
    assert taken.headline.nrmse < 1.1 * clean.headline.nrmse < 0.8 * left.headline.nrmse
    assert left.torque_lag.warning in left.warnings
    assert "--torque-lag auto" in left.torque_lag.warning


def test_a_lag_that_raises_the_error_on_stretches_left_out_is_refused(monkeypatch):
    """Whatever imitates the lag: the torque counts as recorded, and a note says so."""
    log = recorded(3)
    wrong = replace(fitted(log).torque_lag, lag=0.004, error=1e-4, p_value=0.0, significant=True, differing=())
    monkeypatch.setattr("frischid.model.identification_pass.torque_lag", lambda *_: wrong)
    found, plain = fitted(log), fitted(log, torque_lag=0.0)
    assert found.model.lowpass.torque_lag == 0.0
    assert found.torque_lag.said == ""
    assert any("imitates a lag" in note for note in found.notes)
    np.testing.assert_array_equal(found.model.estimate.theta, plain.model.estimate.theta)


def test_a_lag_longer_than_sampling_explains_is_left_to_the_user():
    found = fitted(late(recorded(2), 0.012))
    assert found.torque_lag.significant
    assert not found.torque_lag.taken
    assert found.model.lowpass.torque_lag == 0
    assert "time_delay" in found.torque_lag.warning


@pytest.mark.parametrize("seed", [2, 3])
def test_the_standard_error_of_a_long_lag_holds(seed):
    """On a fast motion, the first term of the series in the lag is too short by many standard errors."""
    log = fr.simulate(
        ROBOT, fr.random_fourier(ROBOT, 20.0, seed=seed, harmonics=60), rate=200.0, effects=fr.BASELINE,
        parameters=FRICTION, noise=fr.Noise(q=1e-6, tau=0.005), channels=(), seed=seed,
    )  # fmt: skip
    lag = fitted(late(log, 0.02)).torque_lag
    assert lag.significant
    assert lag.error < 2e-5
    assert abs(lag.lag - 0.02) < 3 * lag.error


def test_a_lag_of_many_filtered_samples_needs_as_many_neighbours():
    """Rows at the ends of each part had the motion of the part's first sample: 0.2055 ± 0.0016 s."""
    motion = fr.random_fourier(ROBOT, 20.0, seed=2)
    log = fr.simulate(ROBOT, motion, rate=100.0, effects=fr.BASELINE, parameters=FRICTION, channels=())
    log, inner = late(log, 0.2), slice(60, -60)
    noisy = log.tau + 0.05 * np.random.default_rng(2).normal(size=log.tau.shape)
    log = replace(log, t=log.t[inner], q=log.q[inner], tau=noisy[inner])
    lag = fitted(log, cutoff=39.0).torque_lag
    assert lag.lag == pytest.approx(0.2, abs=2e-4)


@pytest.mark.parametrize("seed", [1, 2])
def test_a_lag_of_slow_logs_is_taken_back_and_no_effect_is_missing(seed):
    """A leg with coarse encoders. The lag turns the parameters, too: that correction is no doubt about the lag."""
    leg = fr.Robot.load("hyq_no_sensors", joints=["lf_haa_joint", "lf_hfe_joint", "lf_kfe_joint"])
    drives = {"fv1": 0.1, "fv2": 0.05, "fv3": 0.02, "fc1": 0.2, "fc2": 0.12, "fc3": 0.06}
    drives |= {"Ia1": 0.2, "Ia2": 0.1, "Ia3": 0.03}
    logs = [
        late(
            fr.simulate(
                leg, fr.random_fourier(leg, 20.0, seed=k), rate=250.0, effects=fr.BASELINE, parameters=drives,
                noise=fr.Noise(q=8e-5, tau=0.01), channels=(), seed=k,
            ),
            0.0024,
        )
        for k in (seed, seed + 10)
    ]  # fmt: skip
    found = fr.identify(leg, logs, recursion="none")
    assert found.torque_lag.error < 2e-4
    assert found.torque_lag.taken == pytest.approx(0.0024, abs=4 * found.torque_lag.error)
    assert fr.diagnose(found.model, logs).verdict == "none"


def test_a_given_lag_is_taken_and_the_lag_of_the_log_is_still_measured():
    found = fitted(late(recorded(2), 0.0025), torque_lag=0.002)
    assert found.model.lowpass.torque_lag == found.torque_lag.taken == 0.002
    assert found.torque_lag.lag == pytest.approx(0.0025, abs=0.0003)


@pytest.mark.parametrize("wrong", [np.nan, 2.0, "late", None, True])
def test_a_lag_is_a_time(wrong):
    with pytest.raises(fr.InputError, match="torque_lag"):
        fitted(recorded(2), torque_lag=wrong)


def test_later_steps_use_the_models_lag(tmp_path):
    log, test = (late(recorded(seed), 0.0025) for seed in (2, 3))
    model = fitted(log).model
    model.save(tmp_path / "model.json")
    again = fr.Model.load(tmp_path / "model.json")
    assert again.lowpass == model.lowpass
    assert fr.compare(again, [test]).nrmse < 0.75 * fr.compare(fitted(log, torque_lag=0.0).model, [test]).nrmse
    assert fr.add(again, parse_effects("stribeck"), [log]).model.lowpass == model.lowpass
    found = fr.diagnose(again, [log], effects=["time_delay"])
    assert found.verdict == "none"
    assert any("in the model already" in note for note in found.notes)


def test_a_recording_in_chunks_has_the_torque_of_the_whole_log(tmp_path, monkeypatch):
    log = late(recorded(2), 0.0025)
    write_log(log, tmp_path / "log.csv")
    recording = fr.Recording.open(tmp_path / "log.csv", ROBOT.joints)
    options = {"torque_lag": 0.0025, "effects": fr.BASELINE, "prior": "none"}
    whole = fitted(log, **options).model.estimate
    monkeypatch.setattr("frischid.logs.recording.RECORDING_CHUNK", 1000)
    parts = fitted(recording, **options).model.estimate
    assert parts.theta == pytest.approx(whole.theta, rel=2e-3, abs=1e-3 * np.abs(whole.theta).max())


@pytest.mark.parametrize("seed", [2, 3, 4])
def test_no_lag_is_found_where_there_is_none(seed):
    assert not fitted(recorded(seed)).torque_lag.significant


def test_friction_with_memory_is_no_lag():
    effects = (*fr.BASELINE, *parse_effects("hysteresis(distance=0.01)"))
    log = recorded(2, effects=effects, fh1=0.8, fh2=0.6)
    assert not fitted(log).torque_lag.significant


def test_wrongly_smoothed_friction_is_no_lag():
    log = recorded(2, effects=parse_effects("viscous,coulomb(width=0.05),rotor_inertia"))
    found = fitted(log, effects=parse_effects("viscous,coulomb(width=0.001),rotor_inertia"))
    assert not found.torque_lag.significant


def test_a_lag_of_one_joint_alone_is_no_lag_of_the_record():
    found = fitted(late(recorded(2), [0.0, 0.02]))
    assert "joint2" in found.torque_lag.differing
    assert not found.torque_lag.significant
    assert any("not on all joints alike" in note for note in found.notes)


def test_a_joint_that_turns_a_body_of_revolution_does_not_hide_the_lag_of_the_others():
    """The sixth joint of the Kinova moves no gravity: a lag of its viscous friction is all but rotor inertia."""
    robot = fr.Robot.load("kinova")
    friction = {f"{name}{j}": x for name, x in (("fv", 0.3), ("fc", 0.2), ("Ia", 0.05)) for j in range(1, 7)}
    log = fr.simulate(
        robot, fr.random_fourier(robot, 30.0, seed=2), rate=100.0, effects=fr.BASELINE,
        parameters=friction | {"Ia6": 3e-4}, noise=fr.Noise(q=1e-5, tau=0.02), channels=(), seed=2,
    )  # fmt: skip
    lag = fr.identify(robot, [late(log, 0.004)], recursion="none").torque_lag
    silent = lag.joints[-1]
    assert silent.error > 0.05  # s: no lag of a log is as long
    assert not silent.significant
    assert lag.differing == ()
    assert lag.taken == pytest.approx(0.004, abs=4 * lag.error)


def test_the_remedy_removes_the_lag_and_the_error():
    log, test = (late(recorded(seed), 0.0025) for seed in (2, 3))
    step = fr.add(fitted(log, torque_lag=0.0).model, parse_effects("time_delay"), [log], valid=[test])
    assert step.test_after < 0.8 * step.test_before
    assert step.model.parameters["delay"].value == pytest.approx(0.0025, abs=0.0005)


def test_a_model_with_a_delay_has_no_second_one():
    assert fitted(late(recorded(2), 0.0025), effects=(*fr.BASELINE, *parse_effects("time_delay"))).torque_lag is None


def test_short_logs_have_no_lag():
    assert fitted(recorded(2).slice(0, 800)).torque_lag is None


def test_the_command_line_says_the_lag(tmp_path):
    write_log(late(recorded(2), 0.0025), tmp_path / "log.csv")
    words = ["identify", "planar2", str(tmp_path / "log.csv"), "-o", str(tmp_path / "m.json")]
    plain = " ".join(CliRunner().invoke(main, words).output.split())
    assert "behind the motion" in plain
    assert "counts as 2.49 ms late" in plain
    data = json.loads(CliRunner().invoke(main, [*words, "--json"]).output)
    assert data["torque_lag"]["sampling"]
    assert data["torque_lag"]["lag"] == pytest.approx(0.0025, abs=0.0005)
    kept = json.loads((tmp_path / "m.json").read_text())
    assert kept["filter"]["torque_lag"] == data["torque_lag"]["taken"] == pytest.approx(0.0025, abs=0.0005)
    assert kept["history"][-1]["torque_lag"]["said"] in kept["history"][-1]["notes"]
    left = json.loads(CliRunner().invoke(main, [*words, "--torque-lag", "none", "--json"]).output)
    assert left["torque_lag"]["taken"] == 0
    assert left["torque_lag"]["warning"] in left["warnings"]
