"""One model and one log: every surface shows the same error, measured the same way, beside the same references."""

import json
import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner

import frischid as fr
from frischid.cli import main
from frischid.diagnosis.addition import add
from frischid.figures.history import staircase, steps_of
from frischid.model.events import cross_validated_nrmse
from frischid.model.headline import headline_of
from frischid.model.standstill_joints import rows_of
from frischid.reports.study import study

PLANAR2 = fr.Robot.load("planar2")
SPRING = fr.parse_effects("joint_spring@joint2")


def run(*words):
    """Output of a command that ends well; an alarm is no failure here."""
    result = CliRunner().invoke(main, [str(word) for word in words])
    assert result.exit_code in (0, 1), result.output
    return result.stdout


def data_of(*words):
    return json.loads(run(*words, "--json"))


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    """A model of an arm with a spring that the model does not know, its own log and a test log, on the disk."""
    folder = tmp_path_factory.mktemp("one number")
    for number, name in enumerate(("own", "test")):
        motion = fr.random_fourier(PLANAR2, 20.0, seed=number)
        log = fr.simulate(
            PLANAR2, motion, rate=50.0, effects=(*fr.BASELINE, *SPRING), parameters={"ks2": 1.5},
            noise=fr.Noise(q=1e-5, tau=0.02), channels=(), seed=number,
        )  # fmt: skip
        fr.write_log(log, folder / f"{name}.parquet")
    own, test, path = folder / "own.parquet", folder / "test.parquet", folder / "model.json"
    identified = data_of("identify", "planar2", own, "--valid", test, "--bbrf", "none", "-o", path)
    logs = [fr.read_log(x, PLANAR2.joints) for x in (own, test)]
    return SimpleNamespace(
        folder=folder, own=own, test=test, path=path, logs=logs, identified=identified, model=fr.Model.load(path)
    )


def texts(case, error):
    """Every command's page for people, with the logs that this error is measured on."""
    tested = [case.test] if error.measured == "test" else []
    valid = ["--valid", case.test] * bool(tested)
    page = case.folder / "page.html"
    return {
        "identify": run("identify", "planar2", case.own, *valid, "--bbrf", "none"),
        "compare": run("compare", case.path, *(tested or [case.own])),
        "diagnose": run("diagnose", case.path, case.own, *valid, "--try", "joint_spring"),
        "improve": run("improve", case.path, case.own, *valid, "--max-steps", 0),
        "report": run("report", case.path, case.own, *tested, "-o", page),
    }


@pytest.mark.parametrize("measured", ["test", "cross-validated"])
def test_every_command_prints_the_same_error_and_references(case, measured):
    error = fr.headline(case.model, case.logs if measured == "test" else case.logs[:1])
    assert error.measured == measured
    for command, text in texts(case, error).items():
        said = " ".join(text.split())
        assert str(error) in said, command
        # No other error of the whole robot stands beside it.
        assert {float(x) for x in re.findall(r"NRMSE (\d\.\d{4})(?! with)", said)} == {round(error.nrmse, 4)}, command


def test_json_has_one_key_for_it(case):
    error = fr.headline(case.model, case.logs)
    page = case.folder / "page.html"
    found = {
        "identify": case.identified,
        "compare": data_of("compare", case.path, case.test),
        "diagnose": data_of("diagnose", case.path, case.own, "--valid", case.test, "--try", "joint_spring"),
        "improve": data_of("improve", case.path, case.own, "--valid", case.test, "--max-steps", 0),
        "history": data_of("history", case.path),
        "report": data_of("report", case.path, case.own, case.test, "-o", page),
    }
    for command, data in found.items():
        assert data["headline"]["nrmse"] == pytest.approx(error.nrmse, rel=1e-9), command
        assert data["headline"]["measured"] == "test", command
        for key in ("noise_floor", "urdf_nrmse", "constant_nrmse"):
            assert data["headline"][key] == pytest.approx(getattr(error, key), rel=1e-9), (command, key)


@pytest.mark.parametrize("measured", ["test", "cross-validated"])
def test_python_report_and_studio_show_it(case, measured):
    logs = case.logs if measured == "test" else case.logs[:1]
    error = fr.headline(case.model, logs)
    valid = logs[1:]
    diagnosis = fr.diagnose(case.model, case.logs[:1], valid=valid, effects=["joint_spring"])
    assert diagnosis.headline == error
    assert study(case.model, logs, diagnosis=diagnosis).headline == error
    page = case.folder / "page.html"
    fr.report(case.model, logs, page, diagnosis=diagnosis)
    text = page.read_text(encoding="utf-8")
    assert f"{100 * error.nrmse:.1f}\u00a0%</strong> of the torque's standard deviation" in text
    assert f"(NRMSE {error.nrmse:.4f} {error.where}, mean over 2 joints)" in text
    pytest.importorskip("viser", reason="the extra frischid[studio] is not installed")
    from frischid.studio.bench import Bench

    assert Bench(case.model, logs, Path("model.json")).state.headline == error


def test_a_step_has_the_error_of_the_new_model(case):
    step = add(case.model, SPRING, case.logs[:1], valid=case.logs[1:])
    assert step.headline == fr.headline(step.model, case.logs)
    assert step.headline.nrmse == step.test_after
    alone = add(case.model, SPRING, case.logs[:1])
    assert alone.headline == fr.headline(alone.model)
    assert alone.headline.nrmse == alone.error_after
    assert alone.error_before == fr.headline(case.model).nrmse, "one model has one cross-validated error"
    changed = add(case.model, SPRING, case.logs[1:], situation="changed")
    assert changed.headline.measured == "cross-validated"


def test_the_definition(case):
    """Mean over joints of the rms error over the torque's standard deviation, over moving samples."""
    compared = fr.compare(case.model, case.logs[1:])
    error = fr.headline(case.model, case.logs)
    assert error.nrmse == pytest.approx(sum(j.rmse / j.std for j in compared.joints) / 2)
    assert error.urdf_nrmse == compared.nominal
    assert error.worst == max(compared.joints, key=lambda joint: joint.nrmse).name
    own = fr.headline(case.model)
    assert own.joints == pytest.approx(case.identified["cross_validation"])
    assert own.urdf_nrmse == fr.compare(case.model, case.logs[:1]).nominal


def test_a_damaged_error_is_an_error_of_the_file():
    for wrong in ({"nrmse": "1"}, {}, 3):
        with pytest.raises(fr.InputError, match="the model file is damaged"):
            headline_of({"action": "identify", "test": wrong})
    assert headline_of({"action": "identify fleet", "error_after": 0.1}) is None


def test_with_the_torque_of_some_joints_it_is_the_error_of_these(case):
    """It was the error of all joints: `add --torque-joints` had called 0.0448 of both joints → 0.0029 of one a gain."""
    found = data_of("compare", case.path, case.own, "--torque-joints", "joint1")
    every = fr.headline(case.model)
    assert every.nrmse > 1.2 * every.joints["joint1"], "the joints differ"
    assert found["headline"]["measured"] == "cross-validated"
    assert found["headline"]["joints"] == {"joint1": found["headline"]["nrmse"]}
    assert found["headline"]["nrmse"] == pytest.approx(every.joints["joint1"])
    one = rows_of(case.model, np.array([True, False]))
    assert found["headline"]["noise_floor"] == pytest.approx(fr.compare(one, case.logs[:1]).noise_floor)
    assert cross_validated_nrmse(one.history, one.joints) == pytest.approx(every.joints["joint1"])
    with pytest.raises(fr.InputError, match="of joint1 alone"):
        fr.headline(one)
    step = add(one, fr.parse_effects("joint_spring@joint1"), case.logs[:1])
    refit = fr.identify(PLANAR2, case.logs[:1], torque_joints=["joint1"], recursion="none", effects=one.effects)
    assert step.error_before == pytest.approx(refit.headline.nrmse, rel=0.05)


def test_the_staircase_of_some_joints_ends_at_their_error(case):
    """It ended at the error of all joints, beside the noise floor of all joints."""
    step = add(case.model, SPRING, case.logs[:1])
    one = rows_of(step.model, np.array([True, False]))
    error = fr.headline(one, case.logs[:1])
    assert [after for _, _, after in steps_of(one)] == pytest.approx(
        [fr.headline(case.model).joints["joint1"], error.nrmse]
    )
    assert f"{error.nrmse / error.noise_floor:.1f}\u00a0× the noise floor" in staircase(one, error).reading
