"""Which logs select the effects and which only test, when somebody shows a model together with some logs.

The logs a model was fitted to, its *own* logs, select; every other log tests. So a model has one verdict, whatever logs
it is shown with:

1.  Own logs among those given select, together with the own logs that are found again by path and hash, in the order
    in which the model was fitted to them.
2.  Where no own log is given, the given ones say whether the robot changed since it was identified, together with the
    effects that the own logs show (`decided_situation`). If not, the own logs that are found again select, and the
    given ones test. If it changed, the given logs select, because the change is in them. What was always missing acts
    in them too. So the search for the change starts from the model with the effects that its own logs show (`before`).
    Where something touched an unchanged robot in the given logs, these logs select: the own ones do not show that.
3.  Where no own log is found, the given ones select, and a note says what they cannot show.

`frischid.diagnosis.diagnosis.diagnose` itself takes the roles as they are given to it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

from frischid.core.parallel import Workers
from frischid.core.text import listed, percent
from frischid.diagnosis.contacts import bursts_of, find_contacts
from frischid.diagnosis.criteria import DIAGNOSIS_CRITERIA, DiagnosisCriteria
from frischid.diagnosis.cross_validation import CrossValidator
from frischid.diagnosis.diagnosis import diagnose
from frischid.diagnosis.findings import Finding
from frischid.diagnosis.floor import Floor
from frischid.diagnosis.refit import refitted
from frischid.diagnosis.result import Diagnosis
from frischid.diagnosis.situation import (
    Situation,
    SituationOption,
    cross_validator,
    logs_to_diagnose,
    of_the_training_logs,
)
from frischid.logs.excerpt import as_recording, excerpt
from frischid.logs.given import Logs
from frischid.logs.log import Log
from frischid.logs.mapping import MappingLike
from frischid.logs.poses import in_motion
from frischid.logs.recording import Recording
from frischid.model.comparison import compare
from frischid.model.headline import headline
from frischid.model.model import Model
from frischid.model.own_logs import OwnLogs, own_logs

_TOUCHED = (
    "something touched the robot in the given logs, so these logs select; else they show only the error that the "
    "model's own logs show too"
)


class Roles(NamedTuple):
    """Logs by their role in a diagnosis."""

    select: tuple[Log | Recording, ...]
    test: tuple[Log | Recording, ...]
    situation: SituationOption
    note: str
    """Where the logs that select come from, if somebody might expect others; otherwise empty."""
    found: Diagnosis | None = None
    """The diagnosis in these roles, where the roles could not be told without it."""
    before: Model | None = None
    """The model with the effects that its own logs show, where the robot changed after those logs."""
    always: tuple[Finding, ...] = ()
    """The findings with these effects."""


class Decided(NamedTuple):
    """The situation of some logs."""

    situation: Situation
    found: Diagnosis | None
    """On the model's own logs, with the others as test; None where no own log was found or needed."""
    before: Model
    """The model with the effects that its own logs show; the model itself where they show none."""
    touched: bool = False
    """Whether the logs of a robot that has not changed show bursts, as of a touch, which the own logs do not have."""
    own: OwnLogs | None = None
    """The model's own logs, where they were looked for and do not test."""


def decided_situation(
    model: Model,
    logs: Sequence[Log | Recording],
    situation: SituationOption = "auto",
    criteria: DiagnosisCriteria = DIAGNOSIS_CRITERIA,
    *,
    valid: Sequence[Log | Recording] = (),
) -> Decided:
    """Decide whether a robot changed between the logs of its model and some others.

    A robot whose own logs are among the others has not changed. Else the own logs are diagnosed, and the effects that
    they show go into the model. Then `of_the_training_logs` decides. Where no own log is found, the robot changed if a
    refit describes the given logs better than the model does.

    Parameters
    ----------
    situation : {"auto", "always", "changed"}
        What the caller knows.
    valid : sequence of Log or Recording
        Logs that test only: an own log among them decides nothing.
    """
    if situation == "always" or any(model.made_from(log) for log in logs):
        return Decided("changed" if situation == "changed" else "always", None, model)
    looked, before, found = own_logs(model, tuple(valid)), model, None
    own = _moving(model, looked)
    if own:
        found = diagnose(model, own, valid=logs, situation="always", criteria=criteria)
    effects = () if found is None else tuple(e for f in always_missing(found) for e in f.members)
    if effects:
        before = refitted(model, (*model.effects, *effects), own, "always", criteria).complete()
    if situation == "changed":
        return Decided("changed", found, before, own=looked)
    validator, seen = cross_validator(model, [excerpt(log).log for log in logs], criteria=criteria)
    if found is None or found.fit is None:
        return Decided(seen, found, before, own=looked)
    expected = {joint.name: joint.expected * joint.std for joint in compare(before, logs).joints}
    if not of_the_training_logs(found.fit, validator, effects, expected):
        return Decided("changed", found, before, own=looked)
    return Decided("always", found, before, _touched(model, own, logs, validator, criteria), looked)


def _touched(
    model: Model,
    own: Sequence[Log | Recording],
    logs: Sequence[Log | Recording],
    validator: CrossValidator,
    criteria: DiagnosisCriteria,
) -> bool:
    """Whether bursts stand out in some logs, and are the only ones of these logs and the model's own together."""
    if not find_contacts(validator, Floor.of(validator).noise):
        return False
    every = [excerpt(log).log for log in (*own, *logs)]
    both, _ = cross_validator(model, every, "always", criteria=criteria)
    here, found = {log.source for log in logs}, bursts_of(both, Floor.of(both).noise)
    return bool(found) and all(burst.contact.source in here for burst in found)


def logs_before_change(model: Model, valid: Sequence[Log | Recording] = ()) -> tuple[Log | Recording, ...]:
    """The model's own logs that are found again and do not test; none where nothing moves in them."""
    return _moving(model, own_logs(model, tuple(valid)))


def _moving(model: Model, own: OwnLogs) -> tuple[Log | Recording, ...]:
    return own.logs if in_motion(own.logs, model.robot.joints) else ()


def always_missing(found: Diagnosis) -> list[Finding]:
    """The findings on a model's own logs that entered beside each other, and whose gain is more than chance."""
    return [f for f in found.findings if f.members and f.entered and f.sure]


def roles(
    model: Model,
    logs: Sequence[Log | Recording],
    *,
    valid: Sequence[Log | Recording] = (),
    situation: SituationOption = "auto",
) -> Roles:
    """Give each log its role.

    Parameters
    ----------
    valid : sequence of Log or Recording
        Logs that test in any case.
    situation : {"auto", "always", "changed"}
        A robot that changed is diagnosed on the logs given.
    """
    model.check([*logs, *valid])
    if logs and not in_motion(logs, model.robot.joints):
        return Roles(tuple(logs), tuple(valid), situation, "")
    own = tuple(log for log in logs if model.made_from(log))
    diagnosis = looked = None
    if situation == "changed" or (situation == "auto" and not own):
        situation, diagnosis, before, touched, looked = decided_situation(model, logs, situation, valid=valid)
        if touched:
            here = diagnose(model, logs, valid=valid, situation="always")
            if here.verdict == "contact":
                return Roles(tuple(logs), tuple(valid), situation, _TOUCHED, here)
    if situation == "changed":
        if diagnosis is None or before is model:
            return Roles(tuple(logs), tuple(valid), situation, "")
        always = tuple(always_missing(diagnosis))
        return Roles(tuple(logs), tuple(valid), situation, _note_before_change(always), before=before, always=always)
    others = tuple(log for log in logs if not model.made_from(log))
    tested = {log.identity for log in valid}
    found = looked or own_logs(model, own)
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


def _note_before_change(always: Sequence[Finding]) -> str:
    """Note on the effects of the model's own logs: those called missing there, and those that are only no chance."""
    shown, hinted = ([f for f in always if f.significant is called] for called in (True, False))
    first = [f"{f.title} (probability {percent(f.probability)})" for f in shown[:1]]
    told = [f"already show {listed([*first, *(f.title for f in shown[1:])])}"] if shown else []
    told += [f"hint at {listed([f.title for f in hinted])}, not called missing there"] if hinted else []
    return (
        f"the model's own logs {listed(told)}. The search for the change takes these effects as known, "
        "with their strength there; all figures of the table are for what came later"
    )


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
    logs: Logs,
    *,
    valid: Logs = (),
    situation: SituationOption = "auto",
    effects: Sequence[str] | None = None,
    workers: Workers | None = None,
    progress: Callable[[str], None] = lambda _: None,
    mapping: MappingLike = None,
) -> Diagnosis:
    """Find the effect that a model misses, as `frischid diagnose` does: the model's own logs are found and used.

    `diagnose` takes the roles of the logs as they are given. This function gives each log its role (`roles`): the logs
    that the model was fitted to select, where they are found again by path and hash, and all others test. Where the
    robot changed after the own logs, the given logs select, and the search starts from the model with the effects that
    the own logs show.

    Parameters
    ----------
    model : Model
    logs, valid : sequence of Log, Recording or data frame, or one data frame
        Those in ``valid`` test in any case.
    situation : {"auto", "always", "changed"}
        Whether the robot changed after its model was identified; ``"auto"``: decided as `decided_situation` says.
    effects, workers, progress, mapping
        As in `frischid.diagnosis.diagnosis.diagnose`.

    Returns
    -------
    Diagnosis
        Its notes say where the logs that select come from, and which effects the own logs show.

    Raises
    ------
    InputError, UnknownNameError
        As in `diagnose`.

    Examples
    --------
    A model shown with a new log alone; its own log is read again from its file:

    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> import frischid as fr
    >>> robot = fr.Robot.load("planar2")
    >>> own, new = (fr.simulate(robot, fr.random_fourier(robot, 5.0, seed=seed), rate=50.0, noise=fr.Noise(tau=0.05))
    ...             for seed in (1, 2))
    >>> with TemporaryDirectory() as folder:
    ...     fr.write_log(own, Path(folder) / "own.parquet")
    ...     own = fr.read_log(Path(folder) / "own.parquet", robot.joints)
    ...     model = fr.identify(robot, [own], recursion="none").model
    ...     found = fr.diagnose_in_roles(model, [new], effects=["joint_spring"])
    >>> found.verdict, found.headline.measured
    ('none', 'test')
    """
    logs, valid = logs_to_diagnose(model, logs, valid, situation, mapping)
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
            given.before or model,
            given.select,
            valid=given.test,
            situation=given.situation,
            effects=effects,
            workers=workers,
            progress=progress,
        )
    if given.before is not None:  # the error is that of the model as it is
        moving = in_motion(given.select, model.robot.joints)
        error = headline(model, [as_recording(log) for log in given.test or moving])
        found = replace(found, headline=error, always_missing=given.always)
    return replace(found, notes=(*found.notes[:1], *filter(None, [given.note]), *found.notes[1:]))
