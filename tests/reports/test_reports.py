"""The report: whole, offline, drawn, readable on a large and a small screen; and honest about what it was shown."""

import csv
import html
import os
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from browser import OVERLAPS, needs_browser, opened, unroll
from jinja2 import UndefinedError

from frischid import figures
from frischid.core.text import sentence
from frischid.diagnosis import improvement
from frischid.diagnosis.addition import add
from frischid.diagnosis.clause import missing
from frischid.diagnosis.contacts import Contact
from frischid.diagnosis.diagnosis import diagnose
from frischid.diagnosis.effect_curves import correlation_ratio, shape_of
from frischid.diagnosis.improvement import improve
from frischid.diagnosis.model_notes import TOUCHED
from frischid.effects import BASELINE, parse_effects
from frischid.errors import InputError
from frischid.figures.failure import worst
from frischid.figures.robot_picture import robot_picture
from frischid.figures.style import number
from frischid.logs.readers import read_log
from frischid.model.alarms import Alarm
from frischid.model.comparison import compare
from frischid.model.headline import Headline
from frischid.model.identification import identify
from frischid.model.identification_alarms import HARDLY_PREDICTED
from frischid.model.model import Model
from frischid.model.prediction import predict
from frischid.model.residual_conditions import Condition
from frischid.motions.simulation import Noise, simulate
from frischid.motions.trajectory import random_fourier
from frischid.reports.chapters import CHAPTERS
from frischid.reports.chapters.history import rounded
from frischid.reports.page import page, report
from frischid.reports.study import Study, study
from frischid.reports.templates import environment, packed_plotly, render
from frischid.robot.robot import Robot

DATA = os.environ.get("FRISCHID_DATA")
SECTIONS = ("verdict", "torque", "fails", "missing", "history", "parameters", "data")
LARGEST = 6_000_000  # bytes
UR10E = {
    "current_gain": {
        "shoulder_pan_joint": 11.97, "shoulder_lift_joint": 11.98, "elbow_joint": 9.84,
        "wrist_1_joint": 10.75, "wrist_2_joint": 10.69, "wrist_3_joint": 10.68,
    }
}  # fmt: skip


def recorded(effects=(), extra=None, name="log", seed=0, robot="planar2", rate=100.0, seconds=20.0, scale=0.7):
    """A log of a simulated arm."""
    machine = Robot.load(robot)
    motion = random_fourier(machine, seconds, seed=seed, scale=scale)
    return simulate(
        machine, motion, rate=rate, effects=(*BASELINE, *effects), parameters=extra or {},
        noise=Noise(q=1e-5, tau=0.01), channels=(), seed=seed, name=name,
    )  # fmt: skip


@pytest.fixture(scope="session")
def spring(tmp_path_factory):
    """Report on an arm with a hidden spring, and what it shows."""
    hidden = parse_effects("joint_spring@joint2")
    logs = [
        recorded(hidden, {"ks2": 4.0}, name, seed, seconds=40.0) for seed, name in enumerate(("fit <b>&", "held out"))
    ]
    model = identify(Robot.load("planar2"), logs[:1]).model
    path = tmp_path_factory.mktemp("report") / "page.html"
    return path, report(model, logs, path, situation="always")


def chapter(anchor, shown, model_path="model.json"):
    """One chapter as HTML."""
    (found,) = [c for c in CHAPTERS if c.anchor == anchor]
    return str(found.html(shown, model_path))


def joint_reports(folder):
    """Model and logs of the real robots, by name."""
    data = Path(folder)
    robot = Robot.load(data / "panda/panda.urdf")
    logs = [read_log(data / f"panda/logs/{n}.parquet", robot.joints) for n in ("ident_0_14s", "valid_14_21s")]
    yield "panda", identify(robot, logs[:1], valid=logs[1:], recursion="none").model, logs
    robot = Robot.load(data / "ur10e/ur10e.urdf")
    names = ["ident_20s_5harm", "ident_20s_10harm", "unloaded_50s_14harm"]
    logs = [read_log(data / f"ur10e/logs/{n}.parquet", robot.joints, UR10E) for n in names]
    yield "ur10e", identify(robot, logs[:2], valid=logs[2:], recursion="none").model, logs


DRAWN = (
    f"() => {{ const overlaps = {OVERLAPS};"
    + """ return [...document.querySelectorAll('.plot')].map(p => ({
  label: p.getAttribute('aria-label'),
  marks: [...p.querySelectorAll('.scatterlayer path, .heatmaplayer image')].filter(
    m => { const b = m.getBoundingClientRect(); return b.width + b.height > 4; }).length,
  width: p.getBoundingClientRect().right,
  height: p.getBoundingClientRect().height,
  cut: [...p.querySelectorAll('svg text')].filter(t => {
    if (!t.textContent || getComputedStyle(t).visibility == 'hidden') return false;
    const b = t.getBoundingClientRect(), o = p.getBoundingClientRect();
    return b.width && (b.left < o.left - 3 || b.right > o.right + 3 || b.bottom > o.bottom + 3 || b.top < o.top - 3);
  }).map(t => t.textContent),
  over: overlaps(p),
}))}"""
)


def check(path, width, scheme):
    """Open a report and look at all of it."""
    with opened(path.as_uri(), width=width, scheme=scheme) as seen:
        unroll(seen.page)
        assert seen.complaints == []
        assert seen.outside == []
        assert [s.get_attribute("id") for s in seen.page.query_selector_all("section")] == list(SECTIONS)
        assert seen.page.evaluate("document.documentElement.scrollWidth") <= width
        plots = seen.page.evaluate(DRAWN)
        for plot in plots:
            assert plot["marks"], plot["label"]
            assert plot["width"] <= width, plot["label"]
            assert plot["cut"] == [], plot["label"]
            assert width > 480 or plot["height"] < width + 60 or "Correlation" not in plot["label"]
            assert plot["over"] == [], plot["label"]
        assert {p.get_attribute("data-drawn") for p in seen.page.query_selector_all(".plot")} == {scheme}
        return plots


WIDER = """(kind) => [...document.querySelectorAll(kind)].filter((e) => e.checkVisibility()).filter((e) =>
  e.getBoundingClientRect().right > e.closest("section").getBoundingClientRect().right + 1).map((e) => e.innerText)"""


def printed(page):
    """Look at a page as it is printed: no word covers another one, no figure and no table is wider than the paper."""
    page.evaluate("window.dispatchEvent(new Event('beforeprint'))")
    page.emulate_media(media="print")
    for kind in (".main-svg", "table", "figure"):
        assert page.evaluate(WIDER, kind) == []
    plots = page.evaluate(DRAWN)
    for plot in plots:
        assert plot["over"] == [], plot["label"]
        assert plot["cut"] == [], plot["label"]
    return len(plots)


@needs_browser
@pytest.mark.parametrize(("width", "scheme"), [(1280, "light"), (390, "dark")])
def test_the_page_is_drawn_whole_and_alone(spring, width, scheme):
    assert len(check(spring[0], width, scheme)) > 20


@needs_browser
@pytest.mark.skipif(not DATA, reason="FRISCHID_DATA is not set")
def test_real_robots(tmp_path):
    for name, model, logs in joint_reports(DATA):
        path = tmp_path / f"{name}.html"
        shown = report(model, logs, path)
        assert shown.verdict.nrmse < 0.12
        assert path.stat().st_size < LARGEST
        check(path, *{"panda": (1280, "dark"), "ur10e": (390, "light")}[name])
        with opened(path.as_uri()) as seen:
            assert printed(seen.page) >= 50


@needs_browser
def test_it_prints_every_figure_in_light_colours(spring, tmp_path):
    with opened(spring[0].as_uri(), scheme="dark") as seen:
        seen.page.pdf(path=tmp_path / "page.pdf", format="A4")
        assert (tmp_path / "page.pdf").stat().st_size > 50_000
        seen.page.evaluate("window.dispatchEvent(new Event('beforeprint'))")
        drawn = {p.get_attribute("data-drawn") for p in seen.page.query_selector_all(".plot")}
        assert drawn == {"light"}
        assert printed(seen.page) > 20
        assert seen.complaints == []


class Tags(HTMLParser):
    """Elements of a page, and what they refer to."""

    def __init__(self):
        super().__init__()
        self.scripts, self.links = 0, []

    def handle_starttag(self, tag, attrs):
        self.scripts += tag == "script" and not dict(attrs).get("type")
        self.links += [v for k, v in attrs if k in ("src", "href", "data", "action")]


def test_the_file_refers_to_nothing_outside_and_holds_plotly_once(spring):
    text = spring[0].read_text(encoding="utf-8")
    tags = Tags()
    tags.feed(text)
    assert all(link.startswith(("#", "data:")) for link in tags.links)
    assert tags.scripts == 2  # the one that unpacks plotly.js, and the page's own
    assert text.count("* plotly.js v") == 1  # its licence
    assert text.count(packed_plotly()["packed"]) == 1
    assert len(text) < 2.6e6, "a page of a small robot is small"
    assert "default-src 'none'" in text


def test_a_warning_does_not_repeat_an_alarm(spring, monkeypatch):
    monkeypatch.setattr(Study, "impossible", ["Ia2"])
    found = spring[1]
    assert any("physically impossible" in text for text in found.warnings())
    alarm = Alarm("impossible-sign", "doubt", "The sign of Ia2 is impossible.", "Look for an effect.", ("joint2",))
    told = replace(found, headline=replace(found.headline, alarms=(alarm,)))
    assert not any("physically impossible" in text for text in told.warnings())


def test_a_warning_that_an_effect_of_the_model_answers_is_out_of_date(spring):
    """Beside a model with a tilt, the page had said that gravity probably points elsewhere than in the URDF."""
    found, issue = spring[1], "gravity points along (1, 0, -9.7) m/s² (mounting, likely)"
    quality, hardly = found.qualities[0], "the torque of joint1 is hardly predicted at all (NRMSE above 0.8): why"
    of_log = f"{quality.source}: {issue}"
    (event,) = found.model.history
    after = {"cross_validated": event["cross_validated"]}
    before = after["cross_validated"] | {"joints": {"joint1": 0.9, "joint2": 0.1}}
    event = event | {"warnings": [of_log, hardly], "unpredicted": ["joint1"], "cross_validated": before}
    for answered in (False, True):
        texts = {"answered": (issue,)} if answered else {"warnings": (issue,)}
        model = replace(found.model, history=(event, after)[: 1 + answered])
        shown = replace(found, model=model, qualities=(replace(quality, **texts),))
        said = " ".join(shown.warnings())
        assert ("gravity points" in said) != answered
        assert ("hardly predicted" in said) != answered


def test_a_joint_that_the_test_log_hardly_predicts_is_told_once(spring):
    """An effect ended the warning of the identification, so the warning of the test log takes its place."""
    (event,) = spring[1].model.history
    after = {"cross_validated": event["cross_validated"]}
    before = after["cross_validated"] | {"joints": {"joint1": 0.9, "joint2": 0.1}}
    warned = event | {"warnings": [f"joint1 {HARDLY_PREDICTED}"], "unpredicted": ["joint1"], "cross_validated": before}
    verdict = SimpleNamespace(joints={"joint1": SimpleNamespace(nrmse=0.9)}, behind_urdf=[])
    for history, here in (((warned,), False), ((warned, after), True)):
        said = replace(spring[1], model=replace(spring[1].model, history=history), verdict=verdict).warnings()
        assert any("hardly predicts the torque of joint1" in text for text in said) == here
        assert any(HARDLY_PREDICTED in text for text in said) != here


def test_a_condition_of_a_joint_with_a_small_error_is_no_place_where_the_model_fails(spring):
    whole = spring[1].comparison
    assert "joint2" in worst(whole, above=whole.nrmse)
    assert worst(whole, above=10 * whole.nrmse) == ""


def test_verdict_names_the_spring_and_counts_the_warnings(spring):
    text = spring[0].read_text(encoding="utf-8")
    warnings = spring[1].warnings()
    assert f"<title>planar2: {len(warnings)} warning" in text
    assert "Missing: joint_spring on joint2" in text
    proposed = "frischid add model.json joint_spring --joints joint2 LOG... -o better.json"
    assert proposed in re.sub("</?span>|<wbr>", "", text)
    assert "-o still-better.json" in re.sub(
        "</?span>", "", chapter("verdict", spring[1], "better.json")
    )  # not over what it reads
    assert "on logs it was not fitted to" in text
    start = text.index('id="missing"')
    for words in ("Evidence", "Could also be", "To be sure", "torque of joint_spring"):
        assert words in text[start:]


def test_long_commands_break_after_commas():
    command = environment().get_template("macros.html").module.command
    assert command("add --joints shoulder_pan,elbow") == (
        "<code><span>add</span> <span>--joints</span> <span>shoulder_pan,<wbr>elbow</span></code>"
    )


def test_the_verdict_has_no_legend_of_a_figure(spring):
    shown = spring[1]
    few = replace(shown.verdict, residuals=FewConditions())
    assert figures.matrix(few).reading.endswith("Blank: too few samples.")
    assert "Blank" not in chapter("verdict", replace(shown, verdict=few))


class FewConditions:
    """Residuals of which only one condition of one joint is known."""

    def conditions(self):
        return [Condition("joint1", "slow", 2.0, 0.1, 30, 0.001)]


def test_shapes_in_the_history_are_rounded():
    assert rounded("time_delay(size=0.062499999999999986)@j1, x(width=0.005)") == (
        "time_delay(size=0.0625)@j1, x(width=0.005)"
    )


def test_an_unknown_verdict_names_what_explains_a_part(spring):
    diagnosis = spring[1].diagnosis
    assert missing(replace(diagnosis, verdict="unknown")).endswith(
        "any one effect of the catalogue explains; joint_spring on joint2 explains a part of it"
    )
    assert missing(replace(diagnosis, verdict="unknown", findings=())).endswith(
        "any one effect of the catalogue explains"
    )


def test_every_noise_has_the_unit_of_its_joint(spring):
    text = chapter("data", spring[1])
    assert "noise of q, rad (m)" not in text
    assert re.search(r"<td>[^<]+ rad</td><td>[^<]+ N·m</td></tr>", text)


def test_a_channel_that_no_log_has_is_not_measured(tmp_path):
    log = recorded(seconds=10.0)
    log = replace(log, tau=np.where([True, False], np.nan, log.tau))
    model = identify(Robot.load("planar2"), [log], recursion="none").model
    shown = report(model, [log], tmp_path / "page.html")
    assert re.search(r'<td class="text">joint1</td>.*<td>not measured</td></tr>', chapter("data", shown))


def test_a_recursion_of_an_earlier_model_is_said_to_be_one(spring):
    shown = spring[1]
    assert shown.model.recursion is not None
    later = replace(shown, model=replace(shown.model, recursion=None, previous=shown.model))
    assert "before any effect was added" not in chapter("parameters", shown)
    assert "before any effect was added" in chapter("parameters", later)


def test_what_was_found_has_its_units(spring):
    shown = spring[1]
    found = {f.effect: f for f in shown.diagnosis.findings}
    hose, robot = found["cable_hose"], shown.model.robot
    assert [(name, unit) for name, _, unit in found["joint_spring"].found(robot)] == [("ks2", "N·m/rad")]
    assert [unit for _, _, unit in hose.found(robot)] == ["N·m/rad", "N·m", "rad"]
    assert list(hose.to_dict()["parameters"]) == ["kh2", "fz2", "distance"]
    text = spring[0].read_text(encoding="utf-8")
    assert re.search(r"ks2\u00a0=\u00a0[\d.]+\u00a0N·m/rad", text)
    assert "In parentheses an effect&#39;s shape: width in rad/s" in text


def test_a_shape_of_several_joints_says_whose_it_is(spring):
    found = next(f for f in spring[1].diagnosis.findings if f.effect == "cable_hose")
    members = [replace(found.members[0], joints=(j,)) for j in ("joint1", "joint2")]
    names = ("kh1", "fz1", "kh2", "fz2", "distance_1", "distance_2")
    both = replace(found, members=tuple(members), parameters=dict.fromkeys(names, 1.0))
    shapes = [name for name, _, _ in both.found(spring[1].model.robot)][-2:]
    assert shapes == ["distance of joint1", "distance of joint2"]


def test_a_number_of_the_calculation_alone_is_not_printed(spring):
    found = next(f for f in spring[1].diagnosis.findings if f.effect == "cable_hose")
    late = replace(found, members=parse_effects("time_delay@joint2"), parameters={"delay2": 0.004, "size": 0.003})
    assert [name for name, _, _ in late.found(spring[1].model.robot)] == ["delay2"]


def test_on_a_slow_motion_a_spring_is_shown_over_the_angle():
    log = recorded(parse_effects("joint_spring@joint2"), {"ks2": 4.0}, seconds=20.0, scale=0.2)
    model = identify(Robot.load("planar2"), [log]).model
    found = diagnose(model, [log], situation="always", effects=["joint_spring"])
    (finding,) = [f for f in found.findings if f.members]
    drawn = shape_of(found, finding, predict(model, [log]))
    time = np.linspace(0.0, 1.0, len(drawn.added))
    assert (drawn.joint, drawn.variable) == ("joint2", "q")
    assert correlation_ratio(time, drawn.added) > correlation_ratio(drawn.x, drawn.added), (
        "it is a function of time too"
    )


def test_an_effect_is_shown_over_the_motion_of_its_own_joint():
    """Joint 1 rests. Before, the spring of joint 2 was drawn over the position of joint 1, and so over time."""
    robot, spring, values = Robot.load("planar2"), parse_effects("joint_spring@joint2"), {"fc1": 0.3, "fc2": 0.3}
    model = identify(robot, [recorded(extra=values)], recursion="none").model
    motion, moves = random_fourier(robot, 20.0, seed=3), [0.0, 1.0]
    motion = replace(motion, A=motion.A * moves, B=motion.B * moves)
    effects, values = (*BASELINE, *spring), values | {"ks2": 1.5}
    log = simulate(robot, motion, rate=50, effects=effects, parameters=values, noise=Noise(tau=0.01))
    found = diagnose(model, [log], effects=["joint_spring"])
    drawn = shape_of(found, found.findings[0], predict(model, [log]))
    assert (found.validator.joints, drawn.joint, drawn.variable) == (("joint2",), "joint2", "q")
    assert np.ptp(drawn.x) > 0.9 * np.ptp(log.q[:, 1])


def test_sentences_begin_with_a_capital_or_a_joint():
    assert sentence("gravity pulls", ("joint1",)) == "Gravity pulls"
    assert sentence("each joint rubs", ("joint1", "joint2")) == "Each joint rubs"
    assert sentence("joint1, joint2 and joint3 feel each other", ("joint1", "joint2")).startswith("joint1,")


def test_names_from_files_are_escaped(spring):
    text = spring[0].read_text(encoding="utf-8")
    assert "fit <b>&" not in text
    assert "fit &lt;b&gt;&amp;" in text


def test_a_hostile_joint_name_is_text_everywhere():
    hostile = "<img src=x onerror=alert(1)> & \"j'"
    robot = Robot.load("planar2")
    renamed = robot.urdf.replace("joint1", html.escape(hostile, quote=True))
    machine = Robot(name="<b>arm</b>", source="arm", urdf=renamed)
    log = replace(recorded(), joints=(hostile, "joint2"), source="</script><script>alert(2)</script>")
    text = page(study(identify(machine, [log], recursion="none").model, [log], diagnosed=False))
    assert html.escape(hostile).replace("&quot;", "&#34;").replace("&#x27;", "&#39;") in text
    for markup in ("<img", "<b>arm", "</script><script>alert"):
        assert markup not in text


@needs_browser
def test_a_name_is_no_markup_in_a_figure_and_no_formula_in_a_table(tmp_path):
    names = ("=HYPERLINK(1)", "<b>j</b><a href='javascript:x()'>x</a>")
    text = Robot.load("planar2").urdf
    for plain, name in zip(("joint1", "joint2"), names, strict=True):
        text = text.replace(f'"{plain}"', f'"{html.escape(name)}"')
    log = replace(recorded(), joints=names)
    shown = study(
        identify(Robot(name="arm", source="arm", urdf=text), [log], recursion="none").model, [log], diagnosed=False
    )
    (tmp_path / "page.html").write_text(page(shown), encoding="utf-8")
    with opened((tmp_path / "page.html").as_uri()) as seen:
        for plot in seen.page.query_selector_all(".plot"):
            plot.scroll_into_view_if_needed()
        seen.page.wait_for_function("document.querySelectorAll('.plot[data-drawn] svg text').length > 20")
        assert seen.page.evaluate("document.querySelectorAll('svg a').length") == 0
        drawn = seen.page.evaluate("[...document.querySelectorAll('svg text')].map((t) => t.textContent).join(' ')")
        assert names[1] in drawn
        cells = []
        for button in seen.page.query_selector_all("button.csv"):
            with seen.page.expect_download() as table:
                button.evaluate("(b) => b.click()")
            table.value.save_as(tmp_path / "table.csv")
            with (tmp_path / "table.csv").open(encoding="utf-8-sig", newline="") as file:
                cells += [cell for row in csv.reader(file) for cell in row]
        assert f"'{names[0]}" in cells
        assert not any(cell.startswith(("=", "@")) for cell in cells)
        assert any(cell.startswith("-") and float(cell) < 0 for cell in cells if cell[1:].replace(".", "").isdigit())
        assert not seen.complaints


def test_a_template_names_nothing_unknown():
    with pytest.raises(UndefinedError):
        render("history.html", {})


def test_every_number_of_the_table_of_errors_is_the_comparisons(spring):
    shown = spring[1]
    rows = re.findall(r"<tr>(.*?)</tr>", chapter("torque", shown).split("</table>")[0])[1:]
    cells = [re.findall(r"<td[^>]*>(.*?)</td>", row) for row in rows]
    assert [row[0] for row in cells] == list(shown.comparison.joints.names)
    for row, j in zip(cells, shown.comparison.joints, strict=True):
        values = [float(x.replace("−", "-")) for x in row[2:]]
        assert values == pytest.approx(
            [j.rmse, j.bias, j.nrmse, j.noise_floor, j.nominal, j.constant, j.fit], rel=1e-3, abs=6e-4
        )
        assert values[2] == round(j.nrmse, 4)
        assert values[3] == round(j.noise_floor, 4)
        assert values[5] == round(j.constant, 3)


def test_the_table_of_errors_says_what_stands_at_the_top(spring):
    shown = spring[1]
    assert "the error at the top is that of the test logs alone" in chapter("torque", shown)
    own = study(shown.model, shown.logs[:1])
    assert "the error at the top is cross-validated, and therefore larger" in chapter("torque", own)


def test_every_number_of_the_table_of_parameters_is_the_models(spring):
    shown, e = spring[1], spring[1].model.estimate
    rows = re.findall(r"<tr>(.*?)</tr>", chapter("parameters", shown).split("<tbody>")[2].split("</tbody>")[0])
    cells = {row[0]: row for row in (re.findall(r"<td[^>]*>(.*?)</td>", row) for row in rows)}
    for i, column in enumerate(e.columns):
        assert cells[column.name][2] == number(e.theta[i])
        assert cells[column.name][3] == number(e.stderr[i], 2)
        assert ("impossible sign" in cells[column.name][-2]) == (column.name in shown.impossible)


def test_the_parameters_do_not_contradict_the_verdict_on_signs(spring):
    shown, says = spring[1], "judges signs by the errors of the fit with the URDF as a prior"
    assert says not in chapter("parameters", shown)
    doubt = Alarm("impossible-sign", "doubt", "The logs would give fv1 (3.4 s.e.).", "")
    estimate = replace(shown.model.estimate, theta=np.abs(shown.model.estimate.theta))  # none is impossible
    model = replace(shown.model, estimate=estimate, standard=None)
    alarmed = replace(shown, model=model, headline=replace(shown.headline, alarms=(doubt,)))
    assert says in chapter("parameters", alarmed)


def test_the_open_table_holds_the_parameters_that_differ_most_from_the_urdf(spring):
    shown, e = spring[1], spring[1].model.estimate
    rows = re.findall(r"<tr>(.*?)</tr>", chapter("parameters", shown).split("<tbody>")[1].split("</tbody>")[0])
    off = dict(zip((c.name for c in e.columns), np.abs(e.theta - shown.nominal) / e.stderr, strict=True))
    names = [re.findall(r"<td[^>]*>(.*?)</td>", row)[0] for row in rows]
    assert names == sorted(off, key=lambda name: -off[name])[: len(names)]


@needs_browser
def test_tables_and_the_model_can_be_taken_along(spring, tmp_path):
    with opened(spring[0].as_uri()) as seen:
        with seen.page.expect_download() as model:
            seen.page.click("#download-model")
        model.value.save_as(tmp_path / "again.json")
        with seen.page.expect_download() as table:
            seen.page.click("button.csv >> nth=0")
        table.value.save_as(tmp_path / "table.csv")
        assert not seen.complaints
    again = Model.load(tmp_path / "again.json")
    np.testing.assert_array_equal(again.estimate.theta, spring[1].model.estimate.theta)
    rows = (tmp_path / "table.csv").read_text(encoding="utf-8-sig").splitlines()
    assert rows[0].startswith('"joint","unit","rms error"')
    assert len(rows) == 1 + len(again.joints)


def test_the_verdicts_percentages_are_the_headlines(spring):
    shown = spring[1].headline
    text = chapter("verdict", spring[1]).replace("\u00a0", " ")
    assert f"<strong>{100 * shown.nrmse:.1f} %</strong>" in text
    rungs = re.findall(r'<th scope="row">(.*?)</th>.*?<td>([^<]*)</td></tr>', text)
    values = dict(rungs)
    assert values["URDF with fitted friction"] == f"{100 * shown.urdf_nrmse:.1f} %"
    assert values["constant torque"] == f"{100 * shown.constant_nrmse:.1f} %"
    assert values["sensors' noise alone".replace("'", "&#39;")] == f"{100 * shown.noise_floor:.1f} %"
    assert values["this model"] == f"{100 * shown.nrmse:.1f} %"
    errors = [float(said.split()[0]) for _, said in rungs]
    assert errors == sorted(errors, reverse=True), "the ladder falls"


def test_the_first_screen_answers_five_questions(spring):
    """How good, compared to what, what is wrong, where, what next."""
    shown, text = spring[1], chapter("verdict", spring[1])
    assert f">{shown.headline.grade}</strong>" in text
    assert shown.headline.grade_in_words in html.unescape(text).replace("\u00a0", " ")
    assert "joint_spring" in text.split("What is wrong")[1]
    for name, error in shown.headline.joints.items():
        assert f"{name}: {100 * error:.1f} %" in text
    assert "<span>add</span>" in text.split("Next")[1]


def test_a_model_with_a_severe_alarm_has_no_grade():
    alarm = Alarm("held-out-error", "severe", "The error is another one there.", "Record more.")
    fair = Headline(0.02, "test", 0.019, 0.5, 1.0, ("a",), {"one": 0.02})
    grades = [replace(fair, nrmse=x).grade for x in (0.01, 0.02, 0.05, 0.1, 0.2, 0.4, 0.6)]
    assert grades == ["A", "A", "B", "C", "D", "E", "F"]
    assert replace(fair, urdf_nrmse=0.0195).grade == "A", "a URDF as good as the sensors leaves nothing to gain"
    assert replace(fair, nrmse=0.023, urdf_nrmse=0.0195).grade == "A"
    assert replace(fair, alarms=(alarm,)).grade == "–"


def test_no_grade_is_given_a_reason_that_holds_for_every_severe_alarm():
    fair = Headline(0.02, "test", 0.019, 0.5, 1.0, ("a",), {"one": 0.02})
    for name in ("worse-than-constant", "faulty-log", "held-out-error"):
        said = replace(fair, alarms=(Alarm(name, "severe", "", ""),)).grade_in_words
        assert "another motion" not in said, f"{name} may speak of the motion of these logs"
        assert "an alarm" in said


def test_the_title_counts_alarms_before_warnings(spring):
    shown = spring[1]
    alarm = Alarm("log-too-short", "severe", "The log is short.", "Record a longer one.", (), None, 1.0)
    alarmed = replace(shown, headline=replace(shown.headline, alarms=(alarm,)))
    warned = len(shown.warnings())
    assert warned
    use = "First do what the alarm says. When no alarm is left, use the model"
    assert use in page(replace(alarmed, proposed=None), "model.json")
    assert use not in page(replace(shown, proposed=None), "model.json")
    told = f"{warned} warning{'s' * (warned > 1)}</small>"
    assert f"<small>1 alarm and {told}" in page(alarmed, "model.json")
    doubt = replace(alarm, id="faster-than-fitted", severity="doubt")
    both = replace(shown, headline=replace(shown.headline, alarms=(alarm, doubt)))
    assert f"<small>1 alarm, 1 doubt and {told}" in page(both, "model.json"), "the page calls a doubt a doubt"


def test_long_names_are_told_apart_in_the_picture_and_hide_no_number():
    text, machine = Robot.load("ur10").urdf, Robot.load("ur10")
    for name in machine.joints:
        text = text.replace(f'"{name}"', f'"left_arm_of_the_second_cell_{name}_with_harmonic_drive"')
    machine = replace(machine, urdf=text)
    svg = robot_picture(machine, np.zeros(6), dict.fromkeys(machine.joints, (2.457, 0.01, 1.0)))
    labels = re.findall(r"<text[^>]*>([^<]*)</text>", svg)
    assert len(set(labels)) == 6
    assert "elbow: 245.7 %" in labels
    assert all(len(label) < 27 for label in labels)


def test_names_of_joints_cannot_leave_the_picture():
    hostile = Robot.load("planar2").urdf.replace("joint1", "&lt;/svg&gt;&lt;script&gt;x()&lt;/script&gt;")
    machine = replace(Robot.load("planar2"), urdf=hostile)
    svg = robot_picture(machine, np.zeros(2), {machine.joints[0]: (0.1, 0.01, 1.0)})
    assert "<script" not in svg


def test_error_figures_are_the_comparisons(spring):
    shown = spring[1]
    held_out = compare(shown.model, shown.logs[1:])
    assert shown.held_out == ("held out",)
    assert shown.verdict.nrmse == held_out.nrmse
    assert f"NRMSE {held_out.nrmse:.4f}" in spring[0].read_text(encoding="utf-8")


@pytest.mark.parametrize("explained", [True, False])
def test_a_torque_that_is_not_predicted_is_told_once_and_with_its_explanation(explained):
    """Exchanged positions are found, and noise instead of torques has no explanation."""
    log, noise = recorded(seed=1), np.random.default_rng(0)
    wrong = {"q": log.q[:, ::-1]} if explained else {"tau": log.tau.std(axis=0) * noise.normal(size=log.tau.shape)}
    found = identify(Robot.load("planar2"), [log := replace(log, **wrong)], recursion="none", force=True)
    (said,) = [w for w in found.warnings if "hardly predicted" in w]
    assert said.endswith("a fault that another warning names may be the reason") is explained
    assert ("are columns swapped" in said) is not explained
    told = study(found.model, [log], diagnosed=False).warnings()
    assert [w for w in told if "hardly predict" in w] == [f"At identification: {said}"]


def test_fitted_logs_alone_are_a_warning():
    log = recorded()
    model = identify(log_robot := Robot.load("planar2"), [log]).model
    shown = study(model, [log], diagnosed=False, truth=model.estimate.theta)
    assert log_robot.joints == model.joints
    assert "Every log here was used to fit the model" in shown.warnings()[0]
    text = page(shown)
    assert "The model was not diagnosed" in text
    assert "<th scope=\"col\">true</th>" in text  # fmt: skip


def test_a_minute_of_seven_joints_stays_small(tmp_path):
    log = recorded(robot="panda", rate=1000.0, seconds=60.0)
    machine = Robot.load("panda", joints=[f"panda_joint{i}" for i in range(1, 8)])
    log = log.select(machine.joints)
    model = identify(machine, [log], cutoff=None, recursion="none", effects=parse_effects("viscous, coulomb")).model
    shown = study(model, [log], diagnosed=False)
    assert len(shown.prediction.t) > 59_000
    assert len(page(shown).encode()) < LARGEST
    worst = np.abs(np.where(shown.prediction.used, shown.prediction.residual, 0.0)).max(axis=0)
    assert worst == pytest.approx([abs(j.worst.measured - j.worst.predicted) for j in shown.comparison.joints.values()])


def test_bad_output_is_said_before_the_work(tmp_path):
    with pytest.raises(InputError, match="there is no folder"):
        report(None, [], tmp_path / "none" / "page.html")
    with pytest.raises(InputError, match="no log"):
        report(None, [], tmp_path / "page.html")


def test_numbers_of_json_specs_do_not_end_the_script(spring):
    text = spring[0].read_text(encoding="utf-8")
    specs = re.findall(r'<script type="application/json">(.*?)</script>', text, flags=re.DOTALL)
    assert len(specs) > 20
    assert not any("<" in s for s in specs)


def graded(shown, grade):
    """The same report with an error of another grade."""
    error = shown.headline
    nrmse = {"C": (error.noise_floor * error.urdf_nrmse) ** 0.5, "F": 1.5 * error.urdf_nrmse}[grade]
    return replace(shown, headline=replace(error, nrmse=nrmse, alarms=()))


def test_a_model_that_is_no_better_than_the_urdf_is_not_proposed_for_use(spring):
    shown = spring[1]
    for diagnosis, proposed in ((shown.diagnosis, shown.proposed), (None, None)):
        good, bad = (
            chapter("verdict", replace(graded(shown, g), diagnosis=diagnosis, proposed=proposed)) for g in "CF"
        )
        assert "Use the model:" in good
        assert "Do not use the model yet" in bad
        assert "Use the model:" not in bad
        assert ("frischid</span> <span>check" in bad) == (diagnosis is None)


def test_a_model_fitted_with_contacts_is_not_proposed_for_use(spring):
    shown = graded(spring[1], "C")
    log = shown.logs[0]
    pushes = tuple(Contact(log.source, start, start + 1.0, ["joint1"], 30.0) for start in (3.0, 15.0))
    found = replace(shown.diagnosis, verdict="contact", contacts=pushes, notes=(*shown.diagnosis.notes, TOUCHED))
    text = chapter("verdict", replace(shown, diagnosis=found, proposed=None))
    assert "Use the model" not in text
    command = "<span>--from</span> <span>16.0</span> <span>--until</span> <span>40.0</span>"
    assert command in text, "the longest part that nobody touched"
    elsewhere = tuple(replace(push, source="another.csv") for push in pushes)
    pattern = chapter("verdict", replace(shown, diagnosis=replace(found, contacts=elsewhere), proposed=None))
    assert "<span>--from</span> <span>START</span>" in pattern


def test_a_forecast_is_called_one(spring):
    assert "forecast: with joint_<wbr>spring" in chapter("verdict", spring[1])  # a narrow page breaks between words
    assert "Forecast: from cross-validation" in chapter("verdict", spring[1])
    assert "orecast" not in chapter("verdict", replace(spring[1], diagnosis=None, proposed=None))


def test_no_step_is_proposed_that_improve_would_refuse(spring, monkeypatch):
    shown = spring[1]
    steps, _ = improve(shown.model, shown.logs[:1], situation="always", max_steps=1)
    assert [step.finding.effect for step in steps] == [shown.proposed.effect] == ["joint_spring"]
    monkeypatch.setattr(improvement, "reason_against", lambda *_: "joint1 would become worse")
    refused = study(shown.model, shown.logs, diagnosis=shown.diagnosis)
    assert refused.proposed is None
    assert "frischid</span> <span>add" not in chapter("verdict", refused)
    assert "frischid</span> <span>add" in chapter("verdict", shown)
    said = "frischid improve would not add joint_spring on joint2: joint1 would become worse."
    assert said in chapter("missing", refused)
    assert said in chapter("verdict", refused), "the first screen says why it proposes no step"
    assert "would not add" not in chapter("missing", shown)


def test_a_motion_that_separates_two_effects_is_proposed_once(spring):
    shown = spring[1]
    pairs = re.findall(r"--separate</span> <span>(.*?)</span>", chapter("missing", shown))
    found = [frozenset(x.split("@")[0] for x in html.unescape(p).replace("<wbr>", "").split(",")) for p in pairs]
    assert found
    assert len(found) == len(set(found))


def test_the_last_stair_is_the_error_at_the_top(spring, tmp_path):
    """On the test logs where every step knows them; otherwise cross-validated, with the floor of those logs."""
    model, logs = spring[1].model, spring[1].logs
    first = identify(Robot.load("planar2"), logs[:1], valid=logs[1:], recursion="none").model
    step = add(first, parse_effects("joint_spring@joint2"), logs[:1], valid=logs[1:])
    shown = study(step.model, logs, diagnosed=False)
    stairs, floor = figures.staircase(step.model, shown.headline).figure.select_traces({"mode": "lines"})
    assert stairs.y[-1] == pytest.approx(shown.headline.nrmse)
    assert floor.y[0] == shown.headline.noise_floor
    assert "on the test logs" in chapter("history", shown)
    untested = add(model, parse_effects("joint_spring@joint2"), logs[:1])
    own = study(untested.model, logs[:1], diagnosed=False)
    stairs, floor = figures.staircase(untested.model, own.headline).figure.select_traces({"mode": "lines"})
    assert stairs.y[-1] == pytest.approx(own.headline.nrmse)
    assert floor.y[0] == own.headline.noise_floor


def test_notes_name_logs_without_their_folders(spring):
    """The page is for others: "A motion comes again (/home/me/run1.csv; 29 s)" had stood there."""
    shown = spring[1]
    first, *others = shown.model.history
    history = ({**first, "logs": [{"source": "/home/me/run1.csv", "sha256": None}]}, *others)
    notes = ("", "a motion comes again (/home/me/run1.csv; 29 s)")
    there = replace(shown, model=replace(shown.model, history=history), diagnosis=replace(shown.diagnosis, notes=notes))
    text = chapter("missing", there).replace("<wbr>", "").replace("\u00a0", " ")
    assert "A motion comes again (run1.csv; 29 s)" in text
    assert "/home/me" not in text


def test_the_ladder_shows_the_error_before_the_steps(spring):
    """Also where the model's file names its logs by the paths of another machine."""
    shown = spring[1]
    error = shown.headline
    elsewhere = replace(error, logs=tuple(f"../elsewhere/{source}" for source in error.logs)).to_dict()
    first = {"action": "identify", "effects": [], "test": elsewhere | {"nrmse": 0.5}}
    last = {"action": "add", "effects": ["joint_spring@joint2"], "test_before": 0.5, "test": elsewhere}
    for history, said in (
        ((first, last), "before joint_<wbr>spring"),
        ((first, last, last), "before all added effects"),
    ):
        text = chapter("verdict", replace(shown, model=replace(shown.model, history=history)))
        assert said in text
        assert "50.0\u00a0%" in text
    other = last | {"test": elsewhere | {"nrmse": 2 * error.nrmse}}  # another log of the same name
    assert "before" not in chapter("verdict", replace(shown, model=replace(shown.model, history=(first, other))))
