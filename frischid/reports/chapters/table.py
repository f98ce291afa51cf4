"""The content of a table; the template (`macros.html`) decides its look."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Table:
    """Cells as plain text.

    Attributes
    ----------
    rows : sequence of sequence of str
        As many cells per row as there are headings.
    words : int
        Number of columns, from the left, that hold words; the others hold numbers.
    """

    headings: Sequence[str]
    rows: Sequence[Sequence[str]]
    words: int = 1
    caption: str = ""
