"""Identified numbers in the user's own MJCF: only numbers change; names, actuators, shapes and comments stay.

The text is edited in place: the ``<inertial>`` of the body of every joint, and ``armature``, ``damping``,
``frictionloss`` and a linear spring's ``stiffness`` and ``springref`` of the joint; of a model with a controller,
``kp`` and ``kv`` of the joint's ``<position>`` actuator too (a joint without one gets one). The inertia of bodies that
are welded to a body, or hang from it by a joint that the model locks, stays theirs; the body gets the rest.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin

from frischid.core.text import listed
from frischid.core.types import Array
from frischid.errors import InputError
from frischid.export.mjcf import actuators, gear_line, position_attributes, tendons
from frischid.export.mjcf_gears import GearTrain
from frischid.export.mjcf_share import JOINT_ATTRIBUTES, Share, share_of
from frischid.export.names import number
from frischid.model.model import Model
from frischid.robot.inertia import dynamic_parameters, is_physical, pseudo_inertia
from frischid.robot.mjcf_reading import ignores_inertials, in_degrees, is_mjcf, model_of_mjcf, springdamper_of_mjcf
from frischid.robot.robot import Robot
from frischid.robot.xml_places import Element, elements


def edited_mjcf(model: Model, path: Path) -> str:
    """Text of an MJCF file with the numbers of a model with physical links.

    Parameters
    ----------
    model : Model
        Its robot was read from this file.
    path : Path
        The MJCF file.

    Raises
    ------
    InputError
        The file is no MJCF file in UTF-8, or has settings that make MuJoCo ignore the numbers; a joint of the model has
        no named body in it, or the welded bodies weigh more than the link.
    """
    robot = model.robot
    try:
        data = path.read_bytes()
        text = data.decode("utf-8")
    except OSError as error:
        raise InputError(f"{path}: the MJCF file cannot be read ({error.strerror})") from None
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: byte {error.start} is not UTF-8; save the MJCF file as UTF-8 first") from None
    if not is_mjcf(text):
        raise InputError(
            f"{path}: no MJCF file, because it has no <mujoco>; --into (into=) takes the MJCF file of the robot. "
            "Without it, the whole robot is written"
        )
    if ignores_inertials(path):
        raise InputError(f'{path}: inertiafromgeom="true" makes MuJoCo ignore inertials; set it to "auto" first')
    root = elements(data, str(path))
    _refuse_springdamper(path)
    bodies = (pair for pair in root.below() if (pair[0].name, pair[1].name) == ("body", "joint"))
    places = {tag.attributes.get("name", ""): (body, tag) for body, tag in bodies}
    own = model_of_mjcf(path)
    share, locked, degrees = share_of(model), _locked_bodies(robot, own, path), in_degrees(path)
    changes: list[tuple[int, int, str]] = []
    for i, joint in enumerate(robot.bodies):
        if joint not in places:
            raise InputError(
                f"{path}: no body with a joint '{joint}' stands in this file itself (included files do not count)"
            )
        body, tag = places[joint]
        name = body.attributes.get("name", "")
        new = _body_inertia(own, joint, name, share.links[i], locked.get(joint, ()))
        if not is_physical(new):
            kind = "locked or welded" if joint in locked else "welded"
            raise InputError(f"{path}: the bodies {kind} to '{name}' weigh more than its identified link")
        changes.append(_inertial(body, new))
        if joint in robot.joints:
            scale = 180 / np.pi if degrees and not robot.prismatic[robot.joints.index(joint)] else 1.0
            changes.append(_joint(data, tag, _values(joint, share, scale)))
            changes += _gears(data, tag, share.gears.get(joint), scale)
    if model.controller is not None:
        changes += _positions(model, data, root)
    if share.gears and re.search(rb"<key\b[^>]*\bqpos\s*=", data):
        raise InputError(
            f"{path}: its <keyframe> holds one position for each joint, and the gears of the model add joints "
            f"({', '.join(gear.name for train in share.gears.values() for gear in train.gears)}); "
            "move the <keyframe> out of the file, or take the qpos out of it"
        )
    if lines := tendons(share):
        last = _last_tag(data, root)
        changes.append((last, last, "\n".join([*lines, ""])))
    for start, end, text in sorted(changes, reverse=True):
        data = data[:start] + text.encode() + data[end:]
    return data.decode("utf-8")


def _refuse_springdamper(path: Path) -> None:
    """Refuse (InputError) joints, or a class of joints, whose stiffness and damping MuJoCo makes from two numbers."""
    found = springdamper_of_mjcf(path)
    if found is not None:
        of = f" of joint '{found[0]}'" if found[0] else ""
        raise InputError(
            f"{found[1]}: springdamper{of} makes MuJoCo ignore the joint's stiffness and damping; write stiffness "
            "instead, with the value that MuJoCo computes (jnt_stiffness of its model)"
        )


def _positions(model: Model, data: bytes, root: Element) -> list[tuple[int, int, str]]:
    """Changes that give each joint's ``<position>`` actuator the model's gains; new ones for joints without."""
    tags = {e.attributes["joint"]: e for _, e in root.below() if e.name == "position" and "joint" in e.attributes}
    values = position_attributes(model)
    changes = [_attributes(data, tag, values[joint]) for joint, tag in tags.items() if joint in values]
    new = [line for joint, line in zip(values, actuators(model)[1:-1], strict=True) if joint not in tags]
    if new:
        text = "\n".join(["  <actuator>", *new, "  </actuator>", ""])
        last = _last_tag(data, root)
        changes.append((last, last, text))
    return changes


def _values(joint: str, share: Share, scale: float) -> dict[str, float]:
    """Attributes of a joint; the place of its spring in the file's unit, `scale` of which are one rad (m).

    Armature and friction that the model does not have are zero, or the file would still have its own.
    """
    values = dict.fromkeys(JOINT_ATTRIBUTES, 0.0) | share.joints[joint]
    if "springref" in values:
        values["springref"] *= scale
    return values


def _gears(data: bytes, tag: Element, train: GearTrain | None, scale: float) -> list[tuple[int, int, str]]:
    """The joints of gears, as new lines below the joint of their motor, with its place, axis and class."""
    if train is None:
        return []
    start, end = tag.tag
    text = data[start:end].decode()
    given = dict(re.findall(r"\b(type|pos|axis|class)\s*=\s*[\"']([^\"']*)[\"']", text))
    # Of a class of the file, whatever is not a place is set back.
    none = dict.fromkeys(("armature", "damping", "frictionloss", "stiffness"), "0") if "class" in given else {}
    indent = re.search(rb"[ \t]*$", data[:start])
    lead = "\n" + (indent.group().decode() if indent else "")
    at = tag.end
    wanted = [replace(gear, gap=scale * gear.gap) for gear in train.gears]
    return [(at, at, "".join(lead + gear_line(gear, given | none) for gear in wanted))]


def _last_tag(data: bytes, root: Element) -> int:
    """Place of the end tag of the whole file."""
    return data.rindex(b"</", 0, root.end)


def _locked_bodies(robot: Robot, own: pin.Model, path: Path) -> dict[str, list[Array]]:
    """Pseudo-inertias (4, 4) of the bodies behind locked joints, by the moving joint before them and in its frame.

    A model's link holds them. In the file their joints move, so they keep their own numbers.
    """
    if unknown := [name for name in robot.locked if not own.existJointName(name)]:
        raise InputError(f"{path}: no joint {listed(unknown, 'or')}, which the model locks")
    free = replace(robot, locked={}, frames="joint", known={})
    model, data = free.model, free.model.createData()
    at = np.array([[robot.locked.get(name, 0.0) for name in free.joints]])
    pin.forwardKinematics(model, data, free.configuration(at)[0])
    found: dict[str, list[Array]] = {}
    for name in robot.locked:
        index = before = model.getJointId(name)
        while model.names[before] in robot.locked:
            before = model.parents[before]
        H = np.asarray(data.oMi[before].actInv(data.oMi[index]).homogeneous)
        P = H @ pseudo_inertia(own.inertias[own.getJointId(name)].toDynamicParameters()) @ H.T
        found.setdefault(model.names[before], []).append(P)
    return found


def _body_inertia(own: pin.Model, joint: str, body: str, total: Array, behind: Sequence[Array]) -> Array:
    """Ten parameters of the body alone, in its own frame, from those of the whole link in the joint's frame.

    `behind` are the pseudo-inertias of the bodies behind locked joints.
    """
    index = own.getJointId(joint)
    P = pseudo_inertia(total) - sum(behind, start=np.zeros((4, 4)))
    place = np.eye(4)
    for frame in own.frames:
        if frame.parentJoint != index:
            continue
        if frame.type == pin.FrameType.BODY and frame.name == body:
            place = np.asarray(frame.placement.homogeneous)
        elif frame.inertia.mass > 0 and frame.type == pin.FrameType.FIXED_JOINT:
            H = np.asarray(frame.placement.homogeneous)
            P = P - H @ pseudo_inertia(frame.inertia.toDynamicParameters()) @ H.T
    back = np.linalg.inv(place)
    return np.asarray(dynamic_parameters(back @ P @ back.T))


def _inertial(body: Element, theta: Array) -> tuple[int, int, str]:
    P = pseudo_inertia(theta)
    centre = P[:3, 3] / P[3, 3]
    P[:3, :3] -= P[3, 3] * np.outer(centre, centre)
    xx, xy, yy, xz, yz, zz = dynamic_parameters(P)[4:]
    full = " ".join(map(number, (xx, yy, zz, xy, xz, yz)))
    at = " ".join(map(number, centre))
    text = f'<inertial pos="{at}" mass="{number(P[3, 3])}" fullinertia="{full}"/>'
    old = body.child("inertial")
    if old is None:
        return body.tag[1], body.tag[1], text
    return *old.tag, text if old.empty else text.removesuffix("/>") + ">"


def _joint(data: bytes, tag: Element, values: Mapping[str, float]) -> tuple[int, int, str]:
    return _attributes(data, tag, {key: number(x) for key, x in values.items()})


def _attributes(data: bytes, tag: Element, values: Mapping[str, str]) -> tuple[int, int, str]:
    """The tag with other values of some attributes."""
    text = data[slice(*tag.tag)].decode()
    for key, x in values.items():
        written, count = re.subn(rf"(\b{key}\s*=\s*)([\"'])[^\"']*\2", rf"\g<1>\g<2>{x}\g<2>", text)
        text = written if count else re.sub(r"(\s*/?>)$", f' {key}="{x}"\\1', text)
    return *tag.tag, text
