"""How every figure looks: colours, template, names, and how many points are drawn.

Colours are Okabe and Ito's, distinct to the colour-blind; lines that must be distinct in grey too differ in dash,
marker or lightness too. Titles and readings are text beside the figure, not inside it, so that they wrap on a small
screen. Display is thinned by min-max: of every stretch of samples the ones with the least and the largest value of
each curve are kept, so that a peak of one sample is drawn however long the log.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray

from frischid.core.files import write_text
from frischid.core.types import Array

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000", "#999999")  # Okabe and Ito
DASHES = ("solid", "dash", "dot", "dashdot")
BLUE, VERMILION, GREEN, PURPLE, ORANGE = COLOURS[:5]
MEASURED = "#808080"
"""Measured torque: thick and grey behind the model's thin line, visible on white and on black."""
INK, FAINT, GRID, SHADE = "#222222", "#555555", "#e2e2e2", "#ececec"
BLACK, WHITE = "#101010", "#ffffff"
"""Of numbers on strong colours: black stays black in the dark, white does not stay white."""
SCALE = ((0.0, "#fdf1e3"), (0.3, "#fde0c0"), (0.65, "#e8873a"), (1.0, "#8c3a00"))
"""Light to dark, one hue: reads the same in grey; nowhere as light as the page, which is where there is nothing."""
STRONG, FULL = 0.55, 0.85
POINTS = 1600
"""Samples drawn of one curve."""
UNITS = {"q": "rad", "v": "rad/s", "a": "rad/s²", "load": "N·m", "t": "s"}
SLIDING = {"q": "m", "v": "m/s", "a": "m/s²", "load": "N", "t": "s"}
VARIABLE_WORDS = {
    "q": "position q", "v": "velocity q̇", "a": "acceleration q̈", "load": "load", "t": "time"
}  # fmt: skip


SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
EXPLAINED = {"load": "load (the model's torque)", "t": "time from the log's beginning"}
"""What an axis says that a title does not."""


@dataclass(frozen=True, eq=False)
class Drawing:
    """A figure with what a reader needs beside it.

    Attributes
    ----------
    title : str
        What is shown.
    reading : str
        What it says, in one line.
    figure : plotly Figure
        Its own title is empty.
    height : int
        Pixels.
    """

    title: str
    reading: str
    figure: go.Figure
    height: int

    @property
    def legend(self) -> bool:
        """Whether there is a legend above the curves."""
        named = [t for t in self.figure.data if t.name and t.showlegend is not False]
        return len(named) > 1 and self.figure.layout.showlegend is not False


def drawing(title: str, reading: str, figure: go.Figure, height: int, **layout: Any) -> Drawing:
    """Give a figure the house's look."""
    figure.update_layout(template=TEMPLATE, height=height, **layout)
    return Drawing(typeset(title), typeset(reading), figure, height)


def number(x: float | None, digits: int = 4) -> str:
    """A number with few digits, as a person writes it; a dash where there is none."""
    if x is None or not np.isfinite(x):
        return "–"
    if abs(x) < 1e-15:  # a zero that was rounded
        return "0"
    mantissa, _, exponent = f"{x:.{digits - 1}e}".partition("e")
    if -4 <= int(exponent) < 6:
        text = f"{x:.{digits}g}"
        return (f"{x:.0f}" if "e" in text else text).replace("-", "−")
    mantissa = mantissa.rstrip("0").rstrip(".") if "." in mantissa else mantissa
    return f"{mantissa}·10{str(int(exponent)).translate(SUPERSCRIPTS)}".replace("-", "−")


def typeset(text: str) -> str:
    """Prose with minus signs, and with numbers that stay in one line with their name and their unit."""
    text = re.sub(r"(?<![\w.])-(?=\.?\d)", "−", text)
    text = re.sub(r"(?<=\d)%", " %", text)
    text = re.sub(r" = (?=[−\d])", "\u00a0=\u00a0", text)
    return re.sub(r"(?<=\d) (?=(?:%|×|rad|m/|m\b|N|s\b|ms\b|Hz|kg)(?!\w{3}))", "\u00a0", text)


def _axis(**extra: Any) -> dict[str, Any]:
    return {
        "gridcolor": GRID, "zerolinecolor": GRID, "linecolor": FAINT, "title": {"standoff": 8, "font": {"size": 12}},
        # Ticks that nobody sees keep the two axes' numbers apart in the corner.
        "ticks": "outside", "ticklen": 4, "tickcolor": "rgba(0,0,0,0)", **extra,
    }  # fmt: skip


TEMPLATE = go.layout.Template(
    layout={
        "font": {"family": "system-ui, sans-serif", "size": 12, "color": INK},
        "paper_bgcolor": "rgba(0,0,0,0)",
        "plot_bgcolor": "rgba(0,0,0,0)",
        "colorway": list(COLOURS),
        "margin": {"l": 64, "r": 12, "t": 34, "b": 46},
        "legend": {"orientation": "h", "x": 0, "y": 1, "xanchor": "left", "yanchor": "bottom", "font": {"size": 11}},
        "xaxis": _axis(),
        "yaxis": _axis(),
        "hovermode": "closest",
        "dragmode": "zoom",
    }
)
"""The house's look; the colours of INK, GRID, ... are swapped by the report's page in the dark."""


def on_scale(share: float) -> str:
    """Colour of a number written on `SCALE`; the page swaps it in the dark together with what is under it."""
    return INK if not share > STRONG else BLACK if share < FULL else WHITE


def short(names: Sequence[str]) -> list[str]:
    """Joint names without what all of them begin and end with: ``panda_joint1`` is ``joint1``."""
    words = [n.split("_") for n in names]
    for end in (-1, 0):
        while all(len(w) > 1 for w in words) and len({w[end] for w in words}) == 1:
            rest = [w[1:] if end == 0 else w[:-1] for w in words]
            # Whole words only, and something to read must stay: arm_1 is not called 1.
            if len(words) < 2 or any("".join(w).isdigit() for w in rest):
                break
            words = rest
    return ["_".join(w) for w in words]


def units_of(sliding: bool) -> dict[str, str]:
    """Units of q, v, a, load and t of a turning or a sliding joint."""
    return SLIDING if sliding else UNITS


def axis_of(variable: str, sliding: bool) -> str:
    """Title of an axis: the variable and its unit."""
    return f"{EXPLAINED.get(variable, VARIABLE_WORDS[variable])}, {units_of(sliding)[variable]}"


def breaks(stretch: NDArray[np.intp]) -> NDArray[np.intp]:
    """Where another stretch begins, (B,): a curve is broken before these samples."""
    return np.flatnonzero(np.diff(stretch)) + 1


def thinned(*curves: Array, points: int = POINTS) -> NDArray[np.intp]:
    """Which samples to draw: the extremes of every curve in equal stretches of samples, first and last.

    Parameters
    ----------
    curves : ndarray, shape (N,)
        Curves that share their samples; NaN draws nothing and is passed over.
    points : int
        Samples to draw at most.

    Returns
    -------
    ndarray of int
        Ascending; all of them when there are no more than `points`.
    """
    N = len(curves[0])
    if points >= N:
        return np.arange(N)
    stretches = max(1, (points - 2) // (2 * len(curves)))
    width = -(-N // stretches)
    keep = [np.array([0, N - 1])]
    for curve in curves:
        padded = np.full(-(-N // width) * width, np.nan)
        padded[:N] = curve
        rows = padded.reshape(-1, width)
        offset = width * np.arange(len(rows))
        keep.append(np.where(np.isnan(rows), np.inf, rows).argmin(axis=1) + offset)
        keep.append(np.where(np.isnan(rows), -np.inf, rows).argmax(axis=1) + offset)
    found = np.unique(np.concatenate(keep))
    return np.asarray(found[found < N])


def plain(x: Array) -> NDArray[np.float32]:
    """Numbers as a figure stores them: half the bytes, and more digits than a screen."""
    return np.asarray(x, dtype=np.float32)


def save(figure: go.Figure, path: str | Path) -> None:
    """Write a figure as one HTML file that opens offline."""
    write_text(Path(path), figure.to_html(include_plotlyjs=True, full_html=True))
