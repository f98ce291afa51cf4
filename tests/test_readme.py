"""What the README says can be done, done."""

import os
import re
from pathlib import Path

import pytest
from click.testing import CliRunner

from frischid.cli import main

README = Path(__file__).parents[1] / "README.md"


def test_the_python_example_runs(tmp_path, monkeypatch):
    (block,) = re.findall(r"```python\n(.*?)```", README.read_text(encoding="utf-8"), flags=re.DOTALL)
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    exec(compile(block, "README", "exec"), names)  # the README's own words
    assert names["tau"].shape == names["log"].q.shape
    assert names["found"].comparison.nrmse < 0.05


def test_every_command_in_the_table_exists():
    table = re.findall(r"^\| `frischid (\w+)", README.read_text(encoding="utf-8"), flags=re.MULTILINE)
    assert set(table) == set(main.commands)


def test_the_mapping_example_is_valid():
    from frischid import LogMap

    (block,) = re.findall(r"```toml\n(.*?)```", README.read_text(encoding="utf-8"), flags=re.DOTALL)
    import tomllib

    assert LogMap.from_dict(tomllib.loads(block)).joint["shoulder_pan_joint"].current_gain == 11.97


def test_relative_links_lead_somewhere():
    for target in re.findall(r"\]\(([^)]+)\)", README.read_text(encoding="utf-8")):
        if not target.startswith("http"):
            assert (README.parent / target).exists(), target


@pytest.mark.parametrize("command", sorted(main.commands))
def test_help_of_every_command(command):
    result = CliRunner().invoke(main, [command, "--help"])
    assert result.exit_code == 0
    assert "Usage" in result.output
    assert os.linesep in result.output
