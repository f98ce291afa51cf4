"""The drives of a model's joints, as a table."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from rich.table import Table

from frischid.cli.pages.page import figure, table_of
from frischid.core.text import listed
from frischid.model.amperes import JointCurrents
from frischid.model.drive_parameters import DriveParameter, drive_parameters
from frischid.model.model import Model
from frischid.robot.robot import Robot

TITLES = {
    "torque_per_ampere": "gain",
    "stiffness": "kp",
    "damping": "kd",
    "delay": "delay",
    "armature": "armature",
    "viscous": "viscous",
    "coulomb": "Coulomb",
    "effort_limit": "limit",
}


def drives(model: Model) -> Table:
    """One row per joint; a value with its 95 % range, and a word where the logs leave it open."""
    values = {(x.joint, x.quantity): x for x in drive_parameters(model)}
    there = [q for q in TITLES if any(quantity == q for _, quantity in values)]
    table = table_of(
        "drive of", *(f"{TITLES[q]} {_units(x.unit for x in values.values() if x.quantity == q)}" for q in there)
    )
    for joint in model.joints:
        table.add_row(joint, *(_cell(values.get((joint, q))) for q in there))
    return table


def left_open(model: Model) -> list[str]:
    """One sentence that names the joints whose values the logs leave open; none where every value is known."""
    found: dict[str, list[str]] = {}
    for x in drive_parameters(model):
        if x.known == "open":
            friction = " friction" if x.quantity in ("viscous", "coulomb") else ""
            found.setdefault(TITLES[x.quantity] + friction, []).append(x.joint)
    said = "; ".join(f"{title} of {listed(joints)}" for title, joints in found.items())
    return [f"these logs leave values of drives open: {said}"] if said else []


def _units(found: Iterable[str]) -> str:
    """The unit of a column; both, where some joints turn and others slide."""
    return " or ".join(dict.fromkeys(found))


def _cell(x: DriveParameter | None) -> str:
    if x is None:
        return ""
    if x.known == "given":
        return figure(x.value)
    if x.known == "assumed":
        return f"{figure(x.value)} assumed"
    ends = f"{figure(x.lower)} … {figure(x.upper)}" if np.isfinite(x.upper) else f"at least {figure(x.lower)}"
    return f"{figure(x.value)} ({ends})" + ("" if x.known == "identified" else f" {x.known}")


def amperes(found: Sequence[JointCurrents], robot: Robot) -> Table:
    """The current of each joint, in amperes."""
    slides = dict(zip(robot.joints, robot.prismatic.tolist(), strict=True))
    viscous, rotor = (_units(f"{unit}/{'m' if slides[x.joint] else 'rad'}" for x in found) for unit in ("A·s", "A·s²"))
    table = table_of("current of", f"viscous {viscous}", "Coulomb A", f"rotor {rotor}", "to hold still A")
    for x in found:
        low, high = x.holding
        pairs = (_pair(x.viscous), _pair(x.coulomb), _pair(x.armature))
        table.add_row(x.joint, *pairs, f"{figure(low)} … {figure(high)}")
    return table


def _pair(x: tuple[float, float] | None) -> str:
    return "" if x is None else f"{figure(x[0])} ± {x[1]:.2g}"


MEANING = (
    "In brackets: the 95 % range. roughly: the range is wider than ± 5 % of the value. open: the logs do not "
    "determine the value; it may be anywhere in the range. in a sum: the logs determine only a sum. A sum with values "
    "of the links is divided as in the URDF (--parameters lists these sums); of an open kd, only kd + viscous is "
    "known (--json has this sum, with its range). as a ratio: the logs determine value/kp better than the value "
    "(--json has the ratio). assumed: nobody named the value, and it counts as zero. All values grow in proportion to "
    "kp. Where the drive damps the joint's own velocity, the logs determine only kd + viscous friction, and viscous "
    "is this sum less kd"
)
"""Explanation below the table, for a model with a controller."""
