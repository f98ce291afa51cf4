"""Text for viser's markdown, which has a syntax of its own."""

from __future__ import annotations

from frischid.figures.style import typeset


def plain(text: str) -> str:
    """Text for viser's markdown, which would read braces and angle brackets as code."""
    text = typeset(text)
    for sign, code in (("<", "&lt;"), ("{", "&#123;"), ("}", "&#125;"), ("*", "\\*")):
        text = text.replace(sign, code)
    return text.replace("_", "\\_")
