"""A result as a page: for people and as JSON for machines, side by side. No mathematics: numbers are only arranged."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from rich.markup import escape
from rich.table import Table

from frischid.model.alarms import Alarm


@dataclass(frozen=True)
class Page:
    """A result, ready to print."""

    data: Any
    parts: Sequence[Any]


def change(before: float, after: float) -> str:
    """Relative change, in percent."""
    return f"{100 * (after / before - 1):+.1f} %" if before else "–"


def quantities(found: Sequence[tuple[str, float, str]]) -> str:
    """The values of a finding, each with its unit."""
    return ", ".join(f"{name} = {x:.4g}{f' {unit}' if unit else ''}" for name, x, unit in found)


def depends(variables: Sequence[str]) -> str:
    """The variables that a residual is not independent of."""
    return f"not independent of {', '.join(variables)}" if variables else ""


def warning_lines(warnings: Sequence[str]) -> list[str]:
    """Warnings, one per line."""
    return [f"[yellow]warning:[/yellow] {escape(w)}" for w in warnings]


def alarm_lines(alarms: Sequence[Alarm]) -> list[str]:
    """Alarms, one per line, each with its remedy; nothing where there is none."""
    colours = {"severe": "bold red", "doubt": "yellow"}
    return [
        f"[{colours[a.severity]}]ALARM {a.id}:[/{colours[a.severity]}] {escape(a.sentence)} {escape(a.remedy)}"
        for a in alarms
    ]


def table_of(*columns: str, title: str | None = None) -> Table:
    """An empty table with the house's headings."""
    table = Table(title=title, title_justify="left", header_style="bold", box=None, pad_edge=False)
    words = {
        "joint",
        "where",
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
        "equation",
        "robot",
        "parameters",
    }
    for column in columns:
        table.add_column(
            column, justify="left" if column in words else "right", overflow="fold", no_wrap=column == "joint"
        )
    return table


def figure(x: float) -> str:
    """Four digits, or a dash."""
    return "–" if not np.isfinite(x) else f"{x:.4g}"


def plain(x: float) -> float | None:
    """A number for JSON, null when there is none."""
    return float(x) if np.isfinite(x) else None
