"""Steps and chirps: rows are derivatives, rest at both ends, bands; the drives' criterion and its gradient."""

import json

import numpy as np
import pytest
from click.testing import CliRunner

import frischid as fr
from frischid.cli.group import main
from frischid.effects import BASELINE
from frischid.errors import InputError
from frischid.model.drive_excitation import plan_for_drives
from frischid.motions.chirps import BAND, STEP_SHARES, USUAL, check_command_rate, highest_frequency, law
from frischid.motions.drive_information import DriveInformation
from frischid.motions.limits import MotionLimits


@pytest.mark.parametrize("family", STEP_SHARES)
def test_velocity_and_acceleration_are_derivatives(family, monkeypatch):
    monkeypatch.setattr("frischid.motions.chirps.POINTS_PER_PERIOD", 1200)
    t, (q, v, a), constant = law(family, 8.0, 5, USUAL)
    h = t[1] - t[0]
    for x, dx in ((q, v), (v, a)):
        between = np.abs((x[2:] - x[:-2]) / (2 * h) - dx[1:-1]).max(axis=0)
        assert (between <= 0.02 * np.abs(dx).max()).all()
    np.testing.assert_allclose(q @ constant, 1.0)
    np.testing.assert_allclose(v @ constant, 0.0, atol=1e-9)
    np.testing.assert_allclose(np.stack([v, a])[:, [0, -1]], 0.0, atol=1e-9)
    np.testing.assert_allclose(q[0], q[-1], atol=1e-9)  # the motion can run again


def test_chirps_span_their_band():
    t, (q, _, _), constant = law("chirps", 20.0, 10, 2.0)
    f = np.fft.rfftfreq(len(t), t[1] - t[0])
    chirps = q[:, constant == 0]
    power = np.abs(np.fft.rfft(chirps * np.hanning(len(t))[:, None], axis=0)) ** 2
    peaks = f[power.argmax(axis=0)]
    assert peaks.min() < 2 * 2.0 / BAND
    assert 0.7 * 2.0 < peaks.max() < 1.1 * 2.0


def test_steps_hold_their_poses():
    t, (_, v, _), constant = law("steps", 12.0, 5, USUAL)
    moving = np.abs(v).max(axis=1) > 0
    assert (constant == 1).all()
    assert 0.15 < 1 - moving.mean() < 0.6
    assert len(t) == len(moving)


def test_the_band_follows_from_the_limits():
    """An arm is held by its speed first, a quick leg by its range: from there on by the acceleration limit."""
    one = np.ones(1)
    arm, leg = highest_frequency(3 * one, 2 * one, 8 * one), highest_frequency(one, 30 * one, 120 * one)
    assert arm == pytest.approx(2 * 4 / (2 * np.pi))
    assert leg == pytest.approx(2 * np.sqrt(120) / (2 * np.pi))
    options = fr.PlanOptions(family="chirps").within(MotionLimits.of(fr.Robot.load("planar2")))
    assert options.highest == pytest.approx(2 * 4 / (2 * np.pi))
    with pytest.raises(InputError, match="must lie in"):
        fr.PlanOptions(highest=-1.0)


def test_too_short_or_too_coarse():
    with pytest.raises(InputError, match="at least 4 s, got 2"):
        fr.PlanOptions(duration=2.0, family="chirps").shape()
    with pytest.raises(InputError, match="needs a rate of at least 10 rows a second, got 5"):
        check_command_rate("steps+chirps", 2.0, 5.0)
    check_command_rate("fourier", 0.0, 10.0)


def information(J=2, C=7, p=5):
    rng = np.random.default_rng(4)
    return DriveInformation(
        rng.normal(size=(p, C)), rng.normal(size=C), rng.uniform(0.5, 2.0, C + 1 + J), np.arange(C) >= C - 3,
        rng.uniform(0.5, 2.0, J), 40.0, 0.1,
    )  # fmt: skip


def test_gradient_of_the_drives_criterion():
    wanted = information()
    W, direction = np.random.default_rng(5).normal(size=(2, 1, 30, 5, 2))
    _, slope = wanted(W)
    h = 1e-6
    change = (wanted(W + h * direction)[0] - wanted(W - h * direction)[0]) / (2 * h)
    assert (slope * direction).sum() == pytest.approx(change, rel=1e-5)


def test_the_cost_is_the_mean_log_variance_of_the_drives():
    wanted = information()
    W = np.random.default_rng(6).normal(size=(1, 30, 5, 2))
    chosen = wanted.wanted
    covariance = wanted.covariance(W[0])[np.ix_(chosen, chosen)]
    unit = wanted.spread[chosen]
    expected = np.linalg.slogdet(covariance / np.outer(unit, unit))[1] / len(chosen)
    assert wanted(W)[0] == pytest.approx(expected)


def servo_log(robot, model, motion, rate=100.0):
    """Positions of 14 bits under a position controller whose commands act 20 ms late."""
    t = np.arange(0.0, motion.duration, 1 / rate)
    qcmd = motion(t)[0]
    late = np.concatenate([qcmd[:1], qcmd[:1], qcmd[:-2]])
    hold = fr.PositionController(t, late, np.array([2500.0, 900.0]), np.array([200.0, 60.0]))
    starts = fr.Starts(qcmd[:1], np.zeros((1, 2)))
    count = 2 * np.pi / 2**14
    q = np.round(fr.ForwardDynamics(model).simulate(hold, starts, t).q[0] / count) * count
    return fr.Log(t, robot.joints, q=q, qcmd=qcmd, source="servo")


def widths(robot, log, **given):
    """Mean log width of the 95 % ranges of each quantity, and the share of true values inside."""
    controller = fr.PDController({"joint1": 2500.0, "joint2": 900.0}, {"joint1": 200.0, "joint2": 60.0}, **given)
    found = fr.drive_parameters(fr.identify(robot, [log], controller=controller, recursion="none").model)
    names = ("viscous", "coulomb", "armature", "delay")
    return {n: np.mean([np.log(x.upper - x.lower) for x in found if x.quantity == n]) for n in names}


def test_planned_commands_narrow_the_bounds_of_the_drives():
    """The same length, the same limits, the same search: steps and chirps beside the plain Fourier motion."""
    robot = fr.Robot.load("planar2")
    truth = {"fv1": 12.0, "fv2": 4.0, "fc1": 8.0, "fc2": 3.0, "Ia2": 0.5}
    seen = fr.simulate(robot, fr.random_fourier(robot, 10.0, seed=1), rate=200.0, parameters=truth)
    true = fr.identify(robot, [seen], effects=BASELINE, recursion="none").model
    plain = fr.plan(robot, options=fr.PlanOptions(duration=15.0, budget=400))
    planned = plan_for_drives(robot, fr.PlanOptions(duration=15.0, family="chirps", budget=400))
    assert not planned.plan.violations
    assert min(planned.narrower[k] for k in ("armature", "friction", "delay")) > 1.0
    one, other = (
        widths(robot, servo_log(robot, true, plan.trajectory), delay=0.02, delay_doubt=0.005)
        for plan in (plain, planned.plan)
    )
    assert {name: bool(other[name] < one[name]) for name in one} == dict.fromkeys(one, True)
    assert other["delay"] < one["delay"] - np.log(2)
    assert other["viscous"] < one["viscous"] - np.log(2)


def test_excite_for_drives(tmp_path):
    runner = CliRunner()
    path = tmp_path / "commands.yaml"
    line = ["excite", "planar2", "--drives", "--duration", "6", "--budget", "60", "--home", "zero", "-o", str(path)]
    result = runner.invoke(main, [*line, "--json"])
    assert result.exit_code == 0, result.output
    said = json.loads(result.stdout)
    assert set(said["standard_errors_smaller_by"]) == {"armature", "friction", "delay", "gains"}
    assert said["violations"] == []
    assert said["approach_seconds"] > 0
    assert path.read_text().startswith('joint_names: ["joint1"')
    for more, sentence in (
        (["--separate", "a,b"], "--separate for other ones"),
        (["--criterion", "condition"], "--criterion for other ones"),
        (["--rate", "5"], "rows a second, got 5"),
    ):
        refused = runner.invoke(main, [*line, *more])
        assert refused.exit_code != 0
        assert sentence in refused.output + str(refused.exception)


def test_a_clamped_leg_has_no_floor(tmp_path):
    """Every pose of a leg that hangs from its base is below the base."""
    line = ["excite", "go2", "--drives", "--duration", "5", "--budget", "30", "-o", str(tmp_path / "leg.csv"), "--json"]
    legs = [j for j in fr.Robot.load("go2").joints if not j.startswith("FL")]
    line += [x for j in legs for x in ("--lock", f"{j}={-1.5 if 'calf' in j else 0}")]
    hanging = CliRunner().invoke(main, [*line, "--floor", "none"])
    assert hanging.exit_code == 0, hanging.output
    assert not [x for x in json.loads(hanging.stdout)["violations"] if "floor" in x]
    wrong = CliRunner().invoke(main, [*line, "--floor", "high"])
    assert wrong.exit_code != 0
    assert "--floor" in wrong.output + str(wrong.exception)
    for height in ("nan", "inf"):  # a floor at NaN had been none
        wrong = CliRunner().invoke(main, [*line, "--floor", height])
        assert f"height of the floor must be a finite number of m, got {height}" in " ".join(wrong.output.split())
