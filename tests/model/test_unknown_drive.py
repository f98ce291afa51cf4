"""Gains and delay of a controller that the user does not know."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import frischid as fr
from frischid.errors import InputError

KP = {"joint1": 300.0, "joint2": 120.0}
KD = {"joint1": 9.0, "joint2": 3.0}


def commanded(seed: int = 1, late: float = 0.0, seconds: float = 12.0, **changes: object) -> fr.Log:
    """A log of commands that the drives of `KP` follow: the command that gives the torque of a motion."""
    robot = fr.Robot.load("planar2")
    truth = {"fv1": 0.5, "fv2": 0.3, "fc1": 0.8, "fc2": 0.4, "Ia1": 0.05, "Ia2": 0.03}
    log = fr.simulate(robot, fr.random_fourier(robot, seconds, seed=seed), rate=200.0, parameters=truth)
    kp, kd = (np.array([x[n] for n in robot.joints]) for x in (KP, KD))
    assert log.tau is not None
    assert log.v is not None
    acts = log.q + (log.tau + kd * log.v) / kp
    stamped = np.column_stack([np.interp(log.t + late, log.t, x) for x in acts.T])
    keep = log.t < log.t[-1] - late
    rng = np.random.default_rng(seed)
    noisy = log.q + 1e-5 * rng.standard_normal(log.q.shape)
    made = fr.Log(log.t[keep], robot.joints, q=noisy[keep], qcmd=stamped[keep], source="servo")
    return replace(made, **changes)


@cache
def without_gains() -> fr.Identification:
    """The identification of a log of commands with no gain known."""
    return fr.identify(fr.Robot.load("planar2"), [commanded()], controller=fr.PDController(), recursion="none")


def test_gains_come_from_the_masses_of_the_urdf_with_their_doubt() -> None:
    found = without_gains()
    controller = found.model.controller
    assert controller is not None
    for joint, truth in KP.items():
        doubt = controller.gain_doubt(joint)
        assert 0.01 < doubt < 0.5
        assert abs(controller.gain(joint) / truth - 1) < 2 * doubt
    assert any(note.startswith("kp in N·m/rad") and "joint1" in note for note in found.notes)


def test_ratios_to_a_found_gain_are_sharper_than_the_values() -> None:
    found = without_gains()
    rows = {(x.joint, x.quantity): x for x in fr.drive_parameters(found.model)}
    kp, friction = rows["joint2", "stiffness"], rows["joint2", "coulomb"]
    assert (kp.known, friction.known) == ("roughly", "as a ratio")
    assert kp.lower < KP["joint2"] < kp.upper
    assert friction.lower < 0.4 < friction.upper
    low, high = (float(x) for x in friction.of.split("(")[1].rstrip(")").split(" … "))
    assert low < 0.4 / KP["joint2"] < high
    assert (high - low) * kp.value < 0.5 * (friction.upper - friction.lower)


def test_one_known_gain_is_a_scale_for_the_others() -> None:
    robot, log = fr.Robot.load("planar2"), commanded()
    alone = without_gains().model.controller
    beside = fr.identify(robot, [log], controller=fr.PDController(kp={"joint1": 300.0}), recursion="none")
    controller = beside.model.controller
    assert alone is not None
    assert controller is not None
    assert controller.gain("joint1") == 300.0
    assert controller.gain_doubt("joint1") == 0.0
    assert controller.gain_doubt("joint2") < alone.gain_doubt("joint2")
    assert abs(controller.gain("joint2") / KP["joint2"] - 1) < 2 * controller.gain_doubt("joint2")


@pytest.mark.parametrize("given", [fr.PDController(KP, KD, delay=None), fr.PDController(delay=None)])
def test_the_delay_of_the_commands_is_found(given: fr.PDController) -> None:
    late = 0.023
    found = fr.identify(fr.Robot.load("planar2"), [commanded(late=late)], controller=given, recursion="none")
    controller = found.model.controller
    assert controller is not None
    delay, doubt = (float(controller.values(name, ["joint1"])[0]) for name in ("delay", "delay_doubt"))
    assert abs(delay - late) < 2 * doubt
    assert doubt < 0.01


def test_a_delay_that_the_logs_cannot_tell_is_not_used() -> None:
    given = fr.PDController(KP, KD, delay=None)
    found = fr.identify(fr.Robot.load("planar2"), [commanded(late=0.0)], controller=given, recursion="none")
    controller = found.model.controller
    assert controller is not None
    assert controller.values("delay", ["joint1"])[0] == 0.0
    assert any("taken without one" in note for note in found.notes)


def test_found_values_are_saved_with_the_model(tmp_path: object) -> None:
    from pathlib import Path

    found = fr.identify(
        fr.Robot.load("planar2"), [commanded()], controller=fr.PDController(delay=None), recursion="none"
    )
    path = Path(str(tmp_path)) / "model.json"
    found.model.save(path)
    assert fr.Model.load(path).controller == found.model.controller
    assert fr.compare(fr.Model.load(path), [commanded(seed=2)]).nrmse < 0.2


def test_a_reversed_command_is_named() -> None:
    log = commanded()
    assert log.qcmd is not None
    backwards = replace(log, qcmd=2 * log.q - log.qcmd)
    with pytest.raises(InputError, match=r"joint1: .* pushes against the position error.*sign = -1"):
        fr.identify(fr.Robot.load("planar2"), [backwards], controller=fr.PDController(), recursion="none")


def test_a_gain_that_the_links_cannot_tell_is_open_and_ratios_to_it_are_known() -> None:
    """Without gravity, the URDF's links do not explain this log, and are no scale for kp."""
    light, robot = fr.Robot.load("planar2", gravity=(0.0, 0.0, 0.0)), fr.Robot.load("planar2")
    found = fr.identify(light, [commanded()], controller=fr.PDController(kd=0.5), recursion="none", force=True)
    controller = found.model.controller
    assert controller is not None
    lost = [n for n in robot.joints if controller.gain_doubt(n) == 1.0]
    assert lost
    assert not any(controller.knows_damping(n) for n in lost)
    assert any(f"kp of {', '.join(lost)} is open" in note and "--kp" in note for note in found.notes)
    table = {(x.joint, x.quantity): x for x in fr.drive_parameters(found.model)}
    for name in lost:
        stiffness, dry = table[name, "stiffness"], table[name, "coulomb"]
        assert (stiffness.known, stiffness.to_dict()["upper"]) == ("open", None)
        assert stiffness.lower < controller.gain(name)
        assert dry.known == "open" or (dry.known == "as a ratio" and "coulomb / kp" in dry.of)


@pytest.mark.parametrize("what", ["vcmd", "tauff"])
def test_a_torque_of_known_size_is_a_scale(what: str) -> None:
    """The robot is half as heavy again as its URDF, and the gains are right all the same."""
    robot, rng = fr.Robot.load("planar2"), np.random.default_rng(1)
    truth = {"fv1": 0.5, "fv2": 0.3, "fc1": 0.8, "fc2": 0.4, "Ia1": 0.05, "Ia2": 0.03}
    truth |= {n: 1.5 * x for n, x in zip(robot.all_names, map(float, robot.nominal), strict=True) if x}
    log = fr.simulate(robot, fr.random_fourier(robot, 12.0, seed=1), rate=200.0, parameters=truth)
    assert log.tau is not None
    assert log.v is not None
    kp, kd = (np.array([x[n] for n in robot.joints]) for x in (KP, KD))
    wanted = fr.random_fourier(robot, 12.0, seed=2)(log.t)[1]
    known = kd * (wanted - log.v) if what == "vcmd" else 4.0 * np.sin(np.outer(log.t, [5.0, 7.0]))
    commands = log.q + (log.tau - known + (0.0 if what == "vcmd" else kd * log.v)) / kp
    noisy = log.q + 1e-5 * rng.standard_normal(log.q.shape)
    given = {"vcmd": wanted} if what == "vcmd" else {"tauff": known}
    servo = fr.Log(log.t, robot.joints, q=noisy, qcmd=commands, source="servo", **given)
    found = fr.identify(robot, [servo], controller=fr.PDController(kd=KD), recursion="none")
    controller = found.model.controller
    assert controller is not None
    for joint, gain in KP.items():
        assert abs(controller.gain(joint) / gain - 1) < 0.01
        assert controller.gain_doubt(joint) < 0.01


def test_an_effort_limit_needs_its_gain() -> None:
    with pytest.raises(InputError, match=r"effort limit of joint1 .* needs its kp"):
        fr.identify(fr.Robot.load("planar2"), [commanded()], controller=fr.PDController(limit=5.0))


def test_a_long_delay_is_refused() -> None:
    log = commanded()
    assert log.qcmd is not None
    with pytest.raises(InputError, match=r"the longest that is tried"):
        fr.identify(
            fr.Robot.load("planar2"),
            [replace(log, qcmd=np.roll(log.qcmd, -150, axis=0)).slice(0, -200)],
            controller=fr.PDController(KP, KD, delay=None),
        )


@pytest.mark.parametrize(("factor", "name"), [(57.3, "gains-too-large"), (1 / 57.3, "gains-too-small"), (1.0, "")])
def test_gains_in_another_unit_are_an_alarm(factor, name):
    machine = fr.Robot.load("planar2")
    motion = fr.random_fourier(machine, 8.0, seed=4, scale=0.8)
    log = fr.simulate(machine, motion, rate=100.0, seed=4)
    commanded = fr.Log(log.t, log.joints, q=log.q, qcmd=log.q + log.tau / 300.0)
    assert (np.abs(log.tau).max(axis=0) < machine.limits.effort).all()
    found = fr.identify(machine, [commanded], controller=fr.PDController(kp=300.0 * factor), recursion="none")
    named = [a for a in found.headline.alarms if a.id.startswith("gains-too")]
    assert [a.id for a in named] == ([name] if name else [])
    assert all("N·m/rad" in a.remedy and a.joints for a in named)


def test_the_tables_of_drives_show_a_range_without_an_end() -> None:
    import json

    from frischid.export.actuators import actuators_csv, actuators_json

    light = fr.Robot.load("planar2", gravity=(0.0, 0.0, 0.0))
    model = fr.identify(light, [commanded()], controller=fr.PDController(), recursion="none", force=True).model
    rows = {x["joint"]: x for x in json.loads(actuators_json(model))["joints"]}
    lost = [n for n, x in rows.items() if x["stiffness_known"] == "open"]
    assert lost
    assert all(rows[n]["stiffness_high"] is None and rows[n]["stiffness_low"] > 0 for n in lost)
    assert "inf" not in actuators_csv(model)
