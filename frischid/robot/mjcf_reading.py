"""A robot from MuJoCo's format, MJCF: converted to a URDF that has the same dynamics.

Pinocchio reads the MJCF with its defaults and included files. Every moving body becomes a link, with the inertia that
Pinocchio gives it (of all bodies that are welded together, about the joint's frame), and every hinge or slide a joint
with its limits, damping and dry friction. Bodies become frames of the same names. Shapes are left out. MuJoCo's
``armature`` has no place in a URDF. It stands as an attribute of ``<dynamics>``, which other programs ignore, and is
the nominal value of the effect ``rotor_inertia``. Pinocchio does not read the gravity of ``<option>``. So it is read
here, and stands as an attribute of ``<robot>``. So do the kinds of forces that a URDF cannot state: springs, gravity
compensation, equality constraints. They are not in the nominal torque, and every identification says so.

Format: MuJoCo XML reference, https://mujoco.readthedocs.io/en/stable/XMLreference.html.
"""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np
import pinocchio as pin

from frischid.core.types import Array
from frischid.errors import InputError

_HEAD = re.compile(r"<mujoco[\s>]")
_UNREAD = "unread"
"""Attribute of ``<robot>`` with the kinds of forces that are not in the nominal torque."""
_FORCES = (
    ("body", "gravcomp", "gravity compensation"),
    ("joint", "stiffness", "springs of joints"),
    ("tendon", "stiffness", "springs of tendons"),
)
"""Element, attribute that is not zero, and the force."""


def is_mjcf(text: str) -> bool:
    """Whether a text looks like MJCF.

    >>> is_mjcf('<mujoco model="arm"/>'), is_mjcf('<robot name="arm"/>')
    (True, False)
    """
    found = _HEAD.search(text)
    return found is not None and "<robot" not in text[: found.start()]


def model_of_mjcf(path: Path) -> Any:
    """Pinocchio's model of an MJCF file.

    Raises
    ------
    InputError
        Pinocchio cannot read the file.
    """
    try:
        return pin.buildModelFromMJCF(str(path))
    except (ValueError, RuntimeError, IndexError) as error:
        raise InputError(f"{path}: Pinocchio cannot build a model from this MJCF: {error}") from error


def gravity_of_mjcf(path: Path) -> tuple[float, float, float] | None:
    """Gravity that an MJCF file states, or a file that it includes, m/s²; None where none does.

    Raises
    ------
    InputError
        The gravity is not three numbers, or the file is no XML.
    """
    found = _stated(path, "option", "gravity")
    return None if found is None else stated_gravity(*found)


def in_degrees(path: Path) -> bool:
    """Whether the angles of an MJCF file are in degrees: unless a compiler, also of an included file, says radian.

    Raises
    ------
    InputError
        The file is no XML.
    """
    unit = _stated(path, "compiler", "angle")
    return unit is None or unit[0] == "degree"


def ignores_inertials(path: Path) -> bool:
    """Whether a compiler of an MJCF file, also of an included one, takes every inertia from shapes."""
    stated = _stated(path, "compiler", "inertiafromgeom")
    return stated is not None and stated[0] == "true"


def is_springdamper(tag: ET.Element) -> bool:
    """Whether MuJoCo makes the stiffness and damping of this joint, or class of joints, from two positive numbers."""
    words = tag.get("springdamper", "").split() if tag.tag == "joint" else []
    try:
        return len(words) == 2 and all(float(word) > 0 for word in words)
    except ValueError:
        return False


def springdamper_of_mjcf(path: Path) -> tuple[str, str] | None:
    """A joint, or ``""`` for a class of joints, with a springdamper in an MJCF file or in one that it includes.

    Returns
    -------
    tuple of str or None
        The joint's name and the file.
    """
    return next(((tag.get("name", ""), str(file)) for tag, file in _elements(path) if is_springdamper(tag)), None)


def _stated(path: Path, element: str, attribute: str) -> tuple[str, str] | None:
    """The last attribute of this name in an MJCF file and in those that it includes, and the file that has it."""
    found = None
    for tag, file in _elements(path):
        if tag.tag == element and attribute in tag.attrib:
            found = tag.attrib[attribute], str(file)
    return found


def _elements(path: Path, above: Sequence[Path] = ()) -> Iterator[tuple[ET.Element, Path]]:
    """Elements of an MJCF file and of those that it includes, in order, each with its file.

    `above` are the files that include this one, the main file first: names of included files are relative to its
    folder.
    """
    chain = (*above, path)
    try:
        root = ET.parse(path).getroot()
    except (ET.ParseError, OSError) as error:
        raise InputError(f"{path}: cannot be read as MJCF: {error}") from None
    for tag in root.iter():
        if tag.tag != "include":
            yield tag, path
            continue
        named = (file.parent / tag.get("file", "") for file in (chain[0], path))
        inside = next((file for file in named if file.is_file()), path)
        if inside not in chain:
            yield from _elements(inside, chain)


def _refuse_lost_joints(path: Path, names: Sequence[str]) -> None:
    """Refuse a file of which Pinocchio reads a part: of several bodies in the world, it reads the first alone.

    Raises
    ------
    InputError
        A hinge or slide of the file is not among these names.
    """
    joints = (joint for tag, _ in _elements(path) if tag.tag == "body" for joint in tag.findall("joint"))
    moving = (joint.get("name", "") for joint in joints if joint.get("type", "hinge") in ("hinge", "slide"))
    if lost := [name for name in moving if name and name not in names]:
        raise InputError(
            f"{path}: Pinocchio does not read the joints {', '.join(lost)}: of several bodies in <worldbody> it takes "
            "the first; put all bodies into one body of the world, or give a file of each robot alone"
        )


def _refuse_unread_masses(path: Path) -> None:
    """Refuse compiler settings that change masses in MuJoCo and that Pinocchio does not read.

    Raises
    ------
    InputError
        The file states ``settotalmass``, or ``inertiagrouprange`` for bodies whose masses follow from their shapes.
    """
    inertials = [tag.find("inertial") is not None for tag, _ in _elements(path) if tag.tag == "body"]
    of_shapes = not all(inertials) or ignores_inertials(path)
    total = _stated(path, "compiler", "settotalmass")
    for setting, matters in (
        ("settotalmass", total is not None and not total[0].strip().startswith("-")),
        ("inertiagrouprange", of_shapes and _stated(path, "compiler", "inertiagrouprange") is not None),
    ):
        if matters:
            raise InputError(
                f"{path}: Pinocchio does not read {setting} of <compiler>, so its masses differ from MuJoCo's; "
                'state the <inertial> of every body and remove the setting (with saveinertial="true" in <compiler>, '
                "mujoco.mj_saveLastXML writes them)"
            )


def _unread_forces(path: Path) -> list[str]:
    """Kinds of forces in an MJCF file that a URDF cannot state; those of its ``<default>`` count too."""
    found: dict[str, None] = {}
    for tag, _ in _elements(path):
        kind = "tendon" if tag.tag in ("fixed", "spatial") else tag.tag
        for element, attribute, force in _FORCES:
            if kind == element and any(word.strip("-0.") for word in tag.attrib.get(attribute, "").split()):
                found[force] = None
        if is_springdamper(tag):
            found["springs of joints"] = None
        if tag.tag == "equality" and len(tag):
            found["equality constraints"] = None
    return list(found)


def unread_forces(urdf: str) -> tuple[str, ...]:
    """Forces of the MJCF file behind a URDF that are not in the nominal torque; none where there was no such file.

    Examples
    --------
    >>> from frischid.robot.mjcf_reading import unread_forces
    >>> unread_forces('<robot name="arm" unread="springs of joints; equality constraints"/>')
    ('springs of joints', 'equality constraints')
    >>> unread_forces('<robot name="arm"/>')
    ()
    """
    text = ET.fromstring(urdf).get(_UNREAD, "")
    return tuple(text.split("; ")) if text else ()


def stated_gravity(text: str, source: str) -> tuple[float, float, float]:
    """Three numbers of an attribute ``gravity``, m/s²; `source` names the file in the message.

    Raises
    ------
    InputError
        The text is not three finite numbers.

    Examples
    --------
    >>> stated_gravity("0 0 -1.62", "moon.xml")
    (0.0, 0.0, -1.62)
    """
    try:
        x, y, z = (float(word) for word in text.split())
    except ValueError:
        x = y = z = math.nan
    if not math.isfinite(x + y + z):
        raise InputError(f"{source}: gravity must be three finite numbers in m/s², got {text!r}")
    return x, y, z


def urdf_of_mjcf(path: Path) -> str:
    """Convert an MJCF file to the text of a URDF.

    Raises
    ------
    InputError
        Pinocchio cannot read the file or reads a part of it, its masses would be others than MuJoCo's, or a joint is
        neither hinge nor slide.
    """
    model = model_of_mjcf(path)
    names = list(model.names)
    for index in range(1, model.njoints):
        joint = model.joints[index]
        if joint.nv != 1:
            raise InputError(
                f"{path}: joint '{names[index]}' has {joint.nv} degrees of freedom ({joint.shortname()}); frischid "
                "identifies hinges and slides: remove the base's freejoint, and give each body at most one joint"
            )
    _refuse_lost_joints(path, names)
    _refuse_unread_masses(path)
    # a body's name may stand for a joint too; links get names of their own where it does
    used = set(names[1:])
    links = ["world"] + [_free(f"link of {name}", used) for name in names[1:]]
    gravity, degrees = gravity_of_mjcf(path), in_degrees(path)
    stated = "" if gravity is None else f' gravity="{_row(gravity)}"'
    stated += f' {_UNREAD}="{"; ".join(forces)}"' if (forces := _unread_forces(path)) else ""
    lines = [f"<robot name={quoteattr(model.name or path.stem)}{stated}>", f"  <link name={quoteattr(links[0])}/>"]
    for index in range(1, model.njoints):
        lines += _link(links[index], model.inertias[index])
        lines += _joint(model, index, links, degrees)
    for frame in model.frames:
        if frame.type == pin.FrameType.BODY and frame.name not in used and frame.name not in links:
            used.add(frame.name)
            lines += [
                f"  <link name={quoteattr(frame.name)}/>",
                f'  <joint name={quoteattr(_free(f"{frame.name} frame", used))} type="fixed">',
                f"    <parent link={quoteattr(links[frame.parentJoint])}/><child link={quoteattr(frame.name)}/>",
                f"    {_origin(frame.placement)}",
                "  </joint>",
            ]
    return "\n".join([*lines, "</robot>"]) + "\n"


def _free(name: str, used: set[str]) -> str:
    while name in used:
        name += "_"
    used.add(name)
    return name


def _link(name: str, inertia: Any) -> list[str]:
    c, at = np.asarray(inertia.lever), np.asarray(inertia.inertia)
    six = {"ixx": at[0, 0], "ixy": at[0, 1], "ixz": at[0, 2], "iyy": at[1, 1], "iyz": at[1, 2], "izz": at[2, 2]}
    return [
        f"  <link name={quoteattr(name)}>",
        "    <inertial>",
        f'      <origin xyz="{_row(c)}" rpy="0 0 0"/>',
        f'      <mass value="{float(inertia.mass)!r}"/>',
        "      <inertia " + " ".join(f'{k}="{float(x)!r}"' for k, x in six.items()) + "/>",
        "    </inertial>",
        "  </link>",
    ]


def _joint(model: Any, index: int, links: list[str], degrees: bool) -> list[str]:
    joint, name = model.joints[index], model.names[index]
    kind, axis = _kind(joint)
    v, q = joint.idx_v, joint.idx_q
    bounds = (model.lowerPositionLimit, model.upperPositionLimit)
    # Pinocchio counts limits from the joint's `ref`, and turns those of slides, which are in m, from degrees into rad.
    shift = float(model.referenceConfigurations["qpos0"][q]) if joint.nq == 1 else 0.0
    unit = math.degrees(1.0) if kind == "P" and degrees else 1.0
    lower, upper = (unit * (float(x[q]) + shift) if joint.nq == 1 else math.inf for x in bounds)
    limited = joint.nq == 1 and math.isfinite(lower) and math.isfinite(upper) and upper > lower
    word = "prismatic" if kind == "P" else "revolute" if limited else "continuous"
    effort = float(model.upperEffortLimit[v]) if hasattr(model, "upperEffortLimit") else float(model.effortLimit[v])
    room = {"lower": lower, "upper": upper} if limited else {}
    room |= {"effort": effort if 0 < effort < 1e6 else 1e6, "velocity": 1e6}
    friction = getattr(model, "upperDryFrictionLimit", np.zeros(model.nv))
    damping = getattr(model, "damping", np.zeros(model.nv))
    dynamics = {"damping": float(damping[v]), "friction": float(friction[v]), "armature": float(model.armature[v])}
    return [
        f'  <joint name={quoteattr(name)} type="{word}">',
        f"    <parent link={quoteattr(links[model.parents[index]])}/><child link={quoteattr(links[index])}/>",
        f"    {_origin(model.jointPlacements[index])}",
        f'    <axis xyz="{_row(axis)}"/>',
        "    <limit " + " ".join(f'{k}="{x!r}"' for k, x in room.items()) + "/>",
        "    <dynamics " + " ".join(f'{k}="{x!r}"' for k, x in dynamics.items()) + "/>",
        "  </joint>",
    ]


def _kind(joint: Any) -> tuple[str, Array]:
    """R (turns) or P (slides), and the axis."""
    short = joint.shortname().removeprefix("JointModel")
    letter = "P" if short.startswith("P") else "R"
    data = joint.createData()
    joint.calc(data, np.array([1.0, 0.0] if joint.nq == 2 else [0.0]))
    twist = np.asarray(data.S).reshape(6)
    axis = twist[:3] if letter == "P" else twist[3:]
    return letter, axis / np.linalg.norm(axis)


def _origin(placement: Any) -> str:
    rpy = pin.rpy.matrixToRpy(placement.rotation)
    return f'<origin xyz="{_row(placement.translation)}" rpy="{_row(rpy)}"/>'


def _row(values: Any) -> str:
    return " ".join(repr(float(x)) for x in values)
