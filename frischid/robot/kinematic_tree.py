"""A robot's kinematic tree as plain numbers, for exports to other formats and languages.

Body i is connected to its parent body p(i) by a joint that turns or slides along a fixed axis s_i of its own frame:

    R_i = R⁰_i exp(s_i q_i),  p_i = p⁰_i       or       R_i = R⁰_i,  p_i = p⁰_i + R⁰_i s_i q_i

with q_i = factor · q_leader + shift. The leader is the joint itself, unless the joint mimics another one.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from frischid.core.types import Array
from frischid.robot.robot import Robot


@dataclass(frozen=True, eq=False)
class Body:
    """One moving body, and the joint that connects it to its parent."""

    joint: str
    parent: int
    """Index of the parent body; -1 for the base."""
    rotation: Array
    translation: Array
    """`rotation`, `translation`: Pose of the joint at zero in the parent's joint frame, (3, 3) and (3,)."""
    axis: Array
    """Shape (3,)."""
    slides: bool
    leader: int
    """Index of the independent joint that moves the body."""
    factor: float
    shift: float


def bodies_of(robot: Robot) -> list[Body]:
    """Bodies of a robot in the order of ``robot.bodies``: every parent before its children."""
    model, data = robot.model, robot.model.createData()
    q = pin.neutral(model)
    found = []
    for index, name in enumerate(robot.bodies, start=1):
        joint = model.joints[index]
        jacobian = pin.computeJointJacobian(model, data, q, index).reshape(6, -1)  # flat for a single joint
        twist = jacobian[:, joint.idx_v]
        slides = not np.any(twist[3:])
        leader, factor, shift = robot.mimics.get(name, (name, 1.0, 0.0))
        placement = model.jointPlacements[index]
        found.append(
            Body(
                name,
                int(model.parents[index]) - 1,
                placement.rotation.copy(),
                placement.translation.copy(),
                twist[:3].copy() if slides else twist[3:].copy(),
                slides,
                robot.joints.index(leader),
                factor,
                shift,
            )
        )
    return found


def links_of(robot: Robot, joint: str) -> dict[str, Array]:
    """Links of the body behind a joint, with their poses (4, 4) in the joint's frame; nearest the joint first."""
    index = robot.numbers[joint]
    frames = [f for f in robot.model.frames if f.parentJoint == index and f.type == pin.FrameType.BODY]
    return {f.name: f.placement.homogeneous for f in frames}


def tip_joint(robot: Robot) -> str:
    """Name of the last joint of the longest chain; of several chains of the same length, of the last one."""
    model, depth = robot.model, [0]
    for index in range(1, model.njoints):
        depth.append(depth[model.parents[index]] + 1)
    return str(model.names[len(depth) - 1 - int(np.argmax(depth[::-1]))])


def tip_positions(robot: Robot, q: Array) -> Array:
    """Positions of the tip, m: on the body of `tip_joint`, the origin of the URDF frame farthest from the joint.

    Parameters
    ----------
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
    >>> from frischid.robot.kinematic_tree import tip_positions
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


def skeleton(robot: Robot, q: Array) -> tuple[Array, list[int], dict[str, int], dict[int, Array]]:
    """The robot as points and lines.

    Parameters
    ----------
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
