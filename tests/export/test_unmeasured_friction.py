"""Friction of a joint whose torque no log has: no output calls it estimated, and files say what they hold."""

from dataclasses import replace

import numpy as np
import pytest

import frischid as fr
from frischid.cli.pages.exporting import export as page_of

NOTE = "joint2: friction was not measured, the URDF's value is kept"


@pytest.fixture(scope="module")
def model():
    """Of planar2 with damping 0.05 in the URDF, from a log without the torque of joint2."""
    robot = fr.Robot.load("planar2")
    joint = '<joint name="joint2" type="revolute">'
    text = robot.urdf.replace(joint, f'{joint}<dynamics damping="0.05"/>')
    assert text != robot.urdf
    robot = fr.Robot.from_dict({**robot.to_dict(), "urdf": text})
    log = fr.simulate(robot, fr.random_fourier(robot, 10.0, seed=1), rate=100.0, noise=fr.Noise(tau=0.01))
    tau = log.tau.copy()
    tau[:, 1] = np.nan
    return fr.identify(robot, [replace(log, tau=tau)], recursion="none").model


def test_no_sign_holds_a_parameter_that_was_not_estimated(model):
    found = fr.make_consistent(model)
    assert not {"fc2", "fv2", "Ia2"} & {active.where for active in found.active}
    assert NOTE in found.notes
    assert (found.model.parameter("fv2"), found.model.parameter("fc2")) == (0.05, 0.0), "the URDF's, exactly"


@pytest.mark.parametrize("name", ["robot.urdf", "robot.py", "robot.c", "robot.xml"])
def test_every_file_says_that_friction_was_not_measured(model, tmp_path, name):
    done = fr.export(model, tmp_path / name)
    assert NOTE in done.notes
    lines = [part for part in page_of(done).parts if isinstance(part, str)]
    assert sum(NOTE in line for line in lines) == 1
    assert NOTE in fr.export(fr.make_consistent(model).model, tmp_path / name).notes
    if name == "robot.urdf":
        assert any("the rigid torque (links without friction)" in line for line in lines)


def test_a_model_of_all_joints_has_no_such_note():
    robot = fr.Robot.load("planar2")
    log = fr.simulate(robot, fr.random_fourier(robot, 10.0, seed=1), rate=100.0, noise=fr.Noise(tau=0.01))
    assert not any("not measured" in note for note in fr.make_consistent(fr.identify(robot, [log]).model).notes)
