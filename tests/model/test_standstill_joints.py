"""Logs in which a joint never moves: every command judges the joints that move, and names the others."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from click.testing import CliRunner

import frischid as fr
from frischid.cli import main
from frischid.figures.two_logs import two_logs
from frischid.model.prediction import predict

ARM = fr.Robot.load("planar2")
TRUTH = {"fv1": 0.5, "fv2": 0.3, "fc1": 0.4, "fc2": 0.2}


def held_log(seed, joint, spring=0.0):
    """A motion of one joint; the other is held at 0.4 rad, and its torque is gravity, coupling and noise."""
    whole = fr.simulate(ARM, fr.random_fourier(ARM, 20.0, seed=seed), rate=100.0)
    q, v, a = (x.copy() for x in (whole.q, whole.v, whole.a))
    q[:, joint], v[:, joint], a[:, joint] = 0.4, 0.0, 0.0
    tau = moving_model().inverse_dynamics(q, v, a, whole.t)
    tau[:, 1] += spring * q[:, 1]
    noise = np.random.default_rng(seed).standard_normal((2, *q.shape))
    return replace(whole, q=q + 1e-5 * noise[0], v=None, a=None, tau=tau + 0.01 * noise[1], source=f"held{seed}")


@cache
def moving_model():
    motion = fr.random_fourier(ARM, 20.0, seed=1)
    noise = fr.Noise(q=1e-5, tau=0.01)
    log = fr.simulate(ARM, motion, rate=100.0, effects=fr.BASELINE, parameters=TRUTH, noise=noise, seed=1)
    return fr.identify(ARM, [log], recursion="none").model


def test_the_joint_that_moves_is_compared():
    found = fr.compare(moving_model(), [held_log(2, 0)])
    assert found.not_compared == ("joint1",)
    assert found.joints.names == ("joint2",)
    assert found.nrmse < 0.05


def test_a_missing_effect_is_found_on_the_joint_that_moves():
    found = fr.diagnose(moving_model(), [held_log(2, 0, spring=3.0)], situation="changed", effects=["joint_spring"])
    assert found.findings[0].joints == ("joint2",)
    assert found.findings[0].significant
    assert any("no error of joint1 can be measured" in note for note in found.notes)


def test_a_change_is_added_on_the_joint_that_moves():
    model, log = moving_model(), held_log(2, 0, spring=3.0)
    steps, _ = fr.improve(model, [log], situation="changed", max_steps=1)
    assert steps
    assert steps[0].model.joints == model.joints
    assert steps[0].model.estimate.sigma[0] == model.estimate.sigma[0]
    assert steps[0].error_after < steps[0].error_before


@pytest.mark.parametrize("joint", [0, 1])
def test_identify_takes_such_a_log_and_the_model_can_be_saved(tmp_path, joint):
    log = held_log(3, joint)
    found = fr.identify(ARM, [log], valid=[held_log(4, joint)])
    found.model.save(tmp_path / "model.json")
    again = fr.Model.load(tmp_path / "model.json")
    assert found.headline is not None
    assert list(found.headline.joints) == [ARM.joints[1 - joint]]
    assert fr.headline(again, [held_log(5, joint)]).nrmse < 0.1
    assert fr.improve(again, [log], max_steps=1)[1].verdict == "none"


def test_every_command_names_the_joint_that_it_cannot_judge(tmp_path):
    moving_model().save(tmp_path / "model.json")
    fr.write_log(held_log(2, 1), tmp_path / "held.parquet")
    paths = [str(tmp_path / name) for name in ("model.json", "held.parquet")]
    for command in (["compare"], ["diagnose"], ["report", "-o", str(tmp_path / "report.html")]):
        shown = CliRunner().invoke(main, [command[0], *paths, *command[1:]])
        assert shown.exit_code in (0, 1), shown.output
        text = (tmp_path / "report.html").read_text() if command[0] == "report" else " ".join(shown.output.split())
        assert "no error of joint2 can be measured" in text.lower()


@pytest.mark.filterwarnings("error")
def test_two_logs_are_laid_over_one_another_where_a_joint_rests_in_one():
    """NumPy warned of the mean of an empty slice, and the sentence had a dash for an error."""
    logs = [held_log(2, 0), replace(held_log(3, 1), source="other")]
    said = two_logs(predict(moving_model(), logs), "joint1").reading
    assert "unknown (the joint rests) on held2" in said
    assert "N·m on other" in said
    assert repr(fr.compare(moving_model(), logs[:1]).not_compared) == "('joint1',)"
