"""Rivals of the first finding, findings that hold beside it, and the motion that separates two effects.

Where the first finding has less than 80 % (`DiagnosisCriteria.sure_probability`), its sentence names up to three others
that may be the cause instead, and the command that plans a motion on which two effects act differently. So a user hears
of a rival before acting on the first finding.

An effect that explains the logs together with the first, and error that no other effect explains, is no rival: the
model probably lacks both. It stands *beside* the first, however the two share the probability.
"""

from __future__ import annotations

import itertools
import shlex
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from frischid.core.text import listed, percent, sentence
from frischid.diagnosis.findings import Finding
from frischid.effects import EFFECTS
from frischid.robot.robot import Robot

MOST_RIVALS = 3  # hypotheses that are named beside the first
IN_WORDS = {
    "none": "no effect is missing",
    "several": "several small effects, none dominant",
    "outside": "something outside the catalogue",
    "contact": "a contact",
}
"""Hypotheses other than an effect, in words."""
HOW_RANKED = (
    "Of the effects that are called missing, the most probable stands first. The others are sorted by the larger of "
    "two numbers: the probability, and the share of the explained error that no other effect explains. The figures "
    "of a row are for this effect alone. Many of the lower effects are not needed once the first is in the model."
)


class Rival(NamedTuple):
    """A hypothesis beside the first finding: its name in the catalogue or in `hypotheses.OTHERS`, and probability."""

    name: str
    probability: float

    @property
    def words(self) -> str:
        """Name for a sentence."""
        return IN_WORDS.get(self.name, self.name)


def rivals(findings: Sequence[Finding], probabilities: Mapping[str, float]) -> list[Rival]:
    """Hypotheses that may be true instead of the first finding, most probable first; none where one answer is sure.

    Effects that the data cannot tell from the first (`Finding.undecided`) are named even with a small probability.
    """
    first = best_of(findings)
    if first is None or max(first.probability, *probabilities.values()) >= first.criteria.sure_probability:
        return []
    both = {first.effect, *(f.effect for f in beside(findings))}
    others = [Rival(name, p) for name, p in probabilities.items() if name not in both]
    told = [r for r in others if r.probability >= first.criteria.rival_probability or r.name in first.undecided]
    return sorted(told, key=lambda r: -r.probability)[:MOST_RIVALS]


def best_of(findings: Sequence[Finding]) -> Finding | None:
    """The first finding that is called missing and can be added to a model."""
    return next((f for f in findings if f.significant and f.members), None)


def beside(findings: Sequence[Finding]) -> list[Finding]:
    """Findings that the model probably lacks beside the first: each explains error that no other effect explains."""
    first = best_of(findings)
    if first is None or not first.entered:
        return []
    least = first.criteria.smallest_error**2
    own = [f for f in findings if f is not first and f.significant and f.members and f.entered and f.own > least]
    return [f for f in own if f.effect not in first.confused_with][:MOST_RIVALS]


def shared(findings: Sequence[Finding], probabilities: Mapping[str, float]) -> list[Rival]:
    """The first finding and its rivals, most probable first; none where the first is sure."""
    first, others = best_of(findings), rivals(findings, probabilities)
    if first is None or not others:
        return []
    return sorted([Rival(first.effect, first.probability), *others], key=lambda r: -r.probability)


def in_command(robot: Robot | str, name: Callable[[str], str] = str) -> str:
    """A robot as a command line names it: its file or name, and the joints that move where others are locked.

    `name` writes the path of a file.
    """
    if isinstance(robot, str):
        return shlex.quote(robot)
    moving = f" --joints {shlex.quote(','.join(robot.joints))}" if robot.locked else ""
    source = name(robot.source) if Path(robot.source).is_file() else robot.source
    return f"{shlex.quote(source)}{moving}"


def command_for(pair: Sequence[Finding], robot: Robot | str = "ROBOT", name: Callable[[str], str] = str) -> str:
    """Command that plans a motion on which two findings act differently at one joint; empty where no joint has both.

    Effects of different joints differ on every motion: no plan is needed. `robot` may also be the file or the name that
    the robot was loaded by; `name` writes the path of a file.
    """
    placed = ",".join(_placed(pair))
    if not placed:
        return ""
    return f"frischid excite {in_command(robot, name)} --separate {shlex.quote(placed)} -o motion.csv"


def pair_of(findings: Sequence[Finding], probabilities: Mapping[str, float]) -> list[Finding]:
    """The two most probable effects of `shared` that a motion can tell apart, else two beside each other, or fewer."""
    members = {f.effect: f for f in findings if f.members}
    effects = [members[r.name] for r in shared(findings, probabilities) if r.name in EFFECTS and r.name in members]
    told = next((list(two) for two in itertools.combinations(effects, 2) if _placed(two)), [])
    first = best_of(findings)
    if told or first is None or first.probability >= first.criteria.sure_probability:
        return told
    return next((list(two) for two in itertools.combinations([first, *beside(findings)], 2) if _alike(*two)), [])


def _alike(one: Finding, other: Finding) -> bool:
    """Whether the columns of two findings look alike on many motions, and the two have a joint in common."""
    kinds = [(EFFECTS[a.effect].confused_with, b.effect) for a, b in ((one, other), (other, one))]
    return bool(_placed((one, other))) and any(name in confused for confused, name in kinds)


def _placed(pair: Sequence[Finding]) -> list[str]:
    """Two effects at the best place that both have, as the command line reads them; none where no joint has both.

    An effect of the whole robot is placed at the joint of the other, where its kind can act on a single joint. None for
    a change: its columns are those of other parameters, so no motion alone tells it from another effect.
    """
    if len(pair) != 2 or any(EFFECTS[finding.effect].change for finding in pair):
        return []
    acting = [[effect.joints for effect in finding.members] for finding in pair]
    local = [[joints for joints in places if joints is not None] for places in acting]
    if not any(local):
        return [finding.effect for finding in pair]
    best = local[0] or local[1]
    here = next((joints for joints in best if all(not x or _common(joints, x) for x in local)), None)
    if here is None:
        return []
    return [_at(finding, places, here) for finding, places in zip(pair, local, strict=True)]


def _common(joints: Sequence[str], places: Sequence[Sequence[str]]) -> bool:
    return any(not set(joints).isdisjoint(other) for other in places)


def _at(finding: Finding, places: Sequence[Sequence[str]], here: Sequence[str]) -> str:
    """An effect at its place that shares a joint with `here`; one of all joints at `here`, if it can act there."""
    if not places:
        alone = EFFECTS[finding.effect].candidate == "joint" and len(here) == 1
        return f"{finding.effect}@{here[0]}" if alone else finding.effect
    joints = next(other for other in places if not set(here).isdisjoint(other))
    return f"{finding.effect}@{'+'.join(joints)}"


def cause_of(findings: Sequence[Finding], probabilities: Mapping[str, float]) -> str:
    """The hypotheses of `shared` with their probabilities, as ``A (50 %), B (20 %) or C (10 %)``; empty without any."""
    told = [f"{r.words} ({percent(r.probability)})" for r in shared(findings, probabilities)]
    return f"{', '.join(told[:-1])} or {told[-1]}" if told else ""


def sentence_of(findings: Sequence[Finding], probabilities: Mapping[str, float], robot: Robot | str = "ROBOT") -> str:
    """Sentences on what stands instead of the first finding and beside it; empty where nothing does."""
    cause, more = cause_of(findings, probabilities), beside_of(findings)
    told = [f"these logs alone cannot tell the cause: {cause}"] if cause else []
    told += [more] if more else []
    pair = pair_of(findings, probabilities)
    if len(pair) == 2:
        told.append(
            f"This command plans a motion on which {pair[0].effect} and {pair[1].effect} differ: "
            f"`{command_for(pair, robot)}`"
        )
    return ". ".join([*told[:1], *map(sentence, told[1:])])


def beside_of(findings: Sequence[Finding]) -> str:
    """A clause on the findings beside the first; empty without any."""
    others = beside(findings)
    first = best_of(findings)
    if first is None or not others:
        return ""
    each = "it" if len(others) == 1 else "each"
    also = listed([f.title for f in others])
    return f"probably also missing, beside {first.title}: {also}; {each} explains error that no other effect explains"


def suspect_of(findings: Sequence[Finding], probabilities: Mapping[str, float]) -> Finding | None:
    """The finding of the most probable cause, where this is an effect that is not called missing."""
    name = max(probabilities, key=probabilities.__getitem__, default="")
    finding = next((f for f in findings if f.effect == name), None)
    return finding if finding is not None and finding.refused else None


def suspected(findings: Sequence[Finding], probabilities: Mapping[str, float]) -> str:
    """A sentence on the most probable cause where this is a cause that is not called missing; empty otherwise.

    The table shows this probability beside the verdict that no effect is missing. Both are right: this cause is the
    most probable one, and the logs do not show that it acts.

    Examples
    --------
    >>> suspected((), {"none": 0.04, "outside": 0.95, "contact": 0.01})
    '. The most probable cause is something outside the catalogue (95 %), but these logs do not show it clearly'
    >>> suspected((), {"none": 0.8, "outside": 0.2})
    ''
    """
    finding = suspect_of(findings, probabilities)
    if finding is None:
        name = max(probabilities, key=probabilities.__getitem__, default="")
        if name not in {"outside", "contact"}:
            return ""
        told = f"{IN_WORDS[name]} ({percent(probabilities[name])})"
        return f". The most probable cause is {told}, but these logs do not show it clearly"
    return f". The most probable effect is {finding.title} ({percent(finding.probability)}), but {finding.refused}"
