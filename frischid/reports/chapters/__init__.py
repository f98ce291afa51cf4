"""The report's seven chapters, from the verdict down to the data.

In comes a `Study`; the function `content` of each module arranges plain text and figures for its template. A new
chapter is a module here, a template of the same name, and a line in `CHAPTERS`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from markupsafe import Markup

from frischid.reports.chapters import data, fails, history, missing, parameters, torque, verdict
from frischid.reports.study import Study
from frischid.reports.templates import render


@dataclass(frozen=True)
class Chapter:
    """One chapter."""

    anchor: str
    """Name of its template and of its place on the page."""
    heading: str
    content: Callable[[Study, str], dict[str, Any]]
    """Makes the values for the template from a study and the name of the model's file."""

    def html(self, study: Study, model_path: str = "model.json") -> Markup:
        """The chapter as HTML, without its heading."""
        return render(f"{self.anchor}.html", self.content(study, model_path))


CHAPTERS = (
    Chapter("verdict", "The verdict", verdict.content),
    Chapter("torque", "Measured against model", torque.content),
    Chapter("fails", "Where it fails", fails.content),
    Chapter("missing", "Missing effects", missing.content),
    Chapter("history", "Steps of the model", history.content),
    Chapter("parameters", "Parameters", parameters.content),
    Chapter("data", "Data quality", data.content),
)
