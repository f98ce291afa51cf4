"""A model in MuJoCo's own format, MJCF, which unlike a URDF can hold rotor inertias, as ``armature``.

The file has the kinematic tree with the identified inertias, and for every joint ``armature``, ``damping`` and
``frictionloss``, and ``stiffness`` and ``springref`` of a linear spring, tendons for coupled joints, a second joint for
an elastic gear or one with play, but no shapes.
MuJoCo loads the file as it is; its joint and inertial lines can be copied into a scene. `frischid.export.mjcf_share`
says what of a model is in the file; `frischid.export.mjcf_effects` writes the rest.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from frischid.core.types import Array
from frischid.export.mjcf_gears import GearJoint
from frischid.export.mjcf_share import Share, share_of
from frischid.export.names import attribute, number
from frischid.model.drive_parameters import drive_parameters
from frischid.model.model import Model
from frischid.robot.inertia import dynamic_parameters, pseudo_inertia
from frischid.robot.kinematic_tree import Body, bodies_of

DRY = {"solreffriction": "1e-4 1", "solimpfriction": "0.9999 0.9999 0.001"}
"""Solver values of dry friction. The time constant (s) is the shortest that MuJoCo allows at a time step: with the
default of 20 ms, dry friction turns its sign up to 10 ms before the joint does (a Stribeck curve: an error of 5.8 mrad,
0.8 with this). The impedance holds a joint at rest: with the default of 0.9, a loaded joint creeps by 10 mrad/s."""


def mjcf_source(model: Model) -> str:
    """Write a model with physical links as MJCF.

    Raises
    ------
    InputError
        The model has base parameters only, or an infinite number.
    """
    robot = model.robot
    bodies = bodies_of(robot)
    share = share_of(model)
    lines = [
        f"<mujoco model={attribute(robot.name)}>",
        '  <compiler angle="radian" autolimits="true"/>',
        f'  <option gravity="{_numbers(robot.gravity)}"/>',
        "  <worldbody>",
        *_children(model, bodies, share, -1, "    "),
        "  </worldbody>",
        *_followers(model, bodies),
        *tendons(share),
        *actuators(model),
        "</mujoco>",
    ]
    return "\n".join(lines) + "\n"


def _children(model: Model, bodies: Sequence[Body], share: Share, parent: int, indent: str) -> list[str]:
    lines = []
    for i, body in enumerate(bodies):
        if body.parent != parent:
            continue
        x, y, z, w = Rotation.from_matrix(body.rotation).as_quat()
        name = attribute(f"body of {body.joint}")
        lines += [
            f'{indent}<body name={name} pos="{_numbers(body.translation)}" quat="{_numbers([w, x, y, z])}">',
            f"{indent}  {_inertial(share.links[i])}",
            f"{indent}  {_joint(model, body, share)}",
            *(f"{indent}  {line}" for line in _gears(body, share)),
            *_children(model, bodies, share, i, indent + "  "),
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


def _joint(model: Model, body: Body, share: Share) -> str:
    kind = "slide" if body.slides else "hinge"
    parts = [f"name={attribute(body.joint)}", f'type="{kind}"', f'axis="{_numbers(body.axis)}"']
    if body.joint in model.robot.joints:
        j, limits = model.robot.joints.index(body.joint), model.robot.limits
        if np.isfinite([limits.lower[j], limits.upper[j]]).all():
            parts.append(f'range="{_numbers([limits.lower[j], limits.upper[j]])}"')
    for key, x in share.joints.get(body.joint, {}).items():
        if x or key == "springref":
            parts.append(f'{key}="{number(x)}"')
    parts += [f'{key}="{x}"' for key, x in DRY.items() if share.joints.get(body.joint, {}).get("frictionloss")]
    return f"<joint {' '.join(parts)}/>"


def _gears(body: Body, share: Share) -> list[str]:
    """The joints between the body's motor and the body."""
    train, kind = share.gears.get(body.joint), "slide" if body.slides else "hinge"
    place = {"type": kind, "axis": _numbers(body.axis)}
    return [] if train is None else [gear_line(gear, place) for gear in train.gears]


def gear_line(gear: GearJoint, place: Mapping[str, str]) -> str:
    """The line of the joint of a gear, where `place` has the attributes that it shares with the joint of its motor."""
    values = " ".join(f'{key}="{text}"' for key, text in (dict(place) | gear.attributes()).items())
    return f"<joint name={attribute(gear.name)} {values}/>"


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


def tendons(share: Share) -> list[str]:
    """Lines of a fixed tendon for every motor that turns with two joints, and for friction behind a gear."""
    rows = []
    for joint, loss in share.behind.items():
        written = {"frictionloss": number(loss)} | DRY
        values = " ".join(f'{key}="{x}"' for key, x in written.items())
        turns = [joint, *(gear.name for gear in share.gears[joint].gears)]
        rows += [
            f"    <fixed name={attribute(f'link of {joint}')} {values}>",
            *(f'      <joint joint={attribute(name)} coef="1.0"/>' for name in turns),
            "    </fixed>",
        ]
    for tendon in share.tendons:
        written = {key: number(x) for key, x in tendon.values.items()} | DRY
        motion = f"{tendon.first} {'minus' if tendon.ratio < 0 else 'and'} {tendon.second}"
        values = " ".join(f'{key}="{x}"' for key, x in written.items())
        rows += [
            f"    <fixed name={attribute(f'motor of {motion}')} {values}>",
            f'      <joint joint={attribute(tendon.first)} coef="1.0"/>',
            f'      <joint joint={attribute(tendon.second)} coef="{number(tendon.ratio)}"/>',
            "    </fixed>",
        ]
    return ["  <tendon>", *rows, "  </tendon>"] if rows else []


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
