"""The fenced blocks of every page that a user reads, with the mark above a block that says who runs it.

A mark is a comment on the line above the fence, which no reader sees::

    <!-- run by: tests/docs/test_text_blocks.py::test_the_loop_of_the_page_on_export_compiles -->
    <!-- not run: needs a cluster -->
"""

import re
import shlex
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
ROBOTS = DOCS / "robots"
PAGES = [
    *sorted(ROOT.glob("*.md")),
    *sorted(DOCS.rglob("*.md")),
    *sorted((ROOT / "paper").glob("*.md")),
    *sorted((ROOT / "examples").rglob("*.md")),
]
FENCE = re.compile(
    r"^(?P<indent> *)(?:<!-- (?P<mark>[^\n]*) -->\n *)?```(?P<kind>[^\n]*)\n(?P<text>.*?)^ *```$",
    re.MULTILINE | re.DOTALL,
)


@dataclass(frozen=True)
class Block:
    """A fenced block: its page, the word after its fence, its text without indentation, and the mark above it."""

    page: Path
    kind: str
    text: str
    mark: str

    @property
    def commands(self):
        """Its shell lines, joined where a backslash ends a line; of a console block, those after the prompt."""
        lines = self.text.replace("\\\n", " ").splitlines()
        return [line.removeprefix("$ ") for line in lines if self.kind != "console" or line.startswith("$ ")]

    @property
    def file(self):
        """Name in the block's first line, if the block is a file that the page's commands read."""
        found = re.match(r"# (\w+\.(?:py|toml))\n", self.text)
        return found[1] if found else None

    @property
    def promises(self):
        """A console block's commands, each with the lines that it prints."""
        parts = re.split(r"^\$ ", self.text.replace("\\\n", " "), flags=re.MULTILINE)[1:]
        return [part.partition("\n")[::2] for part in parts]


def text_of(page):
    return page.read_text(encoding="utf-8")


def name_of(page):
    return page.relative_to(ROOT).as_posix()


def blocks(page):
    """Every block of a page, in order."""
    for found in FENCE.finditer(text_of(page)):
        text = "".join(line.removeprefix(found["indent"]) for line in found["text"].splitlines(keepends=True))
        yield Block(page, found["kind"], text, found["mark"] or "")


def spoken(text):
    """Commands `frischid ...` between backticks in running text."""
    return [shlex.split(line) for line in re.findall(r"`(frischid [^`]*)`", text)]


def loosely(words):
    """A pattern for printed words: any blanks, and any last digit of a number, which depends on the machine."""
    return r"\s+".join(re.sub(r"(?<=\\.)(\d*)\d", r"\1\\d*", re.escape(word)) for word in words.split())


def missing(expected, printed):
    """Words that a page promises and a command did not print; ``...`` stands for anything."""
    parts = filter(None, map(str.strip, re.split(r"\n|\.\.\.", expected)))
    return [words for words in parts if not re.search(loosely(words), printed)]
