"""Positions in degrees: of one joint or of all, and the mapping file that undoes it."""

import re
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

from frischid.checks.degrees import implausible_motion
from frischid.checks.log_issue import Notebook
from frischid.cli import main
from frischid.logs.column_units import in_millimetres
from frischid.logs.mapping_guess import propose
from frischid.logs.readers import read_log, write_log
from frischid.logs.table_writing import write_table
from frischid.model.log_examination import check
from frischid.motions.simulation import Noise, simulate
from frischid.motions.trajectory import random_fourier
from frischid.robot.robot import Robot

FILE = ("", "angle_unit", "deg")


def driven(robot, *, seed=1):
    """A log of a robot whose joints have friction."""
    values = dict(zip(robot.all_names, robot.nominal, strict=True))
    values |= {f"fv{robot.numbers[n]}": 0.1 for n in robot.joints}
    motion = random_fourier(robot, 20, seed=seed)
    return simulate(robot, motion, rate=100, noise=Noise(q=1e-5, tau=0.01), parameters=values, channels=())


def in_degrees(log, *joints):
    """The log with the positions of some joints in degrees."""
    factor = np.where([name in joints for name in log.joints], 180 / np.pi, 1.0)
    return replace(log, q=log.q * factor)


def degrees(robot, log):
    """The findings called degrees, and the fix."""
    (report,) = check(robot, [log])
    return [issue for issue in report.issues if issue.kind == "degrees"], report.fix


@pytest.mark.parametrize("which", [(0,), (1,), (0, 1)])
def test_degrees_of_one_joint_leave_the_others_alone_where_no_limit_tells(which):
    robot = Robot.load("double_pendulum_continuous")
    names = tuple(robot.joints[j] for j in which)
    (issue,), fix = degrees(robot, in_degrees(driven(robot), *names))
    assert issue.where == names
    assert fix == ((FILE,) if len(which) == 2 else ((names[0], "angle_unit", "deg"),))


@pytest.mark.parametrize("which", [(3,), (1, 4), range(7)])
def test_degrees_outside_the_limits_are_undone_for_their_joints_only(which):
    robot = Robot.load("xarm7", joints=[f"joint{k}" for k in range(1, 8)])
    names = tuple(robot.joints[j] for j in which)
    (issue,), fix = degrees(robot, in_degrees(driven(robot), *names))
    assert (issue.where, issue.sure, issue.blocks) == (names, "certain", True)
    assert fix == ((FILE,) if len(names) == 7 else tuple((name, "angle_unit", "deg") for name in names))


def test_joints_that_hardly_move_are_in_degrees_with_the_others():
    """Joint 1 moves by a few degrees: the motion cannot tell its unit, and the torques can."""
    robot = Robot.load("xarm7", joints=[f"joint{k}" for k in range(1, 8)])
    t = np.arange(0, 20, 0.01)
    q, v, a = random_fourier(robot, 20, seed=1)(t)
    for x in (q, v, a):
        x[:, 1] *= 0.03
    rng = np.random.default_rng(0)
    tau = robot.inverse_dynamics(q, v, a) + 0.1 * v + 0.01 * rng.normal(size=q.shape)
    small = replace(driven(robot), t=t, q=q + 1e-5 * rng.normal(size=q.shape), tau=tau)
    (issue,), fix = degrees(robot, in_degrees(small, *robot.joints))
    assert issue.where == robot.joints
    assert fix == (FILE,)


def test_without_torques_the_reader_decides_which_joints_are_in_degrees():
    robot = Robot.load("xarm7", joints=[f"joint{k}" for k in range(1, 8)])
    log = in_degrees(driven(robot), "joint4")
    (issue,), fix = degrees(robot, replace(log, tau=None, current=log.tau))
    assert issue.where == ("joint4",)
    assert fix == ()
    assert issue.advice.index("[joint.joint4]") < issue.advice.index("[file]")


def test_sliding_joints_stay_in_metres():
    robot = Robot.load("tiago", joints=["torso_lift_joint", "arm_1_joint"])
    log = driven(robot)
    _, fix = degrees(robot, in_degrees(log, "arm_1_joint"))
    assert set(fix) == {FILE, ("torso_lift_joint", "angle_unit", "m")}


def test_a_proposed_mapping_keeps_a_sliding_joint_in_metres_beside_degrees(tmp_path):
    robot = Robot.load("tiago", joints=["torso_lift_joint", "arm_1_joint"])
    log, path, output = driven(robot), tmp_path / "log.csv", tmp_path / "map.toml"
    write_log(replace(in_degrees(log, "arm_1_joint"), v=None), path)
    output.write_text(propose(path, robot).toml("log.csv"), encoding="utf-8")
    np.testing.assert_allclose(read_log(path, robot.joints, output).q, log.q, rtol=1e-6)


def test_a_sliding_joint_in_millimetres_is_told_and_the_mapping_file_undoes_it(tmp_path):
    robot = Robot.load("tiago", joints=["torso_lift_joint", "arm_1_joint"])
    log = driven(robot)
    path, output = tmp_path / "log.csv", tmp_path / "map.toml"
    factor = np.where(robot.prismatic, 1000.0, 1.0)
    write_log(replace(log, q=log.q * factor), path)
    result = CliRunner().invoke(
        main, ["check", "tiago", "--joints", ",".join(robot.joints), str(path), "-o", str(output)]
    )
    assert "millimetres" in result.output
    assert output.read_text(encoding="utf-8") == '[joint."torso_lift_joint"]\nangle_unit = "mm"\n'
    np.testing.assert_allclose(read_log(path, robot.joints, output).q, log.q, rtol=1e-6)
    proposal = propose(path, robot)
    assert proposal.tables()["joint"]["torso_lift_joint"]["angle_unit"] == "mm"
    (own,) = check(robot, [log])
    assert not own.fix
    write_log(log, path)
    assert "angle_unit" not in propose(path, robot).toml("log.csv")


def test_the_name_of_one_turning_joint_says_degrees_beside_sliding_joints(tmp_path):
    """Of four joints of a gantry one turns: too few for the numbers to decide, but the name says degrees."""
    robot = Robot.load("tiago", joints=["torso_lift_joint", "arm_1_joint", "arm_2_joint"])
    log, path, output = driven(robot), tmp_path / "log.csv", tmp_path / "map.toml"
    units = {"torso_lift_joint": ("mm", 1e3), "arm_1_joint": ("deg", 180 / np.pi), "arm_2_joint": ("rad", 1.0)}
    table = {"t": log.t}
    for k, (joint, (unit, factor)) in enumerate(units.items()):
        table[f"{joint}.pos [{unit}]"] = log.q[:, k] * factor
    write_table(table, path)
    output.write_text(propose(path, robot).toml("log.csv"), encoding="utf-8")
    np.testing.assert_allclose(read_log(path, robot.joints, output).q, log.q, rtol=1e-6)


def test_angles_of_motors_are_not_certainly_degrees():
    """A gear of 121 makes angles twice as large as degrees do: `map` had called them no degrees, `check` degrees."""
    robot = Robot.load("z1", joints=[f"joint{k}" for k in range(1, 7)])
    log = driven(robot)
    (issue,), _ = degrees(robot, replace(log, q=log.q * 121, tau=log.tau / 121))
    assert issue.sure == "likely"
    assert "gear_ratio" in issue.advice
    (issue,), fix = degrees(robot, replace(log, q=log.q * 121, tau=None, current=log.tau / 121))
    assert ("gear_ratio" in issue.advice, fix) == (True, ()), "a file that undoes it cannot be written without torques"
    (issue,), _ = degrees(robot, in_degrees(log, *robot.joints))
    assert issue.sure == "certain"
    assert "gear_ratio" not in issue.advice


def test_the_fix_of_degrees_leaves_a_joint_in_millimetres_as_it_is(tmp_path):
    robot = Robot.load("tiago", joints=["torso_lift_joint", "arm_1_joint"])
    log, path, output = driven(robot), tmp_path / "log.csv", tmp_path / "fixed.toml"
    write_log(replace(log, q=log.q * np.where(robot.prismatic, 1e3, 180 / np.pi), v=None), path)
    (tmp_path / "map.toml").write_text('[joint.torso_lift_joint]\nangle_unit = "mm"\n', encoding="utf-8")
    arguments = ["--joints", ",".join(robot.joints), str(path), "--map", str(tmp_path / "map.toml"), "-o", str(output)]
    CliRunner().invoke(main, ["check", "tiago", *arguments])
    np.testing.assert_allclose(read_log(path, robot.joints, output).q, log.q, rtol=1e-6)


def test_a_motion_within_the_stroke_is_in_metres():
    """A part of the stroke, and an arm that was sent beyond its limits."""
    for span in (0.001, 0.3, 3.0):
        assert not in_millimetres(span, 0.3)
    assert in_millimetres(50.0, 0.3)
    assert not in_millimetres(50.0, np.inf)


def test_check_writes_the_unit_of_one_joint_or_says_that_it_writes_nothing(tmp_path):
    robot = Robot.load("double_pendulum_continuous")
    log = driven(robot)
    name, path, output = robot.joints[0], tmp_path / "log.csv", tmp_path / "map.toml"
    write_log(log, path)
    arguments = ["check", "double_pendulum_continuous", str(path), "-o", str(output)]
    shown = CliRunner().invoke(main, arguments)
    assert not output.exists()
    assert "map.toml not written" in shown.output.replace("\n", "")
    write_log(in_degrees(log, name), path)
    CliRunner().invoke(main, arguments)
    assert output.read_text(encoding="utf-8") == f'[joint."{name}"]\nangle_unit = "deg"\n'
    np.testing.assert_allclose(read_log(path, robot.joints, output).q, log.q, rtol=1e-6)


def test_a_robot_faster_than_its_urdf_states_is_in_radians_where_the_torques_say_so(tmp_path):
    """The motion alone looks like degrees: over more than a turn, and far above the speed limit of the URDF."""
    robot = Robot.load("double_pendulum_continuous")
    unlimited = re.sub(r"<limit[^>]*>", "", robot.urdf)
    limited = unlimited.replace("</joint>", '<limit velocity="0.2" effort="100"/></joint>')
    path = tmp_path / "slow.urdf"
    path.write_text(limited, encoding="utf-8")
    slow, t = Robot.load(path), np.arange(0, 20, 0.01)
    q, v, a = (3.0 * x for x in random_fourier(robot, 20, seed=1)(t))
    log = replace(driven(robot), t=t, q=q, tau=robot.inverse_dynamics(q, v, a) + 0.1 * v)
    assert (slow.limits.velocity == 0.2).all()
    assert implausible_motion(slow, log, Notebook(slow.joints)) is not None
    assert degrees(slow, log) == ([], ())
    (issue,), fix = degrees(slow, in_degrees(log, *slow.joints))
    assert fix == (FILE,)
    assert "faster than the URDF's limits" in issue.what


@pytest.mark.parametrize("name", ["kinova", "double_pendulum_continuous"])
def test_angles_that_jump_by_360_are_in_degrees_wherever_they_move(name, tmp_path):
    """With another zero than the URDF's they leave its limits. They were "position jumps": rows to be removed."""
    robot = Robot.load(name)
    log, path, output = driven(robot), tmp_path / "log.csv", tmp_path / "map.toml"
    wrapped = replace(log, q=np.rad2deg(log.q - log.q[:1]) % 360)
    (issue,), fix = degrees(robot, wrapped)
    assert (issue.sure, issue.blocks, fix) == ("certain", True, (FILE,))
    assert "by 360" in issue.what
    (report,) = check(robot, [wrapped])
    assert [issue.kind for issue in report.issues if issue.blocks] == ["degrees"]
    write_log(replace(wrapped, v=None, a=None), path)
    proposed = propose(path, robot)
    assert proposed.file["angle_unit"] == "deg"
    assert not proposed.guesses
    output.write_text(proposed.toml("log.csv"), encoding="utf-8")
    apart = (read_log(path, robot.joints, output).q - log.q + log.q[:1]) / (2 * np.pi)
    np.testing.assert_allclose(apart, np.round(apart), atol=1e-6)
