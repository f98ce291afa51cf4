"""The catalogue: complete pages, columns that are what physics says, and text that reads back as it was written."""

import json
import re
from dataclasses import replace
from functools import cache

import numpy as np
import pinocchio as pin
import pytest
from cases import ROBOTS, commands_of, made, random_values, robot, serial_arms, states
from hypothesis import given
from hypothesis import strategies as st

from frischid.effects import (
    EFFECTS,
    Backlash,
    Coulomb,
    DriveGain,
    Elasticity,
    EncoderZero,
    Formula,
    GearPlay,
    GravityTilt,
    Hysteresis,
    JointCoupling,
    LoadFriction,
    LoadStribeck,
    Payload,
    PositionFriction,
    SelfHeating,
    State,
    Stribeck,
    ThermalDrift,
    TimeDelay,
    effect_from_dict,
    parse_effects,
)
from frischid.effects.dynamics import RigidDynamics
from frischid.effects.friction_memory import presliding
from frischid.effects.link_lag import SWING_DAMPING, TOGETHER_FROM, Gear, lags
from frischid.effects.self_heating import heat
from frischid.effects.state import SIGN_WIDTH
from frischid.effects.symbols import symbols_of
from frischid.effects.units import TORQUE_UNITS
from frischid.errors import InputError, UnknownNameError
from frischid.motions.trajectory import random_fourier
from frischid.regression.regressor import Regressor
from frischid.regression.structure import structure
from frischid.robot.robot import Robot

every_robot = pytest.mark.parametrize("name", ROBOTS)
every_effect = pytest.mark.parametrize("kind", EFFECTS.values(), ids=EFFECTS)


def motion(machine, seconds=4.0, rate=200.0, reference=None, seed=1, **channels):
    """A smooth motion as effects see it, with the load of the URDF's own parameters or of `reference`."""
    t = np.arange(0.0, seconds, 1 / rate)
    q, v, a = random_fourier(machine, seconds, seed=seed)(t)
    load = RigidDynamics.of(machine, reference).torque(q, v, a)
    return State(machine, t, q, v, a, load, load + 0.3 * v, 0.0, commands_of(machine, q) | channels, reference)


def column(effect, state, number=0):
    """One column as an array (N, J)."""
    out = np.zeros(state.q.shape)
    for joint, values in effect.terms(state)[number].rows.items():
        out[:, joint] = values
    return out


# ---- the catalogue


@every_effect
def test_every_page_is_complete(kind):
    for text in (kind.title, kind.equation, kind.sentence, kind.looks_like, kind.confirmed_by, kind.reference):
        assert len(text) > 2
    kind.sentence.format(joint="joint 1", joints="joint 1 and joint 2")
    assert "{joint" in kind.sentence
    assert any(character.isdigit() for character in kind.reference), "a source has a year"
    assert kind.confused_with
    assert set(kind.confused_with) <= set(EFFECTS) - {kind.id}
    assert EFFECTS[kind.id] is kind
    assert set(kind.shapes) <= set(kind().parameters)
    for values in kind.shapes.values():
        assert list(values) == sorted(set(values)), "the diagnosis refines between neighbours"
    numbers = {k for k, v in kind().parameters.items() if isinstance(v, float)}
    assert set(kind.units) == numbers - {"rubbing", "exponent", "ratio"}, "what is no pure number has a unit"


def test_the_unit_of_a_shape_is_that_of_the_joint():
    machine = robot("mixed mimic")
    turns, slides = (next(n for n, p in zip(machine.joints, machine.prismatic, strict=True) if p == s) for s in (0, 1))
    assert Hysteresis().unit("distance") == "rad (m)"
    assert Hysteresis().unit("distance", machine) == "rad (m)"
    assert Hysteresis(joints=(turns,)).unit("distance", machine) == "rad"
    assert Hysteresis(joints=(slides,)).unit("width", machine) == "m/s"
    assert ThermalDrift().unit("constant", machine) == "s"
    assert Stribeck().unit("exponent") == ""


def test_names_are_unique_across_the_catalogue():
    for machine in (robot("ur10"), robot("mixed mimic")):
        kinds = [kind() for kind in EFFECTS.values() if kind is not Payload]
        effects = [*kinds, Payload(full=True), ThermalDrift(by="temperature")]
        names = {}
        for effect in effects:
            for c in effect.columns(machine):
                names.setdefault(c.name, set()).add(effect.id)
        assert all(len(owners) == 1 for owners in names.values())
        assert not set(names) & set(machine.all_names)


@every_effect
@every_robot
def test_columns_are_the_same_with_and_without_samples(name, kind):
    machine = robot(name)
    q, v, a = states(machine, 7)
    load = machine.inverse_dynamics(q, v, a)
    state = State(machine, 0.1 * np.arange(7), q, v, a, load, load, extra=commands_of(machine, q))
    for alternatives in [[kind()], *kind.candidates(machine)]:
        for effect in alternatives[:: max(1, len(alternatives) // 3)]:
            terms = effect.terms(state)
            assert [term.column for term in terms] == effect.columns(machine)
            assert effect.nominal(machine) == [
                x if kind.id in {"viscous", "coulomb"} else 0.0 for x in effect.nominal(machine)
            ]
            for term in terms:
                assert term.rows
                for values in term.rows.values():
                    assert values.shape == (7,)
                    assert np.isfinite(values).all()


@every_effect
@every_robot
def test_a_change_of_an_effect_has_the_same_columns_under_names_of_its_own(name, kind):
    machine = robot(name)
    q, v, a = states(machine, 7)
    load = machine.inverse_dynamics(q, v, a)
    state = State(machine, 0.1 * np.arange(7), q, v, a, load, load, extra=commands_of(machine, q))
    effect = next((shapes[0] for shapes in kind.candidates(machine)), kind())
    change = replace(effect, changed=1)
    assert parse_effects(str(change)) == (change,)
    assert effect_from_dict(change.to_dict()) == change != effect
    assert change.parameters == effect.parameters
    for one, other in zip(effect.terms(state), change.terms(state), strict=True):
        assert other.column == replace(one.column, name=f"d{one.column.name}", sign=0)
        assert one.rows.keys() == other.rows.keys()
        assert all((one.rows[row] == other.rows[row]).all() for row in one.rows)


@every_effect
def test_what_comes_with_an_effect_after_a_change_is_a_change(kind):
    assert all(EFFECTS[name].change for name in kind.after_change)
    assert not kind.change or not kind.after_change


@pytest.mark.parametrize("name", serial_arms())
def test_the_catalogue_fits_every_arm(name):
    machine = Robot.load(name)
    state = motion(machine, seconds=1.0)
    for kind in EFFECTS.values():
        for term in kind().terms(state):
            assert term.column.unit
            assert all(np.isfinite(values).all() for values in term.rows.values())


@every_effect
def test_one_joint_alone(kind):
    machine = robot("planar2").keep(["joint2"])
    state = motion(machine)
    for term in kind().terms(state):
        assert list(term.rows) == [0]
    for alternatives in kind.candidates(machine):
        assert all(effect.terms(state) for effect in alternatives if not effect.channels(machine))


def test_a_log_without_commands_is_named():
    state = replace(motion(robot("planar2")), extra={})
    with pytest.raises(InputError, match=r"controller_push_rate_joint1.*log of commands"):
        EFFECTS["command_delay"]().terms(state)


def test_sliding_joints_have_units_of_force():
    machine = robot("mixed mimic")
    assert Stribeck(("slide",)).columns(machine)[0].unit == "N"
    assert Elasticity(("slide",)).columns(machine)[0].unit == "m/N"
    assert EFFECTS["joint_spring"](("slide",), form="cubic").columns(machine)[2].unit == "N/m³"
    assert all(len(pair) == 2 for pair in TORQUE_UNITS.values())


@every_effect
def test_shape_parameters_are_checked(kind):
    for name, value in kind().parameters.items():
        if isinstance(value, bool):
            continue
        for wrong in ("nonsense!", None, float("nan")):
            with pytest.raises(InputError, match=name if name != "by" else "source"):
                kind(**{name: wrong})
    with pytest.raises(UnknownNameError, match="elbo"):
        kind(joints=("elbo", "wrist")).columns(robot("ur10"))


# ---- friction


def test_presliding_loops_close_and_do_not_know_the_speed():
    t = np.linspace(0.0, 8 * np.pi, 8001)
    z = presliding(t, 0.02 * np.cos(t), 0.01)
    np.testing.assert_allclose(z[-2000:], z[-4000:-2000], atol=1e-4)
    np.testing.assert_allclose(presliding(t / 3, 0.06 * np.cos(t), 0.01), z, atol=1e-12)
    assert np.abs(z).max() <= 1.0


@pytest.mark.parametrize(("noise", "distance"), [(0.0, 0.0005), (1e-3, 0.002), (0.3, 0.02)])
def test_presliding_is_the_recursion_sample_by_sample(noise, distance):
    t = np.arange(4000) / 500
    v = np.sin(3 * t) + noise * np.random.default_rng(0).normal(size=len(t))
    v[1000:1500] = 0.0
    z = [float(np.sign(v[np.abs(v) > SIGN_WIDTH][0]))]
    started = np.argmax(np.abs(v) > SIGN_WIDTH)
    for k, path in enumerate(0.5 * (v[1:] + v[:-1]) * np.diff(t)):
        side = np.sign(path) if k >= started else 0.0
        z.append(side - (side - z[-1]) * np.exp(-abs(path) * (k >= started) / distance))
    np.testing.assert_allclose(presliding(t, v, distance), z, atol=1e-10)


def test_presliding_is_dahls_solution():
    t = np.linspace(0.0, 2.0, 2001)
    v = np.where(t < 1.0, 0.1, -0.1)
    z = presliding(t, v, 0.02)
    np.testing.assert_array_equal(z[:1000], 1.0)
    path = 0.1 * (t[1001:] - t[1000])
    np.testing.assert_allclose(z[1001:], -1.0 + 2.0 * np.exp(-path / 0.02), rtol=1e-9)


def test_hysteresis_of_no_distance_is_coulomb_friction():
    state = motion(robot("ur10"))
    memory = column(Hysteresis(distance=1e-7), state, 2)
    moving = np.abs(state.v[:, 2]) > 0.05
    assert np.abs(memory[moving]).max() < 1e-6
    assert np.abs(column(Hysteresis(distance=0.1), state, 2)[moving]).max() > 0.5


def test_stribeck_is_coulomb_near_rest_and_gone_at_speed():
    machine = robot("planar2")
    v = np.array([[0.0, 0.0], [0.02, -0.02], [1.0, -1.0]])
    state = State(machine, np.arange(3.0), v, v, v, v, v)
    curve = column(Stribeck(("joint2",), speed=0.2, exponent=1.0), state)[:, 1]
    np.testing.assert_allclose(curve, [0.0, -np.tanh(4.0) * np.exp(-0.1), -np.exp(-5.0)])


def test_friction_follows_a_temperature_channel():
    warm = np.linspace(25.0, 45.0, 800)
    state = motion(robot("planar2"), temperature_joint1=warm)
    effect = ThermalDrift(("joint1",), by="temperature")
    assert effect.channels(state.robot) == ("temperature_joint1",)
    np.testing.assert_allclose(column(effect, state)[:, 0], state.v[:, 0] * (warm - 25.0))
    with pytest.raises(UnknownNameError, match="temperature_joint2"):
        ThermalDrift(("joint2",), by="temperature").terms(state)
    with pytest.raises(UnknownNameError, match="temperature"):
        ThermalDrift(by="heat")


def test_drift_counts_from_the_beginning_of_the_log():
    state = motion(robot("planar2"))
    late = replace(state, t=state.t + 100.0, start=100.0)
    for k in range(4):
        np.testing.assert_allclose(column(ThermalDrift(), state, k), column(ThermalDrift(), late, k), atol=1e-13)


# ---- coupling


def test_coupled_joints_share_the_power_of_their_motor():
    state = motion(robot("ur10"))
    effect = JointCoupling(("wrist_2_joint", "wrist_3_joint"), ratio=-1.0)
    speed = state.v[:, 4] - state.v[:, 5]
    for k, torque in enumerate((speed, np.tanh(speed / 0.005), state.a[:, 4] - state.a[:, 5])):
        rows = column(effect, state, k)
        np.testing.assert_allclose((rows * state.v).sum(axis=1), torque * speed, atol=1e-12)
        assert not rows[:, :4].any()
    assert [c.name for c in effect.columns(state.robot)] == ["fvm5_m6", "fcm5_m6", "Iam5_m6"]


def test_a_screw_couples_a_turning_and_a_sliding_joint_where_they_are_named():
    """The splined screw of a SCARA: its nut's motor turns with both joints. The pair had been refused."""
    state, lead = motion(robot("mixed mimic")), 0.02
    turn, slide = (state.robot.joints.index(name) for name in ("turn", "slide"))
    effect = JointCoupling(("turn", "slide"), ratio=2 * np.pi / lead)
    nut = state.v[:, turn] + 2 * np.pi / lead * state.v[:, slide]  # rad/s
    rows = column(effect, state, 0)
    np.testing.assert_allclose((rows * state.v).sum(axis=1), nut**2, rtol=1e-10)
    assert [c.unit for c in effect.columns(state.robot)] == ["N·m·s/rad", "N·m", "kg·m²"]
    assert [c.unit for c in JointCoupling(("slide", "turn")).columns(state.robot)] == ["N·s/m", "N", "kg"]


def test_the_ratio_of_a_coupling_is_that_of_the_joint_named_second():
    state = motion(robot("ur10"))
    effect = JointCoupling(("wrist_3_joint", "wrist_2_joint"), ratio=3.0)
    assert [c.name for c in effect.columns(state.robot)] == ["fvm6_5", "fcm6_5", "Iam6_5"]
    speed = state.v[:, 5] + 3.0 * state.v[:, 4]
    rows = column(effect, state, 0)
    np.testing.assert_allclose(rows[:, 5], speed, atol=1e-12)
    np.testing.assert_allclose(rows[:, 4], 3.0 * speed, atol=1e-12)


def test_pairs_of_joints():
    machine = robot("mixed mimic")
    assert JointCoupling().pairs(machine) == [("turn", "elbow")]
    assert JointCoupling(("turn", "slide", "elbow")).pairs(machine) == [("turn", "elbow")]
    for joints in (("turn",), (), ("turn", "turn")):
        with pytest.raises(InputError, match="two joints"):
            JointCoupling(joints)
    assert JointCoupling(("turn", "slide")).pairs(machine) == [("turn", "slide")]


# ---- where the links are


@every_robot
def test_slopes_are_derivatives_of_the_torque(name):
    machine = robot(name)
    rng = np.random.default_rng(3)
    # arbitrary parameters, masses of zero among them: as identified base parameters are
    theta = rng.normal(size=len(machine.columns)) * rng.integers(0, 2, len(machine.columns))
    rigid = RigidDynamics.of(machine, theta)
    q, v, a = states(machine, 4)
    Y = np.empty((4, len(machine.columns), len(machine.joints)))
    machine.regressor(q, v, a, Y)
    known = machine.known_torque(q, v, a)
    expected = np.einsum("ncj,c->nj", Y, theta) + (0.0 if known is None else known)
    size = np.abs(expected).max()
    np.testing.assert_allclose(rigid.torque(q, v, a), expected, atol=1e-10 * size)
    h = 1e-5
    for j, step in enumerate(h * np.eye(len(machine.joints))):
        moved = (
            ((q + step, v, a), (q - step, v, a)),
            ((q, v + step, a), (q, v - step, a)),
            ((q, v, a + step), (q, v, a - step)),
        )
        for slope, (up, down) in zip(rigid.slopes(q, v, a), moved, strict=True):
            np.testing.assert_allclose(
                slope[:, :, j], (rigid.torque(*up) - rigid.torque(*down)) / (2 * h), atol=1e-5 * size
            )


def elastic_torque(machine, compliance, state):
    """What the motors feel, and their motion, when the links make the given motion: θ = q + load·compliance."""
    lag = state.load * compliance
    first, second = state.rates(lag)
    theta = replace(state, q=state.q + lag, v=state.v + first, a=state.a + second)
    return state.load, replace(theta, load=machine.inverse_dynamics(theta.q, theta.v, theta.a))


@pytest.mark.parametrize("name", ["planar2", "ur10", "mixed mimic"])
def test_elasticity_is_the_first_order_of_links_behind_springs(name):
    machine = robot(name)
    left = []
    for compliance in (2e-5, 1e-5):
        torque, seen = elastic_torque(machine, compliance, motion(machine))
        terms = Elasticity().terms(seen)
        first = np.zeros_like(torque)
        for term in terms:
            for j, values in term.rows.items():
                first[:, j] += compliance * values
        inside = slice(20, -20)
        left.append(np.abs(torque - seen.load - first)[inside].max() / np.abs(torque - seen.load)[inside].max())
    assert left[1] < 0.02
    assert left[1] < 0.6 * left[0], "the rest is of second order"


def on_the_table(t, speed, load, dry=0.0):
    """The planar arm's second joint without weight, its motor at a speed, its link under a load besides its inertia."""
    machine = Robot.from_dict({**robot("planar2").to_dict(), "gravity": (0.0, 0.0, 0.0)})
    still, second = np.zeros((len(t), 2)), np.array([0.0, 1.0])
    inertia = RigidDynamics.of(machine).inertia[1]
    v, a = (np.outer(x, second) for x in (speed, np.gradient(speed, t)))
    pull = np.outer(load, second) + inertia * a
    return State(machine, t, still, v, still, pull, pull, dry=dry * second), inertia


@pytest.mark.parametrize("rate", [1000.0, 150.0])
def test_a_link_falls_across_its_play(rate):
    t, gap = np.arange(0.0, 2.0, 1 / rate), 2e-3
    state, inertia = on_the_table(t, 0.0 * t, 0.05 * (t - 1.0))
    ((place, _, _, felt),) = lags(state, [Gear(1, 0.0, gap=gap)])
    # δ̈ = c s / M from rest at −gap, until gap
    fall = -gap + 0.05 / inertia * np.maximum(t - 1.0, 0.0) ** 3 / 6
    assert fall[-1] > gap
    away = np.abs(fall - gap) > 0.1 * gap  # the spline through the stop rounds it
    np.testing.assert_allclose(gap * place[away], np.minimum(fall, gap)[away], atol=0.03 * gap)
    assert not felt.any()
    state, _ = on_the_table(t, 0.0 * t, 1.0 + 0.0 * t)
    ((place, *_),) = lags(state, [Gear(1, 0.0, gap=gap)])
    np.testing.assert_allclose(place, 1.0)


SPEED = 0.1


def turning_back(t):
    """Speed of a motor that turns back at t = 0, slowly, and its angle from there."""
    return -SPEED * np.tanh(t), -SPEED * np.log(np.cosh(t))


def test_friction_holds_a_link_while_its_motor_crosses_the_play():
    t, gap, dry = np.arange(-2.0, 2.5, 0.005), 0.02, 0.3
    v, angle = turning_back(t)
    state, _ = on_the_table(t, v, 0.0 * t, dry)
    ((place, _, _, felt),) = lags(state, [Gear(1, 0.5, gap=gap)])
    held, after = (t > 0.02) & (angle > -1.9 * gap), (t > 0) & (angle < -2.3 * gap)
    np.testing.assert_allclose(place[t < -0.02], 1.0, atol=1e-3)
    np.testing.assert_allclose(gap * place[held], (gap + angle)[held], atol=1e-4)
    np.testing.assert_allclose(place[after], -1.0, atol=1e-3)
    # Meanwhile the motor, which turns backward, does not have the link's friction to overcome.
    np.testing.assert_allclose(gap * felt[held & (t > 0.2)], 0.5 * dry, rtol=1e-3)
    assert np.abs(gap * felt[(t < -0.2) | after]).max() < 1e-3 * dry


def test_a_spring_winds_up_before_a_link_that_rubs_turns_back():
    t, dry, period = np.arange(-2.0, 2.0, 0.005), 0.3, 0.4
    v, _ = turning_back(t)
    state, inertia = on_the_table(t, v, 0.0 * t, dry)
    ((torque, _, _, felt),) = lags(state, [Gear(1, 1.0, period=period)])
    stiffness = (2 * np.pi / period) ** 2 * inertia
    forward, held = (t > -1.0) & (t < -0.2), (t > 0.06) & (t < 0.2)
    np.testing.assert_allclose(torque[forward], (dry + state.load[:, 1])[forward], atol=0.05 * dry)
    np.testing.assert_allclose(np.gradient(torque, t)[held], (stiffness * v)[held], rtol=0.02)
    assert torque[-200:].mean() == pytest.approx(-dry, rel=0.1)
    # Instead of friction that has turned with the motor it feels what spring and damper carry.
    carried = torque + 2 * SWING_DAMPING * 2 * np.pi / period * inertia * v
    np.testing.assert_allclose((felt / stiffness + dry * np.tanh(v / SIGN_WIDTH))[held], carried[held], atol=0.02 * dry)


def test_noise_at_the_beginning_starts_no_swing():
    t, noise = np.arange(0.0, 3.0, 0.004), 0.1
    state, _ = on_the_table(t, 0.0 * t, np.random.default_rng(0).normal(0.0, noise, len(t)))
    ((torque, *_),) = lags(state, [Gear(1, 0.0, period=0.3)])
    assert torque.std() < noise


def test_many_links_move_as_each_alone():
    state = replace(motion(robot("ur10"), seconds=1.0), dry=np.full(6, 2.0))
    gears = [Gear(i, 0.4, period=0.05 * (k + 2)) for i in range(6) for k in range(3)]
    gears += [Gear(i, 0.5, gap=1e-3 * (i + k + 1)) for i in range(6) for k in range(3)]
    assert len(gears) >= TOGETHER_FROM
    for together, gear in zip(lags(state, gears), gears, strict=True):
        (alone,) = lags(state, [gear])
        np.testing.assert_allclose(together, alone, rtol=1e-9, atol=1e-12)
    for count in range(5):
        short = replace(state, **{n: getattr(state, n)[:count] for n in ("t", "q", "v", "a", "load", "torque")})
        for found in lags(short, gears):
            assert np.isfinite(found).all()
            assert np.shape(found) == (4, count)


def test_backlash_is_silent_while_the_load_keeps_its_side():
    state = motion(robot("planar2"))
    state = replace(state, load=state.load - np.median(state.load, axis=0))
    turns = np.diff(np.sign(state.load[:, 1]), prepend=0.0) != 0
    near = np.convolve(turns, np.ones(31), "same") > 0
    assert near.any()
    assert not near.all()
    force = column(Backlash(size=1e-6), state, 1)[:, 1]
    force -= -np.sign(state.load[:, 1]) * state.slopes.position[:, 1, 1]  # the link rests on one side of the gap
    assert np.abs(force[~near]).max() < 1e-3 * np.abs(force[near]).max()


def test_gear_play_is_a_line_at_small_load_and_a_step_at_large_load():
    state = motion(robot("planar2"))
    load = state.load[:, 1]
    np.testing.assert_allclose(1e6 * column(GearPlay(knee=1e6), state, 1)[:, 1], load, rtol=1e-9)
    step = column(GearPlay(knee=1e-9), state, 1)[:, 1]
    np.testing.assert_allclose(step[np.abs(load) > 1e-6], np.sign(load)[np.abs(load) > 1e-6], rtol=1e-9)
    assert np.abs(column(GearPlay(knee=0.3), state, 1)[:, 0]).max() == 0.0


def test_gear_play_with_a_large_knee_is_a_gain_of_the_load():
    state = motion(robot("planar2"))
    play, load = column(GearPlay(knee=30 * np.abs(state.load).max()), state, 1)[:, 1], state.load[:, 1]
    slope = play @ load / (load @ load)
    assert np.abs(play - slope * load).max() < 1e-3 * np.abs(play).max()


def test_heat_follows_its_equation_over_irregular_samples_and_many_time_constants():
    rng = np.random.default_rng(0)
    t = np.cumsum(rng.uniform(0.005, 0.02, 30_000))
    v = np.sin(t) + 0.3 * np.sin(5 * t)
    for constant, exponent in ((0.5, 1.0), (7.0, 1.6), (400.0, 2.0)):
        h, power = [0.0], np.abs(v) ** exponent
        for k in range(1, len(t)):
            kept = np.exp(-(t[k] - t[k - 1]) / constant)
            h.append(kept * h[-1] + (1 - kept) * 0.5 * (power[k] + power[k - 1]))
        np.testing.assert_allclose(heat(t, v, constant, exponent), h, rtol=1e-6, atol=1e-9)


def test_a_joint_of_constant_speed_warms_up_with_time():
    machine = robot("planar2")
    t, one = np.linspace(0.0, 60.0, 1201), np.ones((1201, 2))
    state = replace(
        State.empty(machine), t=t, q=t[:, None] * one, v=2.0 * one, a=0.0 * one, load=0 * one, torque=0 * one
    )
    heated = column(SelfHeating(constant=20.0, exponent=2.0), state, 0)
    warmed = column(ThermalDrift(constant=20.0), state, 0)
    np.testing.assert_allclose(heated, 4.0 * warmed, rtol=1e-9, atol=1e-12)


def test_stribeck_friction_under_load_is_load_friction_that_fades_with_the_speed():
    state = motion(robot("planar2"))
    constant = column(LoadFriction(), state, 1)[:, 1]
    np.testing.assert_allclose(column(LoadStribeck(speed=1e12), state, 1)[:, 1], constant, rtol=1e-9)
    faded = column(LoadStribeck(speed=0.1), state, 1)[:, 1]
    np.testing.assert_allclose(faded, constant * np.exp(-np.abs(state.v[:, 1]) / 0.1), rtol=1e-9, atol=1e-15)


def test_dry_friction_of_a_motor_behind_a_linkage_is_a_constant_and_a_slope_over_the_position():
    """Energy: to and fro, a motor of friction F loses 2 F times its own travel, whatever the linkage."""
    machine, crank, rod, middle, dry = robot("planar2"), 0.03, 0.05, 2.0, 40.0

    def travel(q):  # m. Length of a ball screw between a crank and a fixed point
        return np.sqrt(crank**2 + rod**2 - 2 * crank * rod * np.cos(q))

    h = 1e-4
    ratio = (travel(middle + h) - travel(middle - h)) / (2 * h)
    slope = dry * (travel(middle + h) - 2 * travel(middle) + travel(middle - h)) / h**2
    errors = []
    for reach in (0.2, 0.1, 0.05):  # from the middle to one end and back
        t = np.linspace(0.0, 2 * np.pi, 20_001)
        q, v = np.tile((middle + reach * (1 - np.cos(t)) / 2)[:, None], (1, 2)), np.tile(np.sin(t)[:, None], (1, 2))
        v = reach / 2 * v
        state = State(machine, t, q, v, 0 * q, 0 * q, 0 * q)
        sign = column(Coulomb(width=1e-5), state, 0)[:, 0]
        grows = slope * column(PositionFriction(width=1e-5), state, 0)[:, 0]
        truth = 2 * dry * (travel(middle + reach) - travel(middle))
        lost = [
            np.trapezoid(x * v[:, 0], t) for x in (dry * ratio * sign, (dry * ratio - slope * middle) * sign + grows)
        ]
        errors.append(np.abs(np.array(lost) / truth - 1))
    constant, sloped = np.array(errors).T
    np.testing.assert_allclose(constant[:-1] / constant[1:], 2.0, rtol=0.1)  # an error of first order in the reach
    np.testing.assert_allclose(sloped[:-1] / sloped[1:], 4.0, rtol=0.2)  # of second order


def test_a_tilted_base_is_the_robot_on_a_tilted_base():
    for name, rpy in (("ur10", None), ("ur10", (0.4, -0.9, 0.2)), ("planar2", None), ("mixed mimic", None)):
        level = Robot.load(name, base_rpy=rpy) if name != "mixed mimic" else robot(name)
        state = motion(level, seconds=1.0)
        for term in GravityTilt().terms(state):
            axis = "xyz".index(term.column.name[-1])
            angle = 1e-6 * np.eye(3)[axis]
            turned = pin.rpy.rpyToMatrix(angle).T @ np.array(level.gravity)
            tilted = Robot.from_dict({**level.to_dict(), "gravity": turned})
            change = tilted.inverse_dynamics(state.q, state.v, state.a) - state.load
            rows = np.stack([term.rows[j] for j in range(len(level.joints))], axis=1)
            np.testing.assert_allclose(change, 1e-6 * rows, atol=2e-11 * np.abs(state.load).max())


def test_a_tilt_nobody_feels_has_no_column():
    assert [c.name for c in GravityTilt().columns(robot("ur10"))] == ["tilt_x", "tilt_y"]
    planar = robot("planar2")  # all axes along y
    assert len(GravityTilt().columns(planar)) == 1
    weightless = Robot.from_dict({**planar.to_dict(), "gravity": (0.0, 0.0, 0.0)})
    assert GravityTilt().columns(weightless) == []


@pytest.mark.parametrize("name", ["ur10", "planar2 far_end known", "mixed mimic", "ur10 own frames"])
@pytest.mark.parametrize("full", [False, True])
def test_a_payload_is_a_body_more(name, full):
    machine = robot(name)
    link = machine.joints[-2]
    state = motion(machine, seconds=0.2)
    effect = Payload((link,), full=full)
    rng = np.random.default_rng(0)
    added = np.zeros(10)
    added[: 10 if full else 4] = rng.uniform(0.1, 1.0, 10 if full else 4)
    index = machine.numbers[link]
    names = [f"d{n}" for n in machine.all_names[10 * (index - 1) : 10 * index]]
    torque = sum(
        added[names.index(term.column.name)] * column(effect, state, k) for k, term in enumerate(effect.terms(state))
    )
    loaded = machine.nominal.copy()
    loaded[10 * (index - 1) : 10 * index] += added
    before, after = RigidDynamics(machine, machine.nominal), RigidDynamics(machine, loaded)
    expected = after.torque(state.q, state.v, state.a) - before.torque(state.q, state.v, state.a)
    np.testing.assert_allclose(torque, expected, atol=1e-10 * np.abs(expected).max())


def test_a_payload_hangs_on_the_last_link_unless_told():
    machine = robot("ur10")
    assert {c.joint for c in Payload().columns(machine)} == {"wrist_3_joint"}
    assert [c.name for c in Payload().columns(machine)] == ["dm6", "dmx6", "dmy6", "dmz6"]
    assert [effect.full for (effect,) in Payload.candidates(machine)] == [False, True] * 6


def test_a_shifted_encoder_is_another_pose():
    machine = robot("ur10")
    state = motion(machine, seconds=1.0)
    for k, term in enumerate(EncoderZero().terms(state)):
        shift = 1e-6 * np.eye(6)[machine.joints.index(term.column.joint)]
        change = machine.inverse_dynamics(state.q - shift, state.v, state.a) - state.load
        np.testing.assert_allclose(1e-6 * column(EncoderZero(), state, k), change, atol=1e-9)
    assert "shoulder_pan_joint" not in {c.joint for c in EncoderZero().columns(machine)}  # it turns about gravity


# ---- channels


def test_a_delay_is_a_shifted_torque():
    machine = robot("planar2")
    state = motion(machine)
    path = random_fourier(machine, 4.0, seed=1)
    q, v, a = path(np.clip(state.t - 0.02, 0.0, None))
    late = machine.inverse_dynamics(q, v, a) + 0.3 * v
    inside = state.t > 0.03
    together, alone = column(TimeDelay(size=0.02), state), column(TimeDelay(("joint2",), size=0.02), state)
    np.testing.assert_allclose((state.torque + 0.02 * together)[inside], late[inside], atol=1e-5 * np.abs(late).max())
    np.testing.assert_array_equal(alone[:, 1], together[:, 1])
    assert not alone[:, 0].any()
    assert [c.name for c in TimeDelay().columns(machine)] == ["delay"]


def test_a_delay_needs_times():
    state = motion(robot("planar2"))
    for effect in (TimeDelay(), Elasticity(), Elasticity(period=0.2), Backlash()):
        with pytest.raises(InputError, match="increasing order"):
            effect.terms(replace(state, t=np.zeros(len(state.t))))
    one = replace(state, **{n: getattr(state, n)[:1] for n in ("t", "q", "v", "a", "load", "torque")})
    assert not column(TimeDelay(), one).any()
    with pytest.raises(InputError, match="size must be a time in s other than zero"):
        TimeDelay(size=0.0)


def test_a_link_on_a_soft_spring_swings():
    machine, period, omega = robot("planar2"), 0.3, 2 * np.pi * np.array([1.2, 0.9])
    t = np.arange(0.0, 8.0, 0.005)
    q, v, a = (0.05 * omega**n * np.sin(np.outer(t, omega) + n * np.pi / 2) for n in range(3))
    load = RigidDynamics.of(machine).torque(q, v, a)
    state = State(machine, t, q, v, a, load, load)
    compliance = (period / (2 * np.pi)) ** 2 / state.rigid.inertia[0]
    # The damper beside the spring takes its part: to first order the spring has the torque of a moment ago.
    spring = load - SWING_DAMPING * period / np.pi * state.rates(load)[0]
    _, seen = elastic_torque(machine, np.array([compliance, 0.0]), replace(state, load=spring))
    left = {}
    for assumed in (0.0, period):
        (term,) = Elasticity(("joint1",), period=assumed).terms(seen)
        error = load - seen.load - compliance * np.stack([term.rows[j] for j in range(2)], axis=1)
        left[assumed] = np.abs(error)[800:-20].max()  # when the swing it is taken to begin with is over
    assert left[period] < 0.4 * left[0.0]


def test_a_spring_weaker_than_the_weight_is_none():
    state = motion(robot("ur10"))
    heavy = Elasticity(("shoulder_lift_joint",), period=30.0)
    assert not np.isfinite(column(heavy, state)).any()  # as candidate it is left out, in a model it is refused
    assert np.isfinite(column(replace(heavy, period=0.2), state)).all()


def test_rates_of_smooth_channels():
    state = motion(robot("planar2"))
    first, second = state.rates(np.sin(3 * state.t))
    np.testing.assert_allclose(first, 3 * np.cos(3 * state.t), atol=1e-5)
    np.testing.assert_allclose(second, -9 * np.sin(3 * state.t), atol=1e-5)


def test_gain_scales_the_whole_torque():
    state = motion(robot("planar2"))
    np.testing.assert_array_equal(column(DriveGain(("joint1",)), state)[:, 0], state.torque[:, 0])


# ---- reference parameters


def test_effects_of_the_load_take_the_reference():
    machine = robot("planar2")
    reference = 2.0 * np.array(
        [dict(zip(machine.all_names, machine.nominal, strict=True))[c.name] for c in machine.columns]
    )
    once, twice = motion(machine), motion(machine, reference=reference)
    for effect in (GravityTilt(), EncoderZero(), Backlash()):
        np.testing.assert_allclose(
            column(effect, twice), 2.0 * column(effect, once), atol=1e-8 * np.abs(once.load).max()
        )


def test_base_parameters_are_as_good_a_reference():
    machine = robot("ur10")
    found = structure(Regressor(machine, ()), machine.joints)
    nominal = np.array([dict(zip(machine.all_names, machine.nominal, strict=True))[c.name] for c in machine.columns])
    base = np.zeros(len(nominal))
    base[[c.name for c in machine.columns].index("m1")] = 0.0
    places = [i for i in range(len(nominal)) if i in {*found.absolute, *found.independent}]
    base[places] = found.mapping @ nominal
    assert (base.reshape(-1, 10)[:, 0] == 0).any(), "links without mass"
    state = motion(machine)
    other = replace(state, reference=base)
    np.testing.assert_allclose(other.slopes.position, state.slopes.position, atol=1e-5 * np.abs(state.load).max())


# ---- as text


@cache
def wild(kind):
    """Effects of one kind with any parameters."""
    numbers = st.floats(1e-6, 1e6) | st.integers(1, 1000)
    options = {float: numbers, int: numbers, bool: st.booleans()}
    values = {name: options[type(x)] for name, x in kind().parameters.items() if type(x) in options}
    if kind is Formula:
        values["expression"] = st.sampled_from(["sin(3*q2)*v1", "v1", "abs(a2)/(1 + v**2) - pi", "-q", "3"])
    joints = st.none() | st.lists(
        st.sampled_from(["a", "b_1", "c-2", "elbow"]), min_size=2, max_size=4, unique=True
    ).map(tuple)
    return st.builds(kind, joints=joints, **values)


@every_effect
@given(data=st.data())
def test_text_and_data_read_back(kind, data):
    effect = data.draw(wild(kind))
    assert parse_effects(str(effect)) == (effect,)
    assert effect_from_dict(json.loads(json.dumps(effect.to_dict()))) == effect


@given(
    st.lists(st.sampled_from(list(EFFECTS)), unique=True).flatmap(
        lambda ids: st.tuples(*(wild(EFFECTS[i]) for i in ids))
    )
)
def test_lists_of_effects_read_back(effects):
    assert parse_effects(", ".join(map(str, effects))) == tuple(effects)


def test_ways_to_write_an_effect():
    assert parse_effects("coulomb(0.02), stribeck(0.1, exponent=1)@a+b") == (
        Coulomb(width=0.02),
        Stribeck(("a", "b"), speed=0.1, exponent=1.0),
    )
    wanted = Formula(("shoulder",), expression="sin(3*q2)*v1")
    for text in (
        'formula("sin(3*q2)*v1")@shoulder',
        "formula(sin(3*q2)*v1)@shoulder",
        "formula(expression='sin(3*q2)*v1')@ shoulder",
    ):
        assert parse_effects(text) == (wanted,)
    assert len(parse_effects("formula(q)@a, formula(v)@a, formula(q)@b")) == 3


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("viscos", "viscous"),
        ("coulomb(width=)", "no value"),
        ("coulomb(widht=1)", "width"),
        ("coulomb(1, 2, 3)", "2 parameters"),
        ("coulomb(0.1", "name\\(parameter=value\\)"),
        ("viscous@a@b", "name\\(parameter=value\\)"),
        ("viscous, viscous", "twice"),
        ("stribeck@elbow, wrist", "stribeck@elbow\\+wrist"),
        ("stribeck@elbow, viscos", "viscous"),
        ("formula(q)@a, formula(q)@a", "twice"),
        ("stribeck(speed=fast)", "speed"),
        ("formula(__import__)", "__import__"),
    ],
)
def test_what_is_wrong_with_a_text(text, says):
    with pytest.raises(InputError, match=says):
        parse_effects(text)


def test_random_values_reach_every_column():
    machine = made(robot("planar2").urdf)
    for kind in EFFECTS.values():
        assert all(np.isfinite(x) for x in random_values(machine, (kind(),)).values())


WORDS = (
    "sin cos tanh exp sgn sign coupled and its reaction on the rows before joint i j q_i q_j or no torque at cubic "
    "periodic curve spring while else full also six inertias"
)
"""Words and functions in equations; i and j count joints."""
LIKEWISE = {"dmy": "dmx", "dmz": "dmx", "ṡ": "s", "s̈": "s", "dz": "z", "dq": "q", "dh": "h", "dt": "t"}


@pytest.mark.parametrize("name", EFFECTS)
def test_every_symbol_of_an_equation_is_explained(name):
    kind = EFFECTS[name]
    explained = symbols_of(kind)
    letters = {LIKEWISE.get(x, x) for x in re.findall(r"[^\W\d²³][^\W²³]*[\u0300-\u036f]*", kind.equation)}
    assert letters - {*WORDS.split()} <= set(explained)
    assert all(explained.values())


def test_one_sample_is_not_warm():
    assert heat(np.array([3.0]), np.array([2.0]), 10.0, 2.0).tolist() == [0.0]
