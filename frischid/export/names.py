"""Names and numbers in generated code: no text of a robot's files can become code.

Names of robots and joints come from files of other people and may hold any character: a new line, ``*/``, a backslash,
quotes. Generated code has such names in four places only, and each place has its function here:

- in an identifier: `identifier`, `identifiers`;
- in a comment or a docstring: `comment`;
- in an attribute of XML: `attribute`;
- in a cell of a CSV file: `cell`.

`number` writes numbers. Nothing else from a file reaches generated code.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Sequence
from xml.sax.saxutils import quoteattr

import numpy as np

from frischid.core.text import one_line
from frischid.errors import InputError

# Characters that together end or open a comment or a docstring, or form a trigraph of C: a space separates them.
_TOGETHER = re.compile(r"""\*(?=/)|/(?=\*)|"(?=")|'(?=')|\?(?=\?)""")
# Characters that XML 1.0 cannot hold, even as a character reference (https://www.w3.org/TR/xml, production 2).
_NOT_XML = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def identifier(name: str) -> str:
    """Turn a name into an identifier of C and Python: ASCII letters, digits and underscores.

    Parameters
    ----------
    name : str
        Any text, empty too.

    Returns
    -------
    str
        Starts with a letter. Different names may give the same identifier; see `identifiers`.
    """
    word = re.sub(r"[^A-Za-z0-9]+", "_", name).strip("_")
    return word if re.match(r"[A-Za-z]", word) else f"x_{word}".rstrip("_")


def identifiers(names: Sequence[str]) -> list[str]:
    """Give each of several names an identifier of its own.

    Returns
    -------
    list of str
        In the order of the names. A name whose identifier is already taken gets a number at its end.
    """
    found: list[str] = []
    for name in names:
        word = identifier(name)
        spellings = itertools.chain([word], (f"{word}_{k}" for k in itertools.count(2)))
        found.append(next(spelling for spelling in spellings if spelling not in found))
    return found


def comment(text: str) -> str:
    """Write a text so that it can stand in a comment of C or Python, or in a docstring, on one line.

    Characters that cannot be printed and backslashes become their number, ``<U+000A>``; characters that would end the
    comment are separated, ``* /``.
    """
    return _TOGETHER.sub(r"\g<0> ", _numbered(text, lambda c: not c.isprintable() or c == "\\"))


def attribute(text: str) -> str:
    """Write a text as a quoted attribute of XML; characters that XML cannot hold become their number."""
    return quoteattr(_numbered(text, lambda c: _NOT_XML.match(c) is not None))


def cell(text: str) -> str:
    """Write a name as a cell of a CSV file: a spreadsheet would run a name such as ``=HYPERLINK(...)`` as a formula.

    Such a name gets an apostrophe, after which spreadsheets read text. A character that cannot be printed, a new line
    too, becomes its number. JSON has every name as it is.
    """
    text = one_line(text)
    return f"'{text}" if text.startswith(("=", "+", "-", "@")) else text


def number(value: float) -> str:
    """Write a number so that C and Python read the same number again.

    Raises
    ------
    InputError
        The number is infinite or not a number.
    """
    if not np.isfinite(value):
        raise InputError(f"the model has the number {value}, which cannot be written as code; identify the model again")
    return repr(float(value))


def _numbered(text: str, chosen: Callable[[str], bool]) -> str:
    return "".join(f"<U+{ord(c):04X}>" if chosen(c) else c for c in text)
