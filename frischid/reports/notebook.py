"""Results in a notebook: the first screen of the report as HTML, one figure, one table.

`frischid.core.shown.Shown` hands every result here. Tables are columns of plain values first, from which both the HTML
and the data frame are made.
"""

from __future__ import annotations

from functools import singledispatch
from importlib.util import find_spec
from typing import Any, Literal, get_args

import narwhals as nw
import numpy as np
import plotly.graph_objects as go
from markupsafe import Markup

from frischid import figures
from frischid.diagnosis.clause import missing
from frischid.diagnosis.findings import Finding
from frischid.diagnosis.motion_space import MotionDiagnosis
from frischid.diagnosis.result import Diagnosis
from frischid.errors import InputError
from frischid.figures.robot_picture import robot_picture
from frischid.figures.style import BLUE, GREEN, MEASURED, number
from frischid.forward.motion_error import MotionComparison
from frischid.forward.output_error import OutputError
from frischid.model.comparison import Comparison
from frischid.model.headline import Headline, headline_of
from frischid.model.identification import Identification
from frischid.model.model import Model
from frischid.motions.plan import Plan
from frischid.reports.chapters.verdict import rungs
from frischid.reports.templates import render

Backend = Literal["pandas", "polars", "pyarrow"]
BACKENDS: tuple[Backend, ...] = get_args(Backend)
ROWS_SHOWN = 12
FINDINGS_DRAWN = 10
NEXT: dict[type, tuple[str, str]] = {
    Identification: ("what is missing?", "fr.diagnose(identification.model, logs)"),
    Model: ("how good is the model on another log?", "fr.compare(model, [log])"),
    Comparison: ("what is missing?", "fr.diagnose(model, logs)"),
    Plan: ("record this motion, and identify", 'fr.identify(robot, [fr.read_log("log.csv", robot.joints)])'),
    MotionComparison: (
        "which effect changes the motion?",
        "fr.simulate_findings(model, fr.diagnose(model, logs), logs)",
    ),
    OutputError: ("how far does the simulated motion go?", "fr.compare_simulated(fitted.model, logs)"),
}
"""Result -> what most users want next, in words and as the line of Python; findings have a line of their own."""


def page_of(result: Any) -> Markup:
    """HTML of a result: its headline and picture where there is an error, and its table."""
    error, model = _error_of(result), _model_of(result)
    whole = columns_of(result)
    columns = {heading: x for heading, x in whole.items() if not _on_request(result, heading)}
    rows = list(zip(*columns.values(), strict=True))
    values = {
        "title": repr(result),
        "error": error,
        "ladder": [] if error is None else rungs(error),
        "missing": missing(result) if isinstance(result, Diagnosis) else "",
        "picture": Markup(_picture(model, error)) if model is not None and error is not None else "",
        "headings": list(columns),
        "rows": [[_text(x) for x in row] for row in rows[:ROWS_SHOWN]],
        "more": [
            f"{count} more {what}{'s' * (count > 1)}"
            for count, what in ((len(rows) - ROWS_SHOWN, "row"), (len(whole) - len(columns), "column"))
            if count > 0
        ],
        "next": next_of(result),
    }
    return render("notebook.html", values)


def _on_request(result: Any, heading: str) -> bool:
    """Whether a column is only in ``.to_frame()``: what an expression says already, bounds, and one value for all."""
    if isinstance(result, Diagnosis):
        return heading == "error before"
    fitted = isinstance(result, Model | Identification | OutputError)
    return fitted and heading in ("joint", "effect", *_bounds(result))


def _bounds(result: Model | Identification | OutputError) -> list[str]:
    bounds = (result if isinstance(result, Model) else result.model).bounds
    return [f"{name} {side}" for name in bounds for side in ("lower", "upper")]


@singledispatch
def next_of(result: Any) -> tuple[str, str]:
    """The next step that most users want of a result: in words, and the line of Python."""
    return NEXT[type(result)]


@next_of.register
def _after_diagnosis(result: Diagnosis) -> tuple[str, str]:
    for k, finding in enumerate(result.findings):
        if finding.significant and finding.members:
            return _added(finding, f"diagnosis.findings[{k}]")
    return NEXT[Model]


@next_of.register
def _after_motion_diagnosis(result: MotionDiagnosis) -> tuple[str, str]:
    for k, simulated in enumerate(result.findings):
        finding = simulated.finding
        if not simulated.refused and simulated.ratio < 1.0 and finding.significant and finding.members:
            return _added(finding, f"simulated.findings[{k}].finding")
    return "how far does the simulated motion go?", "fr.compare_simulated(model, logs)"


def _added(finding: Finding, it: str) -> tuple[str, str]:
    return f"add {finding.effect} and see the error", f"fr.add(model, {it}.members, logs, finding={it})"


@singledispatch
def columns_of(result: Any) -> dict[str, list[Any]]:
    """The table of a result, as columns of plain values."""
    raise InputError(f"a {type(result).__name__} has no table")


@columns_of.register
def _of_model(result: Model) -> dict[str, list[Any]]:
    e = result.estimate
    found: dict[str, list[Any]] = {
        "parameter": [c.name for c in e.columns],
        "stands for": list(result.expressions),
        "unit": [c.unit for c in e.columns],
        "joint": [c.joint for c in e.columns],
        "effect": [c.effect for c in e.columns],
        "value": e.theta.tolist(),
        "standard error": e.stderr.tolist(),
    }
    if e.from_data is not None:
        found["share from logs"] = e.from_data.tolist()
    for name, box in result.bounds.items():
        found |= {f"{name} lower": box.lower.tolist(), f"{name} upper": box.upper.tolist()}
    return found


@columns_of.register
def _of_fit(result: Identification | OutputError) -> dict[str, list[Any]]:
    return columns_of(result.model)


@columns_of.register
def _of_comparison(result: Comparison) -> dict[str, list[Any]]:
    joints = list(result.joints)
    fields = ("name", "nrmse", "rmse", "noise_floor", "nominal", "constant", "bias")
    headings = ("joint", "NRMSE", "rms error", "sensors alone", "URDF with fitted friction", "constant torque", "bias")
    return {h: [getattr(j, field) for j in joints] for h, field in zip(headings, fields, strict=True)}


@columns_of.register
def _of_diagnosis(result: Diagnosis) -> dict[str, list[Any]]:
    found = result.findings
    return {
        "effect": [f.effect for f in found],
        "joints": [", ".join(f.joints) or "the robot" for f in found],
        "probability": [f.probability for f in found],
        "called missing": [bool(f.significant) for f in found],
        "error before": [f.error_before for f in found],
        "error after": [f.error_after for f in found],
        "share of the error": [f.share for f in found],
        "sentence": [f.sentence for f in found],
    }


@columns_of.register
def _of_plan(result: Plan) -> dict[str, list[Any]]:
    log = result.to_log(50.0)
    found: dict[str, list[Any]] = {"t": log.t.tolist()}
    for kind in ("q", "v", "a"):
        values = getattr(log, kind)
        found |= {f"{kind}_{joint}": values[:, j].tolist() for j, joint in enumerate(log.joints)}
    return found


@columns_of.register
def _of_motion(result: MotionComparison) -> dict[str, list[Any]]:
    rows = (*result.horizons, result.whole)
    found: dict[str, list[Any]] = {
        "horizon": ["whole log" if h.horizon is None else f"{h.horizon:g} s" for h in rows],
        "tip, mm": [h.tip for h in rows],
        "tip of the URDF with fitted friction, mm": [h.urdf_tip for h in rows],
    }
    for joint in result.whole.joints:
        found[f"{joint}, rad (m)"] = [h.joints[joint] for h in rows]
    return found


@columns_of.register
def _of_motion_diagnosis(result: MotionDiagnosis) -> dict[str, list[Any]]:
    found = result.findings
    return {
        "effect": [x.finding.effect for x in found],
        "joints": [", ".join(x.finding.joints) or "the robot" for x in found],
        "probability": [x.finding.probability for x in found],
        "simulated error, times that without": [None if x.refused else x.ratio for x in found],
        "why it is not simulated": [x.refused for x in found],
    }


@singledispatch
def figure_of(result: Any) -> go.Figure:
    """The figure that says most of a result."""
    raise InputError(f"a {type(result).__name__} has no figure")


@figure_of.register
def _parameters(result: Model) -> go.Figure:
    return figures.intervals(result).figure


@figure_of.register
def _fitted(result: Identification | OutputError) -> go.Figure:
    return figures.intervals(result.model).figure


@figure_of.register
def _compared(result: Comparison) -> go.Figure:
    return figures.matrix(result).figure


@figure_of.register
def _planned(result: Plan) -> go.Figure:
    return figures.excitation(result)


@figure_of.register
def _diagnosed(result: Diagnosis) -> go.Figure:
    shown = result.findings[:FINDINGS_DRAWN][::-1]
    names = [f"{f.effect} {', '.join(f.joints)}".strip() for f in shown]
    figure = go.Figure()
    figure.add_bar(x=[f.error_after for f in shown], y=names, orientation="h", marker={"color": BLUE}, name="with it")
    references = (
        (result.error, "without an effect", MEASURED, "right"),
        (result.noise_floor, "sensors", GREEN, "left"),
    )
    for x, said, colour, side in references:
        figure.add_vline(x=x, line={"dash": "dash", "color": colour})
        figure.add_annotation(x=x, y=1, yref="paper", text=said, showarrow=False, xanchor=side, yanchor="bottom")
    figure.update_xaxes(title="cross-validated NRMSE with the effect", rangemode="tozero")
    figure.update_yaxes(automargin=True)
    return figures.style.drawing("", "", figure, 120 + 28 * len(names)).figure


@figure_of.register
def _moved(result: MotionComparison) -> go.Figure:
    rows = [h for h in result.horizons if h.horizon is not None]
    figure = go.Figure()
    tips = (([h.tip for h in rows], "the model", BLUE), ([h.urdf_tip for h in rows], "the URDF", MEASURED))
    for y, said, colour in tips:
        figure.add_scatter(
            x=[h.horizon for h in rows],
            y=[x if np.isfinite(x) else None for x in y],
            mode="lines+markers",
            name=said,
            line={"color": colour},
        )
    figure.update_xaxes(title="horizon, s", type="log")
    figure.update_yaxes(title="error at the tip, mm", type="log")
    return figures.style.drawing("", "", figure, 320).figure


@figure_of.register
def _moved_with_findings(result: MotionDiagnosis) -> go.Figure:
    shown = [x for x in result.findings if not x.refused][:FINDINGS_DRAWN][::-1]
    names = [f"{x.finding.effect} {', '.join(x.finding.joints)}".strip() for x in shown]
    figure = go.Figure()
    figure.add_bar(x=[x.ratio for x in shown], y=names, orientation="h", marker={"color": BLUE}, name="with it")
    figure.add_vline(x=1.0, line={"dash": "dash", "color": MEASURED})
    figure.update_xaxes(title="error of the simulated motion, times that without the effect", rangemode="tozero")
    figure.update_yaxes(automargin=True)
    return figures.style.drawing("", "", figure, 120 + 28 * len(names)).figure


def frame_of(result: Any, backend: str) -> Any:
    """The table of a result as a data frame."""
    here = [name for name in BACKENDS if find_spec(name)]  # pyarrow is always there
    if backend not in {"auto", *BACKENDS}:
        raise InputError(f"no data frames of {backend!r}; there are {', '.join(BACKENDS)}, and auto")
    for name in here:
        if backend in {name, "auto"}:
            return nw.from_dict(columns_of(result), backend=name).to_native()
    raise InputError(f"{backend} is not installed: pip install {backend}, or to_frame('pyarrow')")


def _model_of(result: Any) -> Model | None:
    if isinstance(result, Diagnosis):
        return None if result.fit is None else result.fit.model
    if isinstance(result, Model):
        return result
    return result.model if isinstance(result, Identification | OutputError) else None


def _error_of(result: Any) -> Headline | None:
    if isinstance(result, Identification | Diagnosis):
        return result.headline
    return headline_of(result.history[-1]) if isinstance(result, Model) and result.history else None


def _picture(model: Model, error: Headline) -> str:
    """The robot at the middle of its limits, or at zero."""
    limits = model.robot.limits
    middle = 0.5 * (np.asarray(limits.lower) + np.asarray(limits.upper))
    pose = np.where(np.isfinite(middle), middle, 0.0)
    floor, constant = error.noise_floor, error.constant_nrmse
    return robot_picture(model.robot, pose, {name: (x, floor, constant) for name, x in error.joints.items()})


def _text(x: Any) -> str:
    if isinstance(x, bool):
        return "yes" if x else "–"
    return number(x) if x is None or isinstance(x, float) else str(x)
