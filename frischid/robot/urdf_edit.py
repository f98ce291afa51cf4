"""A URDF as text: inertials, joint friction, axes and zeros are replaced in place, and no other byte changes.

`frischid.robot.xml_places` finds the places of elements; the edits are then made from the last to the first.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator, Mapping, Sequence
from xml.sax.saxutils import quoteattr

import numpy as np
from scipy.spatial.transform import Rotation

from frischid.core.types import Array
from frischid.robot.inertia import dynamic_parameters, pseudo_inertia
from frischid.robot.xml_places import Element, Span, elements


class UrdfText:
    """Links and joints of a URDF with their places in its text.

    Parameters
    ----------
    text : str
        A URDF that an XML parser has accepted.
    """

    def __init__(self, text: str) -> None:
        self.data = text.encode()
        root = elements(self.data, "the URDF")
        self.links = {e.attributes.get("name", ""): e for e in root.children if e.name == "link"}
        self.joints = {e.attributes.get("name", ""): e for e in root.children if e.name == "joint"}

    def child_link(self, joint: str) -> str:
        """Link that a joint moves."""
        child = self.joints[joint].child("child")
        return "" if child is None else child.attributes.get("link", "")

    def pseudo_inertia(self, link: str) -> Array:
        """Pseudo-inertia (4, 4) of a link in its own frame, from the URDF; zero without an inertial."""
        inertial = self.links[link].child("inertial")
        if inertial is None:
            return np.zeros((4, 4))
        of = {c.name: c.attributes for c in inertial.children}
        mass = float(of.get("mass", {}).get("value", 0))
        names = ("ixx", "ixy", "iyy", "ixz", "iyz", "izz")
        tensor = [float(of.get("inertia", {}).get(n, 0)) for n in names]
        origin = of.get("origin", {})
        xyz, rpy = (np.array([float(x) for x in origin.get(k, "0 0 0").split()]) for k in ("xyz", "rpy"))
        H = np.eye(4)
        H[:3, :3], H[:3, 3] = _rotation(rpy), xyz
        central = pseudo_inertia(np.array([mass, 0.0, 0.0, 0.0, *tensor]))
        return np.asarray(H @ central @ H.T)

    def edited(self, inertias: Mapping[str, Array], dynamics: Mapping[str, Mapping[str, float]]) -> str:
        """Text with other inertials and joint friction.

        Parameters
        ----------
        inertias : mapping of str to ndarray, shape (4, 4)
            Link -> pseudo-inertia in its own frame.
        dynamics : mapping of str to mapping
            Joint -> attributes of ``<dynamics>`` to set, for example ``{"damping": 0.1}``.
        """
        edits = [self._inertial(self.links[name], P) for name, P in inertias.items()]
        edits += [edit for name, values in dynamics.items() for edit in self._dynamics(self.joints[name], values)]
        return self._replaced(edits)

    def with_joints(self, joints: Mapping[str, tuple[float, float]], names: Mapping[str, str]) -> str:
        """Text with other axes, zeros and names of joints; joints that mimic them follow as before.

        Parameters
        ----------
        joints : mapping of str to (float, float)
            Joint -> s and δ, where the joint of the file is at ``s q + δ`` (rad, m): the axis becomes s times the axis,
            and the origin is moved by δ about (along) the axis.
        names : mapping of str to str
            Joint -> its new name.
        """
        edits = []
        for name, (sign, offset) in joints.items():
            edits += self._placed(self.joints[name], sign, offset)
        for name, new in names.items():
            start, end = self.joints[name].tag
            edits.append(((start, end), _with_attributes(self.data[start:end].decode(), {"name": new})))
        return self._replaced([*edits, *self._mimics(joints, names)])

    def _mimics(
        self, joints: Mapping[str, tuple[float, float]], names: Mapping[str, str]
    ) -> Iterator[tuple[Span, str]]:
        """Edits of the joints that mimic the changed ones: ``m (s q + δ) + b = (m s) q + (m δ + b)``."""
        for joint in self.joints.values():
            rule = joint.child("mimic")
            leader = "" if rule is None else rule.attributes.get("joint", "")
            if rule is None or leader not in {*joints, *names}:
                continue
            sign, offset = joints.get(leader, (1.0, 0.0))
            factor, shift = float(rule.attributes.get("multiplier", 1)), float(rule.attributes.get("offset", 0))
            values = {"joint": names.get(leader, leader)}
            values |= {"multiplier": _text(np.array([sign * factor]))} if sign < 0 else {}
            values |= {"offset": _text(np.array([factor * offset + shift]))} if offset else {}
            start, end = rule.tag
            yield rule.tag, _with_attributes(self.data[start:end].decode(), values)

    def _placed(self, joint: Element, sign: float, offset: float) -> list[tuple[Span, str]]:
        """Edits of a joint's axis and origin."""
        axis, origin = joint.child("axis"), joint.child("origin")
        written = "1 0 0" if axis is None else axis.attributes.get("xyz", "1 0 0")
        direction = np.array([float(x) for x in written.split()])
        place: dict[str, str] = {}
        if offset:
            of = {} if origin is None else origin.attributes
            xyz, rpy = (np.array([float(x) for x in of.get(k, "0 0 0").split()]) for k in ("xyz", "rpy"))
            turned, unit = _rotation(rpy), direction / np.linalg.norm(direction)
            if joint.attributes.get("type") == "prismatic":
                place["xyz"] = _text(xyz + offset * turned @ unit)
            else:
                moved = turned @ Rotation.from_rotvec(offset * unit).as_matrix()
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore", UserWarning)  # at a pitch of a quarter turn, the yaw is zero
                    place["rpy"] = _text(Rotation.from_matrix(moved).as_euler("xyz"))
        edits = []
        for name, old, values in (
            ("origin", origin, place),
            ("axis", axis, {"xyz": _text(sign * direction)} if sign < 0 else {}),
        ):
            if values and old is not None:
                edits.append((old.tag, _with_attributes(self.data[slice(*old.tag)].decode(), values)))
            elif values:
                attributes = " ".join(f'{k}="{x}"' for k, x in values.items())
                edits.append(self._inserted(joint, [f"<{name} {attributes}/>"]))
        return edits

    def _replaced(self, edits: Sequence[tuple[Span, str]]) -> str:
        """Text with these edits, made from the last to the first."""
        out = self.data
        for (start, end), new in sorted(edits, reverse=True):
            out = out[:start] + new.encode() + out[end:]
        return out.decode()

    def _inertial(self, link: Element, P: Array) -> tuple[Span, str]:
        old = link.child("inertial")
        if old is not None:
            return (old.tag[0], old.end), self._joined(_inertial_lines(P), self._indent(old.tag[0]))
        return self._inserted(link, _inertial_lines(P))

    def _dynamics(self, joint: Element, values: Mapping[str, float]) -> list[tuple[Span, str]]:
        old = joint.child("dynamics")
        if old is None:
            attributes = " ".join(f'{k}="{x!r}"' for k, x in values.items())
            return [self._inserted(joint, [f"<dynamics {attributes}/>"])]
        start, end = old.tag
        written = {key: repr(x) for key, x in values.items()}
        return [((start, end), _with_attributes(self.data[start:end].decode(), written))]

    @property
    def _newline(self) -> str:
        return "\r\n" if b"\r\n" in self.data else "\n"

    def _joined(self, lines: Sequence[str], indent: str) -> str:
        return f"{self._newline}{indent}".join(lines)

    def _inserted(self, parent: Element, lines: Sequence[str]) -> tuple[Span, str]:
        """Insert a first child into an element, on a line of its own if the other children have their own lines."""
        newline = self._newline
        if parent.empty:
            start, end = parent.tag
            tag = self.data[start:end].decode().rstrip("/> \t\r\n")
            outer = self._indent(start)
            inner = outer + "  "
            return (
                start,
                end,
            ), f"{tag}>{newline}{inner}{self._joined(lines, inner)}{newline}{outer}</{_qualified(tag)}>"
        inner = self._indent(parent.children[0].tag[0]) if parent.children else self._indent(parent.tag[0]) + "  "
        return (parent.tag[1], parent.tag[1]), f"{newline}{inner}{self._joined(lines, inner)}"

    def _indent(self, place: int) -> str:
        """White space before a place, if the line has nothing else before the place."""
        line = self.data[self.data.rfind(b"\n", 0, place) + 1 : place].decode()
        return line if not line.strip() else ""


def _with_attributes(tag: str, values: Mapping[str, str]) -> str:
    """A start tag with other values of some attributes."""
    for key, text in values.items():
        written = re.compile(rf"""(\s{key}\s*=\s*)("[^"]*"|'[^']*')""")
        quoted = quoteattr(text)
        if found := written.search(tag):
            tag = tag[: found.start(2)] + quoted + tag[found.end(2) :]
        else:
            tag = re.sub(r"(\s*/?>)$", lambda end: f" {key}={quoted}{end[1]}", tag)  # noqa: B023
    return tag


def _text(values: Array) -> str:
    return " ".join(f"{float(f'{x:.12g}') + 0.0:.12g}" for x in values)


def _qualified(tag: str) -> str:
    return tag.lstrip("<").split()[0]


def _inertial_lines(P: Array) -> list[str]:
    """An ``<inertial>`` with its frame at the centre of mass, along the link's axes."""
    m = float(P[3, 3])
    centre = P[:3, 3] / m if m else np.zeros(3)
    central = P.copy()
    central[:3, :3] -= m * np.outer(centre, centre)
    xx, xy, yy, xz, yz, zz = (float(x) for x in dynamic_parameters(central)[4:])
    x, y, z = (float(c) for c in centre)
    return [
        "<inertial>",
        f'  <origin xyz="{x!r} {y!r} {z!r}" rpy="0 0 0"/>',
        f'  <mass value="{m!r}"/>',
        f'  <inertia ixx="{xx!r}" ixy="{xy!r}" ixz="{xz!r}" iyy="{yy!r}" iyz="{yz!r}" izz="{zz!r}"/>',
        "</inertial>",
    ]


def _rotation(rpy: Array) -> Array:
    """Rotation of roll, pitch and yaw about the fixed axes x, y, z."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(rpy), np.sin(rpy)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )
