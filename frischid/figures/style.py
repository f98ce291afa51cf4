"""The look of every figure: colours, template, names, and the number of drawn points.

Colours are those of Okabe and Ito, which colour-blind readers can distinguish. Lines that must differ in grey too also
differ in dash, marker or lightness. Titles and explanations are text beside the figure, so that they wrap on a small
screen. Curves are thinned by min-max: of every stretch of samples, those with the least and the largest value of each
curve are kept, so that a peak of one sample is drawn in a log of any length.
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
"""Colour of the measured torque: thick and grey behind the model's thin line, visible on white and on black."""
INK, FAINT, GRID, SHADE = "#222222", "#555555", "#e2e2e2", "#ececec"
BLACK, WHITE = "#101010", "#ffffff"
"""Colour of numbers on strong colours; on a dark page, black stays black, but white would not stay white."""
SCALE = ((0.0, "#fdf1e3"), (0.3, "#fde0c0"), (0.65, "#e8873a"), (1.0, "#8c3a00"))
"""Colour scale from light to dark in one hue, readable in grey. Blank cells are lighter than its lightest colour."""
STRONG, FULL = 0.55, 0.85
POINTS = 1600
"""Largest number of drawn samples of one curve."""
UNITS = {"q": "rad", "v": "rad/s", "a": "rad/s²", "load": "N·m", "t": "s"}
SLIDING = {"q": "m", "v": "m/s", "a": "m/s²", "load": "N", "t": "s"}
VARIABLE_WORDS = {
    "q": "position q", "v": "velocity q̇", "a": "acceleration q̈", "load": "load", "t": "time"
}  # fmt: skip


SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
EXPLAINED = {"load": "load (the model's torque)", "t": "time from the log's beginning"}
"""Longer names of variables, for axes."""


@dataclass(frozen=True, eq=False)
class Drawing:
    """A figure with the text that a reader needs beside the figure."""

    title: str
    """Name of the figure."""
    reading: str
    """Explanation of the figure, in one line."""
    figure: go.Figure
    """Has no title of its own."""
    height: int
    """Height, pixels."""

    @property
    def legend(self) -> bool:
        """Whether there is a legend above the curves."""
        named = [t for t in self.figure.data if t.name and t.showlegend is not False]
        return len(named) > 1 and self.figure.layout.showlegend is not False


def drawing(title: str, reading: str, figure: go.Figure, height: int, **layout: Any) -> Drawing:
    """Give a figure the common look."""
    figure.update_layout(template=TEMPLATE, height=height, **layout)
    return Drawing(typeset(title), typeset(reading), figure, height)


def number(x: float | None, digits: int = 4) -> str:
    """A number with few digits, as text; a dash where there is no number."""
    if x is None or not np.isfinite(x):
        return "–"
    if abs(x) < 1e-15:  # zero up to rounding
        return "0"
    mantissa, _, exponent = f"{x:.{digits - 1}e}".partition("e")
    if -4 <= int(exponent) < 6:
        text = f"{x:.{digits}g}"
        return (f"{x:.0f}" if "e" in text else text).replace("-", "−")
    mantissa = mantissa.rstrip("0").rstrip(".") if "." in mantissa else mantissa
    return f"{mantissa}·10{str(int(exponent)).translate(SUPERSCRIPTS)}".replace("-", "−")


def typeset(text: str) -> str:
    """Text with proper minus signs, in which a number stays on one line with its name and its unit."""
    text = re.sub(r"(?<![\w.])-(?=\.?\d)", "−", text)
    text = re.sub(r"(?<=\d)%", " %", text)
    text = re.sub(r" = (?=[−\d])", "\u00a0=\u00a0", text)
    return re.sub(r"(?<=\d) (?=(?:%|×|rad|m/|m\b|N|s\b|ms\b|Hz|kg)(?!\w{3}))", "\u00a0", text)


def _axis(**extra: Any) -> dict[str, Any]:
    return {
        "gridcolor": GRID, "zerolinecolor": GRID, "linecolor": FAINT, "title": {"standoff": 8, "font": {"size": 12}},
        # Invisible ticks keep the numbers of the two axes apart in the corner.
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
"""The common look; on a dark page the report replaces the colours INK, GRID, ..."""


PANELS = (1.4, 1.0, 0.7, 0.7)
"""Heights of a joint's panels: torque, residual, position, velocity."""


def stack(figure: go.Figure, titles: Sequence[str], heights: Sequence[float] = PANELS) -> None:
    """Panels one above the other on one time axis, as high as `heights` say, with one cursor through all."""
    shares = np.array(heights[: len(titles)])
    gap = 0.05
    parts = shares / shares.sum() * (1 - gap * (len(titles) - 1))
    top = 1.0
    for k, (title, height) in enumerate(zip(titles, parts, strict=True)):
        axis = {"title": {"text": title}, "domain": [max(top - float(height), 0.0), top], "anchor": "x"}
        few = {"nticks": 4} if shares[k] < 1 else {}  # in a low panel the numbers on the axis would touch
        figure.update_layout({f"yaxis{k + 1 if k else ''}": axis | few})
        top -= float(height) + gap
    figure.update_layout(hovermode="x unified", hoversubplots="axis")
    figure.update_xaxes(
        anchor=f"y{len(titles)}" if len(titles) > 1 else "y", unifiedhovertitle_text="%{x:.2f} s",
        showspikes=True, spikemode="across", spikesnap="cursor", spikedash="solid", spikethickness=1, spikecolor=FAINT,
    )  # fmt: skip


def on_scale(share: float) -> str:
    """Colour of a number on `SCALE`; on a dark page it is replaced together with the colour below."""
    return INK if not share > STRONG else BLACK if share < FULL else WHITE


def short(names: Sequence[str]) -> list[str]:
    """Joint names without the common beginning and end: ``panda_joint1`` becomes ``joint1``."""
    words = [n.split("_") for n in names]
    for end in (-1, 0):
        while all(len(w) > 1 for w in words) and len({w[end] for w in words}) == 1:
            rest = [w[1:] if end == 0 else w[:-1] for w in words]
            # Only whole words are removed, and a word must remain: arm_1 does not become 1.
            if len(words) < 2 or any("".join(w).isdigit() for w in rest):
                break
            words = rest
    return ["_".join(w) for w in words]


def units_of(sliding: bool) -> dict[str, str]:
    """Units of q, v, a, load and t of a turning or a sliding joint."""
    return SLIDING if sliding else UNITS


def units_among(sliding: NDArray[np.bool_]) -> dict[str, str]:
    """Units of q, v, a, load and t of all joints: those of sliding joints in brackets where both kinds are there."""
    if sliding.all() or not sliding.any():
        return units_of(bool(sliding.all()))
    return {name: unit if unit == SLIDING[name] else f"{unit} ({SLIDING[name]})" for name, unit in UNITS.items()}


def axis_of(variable: str, sliding: bool) -> str:
    """Title of an axis: the variable and its unit."""
    return f"{EXPLAINED.get(variable, VARIABLE_WORDS[variable])}, {units_of(sliding)[variable]}"


def breaks(stretch: NDArray[np.intp]) -> NDArray[np.intp]:
    """First samples of further stretches, (B,): a curve is broken before them."""
    return np.flatnonzero(np.diff(stretch)) + 1


def thinned(*curves: Array, points: int = POINTS) -> NDArray[np.intp]:
    """Samples to draw: the first, the last, and the extremes of every curve in equal stretches of samples.

    Parameters
    ----------
    curves : ndarray, shape (N,)
        Curves that share their samples; NaN is not drawn and is skipped.
    points : int
        Most samples to draw.

    Returns
    -------
    ndarray of int
        Ascending; all samples when there are no more than `points`.
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
    """Numbers in the single precision of a figure: half the bytes, and more digits than a screen shows."""
    return np.asarray(x, dtype=np.float32)


def save(path: str | Path, *figures: go.Figure) -> None:
    """Write figures, one below the other, as one HTML file that opens offline."""
    first, *others = figures
    further = "".join(figure.to_html(include_plotlyjs=False, full_html=False, auto_play=False) for figure in others)
    page = first.to_html(include_plotlyjs=True, full_html=True, auto_play=False)
    write_text(Path(path), page.replace("</body>", f"{further}</body>"))
