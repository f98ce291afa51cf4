"""Position columns that no name gives to a joint, beside joints without a position column.

A gimbal's log says pan and tilt where the URDF says yaw and pitch; a controller calls the axis below its arm E1. Such a
joint was taken as standing still, and nothing was called a guess. Where as many columns are left as joints, the columns
are paired with the joints: a sliding joint with a length, then by the likeness of the names, then in order. Nobody
knows that this is right, so it is a guess.

A column is left if its name is that of a column which has a joint, but for the word in which these columns differ: as
``enc_pan`` beside ``enc_roll``, and ``Axis_E1_pos`` beside ``Axis_A1_pos`` and ``Axis_A2_pos``. The positions of the
motors beside those of the joints, and the place of a base or of a tool, have other names.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Collection, Iterable, Mapping, Sequence

import numpy as np
from scipy.optimize import linear_sum_assignment

from frischid.logs.column_names import alike
from frischid.logs.column_words import unit_of
from frischid.logs.proposal import Proposal
from frischid.robot.robot import Robot

UNITS_OF_KIND = {True: {"mm", "m"}, False: {"rad", "deg", "°"}}
"""Units of a position of a sliding (True) and of a turning joint."""


def left_columns(names: Iterable[str], chosen: Mapping[str, str]) -> list[str]:
    """Columns without a joint whose names are like those that have one.

    Parameters
    ----------
    names : iterable of str
        All columns of a channel.
    chosen : mapping of str to str
        Joint -> column, as far as names tell.

    Examples
    --------
    >>> left_columns(["enc_pan", "enc_roll", "enc_tilt", "motor_roll"], {"roll": "enc_roll", "x": "enc_x"})
    ['enc_pan', 'enc_tilt']
    """
    taken = [_words(name) for name in chosen.values()]
    pairs = ((one, two) for one, two in itertools.combinations(taken, 2) if len(one) == len(two))
    own = {k for one, two in pairs for k in _places(one, two)}
    others = (name for name in names if name not in chosen.values())
    return [name for name in others if any(_like(_words(name), one, own) for one in taken)]


def _words(name: str) -> list[str]:
    return [word for word in re.split(r"[\W_]+", name) if word]


def _places(one: Sequence[str], two: Sequence[str]) -> list[int]:
    """Places of the words in which two names of the same length differ."""
    return [k for k, (a, b) in enumerate(zip(one, two, strict=True)) if a != b]


def _like(name: Sequence[str], one: Sequence[str], own: Collection[int]) -> bool:
    """Whether a name differs from another one in a single word, at a place that tells the joints (any if unknown)."""
    if len(name) != len(one):
        return False
    places = _places(name, one)
    return len(places) == 1 and (not own or places[0] in own)


def pair_left(names: Mapping[str, str], chosen: Mapping[str, str], robot: Robot, found: Proposal) -> dict[str, str]:
    """Rest of a column's name -> joint, of the columns that are left; a guess of the proposal says so.

    Parameters
    ----------
    names : mapping of str to str
        Column -> the rest of its name, of all position columns.
    chosen : mapping of str to str
        Joint -> column, as far as names tell.
    """
    missing = [joint for joint in robot.joints if joint not in chosen]
    left = left_columns(names, chosen)
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
    """Joint -> column of one channel, with the columns whose rest of the name is that of a paired position.

    Such a column must have a name like those of the other joints: a torque of another kind is none of this channel.
    """
    more = {paired[names[name]]: name for name in left_columns(names, chosen) if names[name] in paired}
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
