"""Position columns that no name gives to a joint, beside joints without a position column.

A gimbal's log says pan and tilt where the URDF says yaw and pitch; a controller calls the axis below its arm E1. Such a
joint was taken as standing still, and nothing was called a guess. Where as many columns are left as joints, the columns
are paired with the joints: a sliding joint with a length, then by the likeness of the names, then in order. Nobody
knows that this is right, so it is a guess.

A column is left if its family has no joint, or has fewer columns than joints lack one. A whole second set of positions,
such as those of the motors beside those of the joints, is none.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.optimize import linear_sum_assignment

from frischid.logs.column_names import alike, families
from frischid.logs.column_words import unit_of
from frischid.logs.proposal import Proposal
from frischid.robot.robot import Robot

UNITS_OF_KIND = {True: {"mm", "m"}, False: {"rad", "deg", "°"}}
"""Units of a position of a sliding (True) and of a turning joint."""


def left_columns(names: Mapping[str, str], chosen: Mapping[str, str], joints: Sequence[str]) -> list[str]:
    """Position columns that are left beside joints without one.

    Parameters
    ----------
    names : mapping of str to str
        Column -> the rest of its name, of all position columns.
    chosen : mapping of str to str
        Joint -> column, as far as names tell.
    joints : sequence of str
        Joints of the robot.

    Examples
    --------
    >>> names = {"enc_pan": "pan", "enc_roll": "roll", "enc_tilt": "tilt"}
    >>> left_columns(names, {"roll": "enc_roll"}, ("yaw", "roll", "pitch"))
    ['enc_pan', 'enc_tilt']
    """
    missing, taken = len(joints) - len(chosen), set(chosen.values())
    own = [f for f in families(names) if taken & set(f) or len(f) <= missing]
    return [name for family in own for name in family if name not in taken]


def pair_left(names: Mapping[str, str], chosen: Mapping[str, str], robot: Robot, found: Proposal) -> dict[str, str]:
    """Rest of a column's name -> joint, of the columns that are left; a guess of the proposal says so.

    Parameters
    ----------
    names, chosen
        As in `left_columns`.
    """
    missing = [joint for joint in robot.joints if joint not in chosen]
    left = left_columns(names, chosen, robot.joints)
    pairs = _pairs(names, left, missing, robot)
    if pairs:
        said = ", ".join(f"{name} for {joint}" for joint, name in pairs.items())
        found.guesses.append(f"the only position columns left, for the only joints without one: {said}")
    elif left and missing:
        found.guesses.append(
            f"{', '.join(missing)} without a position column, beside columns of positions that are not used: "
            f"{', '.join(left)}; write which is which"
        )
    return {names[name]: joint for joint, name in pairs.items()}


def with_paired(names: Mapping[str, str], chosen: Mapping[str, str], paired: Mapping[str, str]) -> dict[str, str]:
    """Joint -> column of one channel, with the columns whose rest of the name is that of a paired position."""
    taken = set(chosen.values())
    more = {paired[rest]: name for name, rest in names.items() if rest in paired and name not in taken}
    return {**more, **chosen}


def _pairs(names: Mapping[str, str], left: Sequence[str], missing: Sequence[str], robot: Robot) -> dict[str, str]:
    """Joint -> column, for as many columns as joints; empty where the numbers or the units do not agree."""
    if not left or len(left) != len(missing):
        return {}
    slides = dict(zip(robot.joints, robot.prismatic, strict=True))
    fits = np.array([[_fits(name, slides[joint]) for joint in missing] for name in left])
    near = np.array([[alike(names[name], joint) for joint in missing] for name in left])
    order = 1e-3 * np.eye(len(left))  # of names that are equally unlike, the order decides
    rows, columns = linear_sum_assignment(np.where(fits, -near - order, len(left) + 1.0))
    return {missing[j]: left[i] for i, j in zip(rows, columns, strict=True)} if fits[rows, columns].all() else {}


def _fits(name: str, slides: bool) -> bool:
    """Whether the unit in a column's name can be that of a joint's position."""
    return unit_of(name)[0] not in UNITS_OF_KIND[not slides]
