"""A model in MuJoCo's own format, MJCF, which unlike a URDF can hold rotor inertias, as ``armature``.

The file has the kinematic tree with the identified inertias, and for every joint ``armature``, ``damping`` and
``frictionloss``, and ``stiffness`` and ``springref`` of a linear spring, but no shapes. MuJoCo loads the file as it
is; its joint and inertial lines can be copied into a scene.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from frischid.core.types import Array
from frischid.export.names import attribute, number
from frischid.export.reach import mjcf_springs
from frischid.model.drive_parameters import drive_parameters
from frischid.model.model import Model
from frischid.robot.inertia import dynamic_parameters, pseudo_inertia
from frischid.robot.kinematic_tree import Body, bodies_of


def mjcf_source(model: Model) -> str:
    """Write a model with physical links as MJCF.

    Raises
    ------
    InputError
        The model has base parameters only, or an infinite number.
    """
    robot = model.robot
    bodies = bodies_of(robot)
    links = model.links if robot.transforms is None else (robot.transforms @ model.links[:, :, None])[:, :, 0]
    lines = [
        f"<mujoco model={attribute(robot.name)}>",
        '  <compiler angle="radian" autolimits="true"/>',
        f'  <option gravity="{_numbers(robot.gravity)}"/>',
        "  <worldbody>",
        *_children(model, bodies, links, -1, "    "),
        "  </worldbody>",
        *_followers(model, bodies),
        *actuators(model),
        "</mujoco>",
    ]
    return "\n".join(lines) + "\n"


def _children(model: Model, bodies: Sequence[Body], links: Array, parent: int, indent: str) -> list[str]:
    lines = []
    for i, body in enumerate(bodies):
        if body.parent != parent:
            continue
        x, y, z, w = Rotation.from_matrix(body.rotation).as_quat()
        name = attribute(f"body of {body.joint}")
        lines += [
            f'{indent}<body name={name} pos="{_numbers(body.translation)}" quat="{_numbers([w, x, y, z])}">',
            f"{indent}  {_inertial(links[i])}",
            f"{indent}  {_joint(model, body)}",
            *_children(model, bodies, links, i, indent + "  "),
            f"{indent}</body>",
        ]
    return lines


def _inertial(theta: Array) -> str:
    P = pseudo_inertia(theta)
    centre = P[:3, 3] / P[3, 3]
    P[:3, :3] -= P[3, 3] * np.outer(centre, centre)
    xx, xy, yy, xz, yz, zz = dynamic_parameters(P)[4:]
    full = _numbers([xx, yy, zz, xy, xz, yz])
    return f'<inertial pos="{_numbers(centre)}" mass="{number(P[3, 3])}" fullinertia="{full}"/>'


def _joint(model: Model, body: Body) -> str:
    kind = "slide" if body.slides else "hinge"
    parts = [f"name={attribute(body.joint)}", f'type="{kind}"', f'axis="{_numbers(body.axis)}"']
    if body.joint in model.robot.joints:
        j, limits = model.robot.joints.index(body.joint), model.robot.limits
        if np.isfinite([limits.lower[j], limits.upper[j]]).all():
            parts.append(f'range="{_numbers([limits.lower[j], limits.upper[j]])}"')
    wanted = {"armature": ("rotor_inertia", "Ia"), "damping": ("viscous", "fv"), "frictionloss": ("coulomb", "fc")}
    for key, (effect, symbol) in wanted.items():
        x = model.of_effect(effect, symbol).get(body.joint, 0.0)
        if x > 0:  # MuJoCo refuses negative values; the export's notes name those left out
            parts.append(f'{key}="{number(x)}"')
    if body.joint in (springs := mjcf_springs(model)):
        stiffness, place = springs[body.joint]
        parts.append(f'stiffness="{number(stiffness)}" springref="{number(place)}"')
    return f"<joint {' '.join(parts)}/>"


def _followers(model: Model, bodies: Sequence[Body]) -> list[str]:
    """Mimic joints, as equality constraints."""
    joints = model.robot.joints
    rules = [
        f"    <joint joint1={attribute(b.joint)} joint2={attribute(joints[b.leader])} "
        f'polycoef="{_numbers([b.shift, b.factor, 0.0, 0.0, 0.0])}"/>'
        for b in bodies
        if b.joint not in joints
    ]
    return ["  <equality>", *rules, "  </equality>"] if rules else []


def actuators(model: Model) -> list[str]:
    """Lines of a position actuator for each joint of a model with a controller; none without."""
    if model.controller is None:
        return []
    values = position_attributes(model)
    rows = [
        f"    <position name={attribute(joint)} joint={attribute(joint)} "
        + " ".join(f'{key}="{text}"' for key, text in found.items())
        + "/>"
        for joint, found in values.items()
    ]
    return ["  <actuator>", *rows, "  </actuator>"]


def position_attributes(model: Model) -> dict[str, dict[str, str]]:
    """Joint -> attributes of its ``<position>`` actuator: gains, and the largest force where one is known."""
    found: dict[str, dict[str, str]] = {}
    for x in drive_parameters(model):
        entry = found.setdefault(x.joint, {})
        if x.quantity == "stiffness":
            entry["kp"] = number(x.value)
        elif x.quantity == "damping":
            entry["kv"] = number(x.value)
        elif x.quantity == "effort_limit":
            entry["forcerange"] = _numbers([-x.value, x.value])
    return found


def _numbers(values: Sequence[float] | Array) -> str:
    return " ".join(map(number, values))
