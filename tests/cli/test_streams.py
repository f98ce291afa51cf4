"""Streams that are closed, full, or cannot write every letter: no traceback, and nothing of theirs in a file."""

import json
import subprocess
import sys
from pathlib import Path

import pytest


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
