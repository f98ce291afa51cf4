"""A delay that is in doubt: the ranges of friction hold the doubt."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import frischid as fr

KP, KD, LATE = 300.0, 9.0, 0.02
VISCOUS = {"joint1": 0.5, "joint2": 0.3}


def commanded(seed: int = 1) -> fr.Log:
    """A log of commands that act 20 ms late."""
    robot = fr.Robot.load("planar2")
    truth = {"fv1": 0.5, "fv2": 0.3, "fc1": 0.8, "fc2": 0.4, "Ia1": 0.05, "Ia2": 0.03}
    log = fr.simulate(robot, fr.random_fourier(robot, 12.0, seed=seed), rate=200.0, parameters=truth)
    assert log.tau is not None
    assert log.v is not None
    acts = log.q + (log.tau + KD * log.v) / KP
    stamped = np.column_stack([np.interp(log.t + LATE, log.t, x) for x in acts.T])
    keep = log.t < log.t[-1] - LATE
    noisy = log.q + 1e-5 * np.random.default_rng(seed).standard_normal(log.q.shape)
    return fr.Log(log.t[keep], robot.joints, q=noisy[keep], qcmd=stamped[keep], source="servo")


def drives(controller: fr.PDController, log: fr.Log) -> dict[tuple[str, str], fr.DriveParameter]:
    model = fr.identify(fr.Robot.load("planar2"), [log], controller=controller, recursion="none").model
    return {(x.joint, x.quantity): x for x in fr.drive_parameters(model)}


def test_friction_has_the_doubt_about_the_delay() -> None:
    """One millisecond at 300 N·m/rad is as large as the friction of a joint."""
    log, told = commanded(), fr.PDController(KP, KD, delay=LATE + 0.001)
    sure, doubtful = drives(told, log), drives(replace(told, delay_doubt=0.001), log)
    for joint, truth in VISCOUS.items():
        wrong, right = sure[joint, "viscous"], doubtful[joint, "viscous"]
        assert not wrong.lower <= truth <= wrong.upper
        assert right.lower <= truth <= right.upper
        delay = doubtful[joint, "delay"]
        assert delay.known == "identified"
        assert delay.lower <= LATE <= delay.upper


def test_a_delay_named_four_steps_wrong_is_corrected_beyond_first_order() -> None:
    """A correction of first order alone leaves an error of the armature that its range does not hold."""
    told = fr.PDController(KP, KD, delay=LATE - 0.018, delay_doubt=0.008)
    found = drives(told, commanded())
    for joint, truth in VISCOUS.items():
        assert found[joint, "viscous"].lower <= truth <= found[joint, "viscous"].upper
        assert found[joint, "delay"].lower <= LATE <= found[joint, "delay"].upper
    assert found["joint2", "armature"].lower <= 0.03 <= found["joint2", "armature"].upper
    assert found["joint1", "delay"].upper - found["joint1", "delay"].lower < 1e-3


def test_a_second_identification_takes_the_named_delay_again() -> None:
    robot, log = fr.Robot.load("planar2"), commanded()
    told = fr.PDController(KP, KD, delay=LATE - 0.015, delay_doubt=0.008)
    first = fr.identify(robot, [log], controller=told, recursion="none").model
    again = fr.identify(robot, [log], controller=first.controller, recursion="none").model
    assert first.controller is not None
    assert again.controller is not None
    assert first.controller.delay_told == again.controller.delay_told == told.delay
    assert again.controller.delay == pytest.approx(first.controller.delay, abs=1e-3)


def test_a_sure_delay_adds_no_parameter() -> None:
    controller = fr.PDController(KP, KD, delay=LATE)
    model = fr.identify(fr.Robot.load("planar2"), [commanded()], controller=controller, recursion="none").model
    assert not any(effect.id == "command_delay" for effect in model.effects)
    plain = fr.identify(
        model.robot, [commanded()], controller=replace(controller, delay_doubt=1e-3), recursion="none", prior="none"
    ).model
    assert not any(effect.id == "command_delay" for effect in plain.effects)  # least squares has no prior


def test_only_joints_with_commands_have_a_delay() -> None:
    robot, log = fr.Robot.load("planar2"), commanded()
    driven = fr.PDController(KP, KD, delay=LATE).drive(log)
    assert driven.tau is not None
    half = fr.Log(driven.t, driven.joints, q=driven.q, qcmd=driven.qcmd, tau=driven.tau * [1.0, np.nan], source="half")
    controller = fr.PDController(KP, KD, delay=LATE, delay_doubt=1e-3)
    model = fr.identify(robot, [half], controller=controller, recursion="none").model
    (late,) = (effect for effect in model.effects if effect.id == "command_delay")
    assert late.joints == ("joint2",)


def test_a_model_with_a_doubtful_delay_is_simulated_and_diagnosed() -> None:
    logs = [commanded(1), commanded(2)]
    told = fr.PDController(KP, KD, delay=LATE + 0.001, delay_doubt=0.001)
    model = fr.identify(fr.Robot.load("planar2"), logs[:1], controller=told, recursion="none").model
    moved = fr.compare_simulated(model, logs[1:], horizons=[0.5])
    wrong = fr.identify(
        model.robot, logs[:1], controller=replace(told, delay_doubt=0.0, delay=LATE + 0.01), recursion="none"
    ).model
    beside = fr.compare_simulated(wrong, logs[1:], horizons=[0.5])
    assert max(moved.whole.joints.values()) < 0.5 * max(beside.whole.joints.values())
    assert fr.diagnose(model, logs).verdict == "none"
    assert fr.Model.from_dict(model.to_dict()).controller == model.controller
    assert model.controller is not None
    assert model.controller.delay_told == told.delay


def test_a_model_with_a_doubtful_delay_takes_logs_of_torques() -> None:
    """A measured torque does not depend on the delay of commands."""
    robot, told = fr.Robot.load("planar2"), fr.PDController(KP, KD, delay=LATE + 0.001, delay_doubt=0.001)
    model = fr.identify(robot, [commanded()], controller=told, recursion="none").model
    truth = {"fv1": 0.5, "fv2": 0.3, "fc1": 0.8, "fc2": 0.4, "Ia1": 0.05, "Ia2": 0.03}
    measured = fr.simulate(robot, fr.random_fourier(robot, 8.0, seed=5), rate=200.0, parameters=truth)
    assert fr.compare(model, [measured]).nrmse < 0.01
    both = fr.identify(robot, [commanded(), measured], controller=told, recursion="none").model
    (late,) = (effect for effect in both.effects if effect.id == "command_delay")
    assert late.joints is None
    assert fr.compare(both, [measured, commanded(2)]).nrmse < 0.01


@pytest.mark.parametrize("value", [-1.0, float("nan")])
def test_an_impossible_doubt_is_refused(value: float) -> None:
    with pytest.raises(fr.InputError, match="delay_doubt must be"):
        fr.PDController(KP, delay_doubt=value)
