"""A model with a controller is simulated in closed loop along the recorded commands."""

from dataclasses import replace

import numpy as np
import pytest

import frischid as fr
from frischid.forward.commanded_motion import commanded_source
from frischid.forward.torque_sources import PositionController
from frischid.logs.command_checks import CommandTravel

JOINTS = ("joint1", "joint2")
KP, KD, DELAY = 900.0, 90.0, 0.02


@pytest.fixture(scope="module")
def model():
    robot = fr.Robot.load("planar2")
    log = fr.simulate(robot, fr.random_fourier(robot, 10.0, seed=1), rate=200.0, parameters={"fv1": 4.0, "fc2": 3.0})
    return fr.identify(robot, [log], effects=fr.parse_effects("viscous,coulomb,rotor_inertia"), recursion="none").model


@pytest.fixture(scope="module")
def servo(model):
    """A log of positions and commands: the model itself, moved by a controller that is 20 ms late."""
    t = np.arange(0.0, 4.0, 0.005)
    qcmd = np.column_stack([np.sin(2 * t), 0.6 * np.sin(5 * t)])
    late = np.column_stack([np.interp(t - DELAY, t, x) for x in qcmd.T])
    forward = fr.ForwardDynamics(model)
    at_rest = fr.Starts(np.zeros((1, 2)), np.zeros((1, 2)))
    moved = forward.simulate(PositionController(t, late, KP, KD), at_rest, t)
    return fr.Log(t, JOINTS, q=moved.q[0], qcmd=qcmd, source="servo")


def with_controller(model, **values):
    return replace(model, controller=fr.PDController(kp=KP, kd=KD, **values))


def test_the_loop_is_closed_with_the_models_controller(model, servo):
    found = fr.compare_simulated(with_controller(model, delay=DELAY), [servo], horizons=[0.5])
    assert found.closed
    assert max(found.whole.joints.values()) < 2e-3
    wrong = fr.compare_simulated(with_controller(model), [servo], horizons=[0.5])
    assert max(wrong.whole.joints.values()) > 5 * max(found.whole.joints.values())


def test_a_measured_torque_is_preferred(model, servo):
    from dataclasses import replace

    driven = with_controller(model, delay=DELAY).controller.drive(servo)
    found = fr.compare_simulated(with_controller(model, delay=DELAY), [replace(driven, sha256=None)], horizons=[0.1])
    assert not found.closed


def test_a_recording_has_the_commands_of_the_log(model, servo, tmp_path):
    fr.write_log(servo, tmp_path / "servo.parquet")
    controller = fr.PDController(kp=KP, kd=KD, delay=DELAY)
    recording = fr.Recording.open(tmp_path / "servo.parquet", JOINTS)
    one, other = (commanded_source(controller, x, JOINTS) for x in (servo, recording))
    np.testing.assert_allclose(one.q_cmd, other.q_cmd)
    with pytest.raises(fr.InputError, match="at most 50 are possible"):
        commanded_source(fr.PDController(kp=KP, delay=1.0), servo, JOINTS)


@pytest.mark.parametrize("ends", ["both", "the position", "the command"])
@pytest.mark.parametrize("chunks", [1, 3])
def test_angles_that_wrap_are_followed_across_the_wrap(model, servo, ends, chunks):
    """The commands had jumped by a whole turn, and the simulated arm went after them."""
    closed = with_controller(model, delay=DELAY)
    q, goal = (
        x if ends in only else x % (2 * np.pi) for x, only in ((servo.q, "the command"), (servo.qcmd, "the position"))
    )
    wrapped = replace(servo, q=q, qcmd=goal)
    found = fr.compare_simulated(closed, [in_chunks(wrapped, chunks)], horizons=[0.5])
    plain = fr.compare_simulated(closed, [in_chunks(servo, chunks)], horizons=[0.5])
    assert found.whole.joints == pytest.approx(plain.whole.joints, abs=1e-6)


def in_chunks(log, count):
    parts = [log.slice(part[0], part[-1] + 1) for part in np.array_split(np.arange(len(log)), count)]
    return log if count == 1 else fr.Recording(log.source, lambda _: iter(parts))


def test_an_arm_rests_in_the_first_chunk_of_a_recording(servo):
    t = np.arange(2 * len(servo)) * 0.005
    q, goal = (np.vstack([np.repeat(x[:1], len(servo), axis=0), x]) for x in (servo.q, servo.qcmd))
    log = replace(servo, t=t, q=q, qcmd=goal)
    assert commanded_source(fr.PDController(kp=KP), in_chunks(log, 2), JOINTS).q_cmd.shape == q.shape
    still = replace(log, qcmd=np.zeros_like(q))
    with pytest.raises(fr.InputError, match=r"servo: the commanded positions .* never move"):
        commanded_source(fr.PDController(kp=KP), in_chunks(still, 2), JOINTS)


def test_a_joint_may_be_parked_at_half_a_turn(servo):
    """The noise of its encoder takes the angle from π to -π and back, which is no motion."""
    q, goal = servo.q.copy(), servo.qcmd.copy()
    noisy = np.pi + 1e-4 * np.random.default_rng(0).normal(size=len(q))
    q[:, 1], goal[:, 1] = (noisy + np.pi) % (2 * np.pi) - np.pi, np.pi - 1e-6
    assert commanded_source(fr.PDController(kp=KP), replace(servo, q=q, qcmd=goal), JOINTS).q_cmd.shape == q.shape


def test_the_travel_of_commands_is_joined_by_the_names_of_their_joints(servo):
    """A chunk at rest with the command of one joint alone had made the other chunk forgotten."""
    moving, resting = CommandTravel.of(servo), CommandTravel.of(servo.select(JOINTS[:1]).slice(0, 50))
    found = moving.joined(resting)
    assert found.joints == JOINTS[:1]
    assert found.upper - found.lower == pytest.approx((moving.upper - moving.lower)[:1])
    found.check("servo")


def test_an_unstable_loop_is_said(model, servo):
    held = fr.compare_simulated(with_controller(model, delay=DELAY), [servo], horizons=[0.5])
    assert held.instability is None
    wild = replace(model, controller=fr.PDController(kp=1e3 * KP, kd=0.0, delay=0.05))
    lost = fr.compare_simulated(wild, [servo], horizons=[0.01, 2.0])
    assert lost.instability is not None
    assert "check the gains (kp, kd and their units) and the delay" in lost.instability
