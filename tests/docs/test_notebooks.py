"""Every notebook runs from top to bottom, in an empty folder, and its own assertions hold."""

import ast
import json
import os
import shutil
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
NOTEBOOKS = sorted((ROOT / "examples" / "notebooks").glob("*.ipynb"))


def cells_of(notebook):
    return json.loads(notebook.read_text(encoding="utf-8"))["cells"]


def run(source, name, names):
    """Run a cell as a notebook does; the value of its last expression is what the notebook shows."""
    tree = ast.parse(source)
    last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
    exec(compile(tree, name, "exec"), names)  # the notebook's own words
    return None if last is None else eval(compile(ast.Expression(last.value), name, "eval"), names)


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
            shown = run("".join(cell["source"]), notebook.name, names)
            if hasattr(shown, "_repr_html_"):
                assert str(shown._repr_html_()).startswith("<")


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_opens_with_what_one_will_see_and_leads_on(notebook):
    first, *_, last = ("".join(cell["source"]) for cell in cells_of(notebook))
    assert first.startswith("# ")
    assert "You will see" in first
    assert last.startswith("**Next:**")


def test_ten_cells_show_compare_diagnose_add_and_the_fall_of_the_error():
    cells = cells_of(ROOT / "examples" / "notebooks" / "first_model.ipynb")
    assert len(cells) == 10
    source = ["".join(cell["source"]) for cell in cells]
    order = [
        next(k for k, text in enumerate(source) if call in text) for call in ("fr.compare(", "fr.diagnose(", "fr.add(")
    ]
    assert order == sorted(order)
    shown = {kind for cell in cells for output in cell.get("outputs", ()) for kind in output.get("data", ())}
    assert {"text/html", "image/png"} <= shown
