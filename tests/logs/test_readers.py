import hashlib
import os
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from frischid.checks import defects
from frischid.errors import InputError, UnknownNameError
from frischid.logs import tables
from frischid.logs.content_size import content_bytes
from frischid.logs.log import CHANNELS, GARBAGE, Log, check_torque
from frischid.logs.mapping import JointMap, LogMap
from frischid.logs.readers import read_chunks, read_log, write_log
from frischid.logs.table import Table

N = 20
T = np.arange(N) * 0.1
A, B = np.sin(T), np.cos(T)
FORMATS = ("csv", "parquet", "npz")
UR10E = [f"{name}_joint" for name in ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")]


def write_csv(path, columns, header=True, delimiter=","):
    """Write columns of numbers or texts, one line a row; returns the path."""
    lines = [delimiter.join(columns)] if header else []
    lines += [delimiter.join(map(str, row)) for row in zip(*columns.values(), strict=True)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def with_cell(values, row, cell):
    texts = [repr(float(x)) for x in values]
    texts[row] = cell
    return texts


def refused(words, *args, **kwargs):
    with pytest.raises(InputError) as error:
        read_log(*args, **kwargs)
    for word in words:
        assert word in str(error.value)


# ---- round trips

names = st.text("abcxyz_0189", min_size=1, max_size=8).filter(lambda n: not n.startswith(("des_", "ref_")))
finite = st.floats(-GARBAGE, GARBAGE)


@st.composite
def logs(draw):
    joints = draw(st.lists(names, min_size=1, max_size=3, unique=True))
    n, J = draw(st.integers(10, 15)), len(joints)
    t = np.cumsum(draw(arrays(float, n, elements=st.floats(1e-3, 10.0))))
    channels = {"q": draw(arrays(float, (n, J), elements=finite))}
    for channel in CHANNELS[1:]:
        present = draw(st.lists(st.booleans(), min_size=J, max_size=J))
        channels[channel] = np.where(present, draw(arrays(float, (n, J), elements=finite)), np.nan)
    extra = {f'extra {k}, "file"': draw(arrays(float, n, elements=finite)) for k in range(draw(st.integers(0, 2)))}
    return Log(t, tuple(joints), **channels, extra=extra)


@pytest.mark.parametrize("suffix", FORMATS)
@settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(log=logs())
def test_write_then_read_is_the_identity(tmp_path, suffix, log):
    path = tmp_path / f"log.{suffix}"
    write_log(log, path)
    again = read_log(path)
    assert again.joints == log.joints
    assert list(again.to_table()) == list(log.to_table())
    for name, values in log.to_table().items():
        np.testing.assert_array_equal(again.to_table()[name], values, err_msg=name)
    assert (again.v is None) == (log.v is None)
    assert again.notes == ()
    assert again.source == str(path)
    assert again.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


def test_nothing_half_written(tmp_path, monkeypatch):
    log = Log(T, ("a",), A[:, None])
    path = tmp_path / "log.parquet"
    write_log(log, path)
    before = path.read_bytes()

    def full_disk(*args, **kwargs):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(pa.parquet, "write_table", full_disk)
    with pytest.raises(InputError, match="No space left"):
        write_log(log, path)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(("name", "words"), [("log.bag", "'.bag'"), ("no/log.csv", "no folder")])
def test_write_refuses(tmp_path, name, words):
    with pytest.raises(InputError, match=words):
        write_log(Log(T, ("a",), A[:, None]), tmp_path / name)


# ---- bad files


def test_bad_paths(tmp_path):
    refused(
        ["no such file", "did you mean there.csv"],
        write_csv(tmp_path / "there.csv", {"t": T}).with_name("ther.csv"),
    )
    refused(["is a folder", ".parquet"], tmp_path)
    (tmp_path / "log.xlsx").write_text("x")
    refused(["'.xlsx'", ".csv, .tsv, .txt, .parquet, .npz"], tmp_path / "log.xlsx")


@pytest.mark.parametrize("suffix", ["csv", "tsv", "txt", "parquet", "npz"])
def test_empty_and_foreign_files(tmp_path, suffix):
    path = tmp_path / f"log.{suffix}"
    path.write_bytes(b"")
    refused([str(path), "empty"], path)
    for content in (bytes(range(256)) * 20, b"\n\n\n", b"PK\x05\x06" + 18 * b"\0"):
        path.write_bytes(content)
        refused([str(path)], path)


@pytest.mark.parametrize("suffix", ["parquet", "npz"])
def test_truncated_binary_files(tmp_path, suffix):
    path = tmp_path / f"log.{suffix}"
    write_log(Log(T, ("a",), A[:, None]), path)
    path.write_bytes(path.read_bytes()[:-40])
    refused([str(path)], path)


@pytest.mark.parametrize(
    ("cell", "words"),
    [
        ("", ["line 9", "'q_a'", "nan or an empty cell"]),
        ("nan", ["line 9", "'q_a'", "nan"]),
        ("-inf", ["line 9", "'q_a'", "-inf"]),
        ("1e306", ["line 9", "'q_a'", "1e+306", "not a measurement"]),
        ("x12", ["'q_a'", "not numeric", "line 9 holds 'x12'"]),
        ("0.5,0.7", ["line 9 holds 3 cells instead of 2", "0 more"]),
    ],
)
@pytest.mark.parametrize("blank", [0, 2])
def test_bad_cells_are_named_by_line(tmp_path, cell, words, blank):
    path = write_csv(tmp_path / "log.csv", {"t": T, "q_a": with_cell(A, 7, cell)})
    # Empty lines hold no sample, but an editor counts them.
    path.write_text(path.read_text().replace("\n", "\n" * (blank + 1), 1))
    refused([w.replace("line 9", f"line {9 + blank}") for w in words], path)


def test_bad_cells_are_named_by_row(tmp_path):
    q = A.copy()
    q[7] = np.nan
    pa.parquet.write_table(pa.table({"t": T, "q_a": q}), tmp_path / "log.parquet")
    np.savez(tmp_path / "log.npz", t=T, q_a=q)
    for suffix in ("parquet", "npz"):
        refused(["row 8,", "'q_a'", "nan"], tmp_path / f"log.{suffix}")


def test_bad_times(tmp_path):
    path = tmp_path / "log.csv"
    write_csv(path, {"t": with_cell(T, 3, "0.2"), "q_a": A})
    refused(["line 5", "0.2 after 0.2", "1 repeated"], path)
    write_csv(path, {"t": with_cell(T, 3, "0.05"), "q_a": A})
    refused(["line 5", "0.05 after 0.2", "1 steps backwards"], path)
    write_csv(path, {"t": T[:9], "q_a": A[:9]})
    refused(["9 samples"], path)
    path.write_text("t,q_a\n")
    refused(["0 samples"], path)
    write_csv(path, {"time": T, "q_a": A})
    refused(["no time column 't'", "time, q_a", "[file]"], path)
    write_csv(path, {"t": ["2024-01-01 00:00:00"] * N, "q_a": A})
    refused(["not seconds", 'time_unit = "ns"', "zero_time"], path)


def test_structure_of_csv(tmp_path):
    path = tmp_path / "log.csv"
    write_csv(path, {"t": T, "q_a": A}, header=False)
    refused(["line 1 should name the columns", "header = false"], path)
    path.write_text("t,q_a,q_a\n" + "0,1,2\n" * N)
    refused(["two columns are called 'q_a'"], path)
    write_csv(path, {"t": T, "angle": A})
    refused(["no position column 'q_<joint>'", "t, angle", "mapping"], path)
    path.write_text(write_csv(path, {"t": T, "q_a": A, "q_b": B}).read_text()[:-25])
    refused(["line 21, the last, holds 2 cells instead of 3", "cut"], path)


@pytest.mark.parametrize("delimiter", [",", ";", "\t", " "])
def test_separators(tmp_path, delimiter):
    log = read_log(write_csv(tmp_path / "log.txt", {"t": T, "q_a": A}, delimiter=delimiter))
    np.testing.assert_array_equal(log.q[:, 0], A)


def test_csv_as_spreadsheets_write_it(tmp_path):
    path = write_csv(tmp_path / "log.csv", {'"t"': T, " q_a ": A})
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes().replace(b"\n", b"\r\n"))
    np.testing.assert_array_equal(read_log(path).q[:, 0], A)


def test_other_columns(tmp_path):
    columns = {"t": T, "q_a": A, "q_des_a": B, "temperature_a": np.arange(N), "tau_a": [""] * N}
    columns |= {"mode": ["run"] * N, "slow": with_cell(A, 2, "nan"), "brake": ["true"] * N}
    log = read_log(write_csv(tmp_path / "log.csv", columns))
    assert log.joints == ("a",)
    assert log.tau is None
    assert sorted(log.extra) == ["brake", "q_des_a", "temperature_a"]
    assert any("tau_a left out: it is empty" in note for note in log.notes)
    assert any("mode left out, not numeric: line 2 holds 'run'" in note for note in log.notes)
    assert any("slow left out: line 4 holds nan" in note for note in log.notes)


# ---- joints


def test_joints_of_the_robot(tmp_path):
    columns = {"t": T, "q_a": A, "q_b": B, "v_b": B, "q_finger": A, "tau_finger": A, "tau_a": B}
    path = write_csv(tmp_path / "log.csv", columns)
    assert read_log(path).joints == ("a", "b", "finger")
    log = read_log(path, ["base", "b", "a"])
    assert log.joints == ("b", "a")
    np.testing.assert_array_equal(log.q, np.c_[B, A])
    assert log.has("tau").tolist() == [False, True]
    assert log.has("v").tolist() == [True, False]
    assert dict(log.extra) == {}
    assert log.notes == ("left out, not joints of the robot: finger",)
    words = [
        "none of the joints",
        "has a, b, finger",
        "has arm, finger_joint",
        "finger for finger_joint",
    ]
    refused(words, path, ["arm", "finger_joint"])


# ---- NPZ blocks


def test_npz_blocks(tmp_path):
    path = tmp_path / "log.npz"
    q = np.c_[A, B]
    np.savez(path, t=T, q=q, tau=2 * q, joints=np.array(["a", "b"]), lift=T, odd=np.arange(3))
    log = read_log(path)
    assert log.joints == ("a", "b")
    np.testing.assert_array_equal(log.tau, 2 * q)
    assert list(log.extra) == ["lift"]
    assert any("odd left out" in note for note in log.notes)
    np.savez(path, t=T, q=q)
    refused(["q has 2 columns", "'joints'"], path)
    np.savez(path, t=T, q=q, joints=np.array(["a"]))
    refused(["q has 2 columns", "names 1: a"], path)
    np.savez(path, t=T, q_a=A, q_b=B[:5])
    refused(["'q_b'", "(5,)"], path)
    np.savez(path, t=np.array([{}]), q_a=A)
    refused([str(path), "pickle"], path)
    np.savez(path, scalar=1.0)
    refused([str(path), "no columns"], path)


# ---- mappings


def test_mapping_from_toml(tmp_path):
    path = write_csv(tmp_path / "log.csv", {"stamp": 1000 * (T + 5), "p0": np.rad2deg(A), "w0": B, "i0": A, "p1": B})
    toml = tmp_path / "map.toml"
    toml.write_text("""
        [file]
        time = "stamp"
        time_unit = "ms"
        zero_time = true
        angle_unit = "deg"
        [joint.arm]
        q = "p0"
        v = 2
        current = "i0"
        sign = -1
        offset = 0.5
        gear_ratio = 10.0
        torque_sign = -1
        [joint.lift]
        q = "p1"
        angle_unit = "m"
        [current_gain]
        arm = 11.97
    """)
    log = read_log(path, ["lift", "arm"], toml)
    np.testing.assert_allclose(log.t, T, atol=1e-12)
    np.testing.assert_array_equal(log.q[:, 0], B)
    np.testing.assert_allclose(log.q[:, 1], 0.5 - A / 10)
    np.testing.assert_allclose(log.v[:, 1], -np.deg2rad(B) / 10)
    np.testing.assert_allclose(log.current[:, 1], A)
    np.testing.assert_allclose(log.tau[:, 1], 11.97 * A)
    assert log.has("tau").tolist() == [False, True]
    assert "tau_arm = 11.97 N·m/A × current_arm" in log.notes
    assert "q_arm = -0.00174533 × p0 +0.5" in log.notes
    assert "t = stamp [ms] in seconds, starting from zero (5000.0 subtracted)" in log.notes
    assert "columns renamed: q_lift = p1, current_arm = i0" in log.notes


def test_motor_side_torque(tmp_path):
    path = write_csv(tmp_path / "log.csv", {"t": T, "q_a": A, "a_a": A, "tau_a": B})
    log = read_log(path, mapping={"joint": {"a": {"gear_ratio": 100, "torque_sign": -1}}})
    np.testing.assert_allclose(log.q[:, 0], A / 100)
    np.testing.assert_allclose(log.a[:, 0], A / 100)
    np.testing.assert_allclose(log.tau[:, 0], -100 * B)


def test_templates(tmp_path):
    columns = {"t": T, "joint.a.pos": A, "joint.a.eff": B, "joint.b.pos": B, "v_a": A}
    path = write_csv(tmp_path / "log.csv", columns)
    form = LogMap.from_dict({"default": {"q": "joint.{joint}.pos", "tau": "joint.{joint}.eff"}})
    log = read_log(path, mapping=form)
    assert log.joints == ("a", "b")
    assert log.has("tau").tolist() == log.has("v").tolist() == [True, False]
    np.testing.assert_array_equal(log.tau[:, 0], B)


def test_torque_or_current(tmp_path):
    path = write_csv(tmp_path / "log.csv", {"t": T, "q_a": A, "tau_a": B, "current_a": A})
    log = read_log(path, mapping={"current_gain": {"a": 2.0}})
    np.testing.assert_array_equal(log.tau[:, 0], B)
    assert log.notes == ("current_gain of a not used: torque is column tau_a",)
    for where in ({"default": {"tau_from": "current"}}, {"joint": {"a": {"tau_from": "current"}}}):
        log = read_log(path, mapping={"current_gain": {"a": 2.0}} | where)
        np.testing.assert_array_equal(log.tau[:, 0], 2 * A)
        assert log.notes == ("tau_a = 2 N·m/A × current_a instead of column tau_a",)
    refused(["needs a current_gain"], path, mapping={"default": {"tau_from": "current"}})


@pytest.mark.parametrize("named", [True, False])
def test_without_header(tmp_path, named):
    path = write_csv(tmp_path / "log.csv", {"t": T, "x": A, "y": B, "z": A}, header=False)
    file = {"header": False} | ({"columns": ["t", "q_a", "v_a", "more"]} if named else {"time": 0})
    mapping = {"file": file} | ({} if named else {"joint": {"a": {"q": 1, "v": 2}}})
    log = read_log(path, mapping=mapping)
    np.testing.assert_array_equal(np.c_[log.t, log.q, log.v], np.c_[T, A, B])
    assert list(log.extra) == (["more"] if named else [])
    assert any("columns without a name left out: 3" in note for note in log.notes) != named
    path.write_text(path.read_text() + "1,2\n")
    refused(["line 21, the last, holds 2 cells instead of 4"], path, mapping=mapping)


@pytest.mark.parametrize(("unit", "per_second"), [("s", 1), ("ms", 1000), ("us", 1_000_000), ("ns", 1_000_000_000)])
def test_stamps_of_every_unit_become_seconds(tmp_path, unit, per_second):
    seconds = 3 + np.arange(N)
    path = write_csv(tmp_path / "log.csv", {"t": per_second * seconds, "q_a": A})
    np.testing.assert_array_equal(read_log(path, mapping={"file": {"time_unit": unit}}).t, seconds)


def test_nanoseconds_since_1970(tmp_path):
    stamps = 1_700_000_000_000_000_001 + 10 * np.arange(N)
    for suffix in ("csv", "parquet"):
        path = tmp_path / f"log.{suffix}"
        write_csv(path, {"t": stamps, "q_a": A})
        if suffix == "parquet":
            pa.parquet.write_table(pa.table({"t": stamps, "q_a": A}), path)
        log = read_log(path, mapping={"file": {"time_unit": "ns", "zero_time": True}})
        np.testing.assert_allclose(log.t, 1e-8 * np.arange(N), rtol=1e-14)


@pytest.mark.parametrize(
    ("mapping", "words"),
    [
        ({"fiel": {}}, ["unknown table 'fiel'", "file"]),
        ({"file": 3}, ["file must be a table"]),
        ({"file": {"tine": "t"}}, ["unknown key 'tine' in [file] of mapping", "time"]),
        ({"file": {"angle_unit": "grad"}}, ["angle_unit = 'grad'", "'rad', 'deg'"]),
        ({"file": {"time_unit": "min"}}, ["'s', 'ms', 'us', 'ns'"]),
        ({"file": {"header": 0}}, ["header = 0"]),
        ({"file": {"delimiter": ",,"}}, ["one character"]),
        ({"file": {"columns": ["t", "q"]}}, ["header = false"]),
        ({"file": {"header": False, "columns": ["t", "t"]}}, ["different names"]),
        ({"file": {"header": False, "columns": ["t"]}}, ["line 1 holds 3 cells", "names 1 columns"]),
        ({"file": {"time": 7}}, ["unknown column '7'"]),
        ({"file": {"time": -1}}, ["time = -1", "from 0"]),
        ({"default": {"q": "q_"}}, ["{joint}"]),
        ({"default": {"sign": 1}}, ["unknown key 'sign'"]),
        ({"joint": {"a": 1}}, ["[joint.a]", "expected a table"]),
        ({"joint": {"a": {"singn": 1}}}, ["unknown key 'singn' in [joint.a]", "sign"]),
        ({"joint": {"a": {"sign": 2}}}, ["sign = 2", "1, -1"]),
        ({"joint": {"a": {"sign": True}}}, ["sign = True"]),
        ({"joint": {"a": {"gear_ratio": 0}}}, ["gear_ratio = 0"]),
        ({"joint": {"a": {"offset": float("nan")}}}, ["offset = nan"]),
        ({"joint": {"a": {"q": "q_c"}}}, ["unknown column 'q_c'", "(q of a in mapping)", "q_a"]),
        ({"joint": {"a": {"q": "q_b"}, "b": {"q": "q_b"}}}, ["q_b is given to two channels"]),
        ({"joint": {"c": {"v": "q_a"}}}, ["'c' has no position column"]),
        ({"current_gain": {"c": 2.0}}, ["'c' has no position column"]),
        ({"current_gain": {"a": "2"}}, ["current_gain = '2'"]),
        ({"current_gain": {"a": 2}, "joint": {"a": {"current_gain": 3}}}, ["two different current gains"]),
    ],
)
def test_mapping_mistakes(tmp_path, mapping, words):
    path = write_csv(tmp_path / "log.csv", {"t": T, "q_a": A, "q_b": B})
    if mapping.get("file") and isinstance(mapping["file"], dict) and mapping["file"].get("header") is False:
        write_csv(path, {"t": T, "q_a": A, "q_b": B}, header=False)
    refused(words, path, mapping=mapping)


def test_mapping_against_the_robot(tmp_path):
    path = write_csv(tmp_path / "log.csv", {"t": T, "q_a": A, "q_arm": B})
    with pytest.raises(UnknownNameError, match="unknown joint 'amr' in mapping; did you mean: arm"):
        read_log(path, ["arm", "lift"], {"current_gain": {"amr": 1.0}})
    log = read_log(path, ["arm", "lift"], {"current_gain": {"lift": 1.0, "arm": 2.0}})
    assert "mapping of lift not used: the log has no position of this joint" in log.notes
    assert "current_gain of arm not used: there is no current to convert" in log.notes


def test_mapping_files(tmp_path):
    refused(["none.toml", "cannot be read"], tmp_path / "x.csv", mapping=tmp_path / "none.toml")
    bad = tmp_path / "bad.toml"
    bad.write_text("[file\n")
    refused(["bad.toml", "not TOML", "line 1"], tmp_path / "x.csv", mapping=str(bad))
    bad.write_text("[file]\nhaeder = false\n")
    refused(["unknown key 'haeder'", "bad.toml"], tmp_path / "x.csv", mapping=bad)


def test_plain_mapping_changes_nothing():
    assert LogMap.of(None) == LogMap.from_dict({}) == LogMap()
    assert LogMap.from_dict({"joint": {"a": {}}}).joint == {"a": JointMap()}


def test_a_large_csv_reads_back(tmp_path):
    rng = np.random.default_rng(0)
    joints = tuple(f"joint{k}" for k in range(6))
    log = Log(np.arange(25_000) * 1e-3, joints, *(rng.normal(size=(25_000, 6)) for _ in range(5)))
    write_log(log, tmp_path / "log.csv")
    np.testing.assert_array_equal(read_log(tmp_path / "log.csv").tau, log.tau)


# ---- measured logs


@pytest.fixture
def data():
    if not (folder := os.environ.get("FRISCHID_DATA")):
        pytest.skip("FRISCHID_DATA is not set")
    return Path(folder)


@pytest.mark.parametrize(
    ("robot", "name"),
    [("ur10e", "valid_ptp_10_points"), ("panda", "valid_14_21s"), ("tiago", "valid_48_80s")],
)
def test_measured_csv_equals_parquet(data, robot, name):
    first, second = (read_log(data / robot / "logs" / f"{name}.{suffix}") for suffix in ("csv", "parquet"))
    assert list(first.to_table()) == list(second.to_table())
    for column, values in first.to_table().items():
        np.testing.assert_array_equal(values, second.to_table()[column], err_msg=column)


def test_measured_currents_become_torques(data):
    path = data / "ur10e/logs/unloaded_50s_14harm.parquet"
    plain = read_log(path, UR10E)
    assert plain.joints == tuple(UR10E)
    assert len(plain.extra) == 12
    with pytest.raises(InputError, match="current_gain"):
        check_torque(plain)
    gains = dict(zip(UR10E, [11.97, 11.98, 9.84, 10.75, 10.69, 10.68], strict=True))
    log = read_log(path, UR10E, {"current_gain": gains})
    check_torque(log)
    np.testing.assert_allclose(log.tau, log.current * list(gains.values()))
    assert [note.count("N·m/A × current_") for note in log.notes] == [6]


def test_measured_defects_are_never_repaired(data, tmp_path):
    path = data / "ur10e/raw_defects/garbage_rows_gap_truncated_line.csv"
    columns = ["t", *(f"{c}_{j}" for c in ("q", "v", "current", "current_des", "tau_des") for j in UR10E)]
    mapping = {"file": {"header": False, "columns": columns}}
    refused(["line 1 should name the columns", "31 numbers", "header = false"], path, UR10E)
    refused(["line 460, the last, holds 20 cells instead of 31"], path, UR10E, mapping)
    lines = path.read_text().splitlines()[:-1]
    shorter = tmp_path / "shorter.csv"
    shorter.write_text("\n".join(lines))
    refused(["line 5, column 't' holds 2.68156e+154", "not a measurement"], shorter, UR10E, mapping)
    shorter.write_text("\n".join(line for line in lines if line.startswith("3") and "00000000" not in line))
    log = read_log(shorter, UR10E, mapping)
    assert np.diff(log.t).max() > 50  # the gap stays a gap


def test_mujoco_arrays(tmp_path):
    path, rng = tmp_path / "rollout.npz", np.random.default_rng(0)
    arrays = {name: rng.normal(size=(40, 3)) for name in ("qpos", "qvel", "qacc", "qfrc_actuator", "ctrl")}
    np.savez(path, time=np.arange(40)[:, None] * 0.002, **arrays)
    refused(["q has 3 columns", "joints = [...] under [file]"], path)
    log = read_log(path, ["c", "a", "b"], {"file": {"joints": ["a", "b", "c"]}})
    assert log.joints == ("c", "a", "b")
    np.testing.assert_array_equal(log.q, arrays["qpos"][:, [2, 0, 1]])
    np.testing.assert_array_equal(log.tau, arrays["qfrc_actuator"][:, [2, 0, 1]])
    np.testing.assert_array_equal(log.extra["ctrl_b"], arrays["ctrl"][:, 1])
    assert any("MuJoCo's qpos" in note for note in log.notes)
    np.savez(path, time=np.arange(40) * 0.002, joints=np.array(["a", "b", "c"]), **arrays)
    motor = read_log(path, mapping={"default": {"tau": "ctrl_{joint}"}})
    np.testing.assert_array_equal(motor.tau, arrays["ctrl"])


def hostile_npz(path, offsets, value):
    """An NPZ file with another number in two bytes of every entry's headers."""
    np.savez(path, t=np.arange(20.0), q_joint=np.arange(20.0))
    content = bytearray(path.read_bytes())
    for signature, offset in zip((b"PK\x03\x04", b"PK\x01\x02"), offsets, strict=True):
        start = 0
        while (start := content.find(signature, start)) >= 0:
            content[start + offset : start + offset + 2] = value.to_bytes(2, "little")
            start += 4
    path.write_bytes(content)


@pytest.mark.parametrize(
    ("offsets", "value", "said"),
    [((6, 8), 1, "encrypted"), ((8, 10), 97, "compression method"), ((8, 10), 12, "Invalid data"),
     ((8, 10), 14, "cannot be read as npz")],
)  # fmt: skip
def test_an_npz_that_python_cannot_unpack_is_said(tmp_path, offsets, value, said):
    path = tmp_path / "log.npz"
    hostile_npz(path, offsets, value)
    with pytest.raises(InputError, match=said):
        read_log(path)


def test_an_npz_with_a_file_that_is_no_array_is_said(tmp_path):
    with zipfile.ZipFile(tmp_path / "log.npz", "w") as archive:
        archive.writestr("readme.txt", "hello")
    with pytest.raises(InputError, match=r"log\.npz: readme\.txt in the archive is no array"):
        read_log(tmp_path / "log.npz", ("joint1", "joint2"))


def test_an_npz_that_claims_more_than_any_memory_is_said(tmp_path):
    path = tmp_path / "log.npz"
    header = b"\x93NUMPY\x01\x00v\x00{'descr': '<f8', 'fortran_order': False, 'shape': (999999999999999,), }"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("t.npy", header.ljust(127) + b"\n" + bytes(80))
    with pytest.raises(InputError, match="memory"):
        read_log(path)


@pytest.mark.parametrize("line", [0, 5])
def test_a_cell_longer_than_any_number_is_said(tmp_path, line):
    path = tmp_path / "log.csv"
    rows = ["t,q_joint", *(f"{k / 100},{k / 7}" for k in range(20))]
    rows[line] = f"{rows[line].partition(',')[0]},{'1' * 140_000}"
    path.write_text("\n".join(rows))
    with pytest.raises(InputError, match="line"):
        read_log(path)
    defects(path, LogMap())


HOSTILE_MAPPINGS = {
    "a number of 400 digits": ("[joint.elbow]\noffset = " + "9" * 400, "expected a number"),
    "a number of 5000 digits": ("[joint.elbow]\noffset = " + "9" * 5000, "not TOML"),
    "a number of 5000 hexadecimal digits": ("[joint.elbow]\noffset = 0x" + "f" * 5000, "thousands of digits"),
    "nothing to divide by": ("[joint.elbow]\ngear_ratio = 1e-300", "other than 0"),
    "lists in lists": ("a = " + "[" * 50_000, "nested too deep"),
}


@pytest.mark.parametrize(("text", "said"), HOSTILE_MAPPINGS.values(), ids=HOSTILE_MAPPINGS)
def test_a_hostile_mapping_is_said(tmp_path, text, said):
    path = tmp_path / "map.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=said) as error:
        LogMap.load(path)
    assert len(str(error.value)) < 400


@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".npz"])
def test_more_columns_than_a_log_can_have_are_refused(tmp_path, suffix, monkeypatch):
    path, count = tmp_path / f"log{suffix}", 100_000
    if suffix == ".csv":
        path.write_text(",".join(f"c{k}" for k in range(count)) + "\n" + ",".join(["0"] * count) + "\n")
    else:  # a large file takes long to write
        monkeypatch.setattr("frischid.logs.table.MOST_COLUMNS", 1)
        write_log(Log(T, ("a",), A[:, None]), path)
        count = 2
    for read in (read_log, lambda p: list(read_chunks(p))):
        with pytest.raises(InputError, match=f"has {count} columns, a log has at most"):
            read(path)


@pytest.mark.parametrize("joint", ["a\nb", "a\rb", "a ", "a\x85"])
def test_a_name_that_a_csv_header_cannot_hold_is_refused(joint, tmp_path):
    log = Log(np.arange(12) / 10, (joint, "b"), q=np.ones((12, 2)))
    with pytest.raises(InputError, match="cannot hold a column"):
        write_log(log, tmp_path / "log.csv")
    assert not list(tmp_path.iterdir())
    write_log(log, tmp_path / "log.parquet")
    assert read_log(tmp_path / "log.parquet", log.joints).joints == log.joints


def test_a_format_is_one_entry_of_the_table_of_formats(tmp_path, monkeypatch):
    """A recipe of CONTRIBUTING.md: whatever reads logs finds a new format there, and nowhere else."""

    def read(path, form, joints):
        names, *rows = (line.split("|") for line in path.read_text().splitlines())
        return Table(str(path), names, dict(zip(names, np.array(rows, float).T, strict=True)), {})

    def chunks(path, form, rows, joints):
        whole = read(path, form, joints)
        for start in range(0, whole.rows, rows):
            part = {name: x[start : start + rows] for name, x in whole.numeric.items()}
            yield replace(whole, numeric=part, first=start)

    pipes = tables.TableFormat(
        (".pipes",), read, chunks, lambda path, form: read(path, form, ()).names, lambda _: 10**6
    )
    monkeypatch.setattr(tables, "TABLE_FORMATS", (*tables.TABLE_FORMATS, pipes))
    path = tmp_path / "log.pipes"
    path.write_text("t|q_elbow\n" + "".join(f"{0.01 * k:.2f}|{0.1 * k:.1f}\n" for k in range(40)))
    log = read_log(path)
    assert log.joints == ("elbow",)
    assert log.q[:, 0] == pytest.approx(0.1 * np.arange(40))
    assert [len(part) for part in read_chunks(path, samples=20)] == [20, 20]
    layouts = {"layout": {name: {"joint": {"elbow": {"q": q}}} for name, q in (("a", "q_elbow"), ("b", "angle"))}}
    assert read_log(path, mapping=layouts).joints == ("elbow",)
    assert content_bytes(path) == 10**6
    path.write_text("t|q_elbow\n0|first\n")
    with pytest.raises(InputError, match=r"log.pipes: cannot be read as pipes \(could not convert"):
        read_log(path)


@pytest.mark.parametrize("kind", ["int64", "uint64"])
def test_a_clock_in_nanoseconds_that_starts_anew_below_the_first_stamp(tmp_path, kind):
    """Of numbers without a sign, the difference was 2⁶⁴ ns, and the log 585 years long."""
    ticks = 10**18 + 10**7 * np.arange(20)
    np.savez(tmp_path / "log.npz", t=np.append(ticks + 5, ticks).astype(kind), q_a=np.zeros(40))
    log = read_log(tmp_path / "log.npz", mapping={"file": {"time_unit": "ns", "zero_time": True}})
    assert log.duration == pytest.approx(2 * 0.19 + 10.0)


@pytest.mark.parametrize("late", ["text", "number", "header"])
def test_blocks_of_a_file_are_read_as_the_whole_file(tmp_path, late):
    """The first block gives columns their types, and the file was refused at the first line that has another type."""
    rows = [f"{k / 100:.2f},{np.sin(k / 100):.6f}," for k in range(5000)]
    if late == "header":
        rows.insert(2500, "t,q_a,event")
    else:
        rows[4500:] = [row + {"text": "reached", "number": "2.5"}[late] for row in rows[4500:]]
    (tmp_path / "log.csv").write_text("\n".join(["t,q_a,event", *rows]) + "\n")
    whole, parts = read_log(tmp_path / "log.csv"), list(read_chunks(tmp_path / "log.csv", samples=700))
    assert len(parts) > 1
    assert sum(len(part) for part in parts) == len(whole) == 5000
    np.testing.assert_array_equal(np.concatenate([part.q for part in parts]), whole.q)
