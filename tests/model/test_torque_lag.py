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
def test_a_lag_of_the_record_is_measured_and_said(rate, by):
    found = fitted(late(recorded(2, rate), by))
    lag = found.torque_lag
    assert lag.significant
    assert lag.sampling == (by > 0)
    assert abs(lag.lag - by) < max(4 * lag.error, 0.1 * abs(by))
    assert lag.step == pytest.approx(1 / rate)
    assert lag.warning in found.warnings
    assert ("behind" if by > 0 else "ahead of") in lag.warning


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


def test_the_remedy_removes_the_lag_and_the_error():
    log, test = (late(recorded(seed), 0.0025) for seed in (2, 3))
    step = fr.add(fitted(log).model, parse_effects("time_delay"), [log], valid=[test])
    assert step.test_after < 0.8 * step.test_before
    assert step.model.parameters["delay"].value == pytest.approx(0.0025, abs=0.0005)


def test_a_model_with_a_delay_has_no_second_one():
    assert fitted(late(recorded(2), 0.0025), effects=(*fr.BASELINE, *parse_effects("time_delay"))).torque_lag is None


def test_short_logs_have_no_lag():
    assert fitted(recorded(2).slice(0, 800)).torque_lag is None


def test_the_command_line_says_the_lag(tmp_path):
    write_log(late(recorded(2), 0.0025), tmp_path / "log.csv")
    words = ["identify", "planar2", str(tmp_path / "log.csv"), "-o", str(tmp_path / "m.json")]
    plain = CliRunner().invoke(main, words)
    assert "behind the motion" in " ".join(plain.output.split())
    data = json.loads(CliRunner().invoke(main, [*words, "--json"]).output)
    assert data["torque_lag"]["sampling"]
    assert data["torque_lag"]["lag"] == pytest.approx(0.0025, abs=0.0005)
    kept = json.loads((tmp_path / "m.json").read_text())["history"][-1]
    assert kept["torque_lag"]["warning"] in kept["warnings"]
