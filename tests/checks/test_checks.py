"""The data check: silent on clean logs of many robots, and each planted fault is named, with its joint."""

import inspect as inspect_source
import json
import os
import re
from dataclasses import fields, replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from output_schemas import fits

from frischid.checks import defects, inspect
from frischid.checks.channels import quantum
from frischid.checks.check_criteria import DEFAULT_CRITERIA, CheckCriteria
from frischid.checks.log_issue import Notebook
from frischid.checks.payload import determines_mass
from frischid.checks.sketch import Sketch, shared_fit
from frischid.cli import main
from frischid.cli.pages.checking import check as check_page
from frischid.effects import BASELINE
from frischid.errors import InputError
from frischid.logs.filters import LowPass
from frischid.logs.log import Log
from frischid.logs.mapping import LogMap
from frischid.logs.preprocessing import prepare
from frischid.logs.readers import read_log, write_log
from frischid.model.identification import identify
from frischid.model.log_examination import check
from frischid.motions.simulation import Noise, simulate
from frischid.motions.trajectory import random_fourier
from frischid.regression.regressor import Regressor
from frischid.regression.structure import structure
from frischid.robot.robot import Robot

ARM = [f"arm_{k}_joint" for k in range(1, 8)]
ROBOTS = {
    "planar2": {},
    "ur10": {},
    "panda": {},
    "kinova": {},
    "tiago": {"joints": ARM},
    "xarm7": {},
}
SENSORS = {
    "quiet": (100, 20, Noise(q=1e-5, v=1e-3, tau=0.01), ("v",)),
    "noisy": (125, 25, Noise(q=3e-4, v=1e-2, tau=0.05), ("v",)),
    "coarse encoder": (250, 20, Noise(quantum=1e-3, tau=0.02), ()),
    "fast": (1000, 12, Noise(q=2e-5, tau=0.02, quantum=2e-5), ()),
    "exact": (100, 30, Noise(), ("v", "a")),
}


@cache
def machine(name):
    return Robot.load(name, **ROBOTS[name])


def drives(robot, seed):
    """Friction, rotor inertia and offsets of the size drives have."""
    rng = np.random.default_rng(seed)
    effort = np.where(np.isfinite(robot.limits.effort), np.minimum(robot.limits.effort, 100), 20)
    values = {}
    for name, size in zip(robot.joints, effort, strict=True):
        k = robot.numbers[name]
        share = size * rng.uniform(0.3, 1.0, 3)
        values |= {f"fv{k}": 0.025 * share[0], f"fc{k}": 0.03 * share[1], f"Ia{k}": 0.004 * share[2]}
        values[f"off{k}"] = 0.01 * size * rng.normal()
    return values


@pytest.mark.parametrize("end", [9.0, 11.0, 14.0])
def test_a_gap_in_stamps_of_arrival_is_no_other_fault(end):
    """Even steps across the gap had made velocities unrelated, torques mis-scaled and motors coupled."""
    robot, log = machine("ur10"), arrival(clean("ur10"))
    keep = (log.t < 8) | (log.t > end)
    cut = Log(log.t[keep], log.joints, log.q[keep], v=log.v[keep], tau=log.tau[keep])
    found = kinds(robot, cut)
    assert set(found) == {"gap", "host clock"}
    assert "the stamps are times of arrival" in found["host clock"].what


@cache
def clean(name, sensors="quiet", seed=1):
    rate, seconds, noise, channels = SENSORS[sensors]
    robot, motion = machine(name), random_fourier(machine(name), seconds, seed=seed)
    options = {"noise": noise, "channels": channels, "seed": seed, "parameters": drives(robot, seed)}
    return simulate(robot, motion, rate=rate, **options)


def kinds(robot, log):
    (report,) = check(robot, [log])
    return {issue.kind: issue for issue in report.issues}


@pytest.mark.parametrize("sensors", SENSORS)
@pytest.mark.parametrize("name", ROBOTS)
def test_nothing_is_found_in_clean_logs(name, sensors):
    for seed in (1, 2):
        (report,) = check(machine(name), [clean(name, sensors, seed)])
        assert report.warnings == ()


# ---------------------------------------------------------------------- planted faults


def column(x, j, change):
    x = np.array(x)
    x[:, j] = change(x[:, j])
    return x


def swapped(x):
    return None if x is None else x[:, [1, 0, *range(2, x.shape[1])]]


def delayed(log, x, by):
    return np.column_stack([np.interp(log.t - by, log.t, c) for c in x.T])


def stale(log):
    rng = np.random.default_rng(0)
    index = np.arange(len(log))
    late = np.flatnonzero(rng.random(len(log)) < 0.05)
    index[late] = np.maximum(late - 1, 0)
    return replace(log, q=log.q[index], v=log.v[index], tau=log.tau[index])


def arrival(log):
    late = np.minimum(np.random.default_rng(0).exponential(0.15, len(log)), 0.9)
    return replace(log, t=log.t + late / log.rate)


def bursts(log):
    k = np.arange(len(log))
    return replace(log, t=((k // 4 + 1) * 4 + (k % 4) * 0.01) / log.rate)


FIGURES = (r"an error of ([\d. to]+) %", r"position by ([\d. to]+) s")
NOTE = r"by ([\d. to]+) % \(it lags ([\d. to]+) s\)"

FAULTS = {
    "ms": (lambda x: replace(x, t=1e3 * x.t), "unit of time", None, True),
    "ns": (lambda x: replace(x, t=1e9 * x.t), "unit of time", None, True),
    "degrees": (lambda x: replace(x, q=np.rad2deg(x.q), v=np.rad2deg(x.v)), "degrees", "all", True),
    "degrees, rad/s": (lambda x: replace(x, q=np.rad2deg(x.q)), "degrees", "all", True),
    "degrees per second": (lambda x: replace(x, v=np.rad2deg(x.v)), "degrees", "all", False),
    "late velocity": (lambda x: replace(x, v=delayed(x, x.v, 0.05)), "late velocity", "all", False),
    "velocity sign": (lambda x: replace(x, v=column(x.v, 1, np.negative)), "velocity sign", (1,), False),
    "velocity of the motor": (lambda x: replace(x, v=column(x.v, 1, lambda c: 50 * c)), "velocity scale", (1,), False),
    "swapped velocities": (lambda x: replace(x, v=swapped(x.v)), "exchanged velocity", None, False),
    "dead velocity": (lambda x: replace(x, v=column(x.v, 0, np.zeros_like)), "dead velocity", (0,), False),
    "torque sign": (lambda x: replace(x, tau=column(x.tau, 1, np.negative)), "torque sign", (1,), True),
    "torque signs": (lambda x: replace(x, tau=-x.tau), "torque sign", "all", True),
    "swapped torques": (lambda x: replace(x, tau=swapped(x.tau)), "swapped torques", (0, 1), True),
    "turned axis": (
        lambda x: replace(x, q=column(x.q, 1, np.negative), v=None, tau=column(x.tau, 1, np.negative)),
        "position sign", (1,), True,
    ),
    "swapped joints": (
        lambda x: replace(x, q=swapped(x.q), v=swapped(x.v), tau=swapped(x.tau)), "swapped joints", (0, 1), True,
    ),
    "late torque": (lambda x: replace(x, tau=delayed(x, x.tau, 0.05)), "late torque", None, False),
    "dead torque": (lambda x: replace(x, tau=column(x.tau, 1, lambda c: 0 * c + 3.0)), "dead torque", (1,), False),
    "uninitialised torque": (
        lambda x: replace(x, tau=column(x.tau, 1, lambda c: 1e-300 * c)), "dead torque", (1,), False,
    ),
    "dead band": (
        lambda x: replace(x, tau=column(x.tau, 1, lambda c: np.where(np.abs(c) < np.median(np.abs(c)), 0, c))),
        "dead band", (1,), False,
    ),
    "saturated": (
        lambda x: replace(x, tau=column(x.tau, 1, lambda c: np.clip(c, -0.6 * abs(c).max(), 0.6 * abs(c).max()))),
        "saturated torque", (1,), False,
    ),
    "coarse": (
        lambda x: replace(x, tau=column(x.tau, 1, lambda c: np.round(10 * c / np.ptp(c)) / 10 * np.ptp(c))),
        "coarse torque", (1,), False,
    ),
    "held": (lambda x: replace(x, tau=np.repeat(x.tau[::5], 5, axis=0)[: len(x)]), "held torque", "all", False),
    "mN·m": (lambda x: replace(x, tau=1e3 * x.tau), "torque scale", None, False),
    "one gain": (lambda x: replace(x, tau=column(x.tau, 1, lambda c: 10 * c)), "torque scale", (1,), False),
    "stamps of arrival": (arrival, "host clock", None, False),
    "bursts": (bursts, "host clock", None, False),
    "stale rows": (stale, "repeated samples", None, False),
    "no motion": (lambda x: replace(x, q=column(x.q, 0, lambda c: 0 * c)), "no motion", (0,), False),
}  # fmt: skip


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("name", ["planar2", "ur10", "kinova"])
def test_each_fault_is_named(name, fault):
    damage, kind, where, blocks = FAULTS[fault]
    robot, log = machine(name), clean(name)
    found = kinds(robot, damage(log))
    assert kind in found, list(found)
    assert found[kind].blocks is blocks
    assert found[kind].advice
    if where == "all":
        assert found[kind].where == robot.joints
    elif where is not None:
        assert found[kind].where == tuple(robot.joints[j] for j in where)


def test_a_unit_is_undone_exactly_where_the_links_weigh_less_than_in_the_urdf():
    lighter = clean("ur10")
    (report,) = check(machine("ur10"), [replace(lighter, tau=0.9e3 * lighter.tau)])
    assert {(key, value) for _, key, value in report.fix} == {("torque_factor", 0.001)}


def test_a_table_of_poses_is_no_log_in_milliseconds():
    """One row for each pose: in ms the joints would move by a radian per row. The remedy makes a usable log."""
    robot = machine("planar2")
    q = np.random.default_rng(1).uniform(-1.5, 1.5, (30, 2))
    table = Log(t=np.arange(30.0), q=q, tau=robot.inverse_dynamics(q, 0 * q, 0 * q), joints=robot.joints)
    found = kinds(robot, table)["unit of time"]
    assert found.sure == "likely"
    assert "looks like" not in found.what
    assert "each row ten times" in found.advice
    t = (10.0 * np.arange(30)[:, None] + 0.1 * np.arange(10)).ravel()
    rows = np.repeat(np.arange(30), 10)
    assert table.tau is not None
    assert set(kinds(robot, Log(t=t, q=q[rows], tau=table.tau[rows], joints=robot.joints))) == {"standstill"}


def test_lags_are_measured():
    log = clean("ur10")
    (report,) = check(machine("ur10"), [replace(log, v=delayed(log, log.v, 0.05), tau=delayed(log, log.tau, 0.02))])
    assert [figures["velocity_lag"] for figures in report.joints.values()] == pytest.approx([0.05] * 6, abs=2e-3)
    assert report.facts["torque_lag"] == pytest.approx(0.02, abs=2e-3)


def test_gaps_and_true_jitter():
    robot, log = machine("ur10"), clean("ur10")
    keep = (log.t < 8) | (log.t > 8.5)
    cut = Log(log.t[keep], log.joints, log.q[keep], v=log.v[keep], tau=log.tau[keep])
    assert "the longest 520 ms" in kinds(robot, cut)["gap"].what
    # stamps that jitter because the samples did are no fault
    rng = np.random.default_rng(0)
    t = np.sort(log.t + rng.uniform(-0.3, 0.3, len(log)) / log.rate)
    true = simulate(robot, random_fourier(robot, 20, seed=1), rate=2000)
    q, v, tau = (np.column_stack([np.interp(t, true.t, c) for c in x.T]) for x in (true.q, true.v, true.tau))
    (report,) = check(robot, [Log(t, log.joints, q, v=v, tau=tau)])
    assert report.issues == ()
    assert report.facts["stamps_follow"] == pytest.approx(1.0, abs=0.05)
    even = check(robot, [log])[0].joints
    for name, figures in report.joints.items():  # a moving position is no noise
        assert figures["noise_q"] < 2 * max(even[name]["noise_q"], 1e-5)


def test_a_printed_report_is_its_issues_with_their_remedies():
    """In a notebook, the list of reports had been pages of numbers."""
    log = clean("planar2")
    good, bad = check(machine("planar2"), [log, replace(log, tau=-log.tau, source="turned")])
    assert str(good) == f"{log.source}: nothing suspicious in the log"
    assert repr(good) == f"LogReport('{log.source}': no issue)"
    assert repr(bad) == "LogReport('turned': torque sign)"
    name, issue, remedy = str(bad).splitlines()
    assert (name, issue.strip(), remedy.strip()) == ("turned:", bad.issues[0].short, f"→ {bad.issues[0].advice}")


def test_a_motion_that_comes_again_is_a_fact():
    robot, log = machine("ur10"), clean("ur10")
    assert "comes_again_after" not in check(robot, [log])[0].facts
    n = len(log.t) - 1
    t = np.arange(2 * n) * float(np.median(np.diff(log.t)))
    twice = Log(
        t, log.joints, np.tile(log.q[:n], (2, 1)), v=np.tile(log.v[:n], (2, 1)), tau=np.tile(log.tau[:n], (2, 1))
    )
    (report,) = check(robot, [twice])
    assert report.facts["comes_again_after"] == pytest.approx(t[n], abs=0.005)
    assert any("the motion comes again after" in str(part) for part in check_page([report]).parts)


@pytest.mark.parametrize("name", ["ur10", "panda", "kinova"])
@pytest.mark.parametrize("mass", [0.3, 3.0])
def test_payloads_are_weighed(name, mass):
    robot = machine(name)
    last, nominal = robot.numbers[robot.joints[-1]], dict(zip(robot.all_names, robot.nominal, strict=True))
    if name == "panda":
        robot = Robot.load("panda", joints=[f"panda_joint{k}" for k in range(1, 8)])
        last, nominal = 7, dict(zip(robot.all_names, robot.nominal, strict=True))
    more = {"m": mass, "mz": 0.1 * mass, "Ixx": 0.01 * mass, "Iyy": 0.01 * mass}
    values = drives(robot, 1) | {f"{p}{last}": nominal[f"{p}{last}"] + x for p, x in more.items()}
    motion = random_fourier(robot, 20, seed=1)
    log = simulate(robot, motion, rate=100, noise=SENSORS["quiet"][2], parameters=values, channels=("v",))
    found = kinds(robot, log)
    assert f"about {mass:.2g} kg at (0.00, 0.00, 0.10) m" in found["payload"].what


def test_a_log_of_three_seconds_is_no_evidence_of_a_body():
    """Ten numbers fit six independent samples: links of other weight looked like a body."""
    robot = Robot.load("double_pendulum")
    for seed in range(6, 10):
        factor = np.random.default_rng(seed).uniform(0.8, 1.25, 2)
        own = zip(robot.all_names, robot.nominal, strict=True)
        values = {n: x * factor[int(n.rstrip("R")[-1]) - 1] for n, x in own}
        values |= {"fv1": 0.1, "fv2": 0.05, "fc1": 0.1, "fc2": 0.05}
        motion, noise = random_fourier(robot, 20, seed=seed, scale=0.3), Noise(q=1e-5, tau=0.005)
        log = simulate(robot, motion, rate=100, noise=noise, parameters=values, channels=(), seed=seed)
        assert not {"payload", "missing hand"} & set(kinds(robot, log.slice(0, 300))), seed


def test_wrong_robot_and_wrong_mounting():
    ur5 = Robot.load("ur5")
    assert "wrong robot" in kinds(ur5, replace(clean("ur10"), joints=ur5.joints))
    tilted = Robot.load("panda", base_rpy=(0.3, 0.0, 0.0))
    log = simulate(tilted, random_fourier(tilted, 20, seed=1), rate=200, noise=Noise(q=1e-5, tau=0.01))
    assert "(0, -2.9, -9.37) m/s²" in kinds(machine("panda"), log)["mounting"].what


@pytest.mark.parametrize("name", ["panda", "ur10", "planar2"])
def test_torques_without_the_gravity_that_the_controller_adds(name):
    """Commanded torques of libfranka are such; they were named a wrong unit of all torques."""
    robot = machine(name)
    for seed in (1, 2):
        log = clean(name, seed=seed)
        holding = robot.inverse_dynamics(log.q, 0 * log.q, 0 * log.q) * 1.05  # the controller's own model
        assert log.tau is not None
        (first, *_) = kinds(robot, replace(log, tau=log.tau - holding))
        assert first == "no gravity"


def test_the_criteria_that_decided_are_told():
    robot, log = machine("planar2"), clean("planar2")
    strict = CheckCriteria(related_correlation=1.1)  # no velocity is as related as that
    for criteria, expected in ((DEFAULT_CRITERIA, set()), (strict, {"unrelated velocity"})):
        report = inspect(robot, log, lambda: structure(Regressor(robot, BASELINE), robot.joints), criteria=criteria)
        assert report.criteria is criteria
        assert {issue.kind for issue in report.issues} == expected
    written = check_page([report]).data["criteria"]
    assert written["related_correlation"] == 1.1
    assert set(written) == {f.name for f in fields(CheckCriteria)}
    assert json.loads(json.dumps(written)) == written


def test_every_criterion_has_its_reason():
    source = inspect_source.getsource(CheckCriteria)
    names = [f.name for f in fields(CheckCriteria)]
    assert len(names) == len(re.findall(r'^    \w+: .*\n    """', source, flags=re.MULTILINE))
    folder = Path(inspect_source.getfile(CheckCriteria)).parent
    used = "".join(path.read_text(encoding="utf-8") for path in folder.glob("*.py") if path.stem != "check_criteria")
    assert [name for name in names if f".{name}" not in used] == []


def test_every_kind_of_issue_is_planted_in_some_test():
    """A new check without a test had passed all others."""
    checks, tests = Path(inspect_source.getfile(CheckCriteria)).parent, Path(__file__).parents[1]
    said = "".join(path.read_text(encoding="utf-8") for path in tests.rglob("test_*.py"))
    calls = re.compile(r"(?:notes\.add|\bFault|\bLogIssue)\(\s*\"([a-z ]+)\"")
    kinds = {kind for path in checks.glob("*.py") for kind in calls.findall(path.read_text(encoding="utf-8"))}
    assert len(kinds) > 40
    missing = sorted(kind for kind in kinds if f'"{kind}"' not in said)
    assert not missing, "plant the fault in a log: an entry of FAULTS, or a test of its own"


def test_a_torque_that_runs_ahead_is_not_called_late():
    log = clean("ur10")
    early = kinds(machine("ur10"), replace(log, tau=delayed(log, log.tau, -0.05)))["early torque"]
    assert early.advice.startswith("joints that stick at reversals look the same")
    assert "runs ahead of the motion by 50." in early.what


def test_blocking_issues_come_first():
    log = clean("planar2")
    damaged = replace(log, q=np.rad2deg(log.q), tau=column(log.tau, 1, lambda c: 0 * c + 3.0))
    (report,) = check(machine("planar2"), [damaged])
    blocks = [issue.blocks for issue in report.issues]
    assert blocks == sorted(blocks, reverse=True)
    assert blocks[0]
    assert not blocks[-1]


def test_of_issues_that_do_not_block_the_surest_comes_first():
    notes = Notebook(("a", "b"))
    for kind, sure, blocks in (("1", "possible", False), ("2", "certain", False), ("3", "likely", True)):
        notes.add(kind, "", (), sure, "", blocks=blocks)
    notes.add("4", "", (), "certain", "", blocks=True)
    notes.add("5", "", (), "likely", "")
    assert [issue.kind for issue in notes.report("log").issues] == ["4", "3", "2", "5", "1"]


def test_the_longest_gap_of_a_file_is_told_with_its_line(tmp_path):
    t = np.arange(300) * 0.01
    t[100:] += 0.3
    t[200:] += 0.2
    path = tmp_path / "log.csv"
    path.write_text("t,q_joint1,tau_joint1\n" + "".join(f"{x:.2f},0.1,{k}\n" for k, x in enumerate(t)) + "nan,0,0\n")
    gap = {issue.kind: issue for issue in defects(path, LogMap()).issues}["gap"]
    # the header is line 1, so the hundredth sample is line 101
    assert gap.what == "2 gaps in the time stamps, the longest 0.31 s after line 101"
    assert not gap.blocks


def test_parameters_that_a_log_cannot_see_are_named():
    robot = machine("planar2")
    (rich,) = check(robot, [clean("planar2")])
    held = replace(clean("planar2"), q=column(clean("planar2").q, 1, lambda c: 1e-3 * c), v=None)
    (poor,) = check(robot, [held])
    assert rich.facts["unseen_parameters"] == []
    assert any(name.endswith("2") for name in poor.facts["unseen_parameters"])


def test_every_defect_of_a_file_is_told_at_once(tmp_path):
    path = tmp_path / "log.csv"
    rows = [[f"{0.01 * k:.2f}", "0.1", "0.2", "1", "2"] for k in range(300)]
    rows[50][1] = "nan"
    rows[80] = rows[80][:3]
    rows[120][0] = "9e9"
    rows[160][0] = rows[159][0]
    del rows[200:220]
    rows[-1] = rows[-1][:2]
    head = "t,q_joint1,q_joint2,tau_joint1,tau_joint2"
    path.write_text("\n".join([head, *map(",".join, rows)]) + "\n")
    found = {issue.kind: issue.what for issue in defects(path, LogMap()).issues}
    assert set(found) == {"truncated line", "ragged lines", "garbage rows", "time", "gap"}
    assert "82" in found["ragged lines"]  # the header is line 1
    assert "162" in found["time"]
    path.write_text("\n".join([head, *map(",".join, rows[:40])]) + "\n")
    assert defects(path, LogMap()) is None


def test_empty_cells_are_no_gap_in_the_time_stamps(tmp_path):
    """Twenty lines without one torque had been "certain: a gap in the time stamps of 0.168 s"."""
    path = tmp_path / "log.csv"
    rows = [[f"{0.01 * k:.2f}", "0.1", "" if 50 <= k < 70 else "1"] for k in range(300)]
    path.write_text("\n".join(["t,q_joint1,tau_joint1", *map(",".join, rows)]) + "\n")
    (issue,) = defects(path, LogMap()).issues
    assert (issue.kind, "52 to 71" in issue.what) == ("garbage rows", True)
    assert "a cell is empty" in issue.advice
    printed = CliRunner().invoke(main, ["check", "planar2", str(path)])
    assert printed.exit_code == 2
    assert "52 to 71" in printed.output  # the error names the first line alone
    machine_readable = CliRunner().invoke(main, ["check", "planar2", str(path), "--json"])
    data = json.loads(machine_readable.stdout)
    fits("check", data)
    assert data["logs"][0]["bad_lines"] == 20


def test_a_column_without_any_measurement_makes_no_line_garbage(tmp_path):
    """A clock in ns beside a log without 't' had made all lines "garbage rows", to be deleted."""
    path = tmp_path / "log.csv"
    rows = [[str(1_700_000_000_000_000_000 + 10_000_000 * k), "0.1", ""] for k in range(50)]
    path.write_text("\n".join(["timestamp,q_joint1,unused", *map(",".join, rows)]) + "\n")
    assert defects(path, LogMap()) is None
    printed = CliRunner().invoke(main, ["check", "planar2", str(path)])
    assert (printed.exit_code, "garbage" in printed.output, "no time column" in printed.output) == (2, False, True)
    rows[0][1], rows[30][1], rows[40][2] = "", "nan", "1"  # a column whose first lines are empty holds a measurement
    path.write_text("\n".join(["timestamp,q_joint1,unused", *map(",".join, rows)]) + "\n")
    (issue,) = defects(path, LogMap()).issues
    assert "49 lines" in issue.what  # 'unused' is measured in one line
    rows[40][2] = ""
    path.write_text("\n".join(["timestamp,q_joint1,unused", *map(",".join, rows)]) + "\n")
    (issue,) = defects(path, LogMap()).issues
    assert issue.what.endswith(": 2, 32")


def test_a_time_column_beyond_the_last_is_no_time(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("t,q_joint1\n0,0\n1,nan\n2,0\n3,0\n")
    found = defects(path, LogMap.from_dict({"file": {"time": 99}}))
    assert [issue.kind for issue in found.issues] == ["garbage rows"]
    with pytest.raises(InputError, match="a column number from 0"):
        LogMap.from_dict({"file": {"time": 10**400}})


def test_columns_that_say_nothing_are_given_up():
    """SciPy's nnls frees memory twice if its matrix has no column: that would end the process."""
    log = clean("planar2")
    motions = prepare(log.select(machine("planar2").joints), LowPass(5.0)).motions
    sketch = Sketch.of(machine("planar2"), motions, LowPass(5.0), log.joints)
    overflowing = np.full((len(sketch), 1), 1e300)
    with np.errstate(over="ignore"):
        found = shared_fit(sketch, dict.fromkeys(map(int, sketch.rows), overflowing), sketch.tau)
    assert not found.any()


def test_quantum():
    rng = np.random.default_rng(0)
    x = rng.normal(size=5000)
    assert quantum(x) == 0
    assert quantum(np.round(x / 0.01) * 0.01) == pytest.approx(0.01)
    assert quantum(np.zeros(100)) == 0


# ---------------------------------------------------------------------- identify


def test_identify_prints_the_short_form_and_refuses_what_is_worthless():
    robot, log = machine("planar2"), clean("planar2")
    options = {"recursion": "none"}
    assert identify(robot, [log], **options).warnings == identify(robot, [log], force=True, **options).warnings
    late = identify(robot, [replace(log, v=delayed(log, log.v, 0.05))], **options)
    assert any("lags its own position" in w and "late velocity" in w for w in late.warnings)
    for damage, words in ((FAULTS["degrees"][0], "looks like degrees"), (FAULTS["ms"][0], r'time_unit = "ms"')):
        with pytest.raises(InputError, match=rf"{words}.*--force"):
            identify(robot, [damage(log)], **options)
    found = identify(robot, [FAULTS["degrees"][0](log)], force=True, **options)
    assert any("degrees" in w for w in found.warnings)


def test_a_motion_faster_than_the_urdf_allows_is_not_in_degrees():
    log = clean("kinova")
    fast = replace(log, t=log.t[0] + (log.t - log.t[0]) / 6, v=None if log.v is None else 6 * log.v)
    assert (np.ptp(fast.q, axis=0) < 2 * np.pi).all()
    (report,) = check(machine("kinova"), [fast])
    assert "degrees" not in {issue.kind for issue in report.issues}


def test_identify_refuses_to_hold_out_what_it_fitted():
    robot, log = machine("planar2"), clean("planar2")
    with pytest.raises(InputError, match="both fitted and held out"):
        identify(robot, [log], valid=[replace(log, source="copy")], recursion="none")


@pytest.mark.parametrize("cutoff", [40.0, 50.0])
def test_a_cutoff_that_would_filter_nothing_is_refused(cutoff):
    with pytest.raises(InputError, match=f"cut-off of {cutoff:g} Hz is not below 0.4 times its rate of 100 Hz"):
        identify(machine("planar2"), [clean("planar2")], cutoff=cutoff)


# ---------------------------------------------------------------------- real logs: what their cards say

GAINS = [11.97, 11.98, 9.84, 10.75, 10.69, 10.68]


@pytest.fixture
def data():
    if not (folder := os.environ.get("FRISCHID_DATA")):
        pytest.skip("FRISCHID_DATA is not set")
    return Path(folder)


def measured(data, urdf, log, mapping=None):
    robot = Robot.load(data / urdf)
    return kinds(robot, read_log(data / log, robot.joints, mapping))


def test_tiago(data):
    found = measured(data, "tiago/tiago_48_schunk.urdf", "tiago/logs/ident_0_48s.parquet")
    assert found["dead band"].where == ("arm_5_joint", "arm_6_joint", "arm_7_joint")
    assert len(found["late velocity"].where) == 8
    assert "steps between 7.96 and 12.3 ms" in found["host clock"].what
    assert "the URDF's own parameters with 0.1" in found["weak excitation"].what
    assert set(found) == {"dead band", "late velocity", "host clock", "weak excitation"}


def test_panda(data):
    robot = Robot.load(data / "panda/panda.urdf")
    (report,) = check(robot, [read_log(data / "panda/logs/ident_0_14s.parquet", robot.joints)])
    assert {f.kind for f in report.issues} == {"gap"}  # lost cycles; their stamps are true
    assert report.facts["stamps_follow"] == pytest.approx(1.0, abs=1e-3)
    host = measured(data, "panda/panda.urdf", "panda/logs/traj1_raw_host_time.parquet")
    assert set(host) == {"gap", "repeated samples", "host clock"}
    hand = measured(data, "panda/panda_with_hand.urdf", "panda/logs/ident_0_14s.parquet")
    assert set(hand) == {"gap", "missing hand"}
    assert "about 0.72 kg" in hand["missing hand"].what  # the hand weighs 0.73


@pytest.mark.parametrize(("joints", "seen"), [(None, True), (["joint2"], False)])
def test_one_joint_does_not_weigh_its_link(joints, seen):
    # the torque of a single joint depends on the first moment of its link and not on the mass
    robot = Robot.load("planar2", joints=joints)
    size = (60, len(robot.joints))
    Y = np.empty((size[0], len(robot.columns), size[1]))
    robot.regressor(*np.random.default_rng(1).normal(size=(3, *size)), Y)
    last = [i for i, column in enumerate(robot.columns) if column.joint == "joint2"]
    assert determines_mass(Y[:, last]) is seen


def test_ur10e(data):
    robot = Robot.load(data / "ur10e/ur10e.urdf")
    mapping = {"current_gain": dict(zip(robot.joints, GAINS, strict=True))}
    names = ["ident_20s_5harm", "unloaded_50s_14harm", "valid_ptp_10_points", "loaded_2805g_50s_14harm"]
    logs = [read_log(data / f"ur10e/logs/{n}.parquet", robot.joints, mapping) for n in names]
    *plain, loaded = [{f.kind for f in report.issues} for report in check(robot, logs)]
    assert plain == [set()] * 3  # friction lags by 10 to 35 ms, in each joint by its own time
    assert loaded == {"payload"}


def test_a_late_recording_is_told_from_friction_that_lags(data):
    robot = Robot.load(data / "ur10e/ur10e.urdf")
    log = read_log(
        data / "ur10e/logs/ident_40s_12harm.parquet",
        robot.joints,
        {"current_gain": dict(zip(robot.joints, GAINS, strict=True))},
    )
    (lags, late) = check(robot, [log, replace(log, tau=delayed(log, log.tau, 0.06))])
    assert lags.facts["torque_lag"] > 0.015
    assert not lags.issues
    assert [(i.kind, i.where) for i in late.issues] == [("late torque", ())]
    assert "identify takes that back" in late.issues[0].advice


@pytest.mark.parametrize("delay", [-0.06, 0.06, 0.1])
def test_the_delay_that_is_told_is_that_of_the_recording(data, delay):
    """Friction that follows a reversal late was in it: 83 ± 1.6 ms for 60 ms, 37 ± 1.6 ms for -60 ms."""
    robot = Robot.load(data / "ur10e/ur10e.urdf")
    log = read_log(
        data / "ur10e/logs/ident_40s_12harm.parquet",
        robot.joints,
        {"current_gain": dict(zip(robot.joints, GAINS, strict=True))},
    )
    (report,) = check(robot, [replace(log, tau=delayed(log, log.tau, delay))])
    (issue,) = report.issues
    told, error = (float(x) for x in re.search(r"by ([\d.]+) ± ([\d.]+) ms", issue.what).groups())
    assert issue.kind == ("late torque" if delay > 0 else "early torque")
    assert abs(told - 1e3 * abs(delay)) < 2 * error < 20


def test_the_delay_of_a_single_joint_may_be_its_friction():
    log = clean("ur10")
    issue = kinds(Robot.load("ur10"), replace(log, tau=column(log.tau, 0, lambda _: delayed(log, log.tau, 0.05)[:, 0])))
    assert issue["late torque"].where == log.joints[:1]
    assert "friction that follows a reversal late" in issue["late torque"].advice


def test_a_locked_joint_that_moves_is_told():
    """An arm whose last joint is light: the torques of the others do not tell that it moves."""
    log = clean("ur10")
    locked = Robot.load("ur10", joints=list(log.joints[:-1]))
    issue = kinds(locked, log)["locked joint moves"]
    assert issue.what == f"locked but moving in the log: {log.joints[-1]} by {np.ptp(log.q[:, -1]):.2g} rad (m)"
    assert "--torque-joints" in issue.advice
    still = replace(log, q=column(log.q, 5, lambda c: 0 * c), v=None)
    assert "locked joint moves" not in kinds(locked, still)


def test_an_unexplained_torque_is_told_with_its_error_alone():
    """A torque of which the URDF explains much is not hardly explained."""
    log = clean("ur10")
    ripple = 0.5 * log.tau[:, 1].std() * np.sign(np.sin(11 * log.q[:, 1]))
    issue = kinds(machine("ur10"), replace(log, tau=column(log.tau, 1, lambda c: c + ripple)))["unexplained torque"]
    assert issue.where == (log.joints[1],)
    error = float(re.match(r"the URDF's inertials with fitted friction leave .* of NRMSE ([\d.]+)", issue.what)[1])
    assert 0.3 < error < 0.6
    assert "the error of real arms is below 0.3" in issue.what


@pytest.mark.parametrize("column", ["empty", "missing"])
def test_an_empty_torque_column_is_called_empty(tmp_path, column):
    log = clean("planar2")
    rows = np.column_stack([log.t, log.q, log.tau])
    head = ["t", "q_joint1", "q_joint2", "tau_joint1", "tau_joint2"]
    if column == "missing":
        rows, head = rows[:, :4], head[:4]
    else:
        rows[:, 4] = np.nan
    path = tmp_path / "log.csv"
    np.savetxt(path, rows, delimiter=",", header=",".join(head), comments="")
    issue = kinds(machine("planar2"), read_log(path))["no torque"]
    assert issue.where == ("joint2",)
    assert ("its torque column is empty" in issue.what) is (column == "empty")
    assert ("no torque column" in issue.what) is (column == "missing")


def test_one_joint_is_no_joints_and_zero_has_no_sign():
    robot = Robot.load("planar2", joints=["joint1"])
    log = simulate(robot, random_fourier(robot, 20, seed=1), rate=100, noise=Noise(q=1e-5, tau=0.01), channels=())
    (report,) = check(robot, [log])
    facts = {**report.facts, "rigid_parameters": 1, "unseen_parameters": [], "stamps_follow": -0.0001, "jitter": 0.1}
    facts["stamps_follow_error"] = 0.02
    shown = " ".join(map(str, check_page([replace(report, facts=facts)]).parts))
    assert ", 1 joint, channels q, tau" in shown
    assert "determines 1 rigid base parameter that is not 0" in shown
    assert "by a factor of 0.000 ± 0.020 (1: the stamps are the times of measurement)" in shown


def test_the_advice_on_a_velocity_in_rpm_makes_the_log_right(tmp_path):
    """The mapping file takes the factor that the advice names, for one joint."""
    robot, log = machine("ur10"), clean("ur10")
    name = robot.joints[1]
    spoiled = replace(log, v=column(log.v, 1, lambda c: 30 / np.pi * c))
    (report,) = check(robot, [spoiled])
    (issue,) = (issue for issue in report.issues if issue.kind == "velocity scale")
    assert "9.55 times the slope of the position: velocities are in revolutions per minute" in issue.what
    assert f"set velocity_factor = 0.1047 under [joint.{name}] in a mapping file" in issue.advice
    write_log(spoiled, tmp_path / "log.npz")
    mended = read_log(tmp_path / "log.npz", robot.joints, {"joint": {name: {"velocity_factor": 0.1047}}})
    (report,) = check(robot, [mended])
    assert not report.issues


def test_a_late_velocity_has_one_set_of_figures():
    """What `check` reports, what `identify` warns of, and its note on what it does instead."""
    robot = machine("planar2")
    log = simulate(robot, random_fourier(robot, 60, seed=1), rate=100)
    log = replace(log, v=delayed(log, log.v, 0.15))
    (report,) = check(robot, [log])
    (late,) = (issue for issue in report.issues if issue.kind == "late velocity")
    found = identify(robot, [log], recursion="none")
    assert f"{log.source}: {late.short}" in found.warnings
    (note,) = (text for text in found.notes if "measured velocity" in text)
    figures = [re.search(pattern, late.what)[1] for pattern in FIGURES]
    for one, other in zip(figures, re.search(NOTE, note).groups(), strict=True):
        assert float(one.split(" to ")[0]) == pytest.approx(float(other.split(" to ")[0]), rel=0.05)
        assert float(one.split(" to ")[-1]) == pytest.approx(float(other.split(" to ")[-1]), rel=0.05)


def test_a_coarse_encoder_of_a_slow_arm_that_rests_is_no_buffer():
    """It advances by no step, one or two between two samples, and repeats its values at standstill."""
    t = np.arange(0.0, 40.0, 0.005)
    moving = np.sin(2 * np.pi * t / 20.0) > 0  # ten seconds of motion, ten seconds of standstill
    slow = np.cumsum(np.where(moving, 0.15 * np.sin(2 * np.pi * t / 2.5), 0.0)) * 0.005
    step = 2 * np.pi / 8192
    q = np.array([float(f"{x:.9g}") for x in np.round((0.3 + slow) / step) * step])  # as a file holds them
    tau = np.random.default_rng(0).normal(size=(len(t), 2))
    log = Log(t, ("joint1", "joint2"), q=np.column_stack([q, -q]), tau=tau, source="slow")
    (report,) = check(Robot.load("planar2"), [log])
    assert "host clock" not in [issue.kind for issue in report.issues]
    assert report.joints["joint1"]["noise_q"] == pytest.approx(step / np.sqrt(12), rel=0.3)


def _wrist(mass, y, z):
    """An arm of two joints; the last link's centre of mass is y and z beside the last axis, m."""
    inertia = '<inertia ixx="{0}" iyy="{0}" izz="{0}" ixy="0" ixz="0" iyz="0"/>'
    links = [("arm", 3.0, "0.15 0 0", 0.02), ("tool", mass, f"0.02 {y} {z}", 0.0006)]
    bodies = "".join(
        f'<link name="{name}"><inertial><origin xyz="{at}"/><mass value="{m}"/>{inertia.format(i)}</inertial></link>'
        for name, m, at, i in links
    )
    joints = "".join(
        f'<joint name="{name}" type="revolute"><parent link="{a}"/><child link="{b}"/><origin xyz="{at} 0 0"/>'
        f'<axis xyz="{axis}"/><limit lower="-2" upper="2" velocity="6" effort="50"/></joint>'
        for name, a, b, at, axis in [("lift", "base", "arm", 0, "0 1 0"), ("roll", "arm", "tool", 0.3, "1 0 0")]
    )
    return f'<robot name="wrist"><link name="base"/>{bodies}{joints}</robot>'


@pytest.mark.parametrize(("y", "z"), [(0.0026, -0.0004), (0.0005, 0.0025)])
def test_a_last_link_with_another_centre_of_mass_has_no_wrong_zero(tmp_path, y, z):
    """A zero of the last joint turns its link, and a wrong centre of mass of this link has nearly the same torques."""
    nominal, real = (tmp_path / f"{name}.urdf" for name in ("nominal", "real"))
    nominal.write_text(_wrist(0.5, 0.002, 0.001), encoding="utf-8")
    real.write_text(_wrist(0.5, y, z), encoding="utf-8")
    robot = Robot.load(real)
    motion = random_fourier(robot, 20.0, seed=1)
    log = simulate(robot, motion, rate=200, noise=Noise(q=1e-5, tau=1e-4), channels=())
    assert "joint zero" not in kinds(Robot.load(nominal), log)
