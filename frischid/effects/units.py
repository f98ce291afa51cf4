"""Units of an effect's parameters, on joints that turn and on joints that slide.

A coefficient is a torque per unit of its column, ``[θ] = [τ] / [column]``. A turning joint has torques in N·m and
angles in rad, a sliding joint has forces in N and distances in m, so every unit comes as a pair.

Source: BIPM 2019, "The International System of Units (SI)", 9th edition.
"""

from __future__ import annotations

import numpy as np

from frischid.errors import UnknownNameError
from frischid.robot.robot import Robot

UnitPair = tuple[str, str]
"""A unit on a turning joint, and on a sliding joint."""

ANGLE_UNITS: UnitPair = ("rad", "m")
SPEED_UNITS: UnitPair = ("rad/s", "m/s")
TORQUE_PAIR: UnitPair = ("N·m", "N")
TIME_UNITS: UnitPair = ("s", "s")
TEMPERATURE_UNITS: UnitPair = ("°C", "°C")

TORQUE_UNITS: dict[str, UnitPair] = {
    "": TORQUE_PAIR,
    "velocity": ("N·m·s/rad", "N·s/m"),
    "velocity^2": ("N·m·s²/rad²", "N·s²/m²"),
    "velocity^3": ("N·m·s³/rad³", "N·s³/m³"),
    "acceleration": ("kg·m²", "kg"),
    "position": ("N·m/rad", "N/m"),
    "position^2": ("N·m/rad²", "N/m²"),
    "position^3": ("N·m/rad³", "N/m³"),
    "velocity kelvin": ("N·m·s/(rad·K)", "N·s/(m·K)"),
    "kelvin": ("N·m/K", "N/K"),
    "torque": ("1", "1"),
    "torque rate": ("s", "s"),
    "torque slope": ("rad", "m"),
    "torque slope torque": ("rad/(N·m)", "m/N"),
}
"""Quantity that a column holds -> units of its coefficient."""


def torque_unit(robot: Robot, joint: int, per: str | UnitPair = "") -> str:
    """Unit of a coefficient: a joint's torque (a force, when the joint slides) per unit of the column.

    Parameters
    ----------
    joint : int
        Index of the joint.
    per : str or pair of str
        Quantity that the column holds, one of `TORQUE_UNITS`; or the coefficient's own two units, on a turning joint
        and on a sliding joint.

    Raises
    ------
    UnknownNameError
        No such quantity.
    """
    if isinstance(per, str):
        if per not in TORQUE_UNITS:
            raise UnknownNameError(
                "quantity", per, TORQUE_UNITS, 'torque_unit; or give both units, such as ("N·m/A", "N/A")'
            )
        per = TORQUE_UNITS[per]
    return per[bool(robot.prismatic[joint])]


def is_number(value: object) -> bool:
    """Whether a parameter is a finite number. Parameters come from text and files, so they can be anything."""
    return isinstance(value, int | float) and not isinstance(value, bool) and bool(np.isfinite(value))
