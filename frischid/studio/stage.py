"""The robot's scene in one tab: the robot has its pose at one moment of the logs, the colour of a joint its error."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, Literal

import numpy as np
import trimesh
from numpy.typing import NDArray
from viser import ClientHandle
from viser import transforms as tf
from viser.extras import ViserUrdf

from frischid.core.types import Array
from frischid.figures.torque import side_by_side
from frischid.model.prediction import Prediction
from frischid.robot.robot import Robot
from frischid.studio.bench import Bench
from frischid.studio.bodies import thickness_of, urdf_of
from frischid.studio.colours import LIT, colour_of, top_of
from frischid.studio.ghost import Ghost
from frischid.studio.headline_text import verdict_errors
from frischid.studio.track import Track

Colouring = Literal["of the verdict", "at this moment"]
AROUND = 0.25  # s before and after a moment over which the error is averaged
THINNER, LONGER = 0.8, 1.35  # radius and height of a joint's cylinder over those of another joint at the same place
MOMENTS = 30  # moments of the logs at which the camera must show the whole robot
AHEAD = np.array([-0.8, 0.9, -0.6]) / np.linalg.norm([0.8, 0.9, 0.6])  # direction in which the camera looks
LETTER = 7.5  # pixels per character of the label's text
MARGIN = 1.1  # joints are drawn a little larger than their bodies


class Stage:
    """One tab's scene.

    Parameters
    ----------
    chosen : callable
        Called with the name of a joint that was clicked.
    free : tuple of float
        Width (in the middle) and height (from above) of the part that no panel covers, as shares of the page's height.

    Attributes
    ----------
    viewpoint : tuple of ndarray, shape (3,)
        Position of the camera, and the point that it looks at, m.
    lit : frozenset of str
        Joints that a finding acts on whose shape is shown; green instead of the colour of their error.
    """

    def __init__(
        self, client: ClientHandle, bench: Bench, track: Track, chosen: Callable[[str], None], free: tuple[float, float]
    ) -> None:
        self.client, self.bench, self.track = client, bench, track
        robot: Robot = bench.state.model.robot
        self.urdf = urdf_of(robot)
        self.drawn = ViserUrdf(client, self.urdf, root_node_name="/robot")
        self.ghost = Ghost(client, bench, self._drawn_at)
        self.top = top_of(verdict_errors(bench.state).values())
        self._names = tuple(self.urdf.actuated_joint_names)
        self._fixed = {**dict.fromkeys(self._names, 0.0), **robot.locked}
        size = float(self.urdf.scene.scale) if self.urdf.scene.geometry else 1.0
        self.markers: dict[str, Any] = {}
        self.lit: frozenset[str] = frozenset()
        radius = max(min(0.045 * size, 0.3 * self._apart(size)), 1.6 * thickness_of(robot))
        self._above = np.array([0.0, 0.0, 1.4 * radius])  # the label is above its joint, so that both are seen
        for name, rank in zip(bench.state.model.joints, self._ranks(radius), strict=True):
            # Joints at one place are drawn as thinner and longer cylinders one within the other: surfaces that lie in
            # one another would flicker.
            thin, long = THINNER**rank * radius, 1.5 * LONGER**rank * radius
            marker = client.scene.add_cylinder(f"/joints/{name}", radius=thin, height=long)
            marker.on_click(partial(_clicked, chosen, name))
            self.markers[name] = marker
        self.turns = {name: _turn(self.urdf.joint_map[name].axis) for name in self.markers}
        self.label = client.scene.add_label("/chosen", "", anchor="bottom-center")
        client.scene.add_grid("/floor", width=4 * size, height=4 * size, cell_size=size / 5, section_size=size)
        self._free = free
        self.viewpoint = self._look(free)

    def _look(self, free: tuple[float, float]) -> tuple[Array, Array]:
        """Place the camera so that the robot, in all poses of its logs, just fits into the free part of the page."""
        camera, places = self.client.camera, self._places()
        middle = (places.min(axis=0) + places.max(axis=0)) / 2
        right = np.cross(AHEAD, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        up = np.cross(right, AHEAD)
        x, y, z = np.array([right, up, AHEAD]) @ (places - middle).T
        half = float(np.tan(camera.fov / 2))
        wide, high = half * free[0], free[1]
        # The picture of a point at (x, y, distance + z) from the camera must lie within the free part's four sides.
        sides = np.abs(x) / wide - z, (y / half - z) / high, ((1 - 2 * high) * z - y / half) / high
        distance = MARGIN * float(np.max(sides))
        middle = middle - (1 - high) * half * distance * up  # the free part is the upper part of the page
        # In this order, because moving the camera also moves the point that it looks at.
        camera.position = tuple(middle - distance * AHEAD)
        camera.look_at = tuple(middle)
        return middle - distance * AHEAD, middle

    def _places(self) -> Array:
        """Corners of the base and of the joints' bodies at evenly spread moments, m, (P, 3)."""
        boxes = [self._box(self.urdf.joint_map[name].child) for name in self.bench.state.model.joints]
        places = [np.zeros((1, 3))]
        for x in np.linspace(0.0, self.track.x[-1], MOMENTS):
            self.urdf.update_cfg(self._configuration(x))
            places += [box @ pose[:3, :3].T + pose[:3, 3] for box, pose in zip(boxes, self._poses(), strict=True)]
        return np.concatenate(places)

    def _box(self, link: str) -> Array:
        """Corners of a box around a link's own bodies and its origin, in its frame, m, (8, 3)."""
        scene, points = self.urdf.scene, [np.zeros((1, 3))]
        bounds: Any = trimesh.bounds  # untyped
        for node in scene.graph.nodes_geometry:
            if scene.graph.transforms.parents[node] == link:
                pose, name = scene.graph.get(node, link)
                corners = bounds.corners(scene.geometry[name].bounds)
                points.append(corners @ pose[:3, :3].T + pose[:3, 3])
        together = np.concatenate(points)
        return np.asarray(bounds.corners([together.min(axis=0), together.max(axis=0)]))

    def _poses(self) -> Array:
        """Present poses of the joints' links, (J, 4, 4)."""
        links = (self.urdf.joint_map[name].child for name in self.bench.state.model.joints)
        return np.array([self.urdf.get_transform(link) for link in links])

    def _ranks(self, radius: float) -> list[int]:
        """For each joint, the number of joints before it at the same place."""
        places = self._poses()[:, :3, 3]
        near = np.linalg.norm(places[:, None] - places[None], axis=2) < radius
        return [int(near[k, :k].sum()) for k in range(len(places))]

    def _apart(self, usual: float) -> float:
        """Distance of neighbouring joints, m; `usual` where there is only one joint."""
        gaps = np.linalg.norm(np.diff(self._poses()[:, :3, 3], axis=0), axis=1)
        return float(np.median(gaps[gaps > 1e-3])) if (gaps > 1e-3).any() else usual

    def pose(self, x: float, joint: str, colouring: Colouring) -> None:
        """Show a moment."""
        errors = self.errors(x, colouring)
        with self.client.atomic():
            self.drawn.update_cfg(self._configuration(x))
            self.ghost.show(x)
            for (name, marker), pose in zip(self.markers.items(), self._poses(), strict=True):
                marker.position = tuple(pose[:3, 3])
                marker.wxyz = tf.SO3.from_matrix(pose[:3, :3] @ self.turns[name]).wxyz
                error = errors.get(name, 0.0)  # a joint that never moves: as without error
                marker.color = LIT if name in self.lit else colour_of(error, self.top)
            self.label.text = f"{joint}: misses {100 * errors[joint]:.1f} %"
            self.label.position = self.markers[joint].position + self._above
            self.label.anchor = self._anchor()

    def _anchor(self) -> Literal["bottom-left", "bottom-center", "bottom-right"]:
        """Side of the joint on which the label's text is drawn, so that no panel covers the text."""
        camera = self.client.camera
        x, _, z = tf.SO3(camera.wxyz).inverse() @ (self.label.position - camera.position)
        place = x / (max(z, 1e-6) * float(np.tan(camera.fov / 2)))  # in halves of the page's height, from its middle
        half = LETTER * len(self.label.text) / camera.image_height
        if place - half < -self._free[0]:
            return "bottom-left"
        return "bottom-right" if place + half > self._free[0] else "bottom-center"

    def _configuration(self, x: float) -> Array:
        return self._drawn_at(self.track.at(x))

    def _drawn_at(self, q: Array) -> Array:
        values = self._fixed | dict(zip(self.bench.state.model.robot.joints, q, strict=True))
        return np.array([values[n] for n in self._names])

    def errors(self, x: float, colouring: Colouring) -> dict[str, float]:
        """Error of each joint as a share of its torque's spread."""
        joints = self.bench.state.comparison.joints
        if colouring == "of the verdict":
            return verdict_errors(self.bench.state)
        near = moment(self.bench.state.prediction, x)
        prediction = self.bench.state.prediction
        every = prediction.joints  # those that never move are not compared
        residual = np.abs(prediction.residual[near]).mean(axis=0) if near.any() else np.zeros(len(every))
        return {
            name: float(r / joints[name].std) for name, r in zip(every, residual, strict=True) if name in joints.names
        }


def _clicked(chosen: Callable[[str], None], name: str, _: object) -> None:
    chosen(name)


def moment(prediction: Prediction, x: float) -> NDArray[np.bool_]:
    """Samples around a moment of the common axis, (M,)."""
    starts, _ = side_by_side(prediction)
    return np.asarray(np.abs(prediction.t + starts[prediction.log] - x) < AROUND)


def _turn(axis: Array | None) -> Array:
    """Rotation that lays a cylinder, whose axis is z, along a joint's axis."""
    z = np.array([1.0, 0.0, 0.0]) if axis is None else np.asarray(axis, dtype=float) / np.linalg.norm(axis)
    helper = np.array([1.0, 0.0, 0.0]) if abs(z[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    x = np.cross(helper, z)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])
