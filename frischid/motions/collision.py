"""Distances of a robot's bodies from one another and from the floor.

Primitive ``<collision>`` shapes of the URDF are used directly. A mesh is replaced by its convex hull, which is never
smaller than the mesh and quick to measure; where Coal cannot make a hull, the mesh itself is used. Distances are
computed by Coal (Gilbert, Johnson and Keerthi 1988); they are negative for overlap.

Three kinds of pairs are left out: pairs on one body, pairs joined by a joint, and pairs that overlap in nearly every
pose by design. If exactly one body lies between two others, their gap is often a few millimetres by design; such pairs
keep a tenth of the margin. A mesh file that is not found is not checked, and `Clearance.notes` names it.
"""

from __future__ import annotations

import os
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from frischid.core.types import Array
from frischid.errors import InputError
from frischid.robot.robot import Robot
from frischid.robot.urdf_reading import robot_names

FLOOR_NAME = "floor"
_POSES = 64
_ALWAYS_SHARE = 0.8


@dataclass(frozen=True, eq=False)
class Clearance:
    """Pairs of bodies that must keep a distance."""

    robot: Robot
    geometry: Any
    names: tuple[str, ...]
    """The pairs, as ``"link2 and link5"``."""
    margins: Array
    """Least distance of each pair, m, (pairs,)."""
    notes: tuple[str, ...]
    """Bodies that are not checked, and why."""

    @classmethod
    def of(cls, robot: Robot, *, floor: float | None = 0.0, margin: float = 0.01) -> Clearance:
        """Read a robot's collision shapes.

        Parameters
        ----------
        floor : float, optional
            Height of the floor above the base, against gravity, m; None for no floor.
        margin : float
            Least distance, m.

        Raises
        ------
        InputError
            The height of the floor or the distance is not a finite number.
        """
        for name, value in (("height of the floor", floor), ("least distance of two bodies", margin)):
            if value is not None and not np.isfinite(value):
                raise InputError(f"the {name} must be a finite number of m, got {value}")
        urdf, missing = _with_meshes(robot, "collision")
        notes = [f"no mesh file for {', '.join(missing)}: not checked for collision"] if missing else []
        geometry = _geometry(robot, urdf, pin.GeometryType.COLLISION)
        if geometry.ngeoms == 0:
            notes.append(
                "the URDF has no usable collision shape: neither self-collision nor the floor was checked; watch the "
                "first run"
            )
            return cls(robot, geometry, (), np.empty(0), tuple(notes))
        weight = np.linalg.norm(robot.gravity)
        if floor is not None and weight > 0:
            half_space = coal.Halfspace(-np.array(robot.gravity) / weight, floor)
            geometry.addGeometryObject(pin.GeometryObject(FLOOR_NAME, 0, pin.SE3.Identity(), half_space))
        overlapping = _add_pairs(robot, geometry)
        if overlapping:
            notes.append(f"overlapping in nearly every pose, so not checked: {', '.join(overlapping)}")
        names = tuple(_pair_name(geometry, pair) for pair in geometry.collisionPairs)
        margins = np.array(
            [margin / 10 if _next_but_one(robot, geometry, p) else margin for p in geometry.collisionPairs]
        )
        return cls(robot, geometry, names, margins, tuple(notes))

    def nearest(self, q: Array) -> tuple[Array, NDArray[np.intp]]:
        """Distance and index of the pair that is farthest below its margin, in each of N poses.

        Parameters
        ----------
        q : ndarray, shape (N, J)

        Returns
        -------
        distance : ndarray, shape (N,)
            m; infinite where every pair keeps its margin, because only pairs below their margin are measured.
        pair : ndarray of int, shape (N,)
        """
        distance, pair = np.full(len(q), np.inf), np.zeros(len(q), dtype=np.intp)
        if not self.names:
            return distance, pair
        model, data, geometry = self.robot.model, self.robot.model.createData(), self.geometry
        space = geometry.createData()
        for request, margin in zip(space.collisionRequests, self.margins, strict=True):
            request.security_margin = margin
        for k, x in enumerate(self.robot.configuration(q)):
            if not pin.computeCollisions(model, data, geometry, space, x, False):
                continue
            close = np.array([i for i, result in enumerate(space.collisionResults) if result.isCollision()])
            measured = np.array([pin.computeDistance(geometry, space, int(i)).min_distance for i in close])
            worst = int((self.margins[close] - measured).argmax())
            pair[k] = close[worst]
            distance[k] = min(measured[worst], self.margins[pair[k]])
        return distance, pair

    def distance(self, q: Array, pair: NDArray[np.intp]) -> Array:
        """Distance of one pair in each pose, m: (N, J) and (N,) -> (N,)."""
        model, data, geometry = self.robot.model, self.robot.model.createData(), self.geometry
        space = geometry.createData()
        out = np.empty(len(q))
        for k, x in enumerate(self.robot.configuration(q)):
            pin.updateGeometryPlacements(model, data, geometry, space, x)
            out[k] = pin.computeDistance(geometry, space, int(pair[k])).min_distance
        return out


def body_boxes(robot: Robot) -> dict[str, tuple[Array, Array]]:
    """Bounding boxes of the bodies, along the axes of their joint's frame.

    The boxes are those of the collision shapes, or of the visual shapes where a body has no collision shape. A body
    whose mesh file is not found has no box.

    Returns
    -------
    dict of str to (ndarray (3,), ndarray (3,))
        Joint -> lower and upper corner, m.
    """
    found: dict[str, tuple[Array, Array]] = {}
    for kind, tag in ((pin.GeometryType.COLLISION, "collision"), (pin.GeometryType.VISUAL, "visual")):
        urdf, missing = _with_meshes(robot, tag)
        incomplete = {_body_of(robot, link) for link in missing}
        corners: dict[str, list[Array]] = {}
        for shape in _geometry(robot, urdf, kind).geometryObjects:
            body = robot.model.names[shape.parentJoint]
            if shape.parentJoint and body not in found and body not in incomplete:
                corners.setdefault(body, []).append(_corners(shape))
        found |= {body: (np.min(points, axis=(0, 1)), np.max(points, axis=(0, 1))) for body, points in corners.items()}
    return found


def _body_of(robot: Robot, link: str) -> str:
    model = robot.model  # a fixed joint may have the name of a link, so the frame's kind is asked for too
    return str(model.names[model.frames[model.getFrameId(link, pin.FrameType.BODY)].parentJoint])


def _corners(shape: Any) -> Array:
    """Corners of a shape's own box, in the frame of the shape's joint, (8, 3)."""
    shape.geometry.computeLocalAABB()
    box = shape.geometry.aabb_local
    low, high = np.asarray(box.min_), np.asarray(box.max_)
    unit = np.array(np.meshgrid([0, 1], [0, 1], [0, 1])).reshape(3, -1).T
    return np.asarray((low + unit * (high - low)) @ shape.placement.rotation.T + shape.placement.translation)


def _with_meshes(robot: Robot, tag: str) -> tuple[str, list[str]]:
    """The URDF with full paths of the meshes under `tag`, without meshes that do not exist, and the names of these."""
    root, missing = ET.fromstring(robot.urdf), []
    folder = _folder(robot)
    for link in root.findall("link"):
        for shape in link.findall(tag):
            mesh = shape.find("geometry/mesh")
            if mesh is None:
                continue
            path = _mesh_path(str(mesh.get("filename")), folder)
            if path is None:
                missing.append(str(link.get("name")))
                link.remove(shape)
            else:
                mesh.set("filename", str(path))
    return ET.tostring(root, encoding="unicode"), missing


def mesh_files(robot: Robot) -> list[Path]:
    """Files of the meshes of a robot's URDF, as far as they are on this machine."""
    folder = _folder(robot)
    names = [str(mesh.get("filename")) for mesh in ET.fromstring(robot.urdf).iter("mesh")]
    return [path for path in (_mesh_path(name, folder) for name in dict.fromkeys(names)) if path is not None]


def _folder(robot: Robot) -> Path | None:
    path = Path(robot.source).expanduser()
    path = path if path.is_file() else robot_names().get(robot.source, path)
    return path.resolve().parent if path.is_file() else None


def _mesh_path(filename: str, folder: Path | None) -> Path | None:
    """Find a mesh: ``package://name/rest`` in ROS_PACKAGE_PATH and in every folder above the URDF."""
    rest = filename.removeprefix("file://")
    above = [folder, *folder.parents] if folder else []
    roots = above[:1]
    if filename.startswith("package://"):
        rest = filename.removeprefix("package://")
        roots = above + [Path(p) for p in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep) if p]
    return next((p for p in (root / rest for root in [*roots, Path("/")]) if p.is_file()), None)


def _geometry(robot: Robot, urdf: str, kind: Any) -> Any:
    """Shapes on the bodies of `robot.model`, in which some joints may be locked."""
    whole = pin.buildModelFromXML(robot.urdf)
    shapes = pin.buildGeomFromUrdfString(whole, urdf, kind)
    geometry, model = pin.GeometryModel(), robot.model
    for shape in shapes.geometryObjects:
        frame = whole.frames[shape.parentFrame]
        here = model.frames[model.getFrameId(frame.name, frame.type)]
        placement = here.placement * frame.placement.inverse() * shape.placement
        geometry.addGeometryObject(pin.GeometryObject(frame.name, here.parentJoint, placement, _convex(shape.geometry)))
    return geometry


def _convex(shape: Any) -> Any:
    if not isinstance(shape, coal.BVHModelBase):
        return shape
    try:
        shape.buildConvexHull(True, "Qt")
    except RuntimeError:
        # Coal fails at a corner where more than 255 edges meet (the rim of a round cap); then the slower mesh is used.
        return shape
    return shape.convex


def _pair_name(geometry: Any, pair: Any) -> str:
    return f"{geometry.geometryObjects[pair.first].name} and {geometry.geometryObjects[pair.second].name}"


def _next_but_one(robot: Robot, geometry: Any, pair: Any) -> bool:
    """Whether exactly one body lies between the two."""
    shapes = [geometry.geometryObjects[i] for i in (pair.first, pair.second)]
    if FLOOR_NAME in (shapes[0].name, shapes[1].name):
        return False
    parents = robot.model.parents
    upper, lower = sorted(shape.parentJoint for shape in shapes)
    return bool(parents[parents[lower]] == upper)


def _add_pairs(robot: Robot, geometry: Any) -> list[str]:
    """Add the pairs worth checking; return the names of those that overlap by construction."""
    model = robot.model
    bodies = [shape.parentJoint for shape in geometry.geometryObjects]
    for i in range(len(bodies)):
        for k in range(i + 1, len(bodies)):
            one, two = sorted((bodies[i], bodies[k]))
            on_floor = FLOOR_NAME in (geometry.geometryObjects[i].name, geometry.geometryObjects[k].name)
            joined = one == two or (model.parents[two] == one and not on_floor)
            if not joined:
                geometry.addCollisionPair(pin.CollisionPair(i, k))
    if len(geometry.collisionPairs) == 0:
        return []
    lower, upper = robot.limits.within(np.pi)
    poses = np.random.default_rng(0).uniform(lower, upper, (_POSES, len(robot.joints)))
    data, space, hits = model.createData(), geometry.createData(), np.zeros(len(geometry.collisionPairs))
    for x in robot.configuration(poses):
        pin.computeCollisions(model, data, geometry, space, x, False)
        hits += [result.isCollision() for result in space.collisionResults]
    always = [pair for pair, n in zip(list(geometry.collisionPairs), hits, strict=True) if n > _ALWAYS_SHARE * _POSES]
    names = [_pair_name(geometry, pair) for pair in always]
    for pair in always:
        geometry.removeCollisionPair(pair)
    return names
