"""The robot's colours and its label show the errors of the verdict, which is on test logs."""

from types import SimpleNamespace

import pytest

import frischid as fr
from frischid.model.comparison import compare
from frischid.model.headline import headline
from frischid.studio.colours import top_of
from frischid.studio.headline_text import verdict_errors
from frischid.studio.stage import Stage

pytest.importorskip("viser")


def test_the_scene_shows_the_error_on_the_test_logs_as_the_report_does():
    robot = fr.Robot.load("planar2")
    sprung = {"effects": fr.parse_effects("viscous, coulomb, joint_spring@joint2"), "parameters": {"ks2": 4.0}}
    own = fr.simulate(robot, fr.random_fourier(robot, 12.0, seed=1), rate=100.0, noise=fr.Noise(tau=0.01))
    test = fr.simulate(robot, fr.random_fourier(robot, 12.0, seed=2), rate=100.0, noise=fr.Noise(tau=0.01), **sprung)
    model = fr.identify(robot, [own], recursion="none").model
    state = SimpleNamespace(headline=headline(model, [test]), comparison=compare(model, [own, test]))
    shown = Stage.errors(SimpleNamespace(bench=SimpleNamespace(state=state)), 0.0, "of the verdict")
    assert shown == verdict_errors(state)
    alone = compare(model, [test]).joints["joint2"].nrmse
    assert shown["joint2"] == pytest.approx(alone)
    assert state.comparison.joints["joint2"].nrmse < 0.9 * alone, "the fitted log would hide a part of the error"


@pytest.mark.parametrize(
    ("errors", "top"), [((0.001,), 0.02), ((0.04, 0.3), 0.3), ((2.46, 0.76, 0.06), 1.0)], ids=["small", "usual", "TX40"]
)
def test_an_error_worse_than_a_constant_torque_does_not_bleach_the_scale(errors, top):
    """With 246 % as the strongest colour, a joint that missed 35 % after the step was as grey as one without error."""
    assert top_of(errors) == top
