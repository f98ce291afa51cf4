"""Files as controllers of several vendors write them: names, units, clocks and orders that `map` must read."""

import json
from dataclasses import replace

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from proposed_mapping import mapped

from frischid.checks.defects import defects
from frischid.errors import InputError
from frischid.logs.column_names import assign, split
from frischid.logs.cutoff_choice import choose_lowpass
from frischid.logs.mapping import LogMap
from frischid.logs.mapping_guess import propose
from frischid.logs.readers import read_chunks, read_log
from frischid.logs.wraps import continuous
from frischid.motions.simulation import Noise, simulate
from frischid.motions.trajectory import random_fourier
from frischid.robot.robot import Robot

J = range(6)


@pytest.fixture(scope="module")
def robot():
    return Robot.load("ur5")


@pytest.fixture(scope="module")
def log(robot):
    return simulate(robot, random_fourier(robot, 20, seed=1), rate=100, noise=Noise(q=1e-5, tau=0.02), channels=("v",))


def write(path, head, columns):
    np.savetxt(path, np.column_stack(columns), delimiter=",", header=",".join(head), comments="", fmt="%.12g")
    return path


def numbered(*words, first=0):
    return [f"{word}{j + first}" for word in words for j in J]


def test_the_tools_force_is_no_torque_of_a_joint(tmp_path, robot, log):
    head = ["timestamp", *numbered("target_moment_", "actual_q_", "actual_current_", "actual_TCP_force_")]
    force = np.sin(log.t[:, None] + np.arange(6))
    found, read = mapped(write(tmp_path / "a.csv", head, [log.t, log.tau, log.q, log.tau / 10, force]), robot)
    assert not found.guesses
    assert read.tau is None
    np.testing.assert_allclose(read.current, log.tau / 10, atol=1e-6)


def test_a_torque_that_the_urdf_does_not_explain_beside_currents(tmp_path, robot, log):
    rest = 0.1 * np.random.default_rng(0).normal(size=log.q.shape)
    head = ["t", *numbered("q_", "tau_", "current_")]
    found, read = mapped(write(tmp_path / "a.csv", head, [log.t, log.q, rest, log.tau / 10]), robot)
    assert read.tau is None
    assert any("tau_0 ... left out" in guess for guess in found.guesses)


def test_plain_names_before_others_that_are_explained_as_well(tmp_path, robot, log):
    head = ["time", *(f"{word}[{j}]" for word in ("q", "tau_J", "tau_J_d") for j in J)]
    _, read = mapped(write(tmp_path / "a.csv", head, [log.t, log.q, log.tau, 0.5 * log.tau]), robot)
    np.testing.assert_allclose(read.tau, log.tau, atol=1e-6)


def test_german_compounds(tmp_path, robot, log):
    assert split("Istposition_A1") == ("q", "a_1")
    assert split("motor_current_1") == ("current", "motor_1")
    head = [
        "Zeit[s]",
        *(f"{word} A{j + 1} [{unit}]" for word, unit in (("Achsposition", "°"), ("Achsmoment", "Nm")) for j in J),
    ]
    found, read = mapped(write(tmp_path / "a.csv", head, [log.t, np.rad2deg(log.q), log.tau]), robot)
    assert not found.guesses
    np.testing.assert_allclose(read.q, log.q, atol=1e-6)
    np.testing.assert_allclose(read.tau, log.tau, atol=1e-6)


@pytest.mark.parametrize("clock", ["ts", "elapsed"])
def test_a_counter_of_rows_is_no_clock_beside_a_clock(tmp_path, robot, log, clock):
    head = ["cnt", clock, *(f"J{j + 1}_{word}" for word in ("angle", "speed", "torque") for j in J)]
    found, read = mapped(write(tmp_path / "a.csv", head, [np.arange(len(log)), log.t, log.q, log.v, log.tau]), robot)
    assert found.file["time"] == clock
    np.testing.assert_allclose(read.v, log.v, atol=1e-6)


def test_degrees_from_0_to_360(tmp_path, robot, log):
    head = ["timestamp_us", *(f"actuators[{j}].{word}" for word in ("position", "velocity", "torque") for j in J)]
    columns = [1e6 * (log.t + 5), np.rad2deg(log.q) % 360, np.rad2deg(log.v), log.tau]
    found, read = mapped(write(tmp_path / "a.csv", head, columns), robot)
    assert not found.guesses
    assert found.file == {"time": "timestamp_us", "time_unit": "us", "angle_unit": "deg"}
    np.testing.assert_allclose(read.v, log.v, atol=1e-6)


def test_the_cutoff_of_wrapped_angles_is_that_of_the_motion(robot, log):
    wrapped = replace(log, q=log.q % (2 * np.pi))
    assert np.abs(np.diff(wrapped.q, axis=0)).max() > 6
    assert choose_lowpass([wrapped], log.joints) == choose_lowpass([log], log.joints)


def test_alphabetical_order_is_found_by_the_torques(tmp_path, robot, log):
    order = np.argsort(np.array(robot.joints))
    head = ["%time", *(f"field.{word}{j}" for word in ("position", "velocity", "effort") for j in J)]
    columns = [1e9 * log.t + 1.7e18, log.q[:, order], log.v[:, order], log.tau[:, order]]
    found, read = mapped(write(tmp_path / "a.csv", head, columns), robot)
    assert not found.guesses
    np.testing.assert_allclose(read.q, log.q, atol=1e-6)
    np.testing.assert_allclose(read.tau, log.tau, atol=1e-6)


def test_letters_of_axes_pulses_and_desired_torques(tmp_path, log):
    robot = Robot.load("ur5")
    axes = ["joint_1_s", "joint_2_l", "joint_3_u", "joint_4_r", "joint_5_b", "joint_6_t"]
    names = {f"{a}_FeedbackPulse": split(f"{a}_FeedbackPulse")[1] for a in "SLURBT"}
    assert assign(names, axes).columns == dict(zip(axes, names, strict=True))
    head = ["Time[ms]", *(f"Axis{j + 1}_FeedbackPulse" for j in J), *(f"Axis{j + 1}_TorqueRef" for j in J)]
    found = propose(write(tmp_path / "a.csv", head, [1e3 * log.t, np.round(1e5 * log.q), log.tau]), robot)
    assert all("q" in c and "tau" in c for c in found.joints.values())
    assert any("a desired value" in guess for guess in found.guesses)
    assert any("encoder counts" in guess for guess in found.guesses)


def test_the_clock_before_the_counter_and_feedback_before_the_plan(tmp_path, robot, log):
    head = ["seqno", "tm_ms", *(f"{w}[{j}]" for w in ("planned.joints", "feedBack.joints", "torque_ref") for j in J)]
    columns = [np.arange(len(log)), 1e3 * log.t, log.q + 0.01, log.q, log.tau]
    found, read = mapped(write(tmp_path / "a.csv", head, columns), robot)
    assert found.file["time"] == "tm_ms"
    np.testing.assert_allclose(read.q, log.q, atol=1e-6)


def test_families_whose_names_are_equally_plain_are_a_guess(tmp_path, robot, log):
    head = ["IPOC", *(f"{w}.A{j + 1}" for w in ("AIPos", "ASPos", "MACur") for j in J)]
    columns = [4e9 + 1e3 * log.t, np.rad2deg(log.q), np.rad2deg(log.q) + 0.1, log.tau / 10]
    found, read = mapped(write(tmp_path / "a.csv", head, columns), robot)
    assert any("AIPos.A1 ... and not ASPos.A1" in guess for guess in found.guesses)
    assert found.file["time"] == "IPOC"
    np.testing.assert_allclose(read.current, log.tau / 10, atol=1e-6)


def test_columns_of_lists(tmp_path, robot, log):
    path = tmp_path / "a.parquet"
    columns = {"timestamp": log.t, **{f"observation.{n}": [list(x) for x in getattr(log, n)] for n in ("q", "tau")}}
    pq.write_table(pa.table(columns), path)
    found, read = mapped(path, robot)
    np.testing.assert_allclose(read.q, log.q)
    np.testing.assert_allclose(read.tau, log.tau)
    parts = list(read_chunks(path, robot.joints, path.with_suffix(".toml"), samples=500))
    np.testing.assert_allclose(np.concatenate([part.tau for part in parts]), log.tau)
    assert found.joints[robot.joints[0]]["q"] == "observation.q_0"


def test_a_column_of_lists_of_one_number(tmp_path):
    """Before, no column of a robot with one joint was found."""
    q = np.linspace(0, 1, 50)
    path = tmp_path / "a.parquet"
    pq.write_table(pa.table({"t": np.arange(50) / 100, "q": [[x] for x in q]}), path)
    read = read_log(path, ("slide",), LogMap.of({"joint": {"slide": {"q": "q_0"}}}))
    np.testing.assert_allclose(read.q[:, 0], q)


def test_json_is_told_how_to_become_columns_of_lists(tmp_path, robot, log):
    pandas = pytest.importorskip("pandas")
    rows = [{"state": {"time": float(t), "q": list(q)}} for t, q in zip(log.t, log.q, strict=True)]
    path = tmp_path / "a.json"
    path.write_text(json.dumps(rows))
    with pytest.raises(InputError, match=r"json_normalize\(json.load\(open\(...\)\)\).to_parquet"):
        propose(path, robot)
    with path.open() as file:
        pandas.json_normalize(json.load(file)).to_parquet(tmp_path / "b.parquet")
    _, read = mapped(tmp_path / "b.parquet", robot)
    np.testing.assert_allclose(read.q, log.q)


def test_lists_in_cells_of_a_csv_are_named(tmp_path, robot):
    path = tmp_path / "a.csv"
    path.write_text("time,q\n" + "".join(f'{k / 100},"[{k}, 2, 3]"\n' for k in range(50)))
    with pytest.raises(InputError, match="write a column for each joint"):
        propose(path, robot)


def test_rows_that_were_recorded_repeatedly(tmp_path, robot, log):
    twice = np.repeat(np.arange(len(log)), np.tile([2, 1, 3], len(log))[: len(log)])
    head = ["time_us", *(f"m{j}_pos" for j in J), *(f"m{j}_torque" for j in J)]
    path = write(tmp_path / "a.csv", head, [1e6 * log.t[twice], log.q[twice], log.tau[twice]])
    found, read = mapped(path, robot)
    assert found.file["time"] == "time_us"
    np.testing.assert_allclose(read.t, log.t, atol=1e-6)
    np.testing.assert_allclose(read.tau, log.tau, atol=1e-6)
    assert any(f"{len(twice) - len(log)} rows left out" in note for note in read.notes)
    assert not [i for i in defects(path, LogMap.load(path.with_suffix(".toml"))).issues if i.kind == "garbage rows"]
    parts = list(read_chunks(path, robot.joints, path.with_suffix(".toml"), samples=301))
    np.testing.assert_allclose(np.concatenate([part.t for part in parts]), log.t, atol=1e-6)


def test_a_stamp_that_repeats_with_other_values_is_an_error(tmp_path, robot, log):
    t = np.array(log.t)
    t[50] = t[49]
    head = ["t", *(f"q_{n}" for n in robot.joints)]
    with pytest.raises(InputError, match="time does not increase"):
        read_log(write(tmp_path / "a.csv", head, [t, log.q]), robot.joints)


def test_mujocos_forces_of_actuators(tmp_path, robot, log):
    path = tmp_path / "a.npz"
    np.savez(path, time=log.t, qpos=log.q, qvel=log.v, actuator_force=log.tau / 50)
    found, read = mapped(path, robot)
    assert any("before the gear" in guess for guess in found.guesses)
    np.testing.assert_allclose(read.tau, log.tau / 50)


def test_stamps_in_two_columns_of_a_ros_2_message(tmp_path, robot, log):
    seconds = np.floor(log.t + 0.5)
    head = ["stamp.sec", "stamp.nanosec", *(f"position[{j}]" for j in J)]
    columns = [1.7e9 + seconds, np.round(1e9 * (log.t + 0.5 - seconds)), log.q]
    found = propose(write(tmp_path / "a.csv", head, columns), robot)
    assert any("write one column of their sum" in guess for guess in found.guesses)


def test_continuous_undoes_whole_turns_only():
    x = np.linspace(0, 3, 400) * np.pi
    np.testing.assert_allclose(np.diff(continuous(x % (2 * np.pi))), np.diff(x), atol=1e-12)
    np.testing.assert_allclose(np.diff(continuous(np.rad2deg(x) % 360)), np.diff(np.rad2deg(x)), atol=1e-9)
    assert continuous(x) is x
