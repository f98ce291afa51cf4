"""A check of generated code before it is written: Python must compile, and C's comments and brackets must be balanced.

Only the form is checked. The tests compare the torque that the code computes with the model's.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET

from frischid.errors import InputError

_PAIRS = {")": "(", "]": "[", "}": "{"}


def proofread(text: str, kind: str, target: str) -> None:
    """Check the form of generated text.

    Parameters
    ----------
    kind : {"C", "NumPy", "MJCF", "URDF"}
    target : str
        File that the text is meant for, for the message.

    Raises
    ------
    InputError
        The text is malformed; the message names the file and the place.
    """
    try:
        if kind == "NumPy":
            compile(text, target, "exec", dont_inherit=True)
        elif kind == "C":
            balanced(text)
        else:
            ET.fromstring(text)
    except (SyntaxError, ValueError) as error:  # ParseError of XML is a SyntaxError
        raise InputError(
            f"{target}: not written, because the generated {kind} text is malformed ({error}); please report this "
            "with the model file"
        ) from error


def balanced(text: str) -> None:
    """Check that every comment of C ends and all brackets are closed.

    Generated C has no string literals and no ``//`` comments, so a quote outside of a comment is an error.

    Raises
    ------
    ValueError
        The text is malformed; the message has the line.
    """
    opened: list[str] = []
    place = 0
    while place < len(text):
        if text.startswith("/*", place):
            place = _after_comment(text, place)
            continue
        one = text[place]
        if text.startswith("*/", place):
            raise ValueError(f"line {_line(text, place)} ends a comment that has not begun")
        if one in "\"'\\" or not (one.isascii() and (one.isprintable() or one == "\n")):
            raise ValueError(f"line {_line(text, place)} holds {one!r} outside of a comment")
        if one in _PAIRS.values():
            opened.append(one)
        elif one in _PAIRS and (not opened or opened.pop() != _PAIRS[one]):
            raise ValueError(f"line {_line(text, place)} closes a bracket that is not open")
        place += 1
    if opened:
        raise ValueError(f"{len(opened)} brackets do not close")


def _after_comment(text: str, start: int) -> int:
    end = text.find("*/", start + 2)
    if end < 0:
        raise ValueError(f"the comment of line {_line(text, start)} does not end")
    if "/*" in text[start + 2 : end]:
        raise ValueError(f"the comment of line {_line(text, start)} holds the start of another")
    return end + 2


def _line(text: str, place: int) -> int:
    return text.count("\n", 0, place) + 1
