"""A proposed mapping file for a foreign log: the joint and channel of each column, from names and from numbers.

*Names.* A column's name is cut into words (``actual_q_3``, ``- arm_1_joint_effort``, ``pos.shoulder_pan``). Words that
name a quantity give the channel of the column. The other words are compared with the joints' names, or are a number
that counts joints. The assignment of columns to joints with the largest total likeness is taken (Kuhn 1955).

*Numbers.* Where names do not decide, motion does: a velocity is the slope of its position, and the factor between the
two gives its unit. Positions are in degrees if they are far outside the URDF's limits, but inside when read as degrees.
Stamps are the column that grows steadily; their unit is the one that gives a robot's rate.

A proposal is for a person to read. Comments give the reason for each entry, and list the entries that could not be
decided.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from difflib import SequenceMatcher
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from frischid.core.types import Array
from frischid.errors import InputError
from frischid.logs.bags import bag_form, is_bag, read_bag
from frischid.logs.log import CHANNELS
from frischid.logs.mapping import TICKS_PER_SECOND, LogMap
from frischid.logs.tables import Table, read_table
from frischid.robot.robot import Robot

CHANNEL_WORDS = {
    "q": {"q", "pos", "position", "positions", "angle", "angles", "theta", "qpos"},
    "v": {"v", "qd", "dq", "vel", "velocity", "velocities", "speed", "qvel", "omega"},
    "a": {"a", "qdd", "ddq", "acc", "acceleration", "qacc"},
    "tau": {"tau", "torque", "torques", "effort", "eff", "moment", "force", "load"},
    "current": {"i", "current", "currents", "cur", "amp", "amps", "iq"},
}
SETPOINT_WORDS = {
    "des",
    "desired",
    "ref",
    "reference",
    "cmd",
    "command",
    "commanded",
    "target",
    "setpoint",
    "goal",
    "error",
}
OTHER_WORDS = {"temperature", "temp", "voltage", "status", "mode", "index", "count"}
TIME_WORDS = {"t", "time", "stamp", "timestamp", "sec", "secs", "seconds", "nsec", "clock"}
MEASURED_WORDS = {"actual", "act", "measured", "meas"}
FILLER_WORDS = MEASURED_WORDS | {
    "joint",
    "joints",
    "link",
    "axis",
    "state",
    "states",
    "robot",
    "arm",
    "j",
    "",
}
LEAST_LIKENESS = 0.55
"""Share of matching characters (`difflib`) below which a column's name does not match a joint's."""
DEGREES_PER_RADIAN = 180 / np.pi


@dataclass
class Proposal:
    """A proposed mapping, and the reasons for it.

    Attributes
    ----------
    file : dict
        Keys of the table ``[file]``.
    joints : dict of str to dict of str to str
        URDF joint -> channel -> column.
    reasons : list of str
        The reason for each entry, and the decisions that the reader must make.
    missing : tuple of str
        Joints of the URDF without a position column.
    """

    file: dict[str, object] = field(default_factory=dict)
    joints: dict[str, dict[str, str]] = field(default_factory=dict)
    reasons: list[str] = field(default_factory=list)
    missing: tuple[str, ...] = ()

    def toml(self, source: str) -> str:
        """Text of the mapping file."""
        lines = [f"# Proposed by `frischid map` for {source}. Read it before you use it."]
        lines += [f"# {reason}" for reason in self.reasons]
        if self.file:
            lines += [
                "",
                "[file]",
                *(f"{key} = {json.dumps(value, ensure_ascii=False)}" for key, value in self.file.items()),
            ]
        for joint, columns in self.joints.items():
            lines += ["", f"[joint.{json.dumps(joint, ensure_ascii=False)}]"]
            lines += [f"{channel} = {json.dumps(name, ensure_ascii=False)}" for channel, name in columns.items()]
        if any("current" in c and "tau" not in c for c in self.joints.values()):
            lines += ["", "# [current_gain]  # joint-side torque per ampere, from the data sheet: tau = gain * current"]
            lines += [f"# {json.dumps(joint)} = 10.0" for joint, c in self.joints.items() if "current" in c]
        return "\n".join(lines) + "\n"


def propose(path: str | Path, robot: Robot) -> Proposal:
    """Propose a mapping of a log's columns to a robot's joints.

    Raises
    ------
    InputError
        The file cannot be read, or no column looks like a joint's position.
    """
    path, found = Path(path), Proposal()
    table = _table(path, robot, found)
    t = _time(table, path, found)
    named = {name: split(name) for name in table.names if name in table.numeric and name != found.file.get("time", "t")}
    candidates: dict[str, dict[str, str]] = {channel: {} for channel in CHANNELS}
    for name, (channel, rest) in named.items():
        if channel is not None:
            candidates[channel][name] = rest
    if not candidates["q"]:
        raise InputError(
            f"{path}: no column looks like a position; the columns are {', '.join(table.names)}; write the "
            "mapping by hand"
        )
    for channel, names in candidates.items():
        for joint, name in assign(names, robot.joints).items():
            if channel == "q" or joint in found.joints:
                found.joints.setdefault(joint, {})[channel] = name
    found.missing = tuple(j for j in robot.joints if j not in found.joints)
    if found.missing:
        found.reasons.append(f"no position column found for {', '.join(found.missing)}: they would be locked")
    _check_velocities(table, t, found)
    _degrees(table, robot, found)
    unused = [n for n in named if not any(n in c.values() for c in found.joints.values())]
    if unused:
        found.reasons.append(f"columns not used: {', '.join(unused[:20])}{' ...' * (len(unused) > 20)}")
    return found


def split(name: str) -> tuple[str | None, str]:
    """Channel that a column's name contains (None: no channel of a log), and the rest of the name.

    >>> split("actual_q_3")
    ('q', '3')
    """
    spaced = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name)
    words = [w for w in re.split(r"[^0-9A-Za-z]+", spaced.lower()) if w]
    words = [part for w in words for part in (_counted(w) or [w])]
    if set(words) & (SETPOINT_WORDS | OTHER_WORDS):
        return None, name
    for channel, known in CHANNEL_WORDS.items():
        hits = [w for w in words if w in known]
        # a single letter is a quantity only as the first word: later "a" may be an arm
        if hits and (len(hits[0]) > 1 or words[0] == hits[0] or words[-1] == hits[0] or "actual" in words):
            rest = list(words)
            rest.remove(hits[0])
            return channel, "_".join(w for w in rest if w not in MEASURED_WORDS)
    return None, name


def _counted(word: str) -> list[str] | None:
    """Split a quantity and a number without separator: ``q3`` -> ``q``, ``3``."""
    match = re.fullmatch(r"([a-z]+)(\d+)", word)
    quantities = set().union(*CHANNEL_WORDS.values()) | {"j", "joint", "axis"}
    return [match[1], match[2]] if match and match[1] in quantities else None


def assign(names: Mapping[str, str], joints: Sequence[str]) -> dict[str, str]:
    """Joint -> column: by likeness of names, or in order of their numbers where the names are only numbers.

    Parameters
    ----------
    names : mapping of str to str
        Column -> the rest of its name, as `split` gives it.
    joints : sequence of str
    """
    if not names:
        return {}
    numbers = {name: _only_number(rest) for name, rest in names.items()}
    counted = {name: k for name, k in numbers.items() if k is not None}
    if len(counted) == len(names) and len(set(counted.values())) == len(counted) and len(counted) <= len(joints):
        first = min(counted.values())
        if first in (0, 1) and max(counted.values()) - first < len(joints):
            return {joints[k - first]: name for name, k in sorted(counted.items(), key=lambda item: item[1])}
    columns = list(names)
    likeness = np.array([[_alike(names[name], joint) for joint in joints] for name in columns]).reshape(
        len(columns), -1
    )
    rows, taken = linear_sum_assignment(-likeness)
    return {joints[j]: columns[i] for i, j in zip(rows, taken, strict=True) if likeness[i, j] >= LEAST_LIKENESS}


def _only_number(rest: str) -> int | None:
    left = [w for w in rest.split("_") if w not in FILLER_WORDS]
    return int(left[0]) if len(left) == 1 and left[0].isdigit() else None


def _alike(rest: str, joint: str) -> float:
    """Likeness of two names; their numbers must agree, and words such as "joint" do not count."""
    one, two = ([w for w in re.split(r"[^0-9a-z]+", x.lower()) if w not in FILLER_WORDS] for x in (rest, joint))
    digits = [re.findall(r"\d+", "_".join(x)) for x in (one, two)]
    if digits[0] and digits[1] and digits[0][-1] != digits[1][-1]:
        return 0.0
    return SequenceMatcher(None, "_".join(one), "_".join(two)).ratio()


# ---------------------------------------------------------------------- the table


def _table(path: Path, robot: Robot, found: Proposal) -> Table:
    """The file as a table; a CSV without a header gets numbers for names."""
    if is_bag(path):
        return read_bag(path, bag_form(LogMap()), robot.joints)
    try:
        return read_table(path, LogMap())
    except InputError as error:
        if "should name the columns" not in str(error):
            raise
    found.file |= {"header": False}
    found.reasons.append(
        "the file has no header: columns are numbers from 0; name them in columns = [...] and map again"
    )
    return read_table(path, LogMap(header=False))


def _time(table: Table, path: Path, found: Proposal) -> Array:
    """Name of the time column and its unit; the stamps in seconds."""
    growing = [n for n in table.names if n in table.numeric and _grows(table.numeric[n])]
    by_name = [n for n in growing if set(re.split(r"[^a-z]+", n.lower())) & TIME_WORDS]
    if not growing:
        raise InputError(f"{path}: no column grows steadily, so none is time; the columns are {', '.join(table.names)}")
    name = (by_name or growing)[0]
    raw = np.asarray(table.numeric[name] - table.numeric[name][0], dtype=float)
    if name != "t":
        found.file["time"] = name
        found.reasons.append(f"time: {name}, which grows from row to row")
    rate = 1 / float(np.median(np.diff(raw)))
    units = [unit for unit, scale in TICKS_PER_SECOND.items() if 20 <= rate * scale <= 5e3]
    unit = "ns" if is_bag(path) else (units or ["s"])[0]
    if unit != "s" and not is_bag(path):
        found.file["time_unit"] = unit
        found.reasons.append(f"stamps in {unit}: {rate * TICKS_PER_SECOND[unit]:.4g} samples per second")
    if not is_bag(path) and abs(float(table.numeric[name][0])) / TICKS_PER_SECOND[unit] > 1e8:
        found.file["zero_time"] = True
    return raw / TICKS_PER_SECOND[unit]


def _grows(x: NDArray[np.generic]) -> bool:
    steps = np.diff(np.asarray(x, dtype=float))
    return bool(len(steps) and np.isfinite(steps).all() and (steps > 0).mean() > 0.99 and steps.min() >= 0)


def _check_velocities(table: Table, t: Array, found: Proposal) -> None:
    """Keep a velocity only where it is the slope of its position, and note how well the two agree."""
    for columns in found.joints.values():
        if "v" not in columns or len(t) < 20:
            continue
        slope = np.gradient(
            np.asarray(table.numeric[columns["q"]], dtype=float), np.maximum.accumulate(t) + 1e-12 * np.arange(len(t))
        )
        v = np.asarray(table.numeric[columns["v"]], dtype=float)
        if v.std() == 0 or slope.std() == 0:
            continue
        # a moving mean over both, because slopes of noisy positions are noise; late velocities still correlate
        window = np.ones(max(1, len(t) // 200)) / max(1, len(t) // 200)
        v, slope = (np.convolve(x, window, mode="valid") for x in (v, slope))
        likeness = float(np.corrcoef(v, slope)[0, 1])
        if abs(likeness) < 0.5:
            found.reasons.append(
                f"{columns['v']} is not the slope of {columns['q']} (correlation {likeness:.2f}): left out"
            )
            del columns["v"]
        elif abs(float(v @ slope) / float(slope @ slope) - 1) > 0.2:
            factor = float(v @ slope) / float(slope @ slope)
            found.reasons.append(
                f"{columns['v']} is {factor:.3g} times the slope of {columns['q']}: other unit or sign? left out"
            )
            del columns["v"]


def _degrees(table: Table, robot: Robot, found: Proposal) -> None:
    """Propose degrees where positions are far outside the limits, but inside when divided by 57.3."""
    limits = dict(
        zip(robot.joints, zip(robot.limits.lower, robot.limits.upper, robot.prismatic, strict=True), strict=True)
    )
    outside = inside = 0
    for joint, columns in found.joints.items():
        low, high, slides = limits[joint]
        if slides or not np.isfinite(low) or not np.isfinite(high):
            low, high = -2 * np.pi, 2 * np.pi
        if slides:
            continue
        q = np.asarray(table.numeric[columns["q"]], dtype=float)
        room = 0.1 * (high - low)
        outside += bool((q < low - room).any() or (q > high + room).any())
        inside += bool((q / DEGREES_PER_RADIAN >= low - room).all() and (q / DEGREES_PER_RADIAN <= high + room).all())
    if outside and outside > len(found.joints) / 3 and inside == sum(not limits[j][2] for j in found.joints):
        found.file["angle_unit"] = "deg"
        found.reasons.append("angles in degrees: as radians they are far outside the URDF's limits, as degrees within")
        if sliding := [j for j in found.joints if limits[j][2]]:
            found.reasons.append(
                f'{", ".join(sliding)} slide: give them angle_unit = "m" if their columns are in metres'
            )
