"""An effect of the model answers the issue of a log's check that asks for it, on all joints that the issue names."""

import pytest

from frischid.checks.log_issue import LogIssue
from frischid.effects import BASELINE, parse_effects
from frischid.model.identification import identify
from frischid.model.log_quality import is_answered
from frischid.motions.simulation import Noise, simulate
from frischid.motions.trajectory import random_fourier
from frischid.robot.robot import Robot

ARM = Robot.load("planar2")


@pytest.fixture(scope="module")
def log():
    return simulate(ARM, random_fourier(ARM, 12.0, seed=1), rate=50.0, noise=Noise(tau=0.05), seed=1)


@pytest.mark.parametrize(
    ("effects", "kind", "where", "answered"),
    [
        ("", "unexplained torque", ("joint2",), False),
        ("joint_spring@joint2", "unexplained torque", ("joint2",), True),
        ("joint_spring@joint2", "unexplained torque", ("joint1", "joint2"), False),
        ("joint_spring@joint2", "spring", ("joint2",), True),
        ("joint_spring@joint2", "mounting", (), False),
        ("gravity_tilt", "mounting", (), True),
        ("gravity_tilt", "unexplained torque", ("joint1",), False),
        ("joint_spring@joint2", "torque sign", ("joint2",), False),
    ],
)
def test_effects_answer_issues(log, effects, kind, where, answered):
    chosen = (*BASELINE, *(parse_effects(effects) if effects else ()))
    model = identify(ARM, [log], effects=chosen, recursion="none").model
    assert is_answered(model, LogIssue(kind, "what", where, "likely", "advice")) == answered
