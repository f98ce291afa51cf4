"""Why a URDF is refused: in words, with the joint or link.

The parser of Pinocchio says the cause on the error stream only, where a message cannot quote it. So the usual causes
are sought again in a URDF that was refused. One fault passes the parser: a link with two parents loses one of them.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Iterator

JOINT_TYPES = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")


def cause_of_refusal(urdf: str) -> str:
    """The first cause that is found, with what to do; empty where none is found.

    Examples
    --------
    >>> cause_of_refusal('<robot name="r"><link name="a"/><link name="a"/></robot>')
    "the link 'a' stands twice: rename one of them"
    """
    try:
        root = ET.fromstring(urdf)
    except ET.ParseError as error:  # in a model file, whose URDF nobody has read yet
        return f"it is no XML: {error}"
    return next(_causes(root), "")


def link_with_two_parents(root: ET.Element) -> str:
    """The first link that is the child of several joints, in a sentence; empty where the robot is a tree."""
    children = Counter(tag.get("link", "") for joint in root.findall("joint") for tag in joint.findall("child"))
    found = (f"the link '{name}' is the child of {count} joints" for name, count in children.items() if count > 1)
    said = next(found, "")
    return said and f"{said}: a URDF is a tree, so remove all but one of them"


def _causes(root: ET.Element) -> Iterator[str]:
    links, joints = root.findall("link"), root.findall("joint")
    for kind, tags in (("link", links), ("joint", joints)):
        for name, count in Counter(tag.get("name", "") for tag in tags).items():
            if not name:
                yield f"a {kind} has no name: give it one"
            elif count > 1:
                yield f"the {kind} '{name}' stands {'twice' if count == 2 else f'{count} times'}: rename one of them"
    names = {link.get("name", "") for link in links}
    for joint in joints:
        yield from _causes_in(joint, names)
    children = {tag.get("link", "") for joint in joints for tag in joint.findall("child")}
    roots = [name for name in sorted(names) if name not in children]
    if len(roots) > 1:
        yield f"the links {', '.join(roots)} are the child of no joint: only one link may be the base"
    if names and not roots:
        yield "every link is the child of a joint: one link must be the base"


def _causes_in(joint: ET.Element, links: set[str]) -> Iterator[str]:
    name, kind = f"joint '{joint.get('name', '')}'", joint.get("type", "")
    if kind not in JOINT_TYPES:
        yield f"{name} has the type '{kind}': a URDF knows {', '.join(JOINT_TYPES)}"
    for end in ("parent", "child"):
        tag = joint.find(end)
        link = "" if tag is None else tag.get("link", "")
        if link not in links:
            yield (
                f"{name} has the {end} link '{link}', which the URDF does not have" if link else f"{name} has no {end}"
            )
    limit, dynamics = joint.find("limit"), joint.find("dynamics")
    if kind in ("revolute", "prismatic"):
        stated = {} if limit is None else limit.attrib
        lacking = [key for key in ("effort", "velocity") if key not in stated]
        if lacking:
            yield f"{name} has no <limit> with {' and '.join(lacking)}: a {kind} joint needs one"
    if dynamics is not None and not {"damping", "friction"} & set(dynamics.keys()):
        yield f"{name} has a <dynamics> with neither damping nor friction: give it one of them, or remove it"
