"""The damping gain of a controller that the user left open."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import frischid as fr
from frischid.cli import main
from frischid.errors import InputError

KP = {"joint1": 300.0, "joint2": 120.0}
KD = {"joint1": 9.0, "joint2": 3.0}
TRUTH = {"fv1": 0.5, "fv2": 0.3, "fc1": 0.8, "fc2": 0.4, "Ia1": 0.05, "Ia2": 0.03}


def commanded(seed: int = 1, velocities: bool = True) -> fr.Log:
    """A log of the commands that make the torque of a motion: q_c + T v_c = q + (τ + kd q̇) / kp, T = kd / kp."""
    robot = fr.Robot.load("planar2")
    log = fr.simulate(robot, fr.random_fourier(robot, 12.0, seed=seed), rate=200.0, parameters=TRUTH)
    assert log.tau is not None
    assert log.v is not None
    kp, kd = (np.array([x[n] for n in robot.joints]) for x in (KP, KD))
    goal = log.q + (log.tau + kd * log.v) / kp
    q = log.q + 1e-5 * np.random.default_rng(seed).normal(size=goal.shape)
    if not velocities:
        return fr.Log(log.t, robot.joints, q=q, qcmd=goal, source="servo")
    lag = kd / kp
    behind = np.exp(-np.diff(log.t)[:, None] / lag)  # of a first order lag, along straight lines of the goal
    slope = np.diff(goal, axis=0) / np.diff(log.t)[:, None]
    qcmd = goal.copy()
    for k in range(len(slope)):
        qcmd[k + 1] = goal[k + 1] - lag * slope[k] + behind[k] * (qcmd[k] - goal[k] + lag * slope[k])
    return fr.Log(log.t, robot.joints, q=q, qcmd=qcmd, vcmd=(goal - qcmd) / lag, source="servo")


def rows(log: fr.Log, controller: fr.PDController) -> dict[tuple[str, str], fr.DriveParameter]:
    model = fr.identify(fr.Robot.load("planar2"), [log], controller=controller, recursion="none").model
    return {(x.joint, x.quantity): x for x in fr.drive_parameters(model)}


def test_commanded_velocities_tell_damping_from_friction() -> None:
    found = rows(commanded(), fr.PDController(KP, None))
    for number, joint in enumerate(KP, 1):
        damping, viscous = found[joint, "damping"], found[joint, "viscous"]
        assert (damping.known, viscous.known) == ("identified", "identified")
        assert damping.value == pytest.approx(KD[joint], rel=0.005)
        assert damping.lower <= KD[joint] <= damping.upper
        assert viscous.lower <= TRUTH[f"fv{number}"] <= viscous.upper


def test_a_named_kd_of_one_joint_stays() -> None:
    found = rows(commanded(), fr.PDController(KP, {"joint1": 9.0, "joint2": None}))
    assert (found["joint1", "damping"].known, found["joint1", "damping"].value) == ("given", 9.0)
    assert found["joint2", "damping"].value == pytest.approx(3.0, rel=0.005)


def test_without_commanded_velocities_only_the_sum_is_known() -> None:
    log = commanded(velocities=False)
    found = fr.identify(log_robot := fr.Robot.load("planar2"), [log], controller=fr.PDController(KP, None))
    assert any("only the sum of kd and viscous friction is known" in note for note in found.notes)
    for x in fr.drive_parameters(found.model):
        if x.quantity not in ("damping", "viscous"):
            continue
        whole = KD[x.joint] + TRUTH[f"fv{log_robot.joints.index(x.joint) + 1}"]
        assert x.known == "in a sum"
        assert x.of.startswith("kd + viscous = ")
        low, high = (float(y) for y in x.of.split("(")[1].rstrip(")").split(" … "))
        assert low <= whole <= high < 1.05 * low
        assert x.lower == 0.0
        assert x.upper >= whole
    assert not any(effect.id == "velocity_gain" for effect in found.model.effects)


@pytest.mark.parametrize("velocities", [True, False])
def test_with_an_unknown_kp_the_ratio_is_known(velocities: bool) -> None:
    found = rows(commanded(velocities=velocities), fr.PDController(None, None))
    damping = found["joint2", "damping"]
    low, high = (float(y) for y in damping.of.split("(")[-1].rstrip(")").split(" … "))
    ratio = (3.0 if velocities else 3.3) / 120.0
    assert damping.known == ("as a ratio" if velocities else "in a sum")
    assert low <= ratio <= high < 1.05 * low


def test_a_model_with_an_open_damping_is_saved_compared_and_simulated(tmp_path: Path) -> None:
    model = fr.identify(
        fr.Robot.load("planar2"), [commanded()], controller=fr.PDController(KP, None), recursion="none"
    ).model
    model.save(tmp_path / "model.json")
    again = fr.Model.load(tmp_path / "model.json")
    assert again.controller == fr.PDController(KP, None)
    assert fr.compare(again, [commanded(seed=2)]).nrmse < 0.01
    moved = fr.compare_simulated(again, [commanded(seed=2)], horizons=[0.5])
    assert max(moved.whole.joints.values()) < 1e-3


def test_a_doubtful_delay_beside_an_open_kd_has_ranges_that_hold_the_truth() -> None:
    controller = fr.PDController(KP, None, delay_doubt=1e-3)
    found = fr.identify(fr.Robot.load("planar2"), [commanded()], controller=controller, recursion="none")
    truth = {"damping": KD, "viscous": {"joint1": 0.5, "joint2": 0.3}, "delay": dict.fromkeys(KD, 0.0)}
    for x in fr.drive_parameters(found.model):
        if x.quantity in truth:
            assert x.lower <= truth[x.quantity][x.joint] <= x.upper, x
    assert found.model.controller is not None
    near = found.model.controller.values("kd_near", list(KD))
    assert near == pytest.approx(list(KD.values()), rel=0.1)


def test_an_effort_limit_needs_kd() -> None:
    with pytest.raises(InputError, match=r"effort limit of joint2 .* needs its kd.*--kd joint2=VALUE"):
        fr.PDController(KP, {"joint2": None}, limit=5.0).drive(commanded())


def test_logs_with_and_without_commands_of_a_joint_do_not_mix() -> None:
    log = commanded()
    driven = fr.PDController(KP, KD).drive(log)
    measured = replace(log, tau=driven.tau, qcmd=None, vcmd=None)
    with pytest.raises(InputError, match="kd of joint1 is open, and some logs have its torque"):
        fr.identify(fr.Robot.load("planar2"), [log, measured], controller=fr.PDController(KP, None))


@pytest.mark.parametrize("text", ['kd = "auto"', '[kd]\njoint1 = "auto"\njoint2 = "auto"'])
def test_kd_is_left_open_in_a_file(tmp_path: Path, text: str) -> None:
    (tmp_path / "servo.toml").write_text(f"kp = 20.0\n{text}\n")
    assert not fr.PDController.load(tmp_path / "servo.toml").knows_damping("joint1")


def test_kd_is_left_open_on_the_command_line(tmp_path: Path) -> None:
    log = commanded()
    assert log.qcmd is not None
    assert log.vcmd is not None
    table = np.column_stack([log.t, log.q, log.qcmd, log.vcmd])
    names = ["t", *(f"{c}_{j}" for c in ("q", "qcmd", "vcmd") for j in log.joints)]
    path = tmp_path / "servo.csv"
    np.savetxt(path, table, delimiter=",", header=",".join(names), comments="", fmt="%.9g")
    out = tmp_path / "model.json"
    for kd in ("auto", "joint1=9,joint2=auto"):
        words = ["identify", "planar2", str(path), "--controller", "pd", "--kp", "joint1=300,joint2=120", "--kd", kd]
        ran = CliRunner().invoke(main, [*words, "-o", str(out), "--force", "--json"])
        assert ran.exit_code == 0, ran.output
        drives = {(x["joint"], x["quantity"]): x for x in json.loads(ran.stdout)["drives"]}
        assert drives["joint2", "damping"]["value"] == pytest.approx(3.0, rel=0.01)
        assert drives["joint1", "damping"]["known"] == ("identified" if kd == "auto" else "given")
