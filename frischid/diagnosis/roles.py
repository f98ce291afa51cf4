"""Which logs select the effects and which only test, when somebody shows a model together with some logs.

The logs a model was fitted to, its *own* logs, select; every other log tests. So a model has one verdict, whatever logs
it is shown with:

1.  Own logs among those given select, together with the own logs that are found again by path and hash, in the order
    in which the model was fitted to them.
2.  Where no own log is given, the given ones say whether the robot changed since it was identified, together with the
    effects that the own logs show (`decided_situation`). If it changed, the given logs select: the change is in them.
    If not, the own logs that are found again select, and the given ones test.
3.  Where no own log is found, the given ones select, and a note says what they cannot show.

`frischid.diagnosis.diagnosis.diagnose` itself takes the roles as they are given to it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

from frischid.core.parallel import Workers
from frischid.diagnosis.criteria import DIAGNOSIS_CRITERIA, DiagnosisCriteria
from frischid.diagnosis.diagnosis import Diagnosis, diagnose
from frischid.diagnosis.situation import Situation, SituationOption, cross_validator, of_the_training_logs
from frischid.logs.excerpt import excerpt
from frischid.logs.log import Log
from frischid.logs.poses import in_motion
from frischid.logs.recording import Recording
from frischid.model.comparison_alarms import UNLIKE
from frischid.model.headline import headline
from frischid.model.model import Model
from frischid.model.own_logs import own_logs


class Roles(NamedTuple):
    """Logs by their role in a diagnosis.

    Attributes
    ----------
    select, test : tuple of Log or Recording
    situation : {"auto", "always", "changed"}
    note : str
        Where the logs that select come from, if somebody might expect others; otherwise empty.
    found : Diagnosis or None
        The diagnosis in these roles, where the roles could not be told without it.
    """

    select: tuple[Log | Recording, ...]
    test: tuple[Log | Recording, ...]
    situation: SituationOption
    note: str
    found: Diagnosis | None = None


class Decided(NamedTuple):
    """The situation of some logs to none of which a model was fitted.

    Attributes
    ----------
    situation : {"always", "changed"}
    found : Diagnosis or None
        On the model's own logs, with the given ones as test, where this diagnosis says that the robot has not changed.
    """

    situation: Situation
    found: Diagnosis | None


def decided_situation(
    model: Model, logs: Sequence[Log | Recording], criteria: DiagnosisCriteria = DIAGNOSIS_CRITERIA
) -> Decided:
    """Decide whether a robot changed between the logs of its model and some others.

    Where the model is wrong on these logs, the model's own logs are diagnosed. If the model is as wrong there, or the
    effects that act there explain most of the error here, then the robot has not changed. If not, then it has, even
    where no refit describes the logs better: somebody may have touched the robot.

    Parameters
    ----------
    model : Model
    logs : sequence of Log or Recording
        None of them is the model's own.
    criteria : DiagnosisCriteria, optional
    """
    validator, situation = cross_validator(model, [excerpt(log).log for log in logs], criteria=criteria)
    if situation == "always" and not any(alarm.id == UNLIKE for alarm in headline(model, logs).alarms):
        return Decided(situation, None)
    own = own_logs(model).logs
    if not own or not in_motion(own, model.robot.joints):
        return Decided(situation, None)
    found = diagnose(model, own, valid=logs, situation="always", criteria=criteria)
    effects = [effect for f in found.findings if f.entered and f.sure for effect in f.members]
    if found.fit is not None and of_the_training_logs(found.fit, validator, effects):
        return Decided("always", found)
    return Decided("changed", None)


def situation_of(
    model: Model, logs: Sequence[Log | Recording], criteria: DiagnosisCriteria = DIAGNOSIS_CRITERIA
) -> Situation:
    """The situation of some logs, all of which select: a robot whose own logs are among them has not changed."""
    if any(model.made_from(log) for log in logs):
        return "always"
    return decided_situation(model, logs, criteria).situation


def roles(
    model: Model,
    logs: Sequence[Log | Recording],
    *,
    valid: Sequence[Log | Recording] = (),
    situation: SituationOption = "auto",
    criteria: DiagnosisCriteria = DIAGNOSIS_CRITERIA,
) -> Roles:
    """Give each log its role.

    Parameters
    ----------
    model : Model
    logs : sequence of Log or Recording
    valid : sequence of Log or Recording
        Logs that test in any case.
    situation : {"auto", "always", "changed"}
        A robot that changed is diagnosed on the logs given.
    criteria : DiagnosisCriteria, optional

    Returns
    -------
    Roles
    """
    model.check([*logs, *valid])
    if logs and not in_motion(logs, model.robot.joints):
        return Roles(tuple(logs), tuple(valid), situation, "")
    own = tuple(log for log in logs if model.made_from(log))
    if situation == "changed":
        return Roles(tuple(logs), tuple(valid), situation, "")
    diagnosis = None
    if not own and situation == "auto":
        situation, diagnosis = decided_situation(model, logs, criteria)
        if situation == "changed":
            return Roles(tuple(logs), tuple(valid), situation, "")
    others = tuple(log for log in logs if not model.made_from(log))
    tested = {log.identity for log in valid}
    found = own_logs(model, own)
    more = tuple(log for log in found.logs if log.identity not in tested)
    if not own and not more:
        return Roles(others, tuple(valid), situation, _alone(found.reasons))
    order = {log.get("sha256"): number for number, log in enumerate(model.fitted_logs)}
    select = sorted((*own, *more), key=lambda log: order.get(log.identity, len(order)))
    note = _with_own(len(own), len(more), found.reasons)
    if diagnosis is None:
        return Roles(tuple(select), (*others, *valid), situation, note)
    note = f"the model's own logs show the error of the given logs too, or effects that explain most of it; {note}"
    return Roles(tuple(select), (*others, *valid), situation, note, None if valid else diagnosis)


def _alone(missing: str) -> str:
    """Note on logs that select although the model was fitted to none of them."""
    why = f"its own logs were not found ({missing})" if missing else "its file names no logs of its own"
    return (
        f"the model was not fitted to these logs, and {why}. So these logs alone select the effects; an effect that "
        "their motion hardly shows may be ranked too low"
    )


def _with_own(given: int, more: int, missing: str) -> str:
    """Note on the model's own logs, where they are not simply those given."""
    parts = []
    if more:
        which = f"{more} more found" if given else f"{more} found"
        parts.append(f"effects are selected on the model's own logs ({which} by path and hash); all other logs test")
    if missing:
        parts.append(f"not found: {missing}")
    return "; ".join(parts)


def diagnose_in_roles(
    model: Model,
    logs: Sequence[Log | Recording],
    *,
    valid: Sequence[Log | Recording] = (),
    situation: SituationOption = "auto",
    effects: Sequence[str] | None = None,
    workers: Workers | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> Diagnosis:
    """Find the effect that a model misses: its own logs select, all others test.

    Parameters
    ----------
    model : Model
    logs, valid : sequence of Log or Recording
        See `roles`.
    situation, effects, workers, progress
        As in `frischid.diagnosis.diagnosis.diagnose`.

    Returns
    -------
    Diagnosis
        Its notes say where the logs that select come from.

    Raises
    ------
    InputError, UnknownNameError
        As in `diagnose`.
    """
    given = roles(model, logs, valid=valid, situation=situation)
    return diagnose_with(model, given, effects=effects, workers=workers, progress=progress)


def diagnose_with(
    model: Model,
    given: Roles,
    *,
    effects: Sequence[str] | None = None,
    workers: Workers | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> Diagnosis:
    """The same, where the roles of the logs are known."""
    found = given.found
    if found is None or effects is not None:
        found = diagnose(
            model,
            given.select,
            valid=given.test,
            situation=given.situation,
            effects=effects,
            workers=workers,
            progress=progress,
        )
    return replace(found, notes=(*found.notes, given.note)) if given.note else found
