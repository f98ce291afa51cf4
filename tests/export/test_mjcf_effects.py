"""An MJCF file and the Python file beside it have the whole model: the torque along a log, and the motion in MuJoCo."""

import json
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from click.testing import CliRunner
from hostile_names import HOSTILE
from test_code import module
from test_step import EVERY, with_effects

import frischid as fr
from frischid.cli import main
from frischid.effects import EFFECTS, parse_effects
from frischid.errors import InputError
from frischid.export.export import export
from frischid.export.mjcf_effects import effects_source
from frischid.export.mjcf_share import forces, share_of
from frischid.export.reach import beside, left_out
from frischid.forward.forward_dynamics import ForwardDynamics
from frischid.forward.simulated_motion import Starts
from frischid.forward.torque_sources import RecordedTorque
from frischid.regression.regressor import Regressor
from frischid.robot.kinematic_tree import bodies_of

LAGS = ("elasticity", "backlash")
FORCES = [text for text in EVERY if not text.startswith((*LAGS, "time_delay"))]


@pytest.fixture(autouse=True)
def no_callback():
    yield
    mujoco.set_mjcb_passive(None)


def moving(machine, seconds=0.8, step=0.01):
    """Motion that starts with a clear speed; positions are the path of the speeds' means, as the model has the path."""
    t, J = np.arange(0.0, seconds, step), len(machine.joints)
    w = np.linspace(5.0, 7.0, J)
    v, a = 1.5 * np.cos(w * t[:, None] + 0.3), -1.5 * w * np.sin(w * t[:, None] + 0.3)
    path = np.vstack([np.zeros(J), np.cumsum(0.5 * (v[1:] + v[:-1]) * step, axis=0)])
    warm = {f"temperature_{n}": np.full(len(t), 35.0 + i) for i, n in enumerate(machine.joints)}
    return t, path - 0.2, v, a, warm


def torque_left(model, t, q, v, a, extra):
    """Torque along a motion of the parameters that the XML lacks, by the model itself."""
    whole = forces(model)
    whole = replace(whole, effects=tuple(e for e in whole.effects if str(e) not in left_out(model, "MJCF")))
    regressor = Regressor(model.robot, whole.effects, model.reference)
    held, rigid = share_of(whole).held, len(model.robot.columns)
    left = [k >= rigid and c.name not in held for k, c in enumerate(regressor.columns)]
    Y = regressor(t, q, v, a, extra=extra)
    tau = np.einsum("ncj,c->nj", Y, np.where(left, [whole.full_theta[k] for k in range(len(left))], 0.0))
    for effect in whole.effects:  # of a coupled rotor, the XML has the armature
        if effect.parameters.get("coupled"):
            for joint, x in model.of_effect(effect.id, "Im").items():
                j = model.robot.joints.index(joint)
                tau[:, j] -= max(x, 0.0) * effect.ratio**2 * a[:, j]
    return tau


def placed(compiled, machine, q):
    """Positions of all joints of MuJoCo's model, followers too."""
    out = np.zeros(compiled.nq)
    for body in bodies_of(machine):
        out[compiled.joint(body.joint).qposadr[0]] = body.factor * q[body.leader] + body.shift
    return out


def dofs(compiled, machine):
    return np.array([compiled.joint(n).dofadr[0] for n in machine.joints])


def test_the_matrix_has_every_effect():
    tried = {e.id for text in FORCES for e in parse_effects(text)} | {"coulomb", "time_delay", *LAGS}
    assert tried == {name for name, kind in EFFECTS.items() if not kind.of_controller}


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("text", FORCES)
def test_the_torque_along_a_log_is_the_models(text, sign, tmp_path):
    model = with_effects("mixed mimic", (*parse_effects("coulomb"), *parse_effects(text)), sign)
    done = export(model, tmp_path / "arm.xml", force=True)
    assert (done.effects_path is None) == (beside(model) == ())
    if done.effects_path is None:
        return
    compiled = mujoco.MjModel.from_xml_path(str(done.path))
    effects, data = module(done.effects_path).attach(compiled), mujoco.MjData(compiled)
    t, q, v, a, extra = moving(model.robot)
    expected, mine = torque_left(model, t, q, v, a, extra), dofs(compiled, model.robot)
    for j, name in enumerate(model.robot.joints):
        effects.temperature[j] = extra[f"temperature_{name}"][0]
    found = []
    for k, time in enumerate(t):
        data.time, data.qpos[:] = time, placed(compiled, model.robot, q[k])
        data.qvel[mine], data.qacc[mine] = v[k], a[k]
        found.append(effects.torque(data))
    # Below a speed the model smooths the sign, and below some path the direction before the log is still remembered.
    clear = (np.abs(v) > 0.6).all(axis=1)
    assert clear.sum() > 10
    np.testing.assert_allclose(
        np.array(found)[clear], expected[clear], rtol=0, atol=1e-9 * max(np.abs(expected).max(), 1)
    )


def simulated(model, path, beside_it, start, t, tau, h=0.001):
    """Positions (N, J) in MuJoCo under a torque over time, with the file beside the XML or without."""
    compiled = mujoco.MjModel.from_xml_path(str(path))
    compiled.opt.timestep, compiled.opt.integrator = h, mujoco.mjtIntegrator.mjINT_RK4
    if beside_it is not None:
        module(beside_it).attach(compiled).temperature[:] = 40.0
    data, mine = mujoco.MjData(compiled), dofs(compiled, model.robot)
    data.qpos[mine], data.qvel[mine] = start
    out = []
    for time in t[:-1]:
        out.append(data.qpos[mine].copy())
        while data.time < time + (t[1] - t[0]) - 0.5 * h:
            data.qfrc_applied[mine] = [np.interp(data.time + 0.5 * h, t, x) for x in tau.T]
            mujoco.mj_step(compiled, data)
    mujoco.set_mjcb_passive(None)
    return np.array([*out, data.qpos[mine]])


SIMULATED = list(
    dict.fromkeys(
        re.sub("@.*", "", text)
        for text in FORCES
        if not text.startswith(
            ("formula", "payload", "viscous", "rotor_inertia", "joint_spring(form=p", "self_heating")
        )  # the model's own forward simulation has no heat to compare with
    )
)
IN_XML = ("joint_coupling", "joint_spring", "joint_coupling(ratio=-2)")
SLOW = ("stribeck", "load_stribeck")


def arm(text, size=0.2):
    """A two-joint arm with an effect and friction of every joint, of usual size."""
    own = parse_effects(text)
    usual = tuple(e for e in parse_effects("viscous, coulomb, rotor_inertia") if e.id not in {x.id for x in own})
    return with_effects("planar2", (*usual, *own), size)


def errors(model, folder, slow=False):
    """Largest difference of MuJoCo's motion from frischid's own, with the file beside the XML and without, rad."""
    done = export(model, folder / "arm.xml", force=True)
    t, q, v, a, extra = moving(model.robot, 0.6)
    if slow:
        q, v, a = q[0] + 0.1 * (q - q[0]), 0.1 * v, 0.1 * a
    warm = {name: (t, np.full(len(t), 40.0)) for name in extra}
    Y = Regressor(model.robot, model.effects, model.reference)(t, q, v, a, extra={n: x for n, (_, x) in warm.items()})
    tau = np.einsum("ncj,c->nj", Y, model.full_theta)
    own = ForwardDynamics(model, extra=warm).simulate(RecordedTorque(t, tau), Starts(q[:1], v[:1]), t, step=0.0005)
    both = (done.effects_path, None)
    found = [simulated(model, done.path, path, (q[0], v[0]), t, tau) for path in both]
    return [float(np.abs(x - own.q[0]).max()) for x in found], done


@pytest.mark.parametrize("text", SIMULATED)
def test_mujoco_moves_as_the_model_does(text, tmp_path):
    (both, alone), done = errors(arm(text), tmp_path, text in SLOW)
    assert both < (2.5e-3 if text == "stribeck" else 6e-4)  # rad, in 0.6 s without any control
    assert (done.effects_path is None) == (text in IN_XML)
    if done.effects_path is not None:
        assert alone > 5 * both


def test_a_payload_is_part_of_its_body(tmp_path):
    model = arm("payload(full=True)")
    added = {"dm2": 2.0, "dmx2": 0.4, "dIzz2": 0.002}
    known = {c.name: added.get(c.name, 0.0) for c in model.effects[-1].columns(model.robot)}
    model = replace(model, standard={**model.standard, **known})
    (both, _), done = errors(model, tmp_path)
    assert done.effects_path is None
    assert both < 6e-4
    bare, _ = errors(replace(model, effects=model.effects[:-1]), tmp_path)
    assert bare[0] < 6e-4


def test_friction_of_the_python_file_holds_a_resting_arm(tmp_path):
    model = arm("stribeck")
    done = export(model, tmp_path / "arm.xml", force=True)
    compiled = mujoco.MjModel.from_xml_path(str(done.path))
    push = 0.9 * np.array([model.parameter(f"fc{n}") + model.parameter(f"fs{n}") for n in (1, 2)])

    def moved():
        data = mujoco.MjData(compiled)
        mujoco.mj_forward(compiled, data)
        for _ in range(1000):
            data.qfrc_applied[:] = data.qfrc_bias + push
            mujoco.mj_step(compiled, data)
        return np.abs(data.qpos).max()

    assert moved() > 0.1
    module(done.effects_path).attach(compiled)
    assert moved() < 1e-4


@pytest.mark.parametrize("integrator", list(mujoco.mjtIntegrator.__members__.values()))
def test_every_simulation_has_a_memory_of_its_own(integrator, tmp_path):
    done = export(arm("hysteresis"), tmp_path / "arm.xml", force=True)
    compiled = mujoco.MjModel.from_xml_path(str(done.path))
    compiled.opt.integrator = integrator
    module(done.effects_path).attach(compiled)

    def step(data, count=1):
        for _ in range(count):
            data.qfrc_applied[:] = np.sin(40 * data.time), 1.0
            mujoco.mj_step(compiled, data)

    one, other = mujoco.MjData(compiled), mujoco.MjData(compiled)
    step(one, 80)
    alone = one.qpos.copy()
    mujoco.mj_resetData(compiled, one)
    for _ in range(80):  # from the start again, with another simulation in between
        step(one)
        step(other, 2)
        mujoco.mj_forward(compiled, other)
        other.qfrc_applied[:] = 0.0
    np.testing.assert_allclose(one.qpos, alone, rtol=0, atol=1e-12)


def test_only_the_model_of_the_export_is_taken_unless_told(tmp_path):
    done = export(arm("cogging"), tmp_path / "arm.xml", force=True)
    text = done.path.read_text()
    effects = module(done.effects_path)
    other = mujoco.MjModel.from_xml_string(re.sub('armature="[^"]*"', 'armature="0.7"', text))
    with pytest.raises(ValueError, match=r"'joint1' has armature 0\.7, but the XML beside this file has"):
        effects.attach(other)
    left = mujoco.MjModel.from_xml_string(text.replace('"joint', '"left_joint'))
    with pytest.raises(ValueError, match=r"no joint named \['joint1', 'joint2'\]"):
        effects.attach(left)
    calls = []
    mujoco.set_mjcb_passive(lambda model, data: calls.append(1))
    found = [effects.attach(left, prefix="left_"), effects.attach(other, check=False)]
    mujoco.mj_forward(left, mujoco.MjData(left))
    assert calls == [1]
    for one in found:
        effects.detach(one)
    mujoco.mj_forward(left, mujoco.MjData(left))
    assert calls == [1, 1]


def test_both_files_are_written_or_none_and_no_file_of_the_user_is_lost(tmp_path):
    model = arm("cogging")
    (tmp_path / "arm_effects.py").write_text("mine = 1\n")
    with pytest.raises(InputError, match=r"arm_effects\.py was not written by frischid"):
        export(model, tmp_path / "arm.xml", force=True)
    assert [x.name for x in tmp_path.iterdir()] == ["arm_effects.py"]
    done = export(model, tmp_path / "robot.xml", force=True)
    first = done.effects_path.read_text()
    assert export(model, tmp_path / "robot.xml", force=True).effects_path.read_text() == first
    before = done.path.read_text()
    with pytest.raises(InputError, match="would apply them twice"):
        export(replace(model, effects=model.effects[:-1]), tmp_path / "robot.xml", force=True)
    assert done.path.read_text() == before


def test_nothing_is_said_twice_and_what_cannot_be_is_said(tmp_path):
    texts = "elasticity@joint2, backlash@joint1, time_delay, cogging@joint2"
    model = with_effects("planar2", parse_effects(f"viscous, coulomb, {texts}"))
    done = export(model, tmp_path / "arm.xml", force=True)
    inside, gears, light, other, late = done.notes
    assert inside == "in the XML: viscous, coulomb, elasticity, backlash"
    assert gears.startswith(
        "added joints, each in the body and on the axis of its motor's joint: spring of joint2, play"
    )
    assert light.startswith("armature of joint2, joint1: 1 % of the link's inertia")
    assert other == "in the Python file beside it: cogging(order=12)@joint2"
    assert late.startswith("in neither file, because a late record of the torque is no force")


def test_names_of_other_people_are_no_code(tmp_path):
    model = arm("hysteresis")
    for title in HOSTILE:
        source = effects_source(replace(model, robot=replace(model.robot, name=title)))
        space = {}
        exec(compile(source, "effects", "exec"), space)
        assert space["JOINTS"] == ("joint1", "joint2")


def test_the_command_writes_and_names_both_files(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    machine, effects = fr.Robot.load("planar2"), parse_effects("viscous, coulomb, cogging")
    values = {"fv1": 1.0, "fv2": 1.0, "fc1": 0.5, "fc2": 0.5, "A1": 0.3, "B2": 0.2}
    log = fr.simulate(machine, fr.random_fourier(machine, 10, seed=1), rate=100, effects=effects, parameters=values)
    fr.identify(machine, [log], effects=effects, recursion="none").model.save("model.json")
    done = CliRunner().invoke(main, ["export", "model.json", "-o", "robot.xml", "--force", "--json"])
    assert done.exit_code == 0, done.output
    found = json.loads(done.stdout)
    assert found["effects_file"] == "robot_effects.py"
    assert "in the Python file beside it: cogging(order=12)" in found["notes"]
    said = CliRunner().invoke(main, ["export", "model.json", "-o", "robot.xml", "--force"]).output
    assert "robot_effects.py" in said
    code = "import mujoco, robot_effects as r; r.attach(mujoco.MjModel.from_xml_path('robot.xml'))"
    subprocess.run([sys.executable, "-c", code], check=True, cwd=tmp_path)


def test_the_users_own_file_gets_tendons_and_the_same_forces(tmp_path):
    text = """<mujoco><compiler angle="degree"/><worldbody><body name="a"><joint name="p" axis="0 1 0"/>
    <inertial pos=".2 0 0" mass="2" diaginertia=".1 .1 .1"/><body name="b" pos=".4 0 0"><joint name="q" axis="0 1 0"/>
    <inertial pos=".2 0 0" mass="1" diaginertia=".05 .05 .05"/></body></body></worldbody></mujoco>"""
    (tmp_path / "own.xml").write_text(text)
    machine = fr.Robot.load(tmp_path / "own.xml")
    effects = parse_effects("viscous, coulomb, rotor_inertia, joint_coupling, load_friction")
    truth = {"fcm1_2": 0.3, "fvm1_2": 0.2, "Iam1_2": 0.1, "fl1": 0.05, "fl2": 0.1}
    truth |= {"fc1": 0.2, "fc2": 0.2, "Ia1": 0.1, "Ia2": 0.1}
    log = fr.simulate(machine, fr.random_fourier(machine, 10, seed=1), rate=100, effects=effects, parameters=truth)
    model = fr.identify(machine, [log], effects=effects, recursion="none").model
    done = export(model, tmp_path / "new.xml", into=tmp_path / "own.xml", force=True)
    compiled = mujoco.MjModel.from_xml_path(str(done.path))
    assert compiled.ntendon == 1
    assert compiled.tendon_armature[0] == pytest.approx(0.1, rel=0.1)
    module(done.effects_path).attach(compiled)
    data = mujoco.MjData(compiled)
    data.qvel[:] = data.qacc[:] = 1.0
    mujoco.mj_inverse(compiled, data)
    one = np.ones((1, 2))
    # MuJoCo's friction constraint of a moving joint is at its level
    np.testing.assert_allclose(data.qfrc_inverse, done.model.inverse_dynamics(0 * one, one, one)[0], rtol=1e-6)


def test_the_lines_of_the_guide_run(tmp_path):
    export(arm("hysteresis"), tmp_path / "identified.xml", force=True)
    guide = (Path(__file__).parents[2] / "docs/guides/export.md").read_text(encoding="utf-8")
    (lines,) = re.findall(r"```text\n(import mujoco.*?)```", guide, re.DOTALL)
    subprocess.run([sys.executable, "-c", lines], check=True, cwd=tmp_path)
