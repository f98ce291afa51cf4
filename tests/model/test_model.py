import json
import os
import stat
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from cases import exact_log, quick, random_values, robot, states
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from frischid.core.files import check_writable
from frischid.core.types import Column
from frischid.effects import BASELINE, parse_effects
from frischid.errors import InputError
from frischid.estimators.frisch import Box
from frischid.logs.filters import LowPass
from frischid.logs.recording import Recording
from frischid.model.identification import identify
from frischid.model.model import SCHEMA, Model
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
    assert data["schema"] == SCHEMA == "frischid.model/1"
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
    names = draw(st.lists(st.text(min_size=1, max_size=6), min_size=p, max_size=p, unique=True))
    column = st.builds(Column, st.just(""), text, text, text, st.sampled_from([-1, 0, 1]))
    size = arrays(float, J, elements=st.floats(0, 1e9))
    estimate = replace(
        usual.estimate,
        columns=tuple(replace(draw(column), name=n) for n in names),
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
        effects=draw(st.sampled_from([BASELINE, (), parse_effects("coulomb(width=0.02)@joint2,offset")])),
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
    path.write_text(json.dumps({**data, "schema": "frischid.model/2"}))
    refused(path, SCHEMA, "'frischid.model/2'")
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
    assert event["held_out_nrmse"] == found().comparison.nrmse
    assert any("low-passed at 8 Hz" in n for n in event["notes"])
