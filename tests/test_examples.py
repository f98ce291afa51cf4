"""Examples in docstrings: every one runs, with warnings as errors."""

import doctest
from importlib import import_module
from pathlib import Path

import pytest

import frischid

PACKAGE = Path(frischid.__file__).parent
OPTIONS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE


def with_examples():
    """Modules of the package whose text holds an example."""
    for path in sorted(PACKAGE.rglob("*.py")):
        if ">>> " in path.read_text(encoding="utf-8"):
            yield ".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts).removesuffix(".__init__")


@pytest.mark.parametrize("name", [*with_examples()])
def test_examples_of_a_module_run(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # examples may write files
    runner, printed = doctest.DocTestRunner(optionflags=OPTIONS), []
    tests = doctest.DocTestFinder().find(import_module(name))
    assert any(test.examples for test in tests), f"{name}: an example stands where doctest does not look"
    for test in tests:
        runner.run(test, out=printed.append)
    assert not runner.failures, "".join(printed)


@pytest.mark.parametrize("name", [n for n in frischid.__all__ if not n.isupper() and n != "__version__"])
def test_every_public_name_has_an_example(name):
    text = getattr(frischid, name).__doc__
    assert "Examples\n" in text, f"frischid.{name} has no Examples section"
    assert ">>> " in text
