import json
import math

import numpy as np
import pinocchio as pin
import pytest
from cases import LIMIT, MIXED, ROBOTS, TIAGO, Reference, joint, link, made, robot, states, urdf
from hypothesis import given, settings
from hypothesis import strategies as st

from frischid.errors import InputError, UnknownNameError
from frischid.robot.robot import LINK_PARAMETERS, Robot
from frischid.robot.urdf_reading import robot_names


def refused(words, *args, kind=InputError, **options):
    with pytest.raises(kind) as error:
        Robot.load(*args, **options)
    for word in words:
        assert word in str(error.value)


# ---- finding a URDF


def test_by_name_and_by_path(tmp_path):
    shipped = Robot.load("planar2")
    assert shipped.joints == ("joint1", "joint2")
    path = robot_names()["planar2"]
    for given_path in (path, str(path)):
        again = Robot.load(given_path)
        assert again.urdf == shipped.urdf
        assert again.source == str(path)
    copy = tmp_path / "panda"  # a file without a suffix, called like a robot
    copy.write_text(path.read_text())
    assert Robot.load(copy).name == "planar2"
    assert Robot.load("ur10").joints == Robot.load("ur10_robot").joints
    assert len(Robot.load("panda").joints) == 8


def test_own_robots_come_before_those_of_other_packages():
    assert next(iter(robot_names())) == "planar2"


@pytest.mark.parametrize(("name", "close"), [("pandda", "panda"), ("UR10", "ur10"), ("kinvoa", "kinova")])
def test_unknown_robot_lists_close_ones(name, close):
    refused(["unknown robot", name, "did you mean", close], name, kind=UnknownNameError)


def test_ambiguous_names_carry_their_folder():
    names = robot_names()
    assert "anymal" not in names
    assert {"anymal_b_simple/anymal", "anymal_c_simple/anymal"} <= set(names)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", ["not an XML file"]),
        (b"solid cube", ["not an XML file"]),
        (b"<robot name='x'><link name='a'>", ["not an XML file", "line 1"]),
        (b"<sdf/>", ["root element is <sdf>", "<robot>"]),
        (b"\xff\xfe\x00", ["not a UTF-8 text file"]),
        (
            b"<robot name='x' xmlns:xacro='http://www.ros.org/wiki/xacro'><xacro:arm/></robot>",
            ["xacro", "expand it first"],
        ),
        (b"<robot name='x'/>", ["arm.urdf"]),
        (b"<robot name='x'><link name='a'/></robot>", ["no joint is left to move"]),
    ],
)
def test_bad_files(tmp_path, content, words):
    path = tmp_path / "arm.urdf"
    path.write_bytes(content)
    refused([str(path), *words], path)


WRONG_NUMBERS = {
    "a mass of letters": ('<mass value="3.0"/>', '<mass value="a"/>', ["<mass>", "link 'upper'", 'value="a"']),
    "a comma": ('<mass value="3.0"/>', '<mass value="10,5"/>', ["<mass>", 'value="10,5"', "10.5"]),
    "nan": ('<mass value="3.0"/>', '<mass value="nan"/>', ["<mass>", 'value="nan"']),
    "infinite": ('<mass value="3.0"/>', '<mass value="1e999"/>', ["<mass>", 'value="1e999"']),
    "a space": ('<mass value="3.0"/>', '<mass value=" 3.0"/>', ["<mass>", 'value=" 3.0"']),
    "nothing": ('<mass value="3.0"/>', "<mass/>", ["<mass> of link 'upper' has no value"]),
    "a negative mass": ('<mass value="3.0"/>', '<mass value="-3.0"/>', ["<mass>", 'value="-3.0"', "negative"]),
    "too large": ('<mass value="3.0"/>', '<mass value="1e300"/>', ["<mass>", "is above 1e+09"]),
    "too large an inertia": ('iyy="0.06"', 'iyy="-1e10"', ["<inertia>", "is above 1e+09"]),
    "a letter behind": ('iyy="0.06"', 'iyy="0.23x"', ["<inertia> of link 'upper'", 'iyy="0.23x"']),
    "no iyy": ('iyy="0.06"', "", ["<inertia> of link 'upper' has no iyy"]),
    "two numbers": ('xyz="0.1 0.02 -0.03"', 'xyz="0.1 0.02"', ["<origin> of link 'upper'", 'xyz="0.1 0.02"', "3 "]),
    "tabs": ('xyz="0.1 0.02 -0.03"', 'xyz="0.1\t0.02\t-0.03"', ["<origin> of link 'upper'", "tabs, line breaks"]),
    "a line break": ('xyz="0.1 0.02 -0.03"', 'xyz="0.1\n0.02 -0.03"', ["<origin> of link 'upper'", "line breaks"]),
    "an entity": ('<mass value="3.0"/>', '<mass value="&#51;.0"/>', ['value="3.0" of <mass>', "entities"]),
    "digits of another script": ('<mass value="3.0"/>', '<mass value="\u0663"/>', ["<mass>", "not a finite number"]),
    "commas": ('xyz="0.1 0.02 -0.03"', 'xyz="0.1,0.02,-0.03"', ["<origin>", 'xyz="0.1,0.02,-0.03"', "spaces"]),
    "a mimic multiplier": ('multiplier="2"', 'multiplier="two"', ["<mimic> of joint 'follows'", 'multiplier="two"']),
    "a mimic offset": ('offset="0.3"', 'offset="0.3 rad"', ["<mimic> of joint 'follows'", 'offset="0.3 rad"']),
    "an effort": ('effort="50"', 'effort="big"', ["<limit> of joint 'turns'", 'effort="big"']),
    "an axis": ('<axis xyz="0 0 1"/>', '<axis xyz="0 0 z"/>', ["<axis> of joint 'turns'", 'xyz="0 0 z"']),
}


@pytest.mark.parametrize("fault", WRONG_NUMBERS)
def test_a_number_that_cannot_be_read_is_named_with_its_line(tmp_path, fault):
    old, new, words = WRONG_NUMBERS[fault]
    follows = joint("follows", "upper", "lower", inside=f'{LIMIT}<mimic joint="turns" multiplier="2" offset="0.3"/>')
    parts = (link("base"), link("upper", 3.0), link("lower", 1.0), joint("turns", "base", "upper"), follows)
    lines = urdf(*parts).replace("><", ">\n<")
    path = tmp_path / "arm.urdf"
    path.write_text(lines)
    assert Robot.load(path).bodies == ("turns", "follows")
    path.write_text(lines.replace(old, new, 1), encoding="utf-8")
    number = lines[: lines.index(old)].count("\n") + 1
    refused([f"{path}, line {number}: ", *words], path)


def test_a_number_behind_an_entity_is_refused(tmp_path):
    """An XML parser reads the mass. Pinocchio's dropped the inertial, and the link weighed nothing."""
    path = tmp_path / "arm.urdf"
    text = urdf(link("w"), link("a", 3.0), joint("j", "w", "a")).replace('<mass value="3.0"/>', '<mass value="&m;"/>')
    path.write_text('<!DOCTYPE robot [<!ENTITY m "3.0">]>\n' + text[text.index("<robot") :])
    refused([f"{path}, line ", 'value="3.0" of <mass> of link', "entities"], path)


def test_numbers_in_every_form_of_digits_are_read(tmp_path):
    path = tmp_path / "arm.urdf"
    for mass, value in (("+3", 3.0), ("3.", 3.0), (".5", 0.5), ("3E-1", 0.3), ("0", 0.0)):
        text = urdf(link("w"), link("a", 1.0), joint("j", "w", "a"))
        path.write_text(text.replace('<mass value="1.0"/>', f'<mass value="{mass}"/>'))
        loaded = Robot.load(path)
        assert dict(zip(loaded.all_names, loaded.nominal, strict=True))["m1"] == pytest.approx(value)


def test_missing_file_and_folder(tmp_path):
    refused(["no such URDF file"], tmp_path / "none.urdf")
    refused(["is a folder"], tmp_path)


def test_a_folder_hides_no_robot_that_is_known_by_its_name(tmp_path, monkeypatch):
    """A ROS workspace has a folder for each robot."""
    (tmp_path / "planar2").mkdir()
    monkeypatch.chdir(tmp_path)
    assert len(Robot.load("planar2").joints) == 2


def test_every_name_is_that_of_a_file_with_a_robot():
    """example-robot-data has a ur3.urdf without a single link, which took the short name of ur3_robot.urdf."""
    names = robot_names()
    assert names["ur3"] == names["ur3_robot"]
    assert Robot.load("ur3").joints[0] == "shoulder_pan_joint"


@pytest.mark.parametrize("kind", ["floating", "planar"])
def test_joints_of_several_degrees_of_freedom(tmp_path, kind):
    path = tmp_path / "free.urdf"
    parts = (link("w"), link("a", 1.0), link("b", 1.0), joint("loose", "w", "a", kind), joint("j", "a", "b"))
    path.write_text(urdf(*parts))
    refused(["'loose'", "degrees of freedom", "make it fixed"], path)


def test_spherical_and_dangling_joints(tmp_path):
    path = tmp_path / "odd.urdf"
    path.write_text(urdf(link("a"), link("b", 1.0), joint("j", "a", "b", "spherical")))
    refused([str(path)], path)
    path.write_text(urdf(link("a"), link("b", 1.0), joint("j", "a", "nowhere")))
    refused([str(path)], path)


# ---- joints


def test_kinds_of_joints():
    machine = made(MIXED)
    assert machine.joints == ("turn", "slide", "elbow")
    assert machine.bodies == ("turn", "slide", "elbow", "follower", "gripper")
    assert machine.numbers == {"turn": 1, "slide": 2, "elbow": 3, "follower": 4, "gripper": 5}
    assert machine.prismatic.tolist() == [False, True, False]
    assert machine.model.nq == machine.model.nv + 1  # the continuous joint
    assert len(machine.all_names) == 50
    assert machine.all_names[:3] == ("m1", "mx1", "my1")
    assert machine.columns[0].unit == "kg"
    assert {c.name: c.sign for c in machine.columns[:10]} == dict(
        zip([f"{p}1" for p in LINK_PARAMETERS], [1, 0, 0, 0, 1, 0, 1, 0, 0, 1], strict=True)
    )


def test_continuous_joints_take_one_angle():
    machine = made(MIXED)
    q, v, a = states(machine)
    turned = q + np.array([2 * np.pi, 0.0, 0.0])
    np.testing.assert_allclose(machine.inverse_dynamics(turned, v, a), machine.inverse_dynamics(q, v, a), atol=1e-10)
    full = machine.configuration(np.array([[0.3, 0.1, -0.2]]))
    np.testing.assert_allclose(full[0, :2], [math.cos(0.3), math.sin(0.3)])


def test_mimic_chain():
    machine = made(MIXED)
    assert machine.mimics == {"follower": ("elbow", 2.0, 0.3), "gripper": ("elbow", -1.0, pytest.approx(-0.05))}
    elbow = 0.4
    full = machine.configuration(np.array([[0.0, 0.0, elbow]]))[0]
    np.testing.assert_allclose(full[-3:], [elbow, 2 * elbow + 0.3, -0.5 * (2 * elbow + 0.3) + 0.1])


@pytest.mark.parametrize(("first", "second"), [("one", "two"), ("two", "one")])
def test_mimics_in_a_circle(tmp_path, first, second):
    def rule(leader):
        return f'<limit lower="-1" upper="1" velocity="1" effort="1"/><mimic joint="{leader}"/>'

    path = tmp_path / "circle.urdf"
    parts = [link("w"), link("a", 1.0), link("b", 1.0), link("c", 1.0), joint("free", "w", "a")]
    parts += [joint("one", "a", "b", inside=rule(first if first != "one" else "two"))]
    parts += [joint("two", "b", "c", inside=rule(second if second != "two" else "one"))]
    path.write_text(urdf(*parts))
    refused(["circle", "one", "two"], path)


def test_mimic_of_a_joint_that_is_not_there(tmp_path):
    path = tmp_path / "orphan.urdf"
    inside = '<limit lower="-1" upper="1" velocity="1" effort="1"/><mimic joint="ghost"/>'
    parts = [link("w"), link("a", 1.0), link("b", 1.0), joint("j", "w", "a")]
    path.write_text(urdf(*parts, joint("k", "a", "b", inside=inside)))
    refused(["ghost"], path)


# ---- locks


def test_locked_joints_and_their_angles():
    machine = Robot.load("tiago", joints=TIAGO, lock={"arm_6_joint": 0.5})
    assert list(machine.joints) == TIAGO
    assert machine.locked["arm_6_joint"] == 0.5
    assert machine.locked["arm_7_joint"] == 0.0
    assert len(machine.locked) == 43
    # zero moved into the limits
    lower = Robot.load("panda").limits
    i = Robot.load("panda").joints.index("panda_joint4")
    assert lower.upper[i] < 0
    assert Robot.load("panda", lock=["panda_joint4"]).locked == {"panda_joint4": lower.upper[i]}


def test_a_locked_joint_that_is_none_of_the_urdf_is_named():
    """A model file names its locked joints itself; `Robot.load` looks at the names before."""
    for name in ("elbo", "universe"):  # the second is Pinocchio's name for the base
        with pytest.raises(UnknownNameError, match=f"unknown locked joint '{name}'"):
            made(MIXED, locked={name: 0.6})


def test_locked_joint_takes_its_followers_along():
    free, held = made(MIXED), made(MIXED, locked={"elbow": 0.6})
    assert held.joints == held.bodies == ("turn", "slide")
    assert held.mimics == {}
    q, v, a = states(free)
    q[:, 2], v[:, 2], a[:, 2] = 0.6, 0.0, 0.0
    np.testing.assert_allclose(
        held.inverse_dynamics(q[:, :2], v[:, :2], a[:, :2]), free.inverse_dynamics(q, v, a)[:, :2], atol=1e-10
    )


def test_keep_locks_the_rest():
    machine = Robot.load("ur10").keep(["elbow_joint", "wrist_1_joint"])
    assert machine.joints == ("elbow_joint", "wrist_1_joint")
    assert len(machine.locked) == 4
    assert machine.keep(machine.joints) is machine
    with pytest.raises(UnknownNameError, match="joint 'elbow'"):
        machine.keep(["elbow"])


def test_a_parameter_is_not_known_of_another_link_after_a_lock():
    """The mass of the shoulder had become that of the forearm, because links count from the first joint that moves."""
    machine = Robot.load("ur5", known={"m1": 3.7})
    with pytest.raises(InputError, match="m1 would be known of another link"):
        machine.keep(machine.joints[2:])
    assert machine.keep(machine.joints) is machine


def test_names_that_do_not_exist():
    refused(["joint 'elbow'", "elbow_joint"], "ur10", lock={"elbow": 0.1}, kind=UnknownNameError)
    refused(["joint 'elbow'", "elbow_joint"], "ur10", joints=["elbow"], kind=UnknownNameError)
    refused(["parameter 'm9'"], "ur10", known={"m9": 0.0}, kind=UnknownNameError)
    refused(["frame choice 'far-end'", "far_end"], "ur10", frames="far-end", kind=UnknownNameError)
    refused(["joint 'elbow'", "elbow_joint"], "ur10", frames={"elbow": "tool0"}, kind=UnknownNameError)
    words = ["frame on the body of wrist_3_joint 'tool'", "tool0"]
    refused(words, "ur10", frames={"wrist_3_joint": "tool"}, kind=UnknownNameError)
    refused(["no joint is left"], "planar2", lock=["joint1", "joint2"])


# ---- gravity, frames, known parameters


@pytest.mark.parametrize("rpy", [(math.pi, 0, 0), (0, math.pi / 2, 0), (0.4, -0.9, 2.2)])
def test_tilted_base_is_rotated_gravity(rpy):
    upright, tilted = Robot.load("ur10"), Robot.load("ur10", base_rpy=rpy)
    gravity = pin.rpy.rpyToMatrix(*rpy).T @ [0.0, 0.0, -9.81]
    np.testing.assert_allclose(tilted.gravity, gravity)
    # the arm itself hangs from a fixed joint that turns it
    mount = '<joint name="mount" type="fixed"><parent link="ground"/><child link="world"/>'
    mount = f'<link name="ground"/>{mount}<origin rpy="{rpy[0]} {rpy[1]} {rpy[2]}"/></joint>'
    hung = made(upright.urdf.replace("</robot>", f"{mount}</robot>"))
    q, v, a = states(upright)
    np.testing.assert_allclose(tilted.inverse_dynamics(q, v, a), hung.inverse_dynamics(q, v, a), atol=1e-9)
    assert not np.allclose(tilted.inverse_dynamics(q, v, a), upright.inverse_dynamics(q, v, a), atol=1.0)


def test_gravity_must_be_three_numbers():
    assert Robot.load("planar2", gravity=(0, 0, -1.62)).model.gravity.linear.tolist() == [0, 0, -1.62]
    for wrong in ((0, 0), (0, 0, math.nan), (0, 0, -9.81, 1)):
        refused(["gravity", "three finite numbers"], "planar2", gravity=wrong)
    refused(["gravity", "above 1e+09"], "planar2", gravity=(1e300, 0, 0))
    refused(["lock", "above 1e+09"], "planar2", lock={"joint2": 1e300})
    refused(["known", "above 1e+09"], "planar2", known={"m1": math.inf})
    for wrong in ((0, 0), (0, 0, math.nan)):
        refused(["base_rpy", "three finite numbers"], "planar2", base_rpy=wrong)


@pytest.mark.parametrize("name", ROBOTS)
def test_nominal_parameters_are_those_of_the_chosen_frames(name):
    machine = robot(name)
    plain = Robot.from_dict({**machine.to_dict(), "frames": "joint", "known": {}})
    theta, about_joint = machine.nominal.reshape(-1, 10), plain.nominal.reshape(-1, 10)
    np.testing.assert_allclose(theta[:, 0], about_joint[:, 0], atol=1e-12)  # mass has no frame
    for k, body in enumerate(machine.bodies):
        if about_joint[k, 0] > 0:
            placement = machine.frame_placement(body)
            centre = placement.act(theta[k, 1:4] / theta[k, 0])
            np.testing.assert_allclose(centre, about_joint[k, 1:4] / about_joint[k, 0], atol=1e-10)


def test_far_end_frames_lie_at_the_next_joint_and_at_the_tip():
    machine = Robot.load("planar2", frames="far_end")
    theta = dict(zip(machine.all_names, machine.nominal, strict=True))
    assert theta["mx1"] == pytest.approx(21 * (0.2619047619 - 0.5))
    assert theta["mx2"] == pytest.approx(10 * (0.25 - 0.5))
    assert theta["Izz2"] == pytest.approx(0.2333 + 10 * 0.25**2)
    assert theta["Izz1"] == pytest.approx(0.5262 + 21 * (0.2619047619 - 0.5) ** 2)


def test_known_parameters_leave_the_columns_and_keep_their_torque():
    machine = Robot.load("planar2", known={"m2": 9.0, "my1": 0.0})
    plain = Robot.load("planar2")
    assert [c.name for c in machine.columns] == [c.name for c in plain.columns if c.name not in ("m2", "my1")]
    q, v, a = states(machine)
    out = np.empty((len(q), 20, 2))
    plain.regressor(q, v, a, out)
    np.testing.assert_allclose(machine.known_torque(q, v, a), 9.0 * out[:, plain.all_names.index("m2")])
    assert Robot.load("planar2", known={"my1": 0.0}).known_torque(q, v, a) is None


def test_limits_and_dynamics():
    machine = Robot.load("planar2")
    limits = machine.limits
    np.testing.assert_array_equal([limits.lower, limits.upper], [[-3, -3], [3, 3]])
    np.testing.assert_array_equal([limits.velocity, limits.effort], [[5, 5], [600, 250]])
    assert machine.dynamics == {"joint1": (0.1434, 0.3302), "joint2": (0.1391, 0.3576)}
    limits = made(MIXED).limits
    assert limits.lower.tolist() == [-np.inf, -2, -2]
    assert limits.upper.tolist() == [np.inf, 2, 2]
    assert limits.velocity.tolist() == [4, 3, 3]
    bare = made(urdf(link("w"), link("a", 1.0), joint("j", "w", "a", "continuous", inside="")))
    assert bare.limits.velocity.tolist() == bare.limits.effort.tolist() == [np.inf]
    assert bare.dynamics == {"j": (0.0, 0.0)}


@pytest.mark.parametrize(("written", "limit"), [("0", np.inf), ("1e9", np.inf), ("250", 250.0)])
def test_placeholders_are_no_limits(written, limit):
    inside = f'<limit lower="-2" upper="2" velocity="{written}" effort="{written}"/>'
    limits = made(urdf(link("w"), link("a", 1.0), joint("j", "w", "a", inside=inside))).limits
    assert limits.velocity.tolist() == limits.effort.tolist() == [limit]
    assert (limits.lower.tolist(), limits.upper.tolist()) == ([-2.0], [2.0])


# ---- saved and loaded


@pytest.mark.parametrize("name", ROBOTS)
def test_to_dict_and_back(name):
    machine = robot(name)
    again = Robot.from_dict(json.loads(json.dumps(machine.to_dict())))
    assert again.to_dict() == machine.to_dict()
    assert again.columns == machine.columns
    q, v, a = states(machine)
    np.testing.assert_array_equal(again.inverse_dynamics(q, v, a), machine.inverse_dynamics(q, v, a))


angles = st.floats(-2.0, 2.0)


@settings(max_examples=25, deadline=None)
@given(lock=st.dictionaries(st.sampled_from(["turn", "slide"]), angles), gravity=st.tuples(*[st.floats(-20, 20)] * 3))
def test_any_lock_and_gravity_equal_the_whole_tree_held_there(lock, gravity):
    machine = made(MIXED, locked=lock, gravity=gravity)
    assert json.loads(json.dumps(machine.to_dict())) == machine.to_dict()
    q, v, a = states(machine, count=2)
    np.testing.assert_allclose(machine.inverse_dynamics(q, v, a), Reference(machine)(q, v, a), atol=1e-9)


def test_torque_of_a_motion_of_another_shape_is_refused():
    machine = robot("planar2")
    assert machine.inverse_dynamics([0, 0], [0, 0], [0, 0]).shape == (1, 2)
    for v in (np.zeros((2, 2)), np.zeros((3, 4)), [[0.0], [0.0, 0.0], [0.0]], None):
        with pytest.raises(InputError, match=r"^v (has the shape|must be an array of numbers)"):
            machine.inverse_dynamics(np.zeros((3, 2)), v, np.zeros((3, 2)))
