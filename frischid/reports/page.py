"""The report: one HTML file that can be sent to a colleague and opens offline.

The chapters, in order: the verdict, measured and predicted torque, where the model fails, missing effects, how the
error fell, parameters, data. The figures are those of `frischid.figures`. plotly.js is embedded once, and a content
security policy in the page forbids every address outside the file.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal

from markupsafe import Markup

from frischid.core.files import check_writable, write_text
from frischid.core.text import counted, listed
from frischid.core.types import Array
from frischid.core.version import __version__
from frischid.diagnosis.result import Diagnosis
from frischid.logs.given import Logs, as_logs
from frischid.logs.mapping import MappingLike
from frischid.model.model import Model
from frischid.model.model_digest import text_of
from frischid.reports.chapters import CHAPTERS
from frischid.reports.study import Study, study
from frischid.reports.templates import packed_plotly, render


def report(
    model: Model | Mapping[str, Model],
    logs: Logs,
    path: str | Path,
    *,
    valid: Logs = (),
    diagnosis: Diagnosis | None = None,
    situation: Literal["auto", "always", "changed"] = "auto",
    truth: Array | None = None,
    model_path: str = "model.json",
    progress: Callable[[str], None] = lambda _: None,
    mapping: MappingLike = None,
) -> Study:
    """Write a report on a model along some logs.

    Parameters
    ----------
    model : Model or mapping of str to Model
        Models by name: the report is on the first, with the errors and curves of the others beside.
    logs : sequence of Log, Recording or data frame, or one data frame
        At least one. The model's history says which of them it was fitted to. Of a long one, figures show evenly
        spread stretches; errors are those of all samples.
    path : str or Path
        The HTML file; it appears under this name only when complete.
    valid : sequence of Log, Recording or data frame, or one data frame
        Test logs in any case: the error at the top is that on these logs, and they select no effect.
    diagnosis : Diagnosis, optional
        Diagnosis of this model on these logs, if there is one already.
    situation : {"auto", "always", "changed"}
        Whether the robot changed since it was identified, as in `frischid.diagnosis.diagnosis.diagnose`.
    truth : ndarray, shape (p,), optional
        True base parameters of a simulated robot.
    model_path : str
        Name of the model's file in the commands that the page proposes.
    progress : callable
        Called with the name of each step of the work.
    mapping : LogMap, mapping or path of a TOML file, optional
        Names and units of the columns of data frames.

    Returns
    -------
    Study
        The content of the page.

    Raises
    ------
    InputError
        A log lacks a joint or its torque, a log is given twice, or the file cannot be written.

    Examples
    --------
    >>> import frischid as fr
    >>> robot = fr.Robot.load("planar2")
    >>> log = fr.simulate(robot, fr.random_fourier(robot, 10, seed=1), rate=50, noise=fr.Noise(tau=0.01))
    >>> model = fr.identify(robot, [log], recursion="none").model
    >>> diagnosis = fr.diagnose(model, [log], effects=["joint_spring"])  # leave it out to try the whole catalogue
    >>> shown = fr.report(model, [log], "report.html", diagnosis=diagnosis)
    >>> shown.warnings()[0]
    'Every log here was used to fit the model: its error on new motion may be larger.'
    """
    check_writable(path)
    first = next(iter(model.values()), None) if isinstance(model, Mapping) else model
    joints = first.robot.joints if isinstance(first, Model) else ()
    logs, valid = as_logs(logs, joints, mapping), as_logs(valid, joints, mapping, "valid")
    found = study(model, logs, valid=valid, diagnosis=diagnosis, situation=situation, truth=truth, progress=progress)
    progress("writing the page (stage 5 of 5)")
    write_text(Path(path), page(found, model_path))
    return found


def page(found: Study, model_path: str = "model.json") -> str:
    """One self-contained HTML page.

    Parameters
    ----------
    model_path : str
        Name of the model's file in the commands the page proposes.

    Returns
    -------
    str
        HTML that refers to nothing outside itself.
    """
    severities = [alarm.severity for alarm in found.headline.alarms]
    counts = {"alarm": severities.count("severe"), "doubt": severities.count("doubt"), "warning": len(found.warnings())}
    told = [counted(n, word) for word, n in counts.items() if n]
    alone = replace(found.model, previous=None)  # every earlier step would be as large as the model
    values = {
        "robot": found.model.robot.name,
        "warnings": listed(told) or "no warnings",
        "made": _made(found),
        "chapters": [{"anchor": c.anchor, "heading": c.heading, "html": c.html(found, model_path)} for c in CHAPTERS],
        "plotly": packed_plotly(),
        "model": Markup(text_of(alone.to_dict(), Path(model_path).parent).replace("<", "\\u003c")),
        "steps_left_out": found.model.previous is not None,
        "model_name": Path(model_path).name,
    }
    return render("page.html", values)


def _made(found: Study) -> str:
    names = ", ".join(Path(log.source).name for log in found.logs)
    day = datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC")
    return f"{names} · frischid {__version__} · {day}"
