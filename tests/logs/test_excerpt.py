"""An excerpt of a long log: evenly spread, bounded, with the name and the clock of the whole."""

import numpy as np
import pytest

import frischid as fr
from frischid.errors import InputError
from frischid.logs import excerpt as module
from frischid.logs.excerpt import EXCERPT, STRETCHES, as_recording, excerpt
from frischid.logs.log import Log
from frischid.logs.recording import Recording
from frischid.model.comparison import compare
from frischid.model.identification import identify
from frischid.motions.simulation import Noise, simulate
from frischid.motions.trajectory import random_fourier
from frischid.reports.study import study
from frischid.robot.robot import Robot


def counted(samples):
    """A log whose position counts the samples."""
    t = np.arange(samples) / 1000
    return Log(t, ("a",), t[:, None], source="long", sha256="0" * 64)


def test_an_ordinary_log_is_its_own_excerpt():
    log = counted(1000)
    found = excerpt(log)
    assert found.log is found.first is as_recording(log) is log
    assert (found.samples, found.gaps) == (1000, 0)
    assert found.steps == pytest.approx((0.001, 0.001))


@pytest.mark.parametrize("samples", [EXCERPT + 1, 1_000_000])
def test_a_long_one_is_even_and_bounded(samples):
    log = counted(samples)
    found = excerpt(log)
    assert len(found.log) <= EXCERPT
    assert (found.samples, found.gaps) == (samples, 0)
    assert found.seconds == pytest.approx(log.duration)
    assert found.rate == pytest.approx(1000)
    assert (found.log.source, found.log.identity) == ("long", log.identity)
    assert "errors are those of all samples" in found.log.notes[-1]
    begins = found.log.t[np.flatnonzero(np.diff(found.log.t, prepend=-1) > 0.0015)]
    assert 3 < len(begins) <= STRETCHES
    assert np.ptp(np.diff(begins)) < 1e-9
    assert begins[-1] > 0.7 * log.duration


def test_a_gap_is_counted_once_wherever_it_is():
    t = np.arange(200_000) / 1000
    t[60_000:] += 1.0  # between two chunks
    t[100_000:] += 1.0
    found = excerpt(Log(t, ("a",), t[:, None]))
    assert found.gaps == 2
    assert found.steps[1] == pytest.approx(1.001)


@pytest.fixture
def small(monkeypatch):
    """Logs above 1,600 samples are long."""
    monkeypatch.setattr(module, "EXCERPT", 1600)
    monkeypatch.setattr(module, "STRETCHES", 4)
    monkeypatch.setattr(module, "RECORDING_CHUNK", 1000)


def test_a_report_on_a_long_log_has_the_errors_of_all_samples(small):
    robot = Robot.load("planar2")
    motions = [random_fourier(robot, 60.0, seed=seed) for seed in (0, 1)]
    logs = [simulate(robot, m, rate=100.0, noise=Noise(q=1e-5, tau=0.01), channels=()) for m in motions]
    model = identify(robot, logs[:1], recursion="none").model
    found = study(model, logs, diagnosed=False)
    assert all(800 < len(log) <= 1600 for log in found.logs)
    assert len(found.prediction.t) <= 3200
    assert found.held_out == (logs[1].source,)
    assert found.headline.nrmse == pytest.approx(compare(model, logs[1:]).nrmse, rel=0.02)
    assert [q.samples for q in found.qualities] == [len(log) for log in logs]
    assert not any("gap" in warning for quality in found.qualities for warning in quality.warnings)
    again = study(model, [as_recording(log) for log in logs], diagnosed=False)
    assert isinstance(as_recording(logs[0]), Recording)
    assert again.headline == found.headline


def test_paths_instead_of_logs_are_said(tmp_path):
    robot = Robot.load("planar2")
    log = simulate(robot, random_fourier(robot, 4.0, seed=0), rate=50.0, channels=())
    model = identify(robot, [log], recursion="none").model
    with pytest.raises(InputError, match=r"frischid\.read_log"):
        fr.report(model, ["log.csv"], tmp_path / "report.html")
    with pytest.raises(InputError, match=r"frischid\.read_log"):
        fr.report(model, "log.csv", tmp_path / "report.html")
    with pytest.raises(InputError, match=r"frischid\.Model\.load"):
        fr.report("model.json", [log], tmp_path / "report.html")
    assert list(tmp_path.iterdir()) == []


def test_a_short_recording_is_whole():
    log = counted(70_000)
    found = excerpt(
        Recording(log.source, lambda n: (log.slice(k, k + n) for k in range(0, 70_000, n)), lambda: log.sha256)
    )
    assert np.array_equal(found.log.q, log.q)
    assert not found.said


def test_a_diagnosis_searches_an_excerpt_and_states_the_error_of_all_samples(small):
    robot = Robot.load("planar2")
    motions = [random_fourier(robot, 60.0, seed=seed) for seed in (0, 1)]
    hidden = (*fr.BASELINE, *fr.parse_effects("joint_spring@joint2"))
    logs = [
        simulate(robot, m, rate=100.0, effects=hidden, parameters={"ks2": 1.5}, noise=Noise(tau=0.01)) for m in motions
    ]
    model = identify(robot, logs[:1], recursion="none").model
    found = fr.diagnose(model, logs[:1], valid=logs[1:], effects=["joint_spring"])
    assert found.findings[0].effect == "joint_spring"
    assert found.headline.nrmse == pytest.approx(compare(model, logs[1:]).nrmse, rel=0.02)
    assert any("of 6001 samples" in note for note in found.notes)
    assert sum(len(motion.t) for motion in found.validator.data.cache.prepared) <= 1600
