"""Lists of names in sentences, for the messages of every stage: ``a, b and c``."""

from __future__ import annotations

from collections.abc import Sequence
from unicodedata import category

_STEERING = ("Cc", "Cf", "Cs")
"""Unicode's categories of control characters, marks of direction, and halves of characters."""


def listed(names: Sequence[str]) -> str:
    """Join names to ``a, b and c``.

    >>> listed(["a", "b", "c"])
    'a, b and c'
    """
    return " and ".join(filter(None, (", ".join(names[:-1]), *names[-1:])))


def each_of(names: Sequence[str]) -> str:
    """List names as the subject of a verb in the singular; without names: ``the robot``.

    >>> each_of(["elbow", "wrist"])
    'each of elbow and wrist'
    """
    return f"each of {listed(names)}" if len(names) > 1 else listed(names) or "the robot"


def shortened(value: object, most: int = 60) -> str:
    """A value as Python writes it, cut after `most` letters: nobody reads a thousand digits.

    Examples
    --------
    >>> from frischid.core.text import shortened
    >>> shortened("yaw"), shortened(10**400, most=8)
    ("'yaw'", '10000000...')
    """
    try:
        text = repr(value)
    except ValueError:  # Python refuses to write out such a whole number
        return "a number of thousands of digits"
    return text if len(text) <= most else f"{text[:most]}..."


def printable(text: str) -> str:
    r"""Show control characters, which steer a terminal, as ``\x1b``; new lines and tabs stay.

    Examples
    --------
    >>> from frischid.core.text import printable
    >>> print(printable("elbow\x1b]0;owned\x07"))
    elbow\x1b]0;owned\x07
    """
    return "".join(
        c.encode("unicode_escape").decode() if category(c) in _STEERING and c not in "\n\t" else c for c in text
    )
