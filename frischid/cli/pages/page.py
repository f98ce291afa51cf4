"""A result as a page: text and tables for people, JSON for machines. Pages arrange numbers and compute none."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.markup import escape
from rich.table import Table

from frischid.cli.narrow import Wide

if TYPE_CHECKING:  # the studio prints its address on such a page before anything heavy is imported
    from frischid.model.alarms import Alarm
    from frischid.model.headline import Headline


@dataclass(frozen=True)
class Page:
    """A result, ready to print."""

    data: Any
    parts: Sequence[Any]
    """Text and tables."""
    alarms: Sequence[Alarm] = ()
    """They stand above everything; a severe one makes the command end with exit code 1."""
    found_nothing: bool = False
    """Whether the result is that what was sought is not there."""

    @property
    def exit_code(self) -> int:
        """1 where an alarm is severe or there are no figures, so that a script does not trust them; otherwise 0."""
        return int(self.found_nothing or any(alarm.severity == "severe" for alarm in self.alarms))


def change(before: float, after: float) -> str:
    """Relative change, in percent."""
    return f"{100 * (after / before - 1):+.1f} %" if before else "–"


def quantities(found: Sequence[tuple[str, float | str, str]]) -> str:
    """The values of a finding, each with its unit."""
    said = ((name, x if isinstance(x, str | bool) else f"{x:.4g}", unit) for name, x, unit in found)
    return ", ".join(f"{name} = {x} {unit}".rstrip() for name, x, unit in said)


def depends(variables: Sequence[str]) -> str:
    """The variables on which a residual depends, in words."""
    return f"not independent of {', '.join(variables)}" if variables else ""


def warning_lines(warnings: Sequence[str]) -> list[str]:
    """Warnings, one per line."""
    return [f"[yellow]warning:[/yellow] {escape(w)}" for w in warnings]


def alarm_lines(alarms: Sequence[Alarm]) -> list[str]:
    """Alarms, one per line, each with its remedy; an empty list without alarms. A doubt is called a doubt."""
    looks = {"severe": ("bold red", "ALARM"), "doubt": ("yellow", "DOUBT")}
    return [
        f"[{colour}]{word} {a.id}:[/{colour}] {escape(a.sentence)} {escape(a.remedy)}"
        for a in alarms
        for colour, word in [looks[a.severity]]
    ]


def headline_line(error: Headline) -> str:
    """The model's one error, with its references."""
    grade = f"grade {error.grade}: {error.grade_in_words}" if error.grade != "–" else error.grade_in_words
    return f"[bold]NRMSE {error.nrmse:.4f}[/bold] {error.where} ({error.references}); {grade}"


def table_of(*columns: str, title: str | None = None, droppable: Sequence[str] = ()) -> Table:
    """An empty table; headings of numbers are aligned to the right.

    Parameters
    ----------
    droppable : sequence of str
        Columns that a narrow terminal may go without, the least important first.
    """
    table = Wide(title=title, droppable=droppable)
    words = {
        "joint",
        "where",
        "joint by joint, without and with the effect",
        "confused with",
        "action",
        "effects",
        "parameter",
        "base parameter",
        "stands for",
        "unit",
        "kind",
        "effect",
        "what",
        "measured",
        "equation",
        "robot",
        "parameters",
    }
    for column in columns:
        table.add_column(column, justify="left" if column in words else "right")
    return table


def figure(x: float) -> str:
    """Four digits, or a dash; no zero has a sign."""
    return "–" if not np.isfinite(x) else f"{x + 0.0:.4g}"


def plain(x: float) -> float | None:
    """A number for JSON, null when there is none."""
    return float(x) if np.isfinite(x) else None
