"""The Python surface: one table of public names, which the runtime, editors and type checkers share."""

import subprocess
import sys
from dataclasses import fields, is_dataclass
from importlib import import_module, metadata
from pathlib import Path
from pkgutil import walk_packages

import pytest

import frischid as fr

ROOT = Path(__file__).parents[1]

USER = """
from typing import assert_type

import frischid as fr
import numpy as np
from frischid.reports.study import Study
from numpy.typing import NDArray

robot = fr.Robot.load("panda")
log = fr.simulate(robot, fr.random_fourier(robot, 30, seed=1), rate=200, noise=fr.Noise(q=1e-5, tau=0.01))
found = fr.identify(robot, [log])
assert_type(found, fr.Identification)
assert_type(found.comparison, fr.Comparison | None)
assert_type(found.model.inverse_dynamics(log.q, log.q, log.q), NDArray[np.float64])
assert_type(fr.compare(found.model, [log]), fr.Comparison)
assert_type(fr.diagnose(found.model, [log]), fr.Diagnosis)
assert_type(fr.report(found.model, [log], "report.html"), Study)
assert_type(fr.export(found.model, "robot.urdf"), fr.Export)
assert_type(fr.__version__, str)
"""

MISTAKES = """
import frischid as fr

fr.identfy
fr.identify(3)
"""


def test_completion_lists_the_public_names_only():
    assert dir(fr) == fr.__all__ == sorted(set(fr.__all__))
    assert {"identify", "report", "Robot", "__version__"} <= set(fr.__all__)
    assert all(name[0] != "_" for name in fr.__all__ if name != "__version__")


def test_every_public_name_exists():
    for name in fr.__all__:
        assert getattr(fr, name) is not None
    with pytest.raises(AttributeError, match="identfy"):
        fr.identfy  # noqa: B018


@pytest.mark.parametrize("name", ["export"])
def test_a_function_keeps_its_name_beside_a_folder_of_that_name(name):
    code = f"import frischid as fr, frischid.cli, frischid.{name}\nfor _ in range(2): assert callable(fr.{name})"
    subprocess.run([sys.executable, "-c", code], check=True)


def test_no_dataclass_compares_arrays():
    """Two results are the same or not: a comparison of their arrays would end in an error of NumPy."""
    names = [name for _, name, _ in walk_packages(fr.__path__, "frischid.") if not name.endswith("__main__")]
    modules = [import_module(name) for name in names]
    classes = {x for module in modules for x in vars(module).values() if isinstance(x, type) and is_dataclass(x)}
    classes = {x for x in classes if x.__module__.startswith("frischid.") and x.__dataclass_params__.eq}
    assert len(classes) > 100
    assert not {x.__qualname__ for x in classes if any("Array" in str(f.type) for f in fields(x))}


def test_version_is_that_of_the_installed_package():
    assert fr.__version__ == metadata.version("frischid")


def checked(text, folder):
    """What mypy says about a user's script; the cache is that of ``mypy`` on the package itself."""
    script = folder / "script.py"
    script.write_text(text, encoding="utf-8")
    command = [sys.executable, "-m", "mypy", "--config-file", "pyproject.toml", str(script)]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True).stdout


def test_a_script_of_a_user_sees_real_types(tmp_path):
    assert "Success" in checked(USER, tmp_path)
    said = checked(MISTAKES, tmp_path)
    assert 'Module has no attribute "identfy"' in said
    assert 'incompatible type "int"; expected "Robot"' in said
