"""Lists in sentences."""

from __future__ import annotations

from collections.abc import Sequence


def listed(names: Sequence[str]) -> str:
    """``a, b and c``."""
    return " and ".join(filter(None, (", ".join(names[:-1]), *names[-1:])))


def each_of(names: Sequence[str]) -> str:
    """The same as the subject of a verb in the singular; nobody in particular: the robot."""
    return f"each of {listed(names)}" if len(names) > 1 else listed(names) or "the robot"
