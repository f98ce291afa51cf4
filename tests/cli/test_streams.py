"""Streams that are closed, full, or cannot write every letter: no traceback, and nothing of theirs in a file."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

from frischid.cli import main


def shell(line, folder):
    """Run a line of the shell in which `frischid` stands for the command."""
    line = line.replace("frischid", f"{sys.executable} -m frischid")
    return subprocess.run(line, shell=True, cwd=folder, capture_output=True, text=True, check=False)


def test_a_closed_stream_is_no_file(tmp_path):
    done = shell("frischid simulate planar2 --duration 1 -o log.csv <&- >&- 2>&-", tmp_path)
    assert done.returncode == 0
    assert (tmp_path / "log.csv").read_text().splitlines()[0].startswith("t,q_joint1")
    assert shell("frischid effects --json >&-", tmp_path).returncode == 0


def test_a_stream_of_ascii_loses_letters_and_json_loses_none(tmp_path):
    done = shell("PYTHONIOENCODING=ascii frischid effects viscous", tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert "fv?v" in done.stdout
    done = shell("PYTHONIOENCODING=ascii frischid effects viscous --json", tmp_path)
    assert "fv·v" in json.dumps(json.loads(done.stdout), ensure_ascii=False)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
@pytest.mark.parametrize("options", ["", "--json"])
def test_a_full_disk_is_said(tmp_path, options):
    done = shell(f"frischid effects {options} > /dev/full", tmp_path)
    assert done.returncode == 2
    assert done.stderr.splitlines() == ["error: the output: No space left on device"]


@pytest.mark.parametrize("name", ["\x1b]0;owned\x07", "\x9b2J", "\u202eevil", "a\rb\x08"])
def test_a_name_does_not_steer_the_terminal(tmp_path, name):
    robot = tmp_path / "arm.urdf"
    text = (Path(__file__).parents[2] / "urdf" / "planar2.urdf").read_text(encoding="utf-8")
    joint = "".join(f"&#{ord(c)};" for c in name if c not in "\x1b\x07\x08")  # XML has none of these
    robot.write_text(text.replace('"joint2"', f'"{joint}"'), encoding="utf-8")
    rows = "".join(f"{k},0,{k}\n" for k in range(20))
    (tmp_path / "log.csv").write_text(f"t,q_joint1,{name}\n{rows}", encoding="utf-8", newline="")
    for line in (["info", str(robot)], ["check", str(robot), str(tmp_path / "log.csv")], ["info", name]):
        done = CliRunner().invoke(main, line)
        shown = done.stdout + done.stderr
        assert shown
        assert not {"\x1b", "\x07", "\x08", "\x9b", "\u202e", "\r"} & set(shown)
