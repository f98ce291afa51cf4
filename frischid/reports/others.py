"""Other models along the logs of a report: the earlier steps of its model, and further models to compare with.

Every step of a model remembers the model before it (`Model.previous`). Along the same logs, each of them makes a torque
of its own, which the page draws beside the present one. A step that prepares logs in another way has other samples; its
curves cannot stand beside these, so it is left out.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from frischid.core.text import listed
from frischid.errors import InputError
from frischid.figures.history import kinds
from frischid.logs.log import Log
from frischid.logs.recording import Recording
from frischid.model.comparison import Comparison, compare
from frischid.model.headline import error_after
from frischid.model.model import Model
from frischid.model.prediction import Prediction, predict


@dataclass(frozen=True, eq=False)
class OtherModel:
    """A model that is shown beside the one of the report."""

    name: str
    """The step that made the model, or the name of its file."""
    said: str
    """Its error, in words; empty where nobody measured it."""
    prediction: Prediction
    """Along the logs of the report."""


@dataclass(frozen=True, eq=False)
class SideBySide:
    """The errors of several models on the same logs."""

    logs: tuple[str, ...]
    """Sources of the logs."""
    seen: bool
    """Whether one of the models was fitted to one of them: there is no log that none of them knows."""
    models: Mapping[str, Comparison]
    """By name; the model of the report is the first."""


def earlier_steps(model: Model, logs: Sequence[Log], prediction: Prediction) -> list[OtherModel]:
    """The models before each step of a model, oldest first.

    Parameters
    ----------
    prediction : Prediction
        Of the model along these logs.
    """
    found = []
    for number, step in enumerate(reversed(list(_before(model)))):
        along = predict(step, logs) if step.joints == model.joints else None
        if along is None or along.fitted.shape != prediction.fitted.shape:
            continue
        event = step.history[-1]
        known = error_after(event)
        said = "" if known is None else f"NRMSE {known[0]:.4f} {known[1]}"
        name = " + ".join(kinds(event.get("effects", ()))) if event["action"] == "add" else event["action"]
        found.append(OtherModel(f"step {number}: {name or event['action']}", said, along))
    return found


def further_models(
    models: Sequence[tuple[str, Model]], logs: Sequence[Log], prediction: Prediction
) -> list[OtherModel]:
    """Further models along the logs of the report, where they have the same samples."""
    along = [(name, predict(model, logs)) for name, model in models]
    return [OtherModel(name, "", p) for name, p in along if p.fitted.shape == prediction.fitted.shape]


def side_by_side(models: Mapping[str, Model], logs: Sequence[Log | Recording]) -> SideBySide:
    """Compare models on those logs that none of them was fitted to; without such a log, on all.

    Raises
    ------
    InputError
        The models predict the torque of different joints.
    """
    (name, first), *others = models.items()
    for other, model in others:
        if model.joints != first.joints:
            raise InputError(
                f"{other} predicts the torque of {listed(model.joints)}, {name} of {listed(first.joints)}: only models "
                "of the same joints can be compared"
            )
    new = [log for log in logs if not any(model.made_from(log) for model in models.values())]
    used = new or list(logs)
    found = {name: compare(model, used) for name, model in models.items()}
    return SideBySide(tuple(log.source for log in used), not new, found)


def _before(model: Model) -> Iterator[Model]:
    """Earlier models, the latest first."""
    step = model.previous
    while step is not None and step.history:
        yield step
        step = step.previous
