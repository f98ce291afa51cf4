"""Text for viser's markdown, which has a syntax of its own."""

from __future__ import annotations

import re

from frischid.figures.style import typeset

MARKUP_SIGNS = r"[]\\`*_{}<>&!|~#\[]"
"""Signs that markdown or HTML give a meaning; as entities they have none."""


def plain(text: str) -> str:
    """Text for viser's markdown: a name stays text, and is no code, no link, and no picture from another server."""
    return re.sub(MARKUP_SIGNS, lambda sign: f"&#{ord(sign[0])};", " ".join(typeset(text).splitlines()))
