"""A URDF file, found by path or by name, and read as text after a check that it is a URDF.

The text stays the same, byte for byte, so that an export changes only the numbers that it must change. The checks here
are those of the XML; `frischid.robot.pinocchio_model` checks the kinematic tree.

Format: URDF, https://wiki.ros.org/urdf/XML.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from importlib import metadata
from os import PathLike
from pathlib import Path

from frischid.core.text import shortened
from frischid.errors import InputError, UnknownNameError
from frischid.robot.mjcf_reading import is_mjcf, urdf_of_mjcf
from frischid.robot.urdf_numbers import check_numbers
from frischid.robot.urdf_refusals import link_with_two_parents

MOVING = ("revolute", "continuous", "prismatic")
"""Types of joints that move."""
FEWEST_ALIKE = 3
"""Joints or links that must share a number before it is a placeholder."""


def robot_names() -> dict[str, Path]:
    """URDFs that can be loaded by name: those of this package, then those of example-robot-data.

    Examples
    --------
    >>> from frischid.robot.urdf_reading import robot_names
    >>> robot_names()["planar2"].name
    'planar2.urdf'
    """
    own = [p for p in (Path(__file__).parents[1] / "urdf", Path(__file__).parents[2] / "urdf") if p.is_dir()]
    files = [p for folder in own[:1] for p in sorted(folder.glob("*.urdf"))]
    try:
        share = metadata.distribution("example-robot-data").locate_file("cmeel.prefix/share/example-robot-data/robots")
        # The data hold a file without a robot, which takes the name of the UR3.
        files += [path for path in sorted(Path(str(share)).rglob("*.urdf")) if b"<link" in path.read_bytes()]
    except metadata.PackageNotFoundError:
        pass  # the robots shipped with frischid still load by name, and every path does
    stems = [p.stem for p in files]
    names: dict[str, Path] = {}
    for path in files:
        folder = next((part for part in path.parts if part.endswith(("_description", "_data"))), "")
        short = path.stem if stems.count(path.stem) == 1 else f"{folder.rsplit('_', 1)[0]}/{path.stem}"
        names.setdefault(short, path)
    for short in list(names):
        names.setdefault(short.removesuffix("_robot"), names[short])
    return names


def read_urdf(robot: str | Path) -> tuple[str, str]:
    """Read a URDF or MJCF file by path, or a URDF by a name that `robot_names` lists.

    Returns
    -------
    source, text : str
        The given path or name, and the file's text; of an MJCF file, a URDF with the same dynamics.

    Raises
    ------
    InputError
        The path is a folder, does not exist, or is not a text file.
    UnknownNameError
        There is no robot of that name.
    """
    if not isinstance(robot, str | PathLike):
        raise InputError(f"robot must be the path of a URDF or MJCF file, or a name, got {shortened(robot)}")
    text = str(robot)
    path = Path(robot).expanduser()
    names = {} if path.is_file() or text.endswith((".urdf", ".xml", ".xacro")) else robot_names()
    if text in names:
        path = names[text]  # a folder of that name, as in a ROS workspace, is no robot
    elif path.is_dir():
        raise InputError(f"{path} is a folder; give the .urdf file inside it")
    elif names:
        raise UnknownNameError("robot", text, names, "the list of `frischid info`, and there is no such file")
    elif not path.exists():
        raise InputError(f"{path}: no such URDF file; give a path, or a name that `frischid info` lists")
    try:
        # decoded from bytes, so that line ends stay the same in an export
        content = path.read_bytes().decode("utf-8")
        return text, urdf_of_mjcf(path) if is_mjcf(content) else content
    except UnicodeDecodeError as error:
        raise InputError(
            f"{path}: not a UTF-8 text file, so not a URDF ({error.reason} at byte {error.start})"
        ) from None


def parse_urdf(text: str, source: str) -> ET.Element:
    """Parse the text of a URDF; `source` names the file in messages.

    Raises
    ------
    InputError
        The text is not XML, has another root than ``<robot>``, is a xacro file, or has an unreadable number or a link
        with two parents.
    """
    try:
        root = ET.fromstring(text)
    except ET.ParseError as error:
        if text.lstrip()[:1] == "{":
            raise InputError(
                f"{source}: a JSON file, such as a model, and no robot: give the robot's URDF or MJCF file here; "
                "`frischid compare`, `diagnose`, `add` and `improve` take a model"
            ) from None
        raise InputError(
            f"{source}: not an XML file, so not a URDF: {error}; give the robot's URDF or MJCF file here "
            "(--help of the command has the order of robot and logs)"
        ) from None
    if root.tag != "robot":
        raise InputError(f"{source}: the root element is <{root.tag}>, a URDF has <robot>")
    if any("xacro" in element.tag for element in root.iter()):
        raise InputError(f"{source}: this is a xacro file; expand it first (xacro FILE > robot.urdf)")
    check_numbers(text, source)
    if fault := link_with_two_parents(root):
        raise InputError(f"{source}: {fault}")
    return root


def joint_dynamics(urdf: str) -> dict[str, tuple[float, float]]:
    """``<dynamics damping friction>`` of every joint that has one: joint -> (N·m·s/rad, N·m) or (N·s/m, N).

    Simulators need some damping to be stable, and their URDFs give one value to all joints (Gazebo's
    ``damping="10"``). No real robot has such a damping: it counts as zero. That of an MJCF file stays, because there it
    is the robot that is simulated.
    """
    found, moving, of_mjcf = {}, 0, False
    for joint in ET.fromstring(urdf).findall("joint"):
        tag = joint.find("dynamics")
        moves = joint.get("type") in MOVING
        moving += moves
        if tag is not None:
            found[str(joint.get("name"))] = (float(tag.get("damping", 0)), float(tag.get("friction", 0)), moves)
            of_mjcf |= "armature" in tag.attrib
    dampings = [damping for damping, _, moves in found.values() if moves]
    placeholder = len(dampings) == moving and not of_mjcf and is_placeholder(dampings)
    return {name: (0.0 if placeholder else damping, friction) for name, (damping, friction, _) in found.items()}


def is_placeholder(dampings: Sequence[float]) -> bool:
    """Whether the dampings of all moving joints are a simulator's: one value, other than zero, for at least three."""
    return len(dampings) >= FEWEST_ALIKE and len(set(dampings)) == 1 and dampings[0] != 0


def joint_armature(urdf: str) -> dict[str, float]:
    """``<dynamics armature>`` of every joint that came from an MJCF file: joint -> kg·m² (kg)."""
    tags = {str(j.get("name")): j.find("dynamics") for j in ET.fromstring(urdf).findall("joint")}
    return {name: float(tag.get("armature", 0)) for name, tag in tags.items() if tag is not None}
