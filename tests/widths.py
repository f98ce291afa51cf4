"""A page of the command line, printed for terminals of several widths."""

import io
import re

from rich.cells import cell_len
from rich.console import Console

from frischid.cli import output
from frischid.cli.narrow import fitted
from frischid.cli.pages.page import alarm_lines

NUMBER = re.compile(r"[-+−]?[\d.,·⁰¹²³⁴⁵⁶⁷⁸⁹⁻]+%?")


def text_of(page, width):
    """What a command prints of a page."""
    stream = io.StringIO()
    console = Console(file=stream, width=width, highlight=False)
    for part in (*alarm_lines(page.alarms), *page.parts):
        for piece in fitted(part, width):
            console.print(piece)
    return stream.getvalue()


def assert_whole(page):
    """No line is longer than the terminal is wide, and no number is broken: a broken number is a new number."""
    whole = text_of(page, 5000)
    for width in (60, 80, 120, output.PIPE_WIDTH):
        text = text_of(page, width)
        assert all(cell_len(shown.rstrip()) <= width for shown in text.splitlines())
        # Rules of tables, and a name that is longer than the line, may differ.
        assert not [word for word in set(text.split()) - set(whole.split()) if NUMBER.fullmatch(word)]
