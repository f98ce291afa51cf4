"""What is drawn: no peak is lost, every axis has its unit, bands hold what they promise."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from frischid import figures
from frischid.diagnosis.effect_curves import Shape, correlation_ratio
from frischid.effects import parse_effects
from frischid.estimators.frisch import Box
from frischid.figures.failure import worst
from frischid.figures.parameters import recursion_of, scaled
from frischid.figures.style import BLACK, INK, POINTS, WHITE, on_scale, thinned, typeset
from frischid.model.comparison import compare
from frischid.model.headline import headline
from frischid.model.identification import identify
from frischid.model.log_quality import quality
from frischid.model.model import Model
from frischid.model.prediction import predict
from frischid.model.residual_conditions import Condition
from frischid.motions.simulation import Noise, simulate
from frischid.motions.trajectory import random_fourier
from frischid.robot.robot import Robot


@pytest.fixture(scope="module")
def case():
    """A model of the planar arm with two logs."""
    robot = Robot.load("planar2")
    logs = [
        simulate(robot, random_fourier(robot, 20.0, seed=k), rate=100.0, noise=Noise(q=1e-5, tau=0.01), channels=(),
                 seed=k, name=f"log {k}")
        for k in (0, 1)
    ]  # fmt: skip
    model = identify(robot, logs[:1], valid=logs[1:]).model
    return model, logs, predict(model, logs), compare(model, logs)


@given(st.integers(0, 20_000), st.integers(0, 20_000), st.integers(2, 20_001))
def test_a_peak_of_one_sample_is_always_drawn(up, down, size):
    up, down = up % size, down % size
    x = np.sin(np.arange(size) / 100.0)
    x[down], x[up] = -5.0, 7.0
    other = np.full(size, np.nan)
    keep = thinned(x, other)
    assert len(keep) <= POINTS
    assert up in keep
    assert up == down or down in keep
    assert (np.diff(keep) > 0).all()


def test_short_names():
    assert figures.short(["panda_joint1", "panda_joint2"]) == ["joint1", "joint2"]
    assert figures.short(["shoulder_pan_joint", "elbow_joint"]) == ["shoulder_pan", "elbow"]
    assert figures.short(["arm_1_joint", "arm_2_joint"]) == ["arm_1", "arm_2"]
    assert figures.short(["only_joint"]) == ["only_joint"]


def test_prediction_is_the_model_and_its_band_the_parameters(case):
    model, logs, prediction, comparison = case
    for j, name in enumerate(prediction.joints):
        used = prediction.used[:, j]
        rms = np.sqrt(np.mean(prediction.residual[used, j] ** 2))
        assert rms == pytest.approx(comparison.joints[name].rmse)
    assert (prediction.lower <= prediction.fitted).all()
    assert (prediction.fitted <= prediction.upper).all()
    assert prediction.sources == ("log 0", "log 1")
    # a parameter moved by half a standard error along the covariance's own direction stays inside
    block = next(model.blocks(logs[:1]))[0]
    Y = block.Y[:, list(model.base)]
    direction = model.estimate.covariance @ Y[5, :, 0]
    step = 0.5 * direction / np.sqrt(Y[5, :, 0] @ direction)
    moved = prediction.fitted[5, 0] + Y[5, :, 0] @ step
    assert prediction.lower[5, 0] < moved < prediction.upper[5, 0]


def drawn(model, logs, prediction, comparison):
    """One of each figure."""
    data, robot = quality(model, logs), model.robot
    yield figures.measured(prediction, comparison, "joint1")
    yield figures.matrix(comparison)
    yield from (figures.against(prediction, "joint2", v) for v in ("q", "v", "a", "load", "t"))
    yield figures.plane(prediction, "joint1")
    yield figures.staircase(model, headline(model))
    yield figures.intervals(model, model.estimate.theta)
    yield from figures.closing(model)
    yield figures.reach(robot, data)
    yield from (figures.noise(robot, data, channel) for channel in ("tau", "q"))


def test_every_figure_has_title_units_and_a_reading(case):
    for drawing in drawn(*case):
        layout = json.loads(drawing.figure.to_json())["layout"]
        assert drawing.title
        assert drawing.reading.endswith(".")
        assert len(drawing.reading) < 300
        named = [a["title"]["text"] for k, a in layout.items() if k[1:5] == "axis" and "text" in a.get("title", {})]
        quantities = ("window", "NRMSE")  # what has no unit
        assert all("," in t or t.startswith(quantities) for t in named), named


def test_recursion_is_kept_with_the_model(case, tmp_path):
    model = case[0]
    model.save(tmp_path / "model.json")
    record = recursion_of(Model.load(tmp_path / "model.json"))
    assert record == recursion_of(model)
    assert len(record["steps"]) == len(record["lower"]) <= 40
    assert record["steps"] == sorted(set(record["steps"]))
    old = json.loads((tmp_path / "model.json").read_text())
    del old["recursion"], old["sha256"]
    assert Model.from_dict(old).recursion is None


def test_scale_keeps_order_and_is_finite():
    x = np.array([-np.inf, -1e9, -3.0, 0.0, 0.5, 2.0, np.inf])
    assert (np.diff(scaled(x)) >= 0).all()
    assert np.isfinite(scaled(x)).all()


def test_correlation_ratio_knows_a_function():
    x = np.linspace(-1, 1, 2000)
    assert correlation_ratio(x, x**2) > 0.95
    assert correlation_ratio(x, np.random.default_rng(0).normal(size=2000)) < 0.05
    assert correlation_ratio(x, np.zeros(2000)) == 0.0


def test_quality_sees_the_noise_that_was_put_in(case):
    model, logs, *_ = case
    for q in quality(model, logs):
        assert q.noise["q"] == pytest.approx(1e-5, rel=0.2)
        assert q.samples == 2001
        assert q.gaps == 0
        (trimmed,) = [note for note in q.notes if "trimmed" in note]
        assert q.kept == pytest.approx(q.seconds - float(trimmed.split(": ")[1].split()[0]), abs=0.1)
        assert not q.warnings
        json.dumps(q.to_dict(), allow_nan=False)


def test_effects_are_named_in_the_staircase(case):
    from frischid.diagnosis.addition import add

    model, logs, *_ = case
    step = add(model, parse_effects("joint_spring@joint2"), logs[:1], valid=logs[1:])
    picture = figures.staircase(step.model, headline(step.model))
    assert list(picture.figure.layout.xaxis.ticktext) == ["identify", "joint<br>spring"]
    assert picture.reading.startswith("1 effect added")
    assert "broken" not in picture.reading


def test_the_stair_begins_at_the_error_its_first_step_was_measured_against(case):
    model = case[0]
    event = {"action": "add", "effects": ["joint_spring@joint2"], "error_before": 0.08, "error_after": 0.01}
    picture = figures.staircase(replace(model, history=(*model.history, event)), headline(model))
    stairs = picture.figure.data[0]
    assert stairs.y == (0.08, 0.08, 0.08, 0.01, 0.01)
    assert None not in stairs.x
    assert picture.reading.startswith("1 effect added: 0.0800 → 0.0100")


def test_many_steps_make_room_for_each_other(case):
    model = case[0]
    event = {"action": "add", "effects": ["joint_spring@joint2"], "error_before": 0.02, "error_after": 0.01}
    picture = figures.staircase(replace(model, history=(*model.history, *[event] * 7)), headline(model))
    stairs = picture.figure.data[0]
    assert {note.textangle for note in picture.figure.layout.annotations} == {-90}
    assert picture.figure.layout.xaxis.tickangle
    assert None in stairs.x  # 0.01 after one step, 0.02 before the next: other data
    assert "Where the line is broken" in picture.reading


def test_joints_share_the_axis_of_time(case):
    _, _, prediction, comparison = case
    ranges = {figures.measured(prediction, comparison, j).figure.layout.xaxis.range for j in prediction.joints}
    assert len(ranges) == 1


def test_the_worst_moment_is_marked_whole_at_the_edge_too(case):
    _, _, prediction, comparison = case
    (mark,) = figures.measured(prediction, comparison, "joint1").figure.select_traces({"name": "worst"})
    assert mark.cliponaxis is False


def test_the_staircase_says_what_a_single_step_was_measured_on(case):
    model = case[0]
    picture = figures.staircase(model, headline(model))
    assert "cross-validated" in picture.reading
    assert picture.figure.data[0].y[0] == model.history[0]["cross_validated"]["nrmse"], "not the error on the test log"


def test_shades_are_explained(case):
    assert "Strong shade: half of the samples, faint: 90" in figures.against(case[2], "joint1", "q").reading
    assert "(shaded: 90" in figures.shape(a_shape(), "a spring").reading
    along = figures.shape(replace(a_shape(), stretch="a log"), "a spring").reading
    assert "thin blue line follows the thick grey" in along  # distinct in grey too


def test_what_is_left_out_is_not_drawn_over(case):
    prediction, comparison = case[2:]
    rested = replace(prediction, used=np.zeros_like(prediction.used) | (np.arange(len(prediction.t)) == 5)[:, None])
    (shades,) = figures.measured(rested, comparison, "joint1").figure.layout.shapes[:1]
    assert shades.path.count("M") == 3  # before and after the sixth sample, and the other log: nothing between the two
    x = np.append(np.arange(50), np.arange(80, 130)) / 10.0
    gap = replace(a_shape(), stretch="a log", x=x, residual=np.ones(100), added=np.ones(100))
    for curve in figures.shape(gap, "a spring").figure.data:
        assert np.flatnonzero(np.isnan(np.asarray(curve.y, dtype=float))).tolist() == [50]


def test_stretches_that_a_diagnosis_leaves_out_are_shaded_with_their_reason(case):
    prediction, comparison = case[2:]
    source, start = prediction.sources[0], prediction.starts[0]
    left_out = {
        "contact": [(source, start + 0.5, start + 1.0)],
        "torque at its limit": [(source, start + 2.0, start + 2.5)],
    }
    drawn = figures.measured(prediction, comparison, "joint1", left_out).figure
    without = figures.measured(prediction, comparison, "joint1").figure
    assert {trace.name for trace in drawn.data} - {trace.name for trace in without.data} == set(left_out)
    assert len(drawn.layout.shapes) == len(without.layout.shapes) + 2


def a_shape():
    """A spring's, over the position."""
    q = np.linspace(-1.0, 1.0, 200)
    return Shape("joint_spring", "joint1", "q", q, 2.0 * q, 2.0 * q, "")


def test_labels_of_the_bounds_reach_as_far_as_the_bars(case):
    model = case[0]
    e = model.estimate
    for away, last in ((1.0, "10"), (1e3, "10⁶")):
        axis = figures.intervals(replace(model, bounds={}), e.theta + away * e.stderr).figure.layout.xaxis
        assert last in axis.ticktext
        assert sorted(axis.tickvals) == pytest.approx([-x for x in sorted(axis.tickvals, reverse=True)])


@pytest.mark.parametrize(("lower", "words"), [(-1.0, "Classical Frisch is no bound here"), (1.0, "median")])
def test_bounds_say_where_the_theorem_does_not_hold(case, lower, words):
    """The box is a bound only where no parameter changes its sign; the figure had shown it without a word."""
    model = case[0]
    names = tuple(c.name for c in model.estimate.columns)
    box = Box(names, np.full(len(names), lower), np.full(len(names), 2.0))
    reading = figures.intervals(replace(model, bounds={"frisch": box})).reading
    assert words in reading
    assert ("no bound" in reading) == (lower < 0)


def test_the_estimate_beside_the_recursion_is_that_of_the_same_model(case):
    """An added effect changes old parameters, and their dotted line had left the bounds of the identified model."""
    model = case[0]
    moved = replace(model.estimate, theta=model.estimate.theta + 100.0)
    refitted = replace(model, estimate=moved, recursion=None, previous=model)
    for shown, whose in ((model, "dotted: the estimate."), (refitted, "dotted: the identified model's estimate.")):
        drawings = figures.closing(shown)
        assert drawings
        for drawing in drawings:
            name = drawing.title.split(":")[0]
            (line,) = drawing.figure.layout.shapes
            assert line.y0 == pytest.approx(model.parameters[name].value)
            low, high = drawing.figure.layout.yaxis.range
            assert low < line.y0 < high
            assert drawing.reading.endswith(whose)


def test_a_condition_hardly_worse_than_the_average_is_not_named():
    """On the TX40 the verdict had ended: "Going backwards, the error of joint_5 is 1.1 times its average"."""
    joints = {"j": SimpleNamespace(nrmse=0.3)}
    for ratio, said in ((1.1, "No condition stands out"), (1.5, "At low speed, the error of j is 1.5 times")):
        found = [Condition("j", "slow", ratio, 0.1, 100, 1e-4), Condition("j", "fast", 1.9, 0.1, 100, 0.5)]
        residuals = SimpleNamespace(conditions=lambda found=found: found)
        assert worst(SimpleNamespace(residuals=residuals, joints=joints)).startswith(said)


def test_a_robot_of_one_joint_is_not_compared_with_itself():
    robot = Robot.load("planar2", joints=["joint2"])
    log = simulate(robot, random_fourier(robot, 20.0, seed=1), rate=100.0, noise=Noise(q=1e-5, tau=0.01), seed=1)
    data = quality(identify(robot, [log], recursion="none").model, [log])
    readings = [figures.reach(robot, data).reading, *(figures.noise(robot, data, x).reading for x in ("tau", "q"))]
    assert all("joint2" in text for text in readings)
    assert not [text for text in readings if "least" in text or "noisiest" in text]


def test_numbers_on_strong_colours_can_be_read(case):
    words = list(figures.matrix(case[3]).figure.select_traces({"mode": "text"}))
    assert len(words) == 1
    assert len(words[0].text) == len(words[0].textfont.color)
    assert [on_scale(x) for x in (float("nan"), 0.2, 0.7, 1.0)] == [INK, INK, BLACK, WHITE]


def test_prose_is_typeset():
    assert typeset("removes 18% of -3 N, k = -2 rad") == ("removes 18\u00a0% of −3\u00a0N, k\u00a0=\u00a0−2\u00a0rad")


@pytest.mark.parametrize("furthest", [900.0, 9e3, 3e4, 3e5])
def test_labels_of_the_bounds_do_not_cover_each_other_on_a_phone(case, furthest):
    """On the LBR's page −10 and −100 had covered each other: 300 pixels hold labels a ninth of them apart."""
    model = case[0]
    e = model.estimate
    box = Box(tuple(c.name for c in e.columns), e.theta - furthest * e.stderr, e.theta + furthest * e.stderr)
    axis = figures.intervals(replace(model, bounds={"frisch": box})).figure.layout.xaxis
    reach = float(scaled(np.array(furthest)))
    places = sorted(x for x in axis.tickvals if abs(x) <= reach)
    assert np.diff(places).min() > 2 * reach / 9
