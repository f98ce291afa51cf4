import json
import os
import stat
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from cases import exact_log, quick, random_values, robot, states
from click.testing import CliRunner
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from frischid.cli import main
from frischid.core.files import check_writable
from frischid.effects import BASELINE, columns_of, parse_effects
from frischid.errors import InputError, UnknownNameError
from frischid.estimators.frisch import Box
from frischid.export.consistency import make_consistent
from frischid.logs.filters import LowPass
from frischid.logs.recording import Recording
from frischid.model.identification import identify
from frischid.model.model import Model
from frischid.model.model_file import FIRST_SCHEMA, SCHEMA
from frischid.model.model_parts import without_robot
from frischid.motions.simulation import Noise
from frischid.regression.regressor import nominal_parameters
from frischid.robot.robot import Robot


@cache
def found(name="planar2"):
    machine = robot(name)
    log = exact_log(machine, BASELINE, random_values(machine, BASELINE), noise=Noise(tau=0.02))
    held_out = replace(log, t=log.t + 1.0, source="held out")
    return identify(machine, [log], cutoff=8.0, valid=[held_out])


def model(name="planar2"):
    return found(name).model


# ---- prediction


def test_predicts_what_was_simulated():
    machine = robot("ur10")
    values = random_values(machine, BASELINE)
    exact = quick(machine, [exact_log(machine, BASELINE, values)]).model
    log = exact_log(machine, BASELINE, values, seed=5)
    np.testing.assert_allclose(exact.inverse_dynamics(log.q, log.v, log.a, log.t), log.tau, atol=1e-3)


def test_predicts_known_parameters_too():
    machine = robot("planar2 far_end known")
    exact = quick(machine, [exact_log(machine, ())], effects=()).model
    q, v, a = states(machine)
    truth = Robot.load("planar2", frames="far_end")
    theta = dict(zip(truth.all_names, truth.nominal, strict=True)) | dict(machine.known)
    out = np.empty((len(q), 20, 2))
    truth.regressor(q, v, a, out)
    expected = np.einsum("ncj,c->nj", out, [theta[n] for n in truth.all_names])
    np.testing.assert_allclose(exact.inverse_dynamics(q, v, a), expected, atol=1e-4)


def test_friction_is_what_the_friction_effects_say():
    machine, effects = robot("planar2"), parse_effects("viscous, joint_spring, offset")
    values = random_values(machine, effects)
    seen = quick(machine, [exact_log(machine, effects, values)], effects=effects).model
    q, v, _ = states(machine)
    expected = v * [values["fv1"], values["fv2"]]
    np.testing.assert_allclose(seen.friction(q, v), expected, atol=1e-4 * np.abs(expected).max())


def test_a_model_was_fitted_to_the_logs_of_its_last_fit():
    events = ({"action": "identify", "logs": [1]}, {"action": "add", "logs": [1, 2, 3]}, {"action": "consistent"})
    assert len(replace(model(), history=events).fitted_logs) == 3
    assert replace(model(), history=()).fitted_logs == ()


def test_one_sample_is_a_row():
    q, v, a = states(robot("planar2"), count=1)
    assert model().inverse_dynamics(q[0], v[0], a[0]).shape == (1, 2)


def test_nominal_parameters_are_the_urdfs():
    machine = robot("planar2")
    theta = nominal_parameters(machine, parse_effects("coulomb,viscous@joint2"))
    np.testing.assert_array_equal(theta[:20], machine.nominal)
    np.testing.assert_array_equal(theta[20:], [0.3302, 0.3576, 0.1391])


# ---- files


def test_file_is_readable_json(tmp_path):
    path = tmp_path / "model.json"
    model().save(path)
    data = json.loads(path.read_text(encoding="utf-8"))
    assert data["schema"] == SCHEMA == "frischid.model/2"
    assert data["parameters"][0]["expression"]
    assert data["parameters"][0]["unit"] == model().estimate.columns[0].unit
    assert {"source", "sha256", "samples"} <= set(data["history"][0]["logs"][0])
    assert data["robot"]["urdf"] == robot("planar2").urdf
    assert list(tmp_path.iterdir()) == [path]


def test_a_loaded_model_needs_no_other_file(tmp_path):
    urdf = tmp_path / "arm.urdf"
    urdf.write_text(robot("planar2").urdf)
    machine = Robot.load(urdf)
    log = exact_log(machine, BASELINE, noise=Noise(tau=0.02))
    saved = quick(machine, [log]).model
    saved.save(tmp_path / "model.json")
    urdf.unlink()
    loaded = Model.load(tmp_path / "model.json")
    q, v, a = states(machine)
    np.testing.assert_array_equal(loaded.inverse_dynamics(q, v, a), saved.inverse_dynamics(q, v, a))


number = st.floats(-1e9, 1e9)


@st.composite
def models(draw):
    """Any numbers and texts a model may hold."""
    usual, text = model(), st.text(max_size=12)
    p, J = len(usual.base), len(usual.joints)
    signs = draw(st.lists(st.sampled_from([-1, 0, 1]), min_size=p, max_size=p))
    names = [c.name for c in usual.estimate.columns]
    size = arrays(float, J, elements=st.floats(0, 1e9))
    estimate = replace(
        usual.estimate,
        columns=tuple(replace(c, unit=draw(text), sign=s) for c, s in zip(usual.estimate.columns, signs, strict=True)),
        theta=draw(arrays(float, p, elements=number)),
        covariance=np.diag(draw(arrays(float, p, elements=st.floats(0, 1e9)))),
        sigma=draw(size),
        weights=draw(size),
        condition=draw(st.floats(1, 1e9)),
        estimator=draw(text),
        notes=tuple(draw(st.lists(text, max_size=2))),
    )
    lower, upper = np.sort(draw(arrays(float, (p, 2), elements=number)), axis=1).T
    lower[draw(st.integers(0, p)) :], upper[: draw(st.integers(0, p))] = -np.inf, np.inf
    methods = draw(st.sets(st.sampled_from(["frisch", "bbrf"])))
    return replace(
        usual,
        lowpass=LowPass(draw(st.none() | st.floats(0.1, 100)), draw(text)),
        velocity=draw(st.sampled_from(["auto", "measured"])),
        expressions=tuple(draw(st.lists(text, min_size=p, max_size=p))),
        estimate=estimate,
        mean_torque=draw(arrays(float, J, elements=number)),
        bounds={m: Box(tuple(names), lower, upper) for m in methods},
        history=({"action": draw(text)},),
    )


@settings(max_examples=40, deadline=None, phases=(Phase.explicit, Phase.reuse, Phase.generate))
@given(before=models())
def test_to_json_and_back_is_the_identity(before):
    text = json.dumps(before.to_dict(), allow_nan=False)
    after = Model.from_dict(json.loads(text))
    assert after.to_dict() == before.to_dict()
    assert after.lowpass == before.lowpass
    assert after.effects == before.effects
    assert after.estimate.columns == before.estimate.columns
    assert set(after.bounds) == set(before.bounds)
    for method, box in before.bounds.items():
        np.testing.assert_array_equal(after.bounds[method].lower, box.lower)
        np.testing.assert_array_equal(after.bounds[method].upper, box.upper)


def refused(path, *words):
    with pytest.raises(InputError) as error:
        Model.load(path)
    for word in (str(path), *words):
        assert word in str(error.value)


def test_other_schemas_are_refused(tmp_path):
    path = tmp_path / "model.json"
    data = model().to_dict()
    path.write_text(json.dumps({**data, "schema": "frischid.model/3"}))
    refused(path, SCHEMA, "'frischid.model/3'")
    for other in ({}, [], 3, None, {"schema": None}):
        path.write_text(json.dumps(other))
        refused(path, "expected a frischid model")


def test_damaged_files(tmp_path):
    path = tmp_path / "model.json"
    refused(path, "cannot be read", "No such file")
    text = json.dumps(model().to_dict())
    path.write_text(text[: len(text) // 2])
    refused(path, "not a JSON model file")
    path.write_bytes(b"\xff\xfe\x00")
    refused(path, "not a JSON model file")
    for key in ("robot", "parameters", "filter", "joints", "covariance", "effects", "history"):
        data = model().to_dict()
        del data[key]
        path.write_text(json.dumps(data))
        refused(path, "damaged", key)
    for key, value in {"robot": 3, "parameters": [{}], "joints": [3], "effects": [{}], "covariance": "none"}.items():
        path.write_text(json.dumps({**model().to_dict(), key: value}))
        refused(path)


@pytest.mark.parametrize(
    ("package", "words"),
    [
        ({"name": "my-effect", "version": "1.2"}, ["the package my-effect 1.2, which is not installed", "pip install"]),
        ({"module": "bench"}, ["the module bench, which is not imported"]),
    ],
)
def test_a_model_whose_effect_comes_from_a_missing_package_is_named_and_not_called_damaged(tmp_path, package, words):
    path = tmp_path / "model.json"
    data = model().to_dict()
    foreign = {"effect": "detent", "joints": None, "package": package}
    path.write_text(json.dumps({**data, "effects": [*data["effects"], foreign]}))
    refused(path, "effect 'detent' comes from", *words)
    with pytest.raises(InputError) as error:
        Model.load(path)
    assert "damaged" not in str(error.value)
    path.write_text(json.dumps({**data, "previous": {**without_robot(data), "effects": [foreign]}}))
    refused(path, "effect 'detent' comes from", *words)


def changed(data, *path, to):
    """A copy of a model's content with one field changed."""
    copy = json.loads(json.dumps(data))
    place = copy
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = to
    return copy


@pytest.mark.parametrize(
    ("path", "value", "words"),
    [
        (("parameters", 3, "value"), "1.0", ("Expected `float`, got `str`", "parameters[3].value")),
        (("parameters", 3, "value"), float("nan"), ("finite", "parameters[3].value")),
        (("parameters", 3, "stderr"), -1.0, (">= 0.0", "parameters[3].stderr")),
        (("parameters", 3, "extra"), 1.0, ("unknown field `extra`", "parameters[3]")),
        (("parameters", 0, "bounds", "frisch"), [2.0, 1.0], ("above upper bound", "bounds.frisch")),
        (("parameters", 1, "bounds"), {}, ("expected bounds of", "parameters[1].bounds")),
        (("parameters", 1, "column"), 10_000, ("expected a column below", "parameters[1].column")),
        (("parameters", 1, "name"), "fv9", ("claims it for fv9", "parameters[1]")),
        (("covariance", 1, 1), -1e-3, ("variance", "covariance[1][1]")),
        (("covariance", 0, 1), float("inf"), ("finite", "covariance[0][1]")),
        (("information",), [[1.0]], ("one per parameter", "information")),
        (("filter", "cutoff_hz"), 0.0, (">= 0.001", "filter.cutoff_hz")),
        (("filter", "cutoff_hz"), 1e9, ("<= 1000000", "filter.cutoff_hz")),
        (("filter", "velocity"), "guess", ("Invalid enum value 'guess'", "filter.velocity")),
        (("joints", 0, "name"), "elbow", ("joint1, joint2", "joints[0]")),
        (("robot", "gravity"), [0.0, 0.0], ("length 3", "robot.gravity")),
        (("robot", "urdf"), "<robot", ("robot",)),
        (("standard",), {"m1": 1.0}, ("expected a value of", "standard")),
        (("previous",), {"schema": SCHEMA}, ("missing required field", "previous")),
        (("history", 0, "cross_validated", "nrmse"), float("inf"), ("finite", "history[0].cross_validated.nrmse")),
    ],
)
def test_an_error_names_the_field_and_what_was_expected(tmp_path, path, value, words):
    file = tmp_path / "model.json"
    file.write_text(json.dumps(changed(model().to_dict(), *path, to=value)))
    refused(file, *words)


def test_effects_in_another_order_are_an_error_and_no_wrong_answer(tmp_path):
    path, data = tmp_path / "model.json", model().to_dict()
    path.write_text(json.dumps({**data, "effects": data["effects"][::-1]}))
    refused(path, "the effects or the robot of the file were changed")
    names = [p["name"] for p in data["parameters"]]
    path.write_text(json.dumps(changed(data, "parameters", 1, "column", to=data["parameters"][0]["column"])))
    refused(path, "expected each column once", "parameters[1].column")
    swapped = changed(data, "parameters", 0, "column", to=data["parameters"][1]["column"])
    swapped["parameters"][1]["column"] = data["parameters"][0]["column"]
    path.write_text(json.dumps(swapped))
    refused(path, "claims it for", names[0])


@pytest.mark.parametrize("key", ["history", "previous", "other"])
def test_deep_nesting_is_an_error_of_the_file(tmp_path, key):
    path, text = tmp_path / "model.json", json.dumps(model().to_dict())
    deep = '{"a":' * 100_000 + "1" + "}" * 100_000
    path.write_text(f'{text[:-1]}, "{key}": {deep}}}')
    refused(path, "nested too deep")


def first_version(data):
    """The content of a file as version 1 of the schema had it."""
    old = {k: v for k, v in data.items() if k not in ("prior", "standard", "recursion")}
    parameters = [{k: v for k, v in p.items() if k != "from_data"} for p in data["parameters"]]
    history = [{k: v for k, v in event.items() if k != "criteria"} for event in data["history"]]
    previous = None if data["previous"] is None else first_version(data["previous"])
    return {**old, "schema": FIRST_SCHEMA, "parameters": parameters, "history": history, "previous": previous}


def test_a_file_of_version_1_is_read(tmp_path):
    path = tmp_path / "model.json"
    now = replace(model(), previous=model(), recursion=None)
    path.write_text(json.dumps(first_version(now.to_dict())))
    with pytest.warns(UserWarning, match="no hash"):
        old = Model.load(path)
    q, v, a = states(robot("planar2"))
    np.testing.assert_array_equal(old.inverse_dynamics(q, v, a), now.inverse_dynamics(q, v, a))
    np.testing.assert_array_equal(old.estimate.covariance, now.estimate.covariance)
    assert old.prior is None
    assert old.to_dict()["schema"] == SCHEMA
    assert old.previous.estimate.columns == now.estimate.columns


def test_steps_before_a_model_load_with_it(tmp_path):
    path, chain = tmp_path / "model.json", model()
    for k in range(30):
        chain = replace(chain, previous=chain, history=(*chain.history, {"action": f"step {k}"}))
    chain.save(path)
    loaded = Model.load(path)
    assert loaded.to_dict() == chain.to_dict()
    assert loaded.previous.robot is loaded.robot


def test_the_prior_is_saved_with_the_model(tmp_path):
    log = exact_log(robot("planar2"), BASELINE, noise=Noise(tau=0.02))
    before = quick(robot("planar2"), [log], prior="urdf").model
    before.save(tmp_path / "model.json")
    after = Model.load(tmp_path / "model.json")
    assert after.prior.to_dict() == before.prior.to_dict()
    assert after.fitted.to_dict() == before.fitted.to_dict()
    assert after.prior.parameters.names == tuple(c.name for c in columns_of(after.robot, after.effects))
    assert after.history[0]["criteria"]["identification"]["unexplained_nrmse"] == 0.8
    damaged = json.loads((tmp_path / "model.json").read_text(encoding="utf-8"))
    damaged["prior"]["parameters"].reverse()
    with pytest.raises(InputError, match=r"in order - at `prior\.parameters`"):
        Model.from_dict(damaged, "model.json")


def test_parameters_by_position_and_by_name():
    one = model()
    assert one.parameters["fv1"] == one.parameters[one.parameters.names.index("fv1")]
    assert [p.value for p in one.parameters] == one.estimate.theta.tolist()
    with pytest.raises(InputError, match=r"unknown parameter 'fv7'; did you mean: fv2, fv1"):
        one.parameters["fv7"]


def test_unwritable_paths_leave_nothing_behind(tmp_path):
    with pytest.raises(InputError, match="there is no folder"):
        model().save(tmp_path / "none" / "model.json")
    folder = tmp_path / "folder"
    (folder / "inside").mkdir(parents=True)
    with pytest.raises(InputError, match="is a folder"):
        model().save(folder)  # a folder is in the way
    assert sorted(p.name for p in tmp_path.rglob("*")) == ["folder", "inside"]
    for wrong, words in ((folder, "is a folder"), (tmp_path / "no" / "x.json", "there is no folder")):
        with pytest.raises(InputError, match=words):
            check_writable(wrong)
    check_writable(tmp_path / "new.json")
    assert not (tmp_path / "new.json").exists()


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_write_protected_folder(tmp_path):
    tmp_path.chmod(stat.S_IRUSR | stat.S_IXUSR)
    try:
        with pytest.raises(InputError, match="cannot be written"):
            model().save(tmp_path / "model.json")
        assert not list(tmp_path.iterdir())
    finally:
        tmp_path.chmod(stat.S_IRWXU)


def test_an_interrupted_write_keeps_the_old_file(tmp_path, monkeypatch):
    path = tmp_path / "model.json"
    path.write_text("old")

    def full(*_, **__):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("pathlib.Path.replace", full)
    with pytest.raises(InputError, match="No space left"):
        model().save(path)
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_log_is_known_by_its_samples_not_by_its_name():
    machine = Robot.load("planar2")
    values = random_values(machine, BASELINE)
    logs = [exact_log(machine, BASELINE, values, seed=s) for s in (1, 2)]
    logs = [replace(log, source="log", sha256=None) for log in logs]
    fitted = identify(machine, logs[:1], recursion="none").model
    assert fitted.made_from(replace(logs[0], source="the same under another name"))
    assert not fitted.made_from(logs[1])
    recorded = Recording("log", lambda _: iter(logs))
    assert not fitted.made_from(recorded)
    named = replace(fitted, history=({"logs": [{"source": "log", "sha256": None}]},))
    assert named.made_from(recorded)


def test_history_says_what_was_done():
    (event,) = model().history
    assert event["action"] == "identify"
    assert event["effects"] == [str(e) for e in model().effects]
    assert event["test"]["nrmse"] == found().comparison.nrmse
    assert any("low-passed at 8 Hz" in n for n in event["notes"])


def test_an_edited_number_is_noticed_and_another_layout_is_not(tmp_path):
    path = tmp_path / "model.json"
    model().save(path)
    data = json.loads(path.read_text(encoding="utf-8"))
    path.write_text(json.dumps(dict(reversed(data.items())), indent=7).replace(" 1.0,", " 1,"), encoding="utf-8")
    assert Model.load(path).to_dict() == model().to_dict()
    data["parameters"][0]["value"] *= 1.001
    path.write_text(json.dumps(data), encoding="utf-8")
    refused(path, "a value was changed after frischid wrote the file", "delete its field `sha256`")


def test_a_file_without_its_hash_is_read_with_a_warning(tmp_path):
    path = tmp_path / "model.json"
    data = changed(model().to_dict(), "parameters", 0, "value", to=7.5)
    path.write_text(json.dumps(data), encoding="utf-8")
    with pytest.warns(UserWarning, match=r"model\.json holds no hash .* cannot notice a changed number"):
        assert Model.load(path).estimate.theta[0] == 7.5
    done = CliRunner().invoke(main, ["export", str(path), "-o", str(tmp_path / "drives.csv")])
    assert "note: " in done.stderr
    assert "holds no hash" in done.stderr


def test_a_step_of_the_history_has_types(tmp_path):
    path = tmp_path / "model.json"
    path.write_text(json.dumps(changed(model().to_dict(), "history", 0, "logs", to="all of them")))
    refused(path, "Expected `array`, got `str`", "history[0].logs")
    path.write_text(json.dumps(changed(model().to_dict(), "history", 0, "logs", to=[{"source": "log.csv"}])))
    refused(path, "missing required field `sha256`", "history[0].logs[0]")


def test_a_field_that_is_nested_deep_is_said(tmp_path):
    path = tmp_path / "model.json"
    deep = json.loads("[" * 500 + "]" * 500)
    path.write_text(json.dumps(changed(model().to_dict(), "history", 0, "criteria", to=deep)))
    refused(path, "nested too deep")


@pytest.mark.parametrize("wrong", [None, np.zeros((10, 1)), np.zeros((5, 2)), np.zeros((10, 2, 1))])
def test_a_motion_of_the_wrong_shape_is_refused(wrong):
    q = np.zeros((10, 2))
    with pytest.raises(InputError, match=r"a has the shape .*; expected \(10, 2\): .* joint1, joint2"):
        model().inverse_dynamics(q, q, wrong)


def test_times_of_the_wrong_length_or_order_are_refused():
    q, motion = np.zeros((3, 2)), np.zeros((3, 2))
    for t, words in (
        ([0.0, 1.0], r"t has the shape \(2,\); expected \(3,\)"),
        ([0, np.nan, 1], r"t\[1\] is not a finite"),
    ):
        with pytest.raises(InputError, match=words):
            model().inverse_dynamics(q, motion, motion, t)
    warm = replace(model(), effects=parse_effects("self_heating"), standard=None, base=(), estimate=model().estimate)
    with pytest.raises(InputError, match=r"t\[2\] = 0.5 s lies before t\[1\] = 1 s"):
        warm.friction(q, motion, t=[0.0, 1.0, 0.5])


def test_a_parameter_that_does_not_exist_is_named():
    physical = make_consistent(model()).model
    with pytest.raises(UnknownNameError, match=r"unknown parameter 'fv3'; did you mean: fv2, fv1"):
        physical.parameter("fv3")
