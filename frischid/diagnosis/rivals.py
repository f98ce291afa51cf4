"""The hypotheses that share the probability with the first finding, and the motion that separates them.

Where the first finding has less than 80 % (`DiagnosisCriteria.sure_probability`), its sentence names up to three others
that may be the cause instead, and the command that plans a motion on which two effects act differently. So a user hears
of a rival before acting on the first finding.
"""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from frischid.core.text import percent
from frischid.diagnosis.findings import Finding
from frischid.effects import EFFECTS

MOST_RIVALS = 3  # hypotheses that are named beside the first
IN_WORDS = {
    "none": "no effect is missing",
    "several": "several small effects, none dominant",
    "outside": "something outside the catalogue",
    "contact": "a contact",
}
"""Hypotheses other than an effect, in words."""


class Rival(NamedTuple):
    """A hypothesis beside the first finding: its name in the catalogue or in `hypotheses.OTHERS`, and probability."""

    name: str
    probability: float

    @property
    def words(self) -> str:
        """Name for a sentence."""
        return IN_WORDS.get(self.name, self.name)


def rivals(findings: Sequence[Finding], probabilities: Mapping[str, float]) -> list[Rival]:
    """Hypotheses that may be true instead of the first finding, most probable first; none where that one is sure.

    Effects that the data cannot tell from the first (`Finding.undecided`) are named even with a small probability.
    """
    first = best_of(findings)
    if first is None or first.probability >= first.criteria.sure_probability:
        return []
    others = [Rival(name, p) for name, p in probabilities.items() if name != first.effect]
    told = [r for r in others if r.probability >= first.criteria.rival_probability or r.name in first.undecided]
    return sorted(told, key=lambda r: -r.probability)[:MOST_RIVALS]


def best_of(findings: Sequence[Finding]) -> Finding | None:
    """The first finding that is called missing and can be added to a model."""
    return next((f for f in findings if f.significant and f.members), None)


def shared(findings: Sequence[Finding], probabilities: Mapping[str, float]) -> list[Rival]:
    """The first finding and its rivals, most probable first; none where the first is sure."""
    first, others = best_of(findings), rivals(findings, probabilities)
    if first is None or not others:
        return []
    return sorted([Rival(first.effect, first.probability), *others], key=lambda r: -r.probability)


def separating_command(findings: Sequence[Finding], probabilities: Mapping[str, float], robot: str = "ROBOT") -> str:
    """Command that plans a motion to separate the two most probable effects of `shared`; empty without two."""
    return command_for(pair_of(findings, probabilities), robot)


def command_for(pair: Sequence[Finding], robot: str = "ROBOT") -> str:
    """Command that plans a motion on which two findings act differently, at their joints; empty without two.

    `robot` is the file or the name that the robot was loaded by.
    """
    placed = ",".join(_placed(finding) for finding in pair)
    if len(pair) != 2:
        return ""
    return f"frischid excite {shlex.quote(robot)} --separate {shlex.quote(placed)} -o motion.csv"


def pair_of(findings: Sequence[Finding], probabilities: Mapping[str, float]) -> list[Finding]:
    """The two most probable effects of `shared`, or fewer."""
    members = {f.effect: f for f in findings if f.members}
    return [members[r.name] for r in shared(findings, probabilities) if r.name in EFFECTS and r.name in members][:2]


def _placed(finding: Finding) -> str:
    """An effect at the joints of its best place, as the command line reads it."""
    effect = finding.members[0]
    return finding.effect if effect.joints is None else f"{finding.effect}@{'+'.join(effect.joints)}"


def cause_of(findings: Sequence[Finding], probabilities: Mapping[str, float]) -> str:
    """The hypotheses of `shared` with their probabilities, as ``A (50 %), B (20 %) or C (10 %)``; empty without any."""
    told = [f"{r.words} ({percent(r.probability)})" for r in shared(findings, probabilities)]
    return f"{', '.join(told[:-1])} or {told[-1]}" if told else ""


def sentence_of(findings: Sequence[Finding], probabilities: Mapping[str, float], robot: str = "ROBOT") -> str:
    """A sentence on the hypotheses that share the probability; empty where the first finding is sure."""
    cause = cause_of(findings, probabilities)
    if not cause:
        return ""
    sentence = f"these logs alone cannot tell the cause: {cause}"
    command = separating_command(findings, probabilities, robot)
    return (
        f"{sentence}. This command plans a motion on which the first two differ: `{command}`" if command else sentence
    )


def suspect_of(findings: Sequence[Finding], probabilities: Mapping[str, float]) -> Finding | None:
    """The finding of the most probable cause, where this is an effect that is not called missing."""
    name = max(probabilities, key=probabilities.__getitem__, default="")
    finding = next((f for f in findings if f.effect == name), None)
    return finding if finding is not None and finding.refused else None


def suspected(findings: Sequence[Finding], probabilities: Mapping[str, float]) -> str:
    """A sentence on the most probable cause where this is an effect that is not called missing; empty otherwise.

    The ranking shows this probability beside the verdict that no effect is missing. Both are right: this effect is the
    most probable of the causes, and the logs do not show that it acts.
    """
    finding = suspect_of(findings, probabilities)
    if finding is None:
        return ""
    return f". The most probable effect is {finding.title} ({percent(finding.probability)}), but {finding.refused}"
