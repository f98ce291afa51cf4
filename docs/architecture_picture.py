"""Draw docs/architecture.svg from the imports of the package: one box per folder, one arrow per use.

Arrows that follow from others are left out (A to C, where A leads to B and B to C): the transitive reduction of the
graph. Run `python docs/architecture_picture.py` after a change of imports; a test compares the file with the code.
"""

from __future__ import annotations

import ast
from functools import cache
from html import escape
from pathlib import Path

import frischid

PACKAGE, TARGET = Path(frischid.__file__).parent, Path(__file__).with_name("architecture.svg")

# Folder: row from the top, column from the middle, its task.
PLACES: dict[str, tuple[int, float, str]] = {
    "errors": (0, 0.0, "messages that say what to do"),
    "core": (1, 0.0, "types, files, several cores"),
    "robot": (2, 0.0, "URDF → rigid columns"),
    "logs": (3, -0.6, "files → filtered motions"),
    "effects": (4, 0.6, "physics → more columns"),
    "regression": (5, 0.0, "columns → moments of [Y τ]"),
    "motions": (6, -0.6, "planned and simulated motions"),
    "checks": (6, 0.6, "is this log any good?"),
    "estimators": (7, -0.6, "moments → parameters, bounds"),
    "model": (8, 0.0, "logs → model → error on logs"),
    "forward": (9, 0.6, "model + torque → motion"),
    "diagnosis": (10, -0.6, "which effect is missing?"),
    "export": (10, 0.6, "model → URDF, MJCF, C, NumPy"),
    "fleet": (11, -1.1, "many equal robots"),
    "figures": (11, 0.0, "numbers → pictures"),
    "reports": (12, 0.6, "one page to send"),
    "paper": (13, 0.0, "the paper, computed again"),
    "studio": (13, 1.1, "one page to work in"),
    "cli": (14, -0.6, "arguments and printed pages"),
}
WIDTH, HEIGHT, ROW, COLUMN, MARGIN = 230, 44, 68, 215, 12
STYLE = (
    "rect{fill:#f4f7fb;stroke:#4a6fa5}path{fill:none;stroke:#4a6fa5;stroke-width:1.3;marker-end:url(#head)}"
    "text{font-family:sans-serif;text-anchor:middle;fill:#1d2733}.name{font-weight:bold;font-size:15px}"
    ".does{font-size:12px}"
)


def uses() -> dict[str, set[str]]:
    """Folder -> folders that its modules import."""
    found: dict[str, set[str]] = {name: set() for name in PLACES}
    for path in PACKAGE.rglob("*.py"):
        folder = path.relative_to(PACKAGE).with_suffix("").parts[0]
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and folder in found:
                parts = [*str(node.module).split("."), *(alias.name for alias in node.names)]
                if parts[0] == "frischid" and parts[1] in found:
                    found[folder].add(parts[1])
    return {name: others - {name} for name, others in found.items()}


def reduced(graph: dict[str, set[str]]) -> list[tuple[str, str]]:
    """Arrows (user, used) that do not follow from others."""

    @cache
    def below(name: str) -> frozenset[str]:
        return frozenset(graph[name]).union(*map(below, graph[name]))

    return [
        (user, used)
        for user, others in graph.items()
        for used in sorted(others)
        if not any(used in below(between) for between in others - {used})
    ]


def middle(name: str) -> tuple[float, float]:
    """Middle of a folder's box."""
    row, column, _ = PLACES[name]
    left = min(x for _, x, _ in PLACES.values())
    return MARGIN + WIDTH / 2 + (column - left) * COLUMN, MARGIN + HEIGHT / 2 + row * ROW


def arrow(used: str, user: str) -> str:
    """An arrow from the lower edge of the used folder to the upper edge of its user."""
    (x, y), (u, w) = middle(used), middle(user)
    y, w = y + HEIGHT / 2, w - HEIGHT / 2 - 3
    bend = (w - y) * (0.5 if w - y < ROW else 0.75)
    return f'<path d="M{x:g} {y:g}C{x:g} {y + bend:g} {u:g} {w - bend:g} {u:g} {w:g}"/>'


def picture() -> str:
    """The SVG."""
    width = max(middle(name)[0] for name in PLACES) + WIDTH / 2 + MARGIN
    height = max(middle(name)[1] for name in PLACES) + HEIGHT / 2 + MARGIN
    parts = [arrow(used, user) for user, used in reduced(uses())]
    for name, (_, _, does) in PLACES.items():
        x, y = middle(name)
        parts.append(
            f'<rect x="{x - WIDTH / 2:g}" y="{y - HEIGHT / 2:g}" width="{WIDTH}" height="{HEIGHT}" rx="6"/>'
            f'<text class="name" x="{x:g}" y="{y - 3:g}">{name}</text>'
            f'<text class="does" x="{x:g}" y="{y + 14:g}">{escape(does)}</text>'
        )
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {height:g}" width="{width:g}">\n'
        f"<title>The folders of frischid, and which uses which</title>\n<style>{STYLE}</style>\n"
        '<marker id="head" viewBox="0 0 8 8" refX="6" refY="4" markerWidth="7" markerHeight="7" orient="auto">'
        '<polygon points="0,0 8,4 0,8" fill="#4a6fa5"/></marker>\n'
        '<rect width="100%" height="100%" style="fill:#fff;stroke:none"/>\n' + "\n".join(parts) + "\n</svg>\n"
    )


if __name__ == "__main__":
    TARGET.write_text(picture(), encoding="utf-8")
