"""Prior of a robot's parameters before any log: independent normal distributions, with a scale for each link and rotor.

    θ_c ~ N(μ_c, s_l² d_c²),   θ_c ≥ 0 of known sign,   l the link or rotor of parameter c

`frischid.estimators.urdf_prior` makes it from a URDF; `frischid.estimators.map_estimate` finds the scales.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from frischid.core.types import Array


@dataclass(frozen=True, eq=False)
class ParameterPrior:
    """Prior of C parameters before any log, each independent of the others."""

    names: tuple[str, ...]
    mean: Array
    """Each in its parameter's unit, (C,)."""
    spread: Array
    """Standard deviations d, (C,)."""
    group: tuple[str, ...]
    """Link or rotor whose scale the parameter shares; empty for a parameter at scale 1."""
    nonnegative: NDArray[np.bool_]
    """Parameters whose sign is known, (C,)."""
    negative: Array
    """Standard deviation on the negative side of a parameter that is usually positive, but need not be, (C,); zero for
    others. Such a parameter is the difference of two nonnegative ones."""
    scales: dict[str, float]
    """Scale s of each group; a missing scale is 1."""

    @property
    def of_links(self) -> NDArray[np.bool_]:
        """Parameters of links, shape (C,)."""
        return np.array([bool(g) and x == 0 for g, x in zip(self.group, self.negative, strict=True)])

    @property
    def scaled_spread(self) -> Array:
        """Standard deviations at the groups' scales, shape (C,)."""
        return np.asarray(self.spread * [self.scales.get(g, 1.0) for g in self.group])

    @property
    def total_spread(self) -> Array:
        """Standard deviations with the negative side, shape (C,)."""
        return np.asarray(np.hypot(self.scaled_spread, self.negative))


@dataclass(frozen=True)
class ScaleRule:
    """Rule for the scale of a link's or a rotor's prior, given the data."""

    freedom: float = 4.0
    """ν, weight of the assumption that a link has the scale of its URDF, and that a URDF has scale 1, as a number of
    parameters. It is four of a link's ten, so that a link that the log hardly moves keeps the scale of the others."""
    least: float = 0.03
    most: float = 1e4
    """`least`, `most`: Bounds of the scale: no URDF has less than three percent of the usual error. A URDF in which
    every mass is 1 g has a hundred times, and the rotor behind the gear of a finger's last link can have thousands of
    times."""
