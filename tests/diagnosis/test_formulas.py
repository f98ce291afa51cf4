"""A formula of the user's own that can change nothing is refused, and one of huge numbers cannot spoil the fit."""

from functools import cache

import pytest
from cases import MIXED, made

from frischid.diagnosis.addition import add
from frischid.diagnosis.residual_formula import Description, library
from frischid.diagnosis.situation import cross_validator
from frischid.effects import Formula, parse_effects
from frischid.errors import InputError
from frischid.model.identification import identify
from frischid.motions.simulation import Noise, simulate
from frischid.motions.trajectory import random_fourier
from frischid.robot.robot import Robot


@cache
def case():
    robot = Robot.load("planar2")
    log = simulate(robot, random_fourier(robot, 8.0, seed=0), rate=50.0, noise=Noise(tau=0.01), channels=())
    return identify(robot, [log], recursion="none").model, [log]


@pytest.mark.parametrize("situation", ["always", "changed"])
@pytest.mark.parametrize(
    ("expression", "why"),
    [
        ("0", "is zero"), ("q-q", "is zero"), ("0*v2", "is zero"), ("1e-40*q", "is zero"),
        ("v", "combination of columns"), ("-3*v", "combination of columns"), ("a", "combination of columns"),
        ("2", "combination of columns"),
        ("sin(v)**2+cos(v)**2", "combination of columns"),
    ],
)  # fmt: skip
def test_a_formula_that_changes_nothing_is_refused(expression, why, situation):
    model, logs = case()
    with pytest.raises(InputError, match=rf"changes nothing: its torque .*{why}"):
        add(model, parse_effects(f'formula(expression="{expression}")@joint2'), logs, situation=situation)


@pytest.mark.parametrize("expression", ["1e53", "1e53*q", "1e10*sin(q)"])
def test_a_formula_of_huge_numbers_says_what_to_do(expression):
    model, logs = case()
    with pytest.raises(InputError, match="stay below 1e\\+09"):
        add(model, parse_effects(f'formula(expression="{expression}")@joint2'), logs)


@pytest.mark.parametrize("scale", ["1", "1e8", "1e-8"])
def test_the_scale_of_a_formula_changes_no_error(scale):
    model, logs = case()
    steps = [add(model, parse_effects(f'formula(expression="{s}*sin(3*q)")@joint2'), logs) for s in ("1", scale)]
    assert steps[1].error_after == pytest.approx(steps[0].error_after, rel=2e-3)


@pytest.mark.parametrize("joint", ["turn", "slide", "elbow"])
def test_formulas_know_the_joints_of_a_robot_with_mimic_joints(joint):
    robot = made(MIXED)
    assert robot.mimics
    log = simulate(robot, random_fourier(robot, 8.0, seed=0), rate=50.0, noise=Noise(tau=0.01), channels=())
    model = identify(robot, [log], recursion="none").model
    validator, _ = cross_validator(model, [log], "always")
    for expression in library(validator, joint):
        assert Formula(expression=expression, joints=(joint,)).columns(robot)


def test_a_description_says_which_joint_a_number_means():
    found = Description("elbow", {"v3": 1e-9}, ("sign(v3)", "q2*q3"), 0.9, {"2": "lift", "3": "elbow", "4": "wrist"})
    assert str(found).endswith("; joint 3 is elbow and joint 2 is lift")


def test_of_many_variables_the_clearest_are_named_and_joints_that_have_their_number_in_their_name_are_not_explained():
    depends = {f"{x}{k}": 1e-9 for k in (2, 1, 3) for x in "qva"}
    found = Description("joint2", depends, (), 0.0, {"1": "joint1", "2": "joint2", "3": "wrist"})
    assert str(found) == "The residual error of joint2 depends on 9 variables, most clearly on q2, v2, a2 and q1"
    few = Description("joint2", {"q3": 1e-9}, (), 0.0, {"1": "joint1", "2": "joint2", "3": "wrist"})
    assert str(few) == "The residual error of joint2 depends on q3; joint 3 is wrist"
