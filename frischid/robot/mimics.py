"""Mimic joints: joints that follow another one.

    q_mimic = factor · q_leader + shift

A leader may be a mimic joint itself. The rules are resolved until every leader is an independent joint, so that
``q_full = G q + g`` with one non-zero entry per row of G; virtual work then gives the torque ``τ = Gᵀ τ_full``.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from functools import lru_cache
from typing import NamedTuple

from frischid.errors import InputError


class MimicRule(NamedTuple):
    """Position of a mimic joint: ``factor · q_leader + shift``."""

    leader: str
    """The independent joint that the mimic joint follows."""
    factor: float
    shift: float
    """rad (m)."""


def mimic_rules(urdf: str) -> dict[str, MimicRule]:
    """Read the mimic joints of a URDF, chains of mimics resolved to their independent leader.

    Parameters
    ----------
    urdf : str
        Text of a URDF.

    Returns
    -------
    dict of str to MimicRule
        By name of the mimic joint.

    Raises
    ------
    InputError
        Mimic joints follow one another in a circle, or a leader is not a moving joint.

    Examples
    --------
    >>> from frischid.robot.mimics import mimic_rules
    >>> mimic_rules('''<robot name="gripper"><joint name="left" type="prismatic"/>
    ... <joint name="right" type="prismatic"><mimic joint="left" multiplier="-1" offset="0.02"/></joint></robot>''')
    {'right': MimicRule(leader='left', factor=-1.0, shift=0.02)}
    """
    return dict(_resolved(urdf))


@lru_cache(maxsize=16)
def _resolved(urdf: str) -> dict[str, MimicRule]:
    """The rules, read once for all copies of a robot; they must not be changed."""
    direct = {}
    joints = ET.fromstring(urdf).findall("joint")
    for joint in joints:
        tag = joint.find("mimic")
        if tag is not None and joint.get("type") != "fixed":
            rule = MimicRule(str(tag.get("joint")), float(tag.get("multiplier", 1)), float(tag.get("offset", 0)))
            direct[str(joint.get("name"))] = rule
    resolved = {}
    for name, (leader, factor, shift) in direct.items():
        seen = {name}
        while leader in direct:
            if leader in seen:
                raise InputError(
                    f"the mimic joints {', '.join(sorted(seen))} follow one another in a circle; remove one <mimic> "
                    "from the URDF"
                )
            seen.add(leader)
            leader, inner, more = direct[leader]
            factor, shift = factor * inner, factor * more + shift
        if not any(j.get("name") == leader and j.get("type") != "fixed" for j in joints):
            raise InputError(
                f"mimic joint '{name}' follows '{leader}', which is not a moving joint of the URDF; correct its <mimic>"
            )
        resolved[name] = MimicRule(leader, factor, shift)
    return resolved
