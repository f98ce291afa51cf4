"""The content of a table; the template (`macros.html`) decides its look."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Table:
    """Cells as plain text."""

    headings: Sequence[str]
    rows: Sequence[Sequence[str]]
    """As many cells per row as there are headings."""
    words: int = 1
    """Number of columns, from the left, that hold words; the others hold numbers."""
    caption: str = ""
