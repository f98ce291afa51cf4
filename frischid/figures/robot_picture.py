"""A picture of the robot whose joints are coloured by the model's error: an SVG without a mesh, a script or an address.

Links are thick lines between the joints of the forward kinematics, seen from the direction that spreads the joints
most. A joint's colour is its place between two errors on a scale of logarithms,

    place = log(NRMSE / sensors' noise) / log(constant torque / sensors' noise),

from 0 (the sensors allow no better) to 1 (no better than a constant torque). The number stands beside the joint, so
that nobody needs the colour.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence

import numpy as np
from scipy import optimize

from frischid.core.types import Array
from frischid.figures.style import COLOURS, short
from frischid.model.grade import fifth
from frischid.robot.kinematic_tree import skeleton
from frischid.robot.robot import Robot

STEPS = ("#009e73", "#56b4e9", "#e69f00", "#d55e00", "#a02c2c")
"""Colours of the fifths of the scale, from good to bad: Okabe and Ito's, and a dark red."""
GREY = COLOURS[7]
WORDS = ("near the sensors' noise", "small", "medium", "large", "near a constant torque")
WIDTH_PX, HEIGHT_PX, MARGIN_PX, TEXT_PX, LABEL_PX = 470, 360, 26, 15, 205
"""Size of the picture, free space at its edge, height of a line of text, and width of the column of labels."""
LETTERS, FEWER = 19, 16
"""Letters of a label's name: of names as they are, and of shortened ones, which have more wide letters."""
RADIUS_PX = 7
LABELLED = 9
"""Joints that get a label at most: the worst."""
AZIMUTHS, ELEVATION = np.linspace(0.0, np.pi, 24, endpoint=False), np.radians(18.0)


def robot_picture(robot: Robot, q: Array, joints: Mapping[str, tuple[float, float, float]]) -> str:
    """The robot at a pose, as SVG.

    Parameters
    ----------
    q : ndarray, shape (J,)
        Pose, rad (m).
    joints : mapping of str to (float, float, float)
        NRMSE of the model, of the sensors' noise and of a constant torque of each joint; other joints are grey.

    Returns
    -------
    str
        An ``svg`` element; all names in it are escaped.

    Examples
    --------
    >>> import numpy as np
    >>> import frischid as fr
    >>> from frischid.figures.robot_picture import robot_picture
    >>> svg = robot_picture(fr.Robot.load("planar2"), np.array([0.4, 0.6]), {"joint2": (0.05, 0.01, 1.0)})
    >>> svg.startswith("<svg") and "joint2: 5.0 %" in svg
    True
    """
    points, parents, names, tips = skeleton(robot, q)
    flat = _projected(np.vstack([points, *tips.values()]) if tips else points)
    seen, ends = flat[: len(points)], dict(zip(tips, flat[len(points) :], strict=True))
    seen = _apart(seen)
    root = ET.Element("svg", viewBox=f"0 0 {WIDTH_PX} {HEIGHT_PX}", role="img")
    root.set("xmlns", "http://www.w3.org/2000/svg")
    ET.SubElement(root, "title").text = f"{robot.name}: error of each joint"
    for k in range(1, len(seen)):
        _line(root, seen[parents[k]], seen[k], "link")
    for k, end in ends.items():
        _line(root, seen[k], end, "link")
    labelled = sorted((n for n in names if n in joints), key=lambda n: -joints[n][0])[:LABELLED]
    shown = _labels([*names])
    for name, y in _heights({n: seen[names[n]] for n in labelled}).items():
        _line(root, seen[names[name]], (WIDTH_PX - LABEL_PX + 4, y), "lead")
        text = ET.SubElement(root, "text", x=f"{WIDTH_PX - LABEL_PX + 9:.0f}", y=f"{y + 0.35 * TEXT_PX:.1f}")
        text.text = f"{shown[name]}: {100 * joints[name][0]:.1f} %"
    for name, k in names.items():
        colour = STEPS[fifth(*joints[name])] if name in joints else GREY
        x, y = seen[k]
        mark = ET.SubElement(root, "circle", cx=f"{x:.1f}", cy=f"{y:.1f}", r=str(RADIUS_PX), fill=colour)
        said = f"{100 * joints[name][0]:.1f} %, {WORDS[fifth(*joints[name])]}" if name in joints else "not fitted"
        ET.SubElement(mark, "title").text = f"{name}: {said}"
    return ET.tostring(root, encoding="unicode")


def _projected(points: Array) -> Array:
    """Points on the picture, (N, 2), seen from the side that spreads them most."""
    flat = view(points, best_view(points))
    low, high = flat.min(axis=0), flat.max(axis=0)
    room = np.array([WIDTH_PX - LABEL_PX - 2 * MARGIN_PX, HEIGHT_PX - 2 * MARGIN_PX])
    scale = float((room / np.maximum(high - low, 1e-9)).min())
    centred = (flat - 0.5 * (low + high)) * min(scale, 1e9)
    return np.asarray(centred * [1.0, -1.0] + 0.5 * room + MARGIN_PX)


def _apart(seen: Array) -> Array:
    """Joints that coincide, side by side: wrists have several in one place."""
    found = seen.copy()
    for k in range(2, len(found)):
        while (np.linalg.norm(found[1:k] - found[k], axis=1) < RADIUS_PX).any():
            found[k, 0] -= 2 * RADIUS_PX
    return found


def _heights(places: Mapping[str, Array]) -> dict[str, float]:
    """Height of each joint's label: the lines to the labels are shortest in sum, so no two of them cross."""
    top = max(MARGIN_PX, 0.5 * (HEIGHT_PX - 2 * TEXT_PX * len(places)))
    heights = top + 2 * TEXT_PX * (np.arange(len(places)) + 0.5)
    ends = np.column_stack([np.full(len(heights), WIDTH_PX - LABEL_PX + 4.0), heights])
    lengths = np.linalg.norm(np.array([*places.values()]).reshape(-1, 1, 2) - ends, axis=2)
    chosen = optimize.linear_sum_assignment(lengths)[1]
    found = dict(zip(places, heights[chosen].tolist(), strict=True))
    return dict(sorted(found.items(), key=lambda item: item[1]))


def best_view(points: Array) -> float:
    """The azimuth, rad, from which points (N, 3) lie farthest apart."""

    def apart(azimuth: float) -> float:
        seen = view(points, azimuth)
        return float(np.linalg.norm(seen[:, None] - seen[None], axis=2).sum())

    return float(max(AZIMUTHS, key=apart))


def view(points: Array, azimuth: float) -> Array:
    """Points (N, 3) as seen from an azimuth, rad: to the right and upwards, m, (N, 2)."""
    across = points @ np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    towards = points @ np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    return np.column_stack([across, np.cos(ELEVATION) * points[:, 2] - np.sin(ELEVATION) * towards])


def _line(root: ET.Element, start: Sequence[float], end: Sequence[float], kind: str) -> None:
    (x1, y1), (x2, y2) = start, end
    line = ET.SubElement(root, "line", x1=f"{x1:.1f}", y1=f"{y1:.1f}", x2=f"{x2:.1f}", y2=f"{y2:.1f}")
    line.set("class", kind)


def _labels(names: Sequence[str]) -> dict[str, str]:
    """Names that leave room for a number: where one is long, all without their common beginning and end.

    Of a name that is still long the end is kept, because numbers stand there.
    """
    fitting = all(len(name) <= LETTERS for name in names)
    shown = names if fitting else [x if len(x) <= FEWER else f"…{x[1 - FEWER :]}" for x in short(names)]
    return dict(zip(names, shown, strict=True))
