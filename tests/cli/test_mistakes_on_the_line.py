"""Typical mistakes on the command line: each message says what to do instead."""

import numpy as np
import pytest
from click.testing import CliRunner

import frischid as fr
from frischid.cli import main
from frischid.logs.torque_instead import torque_instead


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A robot, logs with and without torque and commands, a model, another JSON file, an empty folder."""
    where = tmp_path_factory.mktemp("mistakes")
    robot = fr.Robot.load("planar2")
    (where / "robot.urdf").write_text(robot.urdf, encoding="utf-8")
    log = fr.simulate(robot, fr.random_fourier(robot, 10.0, seed=1), rate=50.0, noise=fr.Noise(tau=0.01))
    fr.write_log(log, where / "log.csv")
    fr.write_log(fr.Log(log.t, log.joints, q=log.q), where / "positions.csv")
    fr.write_log(fr.Log(log.t, log.joints, q=log.q, qcmd=log.q + 0.01), where / "commanded.csv")
    fr.write_log(log.select(["joint1"]), where / "one_joint.csv")
    (where / "other.json").write_text("[1, 2]", encoding="utf-8")
    (where / "map.toml").write_text('[joint.joint1]\nq = "pos"\n', encoding="utf-8")
    fr.identify(robot, [log], recursion="none").model.save(where / "model.json")
    (where / "empty").mkdir()
    return where


def said(folder, monkeypatch, line):
    """What a command prints on stderr, in one line; its exit code is 2."""
    monkeypatch.chdir(folder)
    result = CliRunner().invoke(main, line.split())
    assert result.exit_code == 2, result.output
    return " ".join(result.stderr.split())


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("identify model.json log.csv", ["model.json: a JSON file", "give the robot's URDF or MJCF file"]),
        ("check log.csv robot.urdf", ["log.csv: not an XML file", "give the robot's URDF", "order of robot and logs"]),
        ("map robot.urdf log.csv", ["log.csv: not an XML file", "order of robot and logs"]),
        ("compare robot.urdf log.csv", ["robot.urdf: a robot, not a model", "frischid identify ROBOT LOG -o"]),
        ("diagnose log.csv model.json", ["not a JSON model file", "stands before logs"]),
        ("compare none.json log.csv", ["cannot be read", "frischid identify ROBOT LOG -o model.json"]),
        ("identify robot.urdf model.json", ["model.json: a model, not a log", ".parquet"]),
        ("identify robot.urdf other.json", ["cannot read '.json' files", "pandas.json_normalize"]),
        ("identify robot.urdf empty", ["empty: is a folder; no log is in it"]),
        ("identify robot.urdf .", [".: is a folder; give its files, for example *.csv"]),
        ("identify robot.urdf l*.csv", ["l*.csv: there is no such file", "write the pattern without quotes"]),
        ("identify robot.urdf log.csv --map map.toml", ["unknown column 'pos' in log.csv (q of joint1 in map.toml)"]),
        ("compare model.json one_joint.csv", ["no position (q_<joint>) of joint2", "frischid map LOG ROBOT"]),
        ("identify robot.urdf log.csv --estimator lasso", ["unknown estimator 'lasso'", "output_error"]),
        ("identify robot.urdf log.csv --cutoff fast", ["--cutoff: 'fast' is not a number of Hz, nor auto or none"]),
        ("identify robot.urdf log.csv --torque-lag late", ["'late' is not a number of seconds, nor auto or none"]),
        ("cut log.csv --from 5 --until 3 -o part.csv", ["from 5 s until 3 s", "--until, stop=) must be later"]),
        ("report model.json log.csv -o report.pdf", ["report.pdf: a report is an HTML page", ".html"]),
        (
            "export model.json -o x.xml --into robot.urdf",
            ["robot.urdf: no MJCF file", "takes the MJCF file"],
        ),
        ("improve model.json log.csv --max-steps -1", ["--max-steps", "-1 is not in the range x>=0"]),
        ("studio none.json log.csv", ["none.json: the model file cannot be read"]),
    ],
)
def test_a_message_says_what_to_do(folder, monkeypatch, line, words):
    text = said(folder, monkeypatch, line)
    assert all(word in text for word in words), text
    assert not [p for p in folder.iterdir() if p.suffix in {".pdf", ".html"} or p.name == "part.csv"]


@pytest.mark.parametrize("command", ["check robot.urdf", "identify robot.urdf", "compare model.json"])
def test_a_log_without_torque_is_told_where_one_may_come_from(folder, monkeypatch, command):
    text = said(folder, monkeypatch, f"{command} positions.csv")
    assert "no torque column (tau_<joint>) for joint1, joint2" in text
    assert "frischid map LOG ROBOT -o map.toml" in text
    assert "record one of them" in text


def test_commands_are_sent_to_an_option_that_the_command_has(folder, monkeypatch):
    """`compare` named --controller, which it does not have."""
    assert "become torques by --controller pd" in said(folder, monkeypatch, "identify robot.urdf commanded.csv")
    text = said(folder, monkeypatch, "compare model.json commanded.csv")
    assert "the model was fitted to torques" in text
    assert "frischid identify ROBOT LOG --controller pd" in text
    assert "become torques by" not in text


def test_the_page_does_not_open_before_a_wrong_model(folder, monkeypatch):
    monkeypatch.chdir(folder)
    assert CliRunner().invoke(main, ["studio", "none.json", "log.csv"]).stdout == ""


def test_a_controller_without_commands_is_no_part_of_the_fit(folder):
    robot = fr.Robot.load(folder / "robot.urdf")
    log = fr.read_log(folder / "log.csv", robot.joints)
    found = fr.identify(robot, [log], controller=fr.PDController(kp=400.0), recursion="none")
    assert any("no log has commanded positions" in text for text in found.warnings)
    alone = fr.identify(robot, [log], recursion="none").model
    motion = (log.q, log.v, log.a)
    np.testing.assert_array_equal(found.model.inverse_dynamics(*motion), alone.inverse_dynamics(*motion))
    with pytest.raises(fr.InputError, match="no log has commanded positions"):
        fr.identify(robot, [log], controller=fr.PDController(), recursion="none")
    commanded = fr.Log(log.t, log.joints, q=log.q, tau=log.tau, qcmd=log.q + 0.01)
    kept = fr.identify(robot, [commanded], controller=fr.PDController(kp=400.0), recursion="none")
    assert not any("no log has commanded positions" in text for text in kept.warnings)


@pytest.mark.parametrize(("column", "advised"), [("current_limit", False), ("current_joint1", True)])
def test_only_the_current_of_a_joint_may_become_a_torque(column, advised):
    said_of_it = torque_instead(["t", "q_joint1", column], ["joint1"], fitted=False)
    assert ("currents become torques" in said_of_it) == advised


def test_a_model_of_torques_is_not_sent_to_a_controller_by_ctrl():
    assert "--controller" in torque_instead(["ctrl_joint1"], ["joint1"], fitted=False)
    assert "--controller" not in torque_instead(["ctrl_joint1"], ["joint1"], fitted=True)
