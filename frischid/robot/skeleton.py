"""Where the joints of a robot are: forward kinematics as points and lines, for pictures without meshes."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from frischid.core.types import Array
from frischid.robot.robot import Robot


def skeleton(robot: Robot, q: Array) -> tuple[Array, list[int], dict[str, int], dict[int, Array]]:
    """The robot as points and lines.

    Parameters
    ----------
    robot : Robot
    q : ndarray, shape (J,)
        Pose, rad (m).

    Returns
    -------
    points : ndarray, shape (K, 3)
        The root and the joints of all moving bodies, m.
    parents : list of int, length K
        The point before each.
    names : dict of str to int
        Point of each joint.
    tips : dict of int to ndarray, shape (3,)
        Far end of each last link, by its joint's point: the farthest frame, or twice the centre of mass.
    """
    model, data = robot.model, robot.model.createData()
    pin.framesForwardKinematics(model, data, robot.configuration(np.atleast_2d(q))[0])
    points = np.array([m.translation for m in data.oMi])
    parents = [int(p) for p in model.parents]
    tips: dict[int, Array] = {}
    for k in (k for k in range(1, len(points)) if k not in parents):
        own = [f.translation for f, frame in zip(data.oMf, model.frames, strict=True) if frame.parentJoint == k]
        body = model.inertias[k]
        own.append(data.oMi[k].act(2.0 * body.lever) if body.mass > 0 else points[k])
        tips[k] = own[int(np.argmax(np.linalg.norm(np.array(own) - points[k], axis=1)))]
    return points, parents, {name: model.getJointId(name) for name in robot.joints}, tips
