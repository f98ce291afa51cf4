"""The paper, computed again, as a page."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.markup import escape
from rich.table import Table

from frischid.cli.pages.page import Page
from frischid.paper.paper_tables import PaperTable
from frischid.paper.reproduction import Reproduction


def reproduction(found: Reproduction, written: Sequence[Path]) -> Page:
    """Every table with its notes, and where the page is."""
    published = any("published" in heading for table in found.tables for heading in table.headings)
    replaced = "; as published, each run that the authors' rules discard is replaced, and the equations count both"
    parts: list[Any] = [f"points: {escape(found.source)}; {found.runs} runs of each study{replaced * published}"]
    if not found.authors:
        parts.append("[yellow]warning:[/yellow] this is not the authors' motion: nothing can be compared")
    for table in found.tables:
        parts += ["", _table(table), *(f"  {escape(note)}" for note in table.notes)]
    parts += [f"written: {path}" for path in written]
    return Page(found.to_dict(), parts)


def _table(content: PaperTable) -> Table:
    table = Table(title=content.title, title_justify="left", header_style="bold", box=None, pad_edge=False)
    for k, heading in enumerate(content.headings):
        table.add_column(heading, justify="left" if k < content.words else "right", overflow="fold")
    for row in content.rows:
        table.add_row(*(escape(cell) for cell in row))
    return table
