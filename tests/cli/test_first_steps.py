"""What a new user meets first: the list of commands, and the command that is proposed next."""

import json
import re
import shlex
from pathlib import Path
from types import SimpleNamespace

import pytest
from click.testing import CliRunner

import frischid as fr
from frischid.cli import main
from frischid.cli.group import SECTIONS
from frischid.cli.pages.improving import elsewhere, shown
from frischid.diagnosis.rivals import IN_WORDS


def test_help_lists_every_command_once_in_the_order_of_the_work():
    text = CliRunner().invoke(main, ["--help"]).stdout
    listed = re.findall(r"^  (\w+)  ", text, flags=re.MULTILINE)
    assert sorted(listed) == sorted(main.commands)
    assert next(iter(SECTIONS)) == "Begin"
    assert "Others" not in text, "a new command gets a section"


@pytest.fixture
def own(tmp_path, monkeypatch):
    """A folder with a model of two logs, whose columns need a mapping file; what `identify` printed."""
    monkeypatch.chdir(tmp_path)
    robot = fr.Robot.load("planar2")
    log = fr.simulate(robot, fr.random_fourier(robot, 8, seed=1), rate=50, noise=fr.Noise(q=1e-5, tau=0.01))
    for name in ("log.csv", "second log.csv"):
        fr.write_log(log.slice(0 if name == "log.csv" else 100), name)
        table = (tmp_path / name).read_text(encoding="utf-8")
        (tmp_path / name).write_text(table.replace("t,", "stamp,", 1), encoding="utf-8")
    (tmp_path / "my map.toml").write_text('[file]\ntime = "stamp"\n', encoding="utf-8")
    words = "identify planar2 log.csv 'second log.csv' --map 'my map.toml' --bbrf none -o model.json"
    return CliRunner().invoke(main, shlex.split(words)).stdout


def test_the_next_command_runs_as_it_is_printed(own):
    """The model's file names the logs, and the mapping file that explains their columns."""
    line = own.partition("next: ")[2].strip()
    assert line == "frischid diagnose model.json"
    done = CliRunner().invoke(main, [*shlex.split(line)[1:], "--try", "joint_spring"])
    assert done.exit_code in (0, 1)
    assert "the model's own 2 logs" in done.stderr


@pytest.mark.parametrize(
    "command",
    [
        "diagnose model.json --try joint_spring --json",
        "add model.json joint_spring -o better.json --json",
        "improve model.json --max-steps 1 --json",
        "report model.json --json",
    ],
)
def test_a_model_without_logs_is_shown_with_its_own(own, command):
    """The same result as with the logs named."""
    named = command.replace(" --", " log.csv 'second log.csv' --map 'my map.toml' --", 1)
    if "-o" in command:
        named = command.replace(" -o", " log.csv 'second log.csv' --map 'my map.toml' -o", 1)
    alone, together = (CliRunner().invoke(main, shlex.split(x)) for x in (command, named))
    assert alone.exit_code == together.exit_code in (0, 1), alone.output
    # A log that is found again is named by its whole path, in the report too, which is longer by that.
    results = [json.loads(x.stdout.replace(f"{Path.cwd()}/", "")) for x in (alone, together)]
    first, second = ({k: v for k, v in x.items() if k != "bytes"} for x in results)
    assert first == second


def test_logs_that_are_gone_are_named(own):
    Path("log.csv").unlink()
    done = CliRunner().invoke(main, shlex.split("diagnose model.json --try joint_spring"))
    assert done.exit_code in (0, 1)
    assert "the model's own log (found by path and hash) will be used; not found: log.csv" in done.stderr
    Path("second log.csv").unlink()
    for command in ("diagnose model.json", "improve model.json", "report model.json", "studio model.json --port 0"):
        done = CliRunner().invoke(main, shlex.split(command))
        assert done.exit_code == 2
        assert "were not found (log.csv: there is no such file" in done.stderr


def test_notes_on_several_logs_stand_once(own):
    assert own.count("trimmed at the ends") == 1
    assert "log.csv (and the like of 1 other log): " in own


def test_findings_without_evidence_have_no_row():
    """At least three rows stand there; what has no row is told in the sentence on other causes."""

    def finding(effect, gain, probability):
        return SimpleNamespace(effect=effect, gain=gain, probability=probability)

    found = [finding("spring", 9.0, 0.9), finding("backlash", 4.0, 0.0), finding("stribeck", -1.0, 0.02)]
    found += [finding(f"other{k}", -1.0, 0.0) for k in range(5)]
    known = {f.effect: f.probability for f in found} | {"other9": 0.04, "none": 0.01}
    result = SimpleNamespace(by_verdict=found, verdict="effect", probabilities=dict.fromkeys(IN_WORDS, 0.0) | known)
    listed = shown(result)
    assert [f.effect for f in listed] == ["spring", "backlash", "stribeck"]
    assert elsewhere(result, listed).endswith("another effect 4 %")
