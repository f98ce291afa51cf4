"""Every block of code and every shell line of every page is run by a test, or says why not.

``console`` blocks run line by line, and the lines below a command are what it prints; ``python`` blocks run in one
namespace per page; a block that begins with ``# name.ext`` is a file that the page's commands read. The folder is the
one that `frischid demo --practice` writes; `test_robot_pages.py` runs the robots' pages on measured logs. A block of
another kind carries a mark: who runs it, or why nobody can (`fences.py`).
"""

import ast
import re
import runpy
import shlex
import shutil
import sys
from pathlib import Path

import click
import pytest
from click.testing import CliRunner
from fences import DOCS, PAGES, ROBOTS, ROOT, blocks, missing, name_of, spoken, text_of

import frischid
from frischid.cli import main

RUN = ("console", "python")


def pages(*kinds):
    found = [page for page in sorted(DOCS.rglob("*.md")) if ROBOTS not in page.parents]
    return [page for page in found if any(block.kind in kinds for block in blocks(page))]


@pytest.mark.parametrize("page", pages(*RUN), ids=name_of)
def test_blocks_of_a_page_run(page, filled, tmp_path, monkeypatch):
    folder = shutil.copytree(filled, tmp_path / "practice")
    monkeypatch.chdir(folder)
    names = {}
    for block in blocks(page):
        if block.kind in RUN and block.file:
            (folder / block.file).write_text(block.text, encoding="utf-8")
        elif block.kind == "python":
            exec(compile(block.text, page.name, "exec"), names)  # the page's own words
        elif block.kind == "console":
            for line, expected in block.promises:
                printed = run(line)
                assert not (words := missing(expected, printed)), f"{line}\n{words}\nis not in\n{printed}"


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
    before = sys.argv
    sys.argv = words
    try:
        runpy.run_path(words[0], run_name="__main__")
    finally:
        sys.argv = before


# ---- no block is forgotten


def is_run(block):
    """Whether a test runs a block by its kind and its page alone."""
    if DOCS not in block.page.parents:
        return False
    return block.kind in RUN or block.kind == "toml"  # test_pages.py reads every toml block


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_every_block_is_run_or_says_why_not(page):
    found = [*blocks(page)]
    assert len(re.findall(r"^ *(?:```|~~~)", text_of(page), flags=re.MULTILINE)) == 2 * len(found), (
        "a fence is not read"
    )
    for block in found:
        how, _, what = block.mark.partition(": ")
        assert block.kind, "say what the block holds: ```console, ```python, ```text"
        if is_run(block):
            assert not block.mark, f"a test runs this block:\n{block.text}"
        elif how == "not run":
            assert len(what.split()) > 2, f"a reason:\n{block.text}"
        else:
            assert how == "run by", f"mark the block with who runs it, or why nobody can:\n{block.text}"
            path, _, test = what.partition("::")
            words = text_of(ROOT / path)
            assert page.name in words, f"{path} does not read {page.name}"
            assert not test or f"def {test}(" in words, what


def test_install_lines_begin_one_of_the_readmes_commands():
    """`.ci/run` runs the README's commands, word for word."""
    commands = re.findall(r"^python3 -m venv .venv && .*$", text_of(ROOT / "README.md"), flags=re.MULTILINE)
    for page in (ROOT / "CONTRIBUTING.md", DOCS / "start" / "install.md"):
        for line in (line for block in blocks(page) for line in block.commands if "[dev]" in line):
            assert any(command.startswith(line) for command in commands), line


# ---- commands that no test runs exist, with their options


def known(words):
    """The rest of a command line that the program does not know."""
    command = main.commands.get(words[1]) if len(words) > 1 and not words[1].startswith("-") else main
    if command is None:
        return words[1:2]
    options = {option for p in command.params if isinstance(p, click.Option) for option in p.opts} | {"--help", "-h"}
    return [word for word in words[1:] if re.match(r"--?[a-z]", word) and word.partition("=")[0] not in options]


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_commands_and_options_of_a_page_exist(page):
    if page.name == "CHANGELOG.md":
        return  # tells of earlier versions too
    lines = [shlex.split(line, comments=True) for b in blocks(page) if b.kind in ("sh", "bash") for line in b.commands]
    for words in [*lines, *spoken(text_of(page))]:
        if words and words[0].endswith("frischid"):
            assert not known(words), " ".join(words)


def texts(path):
    """Every string of a module, its parts joined; what a message fills in becomes a blank."""
    for node in ast.walk(ast.parse(text_of(path))):
        if isinstance(node, ast.JoinedStr):
            yield "".join(part.value if isinstance(part, ast.Constant) else " " for part in node.values)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.value


def test_commands_and_options_of_messages_exist():
    """What the program itself advises, between backticks."""
    for path in sorted(Path(frischid.__file__).parent.rglob("*.py")):
        for words in (words for text in texts(path) for words in spoken(text)):
            assert not known(words), f"{path.name}: {' '.join(words)}"


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_files_that_a_page_names_exist(page):
    for path in re.findall(r"`((?:tests|benchmarks|docs|frischid|examples|urdf)/[\w./]+)`", text_of(page)):
        assert (ROOT / path).exists(), path
