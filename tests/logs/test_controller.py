"""Commanded positions: a controller makes the torque, and every later stage is that of a measured torque."""

from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.signal import lsim

import frischid as fr
from frischid.cli import main
from frischid.cli.pages import joint_drives
from frischid.logs.command_checks import CommandTravel, check_commands
from frischid.logs.delayed_commands import delayed
from frischid.logs.driven import driven
from frischid.model.drive_parameters import DriveParameter

T = np.arange(0.0, 6.0, 0.01)
JOINTS = ("joint1", "joint2")


def commanded(**changes):
    q = np.column_stack([np.sin(3 * T), 0.5 * np.cos(2 * T)])
    return fr.Log(T, JOINTS, **{"q": q, "qcmd": q + 0.1 * np.sin(7 * T)[:, None], "source": "servo.csv"} | changes)


@pytest.fixture(scope="module")
def robot():
    return fr.Robot.load("planar2")


@pytest.fixture(scope="module")
def measured(robot):
    """A log with torque, and the log with commands of the same motion."""
    log = fr.simulate(
        robot, fr.random_fourier(robot, 10.0, seed=1), rate=200.0, parameters={"fv1": 0.4, "fc2": 0.3}, channels=("v",)
    )
    return log, replace(log, tau=None, v=None, qcmd=log.q + (log.tau + 4.0 * log.v) / 400.0)


def test_the_law_of_the_controller():
    log = commanded(v=np.ones((len(T), 2)), vcmd=np.full((len(T), 2), 3.0), tauff=np.full((len(T), 2), 0.25))
    pd = fr.PDController(kp={"joint1": 20.0, "joint2": 30.0}, kd=1.5, limit={"joint2": 4.0}, dead_band=0.02)
    e = log.qcmd - log.q
    e = np.sign(e) * np.maximum(abs(e) - 0.02, 0.0)
    tau = np.array([20.0, 30.0]) * e + 1.5 * (3.0 - 1.0) + 0.25
    tau[:, 1] = np.clip(tau[:, 1], -4.0, 4.0)
    np.testing.assert_allclose(pd.drive(log).tau, tau)


@pytest.mark.parametrize("ends", ["both", "the position", "the command"])
def test_angles_that_wrap_are_no_position_errors(ends):
    """The two ends wrap at different times: between them, the error had been a whole turn."""
    log = commanded()
    q, goal = (
        x if ends in only else x % (2 * np.pi) for x, only in ((log.q, "the command"), (log.qcmd, "the position"))
    )
    wrapped = fr.PDController(kp=20.0, kd=1.0).drive(replace(log, q=q, qcmd=goal))
    np.testing.assert_allclose(wrapped.tau, fr.PDController(kp=20.0, kd=1.0).drive(log).tau, atol=1e-8)
    np.testing.assert_array_equal(wrapped.q, q)


def test_a_command_acts_after_its_delay():
    log = commanded()
    late = fr.PDController(kp=20.0, delay=0.03).drive(log).tau
    np.testing.assert_allclose(late, 20.0 * (log.qcmd[:-3] - log.q[3:]), atol=1e-9)


def test_between_two_samples_a_command_keeps_its_size():
    t = np.arange(0.0, 3.0, 0.01)
    late = delayed(t, np.sin(20 * t), 0.035)[10:]
    np.testing.assert_allclose(late, np.sin(20 * (t[10:] - 0.035)), atol=2e-3)  # a straight line: 5e-3 too small
    step = np.where(t > 1.0, 1.0, 0.0)
    assert (delayed(t, step, 0.035) >= 0.0).all()
    assert (delayed(t, step, 0.035) <= 1.0).all()


def test_a_held_command_is_the_mean_over_a_step():
    log, omega = commanded(), 20.0
    log = replace(log, q=0.0 * log.q, qcmd=np.column_stack([np.sin(omega * T)] * 2))
    held = fr.PDController(kp=1.0, delay=0.02, held=True).drive(log)
    assert held.t[0] == pytest.approx(0.03)  # the command of the first sample acts fully after delay and hold
    half = 0.5 * omega * 0.01
    wanted = np.sin(half) / half * np.sin(omega * (held.t - 0.025))
    np.testing.assert_allclose(held.tau[1:, 0], wanted[1:], atol=1e-3)
    assert "held commands" in str(fr.PDController(held=True))
    assert fr.PDController.from_dict(fr.PDController(kp=1.0, held=True).to_dict()).held
    with pytest.raises(fr.InputError, match="held must be true or false"):
        fr.PDController(held=1)


def test_velocity_is_the_slope_of_the_positions_where_none_was_measured():
    log = commanded()
    slope = np.column_stack([3 * np.cos(3 * T), -np.sin(2 * T)])
    tau = fr.PDController(kp=20.0, kd=1.0).drive(log).tau
    np.testing.assert_allclose(tau, 20.0 * (log.qcmd - log.q) - slope, atol=1e-3)


def test_a_measured_torque_is_kept_and_the_log_stays_the_same_log():
    tau = np.column_stack([np.ones(len(T)), np.full(len(T), np.nan)])
    log = commanded(tau=tau)
    found = fr.PDController(kp=20.0).drive(log)
    assert (found.tau[:, 0] == 1.0).all()
    assert np.isfinite(found.tau[:, 1]).all()
    assert found.identity == log.identity
    whole = commanded(tau=np.ones((len(T), 2)))
    assert fr.PDController(kp=20.0).drive(whole) is whole


def test_a_recording_gives_the_torque_of_the_log(tmp_path):
    log = commanded()
    fr.write_log(log, tmp_path / "log.parquet")
    pd = fr.PDController(kp=20.0, kd=1.0, delay=0.013)
    (recording,) = driven([fr.Recording.open(tmp_path / "log.parquet", JOINTS)], pd)
    parts = list(recording.chunks(100))
    assert len(parts) > 3
    whole = np.concatenate([part.tau for part in parts])
    ends = np.cumsum([len(part) for part in parts])  # a spline's slope is less sure at the last sample of a chunk
    np.testing.assert_allclose(np.delete(whole, ends - 1, 0), np.delete(pd.drive(log).tau, ends - 1, 0), atol=2e-3)
    np.testing.assert_allclose(whole, pd.drive(log).tau, atol=2e-2)


def recorded(log, path):
    fr.write_log(log, path)
    (recording,) = driven([fr.Recording.open(path, log.joints)], fr.PDController(kp=20.0))
    return recording


def test_a_robot_rests_in_whole_chunks_of_a_recording(tmp_path):
    """A recorder starts long before the motion: nobody can tell from such a chunk whether the commands ever move."""
    log, rest = commanded(), 300
    t = np.arange(rest + len(T)) * 0.01
    q, goal = (np.vstack([np.repeat(x[:1], rest, axis=0), x]) for x in (log.q, log.qcmd))
    recording = recorded(replace(log, t=t, q=q, qcmd=goal), tmp_path / "log.parquet")
    assert not np.ptp(recording.preview().qcmd, axis=0).any()
    found = np.concatenate([part.tau for part in recording.chunks(100)])
    np.testing.assert_allclose(found, 20.0 * (goal - q), atol=1e-12)


def test_the_commands_of_a_whole_recording_must_move(tmp_path):
    log = commanded()
    still = recorded(replace(log, qcmd=np.ones_like(log.q)), tmp_path / "still.parquet")
    with pytest.raises(fr.InputError, match=r"still.parquet: the commanded positions .* never move"):
        list(still.chunks(100))
    servo, wrong = servos(), servos().qcmd.copy()
    wrong[:, 1] = 0.1
    other = recorded(replace(servo, qcmd=wrong), tmp_path / "other.parquet")
    with pytest.raises(fr.InputError, match="the commanded position of middling never moves, and the joint itself"):
        list(other.chunks(500))


def test_the_travel_of_chunks_is_that_of_the_whole():
    log = servos()
    whole, parts = CommandTravel.of(log), [log.slice(a, b) for a, b in ((0, 700), (700, 1100), (1100, None))]
    first, second, third = map(CommandTravel.of, parts)
    for value, expected in zip(first.joined(second).joined(third)[1:], whole[1:], strict=True):
        np.testing.assert_allclose(value, expected, atol=1e-12)


def test_a_model_from_commands_is_that_from_torques(robot, measured, tmp_path):
    log, servo = measured
    pd = fr.PDController(kp=400.0, kd=4.0)
    ours = fr.identify(robot, [servo], controller=pd, recursion="none", cutoff=10.0)
    theirs = fr.identify(robot, [replace(log, v=None)], recursion="none", cutoff=10.0)
    np.testing.assert_allclose(ours.model.estimate.theta, theirs.model.estimate.theta, atol=0.02)
    ours.model.save(tmp_path / "model.json")
    again = fr.Model.load(tmp_path / "model.json")
    assert again.controller == pd
    assert fr.compare(again, [servo]).nrmse == pytest.approx(fr.compare(ours.model, [servo]).nrmse)
    assert again.made_from(servo)
    assert fr.diagnose(again, [servo], effects=["viscous"]).to_dict()
    assert fr.add(again, fr.parse_effects("joint_spring@joint2"), [servo]).model.controller == pd


def test_without_a_controller_the_error_names_one(robot, measured):
    with pytest.raises(fr.InputError, match="--controller pd"):
        fr.identify(robot, [measured[1]])
    (report,) = fr.check(robot, [measured[1]])
    assert [issue.kind for issue in report.issues] == ["commands only"]
    (report,) = fr.check(robot, [measured[1]], controller=fr.PDController(kp=400.0, kd=4.0))
    assert not report.issues


def test_what_ctrl_of_mujoco_means_is_said_where_no_torque_is_known(robot, measured):
    log = replace(measured[1], qcmd=None, extra={"ctrl_joint1": measured[1].q[:, 0]})
    with pytest.raises(fr.InputError, match=r"qcmd = 'ctrl_\{joint\}' under .* qfrc_actuator is the torque"):
        fr.identify(robot, [log])


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"kp": -20.0}, "kp must be above 0, got -20: a drive pushes towards its command"),
        ({"kp": 0.0}, "kp must be above 0"),
        ({"kp": 20.0, "kd": {"joint1": -1.0}}, "kd of joint1 must be at least 0"),
        ({"kp": float("nan")}, "kp must be a number"),
        ({"kp": "20"}, "kp must be a number"),
        ({"kp": 20.0, "limit": 0}, "limit must be above 0"),
    ],
)
def test_gains_of_the_wrong_sign(values, words):
    with pytest.raises(fr.InputError, match=words):
        fr.PDController(**values)


def test_a_controller_that_does_not_fit_the_robot_or_the_log(robot, measured):
    servo = measured[1]

    def run(log=servo, **values):
        return fr.identify(robot, [log], controller=fr.PDController(**values))

    with pytest.raises(fr.InputError, match=r"unknown joint 'jiont1'.*kp.*joint1"):
        run(kp={"jiont1": 20.0})
    with pytest.raises(fr.InputError, match="kp of joint2 is not known"):
        fr.PDController(kp={"joint1": 20.0}).drive(servo)
    with pytest.raises(fr.InputError, match="a delay of 2 s of joint1 is 400 steps of 5 ms, and at most 50"):
        run(kp=20.0, delay=2.0)
    with pytest.raises(fr.InputError, match=r"commanded positions .* never move"):
        run(replace(servo, qcmd=np.ones_like(servo.q)), kp=20.0)


@pytest.mark.parametrize(
    ("factor", "words"),
    [
        (-1.0, "opposite sign of the positions"),
        (180 / np.pi, "in degrees beside positions in rad"),
        (-180 / np.pi, "in degrees, with the opposite sign"),
        (np.pi / 180, "in rad beside positions in degrees"),
    ],
)
def test_commands_of_another_unit_or_sign_are_said(robot, measured, factor, words):
    servo = measured[1]
    wrong = servo.qcmd.copy()
    wrong[:, 1] = 0.3 + factor * wrong[:, 1]
    with pytest.raises(fr.InputError, match=rf"the commanded positions of joint2 .*{words}"):
        fr.identify(robot, [replace(servo, qcmd=wrong)], controller=fr.PDController(kp=400.0, kd=4.0))


def test_identify_names_the_joints_whose_values_the_logs_leave_open(monkeypatch):
    known = [("joint1", "armature", "open"), ("joint2", "armature", "open"), ("joint1", "viscous", "roughly")]
    known += [("joint2", "coulomb", "open"), ("joint2", "viscous", "identified")]
    rows = [DriveParameter(joint, what, "", 1.0, 0.0, 2.0, word) for joint, what, word in known]
    monkeypatch.setattr(joint_drives, "drive_parameters", lambda _: rows)
    assert joint_drives.left_open(None) == [
        "these logs leave values of drives open: armature of joint1 and joint2; Coulomb friction of joint2"
    ]
    monkeypatch.setattr(joint_drives, "drive_parameters", lambda _: rows[2:3])
    assert joint_drives.left_open(None) == []


def test_a_servo_that_hardly_follows_has_no_wrong_unit():
    """Far beyond its bandwidth a servo moves a tenth of the command, late by half a period."""
    t = np.arange(0.0, 10.0, 0.005)
    for share, phase in ((0.1, np.pi), (0.4, 0.9 * np.pi), (0.05, 0.5 * np.pi), (1.3, 0.6 * np.pi)):
        log = fr.Log(t, ("joint",), q=share * np.sin(20 * t - phase)[:, None], qcmd=np.sin(20 * t)[:, None])
        check_commands(log)


def servos(gain=30.0, damping=5.0):
    """Three joints of inertia 1 behind springs to slow, middling and fast commands; they follow late, and not quite."""
    t = np.arange(0.0, 20.0, 0.005)
    c = np.stack([np.sin(w * t) + 0.3 * np.sin(1.7 * w * t) for w in (1.0, 2.0, 3.0)], axis=1)
    q = [lsim(([gain], [1.0, damping, gain]), x, t)[1] for x in c.T]
    return fr.Log(t, ("slow", "middling", "fast"), q=np.stack(q, axis=1), qcmd=c)


@pytest.mark.parametrize("joint", range(3))
@pytest.mark.parametrize("offset", [0.0, 0.4])
def test_a_reversed_command_of_a_servo_that_follows_late(joint, offset):
    """Errors as large as the motion itself, and a command with an offset."""
    log = servos()
    check_commands(log)
    wrong = log.qcmd.copy()
    wrong[:, joint] = offset - wrong[:, joint]
    with pytest.raises(fr.InputError, match=f"of {log.joints[joint]} have the opposite sign"):
        check_commands(replace(log, qcmd=wrong))


@pytest.mark.parametrize("joint", range(3))
def test_a_joint_moves_though_its_command_never_does(joint):
    log = servos()
    wrong = log.qcmd.copy()
    wrong[:, joint] = 0.1
    with pytest.raises(fr.InputError, match=f"of {log.joints[joint]} never moves, and the joint itself moves"):
        check_commands(replace(log, qcmd=wrong))
    # a joint that holds its position is shaken by the others, and its command is right
    q = log.q.copy()
    q[:, joint] = 0.1 + 0.05 * q[:, joint]
    check_commands(replace(log, q=q, qcmd=wrong))


def test_the_command_line(tmp_path, measured, robot, monkeypatch):
    monkeypatch.chdir(tmp_path)
    fr.write_log(measured[1], "servo.parquet")
    (tmp_path / "pd.toml").write_text("kd = 4.0\n[kp]\njoint1 = 400.0\njoint2 = 400.0\n")
    (tmp_path / "wrong.toml").write_text("kq = 4.0\n")
    base = ["identify", "planar2", "servo.parquet", "--bbrf", "none"]

    def run(*words):
        return CliRunner().invoke(main, [*base, *words])

    done = run("--controller", "pd.toml", "-o", "model.json")
    assert done.exit_code == 0, done.output
    assert "by the controller pd(kp 400, kd 4)" in done.output
    assert fr.Model.load("model.json").controller.values("kp", JOINTS).tolist() == [400.0, 400.0]
    # the model finds its log again and makes its torque again, so its logs are read as those of any other model
    assert fr.Model.load("model.json").fitted_logs[0]["file"]["path"].endswith("servo.parquet")
    done = run("--controller", "pd", "--kp", "joint*=400", "--kd", "4", "--json")
    assert '"controller"' in done.output
    for words, message in [
        (["--controller", "pd", "--kp", "elbow=20"], "unknown joint 'elbow'"),
        (["--controller", "pd", "--kp", "twenty"], "--kp: 'twenty' is not a number"),
        (["--controller", "pd", "--kp", "-20"], "kp must be above 0"),
        (["--kp", "20"], "--kp describes a controller; add --controller pd"),
        (["--controller", "wrong.toml"], "unknown key 'kq'"),
        (["--controller", "none.toml"], "the controller file cannot be read"),
        (["--controller", "pid"], "there is no such controller; give pd"),
        (["--controller", "current", "--kp", "20"], "--kp is of a controller of positions"),
        (["--gain", "20"], "add --controller current"),
        (["--controller", "voltage", "--gain", "elbow=20"], "unknown joint 'elbow'"),
    ]:
        done = run(*words)
        assert done.exit_code == 2
        assert message in done.output
        assert "Traceback" not in done.output


def test_drives_of_current_and_voltage_are_named(tmp_path, measured, monkeypatch):
    monkeypatch.chdir(tmp_path)
    log, gains = measured[0], np.array([10.0, 5.0])
    fr.write_log(replace(log, tau=None, qcmd=None, current=log.tau / gains, sha256=None), "drives.parquet")
    for kind, words in (("current", ["--gain", "joint1=10,joint2=5"]), ("voltage", ["--gain", "joint*=10"])):
        done = CliRunner().invoke(
            main, ["identify", "planar2", "drives.parquet", "--controller", kind, *words, "-o", f"{kind}.json"]
        )
        assert done.exit_code == 0, done.output
        told = fr.Model.load(f"{kind}.json").currents
        assert told.gain["joint1"] == 10.0
        assert not told.doubt
    done = CliRunner().invoke(main, ["check", "planar2", "drives.parquet", "--controller", "current", "--gain", "10"])
    assert "torque of 2 joints from their currents" in done.output
    open_gains = CliRunner().invoke(main, ["identify", "planar2", "drives.parquet", "--controller", "current"])
    assert "from the URDF's masses" in open_gains.output


def test_cut_writes_two_logs(tmp_path, measured, monkeypatch):
    monkeypatch.chdir(tmp_path)
    fr.write_log(measured[1], "servo.csv")
    for words in (["--until", "7", "-o", "first.csv"], ["--from", "7", "-o", "rest.csv"]):
        assert CliRunner().invoke(main, ["cut", "servo.csv", *words]).exit_code == 0
    first, rest = fr.read_log("first.csv"), fr.read_log("rest.csv")
    assert len(first) + len(rest) == len(measured[1])
    assert first.t[-1] < rest.t[0] == pytest.approx(7.0)
    assert (rest.qcmd == measured[1].qcmd[len(first) :]).all()
    done = CliRunner().invoke(main, ["cut", "servo.csv", "--from", "20", "-o", "none.csv"])
    assert done.exit_code == 2
    assert "0 samples of this log of 10 s" in done.output


def test_a_mapping_converts_commands_as_positions(tmp_path):
    table = np.column_stack([T, np.degrees(np.sin(T)), np.degrees(np.sin(T + 0.1)), np.cos(T), 3 * np.ones(len(T))])
    np.savetxt(tmp_path / "l.csv", table, delimiter=",", header="t,present,goal,speed,ff", comments="")
    keys = {"q": "present", "qcmd": "goal", "tauff": "ff", "sign": -1, "offset": 0.5, "gear_ratio": 2.0}
    log = fr.read_log(tmp_path / "l.csv", mapping={"file": {"angle_unit": "deg"}, "joint": {"elbow": keys}})
    np.testing.assert_allclose(log.qcmd[:, 0], -np.sin(T + 0.1) / 2 + 0.5)
    np.testing.assert_allclose(log.tauff[:, 0], -6.0)


def test_a_damaged_controller_in_a_model_file(robot, measured):
    model = fr.identify(robot, [measured[0]], recursion="none").model.to_dict()
    for wrong in ({"kp": -1.0}, {"kp": {"elbow": 3.0}}):
        with pytest.raises(fr.InputError, match=r"damaged.*controller"):
            fr.Model.from_dict(model | {"controller": wrong})
