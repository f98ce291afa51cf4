"""Results in a notebook: a page, a figure and a table of each."""

import json
from dataclasses import replace

import plotly.graph_objects as go
import pytest
from markupsafe import escape
from test_reports import recorded

import frischid as fr
from frischid.diagnosis.clause import missing
from frischid.diagnosis.motion_space import SimulatedFinding
from frischid.model.alarms import Alarm
from frischid.reports.notebook import next_of


@pytest.fixture(scope="module")
def results():
    robot, logs = fr.Robot.load("planar2"), [recorded(seed=s, name=f"log{s}") for s in (1, 2)]
    found = fr.identify(robot, logs[:1], valid=logs[1:], recursion="none")
    plan = fr.plan(robot, options=fr.PlanOptions(duration=4.0, budget=20, seed=0))
    missing = fr.diagnose(found.model, logs[:1], effects=["joint_spring"])
    few = fr.OutputErrorOptions(horizon=0.3, rounds=1, iterations=2)
    return {
        "found": found, "model": found.model, "comparison": found.comparison, "missing": missing, "plan": plan,
        "logs": logs[:1], "robot": robot, "moved": fr.compare_simulated(found.model, logs[:1], horizons=[0.1, 0.5]),
        "simulated": replace(
            fr.simulate_findings(found.model, missing, logs[:1]),
            findings=(SimulatedFinding(missing.findings[0], {"joint1": 0.1, "joint2": 0.1}, -0.3),),
        ),
        "fitted": fr.output_error(found.model, logs[:1], options=few),
    }  # fmt: skip


@pytest.mark.parametrize("name", ["found", "model", "comparison", "missing", "plan", "moved", "simulated", "fitted"])
def test_every_result_has_a_page_a_figure_and_a_table(results, name):
    result = results[name]
    page, table = result._repr_html_(), result.to_frame("pyarrow")
    assert repr(result).replace("'", "&#39;") in page
    assert table.num_rows > 0
    hidden = [heading for heading in table.column_names if f"<th>{heading}</th>" not in page]
    assert {"parameter", "value", "joint", "effect", "NRMSE", "t", "horizon"} & set(table.column_names) - set(hidden)
    assert not hidden or f"{len(hidden)} more column" in page
    assert len(hidden) <= 6
    assert isinstance(result.plot(), go.Figure)
    assert json.loads(result.plot().to_json())["data"]


def test_the_page_holds_the_one_number_its_grade_and_the_robot(results):
    for name in ("found", "model", "missing"):
        page = results[name]._repr_html_()
        error = results[name].headline if name == "missing" else results["found"].headline
        assert f"{100 * error.nrmse:.1f} %" in page
        assert error.grade_in_words in page
        assert "<svg" in page
        assert f"{error.worst} has the largest error" in page
    assert str(escape(missing(results["missing"]))) in results["missing"]._repr_html_()
    assert "probability" in results["missing"].to_frame("pyarrow").column_names


@pytest.mark.parametrize("name", ["found", "model", "comparison", "missing", "plan", "moved", "simulated", "fitted"])
def test_the_page_ends_with_a_line_that_runs(results, name, monkeypatch):
    words, line = next_of(results[name])
    assert f"Next: {words} <code>{escape(line)}</code>" in results[name]._repr_html_()
    monkeypatch.setattr(fr, "read_log", lambda path, joints: results["logs"][0])
    names = {"fr": fr, "identification": results["found"], "diagnosis": results["missing"], "log": results["logs"][0]}
    followed = eval(line, names | {key: results[key] for key in ("model", "logs", "robot", "simulated", "fitted")})
    kinds = {"found": fr.Diagnosis, "comparison": fr.Diagnosis, "plan": fr.Identification}
    kinds |= {"moved": fr.MotionDiagnosis, "simulated": fr.MotionComparison, "fitted": fr.MotionComparison}
    assert isinstance(followed, kinds.get(name, fr.Comparison))


def test_a_motion_that_ran_away_has_a_page(results):
    moved = results["moved"]
    gone = replace(moved, whole=replace(moved.whole, tip=float("inf")))
    assert ">–</td>" in gone._repr_html_()
    assert gone.plot().data


def test_the_page_of_a_missing_effect_ends_with_the_line_that_adds_it(results, monkeypatch):
    diagnosis = results["missing"]
    monkeypatch.setattr(type(diagnosis.findings[0]), "significant", True)
    words, line = next_of(diagnosis)
    assert words == "add joint_spring and see the error"
    step = eval(line, {"fr": fr, "diagnosis": diagnosis, "model": results["model"], "logs": results["logs"]})
    assert step.model.effects[-1].id == "joint_spring"


def test_text_of_a_file_stays_text(results):
    hostile = Alarm("x", "severe", "<script>alert(1)</script>", "none")
    found = replace(results["found"], headline=replace(results["found"].headline, alarms=(hostile,)))
    assert "<script" not in found._repr_html_()


def test_a_frame_of_no_library_is_refused(results):
    with pytest.raises(fr.InputError, match="no data frames of 'excel'"):
        results["model"].to_frame("excel")
