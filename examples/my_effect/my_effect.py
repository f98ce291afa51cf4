"""A magnetic detent: one magnet on a joint's link and one on its base attract where they face each other.

    U = −k (2 − x²)/(1 + x²)^(5/2),   τ = dU/dq = md x (4 − x²)/(1 + x²)^(7/2),   x = (q − position)/width

for two dipoles at a distance of `width` (times the lever arm) that slide past each other.

Source: Griffiths 2017, Introduction to Electrodynamics, chapters 5 and 6.
"""

from dataclasses import dataclass
from typing import ClassVar

from frischid import Effect


@dataclass(frozen=True)
class MagneticDetent(Effect):
    """Magnetic detent: two magnets pull the joint to one position."""

    id = "magnetic_detent"
    sentence = "{joint} is pulled towards one position, but only near that position: a magnetic detent"
    shapes: ClassVar = {"position": tuple(n / 10 for n in range(-31, 32)), "width": (0.1, 0.2, 0.4)}
    units: ClassVar = {"position": ("rad", "m"), "width": ("rad", "m")}

    position: float = 0.0
    width: float = 0.2

    def terms(self, state):
        """One column per joint: the magnets' torque per newton metre of `md`."""

        def column(joint):
            x = (state.q[:, joint] - self.position) / self.width
            return x * (4 - x**2) / (1 + x**2) ** 3.5

        return self.per_joint(state, "md", "", column, sign=1)
