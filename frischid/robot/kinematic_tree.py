"""A robot's kinematic tree as plain numbers, for exports to other formats and languages.

Body i is connected to its parent body p(i) by a joint that turns or slides along a fixed axis s_i of its own frame:

    R_i = R⁰_i exp(s_i q_i),  p_i = p⁰_i       or       R_i = R⁰_i,  p_i = p⁰_i + R⁰_i s_i q_i

with q_i = factor · q_leader + shift. The leader is the joint itself, unless the joint mimics another one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from frischid.core.types import Array
from frischid.robot.robot import Robot


@dataclass(frozen=True, eq=False)
class Body:
    """One moving body, and the joint that connects it to its parent.

    Attributes
    ----------
    joint : str
    parent : int
        Index of the parent body; -1 for the base.
    rotation, translation : ndarray, shape (3, 3) and (3,)
        Pose of the joint at zero in the parent's joint frame.
    axis : ndarray, shape (3,)
    slides : bool
    leader : int
        Index of the independent joint that moves the body.
    factor, shift : float
    """

    joint: str
    parent: int
    rotation: Array
    translation: Array
    axis: Array
    slides: bool
    leader: int
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
