"""Notes of a diagnosis on the model that it was given: what the model has already, and what it was fitted with."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from frischid.core.text import listed
from frischid.diagnosis.carried_loads import CarriedLoad
from frischid.diagnosis.contacts import Contact
from frischid.diagnosis.scored_candidate import known_in_motion
from frischid.diagnosis.situation import Situation
from frischid.diagnosis.stretches import Stretch
from frischid.diagnosis.torque_limits import TorqueLimit
from frischid.effects import EFFECTS, columns_of
from frischid.logs.log import Log
from frischid.logs.recording import Recording
from frischid.model.model import Model

TOUCHED = (
    "the model was fitted with these contacts, which change its parameters: cut them out of the logs (frischid cut "
    "LOG --from START --until STOP keeps a part) and identify again"
)
"""Note on a model that was fitted to logs with contacts."""

AT_LIMIT = (
    "the model was fitted with torques at their limit, which change its parameters: cut these stretches out of the "
    "logs (frischid cut LOG --from START --until STOP keeps a part), or record a slower motion, and identify again"
)
"""Note on a model that was fitted to logs with torques at their limit."""

LOADED = (
    "the model was fitted with this load for a part of the time, which changes its parameters: cut the times with the "
    "load out of the logs (frischid cut LOG --from START --until STOP keeps a part) and identify again. Then frischid "
    "payload weighs the load in the part that you cut out"
)
"""Note on a model that was fitted to logs in which the robot carries a load for a while."""


def delay_in(model: Model) -> str:
    """A note on the delay of the torque that the model has from its identification; empty where it has none."""
    late = model.lowpass.lag_in_words
    return late and f"a delay between torque and position is in the model already: {late}, as its own logs show"


def touch_in(model: Model, logs: Sequence[Log | Recording], contacts: Sequence[Contact]) -> str:
    """A note that the model was fitted to logs with contacts; empty where it was not."""
    touched = {contact.source for contact in contacts}
    return TOUCHED if any(log.source in touched and model.made_from(log) for log in logs) else ""


def limit_in(model: Model, logs: Sequence[Log | Recording], limits: Sequence[TorqueLimit]) -> str:
    """A note that the model was fitted to logs with torques at their limit; empty where it was not."""
    cut = {source for limit in limits for source, _, _ in limit.stretches}
    return AT_LIMIT if any(log.source in cut and model.made_from(log) for log in logs) else ""


def load_in(model: Model, logs: Sequence[Log | Recording], load: CarriedLoad | None) -> str:
    """A note that the model was fitted to logs in which the robot carries a load for a while; empty where not."""
    sources = set() if load is None else {source for source, _, _ in load.stretches}
    return LOADED if any(log.source in sources and model.made_from(log) for log in logs) else ""


def untried(model: Model, effects: Sequence[str], situation: Situation, channels: Collection[str]) -> list[str]:
    """Notes on effects that a user wants to be tried, and that this diagnosis cannot try: one for each reason.

    Parameters
    ----------
    effects : sequence of str
        Identifiers.
    situation : {"always", "changed"}
    channels : collection of str
        Further channels that every log has.
    """
    changes, never, blind, known = list[str](), list[str](), list[str](), list[str]()
    present = {column.name for column in columns_of(model.robot, model.effects)}
    for name in dict.fromkeys(effects):
        candidates = [effect for shapes in EFFECTS[name].candidates(model.robot) for effect in shapes]
        if EFFECTS[name].change and situation == "always":
            changes.append(name)
        elif not candidates:
            never.append(name)
        elif not any(set(channels).issuperset(effect.channels(model.robot)) for effect in candidates):
            blind.append(name)
        elif all(known_in_motion(effect, present, model.robot) for effect in candidates) and not (
            situation == "changed" and EFFECTS[name].after_change
        ):
            known.append(name)
    same = listed(list(dict.fromkeys(EFFECTS[name].same_in_motion for name in known)))
    reasons = (
        (changes, "such an effect comes later, and the robot is assumed not to have changed (--situation changed)"),
        (never, "no diagnosis tries such an effect; frischid add adds it"),
        (blind, "the logs lack the channels that such an effect needs"),
        (known, f"while a joint moves the model has it as {same}, and at standstill dry friction is undetermined"),
    )
    return [f"not tried: {listed(names)}, because {why}" for names, why in reasons if names]


def longest_part(log: Log, left_out: Sequence[Stretch]) -> tuple[float, float]:
    """Start and end of the longest part of a log between some stretches, s."""
    here = sorted((start, stop) for source, start, stop in left_out if source == log.source)
    ends = [*(start for start, _ in here), float(log.t[-1])]
    starts = [float(log.t[0]), *(stop for _, stop in here)]
    return max(zip(starts, ends, strict=True), key=lambda stretch: stretch[1] - stretch[0])
