"""The studio: the bench alone, then the page in a real browser: load, play, add, see the error fall, undo, save."""

import json
import re
import socket
import subprocess
import sys
import threading
import time
import warnings
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from browser import OVERLAPS, SOLID, needs_browser, opened, settled
from cases import MIXED, made
from click.testing import CliRunner
from output_schemas import fits
from replacing import instead_of_diagnose

from frischid.cli import main
from frischid.diagnosis import addition, diagnosis
from frischid.effects import BASELINE, parse_effects
from frischid.errors import InputError
from frischid.logs.filters import LowPass
from frischid.logs.readers import write_log
from frischid.model import log_examination, noise_floor
from frischid.model.identification import identify
from frischid.model.model import Model
from frischid.motions.simulation import Noise, simulate
from frischid.motions.trajectory import random_fourier
from frischid.regression.regressor import Regressor
from frischid.robot.robot import Robot

pytest.importorskip("viser", reason="the extra frischid[studio] is not installed")

from viser import transforms as tf

from frischid.studio import Studio, studio
from frischid.studio import bench as bench_module  # needs viser
from frischid.studio import stage as stage_module
from frischid.studio import tab as tab_module
from frischid.studio import watch as watch_module
from frischid.studio.bench import Bench
from frischid.studio.bodies import urdf_of
from frischid.studio.colours import colour_of
from frischid.studio.findings import Findings
from frischid.studio.first_look import PERIODS, first_look
from frischid.studio.frame import PHONE, SHEETLESS, WIDTH
from frischid.studio.tab import plain
from frischid.studio.track import Track

SPRING = parse_effects("joint_spring@joint2")


@pytest.fixture(scope="module")
def case():
    """A model of an arm with a spring it does not know, and two logs."""
    robot = Robot.load("planar2")
    logs = [
        simulate(
            robot, random_fourier(robot, 40.0, seed=seed), rate=100.0, effects=(*BASELINE, *SPRING),
            parameters={"ks2": 4.0}, noise=Noise(q=1e-5, tau=0.01), channels=(), seed=seed, name=f"log {seed}",
        )
        for seed in (0, 1)
    ]  # fmt: skip
    return identify(robot, logs[:1], recursion="none").model, logs


@pytest.fixture
def bench(case, tmp_path):
    return Bench(*case, tmp_path / "model.json")


# ---- the bench


def test_logs_are_told_apart_by_the_history(bench, case):
    model, logs = case
    assert bench.fit == logs[:1]
    assert bench.valid == logs[1:]
    other = Bench(model, logs[1:], bench.output)
    assert other.fit == logs[1:]
    assert other.valid == []


def test_a_log_that_was_fitted_and_is_not_shown_is_told(case, bench, tmp_path):
    robot, logs = Robot.load("planar2"), case[1]
    both = identify(robot, logs, recursion="none").model
    assert bench.absent == Bench(both, logs, bench.output).absent == 0
    fewer = Bench(both, logs[1:], bench.output)
    assert fewer.fit == logs[1:]
    assert fewer.absent == 1


def test_add_undo_save_export(bench):
    seen = []
    stop = bench.listen(lambda: seen.append(bench.state.revision))
    before = bench.state
    bench.diagnose()
    best = bench.state.diagnosis.findings[0]
    assert best.effect == "joint_spring"
    after = bench.add(best.members, 0, best)
    assert after.headline.nrmse < 0.1 * before.headline.nrmse
    assert after.model.history[-1]["test"]["nrmse"] == pytest.approx(after.headline.nrmse)
    assert after.diagnosis is None
    undone = bench.undo(after.revision)
    assert undone.model is before.model
    assert undone.headline.nrmse == before.headline.nrmse
    assert Model.load(bench.save()).history[-1]["action"] == "identify"
    assert bench.export().read_text(encoding="utf-8").startswith("<!doctype html>")
    stop()
    bench.add_formula("q", ["joint2"], undone.revision)
    assert bench.state.headline.nrmse < 0.1 * before.headline.nrmse
    assert seen == [0, 1, 2]


def test_undo_goes_back_at_once_and_to_what_was_found(bench, monkeypatch):
    bench.diagnose()
    before = bench.state
    bench.add(SPRING, 0)
    monkeypatch.setattr(bench, "_state", lambda *_: pytest.fail("what is known is computed again"))
    undone = bench.undo(1)
    assert undone.revision == 2
    assert undone.diagnosis is before.diagnosis is not None
    assert undone.prediction is before.prediction
    monkeypatch.setattr(threading, "Timer", lambda *_: pytest.fail("what is known is looked for again"))
    bench.look()


def test_what_was_undone_is_not_looked_at(bench, monkeypatch):
    bench.diagnose()
    bench.add(SPRING, 0)
    started = []
    real = threading.Timer
    monkeypatch.setattr(threading, "Timer", lambda _, work: started.append(work) or real(0.0, work))
    bench.look()
    bench.undo(1)
    monkeypatch.setattr(bench, "diagnose", lambda: pytest.fail("what was found is looked for again"))
    started[0]()


def test_undo_of_a_step_made_elsewhere_is_computed(bench, case):
    added = bench.add(SPRING, 0).model
    other = Bench(added, case[1], bench.output)
    assert other.undo(0).headline.nrmse == pytest.approx(Bench(*case, bench.output).state.headline.nrmse)


def test_a_diagnosis_that_comes_too_late_does_not_undo_a_step(bench, monkeypatch):
    real = bench_module.replace

    def overtaken(state, **changes):
        if "diagnosis" in changes:  # the last moment before it is shown
            bench.add(SPRING, 0)
        return real(state, **changes)

    monkeypatch.setattr(bench_module, "replace", overtaken)
    bench.diagnose()
    assert bench.state.revision == 1
    assert bench.state.diagnosis is None


def test_a_failure_leaves_everything_as_it_was(bench, monkeypatch):
    before = bench.state
    for wrong in ("import os", "q +", "1/(q - q)", "banana"):
        with pytest.raises(InputError, match="formula"):
            bench.add_formula(wrong, None, 0)
    with pytest.raises(InputError, match="no step to undo"):
        bench.undo(0)

    def broken(*_, **__):
        raise RuntimeError("out of luck")

    monkeypatch.setattr(addition, "add", broken)
    with pytest.raises(RuntimeError, match="out of luck"):
        bench.add(SPRING, 0)
    assert bench.state is before
    assert "the model has not changed" in bench_module.message_of(RuntimeError("x"))
    monkeypatch.undo()
    assert bench.add(SPRING, 0).revision == 1


def test_two_at_once_do_not_corrupt(bench, monkeypatch):
    entered, leave, real = threading.Event(), threading.Event(), addition.add

    def slow(*args, **options):
        entered.set()
        leave.wait(300)
        return real(*args, **options)

    monkeypatch.setattr(addition, "add", slow)
    first = threading.Thread(target=lambda: bench.add(SPRING, 0))
    first.start()
    assert entered.wait(300)
    with pytest.raises(InputError, match="busy: refitting with joint_spring"):
        bench.undo(0)
    leave.set()
    first.join()
    with pytest.raises(InputError, match="changed in another tab"):
        bench.add(SPRING, 0)
    assert [e["action"] for e in bench.state.model.history] == ["identify", "add"]


def test_the_first_findings_come_from_a_part_of_the_logs(case, tmp_path, monkeypatch):
    robot, logs = Robot.load("planar2"), case[1]
    short = logs[1].slice(None, 1500)
    bench = Bench(identify(robot, [logs[0], short], recursion="none").model, [logs[0], short], tmp_path / "model.json")
    given, real = [], diagnosis.diagnose
    instead_of_diagnose(monkeypatch, lambda m, fit, **k: given.append(len(fit)) or real(m, fit, **k))
    seen = []
    stop = bench.listen(lambda: seen.append(bench.state))
    bench.diagnose()
    stop()
    assert given == [1, 2]
    assert [state.first_look for state in seen] == [True, False]
    assert [state.diagnosis.findings[0].effect for state in seen] == ["joint_spring"] * 2
    assert len({state.revision for state in seen}) == 1  # a click on a first finding counts


def test_without_a_first_look_all_logs_are_diagnosed_at_once(case, tmp_path):
    robot, logs = Robot.load("planar2"), case[1]
    bench = Bench(identify(robot, logs, recursion="none").model, logs, tmp_path / "model.json")
    bench._stretches = [log.slice(0, 30) for log in logs]  # too short for the filters
    seen = []
    stop = bench.listen(lambda: seen.append(bench.state))
    bench.diagnose()
    stop()
    assert [(state.first_look, state.problem) for state in seen] == [(False, "")]
    assert seen[0].diagnosis.findings[0].effect == "joint_spring"


def test_a_first_look_shares_the_shortest_logs_time_among_logs_of_many_periods(case):
    logs = [case[1][0].slice(0, n) for n in (3000, 2000, 2400, 2900)]
    seconds = logs[1].duration
    seen = first_look(logs, LowPass(PERIODS * 3 / seconds))
    assert [x.duration for x in seen] == pytest.approx([seconds / 3] * 3, rel=0.01)
    middle = 0.5 * (seen[0].t[0] + seen[0].t[-1])
    assert middle == pytest.approx(0.5 * logs[0].t[-1], rel=0.01)
    assert first_look(logs, LowPass(PERIODS / seconds)) == first_look(logs, LowPass(None)) == [logs[1]]


def test_while_the_findings_are_read_the_logs_are_examined_for_the_refit(case, tmp_path, monkeypatch):
    model, logs = case
    bench = Bench(model, logs[:1], tmp_path / "model.json")
    bench.diagnose()
    monkeypatch.setattr(log_examination, "inspect", None)  # a second examination would fail
    assert bench.add(SPRING, 0).headline.nrmse < 0.2 * bench.state.before.headline.nrmse


def test_logs_are_in_the_order_of_the_fit(case, tmp_path):
    robot, logs = Robot.load("planar2"), case[1]
    bench = Bench(identify(robot, logs, recursion="none").model, logs[::-1], tmp_path / "model.json")
    assert bench.fit == logs


def test_joints_at_one_place_do_not_share_a_surface():
    stage = object.__new__(stage_module.Stage)
    places = np.array([[0, 0, 0], [0, 0, 1], [0, 0, 1], [0, 0, 1.001], [0, 0, 2]], dtype=float)
    poses = np.tile(np.eye(4), (5, 1, 1))
    poses[:, :3, 3] = places
    stage._poses = lambda: poses
    assert stage._ranks(0.05) == [0, 0, 1, 2, 0]


def test_a_diagnosis_of_an_older_model_is_dropped(bench, monkeypatch):
    real = diagnosis.diagnose

    def overtaken(model, *args, **options):
        instead_of_diagnose(monkeypatch, real)
        bench.add(SPRING, 0)
        return real(model, *args, **options)

    instead_of_diagnose(monkeypatch, overtaken)
    bench.diagnose()
    assert bench.state.revision == 1
    assert bench.state.diagnosis is None


def test_track_runs_through_all_logs(bench):
    track = Track.of(bench)
    assert len(track.x) == sum(map(len, (*bench.fit, *bench.valid)))
    assert (np.diff(track.x) >= 0).all()
    assert track.at(0.0) == pytest.approx(bench.fit[0].q[0])
    assert track.at(1e9) == pytest.approx(bench.valid[0].q[-1])


# ---- what is drawn


@pytest.mark.parametrize("name", ["planar2", "panda", "ur10", "tiago", "kinova"])
def test_every_robot_shows_something(name):
    urdf = urdf_of(Robot.load(name))
    assert len(urdf.scene.geometry) >= 2
    assert np.isfinite(urdf.scene.bounds).all()


def test_a_robot_without_meshes_is_drawn_as_capsules():
    """Every cylinder has a sphere of its radius at its far end, and a thicker one at its joint."""
    shown = [(link.name, v.geometry, v.origin) for link in urdf_of(made(MIXED)).robot.links for v in link.visuals]
    rods = [(name, g.cylinder, origin) for name, g, origin in shown if g.cylinder is not None]
    balls = [(name, g.sphere, origin) for name, g, origin in shown if g.sphere is not None]
    assert rods
    for name, rod, origin in rods:
        far = origin @ [0, 0, rod.length / 2, 1]
        ends = [b.radius for own, b, at in balls if own == name and np.allclose(at @ [0, 0, 0, 1], far, atol=1e-6)]
        assert ends == [rod.radius]
        assert max(b.radius for own, b, _ in balls if own == name) > rod.radius
    robot = made(MIXED)
    urdf = urdf_of(robot)
    assert {"turn", "slide", "elbow"} <= set(urdf.actuated_joint_names)
    assert len(urdf.scene.geometry) >= 5
    missing = robot.urdf.replace(
        '<link name="a">',
        '<link name="a"><visual><geometry><mesh filename="package://none/a.stl"/></geometry></visual>',
    )
    assert len(urdf_of(made(missing)).scene.geometry) == len(urdf.scene.geometry)


def test_colours_run_from_calm_to_alarm():
    assert colour_of(0.0, 0.1) != colour_of(0.1, 0.1) == colour_of(5.0, 0.1)


def test_progress_never_goes_back(case, tmp_path, monkeypatch):
    model, (log, _) = case
    monkeypatch.setattr(watch_module, "SAYING_PAUSE", -1.0)
    fresh = log.slice(stop=3000)  # columns of the whole log may be known from another test
    bench = Bench(model, [fresh], tmp_path / "model.json")
    shares = []
    bench.on_progress(lambda text, share: shares.append(share) if text else None)
    bench.diagnose()
    assert len(set(shares)) > 5
    assert shares == sorted(shares)
    assert shares[0] == 0.0 < shares[-1] <= 1.0


def test_while_findings_are_computed_the_list_says_what_is_tried(bench):
    texts = []

    class Gui:
        def add_markdown(self, text):
            texts.append(SimpleNamespace(content=text, remove=lambda: None))
            return texts[-1]

    found = Findings(Gui(), nullcontext(), bench, None, None, None)
    found.show(bench.state)
    assert "effects is tried on 2 joints and cross-validated on 1 log" in texts[0].content
    found.progress("looking for missing effects: stribeck")
    assert texts[0].content.endswith("Now: stribeck.")
    found.show(replace(bench.state, problem="no log"))
    found.progress("looking for missing effects: viscous")
    assert texts[-1].content == "no log"


def test_findings_stream_in_by_rank_while_they_are_computed(bench, monkeypatch):
    """The effects tried so far, best first; the list that is complete begins with the finding."""
    monkeypatch.setattr(watch_module, "RANKING_PAUSE", 0.0)
    rankings = []
    bench.on_ranked(rankings.append)
    bench.diagnose()
    assert len(rankings) >= 2
    for ranking in rankings:
        assert [tried.gain for tried in ranking] == sorted((tried.gain for tried in ranking), reverse=True)
        assert len({tried.effect for tried in ranking}) == len(ranking) <= watch_module.SHOWN
    first = bench.state.diagnosis.findings[0]
    assert first.effect in {tried.effect for tried in rankings[-1][:2]}
    same = next(tried for tried in rankings[-1] if tried.effect == first.effect)
    assert same.joints == first.joints
    assert same.words.endswith(f"error {first.change}")

    texts = []

    class Gui:
        def add_markdown(self, text):
            texts.append(SimpleNamespace(content=text, remove=lambda: None))
            return texts[-1]

    found = Findings(Gui(), nullcontext(), bench, None, None, None)
    found.show(replace(bench.state, diagnosis=None))
    found.ranked(rankings[-1])
    assert texts[-1].content.startswith("Tried so far")
    assert f"1. {plain(rankings[-1][0].words)}" in texts[-1].content
    found.show(replace(bench.state, problem="no log", diagnosis=None))
    found.ranked(rankings[-1])
    assert texts[-1].content == "no log"


def test_text_is_no_markup():
    assert plain("a_b <i>{x}") == "a&#95;b &#60;i&#62;&#123;x&#125;"


# ---- the page


@contextmanager
def in_a_browser(model, logs, output, port, **page):
    """A running studio, and its page in a browser."""
    running = studio(model, logs, output, port=port)
    try:
        with opened(running.address, flags=SOLID, **page) as seen:
            yield running, seen
    finally:
        running.stop()


def error_shown(page):
    """NRMSE in the headline."""
    return float(re.search(r"NRMSE ([\d.]+)", page.inner_text("body")).group(1))


# of the first figure of the page: the time at its cursor, the names of its curves, and the stretch of time it shows
CURSOR = """() => {
  const plot = document.querySelector(".js-plotly-plot");
  const line = document.querySelector(".frischid-cursor > div");
  const axis = plot._fullLayout.xaxis;
  return line ? axis.p2d(line.getBoundingClientRect().left - plot.getBoundingClientRect().left - axis._offset) : -99;
}"""
CURVES = """() => document.querySelector(".js-plotly-plot").data.map((curve) => curve.name)"""
SHOWN = """() => document.querySelector(".js-plotly-plot")._fullLayout.xaxis.range"""


@needs_browser
def test_a_session_in_the_browser(case, tmp_path):
    with in_a_browser(*case, tmp_path / "model.json", port=8200, height=700) as (running, seen):
        page = seen.page
        page.set_default_timeout(180_000)
        page.wait_for_selector(".js-plotly-plot .scatterlayer path")
        before = error_shown(page)
        assert before == pytest.approx(running.bench.state.headline.nrmse, abs=1e-4)
        page.get_by_role("button", name="Play").click()
        slider = page.get_by_role("slider").first
        settled(lambda: float(slider.get_attribute("aria-valuenow")) > 0.2)
        page.get_by_role("button", name="Pause").click()
        settled(lambda: abs(page.evaluate(CURSOR) - float(slider.get_attribute("aria-valuenow"))) < 0.5)

        page.get_by_role("button", name="Show joint_spring on the residual").click()
        page.wait_for_selector("text=torque of joint_spring")
        ((_, tab),) = running.tabs.items()
        assert tab.stage.lit == {"joint2"}
        legend = page.locator(".frischid-legend")
        settled(lambda: "acts in the finding shown" in legend.inner_text())
        assert "joints: error 0 %" in legend.inner_text()
        page.get_by_role("button", name="Add joint_spring").click()
        settled(lambda: error_shown(page) < 0.1 * before)
        page.wait_for_selector("text=Last step, joint_spring")
        assert not tab.stage.lit
        settled(lambda: "acts in the finding shown" not in legend.inner_text())
        settled(lambda: "before" in page.evaluate(CURVES))
        page.get_by_label("Before the step too").click()
        settled(lambda: "before" not in page.evaluate(CURVES))

        # zoom: the figure shows the stretch between the two numbers
        row = page.locator("xpath=//*[normalize-space(text())='Shown, from and to, s']/ancestor::*[.//input][1]")
        row.locator("input").nth(1).fill("10")
        row.locator("input").nth(1).press("Enter")
        settled(lambda: 9.0 < page.evaluate(SHOWN)[1] < 11.0)

        # one log alone: its curves fill the figure, and the robot starts at its beginning
        tab.log.value = "2: log 1"
        settled(lambda: page.evaluate(SHOWN)[0] > 30.0)
        assert float(tab.time.value) == pytest.approx(tab.stretch.value[0])
        tab.log.value = "all logs"
        settled(lambda: page.evaluate(SHOWN)[0] < 1.0)
        page.get_by_role("button", name="Undo the last step").click()
        settled(lambda: error_shown(page) == before)

        # a formula that is none: said, and nothing has changed
        box = page.locator("input[value='sin(q)']")
        box.fill("sin(banana)")
        page.get_by_role("button", name="Add this formula").click()
        page.wait_for_selector("text=unknown variable 'banana'")
        assert error_shown(page) == before

        page.get_by_role("tab", name="Keep").click()
        page.get_by_role("button", name="Save the model").click()
        page.wait_for_selector("text=Model written to")
        assert len(Model.load(tmp_path / "model.json").history) == 1
        with page.expect_download() as download:
            page.get_by_role("button", name="Download the report").click()
        assert download.value.path().read_text(encoding="utf-8").startswith("<!doctype html>")
        page.wait_for_selector("text=Report downloaded")
        assert (tmp_path / "model.html").exists()
        page.get_by_role("tab", name="Where it fails").click()
        page.wait_for_selector(".heatmaplayer image")
        bad = [c for c in seen.complaints if "Error" in c or "Uncaught" in c]
        assert bad == []


def spot(page, tab, joint):
    """Where a joint is seen, in pixels of the page: its position through the tab's camera."""
    return pixel(page, tab, tab.stage.markers[joint].position)


def pixel(page, tab, place):
    """Where a place is seen."""
    camera = tab.client.camera
    canvas = page.locator("canvas").first.bounding_box()
    x, y, z = tf.SO3(camera.wxyz).inverse() @ (place - camera.position)
    assert z > 0, "behind the camera"
    focal = canvas["height"] / 2 / np.tan(camera.fov / 2)
    return canvas["x"] + canvas["width"] / 2 + focal * x / z, canvas["y"] + canvas["height"] / 2 + focal * y / z


def in_place(running, page):
    """The one tab, once the panels stand at the page's sides and the camera is where the stage put it."""
    settled(lambda: any(tab.against.figure is not None for tab in running.tabs.values()))  # this is drawn last
    ((_, tab),) = running.tabs.items()
    width = page.viewport_size["width"]
    scene = width if width < PHONE else width - 2 * WIDTH  # pixels; between the panels there is a little less

    def arrived():
        camera, drawn = tab.client.camera, page.locator("canvas").first.bounding_box()["width"]
        now = np.array([camera.position, camera.look_at])
        return drawn <= scene and camera.image_width == drawn and np.allclose(now, tab.stage.viewpoint, atol=1e-4)

    settled(arrived)
    return tab


# of the curve "measured" in the first figure of the page: its largest value
HIGHEST = """() => {
  const plot = document.querySelector(".js-plotly-plot");
  const curve = plot && plot.calcdata && plot.calcdata.find((c) => c[0].trace.name === "measured");
  return curve ? Math.max(...curve.map((p) => p.y).filter(Number.isFinite)) : null;
}"""


@needs_browser
def test_a_click_on_a_joint_shows_its_curves(case, tmp_path):
    with in_a_browser(*case, tmp_path / "model.json", port=8210, height=700) as (running, seen):
        page = seen.page
        highest = dict(zip(("joint1", "joint2"), running.bench.state.prediction.measured.max(axis=0), strict=True))

        def shown(joint):
            return page.evaluate(HIGHEST) == pytest.approx(highest[joint], rel=1e-5)

        settled(lambda: shown("joint2"))  # the worst: it has the spring
        tab = in_place(running, page)
        chosen = page.get_by_label("Joint", exact=True).first
        for joint in ("joint1", "joint2"):

            def clicked(joint=joint):  # again, where the browser has not drawn the joint yet
                page.mouse.click(*spot(page, tab, joint))
                return chosen.input_value() == joint

            settled(clicked)
            page.wait_for_selector(f"text={joint}: measured and predicted torque")
            settled(lambda joint=joint: shown(joint))


@needs_browser
def test_the_robot_is_as_near_when_the_panels_have_taken_their_place_first(case, tmp_path, monkeypatch):
    real, viewpoints = tab_module.Tab._come, []

    def late(tab):
        """Go on only when the panels have narrowed the scene, and with it the picture that the camera reports."""
        real(tab)
        settled(lambda: tab.client.camera.image_width <= 1280 - 2 * WIDTH)

    running = studio(*case, tmp_path / "model.json", port=8290)
    try:
        for come in (real, late):
            monkeypatch.setattr(tab_module.Tab, "_come", come)
            with opened(running.address, flags=SOLID) as seen:
                viewpoints.append(in_place(running, seen.page).stage.viewpoint)
            settled(lambda: not running.tabs)
    finally:
        running.stop()
    assert np.array(viewpoints[0]) == pytest.approx(np.array(viewpoints[1]))


@needs_browser
def test_on_a_phone_the_robot_stands_above_a_sheet_as_wide_as_the_page(case, tmp_path):
    with in_a_browser(*case, tmp_path / "model.json", port=8250, width=390, height=844) as (running, seen):
        page = seen.page
        page.set_default_timeout(180_000)
        page.wait_for_selector("text=misses")
        sheet = page.locator(".mantine-Paper-root[style*='max-height: 60%']")
        top = SHEETLESS * 844
        settled(lambda: sheet.bounding_box()["y"] == pytest.approx(top, abs=1.0))
        assert sheet.bounding_box()["width"] == 390
        tab = in_place(running, page)
        for joint in ("joint1", "joint2"):
            x, y = spot(page, tab, joint)
            assert 0 < x < 390
            assert 0 < y < top
        page.get_by_text("Motion", exact=True).click()
        page.wait_for_selector(".js-plotly-plot .scatterlayer path")
        page.get_by_role("tab", name="Where it fails").click()
        page.wait_for_selector(".heatmaplayer image")
        settled(lambda: page.evaluate(f"({OVERLAPS})(document)") == [])


@needs_browser
def test_a_page_may_be_there_before_its_model(case, tmp_path):
    running = Studio(port=8230)
    try:
        with opened(running.address, height=700, flags=SOLID) as seen:
            seen.page.wait_for_selector("text=Reading the logs")
            with pytest.raises(InputError, match="no log"):
                running.show(case[0], [], tmp_path / "model.json")
            running.show(*case, tmp_path / "model.json")
            seen.page.wait_for_selector(".js-plotly-plot .scatterlayer path")
            assert error_shown(seen.page) == pytest.approx(running.bench.state.headline.nrmse, abs=1e-4)
            assert seen.page.get_by_text("Reading the logs").count() == 0
    finally:
        running.stop()


@needs_browser
def test_controls_may_be_moved_before_the_robot_is_drawn(case, tmp_path, monkeypatch, capfd):
    moved, real, tabs = threading.Event(), stage_module.Stage, []

    def slow(client, bench, track, chosen, free):
        tabs.append(chosen.__self__)
        assert moved.wait(300)
        return real(client, bench, track, chosen, free)

    monkeypatch.setattr(stage_module, "Stage", slow)
    running = studio(*case, tmp_path / "model.json", port=8280)
    try:
        with opened(running.address, height=700, flags=SOLID) as seen:
            page = seen.page
            page.wait_for_selector(".js-plotly-plot .scatterlayer path")
            slider = page.get_by_role("slider").first
            for _ in range(5):
                slider.press("ArrowRight")
            settled(lambda: tabs and tabs[0].time.value == pytest.approx(0.05))
            moved.set()
            tab = in_place(running, page)
            assert tab.time.value == pytest.approx(0.05)
        assert "Traceback" not in "".join(capfd.readouterr())
    finally:
        moved.set()
        running.stop()


@needs_browser
def test_it_is_dark_where_the_reader_wants_it_dark(case, tmp_path):
    filters = "['html', 'canvas'].map((e) => getComputedStyle(document.querySelector(e)).filter)"
    with in_a_browser(*case, tmp_path / "model.json", port=8290, scheme="dark") as (_, seen):
        seen.page.wait_for_selector("text=misses")
        for scheme, turned in (("dark", True), ("light", False)):
            seen.page.emulate_media(color_scheme=scheme)
            settled(lambda turned=turned: [("invert" in f) for f in seen.page.evaluate(filters)] == [turned, turned])


# of each vertical axis of the first figure: how long its title is, and how long it is itself
TITLES = """() => {
  const plot = document.querySelector(".js-plotly-plot");
  return ["yaxis", "yaxis2"].map((name) => [
    plot.querySelector(`.g-${name.replace("axis", "")}title`).getBoundingClientRect().height,
    plot._fullLayout[name]._length]);
}"""


@needs_browser
def test_many_steps_fit_into_the_panel(case, tmp_path):
    model, logs = case
    event = {"action": "add", "effects": ["joint_spring@joint2"], "error_before": 0.1, "error_after": 0.1}
    model = replace(model, history=(*model.history, *[event] * 8))
    with in_a_browser(model, logs, tmp_path / "model.json", port=8300) as (_, seen):
        seen.page.wait_for_selector("text=8 effects added")
        settled(lambda: seen.page.evaluate("document.querySelectorAll('.annotation-text').length") == 9)
        settled(lambda: seen.page.evaluate(f"({OVERLAPS})(document)") == [])
        settled(lambda: all(title < axis for title, axis in seen.page.evaluate(TITLES)))


END = np.array([0.5, 0.0, 0.0])  # of the planar arm's last link as it is drawn, m


@needs_browser
def test_the_end_of_the_last_link_is_in_view_too(case, tmp_path):
    with in_a_browser(*case, tmp_path / "model.json", port=8320, height=700) as (running, seen):
        page = seen.page
        page.wait_for_selector("text=misses")
        tab = in_place(running, page)
        for x in np.linspace(0, tab.track.x[-1], 20):
            tab.stage.pose(x, "joint2", "of the verdict")
            pose = tab.stage.urdf.get_transform("link2")
            u, v = pixel(page, tab, pose[:3, 3] + pose[:3, :3] @ END)
            assert WIDTH < u < 1280 - WIDTH
            assert 0 < v < 700


@needs_browser
@pytest.mark.parametrize(("width", "left", "bottom", "density"), [(1280, WIDTH, 700, 2), (390, 0, 300, 3)])
def test_the_robot_stays_in_view_wherever_its_logs_take_it(tmp_path, width, left, bottom, density):
    """Also on a screen with more pixels than the page, as most laptops and all telephones have."""
    robot = Robot.load("panda", joints=[f"panda_joint{i}" for i in range(1, 8)])
    log = simulate(robot, random_fourier(robot, 20.0, seed=0), rate=100.0, channels=(), name="far and wide")
    model = identify(robot, [log], recursion="none").model
    window = {"width": width, "height": 700, "density": density}
    with in_a_browser(model, [log], tmp_path / "model.json", port=8310, **window) as (running, seen):
        page = seen.page
        page.wait_for_selector("text=misses")
        tab = in_place(running, page)
        assert tab.frame.phone == (width < PHONE)
        for x in np.linspace(0, tab.track.x[-1], 20):
            tab.stage.pose(x, "panda_joint7", "of the verdict")
            for joint in robot.joints:
                u, v = spot(page, tab, joint)
                assert left < u < width - left
                assert 0 < v < bottom
            u, _ = spot(page, tab, "panda_joint7")
            reach = {"bottom-left": (0, 1), "bottom-center": (-0.5, 0.5), "bottom-right": (-1, 0)}
            text = 6.5 * len(tab.stage.label.text)  # pixels
            for side in reach[tab.stage.label.anchor]:
                assert left - 15 < u + side * text < width - left + 15


@needs_browser
def test_two_tabs_show_one_model(case, tmp_path):
    with in_a_browser(*case, tmp_path / "model.json", port=8220, height=700) as (running, seen):
        one = seen.page
        two = one.context.browser.new_page()
        two.goto(running.address)
        for page in (one, two):
            page.set_default_timeout(180_000)
            page.wait_for_selector("text=misses")
        before = error_shown(two)
        one.get_by_role("button", name="Add joint_spring").click()
        settled(lambda: error_shown(two) < 0.1 * before)
        settled(lambda: error_shown(one) == error_shown(two))


# ---- the command


def test_it_listens_on_loopback(case, tmp_path):
    running = studio(*case, tmp_path / "model.json", port=8240)
    try:
        assert running.server.get_host() == "127.0.0.1"
    finally:
        running.stop()


def test_being_open_to_others_is_said(case, tmp_path, monkeypatch):
    from frischid.logs.readers import write_log

    model, logs = case
    model.save(tmp_path / "model.json")
    write_log(logs[0], tmp_path / "log.parquet")

    def interrupted(_):
        warnings.warn("Queued a Message on a closed connection", UserWarning, stacklevel=1)  # nobody need read this
        raise KeyboardInterrupt

    arguments = ["studio", str(tmp_path / "model.json"), str(tmp_path / "log.parquet"), "--port", "8260"]
    real = time.sleep
    monkeypatch.setattr(time, "sleep", lambda s: interrupted(s) if s > 1000 else real(s))
    for host, said in (("0.0.0.0", True), ("127.0.0.1", False)):
        result = CliRunner().invoke(main, [*arguments, "--host", host])
        assert result.exit_code == 0, result.output
        assert ("anybody who reaches the page can change the model" in result.stdout.replace("\n", " ")) == said
        assert "model-studio.json" in result.stdout.replace("\n", "")
    fits("studio", json.loads(CliRunner().invoke(main, [*arguments, "--json"]).stdout))


def test_what_cannot_be_read_ends_it(case, tmp_path):
    case[0].save(tmp_path / "model.json")
    result = CliRunner().invoke(main, ["studio", str(tmp_path / "model.json"), "nowhere.parquet", "--port", "8270"])
    assert result.exit_code == 2
    assert "nowhere.parquet" in result.stderr
    with socket.socket() as free:
        free.bind(("127.0.0.1", 8270))


def test_a_missing_extra_is_named(case, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "viser", None)
    with pytest.raises(InputError, match=r'pip install "viser>=1.1" "yourdfpy>=0.0.56"'):
        studio(*case, tmp_path / "model.json")


def imported_by(commands):
    """Modules that a fresh Python has imported after some commands."""
    asked = [sys.executable, "-c", f"import sys\n{commands}\nprint(*sys.modules)"]
    return set(subprocess.run(asked, capture_output=True, text=True, check=True).stdout.split())


def test_the_address_is_printed_before_anything_heavy_is_imported():
    """A browser loads the page while models, logs and their libraries are read."""
    names = imported_by("import frischid.studio, frischid.cli.pages.studio, frischid.cli.inputs")
    assert not {"scipy", "pinocchio", "trimesh", "frischid.model.model"} & names


def test_a_first_look_needs_no_slow_library(case, tmp_path):
    """`scipy.signal` and `scipy.stats` take half a second to import."""
    model, logs = case
    model.save(tmp_path / "model.json")
    write_log(logs[0], tmp_path / "log.parquet")
    names = imported_by(
        "from pathlib import Path\n"
        "from frischid.logs.readers import read_log\n"
        "from frischid.model.model import Model\n"
        "from frischid.studio.bench import Bench\n"
        "import frischid.studio.tab\n"
        f"model = Model.load({str(tmp_path / 'model.json')!r})\n"
        f"log = read_log({str(tmp_path / 'log.parquet')!r}, model.robot.joints)\n"
        "bench = Bench(model, [log], Path('model.json'))\n"
        "from frischid.diagnosis.diagnosis import diagnose\n"
        "assert diagnose(model, [log]).findings"
    )
    assert "frischid.diagnosis.diagnosis" in names
    assert not {"scipy.signal", "scipy.stats"} & names


def test_a_click_computes_the_noise_floor_and_the_columns_of_a_log_once(case, tmp_path, monkeypatch):
    """In the fit, and again for the page: the second time they are remembered."""
    seen = {"floor": [], "columns": []}
    floor, columns = noise_floor._through_the_motion, Regressor.blocks

    def counted_floor(model, motion):
        seen["floor"].append(id(motion))
        return floor(model, motion)

    def counted_columns(self, motion, lowpass, *options):
        seen["columns"].append((id(motion), self.effects, self.reference.tobytes(), lowpass.cutoff))
        return columns(self, motion, lowpass, *options)

    model, logs = case
    bench = Bench(model, [replace(log) for log in logs], tmp_path / "model.json")  # nothing is known of new objects
    monkeypatch.setattr(noise_floor, "_through_the_motion", counted_floor)
    monkeypatch.setattr(Regressor, "blocks", counted_columns)
    bench.add(SPRING, bench.state.revision)
    bench.close()
    for calls in seen.values():
        assert calls
        assert len(set(calls)) == len(calls)
