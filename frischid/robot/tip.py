"""The tip of a robot: the far end of the longest chain of joints, and its position.

    x(q) = forward kinematics of the tip, m

Joints count along a chain. Of several chains of the same length, the tip is on the last. On the last body the tip is
the origin of the URDF frame farthest from the joint.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin

from frischid.core.types import Array
from frischid.robot.robot import Robot


def tip_joint(robot: Robot) -> str:
    """Name of the last joint of the longest chain."""
    model, depth = robot.model, [0]
    for index in range(1, model.njoints):
        depth.append(depth[model.parents[index]] + 1)
    return str(model.names[len(depth) - 1 - int(np.argmax(depth[::-1]))])


def tip_positions(robot: Robot, q: Array) -> Array:
    """Positions of the tip, m.

    Parameters
    ----------
    robot : Robot
    q : ndarray, shape (N, J)
        Joint positions, rad (m).

    Returns
    -------
    ndarray, shape (N, 3)
        In the base frame.

    Examples
    --------
    >>> import numpy as np
    >>> import frischid as fr
    >>> from frischid.robot.tip import tip_positions
    >>> tip_positions(fr.Robot.load("planar2"), np.zeros((4, 2))).shape
    (4, 3)
    """
    name = tip_joint(robot)
    far = replace(robot, frames="far_end").frame_placement(name).translation
    model, data = robot.model, robot.model.createData()
    index, out = model.getJointId(name), np.empty((len(q), 3))
    for target, x in zip(out, robot.configuration(q), strict=True):
        pin.forwardKinematics(model, data, x)
        target[:] = data.oMi[index].act(far)
    return out
