"""Logs of one name, and joints that slide: each log by its own motions, each joint in its own unit."""

from dataclasses import replace

from cases import exact_log, joint, link, made, urdf

from frischid.effects import BASELINE, parse_effects
from frischid.logs.filters import LowPass
from frischid.logs.preprocessing import prepare
from frischid.model.log_examination import check, report_issues
from frischid.motions.simulation import Noise
from frischid.robot.robot import Robot

LIMIT = '<limit lower="-0.5" upper="0.5" velocity="1" effort="500"/>'


def test_a_spring_of_a_sliding_joint_is_a_force_that_follows_its_position():
    table = joint("axis", "base", "table", "prismatic", inside=LIMIT, axis="1 0 0")
    machine = made(urdf(link("base"), link("table", 20.0), table))
    effects = (*BASELINE, *parse_effects("joint_spring"))
    values = {"ks1": 800.0, "fv1": 20.0, "fc1": 5.0}
    log = exact_log(machine, effects, values, 20.0, noise=Noise(q=1e-6, tau=0.01))
    (report,) = check(machine, [log])
    (said,) = (issue.what for issue in report.issues if issue.kind == "spring")
    assert said.startswith("a force of ")
    assert " N (half its range) follows the joint's position alone" in said


def test_two_logs_of_one_name_are_checked_each_by_its_own_motions():
    robot, lowpass = Robot.load("planar2"), LowPass(3.0)
    logs = [exact_log(robot, BASELINE, None, 20.0, seed=seed, noise=Noise(q=1e-5, tau=0.01)) for seed in (1, 2)]
    logs[1] = replace(logs[1], tau=logs[1].tau * [1.0, -1.0])
    assert logs[0].source == logs[1].source
    right, wrong = report_issues(robot, logs, (lowpass, [prepare(log, lowpass).motions for log in logs]))
    assert right.issues == ()
    assert [issue.kind for issue in wrong.issues] == ["torque sign"]
