"""Public data sets: from a local folder here, by checksum always."""

import hashlib
import json
import os
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner
from output_schemas import fits
from scipy.io import savemat

from frischid.cli import main
from frischid.errors import InputError, UnknownNameError
from frischid.logs import dataset_checks, datasets
from frischid.logs.dataset_list import DATASETS, Dataset
from frischid.logs.readers import read_log

JOINTS = ["torso_lift_joint", "arm_1_joint"]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder of files as TIAGo's are, and the data set that describes them."""
    rng, source = np.random.default_rng(0), tmp_path / "source"
    (source / "dynamic").mkdir(parents=True)
    digests = {}
    for kind in ("position", "velocity", "effort"):
        rows = [f"{k / 100},{a},{b}" for k, (a, b) in enumerate(rng.normal(size=(50, 2)))]
        path = source / "dynamic" / f"tiago_{kind}.csv"
        path.write_text("\n".join([",".join(["t", *(f"- {j}_{kind}" for j in JOINTS)]), *rows]))
        digests[f"dynamic/{path.name}"] = hashlib.sha256(path.read_bytes()).hexdigest()
    known = DATASETS["tiago"]
    made = Dataset(
        known.title,
        known.page,
        known.licence,
        known.citation,
        "https://x.invalid/",
        digests,
        {"dynamic": "dynamic"},
        known.layout,
    )
    monkeypatch.setitem(DATASETS, "tiago", made)
    return source


def test_fetch_from_a_folder(folder, tmp_path):
    result = CliRunner().invoke(main, ["fetch", "tiago", "--from", str(folder), "-o", str(tmp_path / "out")])
    assert result.exit_code == 0, result.output
    assert "licence: Apache-2.0" in result.output
    assert "cite: " in result.output
    log = read_log(tmp_path / "out/dynamic.parquet")
    assert log.joints == tuple(JOINTS)
    assert log.current.shape == (50, 2)
    assert "Apache-2.0" in (tmp_path / "out/SOURCE.txt").read_text()


def test_another_file_is_refused(folder, tmp_path):
    path = folder / "dynamic/tiago_effort.csv"
    path.write_text(path.read_text() + "\n")
    with pytest.raises(InputError, match=r"its SHA-256 is .*, that of the data set is"):
        datasets.fetch("tiago", tmp_path / "out", folder)
    assert not (tmp_path / "out/dynamic/tiago_effort.csv").exists()
    path.unlink()
    with pytest.raises(InputError, match=r"holds no dynamic/tiago_effort\.csv"):
        datasets.fetch("tiago", tmp_path / "out", folder)


def test_what_cannot_be_fetched(tmp_path, monkeypatch):
    with pytest.raises(UnknownNameError, match="unknown data set 'tiagoo'"):
        datasets.fetch("tiagoo", tmp_path)
    monkeypatch.setitem(sys.modules, "pooch", None)
    with pytest.raises(InputError, match=r'pip install "pooch>=1\.8"'):
        datasets.fetch("tiago", tmp_path)


def test_addresses_are_permanent():
    for dataset in DATASETS.values():
        for path, digest in dataset.files.items():
            if not digest:  # put into place by hand
                assert not dataset.address
                continue
            assert any(len(part) == 40 for part in (dataset.address + path).split("/"))
            assert len(digest) == 64
        for part in dataset.logs.values():
            assert any(path.startswith(part) for path in dataset.files)


# Last stamp [s], decimals and end of each of the owners' files, which the measured logs in FRISCHID_DATA were made of.
UR10E = {
    "ident_20s_10harm": (393.03, 4, "\n"),
    "ident_20s_5harm": (549.336, 4, "\n"),
    "ident_30s_12harm": (1057.09, 6, "\n"),
    "ident_40s_12harm": (332.431, 6, "\n"),
    "ident_50s_12harm": (856.545, 6, "\n"),
    "unloaded_50s_14harm": (894.853, 4, ""),
    "loaded_2805g_50s_14harm": (1939.981, 4, "\n"),
    "valid_ptp_10_points": (1198.723, 4, "\n"),
}


@pytest.mark.skipif("FRISCHID_DATA" not in os.environ, reason="FRISCHID_DATA is not set")
def test_the_ur10es_files_written_again(tmp_path):
    """The owners' files, byte for byte, from the measured logs: their checksums hold and their numbers come back."""
    measured, source, known = Path(os.environ["FRISCHID_DATA"]), tmp_path / "source", DATASETS["ur10e"]
    source.mkdir()
    rows = {}
    for name, (last, decimals, end) in UR10E.items():
        table = pq.read_table(measured / f"ur10e/logs/{name}.parquet")
        rows[name] = np.column_stack([table[c].to_numpy() for c in table.column_names])
        shifted = np.column_stack([rows[name][:, 0] - rows[name][-1, 0] + last, rows[name][:, 1:]])
        lines = [",".join(f"{x:.{decimals}f}" for x in row) for row in shifted]
        (source / Path(known.logs[name]).name).write_text("\n".join(lines) + end)
    _, paths = datasets.fetch("ur10e", tmp_path / "out", source)
    assert {path.stem for path in paths} == set(rows)
    for path in paths:
        table = pq.read_table(path)
        assert table.column_names == pq.read_table(measured / f"ur10e/logs/{path.name}").column_names
        again = np.column_stack([table[c].to_numpy() for c in table.column_names])
        assert np.abs(again - rows[path.stem]).max() < 1e-9


def test_the_pandas_layout(tmp_path):
    rng = np.random.default_rng(0)
    truth = {kind: rng.normal(size=(5, 7)) for kind in ("positions", "velocity", "torques")}
    for kind, rows in truth.items():
        (tmp_path / f"exciting_traj_{kind}.txt").write_text("".join(f"{x}\n" for x in rows.ravel()))
    (tmp_path / "exciting_traj_time.txt").write_text("".join(f"{x}\n" for x in np.arange(5) / 1000))
    table = DATASETS["panda"].layout(tmp_path)
    assert np.array_equal(table["tau_panda_joint7"], truth["torques"][:, 6])
    assert list(table)[:2] == ["t", "q_panda_joint1"]
    assert len(table) == 22


def test_the_list():
    result = CliRunner().invoke(main, ["fetch", "--json"])
    assert result.exit_code == 0
    assert '"name": "panda"' in result.output


def by_hand(name, source, output, *options):
    return CliRunner().invoke(main, ["fetch", name, "--from", str(source), "-o", str(output), *options])


def emps_files(folder, samples=24841, **changed):
    t = np.arange(samples) / 1000
    content = {"t": t[:, None], "qm": 0.1 * np.sin(t)[:, None], "qg": 0.1 * np.sin(t)[:, None]}
    content |= {"vir": np.cos(t)[:, None], "gtau": 35.15, **changed}
    folder.mkdir()
    for file in ("DATA_EMPS.mat", "DATA_EMPS_PULSES.mat"):
        savemat(folder / file, {k: x for k, x in content.items() if x is not None})


def test_emps_by_hand(tmp_path):
    emps_files(tmp_path / "source")
    result = by_hand("emps", tmp_path / "source", tmp_path / "out")
    assert result.exit_code == 0, result.output
    assert "Janot" in result.output
    log = read_log(tmp_path / "out/train.parquet")
    assert log.joints == ("slide",)
    assert np.allclose(log.tau[:, 0], 35.15 * np.cos(log.t))
    fits("fetch", json.loads(by_hand("emps", tmp_path / "source", tmp_path / "again", "--json").stdout))


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"qm": None}, "holds no qm"),
        ({"samples": 1000}, "expected 24841"),
        ({"qm": np.ones((24841, 1))}, "below 0.3 m"),
    ],
)
def test_other_contents_are_refused(tmp_path, changed, said):
    emps_files(tmp_path / "source", **changed)
    result = by_hand("emps", tmp_path / "source", tmp_path / "out")
    assert result.exit_code == 2
    assert said in result.output.replace("\n", " ")
    assert not (tmp_path / "out/train.parquet").exists()


@pytest.mark.parametrize("header", [True, False])
def test_tx40_by_hand(tmp_path, header):
    """Joint angles and torques come from the motors' by the gears, with the coupling of motor 6."""
    rng, q = np.random.default_rng(0), 0.5 * np.sin(np.arange(200)[:, None] / 50 + np.arange(6))
    R = np.diag([32.0, 32, 45, -48, 45, 32])
    R[5, 4] = 32
    tau, motor = rng.normal(size=(200, 6)), (q - [0, -np.pi / 2, np.pi / 2, 0, 0, 0]) @ R.T
    source = tmp_path / "source"
    source.mkdir()
    for name, rows in (("pos_read_data.csv", motor), ("curr_data.csv", tau)):
        lines = [",".join(f"m{k}" for k in range(6))] * header + [",".join(f"{x:.12g}" for x in row) for row in rows]
        (source / name).write_text("\n".join(lines))
    result = by_hand("staubli_tx40", source, tmp_path / "out")
    assert result.exit_code == 0, result.output
    log = read_log(tmp_path / "out/exciting.parquet", [f"joint_{k}" for k in range(1, 7)])
    assert np.allclose(log.q, q)
    assert np.allclose(log.tau, tau @ R)
    assert log.rate == pytest.approx(5000)


def kr300_files(folder, samples=300, **changed):
    """Twelve recordings of a short arm: `monkeypatch` shortens what is expected too."""
    t = np.arange(samples) * 0.004
    axes = np.arange(1.0, 7)[:, None]
    content = {"time": t[None], "recording_ok": np.array([[True]]), "READ_ME": np.full((2, 2), "words", dtype=object)}
    content |= {"q_se_meas": 10 * axes + np.sin(t), "q_mot_meas": 20 * axes + np.sin(t), "q_ref": axes + np.sin(t)}
    content |= {"qd_se_meas": axes * np.cos(t), "qd_mot_meas": 2 * axes * np.cos(t), "tau_meas": axes * np.ones_like(t)}
    content |= changed
    folder.mkdir(parents=True)
    for file in DATASETS["kr300"].files:
        savemat(folder / Path(file).name, {k: x for k, x in content.items() if x is not None})


def test_kr300_by_hand(tmp_path, monkeypatch):
    monkeypatch.setattr(dataset_checks, "KR300_SHAPE", (6, 300))
    kr300_files(tmp_path / "source/raw_data")
    result = by_hand("kr300", tmp_path / "source", tmp_path / "out")
    assert result.exit_code == 0, result.output
    assert "Weigand" in result.output
    logs = sorted(path.stem for path in (tmp_path / "out").glob("*.parquet"))
    assert len(logs) == 12
    assert [name for name in logs if name.startswith("test")] == ["test_22H_58M"]
    log = read_log(tmp_path / "out/test_22H_58M.parquet", [f"joint_a{k}" for k in range(1, 7)])
    assert log.rate == pytest.approx(250)
    assert np.allclose(np.rad2deg(log.q[0]), [10, 20, 30, 80, 100, 120])  # behind the gears, then the motors'
    assert np.allclose(np.rad2deg(log.v[0]), [1, 2, 3, 8, 10, 12])
    assert np.allclose(log.tau[0], [1, 2, 3, 4, 5, 6])


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"tau_meas": None}, "holds no tau_meas"),
        ({"samples": 200}, "axes and samples"),
        ({"time": np.arange(300)[None] * 0.001}, "time steps"),
        ({"q_mot_meas": np.full((6, 300), 400.0)}, "largest angle"),
        ({"tau_meas": np.full((6, 300), np.nan)}, "NaN or infinity"),
        ({"recording_ok": np.array([[False]])}, "recording_ok"),
    ],
)
def test_other_recordings_are_refused(tmp_path, monkeypatch, changed, said):
    monkeypatch.setattr(dataset_checks, "KR300_SHAPE", (6, 300))
    kr300_files(tmp_path / "source", **changed)
    result = by_hand("kr300", tmp_path / "source", tmp_path / "out")
    assert result.exit_code == 2
    assert said in result.output.replace("\n", " ")
    assert not list((tmp_path / "out").glob("*.parquet"))


def test_another_archive_is_refused(tmp_path, monkeypatch):
    """Where the archive lies beside the unpacked files, it has to be the known one."""
    monkeypatch.setattr(dataset_checks, "KR300_SHAPE", (6, 300))
    kr300_files(tmp_path / "source")
    (tmp_path / "source" / DATASETS["kr300"].archive.name).write_bytes(b"half of it")
    with pytest.raises(InputError, match=r"its MD5 is .* download it again"):
        datasets.fetch("kr300", tmp_path / "out", tmp_path / "source")
    assert not (tmp_path / "out").exists()
    known = DATASETS["kr300"]
    own = known.archive._replace(md5=hashlib.md5(b"half of it").hexdigest())
    monkeypatch.setitem(DATASETS, "kr300", replace(known, archive=own))
    assert len(datasets.fetch("kr300", tmp_path / "out", tmp_path / "source")[1]) == 12


def test_an_archive_is_named_with_its_checksum(tmp_path):
    with pytest.raises(InputError, match=r"With_Raw_Data\.rar \(227 MB, MD5 4a9d3a\w+\).* fetch kr300 --from FOLDER"):
        datasets.fetch("kr300", tmp_path / "out")


@pytest.mark.parametrize("name", ["emps", "staubli_tx40"])
def test_files_without_a_checksum_are_not_downloaded(name, tmp_path):
    with pytest.raises(InputError, match=f"frischid fetch {name} --from FOLDER"):
        datasets.fetch(name, tmp_path / "out")
