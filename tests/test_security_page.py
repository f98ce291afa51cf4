"""Every promise of docs/security.md names a test that exists."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "security.md").read_text(encoding="utf-8")


def test_every_test_that_is_named_exists():
    named = re.findall(r"`(tests/[\w/]+\.py)::(\w+)`", PAGE)
    assert len(named) > 40
    for path, name in named:
        assert re.search(rf"^def {name}\(", (ROOT / path).read_text(encoding="utf-8"), re.MULTILINE), f"{path}::{name}"
    for script in re.findall(r"`(benchmarks/\w+\.py)`", PAGE):
        assert (ROOT / script).is_file(), script


def test_every_promise_and_every_fault_has_a_test():
    rows = [line for line in PAGE.splitlines() if line.startswith("|") and line.count("|") == 4]
    promises = [line for line in rows if not line.startswith(("| surface ", "| fault ", "|---"))]
    assert len(promises) > 30
    assert all("`tests/" in line for line in promises)
