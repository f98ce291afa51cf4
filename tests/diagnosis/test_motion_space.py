"""Findings in simulated motion: commands that act late, another gain, a spring, and their simulated errors."""

import json

import numpy as np
import pytest
from cases import robot
from click.testing import CliRunner

import frischid as fr
from frischid.cli import main
from frischid.diagnosis.motion_space import simulated_error
from frischid.effects import parse_effects
from frischid.errors import InputError
from frischid.logs.readers import write_log

KP, KD, RATE = 300.0, 12.0, 100.0


def commanded(seed, *, late=0.0, gain=1.0, spring=0.0):
    """A log of commands and positions; the commands act late, and joint 2 has another gain and a spring."""
    machine = robot("planar2")
    motion = fr.random_fourier(machine, 12.0, seed=seed, scale=0.8)
    hidden = (*fr.BASELINE, *parse_effects("joint_spring@joint2")) if spring else fr.BASELINE
    parameters = {"fv1": 0.6, "fv2": 0.4, "fc1": 0.8, "fc2": 0.5} | ({"ks2": spring} if spring else {})
    log = fr.simulate(machine, motion, rate=RATE, effects=hidden, parameters=parameters, seed=seed)
    v, a = (motion(log.t)[k] for k in (1, 2))
    kp = KP * np.array([1.0, gain])
    qcmd = log.q + (log.tau + KD * v) / kp  # as if the joints followed the motion
    ahead = np.column_stack([np.interp(log.t + late, log.t, x) for x in qcmd.T])
    assert np.isfinite(a).all()
    rng = np.random.default_rng(seed)
    noisy = log.q + 1e-5 * rng.normal(size=log.q.shape)
    whole = fr.Log(log.t, log.joints, q=noisy, qcmd=ahead, source=f"commanded {seed}")
    return fr.stretch(whole, start=0.5, stop=11.5)


def identified(logs):
    controller = fr.PDController(kp=KP, kd=KD)
    return fr.identify(robot("planar2"), logs, controller=controller, recursion="none").model


def test_commands_that_act_late_are_named_and_correct_the_delay():
    logs = [commanded(seed, late=0.02) for seed in (1, 2)]
    model = identified(logs)
    found = fr.diagnose(model, logs)
    assert (found.verdict, found.findings[0].effect, found.findings[0].joints) == ("effect", "command_delay", ())
    assert not any(f.effect == "time_delay" for f in found.findings)  # no torque was recorded, so none is late
    moved = fr.simulate_findings(model, found, logs)
    assert [x.finding for x in moved.findings] == [f for f in found.findings if f.members and f.gain > 0]
    assert moved.closed
    assert moved.findings[0].ratio < 0.3
    step = fr.add(model, found.findings[0].members, logs)
    delays = [x for x in fr.drive_parameters(step.model) if x.quantity == "delay"]
    assert [x.known for x in delays] == ["identified"] * 2
    assert all(abs(x.value - 0.02) < 0.002 for x in delays)
    assert all(x.lower <= 0.02 + 1e-3 and x.upper >= 0.02 - 1e-3 for x in delays)


def test_another_gain_is_named_and_the_simulated_motion_agrees():
    logs = [commanded(seed, gain=0.75) for seed in (5, 6)]
    model = identified(logs)
    found = fr.diagnose(model, logs)
    first = found.findings[0]  # whether joint 2 is too weak or joint 1 too strong, only the masses tell
    assert (found.verdict, first.effect) == ("effect", "position_gain")
    assert not any(f.effect == "drive_gain" for f in found.findings)  # it would scale the drive's damping too
    moved = fr.simulate_findings(model, found, logs)
    assert moved.findings[0].ratio < 0.05
    assert first.error_after < 0.1 * first.error_before


def test_the_search_names_the_joint_whose_gain_is_wrong_and_add_agrees():
    """A gain of joint 1 would need negative friction of joint 2, which no fit may have."""
    logs = [commanded(seed, gain=1.3) for seed in (3, 4)]
    model = identified(logs)
    first = fr.diagnose(model, logs).findings[0]
    assert (first.effect, first.joints) == ("position_gain", ("joint2",))
    assert first.parameters["soft2"] == pytest.approx(1 / 1.3 - 1, abs=0.005)
    assert fr.add(model, first.members, logs).error_after == pytest.approx(first.error_after, rel=0.2)


def test_the_drive_of_a_corrected_gain_has_the_true_one():
    logs = [commanded(seed, gain=1.3) for seed in (3, 4)]
    model = identified(logs)
    before = simulated_error(model, logs)
    step = fr.add(model, parse_effects("position_gain@joint2"), logs)
    after = simulated_error(step.model, logs)
    assert max(after.values()) < 0.05 * max(before.values())
    assert step.error_after < 0.05 * step.error_before
    rows = {(x.joint, x.quantity): x for x in fr.drive_parameters(step.model)}
    gain = rows["joint2", "stiffness"]
    assert gain.value == pytest.approx(1.3 * KP, rel=0.02)
    assert gain.known == "as a ratio"
    assert rows["joint1", "stiffness"].known == "given"
    assert rows["joint2", "viscous"].value == pytest.approx(0.4, abs=0.15)


def test_the_simulated_motion_says_which_finding_mends_it(tmp_path):
    logs = [commanded(seed, spring=6.0) for seed in (5, 6, 7)]
    model = identified(logs[:2])
    found = fr.diagnose(model, logs[:2])
    assert found.findings[0].effect == "joint_spring"
    fitted = fr.simulate_findings(model, found, logs[:2])
    tested = fr.simulate_findings(model, found, logs[:2], valid=logs[2:])
    assert (fitted.tested, tested.tested) == (False, True)
    for moved in (fitted, tested):
        assert moved.findings[0].finding.effect == "joint_spring"
        assert moved.findings[0].joints["joint2"] < 0.3 * moved.joints["joint2"]
        assert moved.joints != fitted.joints or moved is fitted
        assert json.loads(json.dumps(moved.to_dict()))["closed_loop"] is True


def test_a_finding_that_cannot_be_simulated_says_why():
    logs = [commanded(8, spring=6.0)]
    model = identified(logs)
    found = fr.diagnose(model, logs, effects=["elasticity", "joint_spring"])
    moved = fr.simulate_findings(model, found, logs)
    flexible = [f for f in moved.findings if f.finding.effect == "elasticity"]
    assert all("cannot be simulated" in f.refused and not f.joints and f.ratio == 1.0 for f in flexible)
    (log,) = logs
    other = fr.Log(log.t, ("joint1",), q=log.q[:, :1], tau=log.q[:, :1], source="one joint")
    refused = fr.simulate_findings(model, found, [other], valid=logs).findings[0].refused
    assert "one joint: no position (q_<joint>) of joint2" in refused
    with pytest.raises(InputError, match="horizon"):
        fr.simulate_findings(model, found, logs, horizon=-1.0)


def test_recorded_torques_have_neither_effect():
    machine = robot("planar2")
    log = fr.simulate(machine, fr.random_fourier(machine, 8.0, seed=1), rate=100.0, noise=fr.Noise(tau=0.01))
    model = fr.identify(machine, [log], recursion="none").model
    names = {f.effect for f in fr.diagnose(model, [log]).findings}
    assert "command_delay" not in names
    assert "time_delay" in names


def test_the_motion_of_commands_can_be_fitted():
    logs = [commanded(seed, spring=6.0) for seed in (5, 6)]
    model = identified(logs[:1])
    options = fr.OutputErrorOptions(horizon=0.5, rounds=1, iterations=4)
    found = fr.output_error(model, logs[:1], valid=logs[1:], options=options)
    assert found.ratio <= 1.0
    assert found.tested is not None
    assert found.tested[1].closed
    assert max(simulated_error(found.model, logs[:1]).values()) < 0.05


def test_the_command_shows_the_simulated_errors(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    logs = [commanded(seed, late=0.02) for seed in (1, 2)]
    identified(logs).save("model.json")
    for number, log in enumerate(logs):
        write_log(log, f"log{number}.csv")
    line = ["diagnose", "model.json", "log0.csv", "log1.csv"]
    done = CliRunner().invoke(main, [*line, "--simulate"], env={"COLUMNS": "160"})
    assert done.exit_code in (0, 1), done.output
    assert "simulated positions over 1 s under the model's controller" in done.output
    data = CliRunner().invoke(main, [*line, "--simulate", "--json"])
    moved = json.loads(data.stdout)["simulated"]
    assert moved["closed_loop"]
    assert moved["findings"][0]["effect"] == "command_delay"
    assert moved["findings"][0]["simulated"]["ratio"] < 0.3
    plain = CliRunner().invoke(main, [*line, "--json"])
    assert "simulated" not in json.loads(plain.stdout)
