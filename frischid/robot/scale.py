"""A mass, a length and a time of the robot itself, in which its numbers do not depend on the units of its URDF.

    mass    M = sum of the bodies' masses
    length  L = longest chain of joints, without the base's own placement
    time    T = √(L / g)

A parameter of unit kgᵃ·mᵇ·sᶜ has the natural size MᵃLᵇTᶜ. Two robots that differ by a factor in length and in mass are
the same robot in these units, so every comparison of parameters, columns or torques with one another is made in them.

Source: E. Buckingham, "On physically similar systems", Physical Review 4(4), 1914.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from frischid.robot.robot import Robot

_BASE = {"kg": (1, 0, 0), "m": (0, 1, 0), "s": (0, 0, 1), "N": (1, 1, -2)}
_POWER = {"²": 2, "³": 3}


@dataclass(frozen=True)
class RobotScale:
    """Natural units of a robot."""

    mass: float
    """kg; 1 where the URDF has no masses."""
    length: float
    """m; 1 where the URDF has no length at all."""
    time: float
    """s; 1 without gravity."""

    @classmethod
    def of(cls, robot: Robot) -> RobotScale:
        """The scale of a robot.

        Examples
        --------
        >>> import frischid as fr
        >>> from frischid.robot.scale import RobotScale
        >>> scale = RobotScale.of(fr.Robot.load("planar2"))
        >>> scale.mass, scale.length
        (31.0, 0.5)
        """
        model = robot.model
        reach = [0.0]
        for i in range(1, model.njoints):
            parent = model.parents[i]
            step = np.linalg.norm(model.jointPlacements[i].translation) if parent else 0.0
            reach.append(reach[parent] + float(step))
        bodies = [body for body in list(model.inertias)[1:] if body.mass > 0.0]
        length = max(reach)
        if length == 0.0:  # one joint: the body's own size
            sizes = [np.sqrt(body.lever @ body.lever + max(np.trace(body.inertia), 0.0) / body.mass) for body in bodies]
            length = float(max(sizes, default=0.0)) or 1.0
        gravity = float(np.linalg.norm(robot.gravity))
        mass = float(sum(body.mass for body in bodies)) or 1.0
        return cls(mass, length, float(np.sqrt(length / gravity)) if gravity else 1.0)

    def size(self, unit: str) -> float:
        """Natural size of a parameter, in its unit.

        Parameters
        ----------
        unit : str
            Such as ``kg·m²`` or ``N·m·s/rad``. Symbols other than kg, m, s and N count as pure numbers.
        """
        mass, length, time = dimensions(unit)
        return float(self.mass**mass * self.length**length * self.time**time)


SI = RobotScale(1.0, 1.0, 1.0)
"""The units of a URDF, for what is defined in them, such as the paper's costs."""


def dimensions(unit: str) -> tuple[int, int, int]:
    """Exponents of mass, length and time in a unit.

    Parameters
    ----------
    unit : str
        Factors joined by ``·``, one ``/``, and brackets around a denominator of several factors. Symbols other than
        kg, m, s and N count as pure numbers.

    Examples
    --------
    >>> from frischid.robot.scale import dimensions
    >>> dimensions("N·m·s/rad"), dimensions("kg·m²"), dimensions("rad/(N·m)")
    ((1, 2, -1), (1, 2, 0), (-1, -2, 2))
    """
    found = np.zeros(3, dtype=int)
    above, _, below = unit.partition("/")
    for factors, sign in ((above, 1), (below.strip("()"), -1)):
        for factor in factors.split("·"):
            power = _POWER.get(factor[-1:], 1)
            found += sign * power * np.array(_BASE.get(factor.rstrip("²³"), (0, 0, 0)))
    mass, length, time = (int(x) for x in found)
    return mass, length, time
