"""Colours of the joints in the scene, and their legend: a bar from the colour without error to that of the largest."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

LIT = (0, 158, 115)
"""A joint that a shown finding acts on."""
COOL, HOT = np.array([150.0, 170.0, 190.0]), np.array([213.0, 94.0, 0.0])


LEAST_TOP, MOST_TOP = 0.02, 1.0


def top_of(errors: Iterable[float]) -> float:
    """NRMSE of the strongest colour: the largest error, within 2 % and that of a constant torque.

    One joint that is far worse than a constant torque would leave all others, and itself after a step, without colour.
    """
    return min(MOST_TOP, max([LEAST_TOP, *errors]))


def colour_of(error: float, top: float) -> tuple[int, int, int]:
    """Blue-grey without error, vermilion at the largest error `top`."""
    share = float(np.clip(error / top, 0.0, 1.0))
    r, g, b = (int(x) for x in COOL + share * (HOT - COOL))
    return r, g, b


def legend(top: float, lit: bool) -> str:
    """HTML of the legend.

    Parameters
    ----------
    top : float
        Error at which the colour is the strongest, a share of the torque's standard deviation.
    lit : bool
        Whether joints are lit because a finding acts on them.
    """
    calm, hot = (f"rgb{colour_of(error, top)}" for error in (0.0, top))
    shown = (
        f'<span style="white-space:nowrap"><i style="{_DOT};background:rgb{LIT}"></i> acts in the finding shown</span>'
        if lit
        else ""
    )
    return (
        '<div class="frischid-legend" style="font-size:.8em;padding:0 10px;display:flex;flex-wrap:wrap;gap:2px 10px">'
        f'<span style="white-space:nowrap">joints: error 0 % <i style="{_BAR};background:linear-gradient(90deg,{calm},'
        f'{hot})"></i> {100 * top:.0f} % and more</span>{shown}</div>'
    )


_BAR = "display:inline-block;width:70px;height:9px;border-radius:4px"
_DOT = "display:inline-block;width:9px;height:9px;border-radius:50%"
