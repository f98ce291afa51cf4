"""Position columns that no name gives to a joint: none is left out as if it stood still, without a word."""

import numpy as np
import pytest

import frischid as fr
from frischid.logs.mapping_guess import propose

JOINT = """<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{name}_link"/>
<origin xyz="0 0 0.2"/><axis xyz="{axis}"/><limit lower="-2" upper="2" effort="50" velocity="3"/></joint>
<link name="{name}_link"><inertial><origin xyz="0.1 0 0.05"/><mass value="2"/>
<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>"""


def robot_of(folder, joints) -> fr.Robot:
    parts, parent = ['<robot name="r"><link name="base"/>'], "base"
    for k, (name, kind) in enumerate(joints):
        parts.append(JOINT.format(name=name, kind=kind, parent=parent, axis="0 0 1" if k % 2 == 0 else "0 1 0"))
        parent = f"{name}_link"
    path = folder / "robot.urdf"
    path.write_text("".join(parts) + "</robot>")
    return fr.Robot.load(path)


def proposed(folder, joints, columns):
    """Proposal for a file with a time column and these columns: name -> factor of its values."""
    t = np.arange(0, 10, 0.01)
    values = [factor * np.sin((k + 1) * 0.7 * t + k) for k, factor in enumerate(columns.values())]
    path = folder / "log.csv"
    np.savetxt(path, np.column_stack([t, *values]), delimiter=",", header=",".join(["t", *columns]), comments="")
    return propose(path, robot_of(folder, joints))


GIMBAL = [("yaw", "revolute"), ("roll", "revolute"), ("pitch", "revolute")]
RAIL = [("rail", "prismatic"), *((f"a{k}", "revolute") for k in (1, 2, 3))]


@pytest.mark.parametrize(
    ("joints", "columns", "expected"),
    [
        (GIMBAL, [f"{q}_{n}" for q in ("enc", "iq") for n in ("pan", "roll", "tilt")],
         {"yaw": ("enc_pan", "iq_pan"), "pitch": ("enc_tilt", "iq_tilt")}),
        (RAIL, [*(f"Axis_{n}_pos" for n in ("A1", "A2", "A3", "E1")),
                *(f"Axis_{n}_current" for n in ("A1", "A2", "A3", "E1"))],
         {"rail": ("Axis_E1_pos", "Axis_E1_current")}),
    ],
)  # fmt: skip
def test_the_only_columns_left_are_those_of_the_only_joints_left(tmp_path, joints, columns, expected):
    """Yaw and pitch of a gimbal, and the axis below an arm, were taken as standing still, with exit code 0."""
    found = proposed(tmp_path, joints, dict.fromkeys(columns, 1.0))
    assert not found.missing
    for joint, (q, current) in expected.items():
        assert (found.joints[joint]["q"], found.joints[joint]["current"]) == (q, current)
    assert any("the only position columns left" in guess for guess in found.guesses)


def test_columns_and_joints_that_do_not_pair_are_a_guess(tmp_path):
    found = proposed(tmp_path, GIMBAL, dict.fromkeys(["enc_roll", "enc_tilt"], 1.0))
    assert found.missing == ("yaw", "pitch")
    assert any(guess.startswith("yaw, pitch without a position column, beside") for guess in found.guesses)


def test_a_length_is_no_angle(tmp_path):
    joints = [*RAIL[1:], ("wrist", "revolute")]
    found = proposed(
        tmp_path, joints, {**dict.fromkeys([f"Axis_A{k}_pos" for k in (1, 2, 3)], 1.0), "E1_pos [mm]": 9.0}
    )
    assert found.missing == ("wrist",)


def test_a_second_set_of_positions_is_not_left_over(tmp_path):
    """Motors beside joints, and fingers without a column: nothing is left for the fingers."""
    joints = [*((f"joint{k}", "revolute") for k in (1, 2, 3, 4)), ("finger", "prismatic")]
    names = [f"{kind}_{k}" for kind in ("joint_position", "motor_position") for k in (1, 2, 3, 4)]
    found = proposed(tmp_path, joints, dict.fromkeys(names, 1.0))
    assert found.missing == ("finger",)
    assert not any("without a position column" in guess for guess in found.guesses)


@pytest.mark.parametrize(
    ("joints", "columns"),
    [
        ([("joint1", "revolute"), ("joint2", "revolute"), ("finger1", "prismatic"), ("finger2", "prismatic")],
         [f"{kind}_position_{k}" for kind in ("joint", "motor") for k in (1, 2)]),
        ([*((f"joint{k}", "revolute") for k in (1, 2, 3)), *((f"wheel_{x}", "continuous") for x in ("left", "right"))],
         ["joint_pos_1", "joint_pos_2", "joint_pos_3", "base_pos_x", "base_pos_y"]),
    ],
)  # fmt: skip
def test_encoders_of_motors_and_the_place_of_a_base_are_no_other_joints(tmp_path, joints, columns):
    found = proposed(tmp_path, joints, dict.fromkeys(columns, 1.0))
    assert found.missing == tuple(name for name, _ in joints if not name.startswith("joint"))


def test_a_torque_of_another_kind_is_not_mixed_with_those_of_the_other_joints(tmp_path):
    """Yaw and pitch had the external torque, roll the torque of its motor, and nobody said so."""
    names = [f"{kind}_{n}" for kind in ("enc", "torque", "ext_torque") for n in ("pan", "roll", "tilt")]
    found = proposed(tmp_path, GIMBAL, dict.fromkeys(names, 1.0))
    assert [found.joints[j]["tau"] for j in ("yaw", "roll", "pitch")] == ["torque_pan", "torque_roll", "torque_tilt"]


def test_kilonewton_metres_are_told_by_the_end_of_a_name(tmp_path):
    names = [word.format(joint) for word in ("angle_{}", "torque_{}_kNm") for joint, _ in GIMBAL]
    found = proposed(tmp_path, GIMBAL, dict.fromkeys(names, 1.0))
    assert {found.units[j]["torque_factor"] for j, _ in GIMBAL} == {1000.0}
