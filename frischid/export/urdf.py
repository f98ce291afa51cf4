"""A model as a URDF: the robot's own text, in which only inertials and joint friction change.

If a body consists of several links (fixed or locked to one another), the identified pseudo-inertia of the body is
shared out by one affine map x → A x, so that each link keeps its share: Σ_i A P_i Aᵀ = P.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from frischid.core.types import Array
from frischid.model.model import Model
from frischid.robot.inertia import pseudo_inertia, redistributed
from frischid.robot.kinematic_tree import links_of
from frischid.robot.robot import Robot
from frischid.robot.urdf_edit import UrdfText


def urdf_source(model: Model) -> str:
    """The robot's URDF with the model's inertials and joint friction; no other byte of the text changes.

    If a body consists of several links (fixed or locked to one another), all of them change by the same affine map, so
    that each keeps its share: see `frischid.robot.inertia.redistributed`.
    """
    robot, text = model.robot, UrdfText(model.robot.urdf)
    links = model.links if robot.transforms is None else (robot.transforms @ model.links[:, :, None])[:, :, 0]
    inertias: dict[str, Array] = {}
    for joint, theta in zip(robot.bodies, links, strict=True):
        inertias |= _parts(robot, text, joint, theta)
    damping, loss = model.of_effect("viscous", "fv"), model.of_effect("coulomb", "fc")
    dynamics = {
        joint: {
            key: max(0.0, values[joint])
            for key, values in (("damping", damping), ("friction", loss))
            if joint in values
        }
        for joint in robot.joints
    }
    return text.edited(inertias, {joint: values for joint, values in dynamics.items() if values})


def _parts(robot: Robot, text: UrdfText, joint: str, theta: Array) -> dict[str, Array]:
    """Pseudo-inertias of a body's links, each in its own frame."""
    poses = links_of(robot, joint)
    main = text.child_link(joint)
    names = [n for n in poses if n == main or text.pseudo_inertia(n).any()]
    H = np.array([poses[n] for n in names])
    old = H @ np.array([text.pseudo_inertia(n) for n in names]) @ H.transpose(0, 2, 1)
    masses = old[:, 3, 3]
    heaviest = int(masses.argmax()) if masses.any() else names.index(main)
    back = np.linalg.inv(H)
    new = back @ redistributed(old, pseudo_inertia(theta), heaviest) @ back.transpose(0, 2, 1)
    return {n: P for n, P, before in zip(names, new, old, strict=True) if P.any() or before.any()}


def difference_of(model: Model, text: str) -> float:
    """Relative difference of an exported URDF's torque from the model's rigid part, on random states."""
    robot = model.robot
    exported = Robot.from_dict({**robot.to_dict(), "urdf": text, "known": {}})
    rng = np.random.default_rng(0)
    J = len(robot.joints)
    lower, upper = robot.limits.within(np.pi)
    q = rng.uniform(lower, upper, (50, J))
    v, a = rng.normal(size=(2, 50, J))
    bare = replace(model, effects=(), reference=None)
    expected = bare.inverse_dynamics(q, v, 3 * a)
    return float(np.abs(exported.inverse_dynamics(q, v, 3 * a) - expected).max() / np.abs(expected).max())


def of_several_links(robot: Robot) -> list[str]:
    """Bodies whose inertia is spread over several links of the URDF."""
    text = UrdfText(robot.urdf)
    return [j for j in robot.bodies if sum(text.pseudo_inertia(n).any() for n in links_of(robot, j)) > 1]
