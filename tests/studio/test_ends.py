"""The studio's ends: a tab that closes while the model is refitted, a studio that stops, an interpreter that ends."""

import gc
import subprocess
import sys
import threading
import weakref

import pytest
from browser import SOLID, needs_browser, opened, settled
from replacing import instead_of_diagnose

from frischid.effects import parse_effects
from frischid.model.identification import identify
from frischid.motions.simulation import Noise, simulate
from frischid.motions.trajectory import random_fourier
from frischid.robot.robot import Robot

pytest.importorskip("viser", reason="the extra frischid[studio] is not installed")

from frischid.studio import Studio
from frischid.studio import bench as bench_module

STRIBECK = parse_effects("stribeck@joint2")


@pytest.fixture(scope="module")
def case():
    robot = Robot.load("planar2")
    log = simulate(robot, random_fourier(robot, 8.0, seed=0), rate=50.0, noise=Noise(tau=0.01), channels=())
    return identify(robot, [log], recursion="none").model, [log]


class GoneTab:
    """A tab whose browser is closed: whatever is sent to it fails."""

    def __init__(self):
        self.asked = 0

    def refresh(self, *_):
        self.asked += 1
        raise RuntimeError("the connection is closed")

    progress = step = refresh


class OpenTab(GoneTab):
    """A tab that is there."""

    def refresh(self, *_):
        self.asked += 1

    progress = step = refresh


def test_a_browser_that_closes_during_a_refit_stops_nothing(case, tmp_path, monkeypatch, capfd):
    instead_of_diagnose(monkeypatch, lambda *_, **__: pytest.fail("not asked for"))
    running = Studio(port=8420)
    try:
        running.show(*case, tmp_path / "model.json")
        gone, there = GoneTab(), OpenTab()
        running.tabs |= {1001: gone, 1002: there}
        state = running.bench.add(STRIBECK, 0)
        assert state.revision == 1
        assert running.bench.state is state
        assert gone.asked == 1
        assert there.asked > 1
        assert list(running.tabs) == [1002]
        running.bench.save()
        assert (tmp_path / "model.json").is_file()
    finally:
        running.stop()
    assert "Traceback" not in capfd.readouterr().err


@needs_browser
def test_closed_tabs_leave_nothing_in_memory(case, tmp_path, monkeypatch):
    """One tab is closed while its robot moves, the other at rest."""
    instead_of_diagnose(monkeypatch, lambda *_, **__: pytest.fail("not waited for"))
    monkeypatch.setattr(bench_module, "DIAGNOSIS_DELAY", 3600.0)
    running = Studio(port=8450)
    try:
        running.show(*case, tmp_path / "model.json")
        with opened(running.address, flags=SOLID) as seen:
            second = seen.page.context.browser.new_page()
            second.goto(running.address)
            for page in (seen.page, second):
                page.set_default_timeout(180_000)
                page.wait_for_selector("text=misses")
            seen.page.get_by_role("button", name="Play").click()
            parts = [x for tab in running.tabs.values() for x in (tab, tab.client, tab.frame, tab.stage, tab.findings)]
            alive = [weakref.ref(x) for x in parts]
            assert len(alive) == 10
            del parts
            second.close()
        settled(lambda: not running.tabs and not any(x() for x in alive if gc.collect() >= 0))
        assert not running.server.get_clients()
    finally:
        running.stop()


def test_a_stopped_studio_leaves_no_thread(case, tmp_path, monkeypatch):
    monkeypatch.setattr(bench_module, "DIAGNOSIS_DELAY", 0.0)
    begun = threading.Event()

    def endless(*_, progress, **__):
        while True:
            begun.set()
            progress("trying nothing")

    instead_of_diagnose(monkeypatch, endless)
    before = set(threading.enumerate())
    running = Studio(port=8430)
    running.show(*case, tmp_path / "model.json")
    running.bench.look()
    assert begun.wait(60)
    running.stop()
    mine = [t for t in set(threading.enumerate()) - before if "frischid" in t.name or isinstance(t, threading.Timer)]
    for thread in mine:
        thread.join(60)
    assert not any(thread.is_alive() for thread in mine)
    running.bench.look()
    assert not running.bench._looking


ENDS = """
import sys, threading, time
import clarabel
import numpy as np
from pathlib import Path
from scipy import sparse
import frischid as fr
from frischid.diagnosis import diagnosis, roles
from frischid.studio import bench as module

module.DIAGNOSIS_DELAY = 0.0
begun, one, settings = threading.Event(), sparse.eye(30_000, format="csc"), clarabel.DefaultSettings()
settings.verbose = False

def compiled(*_, progress, **__):
    while True:
        begun.set()
        progress("trying nothing")
        cone = [clarabel.NonnegativeConeT(30_000)]
        clarabel.DefaultSolver(one, -np.ones(30_000), one, np.ones(30_000), cone, settings).solve()

diagnosis.diagnose = roles.diagnose = compiled
robot = fr.Robot.load("planar2")
log = fr.simulate(robot, fr.random_fourier(robot, 4.0, seed=0), rate=50.0, channels=())
model = fr.identify(robot, [log], recursion="none").model
bench = module.Bench(model, [log], Path(sys.argv[1]))
bench.look()
begun.wait(60)
time.sleep(0.5)  # then the thread is most likely in the solver
"""


def test_the_interpreter_may_end_during_a_diagnosis(tmp_path):
    """Without `Bench.close`, Rust aborts the process: "FATAL: exception not rethrown"."""
    command = [sys.executable, "-c", ENDS, str(tmp_path / "model.json")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600, check=False)
    assert (done.returncode, done.stderr) == (0, "")
