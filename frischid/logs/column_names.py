"""Names of columns: the quantity that a name contains, and the joint that the rest of the name means.

A name is cut into words (``actual_q_3``, ``- arm_1_joint_effort``, ``pos.shoulder_pan``). Words that name a quantity
give the channel. The rest is compared with the joints' names. Where the rest is the same for all columns but for a
number (``lbr_joint_0`` to ``lbr_joint_6``), the numbers count the joints: those with the same numbers, or all in their
order. Otherwise the assignment of columns to joints with the largest total likeness is taken (Kuhn 1955).
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from difflib import SequenceMatcher
from typing import Literal

import numpy as np
from scipy.optimize import linear_sum_assignment

from frischid.logs.column_words import (
    ALL_CHANNEL_WORDS,
    CHANNEL_OF_UNIT,
    CHANNEL_WORDS,
    COMMANDS,
    COMPOUND,
    DERIVATIVES,
    FILLER_WORDS,
    LEAST_OF_COMPOUND,
    LETTER_OF_UNIT,
    MEASURED_WORDS,
    OTHER_WORDS,
    SETPOINT_WORDS,
    unit_of,
)

LEAST_LIKENESS = 0.55
"""Share of matching characters (`difflib`) below which a column's name does not match a joint's."""
CLEAR_LIKENESS = 0.8
"""The same share; a match below it is a guess."""

How = Literal["name", "number", "order", "likeness"]
"""How columns were assigned: names or numbers agree, or the columns are counted, or the names are only alike."""


@dataclass(frozen=True)
class Assignment:
    """Columns of one channel: joint -> column, how they were found, and the number that means each joint."""

    columns: Mapping[str, str]
    how: How
    numbers: Mapping[int, str]


def split(name: str) -> tuple[str | None, str]:
    """Channel that a column's name contains (None: no channel of a log), and the rest of the name.

    >>> split("actual_q_3")
    ('q', '3')
    >>> split("position_command_elbow")
    ('qcmd', 'elbow')
    """
    words = _with_derivatives([part for w in _without_unit(name) for part in (_counted(w) or [w])])
    if set(words) & OTHER_WORDS:
        return None, name
    if commanded := set(words) & SETPOINT_WORDS:
        quantity, joint = split("_".join(w for w in words if w not in commanded))
        return (COMMANDS[quantity], joint) if quantity in COMMANDS else (None, name)
    # words before single letters, which may also be an arm or a unit
    while len(words) > 1 and words[0] in {"robot", "state", "states"}:
        words.pop(0)
    for channel, known in CHANNEL_WORDS.items():
        hits = [w for w in words if w in known]
        if not hits or (len(hits[0]) == 1 and any(len(w) > 1 and w in ALL_CHANNEL_WORDS for w in words)):
            continue
        # a single letter is a quantity only as the first word: later "a" may be an arm
        if len(hits[0]) > 1 or words[0] == hits[0] or words[-1] == hits[0] or "actual" in words:
            rest = list(words)
            rest.remove(hits[0])
            return channel, "_".join(w for w in rest if w not in MEASURED_WORDS)
    return None, name


def split_all(names: Sequence[str]) -> dict[str, tuple[str | None, str]]:
    """Channel and rest of each column's name, as `split`; last letters that are units are left out.

    A letter that a whole channel shares tells no joint from another, so it is a unit. So is the letter of the channel's
    own unit, unless another column differs in this letter only. Other letters may be axes. Where no word says the
    quantity of a column, its unit does.

    >>> split_all(["current_X_A", "current_Y_A"])
    {'current_X_A': ('current', 'x'), 'current_Y_A': ('current', 'y')}
    >>> split_all(["current_A", "current_B"])
    {'current_A': ('current', 'a'), 'current_B': ('current', 'b')}
    >>> split_all(["J1_torque_Nm", "J2_force_N"])
    {'J1_torque_Nm': ('tau', 'j_1'), 'J2_force_N': ('tau', 'j_2')}
    >>> split_all(["J1 [deg]", "J2 [mm]", "M1 [Nm]", "F2 [N]"])
    {'J1 [deg]': ('q', '1'), 'J2 [mm]': ('q', '2'), 'M1 [Nm]': ('tau', '1'), 'F2 [N]': ('tau', '2')}
    """
    found = {name: split(name) for name in names}
    plain = [name for name in names if not unit_of(name)[0]]
    ends = {name: end for name in plain if (end := re.fullmatch(r"(.+)[^0-9A-Za-z]([A-Za-z])", name))}
    shorter = {name: split(end[1]) for name, end in ends.items()}
    for channel in CHANNEL_WORDS:
        there = {n for n in names if channel in (found[n][0], shorter.get(n, found[n])[0])}
        letters = {ends[n][2] if n in ends else "" for n in there}
        if len(there) > 1 and len(letters) == 1 and "" not in letters:
            found |= {n: shorter[n] for n in there if shorter[n][0] == channel}
        stems = [shorter[n][1] for n in there & set(ends)]
        for n in there & set(ends):
            own = channel in LETTER_OF_UNIT and ends[n][2] == LETTER_OF_UNIT[channel]
            if own and shorter[n][0] == channel and shorter[n][1] and stems.count(shorter[n][1]) == 1:
                found[n] = shorter[n]
    return found | _by_units(found)


def _by_units(found: Mapping[str, tuple[str | None, str]]) -> dict[str, tuple[str | None, str]]:
    """The columns whose quantity only the unit says; beside columns whose words say it, only numbers missing there."""
    by_unit: dict[str, dict[str, list[str]]] = {}
    for name, (channel, _) in found.items():
        own, words = CHANNEL_OF_UNIT.get(unit_of(name)[0]), _without_unit(name)
        # "A1 [deg]" is an angle of axis A1; a single letter is a weaker word than a unit
        told = channel is not None and (own == channel or any(len(w) > 1 and w in ALL_CHANNEL_WORDS for w in words))
        if not told and own is not None and not set(words) & (OTHER_WORDS | SETPOINT_WORDS):
            by_unit.setdefault(own, {})[name] = words
    named: dict[str, tuple[str | None, str]] = {}
    for channel, columns in by_unit.items():
        numbers = {n: m[1] for n, words in columns.items() if (m := re.fullmatch(r"d{0,2}[a-z](\d+)", "".join(words)))}
        if len(set(numbers.values())) < len(numbers):
            numbers = {}
        taken = {_template(rest)[1] for other, rest in found.values() if other == channel}
        rests = numbers if taken else {n: numbers.get(n, "_".join(words)) for n, words in columns.items()}
        named |= {n: (channel, rest) for n, rest in rests.items() if not taken or int(rest) not in taken}
    return named


def set_point(name: str) -> tuple[str | None, str]:
    """Channel and rest of a column's name that says a set point; (None, name) for other columns.

    >>> set_point("target_moment_3"), set_point("actual_current_3")
    (('tau', '3'), (None, 'actual_current_3'))
    """
    words = _without_unit(name)
    plain = [w for w in words if w not in SETPOINT_WORDS]
    return split("_".join(plain)) if len(plain) < len(words) else (None, name)


def _without_unit(name: str) -> list[str]:
    """Words of a column's name without its unit; a German compound is cut: ``Achsmoment`` -> ``achs``, ``moment``."""
    words = [w for w in re.split(r"[^0-9A-Za-z]+", _spaced(unit_of(name)[1]).lower()) if w]
    quantities = "|".join(sorted(w for w in ALL_CHANNEL_WORDS if len(w) >= LEAST_OF_COMPOUND))
    cut = [re.fullmatch(rf"({COMPOUND})({quantities})", w) for w in words]
    return [part for w, match in zip(words, cut, strict=True) for part in (match.groups() if match else (w,))]


def _with_derivatives(words: list[str]) -> list[str]:
    """Words with ``q, dot`` and ``q, ddot`` as one quantity."""
    order = words.count("dot") + 2 * words.count("ddot")
    position = next((w for w in words if w in CHANNEL_WORDS["q"]), None)
    if order not in DERIVATIVES or position is None:
        return words
    words = [w for w in words if w not in ("dot", "ddot")]
    words[words.index(position)] = DERIVATIVES[order]
    return words


def _spaced(text: str) -> str:
    """A text with its capitals apart: ``jointGripper`` -> ``joint_Gripper``."""
    return re.sub(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", text)


def _counted(word: str) -> list[str] | None:
    """Split a quantity and a number without separator: ``q3`` -> ``q``, ``3``."""
    match = re.fullmatch(r"([a-z]+)(\d+)", word)
    quantities = ALL_CHANNEL_WORDS | {"j", "joint", "axis", "achse", "dot", "ddot"}
    return [match[1], match[2]] if match and match[1] in quantities else None


def families(names: Mapping[str, str]) -> list[dict[str, str]]:
    """Columns of one channel in groups that differ only by one number; columns without such a group are one group.

    >>> families({"tau_0": "0", "tau_1": "1", "tau_ext_0": "ext_0", "tau_ext_1": "ext_1"})
    [{'tau_0': '0', 'tau_1': '1'}, {'tau_ext_0': 'ext_0', 'tau_ext_1': 'ext_1'}]
    """
    by_template: dict[str, dict[str, str]] = {}
    for name, rest in names.items():
        by_template.setdefault(_template(rest)[0], {})[name] = rest
    numbered = {k: group for k, group in by_template.items() if "#" in k and len(group) > 1}
    others = {n: r for k, group in by_template.items() if k not in numbered for n, r in group.items()}
    if not others:
        return list(numbered.values())
    # wrist_1 to wrist_3 beside elbow and shoulder are names of joints, not numbers of them
    if sum(map(len, numbered.values())) <= 3 * len(others):
        return [dict(names)]
    return [*numbered.values(), others]


def _template(rest: str) -> tuple[str, int]:
    """The rest of a name with its last number replaced, and this number (-1 without one)."""
    found = list(re.finditer(r"\d+", rest))
    if not found:
        return rest, -1
    last = found[-1]
    return rest[: last.start()] + "#" + rest[last.end() :], int(last[0])


def assign(names: Mapping[str, str], joints: Sequence[str], known: Mapping[int, str] | None = None) -> Assignment:
    """Assign the columns of one family to joints.

    Parameters
    ----------
    names : mapping of str to str
        Column -> the rest of its name, as `split` gives it.
    known : mapping of int to str, optional
        Number -> joint, where another channel has settled what the numbers mean.
    """
    exact = {joint: name for joint in joints for name, rest in names.items() if _words(rest) == _words(joint)}
    if not len(exact) == len(names) == len(set(exact.values())):
        exact = _by_telling_words(names, joints)
    if not len(exact) == len(names) == len(set(exact.values())):
        exact = _by_part(names, joints)
    if len(exact) == len(names) == len(set(exact.values())):
        return Assignment(exact, "name", {})
    numbers = {name: _template(rest)[1] for name, rest in names.items()}
    if len({_template(rest)[0] for rest in names.values()}) == 1 and min(numbers.values(), default=-1) >= 0:
        found = _by_number(numbers, joints, known or {})
        if found is not None:
            return found
    columns = list(names)
    likeness = np.array([[alike(names[name], joint) for joint in joints] for name in columns])
    likeness = likeness.reshape(len(columns), -1)
    rows, taken = linear_sum_assignment(-likeness)
    pairs = [(joints[j], columns[i], likeness[i, j]) for i, j in zip(rows, taken, strict=True)]
    good = {joint: name for joint, name, x in pairs if x >= LEAST_LIKENESS}
    clear = all(x >= CLEAR_LIKENESS for _, _, x in pairs if x >= LEAST_LIKENESS)
    return Assignment(good, "name" if clear else "likeness", {})


def exactly(names: Mapping[str, str], joints: Sequence[str]) -> Assignment:
    """The columns whose names hold the very name of a joint."""
    found = {joint: name for joint in joints for name, rest in names.items() if _words(rest) == _words(joint)}
    clear = {joint: name for joint, name in found.items() if list(found.values()).count(name) == 1}
    return Assignment(clear, "name", {})


def _by_telling_words(names: Mapping[str, str], joints: Sequence[str]) -> dict[str, str]:
    """The columns whose words are those of a joint, without the words that all columns share, or all joints.

    ``motor_x`` and ``motor_y`` are the joints x and y.
    """
    columns, places = _telling(list(names.values())), _telling(joints)
    return {
        joint: name
        for joint, words in zip(joints, places, strict=True)
        for name, own in zip(names, columns, strict=True)
        if own and own == words and not all(word.isdigit() for word in own)
    }


def _telling(texts: Sequence[str]) -> list[tuple[str, ...]]:
    """Words of each text without those that all texts share."""
    words = [_words(text) for text in texts]
    shared = set(words[0]).intersection(*words[1:]) if len(words) > 1 else set()
    return [tuple(w for w in one if w not in shared) for one in words]


def _by_part(names: Mapping[str, str], joints: Sequence[str]) -> dict[str, str]:
    """The columns whose words, among them a word that is no number, are part of the name of one joint only."""
    found = {}
    for name, rest in names.items():
        words = set(_words(rest))
        if all(word.isdigit() for word in words):
            continue
        if len(holders := [joint for joint in joints if words <= set(_words(joint))]) == 1:
            found[holders[0]] = name
    return found


def _by_number(numbers: Mapping[str, int], joints: Sequence[str], known: Mapping[int, str]) -> Assignment | None:
    """Columns whose numbers count joints: those with these numbers in their names, or all, or the first ones."""
    ordered = sorted(numbers, key=lambda name: numbers[name])
    if known and set(numbers.values()) <= set(known):
        return Assignment({known[numbers[name]]: name for name in ordered}, "number", known)
    stems: dict[str, dict[int, str]] = {}
    for joint in joints:
        stem, k = _template(joint)
        if k >= 0:
            stems.setdefault(stem, {})[k] = joint
    groups = [group for group in stems.values() if set(group) == set(numbers.values())]
    if len(groups) == 1:
        return Assignment({groups[0][numbers[name]]: name for name in ordered}, "number", groups[0])
    sized = [list(group.values()) for group in stems.values() if len(group) == len(numbers)]
    chosen = list(joints) if len(joints) == len(numbers) else sized[0] if len(sized) == 1 else list(joints)
    if len(ordered) > len(chosen):
        return None
    pairs = dict(zip(chosen, ordered, strict=False))
    return Assignment(pairs, "order", {numbers[name]: joint for joint, name in pairs.items()})


def _words(text: str) -> tuple[str, ...]:
    """Words that tell one joint from another: ``jointGripper`` and ``joint1`` are cut as `split` cuts names."""
    words = [part for w in re.split(r"[^0-9a-z]+", _spaced(text).lower()) for part in (_counted(w) or [w])]
    return tuple(w for w in words if w not in FILLER_WORDS)


def alike(rest: str, joint: str) -> float:
    """Likeness of two names; their numbers must agree, and words such as "joint" do not count."""
    one, two = _words(rest), _words(joint)
    digits = [re.findall(r"\d+", "_".join(x)) for x in (one, two)]
    if digits[0] and digits[1] and digits[0][-1] != digits[1][-1]:
        return 0.0
    return SequenceMatcher(None, "_".join(one), "_".join(two)).ratio()
