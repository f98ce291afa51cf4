"""Every block of code and every shell line of the site runs, in the folder that `frischid demo --practice` writes.

``console`` blocks run line by line, and the lines below a command are what it prints; ``python`` blocks run in one
namespace per page. ``sh`` and ``bash`` blocks need a network, a robot or another installation; of these, the commands
and their options must exist.
"""

import re
import runpy
import shlex
import shutil
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from frischid.cli import main

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
BLOCK = re.compile(r"^( *)```(\w+)[^\n]*\n(.*?)^\1```", re.MULTILINE | re.DOTALL)
RUN = ("console", "python")


def blocks(page):
    """Kind and text of each block, without its indentation."""
    for indent, kind, text in BLOCK.findall(page.read_text(encoding="utf-8")):
        yield kind, "".join(line.removeprefix(indent) for line in text.splitlines(keepends=True))


def commands(kind, text):
    """Shell lines of a block, joined where a backslash ends a line."""
    lines = text.replace("\\\n", " ").splitlines()
    return [line.removeprefix("$ ") for line in lines if kind != "console" or line.startswith("$ ")]


def pages(*kinds):
    return [
        pytest.param(page, id=str(page.relative_to(ROOT)))
        for page in [*sorted(DOCS.rglob("*.md"))]
        if any(kind in kinds for kind, _ in blocks(page))
    ]


@pytest.fixture(scope="session")
def filled(tmp_path_factory):
    """The folder that the guides speak of."""
    folder = tmp_path_factory.mktemp("practice")
    result = CliRunner().invoke(main, ["demo", "--practice", str(folder / "practice")])
    assert result.exit_code == 0, result.output
    return folder / "practice"


@pytest.mark.parametrize("page", pages(*RUN))
def test_blocks_of_a_page_run(page, filled, tmp_path, monkeypatch):
    folder = shutil.copytree(filled, tmp_path / "practice")
    monkeypatch.chdir(folder)
    names = {}
    for kind, text in blocks(page):
        if kind == "python":
            title = re.match(r"# (\w+\.py)\n", text)
            if title:  # a script that the page's commands call
                (folder / title[1]).write_text(text, encoding="utf-8")
            else:
                exec(compile(text, page.name, "exec"), names)  # the page's own words
        elif kind == "console":
            for part in re.split(r"^\$ ", text.replace("\\\n", " "), flags=re.MULTILINE)[1:]:
                line, _, expected = part.partition("\n")
                printed = run(line)
                for words in filter(None, map(str.strip, re.split(r"\n|\.\.\.", expected))):
                    assert re.search(loosely(words), printed), f"{line}\n{words}\nis not in\n{printed}"


def loosely(words):
    """A pattern for printed words: any blanks, and any last digit of a number, which depends on the machine."""
    return r"\s+".join(re.sub(r"(?<=\\.)(\d*)\d", r"\1\\d*", re.escape(word)) for word in words.split())


def run(line):
    """A line of a page ends with what it promises; an alarm is no failure here."""
    words = shlex.split(line)
    if words[0] == "python":
        runpy_with(words[1:])
        return ""
    assert words[0] == "frischid", line
    result = CliRunner().invoke(main, words[1:])
    assert result.exit_code in (0, 1), f"{line}\n{result.output}"
    assert result.exception is None or isinstance(result.exception, SystemExit), line
    return result.output


def runpy_with(words):
    import sys

    before = sys.argv
    sys.argv = words
    try:
        runpy.run_path(words[0], run_name="__main__")
    finally:
        sys.argv = before


@pytest.mark.parametrize("page", pages("sh", "bash"))
def test_options_of_lines_that_cannot_run_here_exist(page):
    for kind, text in blocks(page):
        if kind in ("sh", "bash"):
            for line in commands(kind, text):
                words = shlex.split(line, comments=True)
                if words and words[0] == "frischid":
                    command = main.commands[words[1]]
                    known = {option for p in command.params if isinstance(p, click.Option) for option in p.opts}
                    assert {word for word in words if word.startswith("-")} <= known, line


def test_every_kind_of_block_is_known():
    kinds = {kind for page in DOCS.rglob("*.md") for kind, _ in blocks(page)}
    assert kinds <= {"console", "python", "sh", "bash", "toml", "json", "text"}
