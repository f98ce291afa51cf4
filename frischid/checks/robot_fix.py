"""The robot's description corrected where a check found wrong kinematics, instead of the log's columns.

A check says how the joint of the URDF stands when the log says q: at s q + δ. Then the URDF describes the log if the
joint's axis becomes s times the axis, and its origin is turned by δ about the axis,

    T(s q + δ) = T₀ R(u, δ) R(s u, q).

The torque about the new axis is s times the torque about the old one. So a turned axis is the robot's fault only if the
torque is turned too; if the positions alone are, the log's column is wrong, and no URDF helps. Two joints whose
positions and torques are exchanged exchange their names.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from frischid.checks.faults import Fix
from frischid.errors import InputError
from frischid.robot.robot import Robot
from frischid.robot.urdf_edit import UrdfText


def corrected_urdf(robot: Robot, fixes: Sequence[Fix]) -> tuple[str, tuple[str, ...]]:
    """The robot's URDF with the wrong kinematics of a check corrected.

    Parameters
    ----------
    fixes : sequence of (str, str, object)
        Entries of a mapping file that undo the faults, such as `LogReport.fix`.

    Returns
    -------
    str
        Text of the URDF, in which only axes, origins or names of the wrong joints differ; empty if no joint is wrong.
    tuple of str
        What was corrected, one sentence each.

    Raises
    ------
    InputError
        The robot was not read from a URDF.

    Examples
    --------
    >>> import frischid as fr
    >>> from frischid.checks import corrected_urdf
    >>> text, said = corrected_urdf(fr.Robot.load("planar2"), [("joint2", "offset", 1.570796)])
    >>> said
    ('joint2: its zero is moved by 90°',)
    """
    moved: dict[str, tuple[float, float]] = {}
    names: dict[str, str] = {}
    said = []
    for joint in robot.joints:
        own = [(key, value) for name, key, value in fixes if name == joint]
        sign = float(np.prod([value for key, value in own if key == "sign"]))
        torque = float(np.prod([value for key, value in own if key == "torque_sign"]))
        offset = float(sum(value for key, value in own if key == "offset"))
        if sign > 0 or torque > 0:
            if sign < 0 or offset:
                moved[joint] = (sign, offset)
            said += [f"{joint}: its axis is reversed"] if sign < 0 else []
            angle = f"{offset:.4g} m" if robot.prismatic[robot.joints.index(joint)] else f"{np.rad2deg(offset):.4g}°"
            said += [f"{joint}: its zero is moved by {angle}"] if offset else []
        columns = dict(own)
        if "q" in columns and columns.get("tau") == columns["q"]:
            names[joint] = str(columns["q"])
    said += [f"{a} and {b} exchange their names" for a, b in names.items() if a < b]
    if not moved and not names:
        return "", ()
    if not robot.urdf.strip():
        raise InputError(f"{robot.source}: only a URDF can be corrected; change the file by hand: {'; '.join(said)}")
    return UrdfText(robot.urdf).with_joints(moved, names), tuple(said)
