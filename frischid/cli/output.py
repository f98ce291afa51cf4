"""Output of results and progress, and the choice of the processes that do the work."""

from __future__ import annotations

import io
import json
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import click

from frischid.core.text import printable

if TYPE_CHECKING:
    from frischid.core.parallel import Workers

PIPE_WIDTH = 140  # characters per line of output to a pipe, which has no width of its own; 80 would cut tables

ASKED_WIDTH, QUIET = "frischid.width", "frischid.quiet"  # keys in click's own store of a running command


def prepare_streams() -> None:
    """Make every stream one that can be written to.

    A closed stream becomes ``/dev/null``; otherwise the next file that is opened would take its number, and whatever a
    library prints would go into that file. A stream that cannot write every letter (ASCII) shows ``?`` instead.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # gets the lowest number that is free: this one
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115, PTH123 (open to the end)
        elif isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")


@contextmanager
def working(quiet: bool) -> Iterator[Callable[[str], None]]:
    """Show the present step of the work with count and time left on stderr, if stderr is a terminal."""
    context = click.get_current_context(silent=True)
    if quiet or not sys.stderr.isatty() or (context is not None and context.meta.get(QUIET)):
        yield lambda _: None
        return
    from frischid.core.progress import progress_bar

    with progress_bar() as progress:
        yield progress


@contextmanager
def elsewhere(scheduler: str | None, count: int | None) -> Iterator[Workers | None]:
    """Workers, if the user asked for them; otherwise None, which means this process."""
    if scheduler is None and count is None:
        yield None
        return
    from frischid.core.parallel import workers

    with workers(scheduler, count) as pool:
        yield pool


def show_page(page: Any, as_json: bool) -> None:
    """Print a page: ``.data`` for machines, all else for people. A severe alarm ends the command with exit code 1."""
    if as_json:
        plain = not (sys.stdout.encoding or "").lower().startswith("utf")  # escapes lose nothing, ? would
        click.echo(json.dumps(page.data, indent=1, ensure_ascii=plain, allow_nan=False))
    else:
        _print(page)
    if page.exit_code:
        sys.exit(page.exit_code)


def _print(page: Any) -> None:
    from rich.console import Console

    from frischid.cli.narrow import fitted
    from frischid.cli.pages.page import alarm_lines

    console = Console(width=_width(), highlight=False)
    for part in (*alarm_lines(page.alarms), *page.parts):
        for piece in fitted(part, console.width):
            console.print(_Printable(piece))


def _width() -> int | None:
    """Characters per line: ``--width``, COLUMNS, the terminal's own, or `PIPE_WIDTH`; None: rich finds out."""
    context = click.get_current_context(silent=True)
    asked = None if context is None else context.meta.get(ASKED_WIDTH)
    if asked is not None:
        return int(asked)
    return None if sys.stdout.isatty() or os.environ.get("COLUMNS", "").isdigit() else PIPE_WIDTH


class _Printable:
    """A part of a page without the control characters that a name in a file may hold: they steer terminals."""

    def __init__(self, part: Any) -> None:
        self.part = part

    def __rich_console__(self, console: Any, options: Any) -> Iterator[Any]:
        from rich.segment import Segment

        for segment in console.render(self.part, options):
            yield segment if segment.control else Segment(printable(segment.text), segment.style)
