"""MJCF in and out: a robot from its XML, identified, and the same XML with other numbers."""

import re

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from click.testing import CliRunner

from frischid.cli import main
from frischid.effects import parse_effects
from frischid.errors import InputError
from frischid.export.export import export
from frischid.model.identification import identify
from frischid.motions.limits import nominal_torque
from frischid.motions.simulation import Noise, simulate
from frischid.motions.trajectory import random_fourier
from frischid.robot.mjcf_reading import gravity_of_mjcf, urdf_of_mjcf
from frischid.robot.robot import Robot

ARM = """<mujoco model="arm">
  <!-- a comment that must stay -->
  <compiler angle="radian"/>
  <default><joint armature="0.1" damping="0.5"/></default>
  <worldbody>
    <body name="upper" pos="0 0 0.3">
      <joint name="shoulder" type="hinge" axis="0 1 0" range="-2 2" frictionloss="0.3"/>
      <inertial pos="0 0.1 0" mass="2" diaginertia="0.02 0.03 0.04"/>
      <geom type="capsule" size="0.05" fromto="0 0 0 0 0.2 0"/>
      <body name="lower" pos="0.3 0 0" euler="0 0 0.4">
        <joint name="elbow" axis="1 0 0" pos="0 0.01 0" range="-2 2"/>
        <geom type="box" size="0.05 0.1 0.05" mass="1"/>
        <body name="tool" pos="0 0.1 0"><inertial pos="0 0 0.1" mass="0.3" diaginertia="0.001 0.001 0.001"/></body>
      </body>
    </body>
  </worldbody>
  <actuator><motor joint="shoulder"/></actuator>
</mujoco>
"""


@pytest.fixture
def path(tmp_path):
    (tmp_path / "arm.xml").write_text(ARM)
    return tmp_path / "arm.xml"


def states(rng, model):
    q = rng.uniform(-1, 1, model.nq)
    return q, rng.normal(size=model.nv), rng.normal(size=model.nv)


def test_the_gravity_of_the_file_is_the_robots(path):
    """Pinocchio does not read it. A log of such a robot gave a wrong model, without a word."""
    (path.parent / "scene.xml").write_text('<mujoco><option timestep="0.001" gravity="0 0 -1.62"/></mujoco>')
    plain = Robot.load(path)
    assert plain.gravity == (0.0, 0.0, -9.81)
    path.write_text(ARM.replace("<default>", '<option gravity="1 0 -3"/><default>', 1))
    robot = Robot.load(path)
    assert robot.gravity == (1.0, 0.0, -3.0)
    compiled, q = mujoco.MjModel.from_xml_path(str(path)), np.array([0.3, -0.4])
    data = mujoco.MjData(compiled)
    data.qpos[:] = q
    mujoco.mj_inverse(compiled, data)
    assert nominal_torque(robot, q[None], np.zeros((1, 2)), np.zeros((1, 2)))[0] == pytest.approx(data.qfrc_inverse)
    assert Robot.load(path, gravity=(0, 0, -9.81)).gravity == plain.gravity, "what is given counts"
    log = simulate(robot, random_fourier(robot, 5.0, seed=1), rate=100.0)
    model = identify(robot, [log], recursion="none").model
    assert not any("gravity" in note for note in export(model, path.parent / "same.xml", into=path).notes)
    path.write_text(ARM.replace("<default>", '<include file="scene.xml"/><default>', 1))
    assert Robot.load(path).gravity == (0.0, 0.0, -1.62)
    (path.parent / "parts").mkdir()
    (path.parent / "parts" / "world.xml").write_text('<mujoco><include file="scene.xml"/></mujoco>')
    nested = ARM.replace("<default>", '<include file="parts/world.xml"/><default>', 1)
    (path.parent / "nested.xml").write_text(nested)
    assert gravity_of_mjcf(path.parent / "nested.xml") == (0.0, 0.0, -1.62), "relative to the main file, as in MuJoCo"
    (note,) = (n for n in export(model, path.parent / "other.xml", into=path).notes if "gravity" in n)
    assert note == "arm.xml keeps its own gravity; the model's is (1, 0, -3) m/s²: set <option gravity> to it"
    path.write_text(ARM.replace("<default>", '<option gravity="down"/><default>', 1))
    with pytest.raises(InputError, match=r"three finite numbers in m/s², got 'down'"):
        Robot.load(path)


def test_the_converted_robot_has_the_same_dynamics(path):
    own, robot = pin.buildModelFromMJCF(str(path)), Robot.load(path)
    assert robot.joints == ("shoulder", "elbow")
    assert robot.dynamics == {"shoulder": (0.5, 0.3), "elbow": (0.5, 0.0)}
    assert robot.armature == {"shoulder": 0.1, "elbow": 0.1}
    rng = np.random.default_rng(0)
    for _ in range(5):
        q, v, a = states(rng, own)
        expected = pin.rnea(own, own.createData(), q, v, a) - own.armature * a
        np.testing.assert_allclose(robot.inverse_dynamics(q[None], v[None], a[None])[0], expected, atol=1e-9)


def test_only_numbers_change_and_they_are_the_identified_ones(path, tmp_path):
    robot = Robot.load(path)
    own = dict(zip(robot.all_names, robot.nominal, strict=True))
    truth = {n: 1.4 * x for n, x in own.items()} | {
        "fv1": 0.9,
        "fc1": 0.5,
        "Ia1": 0.2,
        "fv2": 0.3,
        "fc2": 0.2,
        "Ia2": 0.05,
    }
    noise = Noise(q=1e-6, tau=1e-3)
    log = simulate(robot, random_fourier(robot, 30, seed=1), rate=200, parameters=truth, noise=noise)
    model = identify(robot, [log], recursion="none", prior="none").model
    done = export(model, tmp_path / "new.xml", into=path)
    text = (tmp_path / "new.xml").read_text()

    def bare(x):
        x = re.sub(r"<inertial[^>]*>", "", x)
        return re.sub(r' ?(armature|damping|frictionloss)="[^"]*"', "", x)

    assert bare(text) == bare(ARM)
    assert "a comment that must stay" in text
    again = Robot.load(tmp_path / "new.xml")
    rigid = done.model.robot
    assert again.armature["shoulder"] == pytest.approx(
        done.model.of_effect("rotor_inertia", "Ia")["shoulder"], rel=1e-6
    )
    assert again.dynamics["elbow"][0] == pytest.approx(0.3, rel=0.05)
    expected = rigid.pinocchio(done.model.links.ravel())
    q = np.random.default_rng(1).uniform(-1, 1, (4, 2))
    for row in q:
        torque = pin.rnea(expected, expected.createData(), row, 0 * row, 0 * row)
        np.testing.assert_allclose(
            again.inverse_dynamics(row[None], 0 * row[None], 0 * row[None])[0], torque, atol=1e-6
        )


UNITS = {
    "radian": '<compiler angle="radian"/>',
    "degree": '<compiler angle="degree"/>',
    "unsaid": "<compiler/>",
    "radian in another file": '<include file="unit.xml"/>',  # read as degrees once: a spring 57 times too far away
    "radian in a comment": '<!-- <compiler angle="radian"/> -->',
}


@pytest.mark.parametrize("unit", UNITS)
@pytest.mark.parametrize("into", [True, False])
def test_mujoco_has_the_torque_of_a_linear_spring(tmp_path, unit, into):
    text = ARM.replace('range="-2 2"', "").replace(' euler="0 0 0.4"', "")
    (tmp_path / "unit.xml").write_text('<mujoco><compiler angle="radian"/></mujoco>')
    (tmp_path / "arm.xml").write_text(text.replace(UNITS["radian"], UNITS[unit]))
    robot = Robot.load(tmp_path / "arm.xml")
    effects = parse_effects("viscous, coulomb, offset, rotor_inertia, joint_spring@elbow")
    truth = {"ks2": 3.0, "off2": -0.6, "off1": 0.4}
    log = simulate(robot, random_fourier(robot, 20, seed=1), rate=100, effects=effects, parameters=truth)
    model = identify(robot, [log], effects=effects, recursion="none").model
    done = export(model, tmp_path / "new.xml", into=tmp_path / "arm.xml" if into else None)
    assert "in the Python file beside it: offset@shoulder" in done.notes
    compiled = mujoco.MjModel.from_xml_path(str(tmp_path / "new.xml"))
    data = mujoco.MjData(compiled)
    for q in (-0.5, 0.0, 0.7):
        data.qpos[:] = (0.3, q)
        mujoco.mj_forward(compiled, data)
        expected = done.model.parameter("ks2") * q + done.model.parameter("off2")
        assert -data.qfrc_passive[1] == pytest.approx(expected, abs=1e-6)
        assert expected == pytest.approx(3.0 * q - 0.6, abs=0.05)
        assert data.qfrc_passive[0] == 0


def test_a_spring_that_pushes_away_is_in_the_python_file(tmp_path, path):
    robot = Robot.load(path)
    effects = parse_effects("viscous, coulomb, rotor_inertia, joint_spring@elbow")
    log = simulate(robot, random_fourier(robot, 20, seed=1), rate=100, effects=effects, parameters={"ks2": -3.0})
    done = export(identify(robot, [log], effects=effects, recursion="none").model, tmp_path / "new.xml")
    assert "in the Python file beside it: joint_spring(form=linear)@elbow" in done.notes
    assert "stiffness" not in (tmp_path / "new.xml").read_text()


def test_the_command_line_takes_mjcf(path, tmp_path):
    robot = Robot.load(path)
    log = simulate(robot, random_fourier(robot, 15, seed=1), rate=100, noise=Noise(tau=0.01))
    np.savez(tmp_path / "log.npz", time=log.t, qpos=log.q, qfrc_actuator=log.tau)
    run = CliRunner().invoke
    options = ["--bbrf", "none", "-o", str(tmp_path / "model.json")]
    result = run(main, ["identify", str(path), str(tmp_path / "log.npz"), *options])
    assert result.exit_code in (0, 1), result.output
    files = [str(tmp_path / "model.json"), "-o", str(tmp_path / "new.xml"), "--into", str(path)]
    result = run(main, ["export", *files])
    assert result.exit_code == 0, result.output
    assert '<motor joint="shoulder"/>' in (tmp_path / "new.xml").read_text()


def test_what_cannot_be_converted_is_said(tmp_path):
    free = re.sub(r'<joint name="shoulder"[^>]*>', '<freejoint name="shoulder"/>', ARM)
    (tmp_path / "free.xml").write_text(free)
    with pytest.raises(InputError, match="6 degrees of freedom"):
        urdf_of_mjcf(tmp_path / "free.xml")
    (tmp_path / "broken.xml").write_text("<mujoco><worldbody></mujoco>")
    with pytest.raises(InputError):
        Robot.load(tmp_path / "broken.xml")


FINGERS = """<body name="finger" pos="0 0.1 0.05" euler="0.3 0 0">
          <joint name="grip" type="slide" axis="0 1 0" range="-0.1 0.1" ref="0.02"/>
          <inertial pos="0.01 0 0.02" mass="0.2" diaginertia="0.0001 0.0002 0.0002"/>
          <body name="tip" pos="0 0 0.04"><joint name="bend" axis="1 0 0" range="-1 1"/>
            <inertial pos="0 0 0.01" mass="0.05" diaginertia="0.00001 0.00001 0.00001"/></body></body>
        <body name="tool" """


def test_bodies_behind_locked_joints_keep_their_numbers(tmp_path):
    """A gripper without torques is locked. Its file was refused: "identify all joints for this"."""
    own = tmp_path / "gripper.xml"
    own.write_text(ARM.replace('<body name="tool" ', FINGERS, 1))
    lock = {"grip": 0.05, "bend": -0.4}
    robot = Robot.load(own, lock=lock)
    truth = {n: 1.3 * x for n, x in zip(robot.all_names, robot.nominal, strict=True)}
    log = simulate(robot, random_fourier(robot, 20, seed=1), rate=100, parameters=truth, noise=Noise(tau=1e-3))
    model = identify(robot, [log], recursion="none").model
    done = export(model, tmp_path / "new.xml", into=own)
    compiled, before = (mujoco.MjModel.from_xml_path(str(x)) for x in (tmp_path / "new.xml", own))
    bodies = [before.body(name).id for name in ("finger", "tip", "tool")]
    np.testing.assert_allclose(compiled.body_mass[bodies], before.body_mass[bodies])
    np.testing.assert_allclose(compiled.body_inertia[bodies], before.body_inertia[bodies])
    again = Robot.load(tmp_path / "new.xml", lock=lock)
    q, v, a = np.random.default_rng(0).normal(size=(3, 5, 2))
    expected = done.model.robot.pinocchio(done.model.links.ravel())
    torques = [pin.rnea(expected, expected.createData(), *state) for state in zip(q, v, a, strict=True)]
    np.testing.assert_allclose(again.inverse_dynamics(q, v, a), torques, atol=1e-6)
    own.write_text(ARM)
    with pytest.raises(InputError, match="no joint grip or bend, which the model locks"):
        export(model, tmp_path / "other.xml", into=own)


def test_a_file_of_the_user_that_cannot_be_read_is_named(path, tmp_path):
    robot = Robot.load(path)
    log = simulate(robot, random_fourier(robot, 8, seed=1), rate=50, noise=Noise(tau=0.01))
    model = identify(robot, [log], recursion="none").model
    with pytest.raises(InputError, match=r"gone.xml: the MJCF file cannot be read \(No such file or directory\)"):
        export(model, tmp_path / "new.xml", into=tmp_path / "gone.xml")
    (tmp_path / "arm.urdf").write_text(robot.urdf)
    with pytest.raises(InputError, match=r"arm.urdf: no MJCF file, because it has no <mujoco>; --into"):
        export(model, tmp_path / "new.xml", into=tmp_path / "arm.urdf")
    (tmp_path / "latin.xml").write_bytes(path.read_bytes() + "<!-- Gerät -->".encode("latin-1"))
    with pytest.raises(InputError, match=r"latin.xml: byte \d+ is not UTF-8"):
        export(model, tmp_path / "new.xml", into=tmp_path / "latin.xml")
    for name in ("new.urdf", "new.c"):
        with pytest.raises(InputError, match=r"--into .* writes MJCF only"):
            export(model, tmp_path / name, into=path)
    assert not list(tmp_path.glob("new*"))


def test_a_file_whose_inertials_mujoco_ignores_is_refused(path, tmp_path):
    """Where an included file says so, the written masses had no effect."""
    robot = Robot.load(path)
    model = identify(robot, [simulate(robot, random_fourier(robot, 8, seed=1), rate=50)], recursion="none").model
    (tmp_path / "unit.xml").write_text('<mujoco><compiler angle="radian" inertiafromgeom="true"/></mujoco>')
    for text in ('<include file="unit.xml"/>', '<compiler angle="radian" inertiafromgeom="true"/>'):
        path.write_text(ARM.replace('<compiler angle="radian"/>', text))
        with pytest.raises(InputError, match="makes MuJoCo ignore inertials"):
            export(model, tmp_path / "new.xml", into=path)
    path.write_text(ARM.replace("must stay", "must stay, as inertiafromgeom='true'"))
    export(model, tmp_path / "new.xml", into=path)


@pytest.mark.parametrize("place", ['<joint name="elbow"', "<default><joint"])
def test_a_joint_whose_damping_mujoco_makes_of_other_numbers_is_refused(path, tmp_path, place):
    """MuJoCo had damped the joint 4.5 times as much as the model, whatever the file said."""
    robot = Robot.load(path)
    model = identify(robot, [simulate(robot, random_fourier(robot, 8, seed=1), rate=50)], recursion="none").model
    path.write_text(ARM.replace(place, f'{place} springdamper="0.1 1"'))
    with pytest.raises(InputError, match=r"arm.xml: springdamper.* makes MuJoCo ignore"):
        export(model, tmp_path / "new.xml", into=path)
    (tmp_path / "more.xml").write_text('<mujoco><default><joint springdamper="0.1 1"/></default></mujoco>')
    path.write_text(ARM.replace("<default>", '<include file="more.xml"/><default>'))
    with pytest.raises(InputError, match=r"more.xml: springdamper makes MuJoCo ignore"):
        export(model, tmp_path / "new.xml", into=path)
    path.write_text(ARM.replace(place, f'{place} springdamper="0 1"'))  # MuJoCo takes no notice of this one
    export(model, tmp_path / "new.xml", into=path)


@pytest.mark.parametrize("effects", ["", "viscous@elbow", "coulomb, rotor_inertia@elbow"])
def test_the_file_keeps_no_armature_and_no_friction_that_the_model_has_not(tmp_path, path, effects):
    path.write_text(
        ARM.replace('"lower" pos="0.3 0 0" euler="0 0 0.4"', '"lower" pos="0.3 0 0"').replace('0.3"/>', '2"/>')
    )
    robot = Robot.load(path)
    chosen = parse_effects(effects) if effects else ()
    log = simulate(robot, random_fourier(robot, 10, seed=1), rate=100, effects=chosen, noise=Noise(tau=1e-3))
    model = identify(robot, [log], effects=chosen, recursion="none").model
    done = export(model, tmp_path / "new.xml", into=path)
    compiled = mujoco.MjModel.from_xml_path(str(tmp_path / "new.xml"))
    assert (compiled.dof_damping > 0).tolist() == [False, "viscous" in effects]
    assert (compiled.dof_frictionloss > 0).tolist() == ["coulomb" in effects] * 2
    compiled.dof_frictionloss[:] = 0.0  # it would hold the joints at rest
    data = mujoco.MjData(compiled)
    q, v, a = np.random.default_rng(0).normal(size=(3, 1, 2))
    data.qpos[:], data.qvel[:], data.qacc[:] = q[0], 0.0, a[0]
    mujoco.mj_inverse(compiled, data)
    np.testing.assert_allclose(data.qfrc_inverse, done.model.inverse_dynamics(q, 0 * v, a)[0], atol=1e-6)


def test_a_slide_without_a_range_has_none(tmp_path, path):
    path.write_text(ARM.replace('type="hinge" axis="0 1 0" range="-2 2"', 'type="slide" axis="0 1 0"'))
    assert Robot.load(path).limits.lower.tolist() == [-np.inf, -2.0]


def test_the_torque_of_a_plan_has_the_rotors(path):
    robot, compiled = Robot.load(path), mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(compiled)
    compiled.dof_frictionloss[:] = 0.0  # it would hold the joints at rest
    q, a = np.random.default_rng(0).normal(size=(2, 1, 2))
    data.qpos[:], data.qacc[:] = q[0], a[0]
    mujoco.mj_inverse(compiled, data)
    np.testing.assert_allclose(nominal_torque(robot, q, 0 * q, a)[0], data.qfrc_inverse, atol=1e-6)
