"""Figures, made once and shown wherever they are needed: Plotly, self-contained, offline.

One module a chapter of the report; the studio shows the same ones. They draw what the library has computed and compute
nothing but where to put it on the page. What they draw they know by type only: the studio's first picture waits for all
that is imported here.
"""

from frischid.figures.failure import against, matrix, plane
from frischid.figures.history import staircase
from frischid.figures.missing import shape
from frischid.figures.motion import excitation
from frischid.figures.parameters import closing, correlation, intervals
from frischid.figures.quality import noise, reach
from frischid.figures.style import Drawing, save, short
from frischid.figures.torque import measured

__all__ = [
    "Drawing", "against", "closing", "correlation", "excitation", "intervals", "matrix", "measured", "noise", "plane",
    "reach", "save", "shape", "short", "staircase",
]  # fmt: skip
