"""Exports say what the model says, and change nothing else."""

import json
import re
from dataclasses import replace
from functools import cache

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from cases import exact_log, joint, link, made, quick, random_values, robot, states, urdf
from click.testing import CliRunner

from frischid.cli import main
from frischid.effects import BASELINE, parse_effects
from frischid.errors import InputError, UnknownNameError
from frischid.export.consistency import as_identified, free_masses, free_parameters, make_consistent
from frischid.export.export import NotPhysicalError, export
from frischid.export.urdf import urdf_source
from frischid.model.identification import identify
from frischid.model.model import Model
from frischid.motions.simulation import Noise, simulate
from frischid.motions.trajectory import random_fourier
from frischid.regression.regressor import Regressor
from frischid.robot.inertia import dynamic_parameters
from frischid.robot.robot import LINK_PARAMETERS, Robot
from frischid.robot.urdf_edit import UrdfText

NAMES = ("planar2", "planar2 far_end known", "ur10 far_end tilted", "panda with fingers", "kinova continuous",
         "one joint", "tiago torso and arm", "mixed mimic")  # fmt: skip


def identified(machine, effects=BASELINE):
    values = random_values(machine, effects)
    return quick(machine, [exact_log(machine, effects, values, noise=Noise(tau=0.01))], effects=effects).model


def nominal(machine):
    """The model of a robot whose links are those of its URDF."""
    model = identified(machine)
    standard = dict(as_identified(model).standard) | dict(zip(machine.all_names, machine.nominal.tolist(), strict=True))
    return Model.from_dict({**model.to_dict(), "standard": standard})


@cache
def physical(name):
    return make_consistent(identified(robot(name))).model


# ---- masses that nobody measured


@pytest.mark.parametrize("name", ["planar2", "planar2 far_end known", "mixed mimic", "one slide"])
def test_a_free_parameter_is_one_that_the_regressor_cannot_see_alone(name):
    slide = urdf(link("base"), link("a", 3.0), joint("s", "base", "a", "prismatic", axis="0 0 1"))
    machine, effects = (made(slide), parse_effects("viscous")) if name == "one slide" else (robot(name), BASELINE)
    regressor = Regressor(machine, effects)
    q, v, a = states(machine, 80)
    Y = regressor(np.arange(80.0), q, v, a).transpose(0, 2, 1).reshape(-1, len(regressor.columns))
    names = [c.name for c in regressor.columns]
    rank = np.linalg.matrix_rank(Y, tol=1e-6)
    free = {
        body: tuple(
            symbol
            for symbol, column in zip(LINK_PARAMETERS, machine.all_names[10 * i : 10 * i + 10], strict=True)
            if column in names and np.linalg.matrix_rank(np.delete(Y, names.index(column), axis=1), tol=1e-6) == rank
        )
        for i, body in enumerate(machine.bodies)
    }
    model = identified(machine, effects)
    assert free_parameters(model) == free
    assert set(free_masses(model)) == {body for body, symbols in free.items() if "m" in symbols}
    assert bool(free_masses(model)) == (name != "one slide")


def test_the_command_says_which_masses_are_a_free_choice(tmp_path):
    identified(robot("planar2")).save(tmp_path / "model.json")
    run = ["export", str(tmp_path / "model.json"), "-o", str(tmp_path / "robot.urdf"), "--width", "200"]
    done = CliRunner().invoke(main, run, catch_exceptions=False)
    said = " ".join(done.output.split())
    assert "mass is" in said
    assert "free: the logs determine this mass only in a sum with other parameters" in said
    data = json.loads(CliRunner().invoke(main, [*run[:4], "--json"]).stdout)
    assert data["consistency"]["free_masses"] == ["joint1", "joint2"]
    assert "free besides: the first moments mx, my, mz and the inertias about the joint, Ixx to Izz" in said
    assert "mz Ixx Ixy Iyy Ixz Iyz" in said
    assert data["consistency"]["free_parameters"]["joint2"] == ["m", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz"]


QUIET = Noise(tau=1e-3)  # N·m, a hundred thousandth of the largest torque


@pytest.mark.parametrize("prior", ["urdf", "none"])
@pytest.mark.parametrize("name", ["planar2", "ur10"])
def test_where_the_logs_leave_a_value_open_the_urdfs_own_value_stays(name, prior, tmp_path):
    """Of a right URDF and logs almost without noise, the exported URDF is the same, in the free directions too."""
    machine = Robot.load(name)
    effects = parse_effects("viscous,coulomb,offset")
    log = simulate(machine, random_fourier(machine, 20.0, seed=3), rate=100.0, effects=effects, noise=QUIET)
    model = identify(machine, [log], effects=effects, prior=prior, recursion="none").model
    done = export(model, tmp_path / "robot.urdf")
    before, after = (machine.nominal.reshape(-1, 10), Robot.load(done.path).nominal.reshape(-1, 10))
    free = [machine.bodies.index(body) for body in free_masses(done.model)]
    assert len(free) >= 2
    assert after[free, 0] == pytest.approx(before[free, 0], rel=2e-3)
    sizes = before[:, :1] * np.array([1.0, *[0.1] * 3, *[0.01] * 6])
    assert np.abs((after - before) / sizes).max() < 0.05


def test_free_masses_stay_the_urdfs_where_its_centres_of_mass_are_wrong():
    machine = Robot.load("ur10")
    links = machine.nominal.reshape(-1, 10).copy()
    links[:, 1:4] *= np.array([1.0, 0.75, 1.3, 0.8, 1.3, 1.0])[:, None]
    theta = dict(zip(machine.all_names, links.ravel(), strict=True))
    effects = parse_effects("viscous,coulomb,offset")
    log = simulate(
        machine, random_fourier(machine, 20.0, seed=3), rate=100.0, effects=effects, parameters=theta, noise=QUIET
    )
    found = make_consistent(identify(machine, [log], effects=effects, recursion="none").model)
    assert found.result.reproduces
    worst = float(np.abs(found.model.links[:, 0] / links[:, 0] - 1).max())
    assert worst < 0.35  # 0.29; by the divergence alone 0.48


# ---- URDF


@pytest.mark.parametrize("name", NAMES)
def test_the_urdf_has_the_models_rigid_torque(name, tmp_path):
    model = physical(name)
    done = export(model, tmp_path / "robot.urdf")
    machine = model.robot
    again = Robot.load(tmp_path / "robot.urdf", lock=machine.locked, gravity=machine.gravity)
    q, v, a = states(machine, 30)
    expected = done.model.robot.pinocchio(done.model.links)
    assert expected.nq == again.model.nq
    np.testing.assert_allclose(
        again.inverse_dynamics(q, v, a), _by_links(model, q, v, a), atol=1e-6 * np.abs(_by_links(model, q, v, a)).max()
    )
    assert done.difference < 1e-6


def test_a_urdf_says_the_gravity_that_it_cannot_hold(tmp_path):
    """Loaded with the usual gravity, the file of a tilted robot has other torques."""
    said = [x for x in export(physical("ur10 far_end tilted"), tmp_path / "tilted.urdf").notes if "gravity" in x]
    assert len(said) == 1
    assert "(-7.684, -2.375, -5.617) m/s² in the base" in said[0]
    assert not [x for x in export(physical("planar2"), tmp_path / "robot.urdf").notes if "gravity" in x]


def _by_links(model, q, v, a):
    """Torque of the identified links through the robot's own regressor."""
    bare = Robot.from_dict({**model.robot.to_dict(), "known": {}})
    out = np.empty((len(q), len(bare.all_names), len(bare.joints)))
    bare.regressor(q, v, a, out)
    return np.einsum("ncj,c->nj", out, model.links.ravel())


def without_edits(text):
    text = re.sub(r"[ \t]*<inertial>.*?</inertial>\r?\n?", "", text, flags=re.S)
    return re.sub(r'\s(damping|friction)="[^"]*"', "", text)


@pytest.mark.parametrize("name", ["planar2", "ur10 far_end tilted", "panda with fingers", "tiago torso and arm"])
def test_nothing_else_is_changed(name):
    model = physical(name)
    before, after = without_edits(model.robot.urdf), without_edits(urdf_source(model))
    added = [line for line in after.splitlines() if line not in set(before.splitlines())]
    assert all("<dynamics" in line for line in added)  # only joints that had no <dynamics> gain a line
    kept = "\n".join(line for line in after.splitlines() if line not in added)
    assert kept == "\n".join(line for line in before.splitlines() if line not in set(added)).rstrip("\n") or not added


WEIRD = """<?xml version='1.0' encoding='utf-8'?>\r
<!-- a comment > with a bracket, <inertial> and <link name="a"> -->\r
<robot  name = 'weird'  xmlns:x="http://example.org/x">\r
  <link name="base"/>\r
  <link name='a' x:note="1 > 0"  >  <!-- ä keeps its place -->\r
    <visual><geometry><box size="1 1 1"/></geometry></visual></link>\r
  <link name="b"/>\r
  <link
     name="c">\r
    <inertial><mass value="2"/><origin rpy="0.3 0 -0.2"   xyz="0.1 0 0"/><inertia izz='0.3' ixx="0.1" iyy="0.25" ixy="0" ixz="0.01" iyz="0"/></inertial><collision name="k"><geometry><sphere radius="1"/></geometry></collision>\r
  </link>\r
  <link name="tool"><inertial><mass value="0.5"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>\r
  <joint name="one" type="revolute"><parent link="base"/><child link="a"/><axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="50" velocity="3"/></joint>\r
  <joint type="prismatic" name="two"><limit effort="50" velocity="3" upper="1" lower="-1"/><dynamics friction='0.1'\tx:other="3" ></dynamics><parent link="a"/><child link="b"/><origin xyz="0.2 0 0.1" rpy="0.1 0.2 0.3"/></joint>\r
  <joint name="three" type="continuous"><origin xyz="0 0.3 0"/><dynamics damping = "0.0" friction="0.0"/><parent link="b"/><child link="c"/><axis xyz="0 1 1"/><limit effort="50" velocity="3"/></joint>\r
  <joint name="fix" type="fixed"><origin xyz="0.2 0.1 0" rpy="0.5 0 0"/><parent link="c"/><child link="tool"/></joint>\r
  <transmission name="t"><joint name="one"/></transmission>\r
</robot>\r
"""  # noqa: E501


def test_a_hand_written_urdf_survives(tmp_path):
    path = tmp_path / "weird.urdf"
    path.write_bytes(WEIRD.encode())
    model = make_consistent(identified(Robot.load(path))).model
    done = export(model, tmp_path / "new.urdf")
    assert done.difference < 1e-9
    new = (tmp_path / "new.urdf").read_bytes()
    assert b"\r\n" in new
    assert not re.search(rb"(?<!\r)\n(?!     name)", new.replace(b"<link\n", b"<link"))
    text = new.decode()
    for kept in (
        "<!-- a comment > with",
        "ä keeps its place",
        "<robot  name = 'weird'  xmlns:x=",
        'x:note="1 > 0"  >',
        '\tx:other="3" damping=',
        '<collision name="k"><geometry>',
        '<transmission name="t"><joint name="one"/>',
        '<link name="base"/>',
    ):
        assert kept in text
    assert text.count("<inertial>") == 1 + 4  # that of the comment, and those of a, b, c and the tool
    shares = [UrdfText(text).pseudo_inertia(n)[3, 3] for n in ("c", "tool")]
    assert shares[0] / shares[1] == pytest.approx(4.0)
    again = Robot.load(tmp_path / "new.urdf")
    assert again.dynamics["two"] == pytest.approx((model.parameter("fv2"), model.parameter("fc2")))
    assert again.dynamics["three"] == pytest.approx((model.parameter("fv3"), model.parameter("fc3")))


def test_an_inertial_with_axes_of_its_own_is_read_as_pinocchio_reads_it():
    inertial = (
        '<inertial><origin xyz="0.1 -0.2 0.3" rpy="0.4 -0.9 2.2"/><mass value="3"/>'
        '<inertia ixx="0.05" iyy="0.06" izz="0.07" ixy="0.001" ixz="-0.002" iyz="0.003"/></inertial>'
    )
    text = urdf(link("w"), link("a", extra=inertial), joint("j", "w", "a"))
    expected = pin.buildModelFromXML(text).inertias[1].toDynamicParameters()
    np.testing.assert_allclose(dynamic_parameters(UrdfText(text).pseudo_inertia("a")), expected, atol=1e-12)


def test_links_fixed_to_one_another_keep_their_shares_whatever_their_axes():
    """A body that is identified as the URDF has it leaves all of its links as they are."""
    inertial = (
        '<inertial><origin xyz="0 0.1 0" rpy="1 0 0.5"/><mass value="2"/>'
        '<inertia ixx="0.02" iyy="0.03" izz="0.04" ixy="0" ixz="0" iyz="0"/></inertial>'
    )
    fixed = joint("weld", "a", "tool", "fixed", xyz="0.2 0 0.1", rpy="0.3 -0.8 1.1")
    text = urdf(link("w"), link("a", 3.0), link("tool", extra=inertial), joint("j", "w", "a"), fixed)
    before = UrdfText(text)
    after = UrdfText(urdf_source(nominal(made(text))))
    for name in ("a", "tool"):
        share = before.pseudo_inertia(name)
        np.testing.assert_allclose(after.pseudo_inertia(name), share, atol=1e-9)


def test_exporting_the_nominal_model_changes_only_digits():
    machine = robot("panda with fingers")
    text = urdf_source(nominal(machine))
    again = Robot.from_dict({**machine.to_dict(), "urdf": text})
    np.testing.assert_allclose(again.nominal, machine.nominal, atol=1e-12)


@pytest.mark.parametrize("name", ["ur10 far_end tilted", "kinova continuous"])
def test_mujoco_reads_the_urdf(name, tmp_path):
    model = physical(name)
    machine = model.robot
    text = re.sub(r"<(visual|collision)\b.*?</\1>", "", urdf_source(model), flags=re.S)  # meshes are not at hand
    path = tmp_path / "robot.urdf"
    compiler = '<mujoco><compiler fusestatic="true" balanceinertia="false"/></mujoco></robot>'
    path.write_text(text.replace("</robot>", compiler))
    compiled = mujoco.MjModel.from_xml_path(str(path))
    locked = {**machine.locked}
    names = [compiled.joint(i).name for i in range(compiled.njnt)]
    q, v, a = states(machine, 5)
    expected = _by_links(model, q, v, a)
    for k in range(len(q)):
        values = dict(zip(machine.joints, zip(q[k], v[k], a[k], strict=True), strict=True))
        at = [values.get(n, (locked.get(n, 0.0), 0.0, 0.0)) for n in names]
        torque = _mujoco_inverse(compiled, machine.gravity, *map(np.array, zip(*at, strict=True)))
        by_name = dict(zip(names, torque, strict=True))
        damping = {n: compiled.dof_damping[compiled.joint(n).dofadr[0]] * values[n][1] for n in machine.joints}
        got = [by_name[n] - damping[n] for n in machine.joints]
        np.testing.assert_allclose(got, expected[k], atol=1e-6 * np.abs(expected).max())


def _mujoco_inverse(compiled, gravity, q, v, a):
    compiled.opt.gravity[:] = gravity
    compiled.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT | mujoco.mjtDisableBit.mjDSBL_CONTACT
    data = mujoco.MjData(compiled)
    data.qpos[:], data.qvel[:], data.qacc[:] = q, v, a
    mujoco.mj_inverse(compiled, data)
    return data.qfrc_inverse.copy()


@pytest.mark.parametrize("name", ["planar2", "ur10 far_end tilted", "kinova continuous", "tiago torso and arm"])
def test_mjcf_has_rotors_and_friction(name, tmp_path):
    model = physical(name)
    machine = model.robot
    export(model, tmp_path / "robot.xml")
    compiled = mujoco.MjModel.from_xml_path(str(tmp_path / "robot.xml"))
    assert [compiled.joint(i).name for i in range(compiled.njnt)] == list(machine.bodies)
    for n in machine.joints:
        number, dof = machine.numbers[n], compiled.joint(n).dofadr[0]
        assert compiled.dof_frictionloss[dof] == pytest.approx(model.parameter(f"fc{number}"))
        assert compiled.dof_damping[dof] == pytest.approx(model.parameter(f"fv{number}"))
        assert compiled.dof_armature[dof] == pytest.approx(model.parameter(f"Ia{number}"))
    q, v, a = states(machine, 5)
    expected = _by_links(model, q, v, a)
    for k in range(len(q)):
        torque = _mujoco_inverse(compiled, machine.gravity, q[k], v[k], a[k])
        rest = torque - compiled.dof_damping * v[k] - compiled.dof_armature * a[k]
        np.testing.assert_allclose(rest, expected[k], atol=1e-6 * np.abs(expected).max())


# ---- refusals


def unphysical():
    """A model whose second link has a negative mass, known to a gram."""
    machine = robot("ur10")
    values = random_values(machine, BASELINE) | {"mx3": 40.0, "Ixx3": 0.01}
    return quick(machine, [exact_log(machine, BASELINE, values, noise=Noise(tau=0.001))]).model


def test_what_is_not_physical_is_refused_unless_told(tmp_path):
    model, path = unphysical(), tmp_path / "robot.urdf"
    with pytest.raises(NotPhysicalError, match=r"no physical robot .* --force"):
        export(model, path)
    assert not path.exists()
    done = export(model, path, force=True)
    assert done.difference < 1e-6
    with pytest.raises(NotPhysicalError, match="negative eigenvalue"):
        export(done.model, path)


def test_bad_targets(tmp_path):
    with pytest.raises(UnknownNameError, match="export format"):
        export(physical("planar2"), tmp_path / "robot.sdf")
    with pytest.raises(InputError, match="there is no folder"):
        export(physical("planar2"), tmp_path / "none" / "robot.urdf")


def test_a_changed_robot_is_refused(tmp_path):
    machine = robot("ur10")
    model = identified(machine)
    data = model.to_dict() | {"prior": None, "fitted": None}
    left_out = {key: np.array(data[key])[1:, 1:].tolist() for key in ("covariance", "information")}
    changed = Model.from_dict({**data, **left_out, "parameters": data["parameters"][1:]})
    with pytest.raises(InputError, match="change of the robot"):
        export(changed, tmp_path / "robot.urdf")


# ---- the command line


def test_commands(tmp_path):
    raw, path = tmp_path / "raw.json", tmp_path / "robot.urdf"
    identified(robot("planar2")).save(raw)
    run = CliRunner().invoke
    done = run(main, ["consistent", str(raw), "-o", str(tmp_path / "physical.json")])
    assert done.exit_code == 0, done.output
    assert "physically consistent links found" in done.output
    assert Model.load(tmp_path / "physical.json").standard is not None
    done = run(main, ["export", str(raw), "-o", str(path), "--json"])
    assert done.exit_code == 0, done.output
    data = json.loads(done.output)
    assert data["consistency"]["feasible"] is True
    assert data["difference"] < 1e-6
    done = run(main, ["export", str(tmp_path / "physical.json"), "-o", str(tmp_path / "c.c"), "--json"])
    assert "consistency" not in json.loads(done.output)
    done = run(main, ["consistent", str(raw), "--box", "joint2=0,0,0:1,1,1", "--json"])
    assert json.loads(done.output)["boxes"]["joint2"] == [[0, 0, 0], [1, 1, 1]]
    alarm = {
        "id": "gains-from-masses",
        "severity": "severe",
        "sentence": "The gains follow from masses.",
        "remedy": "Weigh.",
    }
    stored = json.loads(raw.read_text())
    del stored["sha256"]
    stored["history"][-1]["cross_validated"]["alarms"] = [alarm]
    raw.write_text(json.dumps(stored))
    for words in (["consistent", str(raw)], ["export", str(raw), "-o", str(path)]):  # both show it
        done = run(main, words)
        assert done.exit_code == 1, done.output
        assert "ALARM gains-from-masses: The gains follow from masses." in done.output
    for wrong in (["--box", "joint2=0,0:1"], ["--box", "joint2=0,0,x:1,1,1"], ["--box", "joint9=0,0,0:1,1,1"]):
        done = run(main, ["consistent", str(raw), *wrong])
        assert done.exit_code == 2
        assert "error:" in done.output


@pytest.mark.parametrize("suffix", [".urdf", ".xml", ".c", ".py"])
def test_files_of_a_model_whose_torque_was_recorded_late_say_so(tmp_path, suffix):
    model = physical("planar2")
    late = replace(model, lowpass=replace(model.lowpass, torque_lag=0.0025))
    said = [note for note in export(late, tmp_path / f"out{suffix}").notes if "2.5 ms late" in note]
    assert len(said) == 1
    assert "read the record 2.5 ms ahead" in said[0]
    if suffix in {".c", ".py"}:
        assert "read the record 2.5 ms ahead" in (tmp_path / f"out{suffix}").read_text()
    assert not any("ms late" in note for note in export(model, tmp_path / f"plain{suffix}").notes)
