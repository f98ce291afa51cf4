"""Tables on a terminal of any width: no number and no word is broken.

A column is at least as wide as its longest word. If all columns fit so, the free width goes to those that want more. If
not, columns are left out in the order that the table names (`Wide.droppable`), and a line says which. A table that
still does not fit is written row by row, as ``heading value`` pairs.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

from rich.cells import cell_len
from rich.console import Console, RenderableType
from rich.errors import MarkupError
from rich.markup import escape
from rich.table import Table
from rich.text import Text

GAP = 2
"""Characters between two columns."""
PAIRS = "   "
"""Between two pairs of a line."""
FOREIGN_TAG = re.compile(r"(?<!\\)\[(?!/?(?:bold|bold red|red|yellow|green|dim)\])(?=[a-z#/@][^\[]*?\])")
"""Bracket that rich would read as markup, and that is none of the pages'."""


class Wide(Table):
    """A table that knows which of its columns matter least.

    Parameters
    ----------
    droppable : sequence of str
        Headings of columns that a narrow terminal may go without, the least important first.
    """

    def __init__(self, *headings: str, droppable: Sequence[str] = (), title: str | None = None) -> None:
        super().__init__(*headings, title=title, title_justify="left", header_style="bold", box=None, pad_edge=False)
        self.droppable = tuple(droppable)


class Command(str):
    """A command to copy: it continues on the next line as a shell reads it."""


def own_markup(text: str) -> str:
    r"""A text in which only the pages' own markup counts: brackets in names of files and joints stay in sight.

    >>> own_markup("[bold]cut[old].csv[/bold]")
    '[bold]cut\\[old].csv[/bold]'
    """
    text = FOREIGN_TAG.sub(r"\\[", text)
    try:
        Text.from_markup(text)
    except MarkupError:  # a name holds a tag of the pages' own
        return escape(text)
    return text


def fitted(part: Any, width: int) -> list[RenderableType]:
    """A part of a page as it fits a terminal.

    Parameters
    ----------
    part : Table or other renderable
        A text without an indent is returned as it is; a text with one hangs from it.
    width : int
        Characters per line.
    """
    if isinstance(part, Command):
        return _continued(part, width)
    if isinstance(part, str):
        part = own_markup(part)
    if isinstance(part, str) and part.startswith(" "):
        return _hanging(part, width)
    if not isinstance(part, Table):
        return [part]
    cells = [[own_markup(str(cell)) for cell in (column.header, *column.cells)] for column in part.columns]
    kept, left_out = list(range(len(cells))), []
    for heading in getattr(part, "droppable", ()):
        if _width([_least(cells[k]) for k in kept]) <= width:
            break
        gone = [k for k in kept if cells[k][0] == own_markup(heading)]
        left_out += [heading] * len(gone)
        kept = [k for k in kept if k not in gone]
    title: list[RenderableType] = []
    if part.title is not None:
        title = [Text.from_markup(own_markup(str(part.title)), style="italic")]
    if _width([_least(cells[k]) for k in kept]) > width:
        return [*title, *_row_by_row(cells, width)]
    table = Table(box=None, pad_edge=False, header_style="bold")
    for k, size in zip(kept, _sizes([cells[k] for k in kept], width), strict=True):
        table.add_column(cells[k][0], justify=part.columns[k].justify, width=size)
    for row in range(1, len(cells[0])):
        table.add_row(*(cells[k][row] for k in kept))
    note = [f"[dim](no room for: {escape(', '.join(left_out))}; --json has all)[/dim]"] if left_out else []
    return [*title, table, *note]


def _continued(command: str, width: int) -> list[RenderableType]:
    """A command in lines that end with a backslash; quoted words stay whole.

    A word without quotes that is longer than a line continues after a comma or a slash, at the beginning of the next.
    """
    lines = [""]
    for word in re.findall(r"(?:'[^']*'|\S)+", command):
        if lines[-1] and cell_len(f"{lines[-1]} {word} \\") > width:
            lines[-1] += " \\"
            lines += _pieces(word, width)
        else:
            lines[-1] += f" {word}" if lines[-1] else word
    return [Text(line) for line in lines]


def _hanging(part: str, width: int) -> list[RenderableType]:
    """A line with an indent: what does not fit stands below its text, or further to the right where it has no term."""
    text = Text.from_markup(part)
    term = re.match(r" +(?:\S+ )*\S+  +", text.plain)  # "  equation    tau = …": the text begins after the spaces
    begin = len(text.plain) - len(text.plain.lstrip()) if term is None else term.end()
    hang = begin + GAP if term is None else begin
    if cell_len(text.plain) <= width or width <= 2 * hang:
        return [part]
    first, *others = text[begin:].wrap(Console(width=width), width - hang)
    return [text[:begin] + first, *(Text(" " * hang) + line for line in others)]


def _pieces(word: str, width: int) -> list[str]:
    """A word of a command on a line of its own, or on several."""
    if "'" in word or cell_len(f"  {word} \\") <= width:
        return [f"  {word}"]
    pieces = ["  "]
    for part in re.findall(r"[^,/]*[,/]|[^,/]+", word):
        if pieces[-1].strip() and cell_len(f"{pieces[-1]}{part} \\") > width:
            pieces[-1] += "\\"
            pieces.append("")
        pieces[-1] += part
    return pieces


def _sizes(cells: Sequence[Sequence[str]], width: int) -> list[int]:
    """Width of each column: the longest word, and a share of what is free as large as the column's need."""
    least, most = [_least(c) for c in cells], [_most(c) for c in cells]
    free = width - _width(least)
    wanted = [m - n for m, n in zip(most, least, strict=True)]
    for k in sorted(range(len(cells)), key=lambda k: wanted[k]):  # small needs first, so that they are met whole
        others = sum(1 for other in wanted if other >= wanted[k] and other > 0) or 1
        given = min(wanted[k], free // others)
        least[k], wanted[k], free = least[k] + given, 0, free - given
    return least


def _row_by_row(cells: Sequence[Sequence[str]], width: int) -> list[RenderableType]:
    """Every row as its first cell and pairs of heading and value; no pair that fits a line is broken."""
    lines: list[RenderableType] = []
    for row in range(1, len(cells[0])):
        lines.append(f"[bold]{cells[0][row]}[/bold]")
        line = ""
        for pair in (f"{c[0]} {c[row]}" for c in cells[1:] if c[row]):
            longer = f"{line}{PAIRS}{pair}" if line else f"  {pair}"
            if line and _most([longer]) > width:
                lines += _below(line, width)
                longer = f"  {pair}"
            line = longer
        lines += _below(line, width)
    return lines


def _below(line: str, width: int) -> list[RenderableType]:
    """A line of pairs; what does not fit stands further to the right, where no new row can be taken for it."""
    if _most([line]) <= width or width <= 4 * GAP:
        return [line]
    first, *others = Text.from_markup(line).wrap(Console(width=width), width - 2 * GAP)
    return [first, *(Text(" " * 2 * GAP) + other for other in others)]


def _width(sizes: Sequence[int]) -> int:
    return sum(sizes) + GAP * (len(sizes) - 1)


def _least(cells: Sequence[str]) -> int:
    return max(
        (cell_len(word) for cell in cells for word in re.split(r"[ \n](?!%)", Text.from_markup(cell).plain)), default=1
    )


def _most(cells: Sequence[str]) -> int:
    return max((cell_len(line) for cell in cells for line in Text.from_markup(cell).plain.split("\n")), default=1)
