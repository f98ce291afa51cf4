"""Faults of logs against each other: the simplest that explains the torques is named, and a mapping file undoes it."""

import os
import re
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import SimpleNamespace
from xml.etree import ElementTree

import numpy as np
import pytest
from cases import robot
from click.testing import CliRunner

from frischid.checks import corrected_urdf, explanation
from frischid.checks.check_criteria import DEFAULT_CRITERIA, CheckCriteria
from frischid.checks.payload import Body
from frischid.checks.position_faults import JOINT_ZERO, position_faults
from frischid.checks.robot_faults import shared_faults
from frischid.checks.sketch import Sketch
from frischid.cli import main
from frischid.effects import BASELINE
from frischid.errors import InputError
from frischid.logs.filters import LowPass
from frischid.logs.locked_joints import LockedMotion
from frischid.logs.log import Log
from frischid.logs.mapping import LogMap
from frischid.logs.mapping_fix import corrected, together
from frischid.logs.preprocessing import prepare
from frischid.logs.readers import read_log, write_log
from frischid.logs.wraps import unwrapped, wraps_of
from frischid.model.identification import identify
from frischid.model.log_examination import check
from frischid.motions.simulation import Noise, simulate
from frischid.motions.trajectory import random_fourier
from frischid.regression.regressor import Regressor
from frischid.robot.robot import LINK_PARAMETERS, Robot

UR = Robot.load("ur10")


@pytest.fixture(scope="module")
def log():
    """A log of an arm whose links are heavier and lighter than its URDF says."""
    rng = np.random.default_rng(5)
    own = dict(zip(UR.all_names, UR.nominal, strict=True))
    factor = dict(zip(range(1, 7), np.exp(0.1 * rng.normal(size=6)), strict=True))
    values = {n: x * factor[int(n[-1])] for n, x in own.items()}
    for k in range(1, 7):
        values |= {f"fv{k}": 1.0, f"fc{k}": 1.0, f"Ia{k}": 0.1}
    values = {n: x for n, x in values.items() if n in {c.name for c in Regressor(UR, BASELINE).columns}}
    motion = random_fourier(UR, 20, seed=7)
    return simulate(UR, motion, rate=100, noise=Noise(q=1e-5, tau=0.02), parameters=values, channels=())


def issues(log):
    (report,) = check(UR, [log])
    return {issue.kind: issue for issue in report.issues}, report


def shifted(log, j, delta):
    q = np.array(log.q)
    q[:, j] -= delta
    return replace(log, q=q)


def signed(log, *columns):
    tau = np.array(log.tau)
    tau[:, list(columns)] *= -1
    return replace(log, tau=tau)


def test_a_robot_that_is_not_quite_its_urdf_is_no_fault(log):
    assert issues(log)[0] == {}


def test_one_convention_for_all_signs_is_the_simplest(log):
    found, report = issues(signed(log, *range(6)))
    assert found["torque sign"].where == UR.joints
    assert "probability" in found["torque sign"].what
    assert {entry[1:] for entry in report.fix} == {("torque_sign", -1)}
    assert report.facts["explanation"]["probability"] > 0.9


@pytest.mark.parametrize("degrees", [90.0, 180.0, -50.0])
def test_a_zero_that_is_off(log, degrees):
    found, report = issues(shifted(log, 2, np.deg2rad(degrees)))
    assert found["joint zero"].where == (UR.joints[2],)
    ((name, key, value),) = report.fix
    assert (name, key) == (UR.joints[2], "offset")
    assert np.rad2deg(value) % 360 == pytest.approx(degrees % 360, abs=3.0)


def test_two_faults_at_once(log):
    found, _ = issues(signed(shifted(log, 1, np.pi / 2), 2))
    assert found["joint zero"].where == (UR.joints[1],)
    assert found["torque sign"].where == (UR.joints[2],)


def test_a_possible_fault_is_not_asserted(log):
    """Behind a wrong sign, an angle that was fitted may only take up an error of the URDF."""
    alone, _ = issues(signed(log, 2))
    assert alone["torque sign"].sure == "likely"
    assert alone["torque sign"].what.startswith("the torque has the wrong sign: ")
    found, _ = issues(signed(shifted(log, 1, np.deg2rad(50)), 2))
    assert {issue.sure for issue in found.values()} == {"possible"}
    assert found["torque sign"].what.startswith("the torque may have the wrong sign: ")
    assert found["joint zero"].what.startswith("the zero of its angle may be off by ")
    assert not any(mark in issue.what for issue in found.values() for mark in "{|}")


def test_springs_and_coupled_motors_are_physics(log):
    tau = np.array(log.tau)
    tau[:, 1] += 300 * (log.q[:, 1] - 1.0)
    found, report = issues(replace(log, tau=tau))
    assert found["spring"].where == (UR.joints[1],)
    assert not found["spring"].blocks
    assert "the links take it up; else frischid" in found["spring"].advice  # a counterbalance may act as gravity
    assert report.fix == ()
    v = np.gradient(log.q, log.t, axis=0)
    w = v[:, 3] + v[:, 4]
    motor = 40 * np.tanh(w / 0.05) + 20 * w
    tau = np.array(log.tau)
    tau[:, 3:5] += motor[:, None]
    found = issues(replace(log, tau=tau))[0]["motor coupling"]
    assert found.where == UR.joints[3:5]
    assert f"frischid add MODEL 'joint_coupling(ratio=1)@{'+'.join(UR.joints[3:5])}'" in found.advice


def test_angles_that_wrap_are_made_continuous(log):
    q = np.array(log.q)
    q[:, 0] = (q[:, 0] - np.median(q[:, 0])) % (2 * np.pi) - np.pi
    wrapped = replace(log, q=q)
    assert wraps_of(wrapped.q)[0] > 0
    np.testing.assert_allclose(np.diff(unwrapped(wrapped).q, axis=0), np.diff(log.q, axis=0), atol=1e-9)
    found, _ = issues(wrapped)
    assert set(found) == {"wrapped angle"}
    assert found["wrapped angle"].where == UR.joints[:1]
    assert "±π" not in found["wrapped angle"].what  # an angle from 0° to 360° had been said to wrap at ±π
    model = identify(UR, [wrapped], recursion="none")
    assert not any("wraps" in warning for warning in model.warnings)  # nothing is to be done, and a note says it
    assert any("wrap at whole turns" in note for note in model.notes)
    assert max(model.cross_validation.values()) < 0.1


def test_a_joint_that_stands_at_half_a_turn_wraps_at_every_other_sample(log):
    """The sign of ±π is noise there: no joint turns, and none that is locked there moves."""
    there = np.pi + 1e-4 * np.random.default_rng(0).standard_normal(len(log))
    q = np.array(log.q)
    q[:, 5] = (there + np.pi) % (2 * np.pi) - np.pi
    assert np.ptp(q[:, 5]) > 6
    found = unwrapped(replace(log, q=q)).q[:, 5]
    assert np.ptp(found - there) < 1e-9
    for at in (np.pi, -np.pi):
        locked = LockedMotion(Robot.load("ur10", lock={UR.joints[5]: at}))
        locked.see(replace(log, q=q))
        assert not locked.moving
        assert not locked.elsewhere


def test_a_jump_that_is_no_turn_is_no_wrap(log):
    q = np.array(log.q)
    q[500:, 0] += 5.0
    assert not wraps_of(q).any()


def test_a_joint_that_hardly_moves_testifies_to_nothing():
    t = np.arange(0, 20, 0.01)
    rng = np.random.default_rng(0)
    q = np.column_stack([1.3e-3 * np.sin(t), 0.8 * np.sin(0.7 * t)])
    q[:, 0] = np.round(q[:, 0] / 1e-4) * 1e-4
    robot = Robot.load("planar2")
    v = np.gradient(q, t, axis=0)
    v[:, 0] = 0.7 * 1.3e-3 * np.cos(t)
    tau = robot.inverse_dynamics(q, v, np.gradient(v, t, axis=0)) + 0.01 * rng.normal(size=q.shape)
    (report,) = check(robot, [Log(t, robot.joints, q, v=v, tau=tau)])
    assert not any(issue.sure == "certain" and issue.kind == "velocity scale" for issue in report.issues)
    assert DEFAULT_CRITERIA.testimony_steps > 13


def test_the_printed_mapping_undoes_the_faults(tmp_path, log):
    table = {"t": log.t} | {f"p{j}": log.q[:, j] for j in range(6)} | {f"e{j}": log.tau[:, j] for j in range(6)}
    table["p1"], table["e3"], table["e4"] = log.q[:, 1] - np.pi / 2, log.tau[:, 4], log.tau[:, 3]
    from frischid.logs.table_writing import write_table

    write_table(table, tmp_path / "log.csv")
    names = "".join(f'[joint.{n}]\nq = "p{j}"\ntau = "e{j}"\n' for j, n in enumerate(UR.joints))
    (tmp_path / "map.toml").write_text(names)
    options = ["--map", str(tmp_path / "map.toml"), "-o", str(tmp_path / "fixed.toml")]
    result = CliRunner().invoke(main, ["check", "ur10", str(tmp_path / "log.csv"), *options])
    assert result.exit_code == 1, result.output
    read = read_log(tmp_path / "log.csv", UR.joints, tmp_path / "fixed.toml")
    np.testing.assert_allclose(read.tau, log.tau)
    np.testing.assert_allclose(read.q, log.q, atol=1e-5)
    again = CliRunner().invoke(
        main, ["check", "ur10", str(tmp_path / "log.csv"), "--map", str(tmp_path / "fixed.toml")]
    )
    assert again.exit_code == 0, again.output


def test_signs_and_offsets_of_a_mapping_are_kept():
    form = LogMap.from_dict({"joint": {"a": {"q": "x", "sign": -1, "offset": 0.5}}})
    read = Log(np.arange(20) / 10, ("a",), np.zeros((20, 1)))
    fixed = corrected(form, [("a", "sign", -1), ("a", "offset", 0.1)], read)
    assert (fixed.joint["a"].sign, fixed.joint["a"].offset) == (1, pytest.approx(-0.4))
    for names, titles in ((("one", "two"), ("one", "two")), (("log.csv", "log.csv"), ("log.csv", "log.csv (2)"))):
        fixes = [("a", "torque_factor", 0.001)]
        parts = [(names[0], form, fixes, read), (names[1], LogMap(rate=50.0), [], read)]
        text = together(parts)
        assert f'[layout."{titles[0]}".joint."a"]' in text
        assert f'[layout."{titles[1]}".file]\nrate = 50.0' in text


def test_torque_factor(tmp_path, log):
    write_log(log, tmp_path / "log.npz")
    read = read_log(tmp_path / "log.npz", UR.joints, {"joint": {UR.joints[0]: {"torque_factor": 0.001}}})
    np.testing.assert_allclose(read.tau[:, 0], 1e-3 * log.tau[:, 0])


def test_currents_alone_can_be_checked(log):
    found, _ = issues(replace(log, tau=None, current=log.tau / 10))
    assert set(found) == {"currents only"}


def test_a_torque_without_a_position_is_not_locked_silently(log):
    names = [n for n in UR.joints if n != UR.joints[1]]
    part = replace(log.select(names), extra={f"tau_{UR.joints[1]}": log.tau[:, 1]})
    with pytest.raises(InputError, match="no position q_shoulder_lift_joint"):
        check(UR, [part])
    with pytest.raises(InputError, match="--lock shoulder_lift_joint=ANGLE"):
        identify(UR, [part])
    locked = Robot.load("ur10", lock={UR.joints[1]: 0.0})
    check(locked, [part])


def test_all_signs_but_one(log):
    found, report = issues(signed(log, 0, 1, 2, 4, 5))
    assert found["torque sign"].where == tuple(n for j, n in enumerate(UR.joints) if j != 3)
    assert len(report.fix) == 5


def test_a_unit_is_undone_and_an_odd_gain_is_only_said(log):
    found, report = issues(replace(log, tau=1e3 * log.tau))
    assert found["torque scale"].where == UR.joints
    assert {key for _, key, _ in report.fix} == {"torque_factor"}
    tau = np.array(log.tau)
    tau[:, 1] *= 3.0
    found, report = issues(replace(log, tau=tau))
    assert found["torque scale"].where == UR.joints[1:2]
    assert report.fix == ()


def test_a_torque_at_its_limits_has_no_scale(log):
    """A drive that only reaches its two limits does not follow the load, so a multiple of the load is no reading."""
    tau = np.array(log.tau)
    tau[:, 1] = 2.0 * np.sign(tau[:, 1] - np.median(tau[:, 1]) + 300.0 * np.sin(2 * np.pi * log.t))
    found, _ = issues(replace(log, tau=tau))
    assert "torque scale" not in found


def test_logs_that_need_different_corrections_are_still_reported(tmp_path, log):
    for name, one in (("a", log), ("b", signed(log, *range(6)))):
        write_log(one, tmp_path / f"{name}.parquet")
    files = [str(tmp_path / f"{name}.parquet") for name in "ab"]
    plain = CliRunner().invoke(main, ["check", "ur10", *files])
    assert plain.exit_code == 1
    assert "torque sign" in plain.output
    written = CliRunner().invoke(main, ["check", "ur10", *files, "-o", str(tmp_path / "fixed.toml")])
    assert written.exit_code == 2
    assert "torque sign" in written.output
    assert "one by one" in " ".join(written.output.split())


def _case(log, fault):
    """The log as a robot gives it whose joints differ from the URDF's, and the joints concerned."""
    q, tau = np.array(log.q), np.array(log.tau)
    if fault == "zero":
        q[:, 2] -= np.pi / 2
        return replace(log, q=q), [2]
    if fault == "free zero":
        q[:, 1] += 0.7
        return replace(log, q=q), [1]
    if fault == "axis":
        q[:, 2] *= -1
        tau[:, 2] *= -1
        return replace(log, q=q, tau=tau), [2]
    order = [0, 2, 1, 3, 4, 5]
    return replace(log, q=q[:, order], tau=tau[:, order]), [1, 2]


@pytest.mark.parametrize("fault", ["zero", "free zero", "axis", "exchanged"])
def test_the_corrected_urdf_differs_in_the_wrong_joints_only_and_is_silent(log, tmp_path, fault):
    wrong, joints = _case(log, fault)
    write_log(wrong, tmp_path / "log.parquet")
    (tmp_path / "robot.urdf").write_text(UR.urdf, encoding="utf-8")
    run = CliRunner()
    output = tmp_path / "corrected.urdf"
    before = run.invoke(main, ["check", str(tmp_path / "robot.urdf"), str(tmp_path / "log.parquet"), "-o", str(output)])
    assert before.exit_code == 1
    assert f"written to {output}".replace("\n", "") in before.output.replace("\n", "")
    after = run.invoke(main, ["check", str(output), str(tmp_path / "log.parquet")])
    assert after.exit_code == 0, after.output
    names = [UR.joints[j] for j in joints]
    old, new = (ElementTree.fromstring(text) for text in (UR.urdf, output.read_text(encoding="utf-8")))
    for a, b in zip(old.iter(), new.iter(), strict=True):
        if ElementTree.tostring(a) != ElementTree.tostring(b) and a.tag not in ("robot", "origin", "axis"):
            assert a.tag == "joint"
            assert a.get("name") in names


def test_a_fault_of_the_log_gives_no_urdf(log, tmp_path):
    write_log(signed(log, 1), tmp_path / "log.parquet")
    (tmp_path / "robot.urdf").write_text(UR.urdf, encoding="utf-8")
    output = tmp_path / "corrected.urdf"
    given = ["check", str(tmp_path / "robot.urdf"), str(tmp_path / "log.parquet"), "-o", str(output)]
    said = CliRunner().invoke(main, given).output
    assert "no URDF written" in said
    assert not output.exists()


def test_the_corrected_urdf_moves_as_the_corrected_columns():
    rng = np.random.default_rng(1)
    q, v, a = rng.normal(size=(3, 5, 6))
    sign, offset = np.array([1, -1, 1, 1, -1, 1.0]), np.array([0, 0.4, -1.1, 0, 2.0, 0.0])
    fixes = [(n, "sign", s) for n, s in zip(UR.joints, sign, strict=True) if s < 0]
    fixes += [(n, "offset", d) for n, d in zip(UR.joints, offset, strict=True) if d]
    text, said = corrected_urdf(UR, fixes)
    assert len(said) == 5
    other = Robot.from_dict({**UR.to_dict(), "urdf": text})
    true = UR.inverse_dynamics(sign * q + offset, sign * v, sign * a)
    assert np.allclose(other.inverse_dynamics(q, v, a), sign * true, atol=1e-6)


def sketch_of(log, arm=UR):
    lowpass = LowPass(5.0)
    return Sketch.of(arm, prepare(log, lowpass).motions, lowpass, arm.joints).thinned(200)


def test_a_zero_is_tried_with_the_joints_that_mimic_it():
    """A joint that turns twice as far is no sine of the same angle: the torque was wrong by two thirds of its size."""
    arm = robot("mixed mimic")
    sketch = sketch_of(simulate(arm, random_fourier(arm, 10.0, seed=1), rate=100.0), arm)
    zeros = [moved for moved in position_faults(sketch) if moved.fault.kind == JOINT_ZERO]
    assert {moved.fault.where for moved in zeros} == {("turn",), ("elbow",)}
    for tried in (moved.sketch for moved in zeros):
        true = arm.inverse_dynamics(tried.q, tried.v, tried.a)
        assert np.allclose(tried.nominal, true, atol=1e-9 * np.abs(true).max())


def test_joints_that_mimic_a_corrected_one_follow_it_as_before():
    """The finger of a gripper had followed the reversed joint backwards."""
    arm = robot("mixed mimic")
    q, v, a = np.random.default_rng(1).normal(size=(3, 5, 3))
    sign, offset = np.array([1.0, 1.0, -1.0]), np.array([0.0, 0.0, 0.3])
    text, _ = corrected_urdf(arm, [("elbow", "sign", -1.0), ("elbow", "offset", 0.3)])
    true = arm.inverse_dynamics(sign * q + offset, sign * v, sign * a)
    assert np.allclose(Robot.from_dict({**arm.to_dict(), "urdf": text}).inverse_dynamics(q, v, a), sign * true)
    text, _ = corrected_urdf(arm, [(a, c, b) for a, b in (("turn", "elbow"), ("elbow", "turn")) for c in ("q", "tau")])
    other = Robot.from_dict({**arm.to_dict(), "urdf": text})
    assert other.joints == ("elbow", "slide", "turn")
    assert np.allclose(other.inverse_dynamics(q, v, a), arm.inverse_dynamics(q, v, a))


@pytest.mark.parametrize(("name", "seed"), [("panda", 1205), ("panda", 1291), ("kinova", 1097)])
def test_links_that_are_too_heavy_or_too_light_are_no_body(name, seed, monkeypatch):
    """An error of the last link's mass is a body on it, but the links' errors are the simpler explanation."""
    monkeypatch.syspath_prepend(Path(__file__).parents[2] / "benchmarks")
    from planted_log_faults import clean

    case = clean(name, seed, 0.1)
    (report,) = check(case.robot, [case.log])
    assert [issue.kind for issue in report.issues if issue.kind != "weak excitation"] == []


@pytest.mark.parametrize("seed", range(8))
def test_links_whose_centres_of_mass_are_wrong_too_are_no_body(seed):
    """On 15 of 36 healthy arms, a payload or a missing hand was "likely": ten numbers on the last link explain much."""
    arm = Robot.load("kinova", joints=[f"j2s6s200_joint_{k}" for k in range(1, 7)])
    rng, nominal = np.random.default_rng(seed), dict(zip(arm.all_names, arm.nominal, strict=True))
    values = {f"{kind}{k}": 0.5 for kind in ("fv", "fc") for k in range(1, 7)}
    for k in range(1, 7):
        own = {kind: nominal[f"{kind}{k}"] for kind in LINK_PARAMETERS}
        factor = 1 + rng.uniform(0.1, 0.4) * rng.choice([-1, 1])
        own |= {kind: own[kind] + 0.02 * own["m"] * rng.normal() for kind in ("mx", "my", "mz")}
        values |= {f"{kind}{k}": factor * x for kind, x in own.items()}
    motion = random_fourier(arm, 20, seed=seed)
    log = simulate(arm, motion, rate=100, noise=Noise(q=1e-5, tau=0.02), parameters=values, channels=(), seed=seed)
    (report,) = check(arm, [log])
    assert {issue.kind for issue in report.issues} & {"payload", "missing hand"} == set()


def test_only_the_torques_named_are_judged(log, tmp_path):
    write_log(signed(log, 1), tmp_path / "log.parquet")
    (tmp_path / "robot.urdf").write_text(UR.urdf, encoding="utf-8")
    given = ["check", str(tmp_path / "robot.urdf"), str(tmp_path / "log.parquet")]
    assert CliRunner().invoke(main, given).exit_code == 1
    others = CliRunner().invoke(main, [*given, "--torque-joints", "elbow*,wrist*,shoulder_pan*"])
    assert others.exit_code == 0, others.output
    assert "torque not judged: shoulder_lift_joint" in others.output


def with_spring(log, j):
    """A spring on joint j that is as strong as its load."""
    tau, q = np.array(log.tau), log.q[:, j]
    tau[:, j] += 1.5 * tau[:, j].std() * (q - q.mean()) / q.std()
    return replace(log, tau=tau)


def with_body(log, mass):
    """A body on the last link."""
    v = np.gradient(log.q, log.t, axis=0)
    a = np.gradient(v, log.t, axis=0)
    last = [k for k, column in enumerate(UR.columns) if column.joint == UR.joints[-1]]
    Y = np.empty((len(log), len(UR.columns), len(UR.joints)))
    UR.regressor(log.q, v, a, Y)
    body = mass * np.array([1.0, 0.02, 0.0, 0.1, 0.02, 0, 0.02, 0, 0, 0.01])
    return replace(log, tau=np.array(log.tau) + np.einsum("ncj,c->nj", Y[:, last], body))


def test_a_spring_does_not_hide_a_payload(log):
    found, _ = issues(with_spring(with_body(log, 5.0), 2))
    assert set(found) >= {"payload", "spring"}
    assert found["spring"].where == (UR.joints[2],)


def test_no_further_fault_of_positions_is_read_beside_springs_that_explain_all(log, monkeypatch):
    """On a robot of 32 joints these readings take minutes, and none of them could be a rival."""
    read, every = [], explanation.local_fits
    monkeypatch.setattr(explanation, "local_fits", lambda fits, **simple: read.append(simple) or every(fits, **simple))
    found, _ = issues(with_spring(with_spring(log, 2), 1))
    assert set(found) == {"spring"}
    alone = read.index({"simple": True})  # each fault of positions, once
    assert alone > 20
    assert len(read) < 2 * alone


def test_a_small_wrong_zero_beside_a_reversed_axis_is_named():
    """With the sign alone the URDF explains the torques as well as most URDFs do."""
    motion, known = random_fourier(UR, 20.0, seed=3), {f"{name}{i}": 1.0 for name in ("fv", "fc") for i in range(1, 7)}
    right = simulate(UR, motion, rate=100.0, effects=BASELINE, parameters=known, noise=Noise(q=1e-5, tau=0.01), seed=3)
    q = right.q.copy()
    q[:, 1] *= -1
    q[:, 2] -= np.deg2rad(5.0)
    found, _ = issues(replace(right, q=q, v=None, a=None))
    assert set(found) >= {"position sign", "joint zero"}
    assert found["joint zero"].where == (UR.joints[2],)


def test_a_spring_does_not_hide_a_tilted_base(log):
    leaning = Robot.load("ur10", base_rpy=(0.3, 0.4, 0.0))
    zero = np.zeros_like(log.q)
    more = leaning.inverse_dynamics(log.q, zero, zero) - UR.inverse_dynamics(log.q, zero, zero)
    found, _ = issues(with_spring(replace(log, tau=log.tau + more), 1))
    assert set(found) >= {"mounting", "spring"}
    assert found["spring"].where == (UR.joints[1],)


@pytest.mark.parametrize("where", [(1,), (1, 2)])
def test_a_body_does_not_hide_a_reversed_axis_or_exchanged_joints(log, where):
    carrying, order, sign = with_body(log, 8.0), np.arange(6), np.ones(6)
    if len(where) == 1:
        sign[list(where)] = -1
    else:
        order[list(where)] = where[::-1]
    faulty = replace(
        carrying, q=(sign * carrying.q)[:, order], v=None, a=None, tau=(sign * np.asarray(carrying.tau))[:, order]
    )
    kind = "position sign" if len(where) == 1 else "swapped joints"
    found, _ = issues(faulty)
    assert set(found) == {kind, "payload"}
    assert found[kind].where == tuple(UR.joints[j] for j in where)


@pytest.mark.parametrize("fault", ["joint zero", "spring", "swapped torques"])
def test_a_late_torque_of_a_fast_motion_does_not_hide_another_fault(fault):
    """The delay alone makes the error of every torque larger than a log is accepted with."""
    motion = random_fourier(UR, 20, seed=3, harmonics=20)
    fast = simulate(UR, motion, rate=100, noise=Noise(q=1e-5, tau=0.02), channels=())
    if fault == "joint zero":
        fast = shifted(fast, 2, 0.9)
    elif fault == "spring":
        fast = with_spring(fast, 1)
    else:
        fast = replace(fast, tau=np.asarray(fast.tau)[:, [0, 2, 1, 3, 4, 5]])
    late = np.column_stack([np.interp(fast.t - 0.2, fast.t, x) for x in np.asarray(fast.tau).T])
    found, report = issues(replace(fast, tau=late))
    assert set(found) == {fault, "late torque"}
    assert abs(report.facts["torque_lag"] - 0.2) < 0.005


def test_the_column_of_another_joint_is_not_called_degrees():
    panda = Robot.load("panda", joints=[f"panda_joint{k}" for k in range(1, 8)])
    log = simulate(panda, random_fourier(panda, 20, seed=2), rate=100, noise=Noise(q=1e-5, tau=0.02), channels=())
    order = np.array([0, 1, 2, 5, 4, 3, 6])
    (report,) = check(panda, [replace(log, q=log.q[:, order], v=None, a=None, tau=np.asarray(log.tau)[:, order])])
    assert "degrees" not in {issue.kind for issue in report.issues}


def test_nothing_is_named_where_something_else_explains_more(log):
    """Three wrong gains are no fault that is named; a likely story that explains less must not take their place."""
    tau = np.array(log.tau)
    tau[:, [0, 1, 2]] *= [5.0, 0.2, 7.0]
    found, report = issues(replace(log, tau=tau))
    assert report.facts.get("explanation", {"probability": 1.0})["probability"] >= 0.5
    assert "unexplained torque" in found or "wrong robot" in found


@pytest.mark.skipif(not os.environ.get("FRISCHID_DATA"), reason="FRISCHID_DATA is not set")
def test_a_fault_without_which_all_torques_are_explained_comes_last(monkeypatch):
    """In mN·m, a measured UR10e has one fault; a reversed wrist makes a good fit a little better, and is a guess."""
    monkeypatch.syspath_prepend(Path(__file__).parents[2] / "benchmarks")
    from log_faults import unit
    from planted_log_faults import measured

    case = measured("ur10e", 100)
    unit(case)
    (report,) = check(case.robot, [case.log])
    first, *others = report.issues
    assert first.kind == "torque scale"
    assert first.where == case.robot.joints
    assert not any(issue.blocks for issue in others)
    assert not any(key == "sign" for _, key, _ in report.fix)


@pytest.mark.skipif(not os.environ.get("FRISCHID_DATA"), reason="FRISCHID_DATA is not set")
@pytest.mark.parametrize("fault", [None, "torque sign", "swapped torques", "joint zero"])
def test_a_fault_stands_out_of_a_urdf_with_errors_of_its_own(fault, monkeypatch):
    """The LBR's base is tilted by 1.8°, and its URDF's masses are guesses: more errors than faults can be named."""
    monkeypatch.syspath_prepend(Path(__file__).parents[2] / "benchmarks")
    from planted_log_faults import measured

    case = measured("lbr_med7", 100)
    tau, q = np.array(case.log.tau), np.array(case.log.q)
    if fault == "torque sign":
        tau[:, 3] *= -1
    if fault == "swapped torques":
        tau[:, [2, 3]] = tau[:, [3, 2]]
    if fault == "joint zero":
        q[:, 3] -= 0.75
    (report,) = check(case.robot, [replace(case.log, q=q, tau=tau)])
    first = report.issues[0]
    where = {"torque sign": ("A4",), "swapped torques": ("A3", "A4"), "joint zero": ("A4",), None: ()}[fault]
    assert (first.kind, first.where) == (fault or "mounting", where)


@dataclass
class Weightless:
    """As much of a sketch as a body on the last link needs."""

    robot: SimpleNamespace = field(default_factory=lambda: SimpleNamespace(gravity=np.zeros(3)))
    criteria: CheckCriteria = DEFAULT_CRITERIA
    nominal: float = 0.0
    given_nominal: float | None = None


@pytest.mark.parametrize(("mass", "lacks"), [(0.4, "URDF lacks"), (-0.4, "robot lacks")])
def test_no_body_has_a_negative_mass(monkeypatch, mass, lacks):
    """Pushes on a Panda were "a body of about -0.37 kg that the URDF lacks"."""
    body = Body("wrist", mass, np.zeros(3), 0.9, np.zeros(1))
    monkeypatch.setattr("frischid.checks.robot_faults.payload_errors", lambda _: body)
    monkeypatch.setattr("frischid.checks.robot_faults.carried_body", lambda _: None)
    (found,) = shared_faults(SimpleNamespace(sketch=Weightless(), weight=np.ones(1)))
    assert found.fault.what.endswith(f"a body of about 0.4 kg on the last link that the {lacks}")
    assert found.fault.advice.startswith("use a URDF with the payload" if mass > 0 else "use a URDF without this hand")


def carrying(start: float, stop: float, noise: float = 0.02) -> Log:
    """A log of a UR10 that carries 3 kg from `start` to `stop`, s."""
    own = dict(zip(UR.all_names, UR.nominal, strict=True))
    body = {"m6": own["m6"] + 3.0, "mz6": own["mz6"] + 0.3}
    motion = random_fourier(UR, 20.0, seed=3)
    bare, loaded = (simulate(UR, motion, rate=100.0, parameters=more, channels=()) for more in ({}, body))
    carried = (bare.t >= start) & (bare.t < stop)
    rng = np.random.default_rng(3)
    tau = np.where(carried[:, None], loaded.tau, bare.tau)
    tau = tau + noise * tau.std(axis=0) * rng.normal(size=tau.shape)
    return replace(bare, q=bare.q + 1e-5 * rng.normal(size=bare.q.shape), v=None, a=None, tau=tau)


@pytest.mark.parametrize("gap", [False, True])
def test_a_load_for_a_part_of_the_log_is_named(gap):
    """It had been exchanged positions of two wrist joints, likely, to be corrected before an identification."""
    log = carrying(6.0, 13.0)
    if gap:  # the times count from the log's first sample, although the filter needs more than the first piece
        keep = (log.t < log.t[0] + 0.3) | (log.t > log.t[0] + 3.0)
        log = replace(log, t=log.t[keep], q=log.q[keep], tau=log.tau[keep])
    (report,) = check(UR, [log])
    (issue,) = [x for x in report.issues if x.blocks]
    assert (issue.kind, issue.where, issue.sure) == ("carried load", ("wrist_3_joint",), "likely")
    start, stop = (float(x) for x in re.findall(r"from ([\d.]+) to ([\d.]+) s", issue.what)[0])
    assert (start, stop) == pytest.approx((6.0, 13.0), abs=0.3)
    mass = float(re.findall(r"about ([\d.]+) kg", issue.what)[0])
    assert mass == pytest.approx(3.0, abs=0.2)
    assert "frischid cut" in issue.advice
    assert "the robot takes up a load and puts a load down" in issue.what


def test_a_load_throughout_is_a_payload():
    (report,) = check(UR, [carrying(0.0, 30.0)])
    assert [x.kind for x in report.issues if x.kind in ("payload", "carried load")] == ["payload"]


def test_links_that_are_wrong_in_any_way_are_no_spring():
    """A spring that explains most of one joint's error was named; links with errors explain those of all joints."""
    arm = Robot.load("ur5")
    rng, nominal = np.random.default_rng(12), dict(zip(arm.all_names, arm.nominal, strict=True))
    values = {f"{kind}{k}": x for kind, x in (("fv", 0.3), ("fc", 0.5), ("Ia", 0.1)) for k in range(1, 7)}
    for k in range(1, 7):
        own = {kind: nominal[f"{kind}{k}"] for kind in LINK_PARAMETERS}
        own |= {kind: own[kind] + 0.02 * own["m"] * rng.normal() for kind in ("mx", "my", "mz")}
        factor = 1 + rng.uniform(0.1, 0.4) * rng.choice([-1, 1])
        values |= {f"{kind}{k}": factor * x for kind, x in own.items()}
    motion = random_fourier(arm, 20, seed=12)
    log = simulate(arm, motion, rate=100, noise=Noise(q=1e-5, tau=0.02), parameters=values, channels=(), seed=12)
    (report,) = check(arm, [log])
    assert {issue.kind for issue in report.issues} <= {"weak excitation", "wrong robot", "unexplained torque"}


def test_a_zero_that_is_off_by_a_quarter_turn_has_the_links_as_a_rival(log, monkeypatch):
    """A motor that turned with two joints, and a wrong centre of mass of the last link, were a zero off by 90°."""
    turned = shifted(log, 2, np.pi / 2)
    assert "joint zero" in issues(turned)[0]
    monkeypatch.setattr(explanation, "_lead_over_links", lambda hypothesis, null: 0.0)
    assert "joint zero" not in issues(turned)[0]


def test_links_that_are_nearly_as_likely_are_in_the_probability(log, monkeypatch):
    """A body was "0.99 against a spring" where links of another weight were 20 times less likely, and unsaid."""
    turned = shifted(log, 2, np.pi / 2)
    assert "0.99 against" in issues(turned)[0]["joint zero"].what
    monkeypatch.setattr(explanation, "_lead_over_links", lambda hypothesis, null: np.log(25.0))
    found, report = issues(turned)
    assert "probability 0.96 against links that weigh something else" in found["joint zero"].what
    assert report.facts["explanation"]["probability"] == pytest.approx(25 / 26, abs=1e-3)
