"""The reproduction as one HTML page that opens offline, with the report's templates and style."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from frischid.core.version import __version__
from frischid.figures.style import Drawing
from frischid.paper.paper_tables import PaperTable
from frischid.reports.chapters.table import Table
from frischid.reports.templates import packed_plotly, render

_FIGURE_TABLES = {"Figure 1": "Table 2", "Figure 2": "Table 2", "Figure 3": "Table 3", "Figure 4": "Table 4"}
"""The table whose chapter a figure belongs to; without that table, the last chapter."""


def paper_page(source: str, authors: bool, runs: int, tables: Sequence[PaperTable], drawings: Sequence[Drawing]) -> str:
    """One self-contained HTML page.

    Parameters
    ----------
    source : str
        Where the points come from.
    authors : bool
        Whether they are the authors'.

    Returns
    -------
    str
        HTML that refers to nothing outside itself.
    """
    titles = [_short(table.title) for table in tables]
    chapters: list[dict[str, Any]] = []
    for table, title in zip(tables, titles, strict=True):
        own = [d for d in drawings if _home(d, titles) == title]
        content = {"table": Table(table.headings, table.rows, words=table.words), "notes": table.notes, "drawings": own}
        html = render("paper.html", content)
        chapters.append({"anchor": title.lower().replace(" ", "-"), "heading": table.title, "html": html})
    day = datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC")
    values = {
        "robot": "The paper, computed again",
        "warnings": "" if authors else "not on the authors' points: nothing can be compared",
        "made": f"Massaroli et al., Frisch Scheme Identification of Robots Dynamic Parameters · {Path(source).name} · "
        f"{runs} runs of each study · frischid {__version__} · {day}",
        "chapters": chapters,
        "plotly": packed_plotly(),
        "model": "",
    }
    return render("page.html", values)


def _short(title: str) -> str:
    """The part of a title before its colon, "Table 2"."""
    return title.partition(":")[0].replace("\u00a0", " ")


def _home(drawing: Drawing, titles: Sequence[str]) -> str:
    """Title of the chapter that a figure belongs to."""
    home = _FIGURE_TABLES[_short(drawing.title)]
    return home if home in titles else titles[-1]
