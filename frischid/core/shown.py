"""A result in a notebook: a page, a figure and a table, made only when they are asked for.

A result is data and knows nothing of pages. This class is the one hook: it hands the result to
`frischid.reports.notebook`, which is loaded then and not before.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any


class Shown:
    """A result with ``_repr_html_``, ``plot`` and ``to_frame``."""

    def _repr_html_(self) -> str:
        """The first screen of the report, for notebooks."""
        return str(_maker().page_of(self))

    def plot(self) -> Any:
        """The figure that says most of this result."""
        return _maker().figure_of(self)

    def to_frame(self, backend: str = "auto") -> Any:
        """The table of this result as a data frame.

        Parameters
        ----------
        backend : str
            ``"pandas"``, ``"polars"`` or ``"pyarrow"``; ``"auto"`` takes the first of them that is installed.

        Raises
        ------
        InputError
            There is no such backend, or it is not installed.
        """
        return _maker().frame_of(self, backend)


def _maker() -> Any:
    return import_module("frischid.reports.notebook")
