"""What the README says can be done, done."""

import re
from pathlib import Path

from click.testing import CliRunner

from frischid.cli import main

README = Path(__file__).parents[1] / "README.md"


def test_the_python_example_runs(tmp_path, monkeypatch):
    (block,) = re.findall(r"```python\n(.*?)```", README.read_text(encoding="utf-8"), flags=re.DOTALL)
    assert len(block.splitlines()) <= 10
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    exec(compile(block, "README", "exec"), names)  # the README's own words
    assert names["tau"].shape == names["log"].q.shape
    assert names["found"].comparison.nrmse < 0.05


def test_the_demo_prints_what_the_readme_shows(tmp_path, monkeypatch):
    """Line by line, but for blanks and the last digits, which depend on the machine's arithmetic."""
    monkeypatch.chdir(tmp_path)
    printed = CliRunner().invoke(main, ["demo"]).stdout
    (block,) = re.findall(r"```text\n(.*?)```", README.read_text(encoding="utf-8"), flags=re.DOTALL)
    lines = [line for line in block.splitlines() if line != "..."]
    assert len(lines) <= 10
    for line in lines:
        assert re.search(loosely(line), printed), line


def loosely(words):
    """A pattern for printed words: any blanks, and any last digit of a number, which depends on the machine."""
    return r"\s+".join(re.sub(r"(?<=\\.)(\d*)\d", r"\1\\d*", re.escape(word)) for word in words.split())
