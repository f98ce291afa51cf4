"""The pages of the measured robots: each command runs in a shell on the measured logs, and prints what the page says.

The tables of these pages come from the JSON of `benchmarks/six_robots.py`. Here the same figures come from the
commands, and for one robot from the script, so a table that is older than the code fails.
"""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from fences import DOCS, ROBOTS, ROOT, blocks, missing

DATA = os.environ.get("FRISCHID_DATA")
ROWS = {row["key"]: row for row in json.loads((DOCS / "data" / "six_robots.json").read_text(encoding="utf-8"))["rows"]}
FOLDERS = {"go2": "go2_command"}
needs_data = pytest.mark.skipif(DATA is None, reason="no measured logs: FRISCHID_DATA is not set")


def test_every_robot_of_the_table_has_a_page_with_commands():
    for key, row in ROWS.items():
        page = ROBOTS / f"{key}.md"
        lines = [line for block in blocks(page) if block.kind == "console" for line, _ in block.promises]
        for command in ("identify", "improve"):
            line = next(line for line in lines if line.startswith(f"frischid {command} "))
            assert all(f"--valid {name}." in line for name in row["logs"]["test"])


def folder_of(page, folder):
    """The robot's URDF and logs, as a user has them: no file there that the page itself makes."""
    written = {block.file for block in blocks(page)}
    measured = Path(DATA) / FOLDERS.get(page.stem, page.stem)
    for file in [*measured.glob("*.urdf"), *measured.glob("logs/*")]:
        if not (file.name == "panda.urdf" and "without_hand.py" in written):
            (folder / file.name).symlink_to(file)
    for block in blocks(page):
        if block.file:
            (folder / block.file).write_text(block.text, encoding="utf-8")
    return folder


def in_a_shell(line, folder):
    """Exit code and output of a line, with this interpreter's commands first."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(
        ["bash", "-c", line], cwd=folder, capture_output=True, text=True, env=os.environ | {"PATH": path}
    )
    return done.returncode, done.stdout + done.stderr


@needs_data
@pytest.mark.parametrize(
    "page", [page for page in sorted(ROBOTS.glob("*.md")) if page.stem != "index"], ids=lambda p: p.stem
)
def test_commands_of_a_robots_page_print_its_words(page, tmp_path):
    folder = folder_of(page, tmp_path)
    errors = []
    for block in blocks(page):
        for line, expected in block.promises if block.kind == "console" else ():
            code, printed = in_a_shell(line, folder)
            assert code in (0, 1), f"{line}\n{printed}"
            assert not (words := missing(expected, printed)), f"{line}\n{words}\nis not in\n{printed}"
            errors += re.findall(r"^NRMSE (\d\.\d+) on logs it was not fitted to", printed, flags=re.MULTILINE)
    if page.stem in ROWS:  # the commands and the table agree
        row = ROWS[page.stem]
        assert float(errors[0]) == pytest.approx(row["identified"], abs=1e-3)
        one_step = any("--max-steps 1 " in block.text for block in blocks(page))
        assert float(errors[-1]) == pytest.approx(
            row["steps"][0]["test_after"] if one_step else row["improved"], abs=1e-3
        )


@needs_data
def test_the_script_computes_the_stored_figures_again(tmp_path):
    """The line of the page robots/index.md, for one robot."""
    (block,) = [block for block in blocks(ROBOTS / "index.md") if block.kind == "sh"]
    line = block.text.replace("=folder", f"={DATA}").replace("benchmarks/", f"{ROOT}/benchmarks/").strip()
    code, printed = in_a_shell(f"{line} --only tiago", tmp_path)
    assert code == 0, printed
    (again,) = json.loads((tmp_path / "table.json").read_text(encoding="utf-8"))["rows"]
    stored = ROWS["tiago"]
    for key in ("constant", "urdf_with_friction", "identified", "improved", "noise_floor"):
        assert again[key] == pytest.approx(stored[key], rel=0.01), key
    assert [step["effect"] for step in again["steps"]] == [step["effect"] for step in stored["steps"]]
    assert (again["logs"], again["alarms"]) == (stored["logs"], stored["alarms"])
