"""Pieces of HTML. Everything that comes from files is escaped here and nowhere else."""

from __future__ import annotations

import html
from collections.abc import Iterable, Sequence

from frischid.figures import Drawing
from frischid.figures.style import typeset


def esc(text: object) -> str:
    """Text as HTML."""
    return html.escape(str(text), quote=True)


def said(text: str) -> str:
    """Prose as HTML, with minus signs and units as they should be."""
    return esc(typeset(text))


def command(text: str) -> str:
    """A command line that breaks between its words, and after a comma in one that is wider than the page."""
    words = (f"<span>{esc(word).replace(',', ',<wbr>')}</span>" for word in text.split(" "))
    return f"<code>{' '.join(words)}</code>"


def plot(drawing: Drawing) -> str:
    """A figure: title above, reading below, and its data for the page's script."""
    # "<" is the one character that could end the script element early.
    data = str(drawing.figure.to_json()).replace("<", "\\u003c")
    label = esc(f"{drawing.title}. {drawing.reading}")
    return (
        f'<figure><h4>{esc(drawing.title)}</h4><div class="plot" role="img" aria-label="{label}" '
        f'style="height:{drawing.height}px"><script type="application/json">{data}</script></div>'
        f"<figcaption>{esc(drawing.reading)}</figcaption></figure>"
    )


def plots(drawings: Iterable[Drawing]) -> str:
    """Figures side by side where there is room."""
    return f'<div class="grid">{"".join(plot(d) for d in drawings)}</div>'


def table(headings: Sequence[str], rows: Iterable[Sequence[str]], words: int = 1, caption: str = "") -> str:
    """A table that scrolls sideways on a small screen; cells are HTML already, the first `words` columns are text."""
    head = "".join(f'<th{_kind(i, words)} scope="col">{said(h)}</th>' for i, h in enumerate(headings))
    body = "".join(
        f"<tr>{''.join(f'<td{_kind(i, words)}>{cell}</td>' for i, cell in enumerate(row))}</tr>" for row in rows
    )
    above = f'<p class="caption">{said(caption)}</p>' if caption else ""
    return (
        f'{above}<div class="scroll" tabindex="0" role="region" aria-label="{esc(caption or headings[0])}"><table>'
        f"<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>"
    )


def _kind(column: int, words: int) -> str:
    return ' class="text"' if column < words else ""


def folded(summary: str, content: str, *, opened: bool = False) -> str:
    """Content behind a line that opens it; `summary` is HTML."""
    return f"<details{' open' if opened else ''}><summary>{summary}</summary>{content}</details>"


def items(texts: Iterable[str]) -> str:
    """A list of plain texts."""
    return f"<ul>{''.join(f'<li>{said(t)}</li>' for t in texts)}</ul>"
