"""Random inputs of every surface end in a result or in an error of frischid's own; the same inputs in every run.

`benchmarks/fuzz.py` is the long run. A crash that it finds is mended, and its input becomes a file in
`tests/fuzz_found`.
"""

import contextlib
from pathlib import Path

import pytest
from fuzzing import SURFACES
from hypothesis import HealthCheck, Phase, given, settings

from frischid.errors import FrischidError

FOUND = sorted((Path(__file__).parent / "fuzz_found").iterdir())
pytestmark = pytest.mark.filterwarnings("ignore")  # NumPy may warn of a hostile number; it must not be believed


def fixed(examples):
    """The same examples on every machine, and no more than these."""
    checks = list(HealthCheck)
    phases = (Phase.generate, Phase.shrink)
    return settings(
        max_examples=examples, derandomize=True, database=None, deadline=None, phases=phases,
        suppress_health_check=checks,
    )  # fmt: skip


def attempt(surface, folder, value, monkeypatch):
    monkeypatch.chdir(folder)
    with contextlib.suppress(FrischidError):
        SURFACES[surface].attempt(folder, value)


@fixed(150)
@given(value=SURFACES["log"].inputs)
def test_any_log_is_read_or_refused(value, tmp_path, monkeypatch):
    attempt("log", tmp_path, value, monkeypatch)


@fixed(300)
@given(value=SURFACES["urdf"].inputs)
def test_any_urdf_is_read_or_refused(value, tmp_path, monkeypatch):
    attempt("urdf", tmp_path, value, monkeypatch)


@fixed(300)
@given(value=SURFACES["mapping"].inputs)
def test_any_mapping_is_read_or_refused(value, tmp_path, monkeypatch):
    attempt("mapping", tmp_path, value, monkeypatch)


@fixed(300)
@given(value=SURFACES["controller"].inputs)
def test_any_controller_drives_or_is_refused(value, tmp_path, monkeypatch):
    attempt("controller", tmp_path, value, monkeypatch)


@fixed(60)
@given(value=SURFACES["model"].inputs)
def test_any_model_is_used_or_refused(value, tmp_path, monkeypatch):
    attempt("model", tmp_path, value, monkeypatch)


@fixed(300)
@given(value=SURFACES["formula"].inputs)
def test_any_formula_is_used_or_refused(value, tmp_path, monkeypatch):
    attempt("formula", tmp_path, value, monkeypatch)


@fixed(40)
@given(value=SURFACES["line"].inputs)
def test_any_arguments_end_in_a_sentence(value, tmp_path, monkeypatch):
    attempt("line", tmp_path, value, monkeypatch)


@pytest.mark.parametrize("path", FOUND, ids=lambda p: p.name)
def test_what_was_found_stays_mended(path, tmp_path, monkeypatch):
    """The name of a file begins with its surface."""
    surface, content = path.name.partition("-")[0], path.read_bytes()
    value = (path.suffix[1:], content) if surface == "log" else content
    if surface in ("formula", "line"):
        value = content.decode()
        value = value.split("\n") if surface == "line" else value
    attempt(surface, tmp_path, value, monkeypatch)
