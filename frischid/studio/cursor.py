"""A line over a figure at the present moment, which moves without a new figure.

The figure's left and right margins are known, so the moment at share s of its time axis stands at

    left + (width − left − right) s.
"""

from __future__ import annotations

LEFT, RIGHT, TOP, BOTTOM = 64, 12, 76, 46
"""Margins of the figure, pixels: those of `frischid.figures.style`, with three lines of legend above."""
SIDE, BELOW = 10, 12
"""Space that viser leaves at both sides of a figure and below it, pixels."""


def line(share: float, aspect: float) -> str:
    """HTML of a line that stands over the figure above it.

    Parameters
    ----------
    share : float
        Place on the figure's time axis; outside of [0, 1] there is no line.
    aspect : float
        Height of the figure over its width.
    """
    if not 0.0 <= share <= 1.0:
        return ""
    left = f"calc({LEFT + SIDE}px + (100% - {LEFT + RIGHT + 2 * SIDE}px) * {share:.5f})"
    # A padding in % is one of the width.
    height = f"calc((100% - {2 * SIDE}px) * {aspect:.5f} - {TOP + BOTTOM}px)"
    return (
        '<div class="frischid-cursor" style="position:relative;height:0;pointer-events:none;z-index:5">'
        f'<div style="position:absolute;left:{left};bottom:{BOTTOM + BELOW}px;height:0;padding-top:{height};'
        'border-left:1.5px solid #222"></div></div>'
    )
