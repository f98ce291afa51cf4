"""A diagnosis in one clause: what is missing, how sure that is, what shares the probability, what else is missing."""

from __future__ import annotations

from frischid.checks.robot_faults import CARRIED_LOAD
from frischid.core.text import listed, percent
from frischid.diagnosis.result import Diagnosis
from frischid.diagnosis.rivals import beside, cause_of
from frischid.model.alarms import FAULTY_LOG, LOGS_DISAGREE, Alarm

PRESUMED = {
    FAULTY_LOG: "a log has the fault that the alarm names",
    LOGS_DISAGREE: "the robot changed between the fitted logs, as the alarm says",
}
"""Alarm -> what explains the error otherwise, so each verdict presumes that it is not so."""


def missing(diagnosis: Diagnosis) -> str:
    """The clause, as the subject line of a page: a capital, and no full stop."""
    more = beside(diagnosis.findings) if diagnosis.verdict == "effect" else []
    also = f"; probably also missing: {listed([f.title for f in more])}" if more else ""
    changed = "; assumed: the robot changed since it was identified" if diagnosis.situation == "changed" else ""
    # Without an effect, the remainder says so.
    further = "" if diagnosis.verdict == "none" else f"{_before(diagnosis)}{_for_a_while(diagnosis)}"
    return on_condition(diagnosis, f"{_first(diagnosis)}{also}{changed}{further}")


def _before(diagnosis: Diagnosis) -> str:
    """The effect that the model's own logs already show: it is as wrong on new logs, whatever came later."""
    shown = diagnosis.shown_before[:1]
    named = [f"{f.title} (probability {percent(f.probability)})" for f in shown]
    return f"; the model's own logs already show {listed(named)}" if named else ""


def _for_a_while(diagnosis: Diagnosis) -> str:
    return f"; {diagnosis.for_a_while} (left out of the search)" if diagnosis.for_a_while else ""


def on_condition(diagnosis: Diagnosis, said: str) -> str:
    """A verdict in words, with what it presumes in front: effects explain the fault of a log, too, if only in part."""
    found = {alarm.id for alarm in diagnosis.headline.alarms if not _says_the_same(diagnosis, alarm)}
    named = " or ".join(words for alarm, words in PRESUMED.items() if alarm in found)
    return f"Unless {named}, {said[:1].lower()}{said[1:]}" if named else said


def _says_the_same(diagnosis: Diagnosis, alarm: Alarm) -> bool:
    """Whether an alarm is about the load that the diagnosis found: logs that disagree, or a log with this fault."""
    if diagnosis.load is None or alarm.id == LOGS_DISAGREE:
        return diagnosis.load is not None
    named = any(source in alarm.sentence for source, _, _ in diagnosis.load.stretches)
    return alarm.id == FAULTY_LOG and alarm.value == 1.0 and named and f"({CARRIED_LOAD}, " in alarm.sentence


def _first(diagnosis: Diagnosis) -> str:
    """The clause without the effects beside the first."""
    best = next((f for f in diagnosis.findings if f.significant and f.members), None)
    named = "" if best is None else f"{best.effect} on {listed(best.joints) or 'the whole robot'}"
    cause = cause_of(diagnosis.findings, diagnosis.probabilities)
    sure = "" if best is None or cause else f" (probability {percent(best.probability)})"
    if diagnosis.verdict == "contact":
        count = len(diagnosis.contacts)
        touched = f"Something touched the robot {'once' if count == 1 else f'{count} times'} (left out of the search)"
        return f"{touched}; also missing: {named}" if named else touched
    if diagnosis.verdict == "unknown":
        part = f"; {named} explains a part of it" if named else ""
        return f"More is missing than any one effect of the catalogue explains{part}"
    if diagnosis.verdict == "several":
        return "Several small effects are missing; none of them dominates"
    if best is not None and cause:
        likely = cause.startswith(best.effect) and best.probability > 0.5
        first = f", most probably {named}" if likely else ""
        return f"An effect is missing{first}; these logs alone cannot tell the cause: {cause}"
    return f"Missing: {named}{sure}" if named else f"{diagnosis.remainder[:1].upper()}{diagnosis.remainder[1:]}"
