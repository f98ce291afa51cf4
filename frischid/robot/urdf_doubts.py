"""Doubtful numbers of a URDF: possible, but hardly those of a real robot.

    I_xx + I_yy ≥ I_zz (and its permutations) for every body;    a body's centre of mass lies within the body

Parsers accept all of this. A simulator's placeholder (one damping for all joints, one inertia for all links) is a
number too. Each doubt names its line.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from frischid.robot.urdf_numbers import NUMBER_PATTERN
from frischid.robot.urdf_reading import FEWEST_ALIKE, MOVING, is_placeholder
from frischid.robot.xml_places import Element, elements

FAR_CENTRE = 1.5
"""Times the distance to the farthest next joint (at least `SMALL_LINK`). A centre of mass farther out is doubtful."""
SMALL_LINK = 0.25
"""m. A link without a next joint, or with a near one, may be as large as this."""


def urdf_doubts(text: str) -> list[str]:
    r"""Sentences about doubtful numbers, each with its line.

    Parameters
    ----------
    text : str
        A URDF that has been read without error.

    Examples
    --------
    >>> from frischid.robot.urdf_doubts import urdf_doubts
    >>> joint = '<joint name="{}" type="revolute"><dynamics damping="10"/></joint>'
    >>> (doubt,) = urdf_doubts("<robot>" + "".join(joint.format(name) for name in "abc") + "</robot>")
    >>> doubt.startswith('line 1: damping="10" on all 3 moving joints: a simulator')
    True
    """
    seen = _read(text)
    return [*_dampings(seen), *_inertias(seen), *_centres(seen)]


@dataclass
class _Seen:
    """Numbers in the elements of a URDF, with their lines, by the name of the joint or link.

    ``reach`` is the distance from a link to its farthest next joint, m.
    """

    moving: list[str] = field(default_factory=list)
    damping: dict[str, tuple[int, str]] = field(default_factory=dict)
    of_mjcf: bool = False
    inertia: dict[str, tuple[int, tuple[float, ...]]] = field(default_factory=dict)
    mass: dict[str, float] = field(default_factory=dict)
    centre: dict[str, tuple[int, np.ndarray]] = field(default_factory=dict)
    reach: dict[str, float] = field(default_factory=dict)

    def add_joint(self, joint: Element) -> None:
        """Read the damping of a joint, and its distance from its parent."""
        name, parent, offset = joint.attributes.get("name", ""), "", 0.0
        if joint.attributes.get("type") in MOVING:
            self.moving.append(name)
        for part in joint.children:
            if part.name == "dynamics" and "damping" in part.attributes:
                self.damping[name] = part.line, part.attributes["damping"]
                self.of_mjcf |= "armature" in part.attributes
            elif part.name == "origin":
                offset += float(np.linalg.norm(_three(part.attributes)))
            elif part.name == "limit" and joint.attributes.get("type") == "prismatic":  # a rail of this length
                offset += max(abs(_number(part.attributes.get(k, "0"))) for k in ("lower", "upper"))
            elif part.name == "parent":
                parent = part.attributes.get("link", "")
        self.reach[parent] = max(self.reach.get(parent, 0.0), offset)

    def add_link(self, link: Element) -> None:
        """Read the inertial of a link."""
        name = link.attributes.get("name", "")
        for part in (part for inertial in link.children if inertial.name == "inertial" for part in inertial.children):
            if part.name == "origin":
                self.centre[name] = part.line, _three(part.attributes)
            elif part.name == "mass":
                self.mass[name] = _number(part.attributes.get("value", ""))
            elif part.name == "inertia":
                six = tuple(_number(part.attributes.get(k, "")) for k in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"))
                self.inertia[name] = part.line, six


def _read(text: str) -> _Seen:
    seen = _Seen()
    for part in elements(text.encode(), "the URDF").children:
        if part.name == "joint":
            seen.add_joint(part)
        elif part.name == "link":
            seen.add_link(part)
    return seen


def _three(attributes: Mapping[str, str]) -> np.ndarray:
    parts = attributes.get("xyz", "0 0 0").split()
    return np.array([_number(x) for x in parts]) if len(parts) == 3 else np.zeros(3)


def _number(text: str) -> float:
    return float(text) if NUMBER_PATTERN.fullmatch(text) and math.isfinite(float(text)) else 0.0


def _dampings(seen: _Seen) -> list[str]:
    values = [seen.damping[n][1] for n in seen.moving if n in seen.damping]
    if len(values) < len(seen.moving) or seen.of_mjcf or not is_placeholder([_number(x) for x in values]):
        return []
    line = min(seen.damping[n][0] for n in seen.moving)
    return [
        f'line {line}: damping="{values[0]}" on all {len(values)} moving joints: a simulator\'s value, hardly that of '
        "a real robot; 0 is used instead"
    ]


def has_one_inertial(text: str) -> bool:
    """Whether all links of a URDF, at least three, have the same mass and the same inertia: a placeholder."""
    seen = _read(text)
    return _is_one_inertia(seen) and len({seen.mass.get(link) for link in seen.inertia}) == 1


def _is_one_inertia(seen: _Seen) -> bool:
    own = {six for _, six in seen.inertia.values()}
    return len(seen.inertia) >= FEWEST_ALIKE and len(own) == 1 and any(*own)


def _inertias(seen: _Seen) -> list[str]:
    found = []
    if _is_one_inertia(seen):
        line, count = min(line for line, _ in seen.inertia.values()), len(seen.inertia)
        found.append(
            f"line {line}: all {count} links have the same inertia: a placeholder, hardly that of a real robot"
        )
    for link, (line, (xx, xy, xz, yy, yz, zz)) in seen.inertia.items():
        moments = np.linalg.eigvalsh(np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))
        size = float(np.abs(moments).max())
        if size and (moments[0] < -1e-6 * size or moments[0] + moments[1] < moments[2] * (1 - 1e-3)):
            found.append(
                f"line {line}: no body can have the inertia of link '{link}' (a principal moment exceeds the sum)"
            )
        if seen.mass.get(link) == 0 and size:
            found.append(f"line {line}: link '{link}' has inertia and no mass")
    return found


def _centres(seen: _Seen) -> list[str]:
    found = []
    for link, (line, centre) in seen.centre.items():
        room = FAR_CENTRE * max(seen.reach.get(link, 0.0), SMALL_LINK)
        if (far := float(np.linalg.norm(centre))) > room and seen.mass.get(link, 0.0) > 0:
            found.append(
                f"line {line}: the centre of mass of link '{link}' is {far:.3g} m from its frame, outside the link"
            )
    return found
