"""Figures in Plotly, self-contained and offline, for the report and the studio.

Comes in: results of the library. Goes out: a `Drawing`, which is a Plotly figure with its title and a text that
explains it. Each module draws for one chapter of the report; the studio shows the same figures. Classes of results are
imported for type checks only, because the studio's first picture waits for every import of this folder. Start reading
at `style.Drawing`.
"""

from frischid.figures.failure import against, matrix, plane
from frischid.figures.ghost import ghost, position_error
from frischid.figures.history import staircase
from frischid.figures.missing import shape
from frischid.figures.motion import animated, excitation
from frischid.figures.parameters import closing, intervals
from frischid.figures.quality import noise, reach, usual_noise
from frischid.figures.style import Drawing, save, short
from frischid.figures.torque import Overlay, measured
from frischid.figures.two_logs import two_logs

__all__ = [
    "Drawing", "Overlay", "against", "animated", "closing", "excitation", "ghost", "intervals", "matrix", "measured",
    "noise", "plane", "position_error", "reach", "save", "shape", "short", "staircase", "two_logs",
    "usual_noise",
]  # fmt: skip
