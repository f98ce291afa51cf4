"""Names in text: lists in sentences (``a, b and c``), and names of files in terminals, TOML, YAML and comments.

A name comes from somebody's file and may hold any character. Nothing of a name may steer what reads the text.
"""

from __future__ import annotations

import json
import math
from collections.abc import Collection, Sequence
from typing import Any
from unicodedata import category

_STEERING = ("Cc", "Cf", "Cs")
"""Unicode's categories of control characters, marks of direction, and halves of characters."""


def listed(names: Sequence[str], last: str = "and") -> str:
    """Join names to ``a, b and c``, or with another word before the last one.

    >>> listed(["a", "b", "c"]), listed(["a", "b"], "or")
    ('a, b and c', 'a or b')
    """
    return f" {last} ".join(filter(None, (", ".join(names[:-1]), *names[-1:])))


def each_of(names: Sequence[str]) -> str:
    """List names as the subject of a verb in the singular; without names: ``the robot``.

    >>> each_of(["elbow", "wrist"])
    'each of elbow and wrist'
    """
    return f"each of {listed(names)}" if len(names) > 1 else listed(names) or "the robot"


def about(joints: Sequence[str], sentence: str) -> str:
    """A sentence about ``{joint}`` or ``{joints}``; several joints that each do the same are named in front.

    >>> about(["wrist_2", "wrist_3"], "the gear of {joint} plays")
    'wrist_2 and wrist_3: the gear of each joint plays'
    >>> about(["wrist_2", "wrist_3"], "one motor turns {joints}")
    'one motor turns wrist_2 and wrist_3'
    """
    if len(joints) < 2 or "{joint}" not in sentence:
        return sentence.format(joint=each_of(joints), joints=listed(joints))
    return f"{listed(joints)}: {sentence.format(joint='each joint', joints=listed(joints))}"


def counted(count: int, noun: str) -> str:
    """A number of things.

    Examples
    --------
    >>> from frischid.core.text import counted
    >>> counted(1, "joint"), counted(3, "joint")
    ('1 joint', '3 joints')
    """
    return f"{count} {noun}{'s' * (count != 1)}"


def rounded(value: float, error: float) -> str:
    """A value with its standard error: two digits of the error, and as many places of the value; no minus zero.

    Examples
    --------
    >>> from frischid.core.text import rounded
    >>> rounded(-0.00012, 0.00345), rounded(0.98, 0.0712)
    ('-0.0001 ± 0.0034', '0.980 ± 0.071')
    >>> rounded(-0.004, 0.11)
    '0.00 ± 0.11'
    """
    places = 2 if not 0 < error < math.inf else max(0, 1 - math.floor(math.log10(error)))
    return f"{round(value, places) + 0.0:.{places}f} ± {error:.{places}f}"


def percent(share: float, digits: int = 0) -> str:
    """A share as every surface writes it.

    Examples
    --------
    >>> from frischid.core.text import percent
    >>> percent(0.25), percent(0.0123, 1)
    ('25 %', '1.2 %')
    """
    return f"{100 * share:.{digits}f} %"


def sentence(text: str, names: Collection[str] = ()) -> str:
    """A text with a capital at its beginning, unless it begins with a name: of a joint, an effect, a file.

    The given names are known, and others by an underscore, a digit, a dot or a capital letter in their first word.

    Examples
    --------
    >>> from frischid.core.text import sentence
    >>> sentence("the model fits"), sentence("joint_spring on elbow was not added"), sentence("jointGripper slips")
    ('The model fits', 'joint_spring on elbow was not added', 'jointGripper slips')
    >>> sentence("lift z needs more torque", ["lift z"]), sentence("yaw slips", ["y"])
    ('lift z needs more torque', 'Yaw slips')
    """
    first = text.split(maxsplit=1)[0].rstrip(".,:;") if text.strip() else ""
    named = "_" in first or "." in first or any(x.isdigit() or x.isupper() for x in first[1:])
    named |= any(text.startswith(x) and not text[len(x) : len(x) + 1].isalnum() for x in names if x)
    return text if named else text[:1].upper() + text[1:]


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
    except RecursionError:
        return "tables that are nested too deep"
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


def one_line(text: str) -> str:
    r"""Show every character that cannot be printed as its number, new lines too: the text stays within a comment.

    Examples
    --------
    >>> from frischid.core.text import one_line
    >>> print(one_line("elbow\n[file]"))
    elbow\n[file]
    """
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def quoted(value: Any) -> str:
    r"""A text, a number or a list of them as TOML and YAML read it.

    JSON will not do: it writes a character beyond U+FFFF as two halves, which YAML does not join and TOML refuses.

    Examples
    --------
    >>> from frischid.core.text import quoted
    >>> print(quoted(["elbow\n", 1.5]))
    ["elbow\u000a", 1.5]
    """
    if isinstance(value, str):
        return f'"{"".join(map(_character, value))}"'
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(quoted, value))}]"
    return json.dumps(value)


def _character(c: str) -> str:
    if c.isprintable():
        return f"\\{c}" if c in '"\\' else c
    return f"\\u{ord(c):04x}" if ord(c) <= 0xFFFF else f"\\U{ord(c):08x}"
