"""Elastic gears and gears with play in MuJoCo move as an independent integration of the same equations says."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from test_step import with_effects

import frischid as fr
from frischid.effects import parse_effects
from frischid.effects.dynamics import RigidDynamics
from frischid.effects.link_lag import SWING_DAMPING
from frischid.errors import InputError
from frischid.export.export import export
from frischid.export.mjcf import mjcf_source
from frischid.export.reach import exportable, left_out
from frischid.regression.regressor import Regressor

PERIOD, GAP, SECONDS, STEP = 0.12, 0.004, 0.8, 0.0005
TIMES = np.arange(0.0, SECONDS, 0.01)
HANGING = np.array([-np.pi / 2, 0.0])
WIDTH = 1e-3  # rad/s: width of dry friction's sign in the integration


def arm(text, **values):
    """A two-link arm with rotors, viscous friction, the effect, and some values of parameters."""
    model = with_effects("planar2", (*parse_effects("viscous, coulomb, rotor_inertia"), *parse_effects(text)))
    usual = {"fv1": 1.0, "fv2": 0.5, "fc1": 0.0, "fc2": 0.0, "Ia1": 2.0, "Ia2": 0.6}
    return replace(model, standard={**model.standard, **usual, **values})


def stiffness(model, period=PERIOD):
    """Stiffness of the spring of the second joint that makes its link swing with a period."""
    return (2 * np.pi / period) ** 2 * inertia(model)


def inertia(model):
    return float(RigidDynamics.of(model.robot, model.full_theta[: len(model.robot.columns)]).inertia[1])


def torque(t):
    """Torque of the motors, N·m."""
    return np.array([40.0 * np.sin(5.0 * t), 25.0 * np.sin(8.0 * t + 0.5)])


def integrated(model, pull, behind=0.0):
    """Motor positions (N, 2) and x (N,) by scipy, from M and h of the links, and the torque pull(x, u) of the gear."""
    links = replace(model, effects=(), reference=None)
    rotor, drag = (np.array([model.standard[f"{s}{n}"] for n in (1, 2)]) for s in ("Ia", "fv"))
    dry = np.array([model.standard["fc1"], model.standard["fc2"] - behind])
    jacobian = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 1.0]])  # of the links' angles by q and x

    def slope(t, state):
        q, v = state[:3], state[3:]
        turned, speed = jacobian @ q, jacobian @ v
        every = np.vstack([np.zeros(2), np.eye(2)])
        h, *rows = links.inverse_dynamics(np.tile(turned, (3, 1)), np.tile(speed, (3, 1)), every)
        mass = jacobian.T @ (np.array(rows).T - h[:, None]) @ jacobian + np.diag([*rotor, 0.0])
        force = np.append(torque(t) - drag * v[:2] - dry * np.tanh(v[:2] / WIDTH), pull(q[2], v[2]))
        force -= jacobian.T @ (h + np.array([0.0, behind * np.tanh(speed[1] / WIDTH)]))
        return np.concatenate([v, np.linalg.solve(mass, force)])

    start = np.concatenate([HANGING, np.zeros(4)])
    found = solve_ivp(slope, (0.0, SECONDS), start, "LSODA", TIMES, rtol=1e-8, atol=1e-10, max_step=1e-3)
    return found.y[:2].T, found.y[2]


def in_mujoco(path, gear, step=STEP):
    """The same in MuJoCo, with the accelerations of the motors."""
    compiled = mujoco.MjModel.from_xml_path(str(path))
    compiled.opt.timestep, compiled.opt.integrator = step, mujoco.mjtIntegrator.mjINT_RK4
    data = mujoco.MjData(compiled)
    motors = [compiled.joint(n).dofadr[0] for n in ("joint1", "joint2")]
    between, q, x = compiled.joint(gear).dofadr[0], [], []
    data.qpos[motors] = HANGING
    for time in TIMES:
        q.append(data.qpos[motors].copy())
        x.append(data.qpos[between])
        while data.time < time + 0.01 - 0.5 * step:
            data.qfrc_applied[motors] = torque(data.time + 0.5 * step)
            mujoco.mj_step(compiled, data)
    return np.array(q), np.array(x)


@pytest.mark.parametrize("behind", [0.0, 0.5])
def test_an_elastic_gear_moves_as_its_equations_say(behind, tmp_path):
    model = arm(f"elasticity(period={PERIOD}, rubbing={behind})@joint2")
    k = stiffness(model)
    model = replace(model, standard={**model.standard, "ce2": 1 / k, "fc2": 2.0 if behind else 0.0})
    done = export(model, tmp_path / "arm.xml", force=True)
    damping = 2 * SWING_DAMPING * np.sqrt(k * inertia(model))
    q, x = integrated(model, lambda x, u: -k * x - damping * u, behind * model.standard["fc2"])
    there, gear = in_mujoco(done.path, "spring of joint2")
    rigid, _ = in_mujoco(export(without_gear(model), tmp_path / "rigid.xml", force=True).path, "joint2")
    assert np.abs(x).max() > 5e-3  # rad
    # MuJoCo's dry friction is a constraint, that of the integration a steep curve; without it they differ by 1e-6 rad.
    assert np.abs(gear - x).max() < (5e-5 if behind else 1e-6)
    assert np.abs(there - q).max() < (1e-3 if behind else 2e-6)
    assert np.abs(rigid - q).max() > 3e-3


def test_a_gear_with_play_moves_as_its_equations_say(tmp_path):
    model = arm(f"backlash(size={GAP})@joint2", gap2=GAP)
    done = export(model, tmp_path / "arm.xml", force=True)
    wall, link = 1e6, inertia(model)

    def pull(x, u):
        beyond = abs(x) - GAP
        return 0.0 if beyond < 0 else -np.sign(x) * wall * beyond - 2 * np.sqrt(wall * link) * u

    q, x = integrated(model, pull)
    there, gear = in_mujoco(done.path, "play of joint2")
    assert x.max() > 0.9 * GAP
    assert x.min() < -0.9 * GAP
    rigid, _ = in_mujoco(export(without_gear(model), tmp_path / "rigid.xml", force=True).path, "joint2")
    assert np.abs(there - q).max() < 1.5e-4  # rad
    assert np.abs(rigid - q).max() > 3e-3
    assert np.abs(gear).max() < 1.05 * GAP
    assert np.abs(gear - x).max() < 0.1 * GAP


def without_gear(model):
    return replace(model, effects=tuple(e for e in model.effects if e.id not in ("elasticity", "backlash")))


def test_the_effects_torque_is_that_of_the_simulated_arm():
    """To first order: the effect explains nine tenths of the power that the rigid arm leaves."""
    model = arm(f"elasticity(period={PERIOD})@joint2")
    model = replace(model, standard={**model.standard, "ce2": 1 / stiffness(model)}, reference=None)
    compiled = mujoco.MjModel.from_xml_string(mjcf_source(model))
    compiled.opt.timestep, compiled.opt.integrator = 0.0005, mujoco.mjtIntegrator.mjINT_RK4
    data, motors, rows = mujoco.MjData(compiled), [0, 1], []
    data.qpos[motors] = HANGING
    while data.time < 1.5:
        data.qfrc_applied[motors] = torque(data.time) * min(data.time / 0.3, 1.0)  # the first load is that at rest
        mujoco.mj_forward(compiled, data)
        rows.append(np.concatenate([data.qpos[:2], data.qvel[:2], data.qacc[:2], data.qfrc_applied[:2]]))
        mujoco.mj_step(compiled, data)
    q, v, a, tau = np.split(np.array(rows)[::4], 4, axis=1)
    t = 0.002 * np.arange(len(q))

    def left(some):
        Y = Regressor(some.robot, some.effects, dict(model.standard))(t, q, v, a)
        return np.square(tau - np.einsum("ncj,c->nj", Y, some.full_theta))[100:].mean(axis=0)

    assert (left(model) < 0.1 * left(without_gear(model))).all()


def test_the_users_own_file_gets_one_joint_and_says_so(tmp_path):
    text = """<mujoco><compiler angle="degree"/>
    <default><default class="big"><joint axis="0 1 0" damping="9"/></default></default><worldbody>
    <body name="a"><joint name="p" axis="0 1 0"/>
    <inertial pos=".2 0 0" mass="2" diaginertia=".1 .1 .1"/><body name="b" pos=".4 0 0">
      <joint name="q" class="big" pos="0 0 0" stiffness="0"></joint>
    <inertial pos=".2 0 0" mass="1" diaginertia=".05 .05 .05"/></body></body></worldbody>
    <actuator><motor joint="q"/></actuator></mujoco>"""
    own = tmp_path / "own.xml"
    own.write_text(text)
    machine = fr.Robot.load(own)
    effects = parse_effects("viscous, coulomb, rotor_inertia, elasticity@q, backlash@p")
    truth = {"ce2": 1e-3, "gap1": 0.01, "fv1": 0.1, "fv2": 0.1, "fc1": 0.1, "fc2": 0.1, "Ia1": 0.2, "Ia2": 0.2}
    log = fr.simulate(machine, fr.random_fourier(machine, 5, seed=1), rate=100, effects=effects[:3])
    model = fr.identify(machine, [log], effects=effects[:3], recursion="none").model
    model = fr.make_consistent(model).model
    model = replace(model, effects=effects, standard={**model.standard, **truth}, prior=None)
    done = export(model, tmp_path / "new.xml", into=own)
    compiled = mujoco.MjModel.from_xml_path(str(done.path))
    spring, play = compiled.joint("spring of q"), compiled.joint("play of p")
    assert (spring.stiffness[0], compiled.nq, compiled.nu) == (pytest.approx(1e3), 4, 1)
    assert spring.axis == pytest.approx([0, 1, 0])
    assert compiled.dof_damping[spring.dofadr[0]] == pytest.approx(2 * SWING_DAMPING * np.sqrt(1e3 * 0.09), rel=0.3)
    assert play.range == pytest.approx([-0.01, 0.01])
    assert compiled.dof_damping[play.dofadr[0]] == 0.0
    assert compiled.actuator_trnid[0, 0] == compiled.joint("q").id
    assert any("added joints" in note and "spring of q, play of p" in note for note in done.notes)
    own.write_text(text.replace("<actuator>", '<keyframe><key qpos="0 0"/></keyframe><actuator>'))
    with pytest.raises(InputError, match="holds one position for each joint"):
        export(model, tmp_path / "new.xml", into=own)


def test_two_gears_in_a_row_and_motors_without_inertia_have_an_armature(tmp_path):
    effects = parse_effects("elasticity(period=0.1)@joint2, backlash@joint2")
    model = with_effects("planar2", effects)
    model = replace(model, standard={**model.standard, "ce2": 1e-3, "gap2": 0.003})
    done = export(model, tmp_path / "arm.xml", force=True)
    compiled = mujoco.MjModel.from_xml_path(str(done.path))
    data = mujoco.MjData(compiled)
    mujoco.mj_step(compiled, data, 2000)
    assert np.isfinite(data.qpos).all()
    assert data.warning[mujoco.mjtWarning.mjWARN_BADQACC].number == 0
    assert [note for note in done.notes if note.startswith("armature of joint2: 1 % of the link's inertia")]


def test_a_gear_that_cannot_be_is_left_out_and_said():
    model = with_effects("planar2", parse_effects("elasticity@joint1, backlash@joint2"))
    model = replace(model, standard={**model.standard, "ce1": -1e-3, "gap2": 0.003})
    assert left_out(model, "MJCF") == ("elasticity(period=0, rubbing=0)@joint1",)
    model = replace(model, standard={**model.standard, "ce1": 0.0})
    assert left_out(model, "MJCF") == ()
    assert {"elasticity", "backlash"} <= set(exportable(model, "mjcf"))
