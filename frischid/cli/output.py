"""How results and progress are shown, and where work is done."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from frischid.core.parallel import Workers

PIPE_WIDTH = 140  # columns of a table that goes to a pipe, which has no width of its own; 80 would cut tables


@contextmanager
def working(quiet: bool) -> Iterator[Callable[[str], None]]:
    """Show on stderr the present step of the work, when a person is watching."""
    if quiet or not sys.stderr.isatty():
        yield lambda _: None
        return
    from rich.console import Console

    with Console(stderr=True).status("working") as status:
        yield lambda text: status.update(text)


@contextmanager
def elsewhere(scheduler: str | None, count: int | None) -> Iterator[Workers | None]:
    """Workers, if the user asked for some; otherwise None, which is this process."""
    if scheduler is None and count is None:
        yield None
        return
    from frischid.core.parallel import workers

    with workers(scheduler, count) as pool:
        yield pool


def show_page(page: Any, as_json: bool) -> None:
    """Print a page: ``.data`` for machines, ``.parts`` for people."""
    if as_json:
        click.echo(json.dumps(page.data, indent=1, ensure_ascii=False, allow_nan=False))
        return
    from rich.console import Console

    console = Console(width=None if sys.stdout.isatty() else PIPE_WIDTH, highlight=False)
    for part in page.parts:
        console.print(part)
