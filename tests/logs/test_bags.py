"""Bags and MCAP files, written by the libraries themselves, read back to the same numbers."""

import sys
import tracemalloc

import numpy as np
import pytest
from bag_files import WRITERS, mcap_ros2, ros1, ros2

from frischid.errors import InputError, UnknownNameError
from frischid.logs.log import Log
from frischid.logs.readers import read_chunks, read_log

JOINTS = ("shoulder", "elbow", "wrist")


def made(samples=300, joints=JOINTS, seed=0, start=0.0, tau=True, v=True):
    rng = np.random.default_rng(seed)
    t = start + np.arange(samples) * 0.002
    x = rng.normal(size=(3, samples, len(joints)))
    return Log(t, joints, x[0], v=x[1] if v else None, tau=x[2] if tau else None)


def same(read, log):
    assert read.joints == log.joints
    np.testing.assert_allclose(read.t, log.t - log.t[0], atol=1e-9)
    for channel in ("q", "v", "tau"):
        want, got = getattr(log, channel), getattr(read, channel)
        assert (want is None) == (got is None)
        if want is not None:
            np.testing.assert_array_equal(got, want, err_msg=channel)


@pytest.mark.parametrize("name", WRITERS)
def test_a_bag_reads_back_to_the_same_arrays(tmp_path, name):
    log = made()
    path = WRITERS[name](log, tmp_path / name)
    read = read_log(path, JOINTS)
    same(read, log)
    assert "joint states of topic /joint_states" in read.notes[0]
    assert len(read.sha256) == 64


@pytest.mark.parametrize("name", WRITERS)
def test_chunks_of_a_bag_are_the_whole(tmp_path, name):
    log = made()
    pieces = list(read_chunks(WRITERS[name](log, tmp_path / name), JOINTS, samples=98))
    assert [len(p) for p in pieces] == [98, 98, 104]  # the last six samples are too few for a log of their own
    np.testing.assert_allclose(np.concatenate([p.t for p in pieces]), log.t, atol=1e-9)
    np.testing.assert_array_equal(np.concatenate([p.tau for p in pieces]), log.tau)


@pytest.mark.parametrize("suffix", ["csv", "parquet", "npz"])
def test_chunks_of_a_table_are_the_whole(tmp_path, suffix):
    from frischid.logs.readers import write_log

    log = made(5000)
    write_log(log, path := tmp_path / f"log.{suffix}")
    pieces = list(read_chunks(path, samples=1000))
    assert len(pieces) >= 4
    np.testing.assert_array_equal(np.concatenate([p.t for p in pieces]), log.t)
    np.testing.assert_array_equal(np.concatenate([p.v for p in pieces]), log.v)


def test_whole_numbers_first_and_fractions_later(tmp_path):
    path = tmp_path / "log.csv"
    rows = [f"{k},{0 if k < 40_000 else 0.5},{k / 3}" for k in range(80_000)]
    path.write_text("\n".join(["t,q_a,tau_a", *rows]))
    pieces = list(read_chunks(path, mapping={"file": {"time_unit": "ms", "zero_time": True}}, samples=4096))
    assert len(pieces) > 5
    assert sum(len(p) for p in pieces) == 80_000
    assert pieces[-1].q[-1, 0] == 0.5
    assert pieces[-1].t[-1] == pytest.approx(79.999)


def test_a_fault_in_a_late_chunk_is_named_by_its_place(tmp_path):
    path = tmp_path / "log.csv"
    rows = [f"{k * 1e-3},{np.sin(k)},{k}" for k in range(20_000)]
    rows[15_000] = "15.0,nan,1"
    path.write_text("\n".join(["t,q_a,tau_a", *rows]))
    with pytest.raises(InputError, match="line 15002, column 'q_a' holds nan"):
        list(read_chunks(path, samples=1000))
    rows[15_000] = "3.0,1,1"
    path.write_text("\n".join(["t,q_a,tau_a", *rows]))
    with pytest.raises(InputError, match="time does not increase at line 15002"):
        list(read_chunks(path, samples=1000))


def test_missing_channels_and_joints_in_another_order(tmp_path):
    same(read_log(ros1(made(tau=False, v=False), tmp_path / "q.bag")), made(tau=False, v=False))
    turned = read_log(ros2(made(), tmp_path / "bag", order=[2, 0, 1]), JOINTS)
    same(turned, made())


def test_joints_of_another_name_through_a_mapping(tmp_path):
    path = ros2(made(), tmp_path / "bag")
    mapping = {"joint": {f"arm_{n}": {"q": f"q_{n}", "v": f"v_{n}", "tau": f"tau_{n}", "sign": -1} for n in JOINTS}}
    read = read_log(path, [f"arm_{n}" for n in JOINTS], mapping)
    np.testing.assert_array_equal(read.tau, -made().tau)


def test_topics(tmp_path):
    path = ros2(made(), tmp_path / "bag", others={"/wanted": made(joints=("a", "b"))})
    with pytest.raises(InputError, match=r'several topics hold joint states: /joint_states, /wanted.*topic = "'):
        read_log(path)
    assert read_log(path, mapping={"file": {"topic": "/wanted"}}).joints == ("a", "b")
    with pytest.raises(UnknownNameError, match=r"unknown topic of joint states '/want'.*did you mean: /wanted"):
        read_log(path, mapping={"file": {"topic": "/want"}})


def test_one_topic_of_two_publishers(tmp_path):
    """An arm and its gripper on one topic: the robot's joints are read, the others counted."""
    arm, hand = made(), made(joints=("finger",), start=0.001)
    parts = [x.slice(k, k + 10) for k in range(0, 300, 10) for x in (hand, arm)]
    path = mcap_ros2(arm, tmp_path / "both.mcap", pieces=parts)
    read = read_log(path, JOINTS)
    same(read, arm)
    assert "300 messages of finger on the same topic left out" in read.notes


def test_stamps_that_are_missing(tmp_path):
    path = ros1(made(), tmp_path / "log.bag", header=False)
    with pytest.raises(InputError, match=r'header stamps of topic /joint_states are all zero.*time = "t_record"'):
        read_log(path)
    same(read_log(path, mapping={"file": {"time": "t_record"}}), made())


def test_damaged_and_foreign_files(tmp_path, monkeypatch):
    for name, write in WRITERS.items():
        if name in ("ros2", "ros2_mcap"):
            continue
        path = write(made(2000), tmp_path / name)
        whole = path.read_bytes()
        path.write_bytes(whole[: len(whole) // 2])
        with pytest.raises(InputError, match=r"cannot be read as a bag|was not closed"):
            read_log(path)
        path.write_bytes(b"not a bag at all" * 100)
        with pytest.raises(InputError, match=f"{path.name}: cannot be read as a bag"):
            read_log(path)
    with pytest.raises(InputError, match=r"nothing\.bag: there is no such bag"):
        read_log(tmp_path / "nothing.bag")
    path = ros1(made(), tmp_path / "fine.bag")
    monkeypatch.setitem(sys.modules, "rosbags.rosbag1", None)
    with pytest.raises(InputError, match=r'pip install "mcap>=1.2" "rosbags>=0.10"'):
        read_log(path)


def test_memory_does_not_grow_with_the_bag(tmp_path):
    """Four times the messages, the same peak: chunks of 2000 of 10,000 and of 40,000 messages."""
    peaks = []
    for samples in (10_000, 40_000):
        pieces = (made(2000, seed=k, start=0.002 * k) for k in range(0, samples, 2000))
        path = mcap_ros2(None, tmp_path / f"{samples}.mcap", pieces=pieces)
        tracemalloc.start()
        assert sum(len(log) for log in read_chunks(path, JOINTS, samples=2000)) == samples
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 1.25 * peaks[0]
