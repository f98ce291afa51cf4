"""Types that every stage shares.

A torque is a sum of columns times parameters, ``τ = Σ_c y_c θ_c``. `Column` describes one of them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
"""A float array; docstrings give its shape."""

Sign = Literal[-1, 0, 1]
"""Known sign of a parameter; 0 when either sign is possible."""


@dataclass(frozen=True)
class Column:
    """Meaning of one column of the regressor.

    Examples
    --------
    >>> from frischid.core.types import Column
    >>> Column("fv1", "N·m·s/rad", "elbow", "viscous", sign=1).name
    'fv1'
    """

    name: str
    """Parameter name, unique within a regressor (``mx3``, ``fv1``)."""
    unit: str
    """Unit of the parameter (``kg·m``)."""
    joint: str
    """Joint (and so link) that the column belongs to."""
    effect: str
    """``"rigid"``, or the identifier of the effect that computes the column."""
    sign: Sign = 0
    """Known sign of the parameter; 0 when either sign is possible."""
