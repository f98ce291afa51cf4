"""A bar for work that takes more than a moment: what is done now, how much of it, and the time left.

Long functions take a callable ``progress`` and call it with a few words. Where the work has a known size, the words
hold a count (``trying stribeck (3 of 90)``) or a share (``planning: 40%``), and the bar reads it. With t the time since
the stage began,

    time left = t · (all − done) / done.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from rich.console import Console

_COUNT, _SHARE = re.compile(r"\(?\b(\d+) of (\d+)\)?"), re.compile(r"\b(\d+)\s?%")


class Stage(NamedTuple):
    """The words, and how much is done of how much; `total` is 0 where the size is unknown."""

    words: str
    done: int = 0
    total: int = 0

    def follows(self, other: Stage) -> bool:
        """Whether this is the same work as the other, further on: one clock runs for both."""
        return self.total == other.total > 0 and self.done >= other.done


def stage_of(text: str) -> Stage:
    """Read the words that a function tells.

    Examples
    --------
    >>> from frischid.core.progress import stage_of
    >>> stage_of("trying stribeck (3 of 90)")
    Stage(words='trying stribeck (3 of 90)', done=3, total=90)
    >>> stage_of("planning: 40% of the budget").total, stage_of("reading logs").total
    (100, 0)
    """
    if count := _COUNT.search(text):
        return Stage(text, int(count[1]), int(count[2]))
    share = _SHARE.search(text)
    return Stage(text, int(share[1]), 100) if share else Stage(text)


def counter(progress: Callable[[str], None], words: str, total: int) -> Callable[[int], None]:
    """A function that tells how many samples of a total a pass has read; without a total, their number alone.

    Examples
    --------
    >>> from frischid.core.progress import counter
    >>> counter(print, "comparing", 400)(100)
    comparing: 25% of the samples
    >>> counter(print, "comparing", 0)(100)
    comparing: 100 samples
    """

    def told(samples: int) -> None:
        share = f"{100 * samples / total:.0f}% of the" if total else f"{samples}"
        progress(f"{words}: {share} samples")

    return told


@contextmanager
def progress_bar(console: Console | None = None) -> Iterator[Callable[[str], None]]:
    """Show the progress of a long function, in a terminal or in a notebook.

    Parameters
    ----------
    console : rich.console.Console, optional
        Where to show it: the notebook's cell, or the terminal's stderr by default.

    Yields
    ------
    callable
        Give it to a function as ``progress``.

    Examples
    --------
    >>> import frischid as fr
    >>> robot = fr.Robot.load("planar2")
    >>> log = fr.simulate(robot, fr.random_fourier(robot, 5.0, seed=1), rate=50.0)
    >>> with fr.progress_bar() as progress:
    ...     found = fr.identify(robot, [log], recursion="none", progress=progress)
    """
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        Progress,
        SpinnerColumn,
        Task,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )
    from rich.text import Text

    class TimeLeft(TimeRemainingColumn):
        """Nothing while the size of the work is unknown."""

        def render(self, task: Task) -> Text:
            return Text() if task.total is None else Text.assemble("left ", super().render(task))

    columns = (
        SpinnerColumn(),
        TextColumn("{task.description}", markup=False),
        BarColumn(bar_width=20),
        TextColumn("so far"),
        TimeElapsedColumn(),
        TimeLeft(),
    )
    where = console or Console(stderr=not Console().is_jupyter)
    with Progress(*columns, console=where, transient=True) as bar:
        task, now = bar.add_task("working", total=None), Stage("working")

        def tell(text: str) -> None:
            nonlocal now
            stage = stage_of(text)
            if stage.total == 0 or not stage.follows(now):
                bar.reset(task, total=stage.total or None)
            bar.update(task, description=stage.words, completed=stage.done)
            now = stage

        yield tell
