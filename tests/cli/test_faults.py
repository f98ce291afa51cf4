"""Faults from outside: a full disk, a folder without the right to write, Ctrl-C at every stage of a long command.

Whatever happens: one sentence, an exit code that says so, the old output and the inputs as they were, and nothing else
in the folder. (`kill -9` is in `benchmarks/kills.py`, two writers in `tests/core/test_files.py`, a dying worker in
`tests/fleet/test_fleet.py`.)
"""

import os
import shutil
import signal
import sys
import tempfile
import time
from contextlib import contextmanager
from pathlib import Path

import pytest
from click.testing import CliRunner

from frischid.cli import checking, demo, drives, exporting, fitting, fleets, improving, learning, main, motions, seeing
from frischid.cli.group import STOPPED
from frischid.core.files import write_text
from frischid.errors import InputError
from frischid.logs.readers import write_log
from frischid.model.identification import identify
from frischid.motions.simulation import Noise, simulate
from frischid.motions.trajectory import random_fourier
from frischid.robot.robot import Robot

MODULES = (checking, demo, drives, exporting, fitting, fleets, improving, learning, motions, seeing)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A log and its model."""
    folder = tmp_path_factory.mktemp("made")
    robot = Robot.load("planar2")
    log = simulate(robot, random_fourier(robot, 8.0, seed=0), rate=50.0, noise=Noise(tau=0.01), channels=())
    write_log(log, folder / "log.csv")
    identify(robot, [log], recursion="none").model.save(folder / "model.json")
    return folder


@pytest.fixture
def here(made, tmp_path, monkeypatch):
    """A fresh folder with the log and the model, where the command runs."""
    for path in made.iterdir():
        shutil.copy(path, tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def contents(folder):
    return {p.name: p.read_bytes() for p in folder.iterdir()}


# ---- a full disk

WRITING = [
    "identify planar2 log.csv --bbrf none -o out.json",
    "add model.json stribeck@joint2 log.csv -o out.json",
    "consistent model.json -o out.json",
    "report model.json log.csv -o out.html",
    "simulate planar2 --duration 8 -o out.csv",
    "simulate planar2 --duration 8 -o out.npz",
    "simulate planar2 --duration 8 -o out.parquet",
    "export model.json --force -o out.c",
    "export model.json --force -o out.urdf",
]


@contextmanager
def disk_full_after(size):
    """Let no file grow beyond a size: the system refuses the write in its middle, as on a full disk.

    Python itself must not write then: it would keep half of the bytecode of a module that a command imports.
    """
    import resource

    before, bytecode = resource.getrlimit(resource.RLIMIT_FSIZE), sys.dont_write_bytecode
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    sys.dont_write_bytecode = True
    try:
        yield
    finally:
        sys.dont_write_bytecode = bytecode
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.skipif(sys.platform == "win32", reason="no limit of a file's size")
@pytest.mark.parametrize("line", WRITING)
def test_a_disk_that_is_full_in_the_middle_of_a_write_changes_nothing(line, here):
    output = here / line.split()[-1]
    output.write_bytes(b"the old file")
    before = contents(here)
    with disk_full_after(500):
        done = CliRunner().invoke(main, line.split())
    assert done.exit_code == 2, done.output
    assert "out." in done.stderr
    assert "cannot be written" in done.stderr
    assert contents(here) == before


# ---- a folder without the right to write


@contextmanager
def as_nobody():
    """Give up root's right to write everywhere."""
    if os.geteuid() != 0:
        yield
        return
    os.setresuid(65534, 65534, 0)
    try:
        yield
    finally:
        os.setresuid(0, 0, 0)


@pytest.mark.skipif(not hasattr(os, "setresuid"), reason="no users to change")
def test_a_folder_without_the_right_to_write_is_said_and_stays():
    with tempfile.TemporaryDirectory() as text:
        folder = Path(text)
        write_text(folder / "old", "old")
        folder.chmod(0o555)
        with as_nobody(), pytest.raises(InputError, match="you may not write in the folder"):
            write_text(folder / "new", "new")
        folder.chmod(0o777)
        (folder / "old").chmod(0o444)
        with as_nobody(), pytest.raises(InputError, match="write-protected"):
            write_text(folder / "old", "new")
        assert {p.name: p.read_text() for p in folder.iterdir()} == {"old": "old"}


# ---- Ctrl-C

LONG = [
    "check planar2 log.csv",
    "identify planar2 log.csv -o out.json",
    "compare model.json log.csv",
    "diagnose model.json log.csv",
    "improve model.json log.csv --max-steps 1 -o out.json",
    "add model.json stribeck@joint2 log.csv -o out.json",
    "report model.json log.csv -o out.html",
    "consistent model.json -o out.json",
    "export model.json -o out.urdf",
    "simulate planar2 --duration 5 -o out.csv",
    "excite planar2 --duration 4 --budget 60 -o out.csv",
    "fleet planar2 log.csv --scheduler none -o out.json",
]


@pytest.mark.parametrize("line", LONG, ids=[line.split()[0] for line in LONG])
def test_ctrl_c_at_any_stage_is_one_line_and_changes_nothing(line, here, monkeypatch):
    before = contents(here)
    stages, stop_at = [], -1

    @contextmanager
    def working(quiet):
        def progress(text):
            stages.append(text)
            if len(stages) == stop_at:
                signal.raise_signal(signal.SIGINT)
                time.sleep(10)  # the signal's handler raises KeyboardInterrupt before this ends

        yield progress

    for module in MODULES:
        if hasattr(module, "working"):
            monkeypatch.setattr(module, "working", working)
    stop_at = 1
    tried = 0
    while True:
        stages.clear()
        done = CliRunner().invoke(main, line.split())
        if len(stages) < stop_at:
            break
        tried += 1
        assert done.exit_code == STOPPED, done.output
        assert done.stderr.startswith("stopped by Ctrl-C")
        assert contents(here) == before
        stop_at *= 2
    assert tried, done.output
    assert done.exit_code in (0, 1), done.output
