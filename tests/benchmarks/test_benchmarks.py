"""Every benchmark script starts, and the recursion's writes what it documents."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).parents[2] / "benchmarks"
SCRIPTS = sorted(
    path.name
    for path in FOLDER.glob("*.py")
    if path.name != "readme_picture.py" and '__name__ == "__main__"' in path.read_text(encoding="utf-8")
)


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


def test_scripts_are_found() -> None:
    assert {"bbrf.py", "estimators.py", "regressor.py"} <= set(SCRIPTS)


def test_every_script_starts() -> None:
    """In one process: each script would import the same libraries again."""
    code = (
        "import contextlib, io, json, runpy, sys\n"
        "shown = {}\n"
        "for script in sys.argv[1:]:\n"
        "    sys.argv, text = [script, '--help'], io.StringIO()\n"
        "    try:\n"
        "        with contextlib.redirect_stdout(text):\n"
        "            runpy.run_path(script, run_name='__main__')\n"
        "    except SystemExit as end:\n"
        "        shown[script] = (end.code, text.getvalue())\n"
        "print(json.dumps(shown))\n"
    )
    paths = [str(FOLDER / script) for script in SCRIPTS]
    environment = os.environ | {"PYTHONPATH": str(FOLDER), "PYTHONWARNINGS": "error", "MPLBACKEND": "agg"}
    command = [sys.executable, "-c", code, *paths]
    result = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=900)
    assert result.returncode == 0, result.stderr
    shown = json.loads(result.stdout.splitlines()[-1])
    assert list(shown) == paths
    for script, (code_at_end, text) in shown.items():
        assert code_at_end in (0, None), script
        assert "--json" in text, script


def test_bbrf_is_the_published_recursion_and_faster(tmp_path: Path) -> None:
    content = document("bbrf.py", tmp_path / "figures.json", "--samples", "1500", "--windows", "100", "--rounds", "1")
    assert [row["p"] for row in content["rows"]] == [9, 46]
    for row in content["rows"]:
        assert row["agree"], row
        assert row["largest difference"] <= 1e-6
        assert row["ratio"] > 3.0  # a loaded machine may be slow, but not that slow


def test_no_edit_of_a_model_file_passes_unnoticed(tmp_path: Path) -> None:
    """The reduced form of the thousand edits; another seed than by default."""
    content = document("mutated_models.py", tmp_path / "edits.json", "--edits", "60", "--seed", "3")
    kept, removed = content["rows"]
    assert kept["refused"] == 60
    assert removed["refused"] + removed["warned of"] == 60


def test_no_name_of_a_urdf_becomes_code(tmp_path: Path) -> None:
    """The reduced form of the ten thousand hostile names; another seed than by default."""
    content = document("exported_names.py", tmp_path / "names.json", "--names", "84", "--seed", "7")
    assert [(row["format"], row["other code"]) for row in content["rows"]] == [
        ("C", 0), ("Python", 0), ("MJCF", 0), ("URDF", 0),
    ]  # fmt: skip


def test_bad_inputs_end_in_a_sentence(tmp_path: Path) -> None:
    """The reduced form of the table of bad inputs: one row of 40, of every kind."""
    content = document("bad_inputs.py", tmp_path / "table.json", "--every", "40")
    assert len(content["rows"]) >= 60
    assert {row["verdict"] for row in content["rows"]} == {"right"}
    kinds = {str(row["kind"]).split()[0] for row in content["rows"]}
    assert kinds == {"column", "file", "robot", "mapping", "model", "formula", "argument", "controller"}


def test_a_kill_leaves_no_half_file(tmp_path: Path) -> None:
    """The reduced form of the two hundred kills: two of each command but the slow ones."""
    options = ("--kills", "8", "--only", "identify,export,simulate,fetch")
    content = document("kills.py", tmp_path / "kills.json", *options)
    assert sum(row["kills"] for row in content["rows"]) == 8
    assert all(row["half"] == row["left"] == 0 for row in content["rows"])


def test_a_written_mjcf_simulates_the_motion_of_the_measured_arm(tmp_path: Path) -> None:
    (row,) = document("mjcf_round_trip.py", tmp_path / "figures.json", "--arms", "1", "--first", "11")["rows"]
    assert row["open loop, original"] > 0.2
    assert row["open loop, written"] < 0.01
    assert row["nothing else changed"]
