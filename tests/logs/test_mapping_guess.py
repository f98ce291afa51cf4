"""`frischid map`: other people's columns become ours, from names and numbers."""

import numpy as np
import pytest
from bag_files import ros2
from click.testing import CliRunner

from frischid.cli import main
from frischid.errors import InputError
from frischid.logs.column_names import assign, exactly, split, split_all
from frischid.logs.mapping_guess import propose
from frischid.logs.readers import read_chunks, read_log
from frischid.logs.table_writing import write_table
from frischid.motions.simulation import simulate
from frischid.motions.trajectory import random_fourier
from frischid.robot.robot import Robot

UR = Robot.load("ur10")
LOG = simulate(UR, random_fourier(UR, 10, seed=1), rate=100)


def written(path, position, velocity, torque, *, time="t", scale=1.0, angle=1.0, more=None):
    """A file of the same log under other people's names."""
    table = {time: LOG.t * scale}
    for template, values, unit in ((position, LOG.q, angle), (velocity, LOG.v, angle), (torque, LOG.tau, 1.0)):
        for j, joint in enumerate(UR.joints):
            short = joint.removesuffix("_joint")
            table[template.format(j=j, k=j + 1, joint=joint, short=short)] = unit * values[:, j]
    write_table(table | (more or {}), path)
    return path


CASES = {
    "rtde": ("actual_q_{j}", "actual_qd_{j}", "actual_current_{j}", {"time": "timestamp"}),
    "one by one": ("q{k}", "dq{k}", "tau{k}", {"time": "time"}),
    "spoken": ("- {joint}_position", "- {joint}_velocity", "- {joint}_effort", {}),
    "short": ("{short}.pos", "{short}.vel", "{short}.torque", {"time": "stamp", "scale": 1e3}),
    "camel": ("jointPosition{k}", "jointVelocity{k}", "jointTorque{k}", {"time": "timeStamp", "scale": 1e9}),
    "degrees": ("angle_{short}", "speed_{short}", "moment_{short}", {"angle": 180 / np.pi}),
}


@pytest.mark.parametrize("case", CASES)
def test_a_proposed_mapping_reads_the_log(tmp_path, case):
    position, velocity, torque, options = CASES[case]
    more = {"target_q_0": LOG.t, "temperature_1": LOG.t}
    path = written(tmp_path / "log.csv", position, velocity, torque, more=more, **options)
    output = tmp_path / "map.toml"
    result = CliRunner().invoke(main, ["map", str(path), "ur10", "-o", str(output)])
    assert result.exit_code == 0, result.output
    assert "6 joints found" in result.output
    read = read_log(path, UR.joints, output)
    assert read.joints == UR.joints
    np.testing.assert_allclose(read.t, LOG.t, atol=1e-9)
    np.testing.assert_allclose(read.q, LOG.q, atol=1e-9)
    np.testing.assert_allclose(read.v, LOG.v, atol=1e-9)
    effort = read.current if "current" in torque else read.tau
    np.testing.assert_allclose(effort, LOG.tau, atol=1e-9)


def test_a_bag_of_other_joint_names(tmp_path):
    from dataclasses import replace

    renamed = replace(LOG, joints=tuple(f"left_{j.removesuffix('_joint')}" for j in LOG.joints))
    path = ros2(renamed, tmp_path / "bag")
    output = tmp_path / "map.toml"
    output.write_text(propose(path, UR).toml("bag"))
    np.testing.assert_array_equal(read_log(path, UR.joints, output).tau, LOG.tau)


GAINS = (12.0, 12.0, 9.8, 10.7, 10.6, 10.6)


def set_points(noise=0.0):
    """The set points of a UR's RTDE: the model's torque, and a current that overcomes friction too."""
    friction = 0.2 * LOG.tau.std(axis=0) * (LOG.v + np.sign(LOG.v))
    current = (LOG.tau + friction) / GAINS
    current += noise * current.std(axis=0) * np.random.default_rng(0).normal(size=current.shape)
    named = {f"target_moment_{j}": LOG.tau[:, j] for j in range(6)}
    return named | {f"target_current_{j}": current[:, j] for j in range(6)}


@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_gains_follow_from_the_controllers_set_points(tmp_path, noise):
    names = ("actual_q_{j}", "actual_qd_{j}", "actual_current_{j}")
    path = written(tmp_path / "log.csv", *names, time="timestamp", more=set_points(noise))
    found = propose(path, UR)
    np.testing.assert_allclose([found.gains[j] for j in UR.joints], GAINS, rtol=1e-3 if noise == 0 else 0.1)
    assert any("frischid gains checks them" in guess for guess in found.guesses)
    assert not any("columns not used" in reason for reason in found.reasons), "the set points are used"
    (tmp_path / "map.toml").write_text(found.toml("log.csv"), encoding="utf-8")
    read = read_log(path, UR.joints, tmp_path / "map.toml")  # the proposal is used as it is
    np.testing.assert_allclose(read.tau, LOG.tau * [found.gains[j] for j in UR.joints], rtol=1e-6)


@pytest.mark.parametrize("fault", ["one joint lacks a set point", "another channel under the name"])
def test_no_gains_are_guessed_where_set_points_do_not_belong_together(tmp_path, fault):
    more = set_points()
    if fault == "one joint lacks a set point":
        del more["target_moment_3"]
    else:
        more["target_current_0"] = np.random.default_rng(1).normal(size=len(LOG))
    names = ("actual_q_{j}", "actual_qd_{j}", "actual_current_{j}")
    found = propose(written(tmp_path / "log.csv", *names, time="timestamp", more=more), UR)
    assert not found.gains
    assert "# [current_gain]" in found.toml("log.csv")


def test_what_does_not_fit_is_said(tmp_path):
    table = {"t": LOG.t} | {f"q_{j}": LOG.q[:, j] for j in range(4)} | {f"v_{j}": LOG.v[:, j] for j in range(4)}
    write_table(table | {"v_1": -LOG.v[:, 1], "v_2": LOG.v[::-1, 3]}, tmp_path / "log.csv")
    found = propose(tmp_path / "log.csv", UR)
    assert found.missing == UR.joints[4:]
    assert any("v_1 is -1 times the slope of q_1" in r for r in found.reasons)
    assert any("v_2 is not the slope of q_2" in r for r in found.reasons)
    assert "v" in found.joints[UR.joints[0]]
    assert "v" not in found.joints[UR.joints[1]]


def test_a_file_with_a_row_for_each_joint_is_named(tmp_path):
    """As `rostopic echo` and data loggers write them: no mapping can help."""
    lines = [
        f"{t:.3f},{joint},{x:.5f},0.1"
        for t, q in zip(LOG.t[:5], LOG.q[:5], strict=True)
        for joint, x in zip(UR.joints, q, strict=True)
    ]
    (tmp_path / "long.csv").write_text("\n".join(["stamp,joint,position,effort", *lines]), encoding="utf-8")
    remedy = "The file has a row for each joint; write a row for each time, with columns q_JOINT and tau_JOINT"
    with pytest.raises(InputError, match=rf"{remedy}$"):
        propose(tmp_path / "long.csv", UR)


def test_nothing_to_go_by(tmp_path):
    write_table({"t": LOG.t, "x": LOG.q[:, 0]}, tmp_path / "log.csv")
    with pytest.raises(InputError, match="no column looks like a position"):
        propose(tmp_path / "log.csv", UR)
    write_table({"noise": LOG.q[:, 0]}, tmp_path / "log.csv")
    with pytest.raises(InputError, match="no column looks like a position"):
        propose(tmp_path / "log.csv", UR)
    result = CliRunner().invoke(main, ["map", str(tmp_path / "log.csv"), "ur10", "-o", str(tmp_path / "map.toml")])
    assert result.exit_code == 2
    assert not (tmp_path / "map.toml").exists()


def test_numbers_in_longer_names_are_an_order_that_torques_confirm(tmp_path):
    table = {"time": LOG.t}
    for j in (1, 2, 3, 0, 4, 5):  # as a driver sorts its joints
        table |= {f"position_lbr_joint_{j}": LOG.q[:, j], f"effort_lbr_joint_{j}": -LOG.tau[:, j]}
        table[f"tau_ext_{j}"] = np.sin(LOG.t + j)
    write_table(table, tmp_path / "log.parquet")
    found = propose(tmp_path / "log.parquet", UR)
    assert found.guesses == []
    assert found.joints[UR.joints[0]] == {"q": "position_lbr_joint_0", "tau": "effort_lbr_joint_0"}
    assert any("torques confirm this order" in reason for reason in found.reasons)
    # the same columns counted from the tool: no order is claimed
    turned = {f"position_{j}": LOG.q[:, 5 - j] for j in range(6)} | {f"effort_{j}": LOG.tau[:, 5 - j] for j in range(6)}
    write_table({"time": LOG.t} | turned, tmp_path / "turned.parquet")
    arguments = ["map", str(tmp_path / "turned.parquet"), "ur10"]
    result = CliRunner().invoke(main, arguments)
    assert result.exit_code == 1
    assert "no torque confirms this order" in " ".join(result.output.split())


def test_a_file_without_time_has_a_rate(tmp_path):
    table = {f"q_{j}": LOG.q[:, j] for j in range(6)} | {f"dq_{j}": LOG.v[:, j] for j in range(6)}
    write_table(table | {f"tau_{j}": LOG.tau[:, j] for j in range(6)}, tmp_path / "log.npz")
    found = propose(tmp_path / "log.npz", UR)
    assert found.file == {"rate": 100.0}
    assert any("velocities tell 100 samples per second" in guess for guess in found.guesses)
    (tmp_path / "map.toml").write_text(found.toml("log"))
    np.testing.assert_allclose(read_log(tmp_path / "log.npz", UR.joints, tmp_path / "map.toml").t, LOG.t, atol=1e-9)
    chunks = list(read_chunks(tmp_path / "log.npz", UR.joints, tmp_path / "map.toml", samples=300))
    np.testing.assert_allclose(np.concatenate([c.t for c in chunks]), LOG.t, atol=1e-9)
    assert propose(tmp_path / "log.npz", UR, rate=250).file == {"rate": 250}


@pytest.mark.parametrize("side_by_side", [False, True])
@pytest.mark.parametrize("velocity", [False, True])
def test_a_file_without_names(tmp_path, side_by_side, velocity):
    channels = [LOG.q, *([LOG.v] if velocity else []), LOG.tau]
    blocks = np.stack(channels, axis=2 if side_by_side else 1).reshape(len(LOG.t), -1)
    np.savetxt(tmp_path / "log.csv", np.column_stack([LOG.t, blocks]), delimiter=",")
    found = propose(tmp_path / "log.csv", UR)
    assert any("the names say nothing" in guess for guess in found.guesses)
    (tmp_path / "map.toml").write_text(found.toml("log"))
    read = read_log(tmp_path / "log.csv", UR.joints, tmp_path / "map.toml")
    np.testing.assert_allclose(read.q, LOG.q)
    np.testing.assert_allclose(read.tau, LOG.tau)


def test_a_torque_without_a_position_is_said(tmp_path):
    table = {"t": LOG.t} | {f"q_{n}": LOG.q[:, j] for j, n in enumerate(UR.joints) if j != 1}
    write_table(table | {f"tau_{n}": LOG.tau[:, j] for j, n in enumerate(UR.joints)}, tmp_path / "log.csv")
    found = propose(tmp_path / "log.csv", UR)
    assert any(f"tau_{UR.joints[1]}" in guess for guess in found.guesses)


def test_mujoco_arrays_without_names_of_joints(tmp_path):
    np.savez(tmp_path / "log.npz", time=LOG.t, qpos=LOG.q, qvel=LOG.v, qfrc_actuator=LOG.tau)
    read = read_log(tmp_path / "log.npz", UR.joints)
    np.testing.assert_array_equal(read.tau, LOG.tau)
    assert any("in the robot's order" in note for note in read.notes)
    np.savez(tmp_path / "part.npz", time=LOG.t, qpos=LOG.q[:, :4], qvel=LOG.v[:, :4], qfrc_actuator=LOG.tau[:, :4])
    found = propose(tmp_path / "part.npz", UR)
    assert found.file["joints"] == list(UR.joints[:4])
    assert found.guesses


def test_the_topic_with_most_joints(tmp_path):
    from dataclasses import replace

    log = LOG.slice(0, 100)
    hand = replace(log.select(UR.joints[:2]), joints=("finger_left", "finger_right"))
    path = ros2(log, tmp_path / "bag", others={"/gripper/joint_states": hand})
    np.testing.assert_array_equal(read_log(path, UR.joints).tau, log.tau)
    named = replace(log, joints=tuple(f"left_{j.removesuffix('_joint')}" for j in LOG.joints))
    path = ros2(named, tmp_path / "other", others={"/gripper/joint_states": hand})
    assert propose(path, UR).file["topic"] == "/joint_states"


def test_layouts(tmp_path):
    written(tmp_path / "one.csv", "pos_{j}", "vel_{j}", "torque_{j}", time="time")
    written(tmp_path / "two.csv", "angle_{short}", "speed_{short}", "moment_{short}")
    for name in ("one", "two"):
        (tmp_path / f"{name}.toml").write_text(propose(tmp_path / f"{name}.csv", UR).toml(name))
    both = [tmp_path / "one.toml", tmp_path / "two.toml"]
    for name in ("one", "two"):
        log = read_log(tmp_path / f"{name}.csv", UR.joints, both)
        np.testing.assert_allclose(log.tau, LOG.tau)
        assert log.file.mapping.path == str(tmp_path / f"{name}.toml")
    shared = {"joint": {UR.joints[0]: {"torque_sign": -1}}}
    layouts = {
        "one": {"file": {"time": "time"}, "default": {"q": "no_{joint}"},
                "joint": {n: {"q": f"pos_{j}", "tau": f"torque_{j}"} for j, n in enumerate(UR.joints)}},
        "two": {"joint": {n: {"q": f"angle_{n.removesuffix('_joint')}", "tau": f"moment_{n.removesuffix('_joint')}"}
                          for n in UR.joints}},
    }  # fmt: skip
    for name in ("one", "two"):
        log = read_log(tmp_path / f"{name}.csv", UR.joints, shared | {"layout": layouts})
        np.testing.assert_allclose(log.tau[:, 0], -LOG.tau[:, 0])
    write_table({"t": LOG.t, "x": LOG.q[:, 0]}, tmp_path / "three.csv")
    with pytest.raises(InputError, match="no layout of the mapping fits this log"):
        read_log(tmp_path / "three.csv", UR.joints, both)
    twice = {"layout": {"a": {"default": {"q": "angle_{joint}"}}, "b": {"default": {"q": "angle_{joint}"}}}}
    assert read_log(tmp_path / "two.csv", None, twice).joints  # they say the same
    twice["layout"]["b"]["file"] = {"angle_unit": "deg"}
    with pytest.raises(InputError, match="equally well"):
        read_log(tmp_path / "two.csv", None, twice)
    copy = (tmp_path / "two.csv").rename(tmp_path / "run[2].csv")
    twice["layout"]["a"]["file"] = {"logs": ["run[2].csv"]}  # its own name, though brackets are a set of characters
    twice["layout"]["b"]["file"] |= {"logs": ["other*"]}
    assert read_log(copy, None, twice).joints


def test_names():
    assert split("actual_q_3") == ("q", "3")
    assert split("- arm_1_joint_effort") == ("tau", "arm_1_joint")
    assert split("target_q_3") == ("qcmd", "3")
    assert split("target_torque_3")[0] is None
    assert split("qd_target_1") == ("vcmd", "1")
    assert split("pos.shoulder_pan") == ("q", "shoulder_pan")
    joints = [f"panda_joint{k}" for k in range(1, 8)]
    assert assign({f"c{k}": f"joint_{k}" for k in range(1, 8)}, joints).columns == {
        j: f"c{k + 1}" for k, j in enumerate(joints)
    }
    assert assign({"x": "elbow", "y": "shoulder"}, ["shoulder_joint", "elbow_joint"]).columns == {
        "elbow_joint": "x",
        "shoulder_joint": "y",
    }


@pytest.mark.parametrize("unit", [1.0, 180 / np.pi])
def test_angles_a_little_outside_the_limits_are_no_degrees(tmp_path, unit):
    """A zero that is off, as of three fingers that move by ±0.7 rad around zero, with limits from -0.2 rad on."""
    hand = Robot.load("allegro_left_hand").keep(["joint_1.0", "joint_2.0", "joint_3.0"])
    log = simulate(hand, random_fourier(hand, 10, seed=1), rate=100)
    q = log.q - log.q.mean(axis=0)
    q = q / np.abs(q).max(axis=0) * 0.7
    assert (q < hand.limits.lower - 0.1 * (hand.limits.upper - hand.limits.lower)).any(axis=0).all()
    table = {"t": log.t} | {f"q_{name}": unit * x for name, x in zip(hand.joints, q.T, strict=True)}
    write_table(table, tmp_path / "log.csv")
    found = propose(tmp_path / "log.csv", hand)
    assert not found.file
    assert ['angle_unit = "deg"' in guess for guess in found.guesses] == ([] if unit == 1.0 else [True])


def test_the_hint_without_a_mapping_agrees_with_the_proposal(tmp_path):
    """Numbers from 0 on beside joints that count from 1."""
    arm = Robot.load("xarm7", joints=[f"joint{k}" for k in range(1, 8)])
    log = simulate(arm, random_fourier(arm, 10, seed=1), rate=100)
    table = {f"q_{k}": x for k, x in enumerate(log.q.T)} | {f"tau_{k}": x for k, x in enumerate(log.tau.T)}
    write_table({"t": log.t, **table}, tmp_path / "log.csv")
    found = propose(tmp_path / "log.csv", arm)
    pairs = ", ".join(f"{found.joints[joint]['q'].removeprefix('q_')} for {joint}" for joint in arm.joints)
    with pytest.raises(InputError, match=f"perhaps {pairs}") as error:
        read_log(tmp_path / "log.csv", arm.joints)
    assert "0 for joint1, 1 for joint2" in str(error.value)


@pytest.mark.parametrize(("name", "scale", "every"), [("time_ms", 1e3, 10), ("time [s]", 1.0, 25), ("t_us", 1e6, 1)])
def test_the_unit_of_time_in_a_name_decides_at_a_slow_rate(tmp_path, name, scale, every):
    """10 Hz in ms, and 4 Hz in s, which as ms would be the usual 4 kHz."""
    table = {name: np.round(LOG.t * scale, 3)} | {f"q_{joint}": q for joint, q in zip(UR.joints, LOG.q.T, strict=True)}
    path, output = tmp_path / "log.csv", tmp_path / "map.toml"
    write_table({column: values[::every] for column, values in table.items()}, path)
    output.write_text(propose(path, UR).toml("log.csv"), encoding="utf-8")
    np.testing.assert_allclose(read_log(path, UR.joints, output).t, LOG.t[::every], atol=1e-9)


@pytest.mark.parametrize("gripper", ["jointGripper", "joint_gripper", "GRIPPER"])
def test_a_joint_with_a_capital_inside_is_found_beside_numbered_ones(gripper):
    """Unitree's Z1: ``joint1`` to ``joint6`` and ``jointGripper``."""
    joints = [f"joint{k}" for k in range(1, 7)] + ["jointGripper"]
    names = {f"q_{joint}": split(f"q_{joint}")[1] for joint in [*joints[:-1], gripper]}
    assert exactly(names, joints).columns == dict(zip(joints, names, strict=True))


def test_a_name_with_a_number_is_exact_beside_one_without():
    """SCARA: two joints with numbers and a slide."""
    names = {f"q_{joint}": split(f"q_{joint}")[1] for joint in ("j1", "j2", "z")}
    found = assign(names, ["j1", "j2", "z"])
    assert found.how == "name"
    assert found.columns == {"j1": "q_j1", "j2": "q_j2", "z": "q_z"}


@pytest.mark.parametrize(
    ("position", "effort"),
    [("Act_Pos_{}", "Motor_Current_{}_A"), ("pos_{}_m", "current_{}_A"), ("{}_pos", "{}_current_A")],
)
def test_a_letter_that_all_columns_share_is_a_unit_and_no_axis(position, effort):
    axes = ("X", "Y", "Z")
    names = [template.format(axis) for template in (position, effort) for axis in axes]
    named = split_all(names)
    for channel, template in (("q", position), ("current", effort)):
        columns = {n: rest for n, (kind, rest) in named.items() if kind == channel}
        assert assign(columns, ("x", "y", "z")).columns == {a.lower(): template.format(a) for a in axes}
        assert assign(columns, ("x", "y", "z")).how == "name"
    assert split_all(["current_A", "current_B"]) == {n: split(n) for n in ("current_A", "current_B")}


SCARA = """<robot name="scara"><link name="base"/>{links}</robot>"""
LINK = """<link name="l{k}"><inertial><origin xyz="0.1 0 0"/><mass value="{mass}"/>
<inertia ixx="0.02" ixy="0" ixz="0" iyy="0.05" iyz="0" izz="0.05"/></inertial></link>
<joint name="J{k}" type="{kind}"><parent link="{parent}"/><child link="l{k}"/><origin xyz="{x} 0 0"/><axis xyz="0 0 1"/>
<limit lower="{low}" upper="{high}" effort="200" velocity="3"/></joint>"""
NAMES_WITH_UNITS = {
    "underlines": (
        ["J1_pos_rad", "J2_pos_m", "J3_pos_rad"],
        ["J1_vel_rad_s", "J2_vel_m_s", "J3_vel_rad_s"],
        ["J1_torque_Nm", "J2_force_N", "J3_torque_Nm"],
    ),
    "brackets alone": (
        ["J1 [rad]", "J2 [m]", "J3 [rad]"],
        ["dJ1 [rad/s]", "dJ2 [m/s]", "dJ3 [rad/s]"],
        ["M1 [Nm]", "F2 [N]", "M3 [Nm]"],
    ),
    "axes A": (
        ["A1 [rad]", "A2 [m]", "A3 [rad]"],
        ["A1 [rad/s]", "A2 [m/s]", "A3 [rad/s]"],
        ["A1 [Nm]", "A2 [N]", "A3 [Nm]"],
    ),
    "a force beside torques": (["q1", "q2", "q3"], ["qd1", "qd2", "qd3"], ["tau1 (Nm)", "f2 (N)", "tau3 (Nm)"]),
    "dots": (["q_1", "q_2", "q_3"], ["q_dot_1", "q_dot_2", "q_dot_3"], ["tau_1", "tau_2", "tau_3"]),
    "short words": (
        ["Axis1.ActPos", "Axis2.ActPos", "Axis3.ActPos"],
        ["Axis1.ActVelo", "Axis2.ActVelo", "Axis3.ActVelo"],
        ["Axis1.ActTorque", "Axis2.ActTorque", "Axis3.ActTorque"],
    ),
}


def scara(folder):
    """A robot whose second joint slides."""
    kinds = [("revolute", -2.5, 2.5, 5, 0.0), ("prismatic", -0.3, 0.3, 2, 0.3), ("revolute", -3, 3, 1, 0.2)]
    links = "".join(
        LINK.format(k=k + 1, kind=kind, low=low, high=high, mass=mass, x=x, parent=f"l{k}" if k else "base")
        for k, (kind, low, high, mass, x) in enumerate(kinds)
    )
    path = folder / "scara.urdf"
    path.write_text(SCARA.format(links=links))
    return Robot.load(path)


@pytest.mark.parametrize("case", NAMES_WITH_UNITS)
def test_the_units_of_a_sliding_joint_hide_no_column(tmp_path, case):
    robot = scara(tmp_path)
    log = simulate(robot, random_fourier(robot, 10, seed=1), rate=100)
    table = {"time": log.t}
    for names, values in zip(NAMES_WITH_UNITS[case], (log.q, log.v, log.tau), strict=True):
        table |= dict(zip(names, values.T, strict=True))
    write_table(table, tmp_path / "log.csv")
    found = propose(tmp_path / "log.csv", robot)
    for k, joint in enumerate(robot.joints):
        expected = dict(zip(("q", "v", "tau"), (names[k] for names in NAMES_WITH_UNITS[case]), strict=True))
        assert found.joints[joint] == expected
    assert not found.guesses


def test_a_unit_says_a_quantity_only_where_no_word_does():
    foreign = ["X [mm]", "E1 [deg]", "E2_soll [deg]", "T1 [°C]"]
    named = split_all(["actual_q_1", "actual_q_2", "A1 [A]", "A2 [A]", *foreign])
    assert {n: c for n, (c, _) in named.items()} == {
        **{"actual_q_1": "q", "actual_q_2": "q", "A1 [A]": "current", "A2 [A]": "current"},
        **dict.fromkeys(foreign),
    }


@pytest.mark.parametrize("unit", [1.0, 180 / np.pi], ids=["rad", "deg"])
def test_of_two_torques_the_measured_one_is_taken_in_any_unit_of_the_angles(tmp_path, unit):
    """With angles in degrees, the part that the controller's model leaves over had been explained best."""
    panda = Robot.load("panda")
    arm, rng = panda.keep(panda.joints[:7]), np.random.default_rng(0)
    t = np.arange(0, 20, 0.01)
    q, v, a = (np.array(x) for x in random_fourier(arm, 20, seed=1)(t))
    noise = rng.standard_normal((2, *q.shape))
    torque, left = arm.inverse_dynamics(q, v, a) + 0.02 * noise[0], 0.5 * v + 0.3 * v.std(axis=0) * noise[1]
    kinds = {"q": unit * q, "tau_ext": left, "tau_measured": torque}
    columns = {f"{kind}_{j + 1}": x[:, j] for kind, x in kinds.items() for j in range(7)}
    write_table({"t": t} | columns, tmp_path / "log.csv")
    assert propose(tmp_path / "log.csv", arm).joints[arm.joints[0]]["tau"] == "tau_measured_1"


@pytest.mark.parametrize("angles", ["rad", "deg"])
@pytest.mark.parametrize(("unit", "factor"), [("rpm", 30 / np.pi), ("deg/s", 180 / np.pi), ("rad/s", 1.0)])
def test_velocities_in_another_unit_than_the_positions_are_read(tmp_path, angles, unit, factor):
    """Drives report revolutions per minute; such velocities had been left out."""
    scale = 1.0 if angles == "rad" else 180 / np.pi
    table = {f"q_{joint} [{angles}]": scale * x for joint, x in zip(UR.joints, LOG.q.T, strict=True)}
    table |= {f"v_{joint} [{unit}]": factor * x for joint, x in zip(UR.joints, LOG.v.T, strict=True)}
    path, output = tmp_path / "log.csv", tmp_path / "map.toml"
    write_table({"t": LOG.t, **table}, path)
    output.write_text(propose(path, UR).toml("log.csv"), encoding="utf-8")
    read = read_log(path, UR.joints, output)
    np.testing.assert_allclose(read.q, LOG.q, atol=1e-9)
    np.testing.assert_allclose(read.v, LOG.v, rtol=1e-5, atol=1e-9)


def test_velocities_of_no_known_unit_are_left_out(tmp_path):
    table = {f"q_{joint}": x for joint, x in zip(UR.joints, LOG.q.T, strict=True)}
    table |= {f"v_{joint}": 3.0 * x for joint, x in zip(UR.joints, LOG.v.T, strict=True)}
    write_table({"t": LOG.t, **table}, tmp_path / "log.csv")
    found = propose(tmp_path / "log.csv", UR)
    assert not any("v" in columns for columns in found.joints.values())
    assert sum("3 times the slope of q_" in reason and "left out" in reason for reason in found.reasons) == 6
