"""A check of the numbers of a URDF before Pinocchio's parser reads them.

    number = [+-] digits [. digits] [e [+-] digits]

If Pinocchio's parser cannot read one number of an inertial, it drops the whole inertial and only prints a message: the
link then weighs nothing. So every number of the dynamics is read here first. A number that cannot be read, is not
finite or is above `LARGEST_QUANTITY` is an error that names its line. A mass must not be negative.

An XML parser turns tabs and line breaks of an attribute into spaces, and entities into text. Pinocchio's parser does
neither. So the numbers must stand in the file itself as they are read.

Format: URDF, https://wiki.ros.org/urdf/XML.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping

from frischid.errors import InputError
from frischid.robot.xml_places import Element, elements

NUMBER_PATTERN = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)
"""A number that Pinocchio's parser can read: plain digits, without a space or a comma."""

LARGEST_QUANTITY = 1e9
"""Largest mass, length, inertia or angle of a robot, in SI units. Above it, sums of squares and products leave double
precision, and compiled solvers got infinities that they do not expect."""

Quantities = Mapping[str, int]
"""Attribute -> count of numbers in the attribute."""

_POSE: Quantities = {"xyz": 3, "rpy": 3}
_NUMBERS: Mapping[tuple[str, ...], Quantities] = {
    ("link", "inertial", "origin"): _POSE,
    ("link", "inertial", "mass"): {"value": 1},
    ("link", "inertial", "inertia"): dict.fromkeys(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), 1),
    ("joint", "origin"): _POSE,
    ("joint", "axis"): {"xyz": 3},
    ("joint", "limit"): dict.fromkeys(("lower", "upper", "velocity", "effort"), 1),
    ("joint", "dynamics"): {"damping": 1, "friction": 1},
    ("joint", "mimic"): {"multiplier": 1, "offset": 1},
}
"""Elements below ``<robot>`` whose numbers decide the dynamics."""
_REQUIRED = {("link", "inertial", "mass"), ("link", "inertial", "inertia")}
"""Elements in which no number may be missing, because the parser would then drop the whole inertial."""


def check_numbers(text: str, source: str) -> None:
    """Refuse a URDF with an unreadable number or a negative mass.

    Parameters
    ----------
    text : str
        A URDF that an XML parser has accepted.
    source : str
        Its name in messages.

    Raises
    ------
    InputError
        A number of an inertial or of a joint is unreadable, not finite, too large or missing, or a mass is negative.
        The message names the file, the line, the element and the value.

    Examples
    --------
    >>> from frischid.robot.urdf_numbers import check_numbers
    >>> check_numbers('<robot><link name="arm"><inertial><mass value="10,5"/></inertial></link></robot>', "arm.urdf")
    Traceback (most recent call last):
    frischid.errors.InputError: arm.urdf, line 1: value="10,5" of <mass> of link 'arm' is not a finite number; ...
    """
    data = text.encode()
    for part in elements(data, source).children:
        _check_below(part, (part.name,), f"{part.name} '{part.attributes.get('name', '')}'", data, source)


def _check_below(parent: Element, path: tuple[str, ...], owner: str, data: bytes, source: str) -> None:
    """Check the elements below a link or a joint, `owner` in words; `path` leads to the parent."""
    for element in parent.children:
        place = (*path, element.name)
        if place in _NUMBERS:
            said = f"{source}, line {element.line}", f"<{element.name}> of {owner}"
            _check_element(_NUMBERS[place], element.attributes, place in _REQUIRED, said)
            _check_written(_NUMBERS[place], element.attributes, data[slice(*element.tag)].decode(), said)
        _check_below(element, place, owner, data, source)


def _check_element(
    quantities: Quantities, attributes: Mapping[str, str], required: bool, place: tuple[str, str]
) -> None:
    """Check the numbers of one element; `place` is the line and the element in words."""
    line, element = place
    for name, count in quantities.items():
        written = attributes.get(name)
        if written is None:
            if required:
                raise InputError(f"{line}: {element} has no {name}; the inertial would be left out: write the number")
            continue
        parts = [written] if count == 1 else written.split()
        said = f'{line}: {name}="{written}" of {element}'
        if len(parts) != count or not all(map(_is_number, parts)):
            expected = "a finite number" if count == 1 else f"{count} finite numbers with spaces between them"
            raise InputError(f"{said} is not {expected}; write digits with a point, for example 10.5, and no more")
        if not element.startswith("<limit>") and any(abs(float(part)) > LARGEST_QUANTITY for part in parts):
            raise InputError(
                f"{said} is above {LARGEST_QUANTITY:g}, which no robot has; correct the number or its unit"
            )
        if element.startswith("<mass>") and float(written) < 0:
            raise InputError(f"{said} is negative; a mass is zero or more: correct the number")


def _check_written(quantities: Quantities, attributes: Mapping[str, str], tag: str, place: tuple[str, str]) -> None:
    """Check that the text of a start tag holds the numbers that an XML parser reads there."""
    for name in quantities.keys() & attributes.keys():
        if not re.search(rf"\s{name}\s*=\s*([\"']){re.escape(attributes[name])}\1", tag):
            line, element = place
            raise InputError(
                f'{line}: {name}="{attributes[name]}" of {element} is written with tabs, line breaks or entities, '
                "which parsers of URDF do not read; write digits, with spaces between numbers"
            )


def _is_number(text: str) -> bool:
    return NUMBER_PATTERN.fullmatch(text) is not None and math.isfinite(float(text))
