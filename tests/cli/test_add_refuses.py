"""`add` refuses an effect that no log can show, and an expression that nobody wrote."""

import json
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

import frischid as fr
from frischid.cli import main
from frischid.diagnosis.shape_choice import searched
from frischid.model.log_requirements import check_effects_act


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A model of planar2, from a log without the torque of joint2."""
    where = tmp_path_factory.mktemp("add")
    robot = fr.Robot.load("planar2")
    log = fr.simulate(robot, fr.random_fourier(robot, 10.0, seed=1), rate=50.0, noise=fr.Noise(tau=0.01))
    tau = log.tau.copy()
    tau[:, 1] = np.nan
    fr.write_log(replace(log, tau=tau), where / "log.csv")
    found = fr.identify(robot, [fr.read_log(where / "log.csv", robot.joints)], recursion="none")
    found.model.save(where / "model.json")
    return where


def added(folder, effect):
    result = CliRunner().invoke(
        main, ["add", f"{folder}/model.json", effect, f"{folder}/log.csv", "-o", f"{folder}/x.json"]
    )
    return result.exit_code, " ".join(result.output.split())


def test_an_effect_on_a_joint_without_torque_is_an_error(folder):
    code, said = added(folder, "joint_spring@joint2")
    assert code == 2
    assert "have no torque of joint2" in said
    assert "fitted: joint1" in said
    assert not (folder / "x.json").exists()
    assert added(folder, "joint_spring@joint1")[0] == 0


def test_an_effect_without_a_joint_to_act_on_says_so():
    """It said that the model's own columns span a coupling, on a robot whose joints are no pair."""
    robot = fr.Robot.load("planar2", joints=["joint1"])
    log = fr.simulate(robot, fr.random_fourier(robot, 10.0, seed=1), rate=50.0, noise=fr.Noise(tau=0.01))
    model = fr.identify(robot, [log], recursion="none").model
    text = "joint_coupling"
    with pytest.raises(fr.InputError, match="on this robot, the effect acts on no joint"):
        searched(model, fr.parse_effects(text), text, [log], "auto")


def test_all_effects_that_were_added_are_named(folder):
    robot = fr.Robot.load("planar2")
    log = fr.simulate(robot, fr.random_fourier(robot, 10.0, seed=1), rate=50.0, noise=fr.Noise(tau=0.01))
    fr.write_log(log, folder / "both.csv")
    fr.identify(robot, [log], recursion="none").model.save(folder / "both.json")
    command = ["add", f"{folder}/both.json", "joint_spring@joint1, joint_spring@joint2", f"{folder}/both.csv"]
    result = CliRunner().invoke(main, [*command, "-o", f"{folder}/y.json", "--json"])
    assert [e.joints for e in fr.parse_effects(json.loads(result.stdout)["effect"])] == [("joint1",), ("joint2",)]


def test_a_formula_needs_its_expression(folder):
    code, said = added(folder, "formula@joint1")
    assert code == 2
    assert """'formula("sin(q)*v")@joint1'""" in said
    assert added(folder, 'formula("sin(3*q)")@joint1')[0] == 0


def test_an_effect_between_joints_needs_the_torque_of_one():
    robot = fr.Robot.load("planar2")
    check_effects_act(robot, ["joint1"], fr.parse_effects("joint_coupling@joint1+joint2"))
    check_effects_act(robot, ["joint1"], fr.parse_effects("gravity_tilt"))


def test_python_refuses_such_an_effect_too(folder):
    model = fr.Model.load(folder / "model.json")
    log = fr.read_log(folder / "log.csv", model.robot.joints)
    with pytest.raises(fr.InputError, match="have no torque of joint2"):
        fr.add(model, fr.parse_effects("joint_spring@joint2"), [log])
