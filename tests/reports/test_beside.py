"""Models and logs beside one another in the report: one cursor, one zoom, earlier steps, two models, two logs."""

import json
import re
from dataclasses import replace

import pytest
from browser import needs_browser, opened
from click.testing import CliRunner

from frischid.cli import main
from frischid.diagnosis.addition import add
from frischid.effects import BASELINE, parse_effects
from frischid.errors import InputError
from frischid.logs.readers import write_log
from frischid.model.comparison import compare
from frischid.model.identification import identify
from frischid.motions.simulation import Noise, simulate
from frischid.motions.trajectory import random_fourier
from frischid.reports.chapters import data, torque
from frischid.reports.page import page, report
from frischid.reports.study import study
from frischid.robot.robot import Robot

EFFECTS = parse_effects("joint_spring@joint2")


@pytest.fixture(scope="module")
def steps():
    """A model, the same with two effects added one by one, and its logs: one fitted, one not."""
    robot = Robot.load("planar2")
    logs = [
        simulate(
            robot, random_fourier(robot, 20.0, seed=seed, scale=0.7), rate=100.0, effects=(*BASELINE, *EFFECTS),
            parameters={"ks2": 4.0}, noise=Noise(q=1e-5, tau=0.01), channels=(), seed=seed, name=name,
        )
        for seed, name in enumerate(("own", "new"))
    ]  # fmt: skip
    first = identify(robot, logs[:1], recursion="none").model
    second = add(first, EFFECTS, logs[:1]).model
    third = add(second, parse_effects("quadratic_viscous"), logs[:1]).model
    return first, second, third, logs


@pytest.fixture(scope="module")
def written(steps, tmp_path_factory):
    """Report on the last of these models."""
    path = tmp_path_factory.mktemp("beside") / "page.html"
    found = study(steps[2], steps[3], diagnosed=False)
    path.write_text(page(found), encoding="utf-8")
    return path, found


FIRST = "document.querySelector('#torque .plot')"
VISIBLE = f"{FIRST}.data.filter((t) => t.visible !== false).map((t) => t.name)"


TALLEST = "Math.max(0, ...[...document.querySelectorAll('#torque .spikeline')].map((line) => line.getBBox().height))"


def hovered(page, share):
    """Put the cursor over the first joint's upper panel; move it until its line through the panels is drawn."""
    plot = page.query_selector("#torque .plot")
    plot.scroll_into_view_if_needed()
    page.wait_for_function(f"{FIRST}.dataset.drawn")
    box = page.query_selector("#torque .plot .nsewdrag").bounding_box()
    for _ in range(100):  # Plotly reads the cursor 20 times a second, and not while a figure is still being drawn
        page.mouse.move(box["x"] + share * box["width"] - 5, box["y"] + 0.5 * box["height"])
        page.mouse.move(box["x"] + share * box["width"], box["y"] + 0.5 * box["height"])
        page.wait_for_timeout(100)
        if page.evaluate(TALLEST) > 0:
            break
    return page.locator("#torque .plot").first.locator(".hoverlayer")


@needs_browser
def test_one_cursor_reads_all_panels_of_a_joint(written):
    with opened(written[0].as_uri()) as seen:
        layer = hovered(seen.page, 0.3)
        layer.locator(".legend").wait_for()
        words = layer.text_content()
        for name in ("measured", "model", "residual", "q", "q̇", "log 1"):
            assert name in words
        first = seen.page.locator("#torque .plot").first
        panels = [p.bounding_box() for p in first.locator(".nsewdrag").all()]
        assert len(panels) == 4
        assert seen.page.evaluate(TALLEST) > 0.95 * (panels[-1]["y"] + panels[-1]["height"] - panels[0]["y"])
        assert seen.complaints == []


@needs_browser
def test_a_zoom_in_one_panel_is_a_zoom_in_all(written):
    with opened(written[0].as_uri()) as seen:
        hovered(seen.page, 0.3)
        box = seen.page.locator("#torque .plot").first.locator(".nsewdrag").nth(2).bounding_box()
        seen.page.mouse.move(box["x"] + 0.2 * box["width"], box["y"] + 10)
        seen.page.mouse.down()
        seen.page.mouse.move(box["x"] + 0.4 * box["width"], box["y"] + 12, steps=5)
        seen.page.mouse.up()
        seen.page.wait_for_function(f"{FIRST}._fullLayout.xaxis.range[1] < 20")
        axes = "[...new Set(" + FIRST + "._fullData.map((t) => t.xaxis))]"
        assert seen.page.evaluate(axes) == ["x"]  # the panels have no other time axis


@needs_browser
def test_a_slider_shows_the_curves_of_every_earlier_step(written):
    path, found = written
    assert [other.name for other in found.others] == ["step 0: identify", "step 1: joint_spring"]
    with opened(path.as_uri()) as seen:
        hovered(seen.page, 0.3)
        shown = seen.page.evaluate(VISIBLE)
        assert "step 0: identify" in shown
        assert "residual step 0: identify" in shown
        assert "step 1: joint_spring" not in shown
        slider = seen.page.get_by_role("slider", name="Choose")
        slider.focus()
        slider.press("ArrowRight")
        seen.page.wait_for_function(f"{VISIBLE}.includes('step 1: joint_spring')")
        assert "step 0: identify" not in seen.page.evaluate(VISIBLE)
        assert slider.get_attribute("aria-valuetext").startswith("step 1: joint_spring (NRMSE 0.0")
        seen.page.get_by_role("checkbox", name="Dotted purple curve").uncheck()
        seen.page.wait_for_function(f"!{VISIBLE}.some((name) => name.startsWith('step'))")
        assert seen.complaints == []


def test_every_log_has_its_own_errors(steps, written):
    text = written[0].read_text(encoding="utf-8")
    first = text.index("The error (NRMSE) on each log alone")
    table = text[first : text.index("</table>", first)]
    assert re.findall(r'<td class="text">(.*?)</td>', table) == ["own", "fitted", "new", "test"]
    for log in steps[3]:
        assert f"{compare(steps[2], [log]).nrmse:.4f}" in table
    assert "Both logs, one over the other" in text


def test_two_models_stand_side_by_side(steps, tmp_path):
    first, second, _, logs = steps
    path = tmp_path / "page.html"
    found = report({"old": first, "new": second}, logs, path, diagnosis=None, situation="always")
    assert found.model is first
    assert found.beside.logs == ("new",)  # neither model was fitted to this log
    assert not found.beside.seen
    assert found.beside.models["new"].nrmse == compare(second, logs[1:]).nrmse
    assert [other.name for other in found.others] == ["new"]
    text = path.read_text(encoding="utf-8")
    change = 100 * (compare(second, logs[1:]).nrmse / compare(first, logs[1:]).nrmse - 1)
    assert f"<td>−{-change:.1f} %</td>" in text, "a minus, and no hyphen"
    assert "new against old" in text


def test_models_of_other_joints_are_not_compared(steps):
    first, _, _, logs = steps
    robot = Robot.load("planar2")
    other = identify(robot, logs[:1], recursion="none", torque_joints=["joint1"]).model
    with pytest.raises(InputError, match="only models of the same joints can be compared"):
        study({"a": first, "b": other}, logs, diagnosed=False)


def test_the_command_takes_two_models(steps, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    first, second, _, logs = steps
    first.save("a.json")
    second.save("b.json")
    write_log(logs[1], "log.parquet")
    done = CliRunner().invoke(main, ["report", "a.json", "b.json", "log.parquet", "-o", "page.html", "--json"])
    assert done.exit_code == 0, done.output
    beside = json.loads(done.stdout)["beside"]
    assert list(beside["nrmse"]) == ["a", "b"]
    assert beside["nrmse"]["b"] < 0.2 * beside["nrmse"]["a"]
    assert "b against a" in (tmp_path / "page.html").read_text(encoding="utf-8")
    for arguments, said in ((["a.json", "b.json"], "no log"), (["a.json", "a.json", "log.parquet"], "given twice")):
        refused = CliRunner().invoke(main, ["report", *arguments, "-o", "other.html"])
        assert refused.exit_code == 2
        assert said in " ".join(refused.stderr.split())
        assert not (tmp_path / "other.html").exists()


def test_two_logs_of_one_name_have_each_its_role(steps):
    first, _, _, logs = steps
    found = study(first, [replace(log, source="simulated") for log in logs], diagnosed=False)
    assert found.roles == ("fitted", "test")
    for table in (data.content(found, "")["logs"], torque.content(found, "")["by_log"]):
        assert [row[:2] for row in table.rows] == [["simulated", "fitted"], ["simulated", "test"]]
