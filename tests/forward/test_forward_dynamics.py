"""Forward dynamics against the model's own inverse dynamics, against conservation of energy, and at standstill."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from cases import exact_log, quick, random_values, robot

import frischid as fr
from frischid.effects import EFFECTS, parse_effects
from frischid.errors import InputError
from frischid.forward.forward_dynamics import ForwardDynamics
from frischid.forward.simulated_motion import Starts
from frischid.forward.torque_sources import PositionController, RecordedTorque, TorqueFunction
from frischid.motions.simulation import parameters_of

SIMULATED = (
    "viscous", "coulomb", "offset", "rotor_inertia", "cogging(order=3)", "joint_coupling", "stribeck",
    "quadratic_viscous", "cubic_viscous", "asymmetric_viscous", "asymmetric_coulomb(width=0.005)", "load_friction",
    "load_stribeck", "position_friction", "thermal_drift", "joint_spring", "counterbalance", "gear_play", "payload",
    "gravity_tilt", "drive_gain", "encoder_zero", "formula",
)  # fmt: skip


WITH_MEMORY = ("hysteresis(distance=0.01), coulomb", "cable_hose", "time_delay(size=0.004)")


@cache
def rigid_of(machine):
    """A model of the links alone."""
    return quick(machine, [exact_log(machine, (), noise=fr.Noise(tau=1e-3))], effects=(), prior="none").model


def moderate(machine, effects):
    """Values of the effects: a tenth of a newton metre, and of effects of the load at most a tenth of the load."""
    values = random_values(machine, effects)
    loaded = any(e.loaded for e in effects)
    return {k: min(0.1 * x, 0.1) if loaded else 0.1 * x for k, x in values.items()}


def model_of(machine, effects, values=None):
    """The true model of a simulated robot."""
    plain = rigid_of(machine)
    names = [c.name for c in (*machine.columns, *(c for e in effects for c in e.columns(machine)))]
    truth = dict(zip(names, parameters_of(machine, effects, values).tolist(), strict=True))
    return replace(
        plain, effects=tuple(effects), standard=dict(zip(machine.all_names, machine.nominal, strict=True)) | truth
    )


@pytest.mark.parametrize("name", ["planar2", "ur10", "ur10 far_end tilted", "mixed mimic", "kinova continuous"])
@pytest.mark.parametrize("text", ["viscous", "rotor_inertia", *SIMULATED[4:]])
def test_acceleration_is_the_inverse_of_the_models_torque(name, text):
    machine, effects = robot(name), parse_effects(text)
    values = moderate(machine, effects)
    model = model_of(machine, effects, values)
    motion = fr.random_fourier(machine, 4.0, seed=5)
    t = np.array([0.0, 0.7, 1.3, 2.1, 3.2])
    q, v, a = motion(t)
    v = np.where(abs(v) < 0.1, 0.1, v)  # far from the smoothed sign of the model
    tau = model.inverse_dynamics(q, v, a, t)
    found = ForwardDynamics(model).acceleration(q, v, tau, t)
    np.testing.assert_allclose(found, a, atol=2e-3 * np.abs(a).max())


@pytest.mark.parametrize("text", [*SIMULATED, *WITH_MEMORY])
@pytest.mark.parametrize("name", ["planar2", "mixed mimic"])
def test_simulation_returns_the_trajectory_whose_torque_was_predicted(name, text):
    machine, effects = robot(name), parse_effects(text)
    values = moderate(machine, effects)
    if "time_delay" in text:
        values = {"delay": 0.004}
    model = model_of(machine, effects, values)
    motion = fr.random_fourier(machine, 4.0, seed=5)
    t = np.arange(0, 4.0, 0.001)
    tau = model.inverse_dynamics(*motion(t), t)
    start, part = 1000, slice(1000, 1400)
    q, v, _ = motion(t)
    forward = ForwardDynamics(model)
    starts = Starts(q[[start]], v[[start]], t[[start]], remembered=forward.remembered(t, v, np.array([start])))
    found = forward.simulate(RecordedTorque(t, tau), starts, t[part] - t[start])
    assert np.abs(found.q[0] - q[part]).max() < 0.004 * np.ptp(q[part], axis=0).max()


def pendulum(**values):
    """A double pendulum that hangs, with friction as given."""
    machine = fr.Robot.load("planar2", gravity=(9.81, 0.0, 0.0))
    return model_of(
        machine, parse_effects("viscous, coulomb"), {"fv1": 0.0, "fv2": 0.0, "fc1": 0.0, "fc2": 0.0} | values
    )


def free(t, q, v):
    return np.zeros_like(q)


def test_a_pendulum_without_friction_keeps_its_energy():
    model = pendulum()
    forward, machine = ForwardDynamics(model), model.robot
    t = np.linspace(0.0, 10.0, 201)
    found = forward.simulate(TorqueFunction(free), Starts([[-0.5, 0.4]], [[0.0, 0.0]]), t)
    q, v = found.q[0], found.v[0]
    kinetic = 0.5 * np.einsum("ni,nij,nj->n", v, forward.mass_matrix(q), v)
    # the power of the weight is −g(q)·v, integrated by fine steps
    fine = forward.simulate(TorqueFunction(free), Starts([[-0.5, 0.4]], [[0.0, 0.0]]), np.linspace(0, 10, 10001))
    weight = machine.inverse_dynamics(fine.q[0], 0 * fine.q[0], 0 * fine.q[0])
    power = np.einsum("nj,nj->n", weight, fine.v[0])
    potential = np.append(0.0, np.cumsum(0.5 * (power[1:] + power[:-1]) * 0.001))[::50]
    assert np.ptp(kinetic) > 1.0
    np.testing.assert_allclose(kinetic + potential, 0.0, atol=1e-3 * kinetic.max())


def test_a_joint_that_friction_holds_rests_exactly():
    model = pendulum(fc1=200.0, fc2=200.0, fv1=1.0, fv2=1.0)
    t = np.linspace(0.0, 3.0, 61)
    found = ForwardDynamics(model).simulate(
        TorqueFunction(free), Starts([[0.3, 0.2]] * 2, [[0.0, 0.0], [2.0, -3.0]]), t
    )
    np.testing.assert_array_equal(found.q[0], np.broadcast_to([0.3, 0.2], (61, 2)))
    np.testing.assert_array_equal(found.v[1, -20:], 0.0)
    np.testing.assert_array_equal(found.q[1, -20:], np.broadcast_to(found.q[1, -1], (20, 2)))


def test_one_joint_rests_while_the_other_moves():
    model = pendulum(fc1=300.0, fc2=0.0)
    found = ForwardDynamics(model).simulate(
        TorqueFunction(free), Starts([[0.3, 0.5]], [[0.0, 0.0]]), np.linspace(0, 2, 41)
    )
    assert np.ptp(found.q[0, :, 0]) == 0.0
    assert np.ptp(found.q[0, :, 1]) > 0.5


def test_many_robots_move_as_each_alone():
    model = pendulum(fc1=3.0, fc2=1.0, fv1=0.5)
    forward, rng, t = ForwardDynamics(model), np.random.default_rng(3), np.linspace(0, 1, 11)
    q, v = rng.normal(size=(2, 5, 2))
    together = forward.simulate(TorqueFunction(free), Starts(q, v), t)
    for k in range(5):
        alone = forward.simulate(TorqueFunction(free), Starts(q[[k]], v[[k]]), t)
        np.testing.assert_allclose(together.q[k], alone.q[0], atol=1e-12)


def test_a_controller_reaches_its_command_and_delay_makes_it_swing():
    model = pendulum(fv1=1.0, fv2=1.0)
    target, t = np.array([[0.4, -0.3]] * 2), np.linspace(0, 4, 401)
    weight = model.robot.inverse_dynamics(target[:1], 0 * target[:1], 0 * target[:1])
    swings = []
    for delay in (0.0, 0.02):
        hold = PositionController(
            np.array([0.0, 4.0]), target, kp=400.0, kd=40.0, feedforward=np.repeat(weight, 2, 0), delay=delay
        )
        found = ForwardDynamics(model).simulate(hold, Starts([[0.0, 0.0]], [[0.0, 0.0]]), t)
        swings.append(np.abs(found.v[0, 100:]).max())
        if not delay:
            np.testing.assert_allclose(found.q[0, -1], target[0], atol=1e-3)
    assert swings[1] > swings[0]


def test_the_delay_does_not_depend_on_the_times_that_are_asked_for():
    """It counted the steps before as long as the last one, and the times asked for cut some steps short."""
    model, t = pendulum(fv1=1.0, fv2=1.0), np.arange(0.0, 4.0, 0.01)
    wave = np.column_stack([0.5 * np.sin(3 * t), 0.4 * np.sin(4 * t)])
    late = PositionController(t, wave, np.array([300.0, 100.0]), np.array([30.0, 8.0]), delay=0.02)
    start, even = Starts([[0.0, 0.0]], [[1.5, 1.6]]), np.linspace(0.0, 2.0, 201)
    uneven = np.unique(np.append(even, even[:-1] + 1e-4))
    first, other = (ForwardDynamics(model).simulate(late, start, times).q[0] for times in (even, uneven))
    np.testing.assert_allclose(other[np.searchsorted(uneven, even - 1e-9)], first, atol=5e-4)


def test_an_unstable_loop_is_marked_and_not_nan_before():
    model = pendulum()
    wrong = PositionController(np.array([0.0, 4.0]), np.ones((2, 2)), kp=-1e4, kd=-1e3)
    found = ForwardDynamics(model).simulate(wrong, Starts([[0.0, 0.0]], [[0.0, 0.0]]), np.linspace(0, 4, 41))
    assert np.isfinite(found.unstable[0])
    assert np.isfinite(found.q[0][found.t < found.unstable[0]]).all()


@pytest.mark.parametrize("name", [n for n, kind in EFFECTS.items() if kind.memory])
def test_an_effect_is_simulated_or_refused_by_name(name):
    machine = robot("planar2")
    model = model_of(machine, parse_effects(name), random_values(machine, parse_effects(name)))
    if name in ("hysteresis", "cable_hose", "time_delay"):
        ForwardDynamics(model)
        return
    with pytest.raises(InputError, match=name):
        ForwardDynamics(model)


def test_a_mass_matrix_that_is_not_positive_definite_is_named():
    model = pendulum()
    bad = replace(model, standard=dict(model.standard) | {"Izz2": -5.0})
    with pytest.raises(InputError, match=r"not positive definite.*joint2"):
        ForwardDynamics(bad).simulate(TorqueFunction(free), Starts([[0.0, 0.0]], [[0.0, 0.0]]), np.array([0.0, 0.1]))


def test_joints_without_torque_are_named():
    machine = robot("planar2")
    model = quick(machine, [exact_log(machine, ())], effects=(), prior="none", torque_joints=["joint1"]).model
    with pytest.raises(InputError, match="joint2"):
        ForwardDynamics(model)


SOURCE = RecordedTorque([0.0, 1.0], [[0.0, 0.0], [0.0, 0.0]])
START = Starts([[0.0, 0.0]], [[0.0, 0.0]])


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda f: f.acceleration(np.zeros((3, 2)), np.zeros((3, 2)), np.ones((3, 1))), r"tau has the shape \(3, 1\)"),
        (lambda f: f.acceleration(np.zeros((3, 2)), np.zeros((3, 2)), np.zeros((3, 2)), 0), r"t has the shape \(\)"),
        (lambda f: f.mass_matrix(np.zeros((3, 3))), r"q has the shape \(3, 3\); expected \(3, 2\)"),
        (lambda f: f.mass_matrix(np.zeros((3, 2)), which=1), "one of the 1 sets of parameters"),
        (lambda f: f.simulate(SOURCE, START, [0.0, 0.2, 0.1]), "must begin with 0 and increase"),
        (lambda f: f.simulate(SOURCE, START, []), "must begin with 0 and increase"),
        (lambda f: f.simulate(SOURCE, Starts([[0.0, np.nan]], [[0.0, 0.0]]), [0.0, 0.1]), "q = nan at joint2"),
        (lambda f: f.simulate(RecordedTorque([0, 1], [[1], [1]]), START, [0.0, 0.1]), r"gives the shape \(1, 1\)"),
        (lambda f: ForwardDynamics(f.model, np.zeros(3)), r"theta has the shape \(1, 3\)"),
    ],
)  # fmt: skip
def test_arrays_of_another_shape_are_refused_and_not_broadcast(call, words):
    forward = ForwardDynamics(model_of(robot("planar2"), ()))
    with pytest.raises(InputError, match=words):
        call(forward)


def test_lists_are_arrays_and_one_state_is_a_row():
    forward = ForwardDynamics(model_of(robot("planar2"), ()))
    assert forward.mass_matrix([0, 0]).shape == (1, 2, 2)
    assert forward.acceleration([0, 0], [0, 0], [0, 0]).shape == (1, 2)
    hold = PositionController([0, 1], [[0, 0], [0, 0]], kp=[10, 1], kd=1)
    assert forward.simulate(hold, START, [0, 0.1]).q.shape == (1, 2, 2)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"kp": np.nan}, "kp of a controller must be finite"),
        ({"v_cmd": np.zeros((2, 1))}, r"v_cmd must have the shape \(2, 2\) of q_cmd"),
        ({"q_cmd": [[0.0, 0.0], [0.0, np.nan]]}, "q_cmd of a controller is nan at row 1, joint 1"),
        ({"t": [0.0, 0.0]}, "at increasing times"),
    ],
)
def test_a_controller_that_gives_no_number_is_refused(wrong, words):
    with pytest.raises(InputError, match=words):
        PositionController(**{"t": [0.0, 1.0], "q_cmd": np.zeros((2, 2)), "kp": 1.0, "kd": 1.0} | wrong)
