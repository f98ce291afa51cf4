"""Whether a URDF says what its links weigh, and how long the links are if it does not.

Many URDFs describe a robot's geometry only. Some have no inertials. Others have one mass and inertia for all links, so
that a simulator accepts them. Neither says anything of the robot's torques.
"""

from __future__ import annotations

import numpy as np

from frischid.core.types import Array
from frischid.robot.robot import Robot
from frischid.robot.urdf_doubts import has_one_inertial


def unstated(robot: Robot) -> str:
    """The URDF's substitute for inertials, in words: nothing, or one for all links; "" where it states them.

    Examples
    --------
    >>> import frischid as fr
    >>> from frischid.robot.stated_inertials import unstated
    >>> unstated(fr.Robot.load("ur5"))
    ''
    """
    if not robot.nominal.any():
        return "no inertials"
    return "one mass and inertia for all links" if has_one_inertial(robot.urdf) else ""


def link_lengths(robot: Robot) -> dict[int, float]:
    """Distance from each joint to the farthest next joint or frame on its link, m, by the joint's number.

    A link without any of them counts as long as the mean of the others.
    """
    model = robot.model
    found = dict.fromkeys(robot.numbers.values(), 0.0)
    for i in range(1, model.njoints):
        parent = int(model.parents[i])
        if parent in found:
            found[parent] = max(found[parent], float(np.linalg.norm(model.jointPlacements[i].translation)))
    for frame in model.frames:
        parent = int(frame.parentJoint)
        if parent in found:
            found[parent] = max(found[parent], float(np.linalg.norm(frame.placement.translation)))
    known = [x for x in found.values() if x > 0]
    usual = float(np.mean(known)) if known else 0.0
    return {number: x or usual for number, x in found.items()}


def length_order(name: str) -> int:
    """Power of the length in a parameter of a link: 0 of a mass, 1 of a first moment, 2 of an inertia.

    Examples
    --------
    >>> from frischid.robot.stated_inertials import length_order
    >>> [length_order(name) for name in ("m3", "mx3", "Ixy3")]
    [0, 1, 2]
    """
    kind = name.rstrip("0123456789")
    return 0 if kind == "m" else 1 if kind.startswith("m") else 2


def sizes_of_links(robot: Robot) -> Array:
    """Each parameter of the links for a mass of 1 kg: 1, ℓ, ℓ², with ℓ of a rod as long as the link, (C,)."""
    lengths = link_lengths(robot)
    longest = max(lengths.values(), default=0.0) or 1.0
    rods = np.array([(lengths[robot.numbers[c.joint]] or longest) / np.sqrt(3) for c in robot.columns])
    return np.asarray(rods ** np.array([length_order(c.name) for c in robot.columns]))
