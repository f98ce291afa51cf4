"""What a table of a page is made of: a stored result, its rows in Markdown, and the version and machine that made it.

`benchmarks/NAME.py --json docs/data/NAME.json` stores a result; the modules `tables_...` write rows from it.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

DOCS = Path(__file__).parent
ROOT = DOCS.parent

Row = dict[str, Any]


def data(script: str = "six_robots") -> dict[str, Any]:
    """The stored result of a script."""
    return dict(json.loads((DOCS / "data" / f"{script}.json").read_text(encoding="utf-8")))


def rows_of(script: str) -> list[Row]:
    """Rows of the stored result of a script."""
    return list(data(script)["rows"])


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table."""
    cells = [[cell.replace("|", "&#124;") for cell in row] for row in rows]
    lines = [head, ["---"] * len(head), *cells]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def where(joints: Sequence[str]) -> str:
    """Joints in a few letters, in brackets; nothing for the whole robot."""
    names = [re.sub(r"^panda_|_joint$", "", joint).replace("_", " ") for joint in joints]
    return f" ({', '.join(names)})" if names else ""


def percent(share: float) -> str:
    """A share as a whole percentage."""
    return f"{100 * share:.0f} %"


def share(rows: Iterable[Row], key: str = "first") -> str:
    """Share of rows for which `key` is true, among those that have a value, and their number."""
    counted = [bool(row[key]) for row in rows if row[key] is not None]
    return f"{percent(sum(counted) / len(counted))} of {len(counted)}" if counted else "–"


def middle(values: Iterable[float]) -> float:
    """Median."""
    ordered = sorted(values)
    k = len(ordered) // 2
    return ordered[k] if len(ordered) % 2 else (ordered[k - 1] + ordered[k]) / 2


def geometric_mean(values: Sequence[float]) -> float:
    """Geometric mean."""
    return math.exp(math.fsum(map(math.log, values)) / len(values))


def each(head: Sequence[str], rows: Iterable[Row], line: Callable[[Row], Sequence[str]]) -> str:
    """A table with one line for each row."""
    return table(head, [tuple(line(row)) for row in rows])


def machine(name: str, script: str | None = None) -> str:
    """Version and machine of a stored result, and the script that made it (by default called as the result)."""
    stored = data(name)
    computer = stored["machine"]
    load = computer.get("load", 0.0)
    busy = f", busy with other work (load {load})" if load > computer["cores"] + 0.5 else ""
    return (
        f"*Made by `benchmarks/{script or name}.py` with frischid {stored['frischid']}, Python {computer['python']}, "
        f"{computer['cores']} cores ({computer['processor']}){busy}.*\n"
    )
