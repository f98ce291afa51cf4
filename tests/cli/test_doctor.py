"""`frischid doctor`: what an installation has, and whether it computes what it should."""

import json
import sys

from click.testing import CliRunner

from frischid.cli import demo, main
from frischid.core import extras


def run(*words):
    return CliRunner().invoke(main, ["doctor", *words])


def test_a_whole_installation_passes():
    result = run("--json")
    data = json.loads(result.stdout)
    assert result.exit_code == 0, data
    assert data["passed"]
    assert {trial["name"] for trial in data["self_test"]} >= {"parameters", "missing effect", "save and load"}
    assert data["packages"]["numpy"]
    assert set(data["optional"]) == {"fetch", "ros", "studio", "cluster"}


def test_a_broken_installation_fails_and_says_where(monkeypatch):
    def broken(seed):
        raise ImportError("libpinocchio.so: cannot open shared object file")

    monkeypatch.setattr(demo, "run", broken)
    result = run()
    assert result.exit_code == 1
    assert "libpinocchio.so" in result.stdout
    assert "FAILED" in result.stdout


def test_a_wrong_answer_fails(monkeypatch):
    """Truth that is off by ten standard errors stands for arithmetic that is."""
    from dataclasses import replace

    whole = demo.run(0)
    wrong = replace(whole, truth=whole.truth + 10 * whole.found.model.estimate.stderr)
    monkeypatch.setattr(demo, "run", lambda seed: wrong)
    result = run("--json")
    assert result.exit_code == 1
    failed = [trial["name"] for trial in json.loads(result.stdout)["self_test"] if not trial["passed"]]
    assert failed == ["parameters"]


def test_a_missing_part_is_named_with_its_packages(monkeypatch):
    real = extras.installed
    monkeypatch.setattr("frischid.cli.pages.doctor.installed", lambda text: None if "viser" in text else real(text))
    monkeypatch.setattr(demo, "run", lambda seed: sys.exit)  # no need to work for this
    text = run().stdout
    assert "the page to work in: missing: " in text
    assert '"viser>=' in text


def test_what_to_install_does_not_suppose_a_registry():
    for extra in extras.PURPOSE:
        command = extras.install_command(extra)
        assert 'pip install "' in command
        assert "frischid[" not in command
        assert extras.packages(extra)
    assert extras.packages() == tuple(dict.fromkeys(extras.packages()))
    assert "numpy" in {extras.name_of(text) for text in extras.packages()}
