"""The simulated robot beside the measured one, in the report on a model of commanded positions."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from browser import needs_browser, opened

import frischid as fr
from frischid import figures
from frischid.forward.simulated_beside import BESIDE_SECONDS, RESTART, SimulatedBeside, simulated_beside
from frischid.reports.chapters import CHAPTERS
from frischid.reports.page import page
from frischid.reports.study import Study, study

KP, KD = 300.0, 9.0
TRUTH = {"fv1": 0.5, "fv2": 0.3, "fc1": 0.8, "fc2": 0.4, "Ia1": 0.05, "Ia2": 0.03}


def commanded(seed: int, seconds: float = 6.0) -> fr.Log:
    robot = fr.Robot.load("planar2")
    log = fr.simulate(robot, fr.random_fourier(robot, seconds, seed=seed), rate=100.0, parameters=TRUTH)
    assert log.tau is not None
    assert log.v is not None
    return fr.Log(log.t, robot.joints, q=log.q, qcmd=log.q + (log.tau + KD * log.v) / KP, source=f"<b>{seed}.csv")


@pytest.fixture(scope="module")
def shown() -> Study:
    fitted, held = commanded(1), commanded(2)
    model = fr.identify(fr.Robot.load("planar2"), [fitted], controller=fr.PDController(KP, KD), recursion="none").model
    return study(model, [fitted, held], diagnosed=False)


def fails(found: Study) -> str:
    (chapter,) = [c for c in CHAPTERS if c.anchor == "fails"]
    return str(chapter.html(found))


def test_the_held_out_log_is_simulated_along_its_commands(shown: Study) -> None:
    beside = shown.simulated
    assert isinstance(beside, SimulatedBeside)
    assert beside.source == "<b>2.csv"
    assert beside.measured.shape == beside.simulated.shape
    assert (beside.rms < 0.01).all()
    assert (beside.rms > 0).all()


def test_a_wrong_model_moves_away(shown: Study) -> None:
    model = shown.model
    heavy = replace(model, estimate=replace(model.estimate, theta=1.3 * model.estimate.theta), standard=None)
    wrong = simulated_beside(heavy, [commanded(2)])
    assert isinstance(wrong, SimulatedBeside)
    assert isinstance(shown.simulated, SimulatedBeside)
    assert (wrong.rms > 3 * shown.simulated.rms).all()


def test_only_the_beginning_of_a_long_log_is_simulated(shown: Study) -> None:
    beside = simulated_beside(shown.model, [commanded(3, 1.5 * BESIDE_SECONDS)])
    assert isinstance(beside, SimulatedBeside)
    assert 0.9 * BESIDE_SECONDS < beside.t[-1] <= BESIDE_SECONDS


def resting(log: fr.Log, seconds: float) -> fr.Log:
    """The log of an arm that rests so long before."""
    count = round(100 * seconds)
    rows = {"q": log.q, "qcmd": log.qcmd, "tau": log.tau}
    before = {name: np.vstack([np.repeat(x[:1], count, axis=0), x]) for name, x in rows.items() if x is not None}
    return fr.Log(np.arange(count + len(log)) / 100, log.joints, **before, source=log.source)


@pytest.mark.parametrize("rest", [5.0, 2 * BESIDE_SECONDS])
def test_an_arm_that_rests_before_its_motion_is_simulated_along_the_motion(shown: Study, rest: float) -> None:
    """The beginning of the log had no motion, and the report said that the commands never move."""
    log = resting(commanded(2), rest)
    beside = simulated_beside(shown.model, [log])
    assert isinstance(beside, SimulatedBeside)
    assert (np.ptp(beside.measured, axis=0) > 0.1).all()
    places = np.searchsorted(log.t, beside.t - 1e-6)  # t counts from the log's first sample
    np.testing.assert_allclose(beside.measured, log.q[places], atol=1e-6)


def test_the_ghost_is_transparent_and_stands_at_the_simulated_positions(shown: Study) -> None:
    beside = shown.simulated
    assert isinstance(beside, SimulatedBeside)
    apart = replace(beside, simulated=beside.simulated + 0.3)
    figure = figures.ghost(apart, shown.model.robot).figure
    measured, ghost = figure.frames[-1].data
    assert measured.opacity > 2 * ghost.opacity
    assert np.nanmax(np.hypot(measured.x - ghost.x, measured.y - ghost.y)) > 0.05
    same = figures.ghost(replace(beside, simulated=beside.measured), shown.model.robot).figure
    assert np.array_equal(same.data[0].x, same.data[1].x, equal_nan=True)
    assert 50 <= len(figure.frames) <= 100


SLIDE = """<robot name="slide"><link name="base"/><link name="carriage"><inertial><mass value="2"/>
<inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/></inertial></link>
<joint name="axis" type="prismatic"><parent link="base"/><child link="carriage"/><axis xyz="0 1 0"/>
<limit lower="0" upper="1" velocity="1" effort="50"/></joint></robot>"""


def test_a_sliding_axis_is_drawn_as_points_in_metres(tmp_path: Path) -> None:
    path = tmp_path / "slide.urdf"
    path.write_text(SLIDE)
    robot = fr.Robot.load(path)
    t = np.linspace(0.0, 2.0, 51)
    q = 0.3 * (1.0 - np.cos(np.pi * t))[:, None]
    beside = SimulatedBeside("log", t[:50], q[:50], q[:50], 25, np.zeros((2, 50, 2)))
    figure = figures.ghost(beside, robot).figure
    for part in figure.data:
        assert "markers" in part.mode, "at its zero the link has no length, so a line alone would not be seen"
    across = np.array([frame.data[0].x[1] for frame in figure.frames], dtype=float)
    assert np.ptp(across) > 0.55, "the view is across the axis, not along it"
    titles = [axis.title.text for axis in figures.position_error(beside, robot).figure.select_yaxes()]
    assert "joints, m" in titles


def test_the_report_shows_both_figures_and_escapes_the_log(shown: Study) -> None:
    text = fails(shown)
    assert "Error of the simulated positions" in text
    assert "The simulated robot beside the measured one" in text
    assert "Along &lt;b&gt;2.csv" in text
    specs = [json.loads(x) for x in re.findall(r'<script type="application/json">(.*?)</script>', text)]
    assert sum(bool(spec.get("frames")) for spec in specs) == 1


@pytest.fixture(scope="module")
def pushed() -> Study:
    """A model of torques with its fitted and a test log."""
    robot = fr.Robot.load("planar2")
    logs = [
        replace(
            fr.simulate(robot, fr.random_fourier(robot, 4.0, seed=s), rate=100.0, noise=fr.Noise(tau=0.01), seed=s),
            source=f"{s}.csv",
        )
        for s in (1, 2)
    ]
    return study(fr.identify(robot, logs[:1], recursion="none").model, logs, diagnosed=False)


def test_a_recorded_torque_moves_the_model_from_a_measured_state_every_second(pushed: Study) -> None:
    beside = pushed.simulated
    assert isinstance(beside, SimulatedBeside)
    assert not beside.closed
    assert beside.source == pushed.held_out[0]
    starts = np.arange(0, len(beside.t), beside.length)
    assert beside.t[beside.length] - beside.t[0] == pytest.approx(RESTART)
    np.testing.assert_array_equal(beside.simulated[starts], beside.measured[starts])


def test_the_error_against_the_horizon_is_that_of_compare_simulated(pushed: Study) -> None:
    """Both are means over starts along one log; the starts differ."""
    beside = pushed.simulated
    assert isinstance(beside, SimulatedBeside)
    horizons, rms = beside.over_horizon()
    assert horizons[0] == 0.0
    log = next(x for x in pushed.logs if x.source == beside.source)
    (asked,) = fr.compare_simulated(pushed.model, [log], horizons=[0.5]).horizons
    k = int(np.searchsorted(horizons, 0.5))
    assert rms[0, k, -1] == pytest.approx(asked.tip, rel=1.0)
    assert rms[1, k, -1] == pytest.approx(asked.urdf_tip, rel=1.0)


def test_the_report_on_torques_draws_the_error_against_the_horizon(pushed: Study) -> None:
    text = fails(pushed)
    assert "Error of the simulated positions against the horizon" in text
    assert "the recorded torque alone moves the model" in text
    assert "for the URDF with fitted friction" in text
    assert "follows the same commands" not in text


def test_a_log_without_torque_and_commands_is_not_simulated(pushed: Study) -> None:
    positions = replace(pushed.logs[0], tau=None)
    assert simulated_beside(pushed.model, [positions]) is None
    assert "simulated" not in fails(replace(pushed, simulated=None))


def test_the_push_of_an_arm_that_rests_first_is_simulated(pushed: Study) -> None:
    beside = simulated_beside(pushed.model, [resting(pushed.logs[0], 2 * BESIDE_SECONDS)])
    assert isinstance(beside, SimulatedBeside)
    assert beside.t[0] > 1.9 * BESIDE_SECONDS


def test_an_arm_that_stands_still_says_why_it_is_not_simulated(pushed: Study) -> None:
    log = pushed.logs[0]
    still = replace(log, q=np.tile(log.q[:1], (len(log), 1)), v=None if log.v is None else 0.0 * log.v, a=None)
    assert "stands still" in str(simulated_beside(pushed.model, [still]))


def test_a_model_that_cannot_be_simulated_says_why(shown: Study) -> None:
    assert "The motion is not simulated: no second mass." in fails(replace(shown, simulated="no second mass"))


def test_a_motion_that_runs_away_is_drawn_as_far_as_it_goes(shown: Study) -> None:
    beside = shown.simulated
    assert isinstance(beside, SimulatedBeside)
    broken = beside.simulated.copy()
    broken[100:] = np.nan
    away = replace(beside, simulated=broken)
    assert np.isinf(away.rms).all()
    assert float(figures.ghost(away, shown.model.robot).figure.frames[-1].name) < beside.t[100]
    assert "Rms, rad: joint1 –, joint2 –." in fails(replace(shown, simulated=away))


@needs_browser
def test_the_ghost_moves_in_the_browser(shown: Study, tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    path.write_text(page(shown))
    with opened(path.as_uri()) as seen:
        tab = seen.page
        tab.locator("#fails").scroll_into_view_if_needed()
        tab.wait_for_selector(".updatemenu-button")
        plot = tab.locator(".plot", has=tab.locator(".updatemenu-button")).first
        lines = "p => [...p.querySelectorAll('.scatterlayer path.js-line')].map(x => x.getAttribute('d')).join()"
        tab.wait_for_function(
            "p => p._transitionData && p._transitionData._frames.length > 50", arg=plot.element_handle()
        )
        before = plot.evaluate(lines)
        plot.locator(".updatemenu-button").first.click()
        tab.wait_for_function(f"([p, old]) => ({lines})(p) !== old", arg=[plot.element_handle(), before])
    assert not seen.complaints
