"""Every notebook runs from top to bottom, in an empty folder, and its own assertions hold."""

import json
import os
import shutil
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
NOTEBOOKS = sorted((ROOT / "examples" / "notebooks").glob("*.ipynb"))


def cells_of(notebook):
    return json.loads(notebook.read_text(encoding="utf-8"))["cells"]


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs(notebook, tmp_path, monkeypatch):
    if '\\"cc\\"' in notebook.read_text(encoding="utf-8") and not shutil.which("cc"):
        pytest.skip("no C compiler")
    if "FRISCHID_DATA" in notebook.read_text(encoding="utf-8") and not os.environ.get("FRISCHID_DATA"):
        pytest.skip("no measured logs")
    monkeypatch.chdir(tmp_path)
    names = {}
    for cell in cells_of(notebook):
        if cell["cell_type"] == "code":
            exec(compile("".join(cell["source"]), notebook.name, "exec"), names)  # the notebook's own words


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_opens_with_what_one_will_see_and_leads_on(notebook):
    first, *_, last = ("".join(cell["source"]) for cell in cells_of(notebook))
    assert first.startswith("# ")
    assert "You will see" in first
    assert last.startswith("**Next:**")
