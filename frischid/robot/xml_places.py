"""The elements of an XML file with their places: bytes, for edits that change nothing else, and lines, for messages.

An XML library that reads and writes a file would reorder attributes, drop comments or change white space. Here the
parser only finds the *places* of elements. Edits are then replacements of bytes.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from xml.parsers import expat

from frischid.errors import InputError

Span = tuple[int, int]
_TAG = re.compile(rb"""<(?:[^>"']+|"[^"]*"|'[^']*')*+>""")
"""A start tag up to its end; a ``>`` inside quotes does not end it."""
DEEPEST_ELEMENT = 500
"""Elements within each other. The reader of URDFs gives up between 400 and 1500; no robot comes near."""


@dataclass
class Element:
    """An element of a file."""

    name: str
    attributes: dict[str, str]
    tag: Span
    """Bytes of the start tag."""
    end: int
    """Place after the whole element."""
    line: int
    """Line of the start tag, from 1."""
    empty: bool
    """Whether the start tag is the whole element, as in ``<mass value="1"/>``."""
    children: list[Element] = field(default_factory=list)

    def child(self, name: str) -> Element | None:
        """First direct child of that name."""
        return next((c for c in self.children if c.name == name), None)

    def below(self) -> Iterator[tuple[Element, Element]]:
        """Every element below this one with its parent, (parent, element), in the order of the file."""
        for element in self.children:
            yield self, element
            yield from element.below()


def elements(data: bytes, source: str) -> Element:
    """The root element of a file.

    Parameters
    ----------
    source : str
        Name of the file in messages.

    Raises
    ------
    InputError
        The file is not XML, an element comes from an entity, so that it has no place of its own, or elements are nested
        too deep.

    Examples
    --------
    >>> from frischid.robot.xml_places import elements
    >>> data = b'<robot> <link name="arm"/> </robot>'
    >>> [(e.name, e.line, data[slice(*e.tag)]) for _, e in elements(data, "arm.urdf").below()]
    [('link', 1, b'<link name="arm"/>')]
    """
    parser = expat.ParserCreate(encoding="utf-8")
    top = Element("", {}, (0, 0), len(data), 0, False)
    open_elements = [top]

    def start(name: str, attributes: dict[str, str]) -> None:
        begin, line = parser.CurrentByteIndex, parser.CurrentLineNumber
        found = _TAG.match(data, begin)
        if found is None:  # the parser is at the reference
            raise InputError(f"{source}, line {line}: <{name}> comes from an entity; write the element in its place")
        if len(open_elements) > DEEPEST_ELEMENT:
            raise InputError(f"{source}, line {line}: elements are nested more than {DEEPEST_ELEMENT} deep")
        close = found.end()
        empty = data[close - 2 : close] == b"/>"
        element = Element(name, attributes, (begin, close), close, line, empty)
        open_elements[-1].children.append(element)
        open_elements.append(element)

    def end(_: str) -> None:
        element = open_elements.pop()
        if not element.empty:
            element.end = data.index(b">", parser.CurrentByteIndex) + 1

    parser.StartElementHandler, parser.EndElementHandler = start, end
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        raise InputError(f"{source}: not an XML file: {error}") from None
    return top.children[0]
