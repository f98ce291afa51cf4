"""Colours of the joints in the scene."""

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
