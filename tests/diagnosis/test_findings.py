"""Where a finding says that its effect acts."""

import frischid as fr
from frischid.diagnosis.findings import joints_of, with_members
from frischid.effects import parse_effects
from frischid.motions.simulation import simulate
from frischid.motions.trajectory import random_fourier


def test_a_delay_of_all_joints_with_a_correction_on_one_is_no_delay_of_that_joint():
    """A leg with all torques 10 ms late was told that one joint is late."""
    whole, one = parse_effects("time_delay"), parse_effects("time_delay@joint2")
    assert joints_of([*whole, *one]) == ()
    assert joints_of(one) == ("joint2",)
    assert joints_of([*parse_effects("hysteresis@joint2"), *parse_effects("hysteresis@joint1")]) == ("joint2", "joint1")


def test_a_finding_with_some_of_its_effects_says_where_these_act():
    robot = fr.Robot.load("planar2")
    logs = [
        simulate(robot, random_fourier(robot, 20.0, seed=k), rate=100.0, noise=fr.Noise(q=1e-5, tau=0.02), seed=k)
        for k in (1, 2)
    ]
    found = fr.diagnose(fr.identify(robot, logs, recursion="none").model, logs, effects=["time_delay"])
    finding = found.findings[0]
    both = with_members(finding, [*parse_effects("time_delay"), *parse_effects("time_delay@joint2")], robot)
    assert both.joints == ()
    assert both.sentence.startswith("the torque of the robot is recorded later")
