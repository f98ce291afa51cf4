"""What a new user meets first: the list of commands, and the command that is proposed next."""

import re
import shlex

from click.testing import CliRunner

import frischid as fr
from frischid.cli import main
from frischid.cli.group import SECTIONS


def test_help_lists_every_command_once_in_the_order_of_the_work():
    text = CliRunner().invoke(main, ["--help"]).stdout
    listed = re.findall(r"^  (\w+)  ", text, flags=re.MULTILINE)
    assert sorted(listed) == sorted(main.commands)
    assert next(iter(SECTIONS)) == "Begin"
    assert "Others" not in text, "a new command gets a section"


def test_the_next_command_runs_as_it_is_printed(tmp_path, monkeypatch):
    """From a log with columns of other names: the mapping file belongs to the command."""
    monkeypatch.chdir(tmp_path)
    robot = fr.Robot.load("planar2")
    log = fr.simulate(robot, fr.random_fourier(robot, 8, seed=1), rate=50, noise=fr.Noise(q=1e-5, tau=0.01))
    for name in ("log.csv", "second log.csv"):
        fr.write_log(log.slice(0 if name == "log.csv" else 100), name)
        table = (tmp_path / name).read_text(encoding="utf-8")
        (tmp_path / name).write_text(table.replace("t,", "stamp,", 1), encoding="utf-8")
    (tmp_path / "my map.toml").write_text('[file]\ntime = "stamp"\n', encoding="utf-8")
    words = [
        "identify",
        "planar2",
        "log.csv",
        "second log.csv",
        "--map",
        "my map.toml",
        "--bbrf",
        "none",
        "-o",
        "model.json",
    ]
    printed = CliRunner().invoke(main, words).stdout
    line = printed.partition("next: ")[2].strip()
    assert "--map 'my map.toml'" in line
    assert "..." not in line
    assert CliRunner().invoke(main, [*shlex.split(line)[1:], "--try", "joint_spring"]).exit_code in (0, 1)
