"""One row of the table of bad inputs (`bad_inputs.py`): a command, its input, and the exit codes that are right."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ANY, TOLD, REFUSED = (0, 1, 2), (1, 2), (2,)
"""Exit codes that are right: whatever comes, something is said, or nothing is done."""
COMMANDS = (("check", "robot.urdf"), ("identify", "robot.urdf"), ("compare", "model.json"))


@dataclass(frozen=True)
class Row:
    """One command on one bad input.

    Attributes
    ----------
    kind, fault : str
        What the input is, and what is wrong with it.
    arguments : tuple of str
        The command line.
    codes : tuple of int
        Exit codes that are right.
    prepare : callable
        Writes the input, just before the command runs.
    """

    kind: str
    fault: str
    arguments: tuple[str, ...]
    codes: tuple[int, ...] = REFUSED
    prepare: Callable[[], Any] = lambda: None


def writer(folder: Path, name: str, text: str) -> Callable[[], Any]:
    """A function that writes a file."""
    return lambda: (folder / name).write_bytes(text.encode("utf-8", errors="surrogateescape"))
