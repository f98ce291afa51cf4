"""What a table holds; how a table looks is the template's (`macros.html`)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Table:
    """Cells as plain text.

    Attributes
    ----------
    headings : sequence of str
    rows : sequence of sequence of str
        As many cells per row as there are headings.
    words : int
        How many columns, from the left, hold words; the others hold numbers.
    caption : str
    """

    headings: Sequence[str]
    rows: Sequence[Sequence[str]]
    words: int = 1
    caption: str = ""
