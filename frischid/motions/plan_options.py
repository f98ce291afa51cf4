"""Options of a planned motion: its length, family, criterion and limits.

A family of motions is linear in its coefficients; `PlanOptions.size` gives their number. By default there are harmonics
up to about 1.2 Hz, two control points per second, or one via point per second (Swevers et al. 1997, IEEE Trans.
Robotics and Automation 13(5), use five harmonics of 0.1 Hz).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from frischid.core.arguments import check_number
from frischid.core.types import Array
from frischid.errors import InputError, UnknownNameError
from frischid.motions.chirps import FASTEST, STEP_SHARES, USUAL, default_windows, highest_frequency
from frischid.motions.collision import Clearance
from frischid.motions.families import FAMILIES, Family
from frischid.motions.limits import MotionLimits
from frischid.motions.motion_request import check_length
from frischid.motions.optimality import Criterion, criterion_of
from frischid.motions.optimize import Bounds

PLAN_RATE = 7.5
"""Instants of the criterion per second."""
PER_PERIOD = 16.0
"""Instants of the criterion per period of the highest frequency of chirps."""


@dataclass(frozen=True, eq=False)
class PlanOptions:
    """The motion to search for, and the effort of the search.

    Attributes
    ----------
    duration : float
        Seconds.
    family : {"fourier", "bspline", "points", "steps", "chirps", "steps+chirps"}
    size : int, optional
        Number of harmonics, control points, via points or windows of a chirp; `default_size` when not given.
    samples : int, optional
        Number of equally spaced instants at which the criterion is computed; in the family ``"points"`` these are the
        via points.
    criterion : str or Criterion
        Name in `frischid.motions.optimality.CRITERIA`, or an instance.
    highest : float, optional
        Highest frequency of chirps, Hz; by default that from which faster chirps tell no more within the limits.
    bounds : {"everywhere", "points"}
        ``"points"`` keeps the limits at the via points only, as Massaroli et al. do; `Plan.violations` lists the limits
        that are exceeded between them. Torque and distances are then ignored.
    limits : MotionLimits or float
        Limits, or the share of the URDF's limits to use.
    clearance : Clearance, optional
        Pairs of bodies that must not touch; by default from the URDF's collision shapes and a floor at the base.
    budget : int
        Evaluations of the criterion per start, the cost of its gradients included.
    seed : int
        The same seed gives the same motion.
    starts : int
        Number of searches from different starts; the best motion that keeps its limits is taken.

    Raises
    ------
    InputError
        Options contradict each other, or a number is out of its range.
    UnknownNameError
        There is no such family, criterion or choice of bounds.

    Examples
    --------
    >>> from frischid.motions.plan_options import PlanOptions
    >>> PlanOptions(duration=10.0, family="bspline").family_size
    20
    >>> PlanOptions(bounds="points")
    Traceback (most recent call last):
    ...
    frischid.errors.InputError: bounds at the points need family 'points'; 'fourier' has none
    """

    duration: float = 20.0
    family: str = "fourier"
    size: int | None = None
    samples: int | None = None
    criterion: str | Criterion = "condition"
    highest: float | None = None
    bounds: Bounds = "everywhere"
    limits: MotionLimits | float = 0.9
    clearance: Clearance | None = None
    budget: int = 30_000
    seed: int = 0
    starts: int = 1

    def __post_init__(self) -> None:
        for name in ("size", "samples", "budget", "seed", "starts"):
            value = getattr(self, name)
            if value is not None:
                check_number(f"{name} of a plan", value)
            if value is not None and value % 1 != 0:
                raise InputError(f"{name} of a plan must be a whole number, got {value}")
        if self.starts < 1:
            raise InputError(f"a search needs at least one start, got {self.starts}")
        if self.budget < 1:
            raise InputError(f"a search needs a budget of at least one evaluation, got {self.budget}")
        check_length(self.duration, self.seed)
        if self.family not in FAMILIES:
            raise UnknownNameError("family", self.family, FAMILIES)
        if self.bounds not in {"everywhere", "points"}:
            raise UnknownNameError("bounds", self.bounds, ["everywhere", "points"])
        if self.bounds == "points" and self.family != "points":
            raise InputError(f"bounds at the points need family 'points'; '{self.family}' has none")
        criterion_of(self.criterion)
        least = 2 if self.family == "fourier" else 3
        if self.family_size < least:
            raise InputError(f"family '{self.family}' needs a size of at least {least}, got {self.size}")
        if self.family == "points" and self.samples not in {None, self.family_size}:
            raise InputError(f"family 'points' is judged at its {self.family_size} points; leave the samples out")
        if self.highest is not None and not 0 < self.highest <= FASTEST:
            raise InputError(f"the highest frequency of chirps must lie in (0, {FASTEST:g}] Hz, got {self.highest:g}")
        if self.samples is not None and self.samples < 2:
            raise InputError(f"a criterion needs at least 2 samples, got {self.samples}")

    @property
    def family_size(self) -> int:
        """The given size, or the default one."""
        return default_size(self.family, self.duration) if self.size is None else self.size

    def shape(self) -> Family:
        """The family of motions."""
        return Family.named(self.family, self.duration, self.family_size, self.highest or USUAL)

    def within(self, limits: MotionLimits) -> PlanOptions:
        """The options with the band of chirps that these limits give, where none was named."""
        if self.highest is not None or self.family not in STEP_SHARES:
            return self
        return replace(self, highest=highest_frequency(limits.half, limits.velocity, limits.acceleration))

    def instants(self) -> Array:
        """Times at which the criterion is computed, s."""
        if self.family == "points":
            return np.linspace(0.0, self.duration, self.family_size)
        rate = PER_PERIOD * (self.highest or USUAL) if self.family in STEP_SHARES else PLAN_RATE
        count = max(100, round(rate * self.duration)) if self.samples is None else self.samples
        return np.linspace(0.0, self.duration, count)


def default_size(family: str, duration: float) -> int:
    """Harmonics up to 1.2 Hz, two control points per second, or one via point per second; at least six."""
    if family in STEP_SHARES:
        return default_windows(duration)
    wanted = {"fourier": round(1.2 * duration), "bspline": round(2 * duration), "points": round(duration) + 1}
    return max(wanted[family], 6)
