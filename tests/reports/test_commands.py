"""Printed commands name the files that were used, and help against the alarms that stand above them."""

import shlex
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
from click.testing import CliRunner
from rich.text import Text

import frischid as fr
from frischid.cli import main
from frischid.cli.pages.page import alarm_lines
from frischid.estimators.least_squares import Estimate
from frischid.model.alarms import Alarm, by_severity
from frischid.reports.chapters import CHAPTERS
from frischid.reports.chapters.verdict import _cut, content
from frischid.reports.commands import alone, check_command
from frischid.reports.study import study


def written(name, seconds=10.0, seed=1, sign=1.0):
    """A log of planar2 in a file whose time column needs a mapping."""
    robot = fr.Robot.load("planar2")
    log = fr.simulate(robot, fr.random_fourier(robot, seconds, seed=seed), rate=50.0, noise=fr.Noise(tau=0.01))
    fr.write_log(replace(log, tau=log.tau * [1.0, sign]), name)
    text = Path(name).read_text(encoding="utf-8")
    Path(name).write_text(text.replace("t,", "stamp,", 1), encoding="utf-8")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "my map.toml").write_text('[file]\ntime = "stamp"\n', encoding="utf-8")
    return tmp_path


def identified(more=""):
    words = f"identify planar2 log.csv --map 'my map.toml' --bbrf none -o model.json {more}"
    result = CliRunner().invoke(main, [*shlex.split(words), "--width", "300"])
    return result.stdout.partition("next: ")[2].strip(), result.stdout


def test_the_next_command_names_the_test_log_and_its_mapping(folder):
    written("log.csv")
    written("test log.csv", seed=2)
    line, _ = identified("--valid 'test log.csv'")
    assert line == "frischid diagnose model.json --valid 'test log.csv' --map 'my map.toml'"
    done = CliRunner().invoke(main, [*shlex.split(line)[1:], "--try", "joint_spring"])
    assert done.exit_code in (0, 1), done.output
    assert "on logs it was not fitted to" in " ".join(done.stdout.split())


def test_the_output_calls_a_doubt_a_doubt():
    lines = alarm_lines([Alarm("log-too-short", "severe", "", ""), Alarm("faster-than-fitted", "doubt", "", "")])
    assert [Text.from_markup(line).plain.split(":")[0] for line in lines] == [
        "ALARM log-too-short",
        "DOUBT faster-than-fitted",
    ]


def test_a_faulty_log_is_checked_first(folder):
    written("log.csv", seconds=20.0, sign=-1.0)
    line, page = identified()
    assert page.startswith("ALARM faulty-log")
    assert line == "frischid check planar2 log.csv --map 'my map.toml' -o map.toml"
    done = CliRunner().invoke(main, shlex.split(line)[1:])
    assert done.exit_code in (0, 1), done.output
    assert "torque sign" in done.stdout
    done = CliRunner().invoke(main, ["--quiet", "diagnose", "model.json", "--try", "joint_spring"])
    assert "Unless a log has the fault that the alarm names, " in " ".join(done.stdout.split())


def test_a_short_log_is_recorded_again(folder):
    written("log.csv", seconds=3.0)
    assert identified()[0] == "frischid excite planar2 -o motion.csv"


def test_the_causes_come_first():
    names = ("worse-than-constant", "log-leaves-open", "faulty-log", "log-too-short")
    alarms = by_severity([Alarm("doubt", "doubt", "", ""), *(Alarm(n, "severe", "", "") for n in names)])
    order = [alarm.id for alarm in alarms]
    assert order == ["faulty-log", "log-too-short", "worse-than-constant", "log-leaves-open", "doubt"]


def test_the_report_names_its_test_log_and_fills_in_the_check(folder):
    robot, spring = fr.Robot.load("planar2"), fr.parse_effects("joint_spring@joint2")
    for name, seed in (("log.csv", 1), ("test.csv", 2)):
        motion = fr.random_fourier(robot, 40.0, seed=seed)
        noise, values = fr.Noise(q=1e-5, tau=0.05), {"ks2": 4.0}
        log = fr.simulate(
            robot, motion, rate=50.0, effects=(*fr.BASELINE, *spring), parameters=values, noise=noise, seed=seed
        )
        fr.write_log(log, name)
    logs = [fr.read_log(folder / name, robot.joints) for name in ("log.csv", "test.csv")]
    fr.identify(robot, logs[:1], recursion="none").model.save("model.json")
    model = fr.Model.load("model.json")
    commands = [step["command"] for step in content(study(model, logs), "model.json")["next"]]
    (add,) = [command for command in commands if " add " in command]
    assert add == "frischid add model.json joint_spring --joints joint2 --valid test.csv -o better.json"
    assert CliRunner().invoke(main, shlex.split(add)[1:]).exit_code in (0, 1)
    assert check_command(model, name=alone) == "frischid check planar2 log.csv"


def test_the_report_on_a_changed_robot_names_the_log_with_the_change(folder):
    """The command had said LOG... and no mapping file: copied, it was refused."""
    written("log.csv", seconds=20.0)
    identified()
    model, robot = fr.Model.load("model.json"), fr.Robot.load("planar2")
    body = {"effects": fr.parse_effects("payload@joint2"), "parameters": {"dm2": 3.0, "dmx2": 1.5}}
    motion = fr.random_fourier(robot, 20.0, seed=2)
    loaded = fr.simulate(robot, motion, rate=50.0, noise=fr.Noise(tau=0.01), seed=2, **body)
    fr.write_log(loaded, "with a body.csv")
    text = Path("with a body.csv").read_text(encoding="utf-8")
    Path("with a body.csv").write_text(text.replace("t,", "stamp,", 1), encoding="utf-8")
    log = fr.read_log("with a body.csv", robot.joints, "my map.toml")
    shown = study(model, [log])
    assert shown.diagnosis.situation == "changed"
    (add,) = [x["command"] for x in content(shown, "model.json")["next"] if " add " in x["command"]]
    assert add.startswith("frischid add model.json payload --joints joint2 'with a body.csv' --map 'my map.toml' -o")
    done = CliRunner().invoke(main, shlex.split(add)[1:])
    assert done.exit_code in (0, 1), done.output
    assert "payload" in done.stdout


def test_commands_of_a_model_of_some_joints(folder, monkeypatch):
    written("log.csv")
    _, page = identified("--torque-joints joint1")
    assert "planar2" in page
    model = fr.Model.load("model.json")
    command = check_command(model, name=alone)
    assert command == "frischid check planar2 log.csv --map 'my map.toml' --torque-joints joint1"
    assert CliRunner().invoke(main, shlex.split(command)[1:]).exit_code in (0, 1)
    monkeypatch.setattr(Estimate, "hardly_known", property(lambda _: ("Izz2",)))
    shown = study(model, fr.own_logs(model).logs)
    page = str(next(c for c in CHAPTERS if c.anchor == "verdict").html(shown, "model.json"))
    assert "frischid excite has no --torque-joints" in page


def test_a_command_finds_the_robot_from_another_folder(folder, monkeypatch):
    """The model names its robot's file relative to itself; the page names no folder of a machine."""
    robot = fr.Robot.load("planar2")
    (folder / "arm").mkdir()
    Path("arm/robot.urdf").write_text(robot.urdf, encoding="utf-8")
    written("log.csv", seconds=20.0, sign=-1.0)
    words = "identify arm/robot.urdf log.csv --map 'my map.toml' --bbrf none -o model.json"
    CliRunner().invoke(main, shlex.split(words))
    assert fr.Model.load("model.json").robot.source == str(Path("arm/robot.urdf"))
    monkeypatch.chdir(folder / "arm")
    model = fr.Model.load("../model.json")
    assert model.robot.source == "robot.urdf"
    (folder / "elsewhere").mkdir()
    monkeypatch.chdir(folder / "elsewhere")
    model = fr.Model.load("../model.json")
    done = CliRunner().invoke(main, shlex.split(check_command(model))[1:])
    assert done.exit_code == 1, done.output
    assert check_command(model, name=alone) == "frischid check robot.urdf log.csv --map 'my map.toml'"
    model.save("again.json")
    assert '"source": "../arm/robot.urdf"' in Path("again.json").read_text(encoding="utf-8")


def test_the_part_that_nobody_touched_is_cut_with_the_mapping_of_its_log(folder):
    written("log.csv")
    log = fr.read_log("log.csv", fr.Robot.load("planar2").joints, "my map.toml")
    touched = SimpleNamespace(to_cut_out=[(log.source, 6.0, 7.0)])
    command = _cut(SimpleNamespace(logs=(log,)), touched)
    assert command == "frischid cut log.csv --from 0.0 --until 6.0 --map 'my map.toml' -o log_part.csv"
    done = CliRunner().invoke(main, shlex.split(command)[1:])
    assert done.exit_code == 0, done.output
