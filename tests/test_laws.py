"""The laws of the design, as matrices over robots, effects, estimators; that of generated code: export/test_code.py."""

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pinocchio as pin
import pytest
from cases import (
    EFFECT_CASES,
    ESTIMATOR_CASES,
    ROBOTS,
    Reference,
    exact_log,
    joint,
    link,
    made,
    misfit,
    quick,
    random_values,
    robot,
    states,
    true_base,
    urdf,
    whole_regressor,
)

from frischid.checks import LogReport
from frischid.effects import BASELINE, EFFECTS
from frischid.logs.filters import LowPass
from frischid.logs.preprocessing import prepare
from frischid.model import log_examination
from frischid.model.model import Model
from frischid.motions.simulation import Noise, torque
from frischid.regression.accumulation import accumulate
from frischid.regression.joint_rows import JointRows
from frischid.regression.moment_blocks import total
from frischid.regression.regressor import Regressor, nominal_parameters
from frischid.regression.structure import structure
from frischid.robot.rotors import rotor_coupling

every_robot = pytest.mark.parametrize("name", ROBOTS)
every_effect = pytest.mark.parametrize("effect", EFFECT_CASES.values(), ids=EFFECT_CASES)


# ---- columns


@every_robot
def test_rigid_columns_times_theta_are_inverse_dynamics(name):
    machine = robot(name)
    q, v, a = states(machine)
    expected = Reference(machine)(q, v, a)
    Y = whole_regressor(Regressor(machine, ()), q, v, a)
    fitted = np.einsum("ncj,c->nj", Y, nominal_parameters(machine, ()))
    # the URDF's own value of a parameter known outright need not be the known one
    outright = {n: x for n, x in zip(machine.all_names, machine.nominal, strict=True) if n in machine.known}
    truthful = type(machine).from_dict({**machine.to_dict(), "known": outright})
    known = truthful.known_torque(q, v, a)
    size = np.abs(expected).max()
    np.testing.assert_allclose(fitted + (0.0 if known is None else known), expected, atol=1e-11 * size)
    np.testing.assert_allclose(machine.inverse_dynamics(q, v, a), expected, atol=1e-11 * size)


@every_robot
def test_rigid_columns_are_derivatives_of_inverse_dynamics(name):
    machine = robot(name)
    q, v, a = states(machine, count=2)
    reference = Reference(machine)
    Y = whole_regressor(Regressor(machine, ()), q, v, a)
    bodies = [n for n in reference.names if n in machine.bodies]

    def torque_of(body, theta):
        """Torque when this body alone has inertia, given about the user's frame."""
        model = reference.model.copy()
        for i in range(model.njoints):
            model.inertias[i] = pin.Inertia.Zero()
        about = pin.Inertia.FromDynamicParameters(theta)
        frame = machine.frame_placement(body)
        model.inertias[model.getJointId(body)] = frame.act(about)
        return reference(q, v, a, model)

    some = np.array([2.0, 0.1, -0.2, 0.3, 0.5, 0.02, 0.6, -0.03, 0.01, 0.7])
    names = [c.name for c in Regressor(machine, ()).columns]
    size = np.abs(Y).max()
    checked = 0
    for body in bodies:
        before = torque_of(body, some)
        for k, step in enumerate(np.eye(10)):
            full = machine.all_names[10 * (machine.numbers[body] - 1) + k]
            if full in names:
                change = torque_of(body, some + step) - before
                np.testing.assert_allclose(Y[:, names.index(full)], change, atol=1e-10 * size, err_msg=full)
                checked += 1
    assert checked == len(names) == 10 * len(machine.bodies) - len(machine.known)


@every_effect
@every_robot
def test_columns_are_derivatives_of_the_simulated_torque(name, effect):
    machine, t = robot(name), np.arange(5) * 0.01
    q, v, a = states(machine, count=5)
    regressor = Regressor(machine, (effect,))
    theta = np.random.default_rng(0).normal(size=len(regressor.columns))
    Y, before = regressor(t, q, v, a), torque(machine, (effect,), theta, t, q, v, a)
    np.testing.assert_array_equal(Y, whole_regressor(regressor, q, v, a))
    for c in range(len(machine.columns), len(theta)):
        shifted = theta + 2.0 * (np.arange(len(theta)) == c)
        change = (torque(machine, (effect,), shifted, t, q, v, a) - before) / 2.0
        np.testing.assert_allclose(Y[:, c], change, atol=1e-9 * max(1.0, np.abs(before).max()))
    # what has no column is exactly the rigid robot with what is known of it
    none = np.zeros(len(theta))
    rest = torque(machine, (effect,), none, t, q, v, a)
    known = machine.known_torque(q, v, a)
    np.testing.assert_array_equal(rest, np.zeros_like(rest) if known is None else known)


@every_effect
@every_robot
def test_effects_describe_their_columns(name, effect):
    machine = robot(name)
    columns = effect.columns(machine)
    pairs = effect.id == "joint_coupling" and len(machine.joints) == 1
    assert columns or pairs, "an effect that adds nothing"
    assert len({c.name for c in columns}) == len(columns) == len(effect.nominal(machine))
    assert {c.effect for c in columns} <= {effect.id}
    assert {c.joint for c in columns} <= {*machine.joints, *machine.bodies}
    assert all(c.unit for c in columns)
    again = type(effect)(**{**effect.parameters, "joints": effect.joints})
    assert again == effect
    for text in ("title", "equation", "sentence", "looks_like", "confirmed_by", "reference"):
        assert getattr(effect, text)
    assert set(effect.confused_with)
    assert effect.id not in effect.confused_with


@pytest.mark.parametrize("name", ["ur10", "mixed mimic"])
def test_rotor_of_one_joint_only_touches_rows_up_to_its_own(name):
    machine = robot(name)
    q, v, a = states(machine)
    for i, joint_name in enumerate(machine.joints):
        assert not rotor_coupling(machine, q, v, a, joint_name, 3.0)[:, i + 1 :].any()


# ---- a rotor as a body of its own

FRAME = {
    1: {"xyz": "0 0 0.2", "rpy": "0 0 0", "axis": "0 0 1"},
    2: {"xyz": "0.3 0.1 0", "rpy": "1.1 0.2 0.5", "axis": "0 1 0"},
    3: {"xyz": "0 0.1 0.3", "rpy": "-0.4 0.9 0", "axis": "0.6 0 0.8"},
}
IM, TRANSVERSE = 0.02, 0.035


def arm_with_rotor(carrier, free, driven, kinds):
    """Three links and, on link driven − 1, the rotor of joint `driven`: spinning, or welded to its link."""
    parts = [link("l0"), *(link(f"l{k}", 4.0 - k, f"0.{k} 0.05 0.0{k}") for k in FRAME)]
    parts += [joint(f"j{k}", f"l{k - 1}", f"l{k}", kinds[k - 1], **frame) for k, frame in FRAME.items()]
    # the rotor's z axis is joint `driven`'s axis; it sits at the joint's own place
    placement = FRAME[driven]
    turned = pin.rpy.rpyToMatrix(*(float(x) for x in placement["rpy"].split()))
    axis = turned @ np.array([float(x) for x in placement["axis"].split()])
    R = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), axis).toRotationMatrix()
    rpy = " ".join(repr(float(x)) for x in pin.rpy.matrixToRpy(R))
    inertial = (
        '<inertial><origin xyz="0 0 0"/><mass value="1.5"/>'
        f'<inertia ixx="{TRANSVERSE}" iyy="{TRANSVERSE}" izz="{IM}" ixy="0" ixz="0" iyz="0"/></inertial>'
    )
    parts.append(f'<link name="rotor">{inertial}</link>')
    kind = "continuous" if free else "fixed"
    parts.append(joint("spin", carrier, "rotor", kind, "0.02 -0.1 0.05", rpy, "0 0 1", ""))
    return urdf(*parts)


@pytest.mark.parametrize("driven", [1, 2, 3])
@pytest.mark.parametrize("ratio", [1.0, -7.0, 80.0])
@pytest.mark.parametrize(
    "kinds", [("revolute",) * 3, ("continuous", "revolute", "revolute"), ("prismatic", "revolute", "revolute"),
              ("revolute", "prismatic", "revolute")],
)  # fmt: skip
def test_rotor_coupling_equals_an_explicit_rotor_body(driven, ratio, kinds):
    if kinds[driven - 1] == "prismatic":
        pytest.skip("a ball screw's rotor axis is not the joint's axis")
    carrier = f"l{driven - 1}"
    machine = made(arm_with_rotor(carrier, False, driven, kinds))
    spinning = pin.buildModelFromXML(arm_with_rotor(carrier, True, driven, kinds))
    data = spinning.createData()
    q, v, a = states(machine)
    order = [spinning.joints[spinning.getJointId(n)].idx_v for n in (*machine.joints, "spin")]
    G = np.vstack([np.eye(3), ratio * np.eye(3)[driven - 1]])
    explicit = np.empty_like(q)
    for k in range(len(q)):
        full = np.zeros((3, 4))
        full[:, order] = np.stack([G @ q[k], G @ v[k], G @ a[k]])
        x = pin.integrate(spinning, pin.neutral(spinning), full[0])
        explicit[k] = G.T @ pin.rnea(spinning, data, x, full[1], full[2])[order]
    welded = machine.inverse_dynamics(q, v, a)
    coupling = rotor_coupling(machine, q, v, a, f"j{driven}", ratio)
    np.testing.assert_allclose(welded + IM * coupling, explicit, rtol=1e-10, atol=1e-10)
    assert np.abs(coupling).max() > 0.1


def test_rotor_of_a_sliding_joint_couples_to_nothing():
    machine = robot("mixed mimic")
    q, v, a = states(machine)
    coupling = rotor_coupling(machine, q, v, a, "slide", 30.0)
    i = machine.joints.index("slide")
    np.testing.assert_allclose(coupling[:, i], 900.0 * a[:, i])
    assert not np.delete(coupling, i, axis=1).any()


# ---- moments


def moments_by_hand(regressor, motion, lowpass, joints):
    """Filter and decimate the whole motion at once."""
    machine = regressor.robot
    known = machine.known_torque(motion.q, motion.v, motion.a)
    Y = regressor(motion.t, motion.q, motion.v, motion.a)
    Z = np.concatenate([Y, (motion.tau - (0.0 if known is None else known))[:, None, :]], axis=1)
    taps, every = lowpass.taps(motion.step), lowpass.decimation(motion.step)
    count = (len(Z) - len(taps)) // every + 1
    kept = np.stack([np.tensordot(taps, Z[k * every : k * every + len(taps)], 1) for k in range(count)])
    index = [machine.joints.index(n) for n in joints]
    return np.stack([kept[:, :, j].T @ kept[:, :, j] for j in index]), count


@every_robot
@pytest.mark.parametrize("cutoff", [None, 6.0])
def test_gram_of_chunks_equals_gram_of_the_whole(name, cutoff):
    machine, lowpass = robot(name), LowPass(cutoff)
    log = exact_log(machine, BASELINE, random_values(machine, BASELINE), seconds=3.0)
    (motion,) = prepare(log, lowpass).motions
    regressor, joints = Regressor(machine, BASELINE), machine.joints[::-1]
    motion = replace(motion, standstill=np.zeros_like(motion.standstill))  # these samples have their own test
    expected, count = moments_by_hand(regressor, motion, lowpass, joints)
    scale = np.sqrt(np.einsum("jcc->jc", expected))
    size = 1e-11 * scale[:, :, None] * scale[:, None, :] + 1e-15 * scale.max() ** 2  # some columns are rounding
    for chunk in (3, 64, 100_000):
        blocks = list(regressor.blocks(motion, lowpass, chunk))
        rows = JointRows.of(regressor, joints)
        gram = total(rows.gram([c]) for c in rows.chunks(motion, lowpass, chunk))
        assert gram.counts.tolist() == [count] * len(joints)
        assert (np.abs(gram.moments - expected) <= size).all()
        t = np.concatenate([b.t for b in blocks])
        middle = len(lowpass.taps(motion.step)) // 2
        every = lowpass.decimation(motion.step)
        np.testing.assert_array_equal(t, motion.t[middle : len(motion.t) - middle : every][:count])
    streamed = accumulate(regressor, [motion], lowpass, joints)
    assert len(streamed) > 1
    assert (np.abs(total(streamed).moments - expected) <= size).all()


@every_effect
def test_blocks_of_chunks_equal_blocks_of_the_whole(effect):
    machine, lowpass = robot("mixed mimic"), LowPass(6.0)
    log = exact_log(machine, (effect,), random_values(machine, (effect,)), seconds=3.0)
    (motion,) = prepare(log, lowpass).motions
    regressor = Regressor(machine, (effect,))
    (whole,) = regressor.blocks(motion, lowpass, 100_000)
    blocks = list(regressor.blocks(motion, lowpass, 40))
    assert len(blocks) > 3
    size = 1e-12 * np.abs(whole.Z).max(axis=(0, 2), keepdims=True)
    assert (np.abs(np.concatenate([b.Z for b in blocks]) - whole.Z) <= size).all()
    for part in ("t", "used"):
        np.testing.assert_array_equal(np.concatenate([getattr(b, part) for b in blocks]), getattr(whole, part))


# ---- estimates


@every_robot
@pytest.mark.parametrize("estimator", ESTIMATOR_CASES)
def test_every_estimator_recovers_the_truth(name, estimator):
    machine = robot(name)
    values = random_values(machine, BASELINE)
    log = exact_log(machine, BASELINE, values, rate=200.0)
    # to find the baseline itself takes half of the time, and is the same for every estimator
    effects = None if estimator == "wls" else BASELINE
    found = quick(machine, [log], effects=effects, estimator=estimator, prior="none")
    assert found.simplex.exact
    assert found.model.estimate.estimator == estimator
    assert misfit(found, true_base(found, values)) < 1e-5
    assert max(found.cross_validation.values()) < 1e-5


@every_robot
def test_every_vertex_lies_in_its_box(name):
    machine = robot(name)
    found = noisy(name, prior="none")
    box = found.model.bounds["frisch"]
    assert not found.simplex.exact
    for vertex in found.simplex.vertices.T:
        assert box.contains(vertex)
    edges = np.stack([box.lower, box.upper])
    touched = (found.simplex.vertices.T[:, None] == edges[None]).any(axis=0)
    assert touched.all(), "the box is wider than its vertices"
    assert box.contains(found.model.estimate.theta, tol=1e-6 * np.abs(found.model.estimate.theta).max())
    assert machine.joints == found.model.joints


@cache
def noisy(name, prior="urdf"):
    machine = robot(name)
    noise = Noise(q=1e-4, v=1e-3, a=1e-2, tau=0.02)
    return quick(machine, [exact_log(machine, BASELINE, random_values(machine, BASELINE), noise=noise)], prior=prior)


@every_robot
def test_saved_and_loaded_is_the_same_model(name, tmp_path):
    model = noisy(name).model
    model.save(tmp_path / "model.json")
    again = Model.load(tmp_path / "model.json")
    assert again.to_dict() == model.to_dict()
    assert again.effects == model.effects
    assert again.base == model.base
    for x, y in ((again.estimate.theta, model.estimate.theta), (again.mean_torque, model.mean_torque)):
        np.testing.assert_array_equal(x, y)
    q, v, a = states(model.robot)
    np.testing.assert_array_equal(again.inverse_dynamics(q, v, a), model.inverse_dynamics(q, v, a))


def with_effect(effect):
    """A model of known links with one effect."""
    machine = robot("mixed mimic")
    links = dict(zip(machine.all_names, map(float, machine.nominal), strict=True))
    return replace(rigid(), effects=(effect,), standard=links | random_values(machine, (effect,)))


@cache
def rigid():
    machine = robot("mixed mimic")
    return quick(machine, [exact_log(machine, (), noise=Noise(tau=0.01))], effects=(), prior="none").model


@every_effect
def test_saved_and_loaded_is_the_same_model_with_every_effect(effect, tmp_path):
    model = with_effect(effect)
    model.save(tmp_path / "model.json")
    again = Model.load(tmp_path / "model.json")
    assert again.to_dict() == model.to_dict()
    assert again.effects == model.effects
    np.testing.assert_array_equal(again.full_theta, model.full_theta)


@pytest.mark.parametrize("estimator", ESTIMATOR_CASES)
def test_saved_and_loaded_is_the_same_model_of_every_estimator(estimator):
    machine = robot("planar2")
    log = exact_log(machine, BASELINE, random_values(machine, BASELINE), rate=200.0, noise=Noise(q=1e-5, tau=0.01))
    data = quick(machine, [log], estimator=estimator).model.to_dict()
    assert Model.from_dict(json.loads(json.dumps(data, allow_nan=False))).to_dict() == data


# ---- effects


@pytest.fixture
def unchecked(monkeypatch):
    """Logs are not checked: random parameters are far from the URDF, and the search for the fault takes its time."""
    monkeypatch.setattr(log_examination, "inspect", lambda robot, log, *_, **__: LogReport(log.source, {}, {}, ()))


@pytest.mark.parametrize("name", ["planar2", "ur10", "mixed mimic"])
@every_effect
@pytest.mark.usefixtures("unchecked")
def test_adding_a_simulated_effect_removes_it_exactly(name, effect):
    machine, basis = robot(name), (EFFECTS["offset"](),)
    if isinstance(effect, EFFECTS["offset"]):
        basis = (EFFECTS["viscous"](),)
    if effect.id == "backlash":  # a wide play is crossed slowly where there is little load: its past is not forgotten
        effect = replace(effect, size=1e-6)
    both = (*basis, effect)
    values = random_values(machine, both)
    log = exact_log(machine, both, values, seconds=20.0)
    # a short delay is a lag of the recording too, which a fit without the effect would take back
    without, with_it = (quick(machine, [log], effects=e, torque_lag=0.0) for e in (basis, both))
    # identification begins a few samples after the simulation: what an effect remembers of them is not exact
    exact = not effect.memory
    assert max(with_it.cross_validation.values()) < (1e-4 if exact else 0.01)
    assert misfit(with_it, true_base(with_it, values)) < (1e-4 if exact else 0.01)
    ranks = [structure(Regressor(machine, e), machine.joints).rank for e in (basis, both)]
    if ranks[1] > ranks[0]:  # else rigid parameters say the same
        assert max(without.cross_validation.values()) > 10 * max(with_it.cross_validation.values())
