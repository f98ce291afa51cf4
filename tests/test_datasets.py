"""Public data sets: from a local folder here, by checksum always."""

import hashlib
import sys

import numpy as np
import pytest
from click.testing import CliRunner

from frischid import datasets
from frischid.cli import main
from frischid.errors import InputError, UnknownNameError
from frischid.readers import read_log

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
    known = datasets.DATASETS["tiago"]
    made = datasets.Dataset(
        known.title, known.page, known.licence, known.citation, "https://x.invalid/", digests, {"dynamic": "dynamic"}
    )
    monkeypatch.setitem(datasets.DATASETS, "tiago", made)
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
    with pytest.raises(InputError, match=r"its SHA-256 is .*, published is"):
        datasets.fetch("tiago", tmp_path / "out", folder)
    assert not (tmp_path / "out/dynamic/tiago_effort.csv").exists()
    path.unlink()
    with pytest.raises(InputError, match=r"holds no dynamic/tiago_effort\.csv"):
        datasets.fetch("tiago", tmp_path / "out", folder)


def test_what_cannot_be_fetched(tmp_path, monkeypatch):
    with pytest.raises(InputError, match=r"published no checksums.*github\.com/shamilmamedov"):
        datasets.fetch("ur10e", tmp_path)
    with pytest.raises(UnknownNameError, match="unknown data set 'tiagoo'"):
        datasets.fetch("tiagoo", tmp_path)
    monkeypatch.setitem(sys.modules, "pooch", None)
    with pytest.raises(InputError, match=r'pip install "frischid\[fetch\]"'):
        datasets.fetch("tiago", tmp_path)


def test_addresses_are_permanent():
    for dataset in datasets.DATASETS.values():
        assert bool(dataset.files) == bool(dataset.address)
        if dataset.files:
            assert any(len(part) == 40 for part in dataset.address.split("/"))
            assert all(len(digest) == 64 for digest in dataset.files.values())


def test_the_list():
    result = CliRunner().invoke(main, ["fetch", "--json"])
    assert result.exit_code == 0
    assert '"name": "panda"' in result.output
