"""Bodies to draw: the URDF's own where they can be read, otherwise simple ones from the kinematics.

A link is drawn with the first of these that can be read: its visual geometry, its collision geometry, capsules from its
joint to the joints of the next links. So every URDF can be drawn, and a missing mesh changes one link only.
"""

from __future__ import annotations

import math
import os
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from importlib import metadata, util
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from frischid.core.types import Array
from frischid.robot.robot import Robot

READABLE = {".stl", ".obj", ".ply", ".glb", ".gltf", ".off"} | ({".dae"} if util.find_spec("collada") else set())
SIMPLE = "0.72 0.75 0.79 1"
JOINT = 1.25  # radius of a joint over that of the links


def urdf_of(robot: Robot) -> Any:
    """A yourdfpy URDF in which every link with a body can be drawn."""
    import trimesh
    import yourdfpy

    visual: Any = trimesh.visual  # untyped
    tree = ET.fromstring(robot.urdf)
    folders = _folders(robot)
    children = _children(tree)
    radius = _thickness(tree)
    for link in tree.findall("link"):
        own = list(_readable(link, "visual", folders)) or list(_readable(link, "collision", folders))
        for kind in ("visual", "collision"):
            for element in link.findall(kind):
                link.remove(element)
        name = str(link.get("name"))
        link.extend(own or _simple(children.get(name, []), _centre(link), radius))
    text = ET.tostring(tree)
    urdf = yourdfpy.URDF.load(BytesIO(text), filename_handler=yourdfpy.urdf.filename_handler_null)
    for body in urdf.scene.geometry.values():
        if body.visual.kind == "face":
            # A colour without a material would be drawn as bare metal, which is black where nothing is mirrored.
            dull = visual.material.PBRMaterial(
                baseColorFactor=body.visual.main_color, metallicFactor=0.0, roughnessFactor=0.8
            )
            body.visual = visual.TextureVisuals(material=dull)
    return urdf


def thickness_of(robot: Robot) -> float:
    """Radius of the simple bodies of a robot, m."""
    return _thickness(ET.fromstring(robot.urdf))


def _thickness(tree: ET.Element) -> float:
    """A fraction of the mean distance between joints, in which long links have more weight."""
    offsets = [float(np.linalg.norm(_xyz(joint.find("origin")))) for joint in tree.findall("joint")]
    usual = [x for x in offsets if x > 1e-3]
    return float(np.clip(0.08 * np.sqrt(np.mean(np.square(usual))), 0.004, 0.06)) if usual else 0.03


def _folders(robot: Robot) -> list[Path]:
    """Folders that may hold packages and relative file names."""
    here = Path(robot.source)
    folders = list(here.resolve().parents) if here.exists() else []
    folders += [Path(p) for p in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep) if p]
    try:
        share = metadata.distribution("example-robot-data").locate_file("cmeel.prefix/share")
    except metadata.PackageNotFoundError:
        return folders
    return [*folders, Path(str(share))]


def _found(filename: str, folders: list[Path]) -> Path | None:
    """The file with a ``package://``, ``file://``, relative or absolute name."""
    plain = filename.removeprefix("file://").removeprefix("package://")
    package = plain.partition("/")
    for folder in folders:
        # A package is a subfolder of that name, or the folder itself if it has that name.
        for path in (folder / plain, folder / package[2] if folder.name == package[0] else None):
            if path is not None and path.is_file():
                return path
    return Path(plain) if Path(plain).is_file() else None


def _readable(link: ET.Element, kind: str, folders: list[Path]) -> Iterator[ET.Element]:
    """Geometry elements of a link that can be drawn, as visual elements with the paths of their files."""
    for element in link.findall(kind):
        mesh = element.find("geometry/mesh")
        if mesh is not None:
            path = _found(str(mesh.get("filename")), folders)
            if path is None or path.suffix.lower() not in READABLE:
                continue
            mesh.set("filename", str(path))
        element.tag = "visual"
        element.attrib.pop("name", None)
        yield element


def _children(tree: ET.Element) -> dict[str, list[Array]]:
    """For each link the origins of the joints of its child links."""
    found: dict[str, list[Array]] = {}
    for joint in tree.findall("joint"):
        parent = joint.find("parent")
        if parent is not None:
            found.setdefault(str(parent.get("link")), []).append(_xyz(joint.find("origin")))
    return found


def _centre(link: ET.Element) -> Array | None:
    inertial = link.find("inertial")
    return None if inertial is None else _xyz(inertial.find("origin"))


def _xyz(origin: ET.Element | None) -> Array:
    text = "0 0 0" if origin is None else origin.get("xyz", "0 0 0")
    return np.array([float(x) for x in text.split()])


def _simple(ends: list[Array], centre: Array | None, radius: float) -> list[ET.Element]:
    """Capsules from a link's joint to the next joints; a last link's one is twice as long as to its centre of mass.

    A capsule is a cylinder with a sphere of the same radius at its end. The sphere at the joint is thicker: it shows
    the joint, and its surface is not that of the link that ends there, so that the two do not flicker.
    """
    if not ends:
        if centre is None:
            return []
        ends = [2 * centre]
    parts = [_visual(np.zeros(3), "0 0 0", "sphere", JOINT * radius, 0.0)]
    for end in ends:
        length = float(np.linalg.norm(end))
        if length > radius:
            parts.append(_visual(end / 2, _rpy(end), "cylinder", radius, length))
            parts.append(_visual(end, "0 0 0", "sphere", radius, 0.0))
    return parts


def _rpy(direction: Array) -> str:
    """Roll, pitch and yaw that turn the z axis to a direction, as text."""
    x, y, z = direction / np.linalg.norm(direction)
    return f"0 {math.acos(min(1.0, max(-1.0, z))):.9g} {math.atan2(y, x):.9g}"


def _visual(position: Array, rpy: str, shape: str, radius: float, length: float) -> ET.Element:
    visual = ET.Element("visual")
    ET.SubElement(visual, "origin", xyz=" ".join(f"{x:.9g}" for x in position), rpy=rpy)
    size = {"radius": f"{radius:.6g}"} | ({"length": f"{length:.9g}"} if shape == "cylinder" else {})
    ET.SubElement(ET.SubElement(visual, "geometry"), shape, size)
    ET.SubElement(ET.SubElement(visual, "material", name="body"), "color", rgba=SIMPLE)
    return visual
