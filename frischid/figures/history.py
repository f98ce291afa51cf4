"""The errors in a model's history, drawn as a staircase.

The last stair is the error at the top of the page. Where that error is measured on test logs and every step knows its
error on these logs, the stairs are errors on the test logs; otherwise they are cross-validated, and the noise floor is
that of the logs they are cross-validated on.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import plotly.graph_objects as go

from frischid.core.text import counted
from frischid.figures.style import BLUE, GREEN, Drawing, drawing
from frischid.model.events import cross_validated_nrmse, measured_on, measured_within, selection_errors, test_errors
from frischid.model.headline import Headline, cross_validated, headline_of
from frischid.model.model import Model

CROWD = 4
"""Number of steps above which names and numbers would overlap on a small screen and are shortened or left out."""


def steps_of(model: Model, tested: bool = False) -> list[tuple[str, float | None, float]]:
    """The steps of a model, with the error before and after each; steps without an error are skipped.

    The errors are those on the logs that select, or with `tested` those on the test logs. The first model's error is
    the one before the first step, measured on the same data as the error after that step. Of a model with the torque of
    some joints alone, an error is that of these joints, and the one before a step is not known.
    """
    found: list[tuple[str, float | None, float]] = []
    for event in model.history:
        before, after = selection_errors(event)
        if not measured_within(event, model.joints):
            before, after = None, cross_validated_nrmse([event], model.joints)
        if after is None:
            continue
        if tested:
            *known, after = test_errors(event)
            before = known[0] if known else None
        effects = event.get("effects", [])
        name = event["action"] if event["action"] == "identify" else " + ".join(kinds(effects)) or event["action"]
        found.append((name, before, float(after)))
    if len(found) > 1 and (same_data := found[1][1]) is not None:
        found[0] = (*found[0][:2], same_data)
    return found


def kinds(effects: list[str]) -> list[str]:
    """Identifiers of effects, without shapes and joints."""
    return list(dict.fromkeys(e.split("(")[0].split("@")[0] for e in effects))


def known_on(model: Model, error: Headline) -> bool:
    """Whether an error is measured on test logs on which every step of the model was measured too."""
    if error.measured != "test" or not model.history:
        return False
    found = [headline_of(event) for event in model.history if selection_errors(event)[1] is not None]
    known = [step for step in found if step is not None and step.measured == "test" and _same(step.logs, error.logs)]
    return len(known) == len(found) and all(step.joints.keys() <= set(model.joints) for step in known)


def _same(one: Sequence[str], other: Sequence[str]) -> bool:
    """Whether logs have the same names; their folders may differ, because a model may come from another machine."""
    return [Path(x).name for x in one] == [Path(x).name for x in other]


def staircase(model: Model, error: Headline) -> Drawing:
    """Error after each step, with the error of the sensor noise alone.

    Parameters
    ----------
    error : Headline
        The model's error where the staircase is shown.
    """
    tested = known_on(model, error)
    last_event = model.history[-1] if model.history else {}
    where = "on the test logs" if tested else measured_on(last_event)
    steps = steps_of(model, tested)
    own = cross_validated(last_event) if measured_within(last_event, model.joints) else None
    floor = (error if tested else own or error).noise_floor
    crowded = len(steps) > CROWD
    x, y = _stairs(steps)
    figure = go.Figure()
    figure.add_scatter(
        x=x, y=y, mode="lines", line={"color": BLUE, "width": 3},
        name="error on the test logs" if tested else "cross-validated error",
    )  # fmt: skip
    figure.add_scatter(
        x=list(range(len(steps))), y=[s[2] for s in steps], mode="markers", showlegend=False,
        marker={"size": 8, "color": BLUE}, cliponaxis=False,
    )  # fmt: skip
    for i, (_, _, after) in enumerate(steps):
        figure.add_annotation(
            x=i, y=after, text=f"{after:.4f}", textangle=-90 if crowded else 0, yanchor="bottom", yshift=5,
            showarrow=False, font={"size": 11 if crowded else 12},
        )  # fmt: skip
    figure.add_scatter(
        x=[-0.5, len(steps) - 0.5], y=[floor, floor], mode="lines", name=f"noise floor {floor:.4f}",
        line={"color": GREEN, "dash": "dash", "width": 2},
    )  # fmt: skip
    figure.update_xaxes(
        automargin=True, tickvals=list(range(len(steps))), tickangle=-50 if crowded else 0,
        ticktext=[s[0].replace("_", " ") if crowded else _wrapped(s[0]) for s in steps],
        showgrid=False, zeroline=False,
        range=[-0.6, max(len(steps), 2) - 0.4],
    )  # fmt: skip
    top = max([floor, *(s[2] for s in steps), *(s[1] or 0.0 for s in steps)], default=1.0)
    # The errors are written as numbers, through which the lines of a grid would run.
    figure.update_yaxes(title_text="NRMSE", range=[0, (1.5 if crowded else 1.3) * top], showgrid=False)
    if len(steps) > 1:
        first, last = steps[0][2], steps[-1][2]
        reading = (
            f"{counted(len(steps) - 1, 'effect')} added: {first:.4f} → {last:.4f} ({where}), {last / floor:.1f} × the "
            f"noise floor.{' Where the line is broken, the step before was measured on other data.' * (None in x)}"
        )
    else:
        reading = f"No effect has been added to this model yet.{f' Its error is {where}.' * bool(steps)}"
    return drawing("Error after each step (NRMSE)", reading, figure, 330 if crowded else 230)


def _stairs(
    steps: Sequence[tuple[str, float | None, float]],
) -> tuple[list[float | None], list[float | None]]:
    """Corners of the line; broken, by None, where a step was measured on other data than the step before."""
    x: list[float | None] = []
    y: list[float | None] = []
    for i, (_, before, after) in enumerate(steps):
        if i > 0 and before is not None:
            joined = abs(before - steps[i - 1][2]) < 1e-9
            x += [i - 0.5] if joined else [None, i - 0.5]
            y += [before] if joined else [None, before]
        x += [i - 0.5, i + 0.5]
        y += [after, after]
    return x, y


def _wrapped(name: str) -> str:
    return name.replace("_", "<br>").replace(" + ", " +<br>")
