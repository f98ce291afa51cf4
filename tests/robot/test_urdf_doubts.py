"""Numbers of a URDF that no real robot has are said, with their line."""

import numpy as np
from cases import joint, link, urdf

from frischid.effects import parse_effects
from frischid.regression.regressor import nominal_parameters
from frischid.robot.robot import Robot
from frischid.robot.urdf_doubts import urdf_doubts


def chain(*links, dynamics=""):
    inside = '<limit lower="-2" upper="2" velocity="3" effort="50"/>' + dynamics
    names = ["base", *(f"l{k}" for k in range(len(links)))]
    joints = [joint(f"j{k}", names[k], names[k + 1], inside=inside) for k in range(len(links))]
    return urdf(link("base"), *links, *joints).replace("><", ">\n<")


SOUND = [link(f"l{k}", 1.0 + k, inertia=(0.05 + k / 100, 0.06, 0.07)) for k in range(3)]


def test_a_sound_robot_raises_no_doubt():
    assert urdf_doubts(chain(*SOUND)) == []
    assert urdf_doubts(Robot.load("ur10").urdf) == []


def test_one_damping_for_all_joints():
    text = chain(*SOUND, dynamics='<dynamics damping="10"/>')
    (doubt,) = urdf_doubts(text)
    line = next(k for k, x in enumerate(text.splitlines(), 1) if "damping" in x)
    assert doubt.startswith(f'line {line}: damping="10" on all 3 moving joints')


def test_a_simulators_damping_is_not_the_robots(tmp_path):
    """The nominal torque is that of the same robot without damping; a damping of one's own stays."""
    effects = parse_effects("viscous")
    found = {}
    for name, dynamics in {"none": "", "simulator": '<dynamics damping="10" friction="0.5"/>'}.items():
        (tmp_path / f"{name}.urdf").write_text(chain(*SOUND, dynamics=dynamics))
        robot = Robot.load(tmp_path / f"{name}.urdf")
        found[name] = nominal_parameters(robot, effects)
    assert np.array_equal(found["none"], found["simulator"])
    assert [friction for _, friction in robot.dynamics.values()] == [0.5] * 3
    own = chain(*SOUND, dynamics='<dynamics damping="10"/>').replace('damping="10"', 'damping="9"', 1)
    (tmp_path / "own.urdf").write_text(own)
    assert sorted(Robot.load(tmp_path / "own.urdf").dynamics.values()) == [(9.0, 0.0), (10.0, 0.0), (10.0, 0.0)]


def test_the_damping_of_a_simulated_robot_stays(tmp_path):
    """An MJCF file describes the robot that is simulated."""
    joints = '<joint axis="0 1 0" damping="2" armature="0.1" frictionloss="0.3"/>'
    body = '<body pos="0 0 0.2">' + joints + '<geom type="capsule" size="0.05" fromto="0 0 0 0 0 0.2" mass="1"/>'
    text = f"<mujoco><worldbody>{3 * body}{3 * '</body>'}</worldbody></mujoco>"
    (tmp_path / "arm.xml").write_text(text)
    robot = Robot.load(tmp_path / "arm.xml")
    assert set(robot.dynamics.values()) == {(2.0, 0.3)}
    assert not any("damping" in doubt for doubt in urdf_doubts(robot.urdf))


def test_one_inertia_for_all_links():
    assert any(
        "all 3 links have the same inertia" in x for x in urdf_doubts(chain(*[link(f"l{k}", 1.0) for k in range(3)]))
    )


def test_impossible_bodies_and_far_centres():
    text = chain(link("l0", 1.0, inertia=(0.01, 0.02, 0.5)), link("l1", 2.0, centre="0 0 1.7"), SOUND[2])
    found = urdf_doubts(text)
    assert any("no body can have the inertia of link 'l0'" in x for x in found)
    assert any("centre of mass of link 'l1' is 1.7 m" in x for x in found)


def test_the_bridge_of_a_gantry_is_as_long_as_its_carriage_slides():
    text = (
        '<robot name="gantry"><link name="base"/>'
        + link("bridge", 20.0, centre="0 0.6 0")
        + '<link name="carriage"/><joint name="X" type="prismatic"><parent link="base"/><child link="bridge"/></joint>'
        + '<joint name="Y" type="{}"><parent link="bridge"/><child link="carriage"/>'
        + '<limit lower="0" upper="1.2"/></joint>'
        + "</robot>"
    )
    assert not any("centre of mass" in x for x in urdf_doubts(text.format("prismatic")))
    assert any("centre of mass" in x for x in urdf_doubts(text.format("revolute")))
