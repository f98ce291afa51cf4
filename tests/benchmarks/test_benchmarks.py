"""Every benchmark script starts, and those of the paper's case study write what they document."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

FOLDER = Path(__file__).parents[2] / "benchmarks"
SCRIPTS = sorted(
    path.name
    for path in FOLDER.glob("*.py")
    if path.name != "readme_picture.py" and '__name__ == "__main__"' in path.read_text(encoding="utf-8")
)
DATA = os.environ.get("FRISCHID_DATA")
needs_data = pytest.mark.skipif(DATA is None, reason="FRISCHID_DATA is not set")


def run(script: str, *arguments: str | Path, data: str | None = None) -> subprocess.CompletedProcess[str]:
    environment = {name: value for name, value in os.environ.items() if name != "FRISCHID_DATA"}
    environment.update(OMP_NUM_THREADS="1", PYTHONWARNINGS="error", MPLBACKEND="agg", COLUMNS="160")
    if data is not None:
        environment["FRISCHID_DATA"] = data
    command = [sys.executable, str(FOLDER / script), *map(str, arguments)]
    return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=900)


def document(script: str, path: Path, *arguments: str | Path, data: str | None = None) -> dict[str, Any]:
    result = run(script, *arguments, "--json", path, data=data)
    assert result.returncode == 0, result.stderr
    content = json.loads(path.read_text(encoding="utf-8"))
    assert content["schema"] == "frischid.benchmark/1"
    assert content["machine"]
    assert content["notes"]
    return dict(content)


def planar(path: Path, *arguments: str | Path, data: str | None = None) -> dict[str, Any]:
    content = document("paper_planar.py", path, "--runs", "2", "--draws", "2", *arguments, data=data)
    tables, runs = content["tables"], content["settings"]["runs"]
    assert set(tables) == {"table2", "table3", "table4", "bounds"}
    assert tables["bounds"] == content["rows"]
    assert runs == 2
    assert {row["runs"] for row in content["rows"]} == {runs}, "a run was discarded"
    assert content["settings"]["samples"] == 4951
    assert {row["σ_q"] for row in tables["table3"]} == {"0.001", "0.01"}
    assert len(tables["table3"]) == 18
    return content


def test_scripts_are_found() -> None:
    assert {"bbrf.py", "paper_planar.py", "regressor.py"} <= set(SCRIPTS)


@pytest.mark.parametrize("script", SCRIPTS)
def test_help(script: str) -> None:
    result = run(script, "--help")
    assert result.returncode == 0, result.stderr
    assert "--json" in result.stdout


def test_paper_planar_on_a_fourier_motion(tmp_path: Path) -> None:
    content = planar(tmp_path / "figures.json", "--no-pictures", "--workers", "2")
    assert "Fourier" in content["settings"]["motion"]
    assert all(row["off %"] == "other motion" for row in content["tables"]["table2"])


@needs_data
def test_paper_planar_on_the_authors_points(tmp_path: Path) -> None:
    content = planar(tmp_path / "figures.json", "--workers", "1", "--pictures", tmp_path / "pictures", data=DATA)
    values = {row["figure"]: row for row in content["tables"]["table2"]}
    for figure, paper in (("σ max", 74.59), ("σ min", 6.686), ("cond", 11.16)):
        assert values[figure]["paper"] == paper
        assert values[figure]["at the points"] == pytest.approx(paper, rel=0.03)
    pictures = sorted(path.name for path in (tmp_path / "pictures").glob("*.png"))
    assert [name.split("_")[0] for name in pictures] == ["figure1", "figure2", "figure3", "figure4"]


def test_paper_planar_rejects_a_single_run() -> None:
    result = run("paper_planar.py", "--runs", "1")
    assert result.returncode == 2
    assert "--runs must be at least 2" in result.stderr


def test_bbrf_is_the_published_recursion_and_faster(tmp_path: Path) -> None:
    content = document("bbrf.py", tmp_path / "figures.json", "--samples", "1500", "--windows", "100", "--rounds", "1")
    assert [row["p"] for row in content["rows"]] == [9, 46]
    for row in content["rows"]:
        assert row["agree"], row
        assert row["largest difference"] <= 1e-6
        assert row["ratio"] > 3.0  # a loaded machine may be slow, but not that slow
