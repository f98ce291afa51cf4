"""A proposed mapping file for a foreign log: the joint and channel of each column, from names, order and motion.

*Names.* `frischid.logs.column_names` finds the quantity and the joint in each name, or counts joints by numbers.

*Motion.* A velocity is the slope of its position, and the factor between the two gives its unit, or the rate of a file
without time. Where names say nothing, this finds the positions and velocities (`frischid.logs.column_motion`).
Positions are in degrees if they are more than a turn outside the URDF's limits, but inside when read as degrees. Stamps
are the column that grows steadily; their unit is the one that gives a robot's rate.

*Torque.* The URDF's torque follows the measured one only if the joints are in the right order. Numbers that count
joints are confirmed by this, or else they are a guess.

A proposal is for a person to read. Comments give the reason for each entry, and list what is guessed.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from frischid.core.types import Array
from frischid.errors import InputError
from frischid.logs.column_motion import UNEXPLAINED, Grid, columns_by_motion, order_is_confirmed, unexplained
from frischid.logs.column_names import Assignment, assign, exactly, families, set_point, split_all
from frischid.logs.column_units import (
    check_velocities,
    propose_degrees,
    propose_effort_units,
    propose_lengths,
    radians_per_unit,
)
from frischid.logs.column_words import SETPOINT_WORDS
from frischid.logs.gain_guess import guess_gains
from frischid.logs.left_columns import pair_left, with_paired
from frischid.logs.log import CHANNELS, FEWEST_SAMPLES
from frischid.logs.mapping_table import USUAL_RATE, rate_of, stamps_of, table_of, time_column
from frischid.logs.proposal import Proposal
from frischid.logs.repeated_rows import repeats
from frischid.logs.table import Table
from frischid.logs.wraps import continuous, degree_wraps_of
from frischid.robot.robot import Robot


def propose(path: str | Path, robot: Robot, rate: float | None = None) -> Proposal:
    """Propose a mapping of a log's columns to a robot's joints.

    Parameters
    ----------
    rate : float, optional
        Samples per second, for a file without time.

    Raises
    ------
    InputError
        The file cannot be read, or no column can be assigned to a joint of the robot; the rate is no positive number.
    """
    if rate is not None and not 0 < rate < math.inf:
        raise InputError(f"the rate must be a positive number of samples per second, got {rate}")
    path, found, robot = Path(path), Proposal(), replace(robot, known={})  # known by numbers that locks change
    table = table_of(path, robot, found)
    time = time_column(table, found)
    found.full_turns = frozenset(n for n, x in table.numeric.items() if n != time and _is_angle(x) and _in_degrees(x))
    table = _readable(table, time)
    numeric = [name for name in table.names if name in table.numeric and name != time]
    named = split_all([name for name in numeric if table.numeric[name].dtype.kind in "iuf"])
    by_channel = {c: {n: rest for n, (channel, rest) in named.items() if channel == c} for c in CHANNELS}
    _take_set_torques(by_channel, named, found)
    t = None if time is None or rate is not None else stamps_of(table, path, time, found)
    if by_channel["q"]:
        _by_names(by_channel, table, robot, t, found)
        _drop_unexplained_torques(table, robot, t, found)
    if not found.joints:
        _by_motion(table, _not_set(named), robot, t, found)
    if not found.joints:
        raise InputError(
            f"{path}: no column looks like a position of a joint of {robot.name} ({', '.join(robot.joints)}); the "
            f"columns are {', '.join(table.names)}{_not_numeric(table, robot)}"
        )
    if t is None:
        t = rate_of(table, rate, found)
    found.missing = tuple(j for j in robot.joints if j not in found.joints)
    if found.missing:
        found.reasons.append(
            f"no position column found for {', '.join(found.missing)}: taken as standing still, at zero "
            "(--lock JOINT=ANGLE sets another angle)"
        )
    guess_gains(table, t, found)
    check_velocities(table, t, found)
    propose_degrees(table, robot, found)
    propose_lengths(table, robot, found)
    propose_effort_units(found)
    used = {*found.set_points, *(name for columns in found.joints.values() for name in columns.values())}
    unused = [n for n in named if n.strip() and n not in used]
    if unused:
        found.reasons.append(f"columns not used: {', '.join(unused[:20])}{' ...' * (len(unused) > 20)}")
    return found


def _not_set(names: Iterable[str]) -> list[str]:
    """Names of columns that are no set points; desired torques stay, which may be the only ones."""
    words = {n: set(re.split(r"[^a-z]+", n.lower())) for n in names}
    return [n for n in names if not words[n] & SETPOINT_WORDS or set_point(n)[0] in ("tau", "current")]


def _not_numeric(table: Table, robot: Robot) -> str:
    """Why columns that are not numeric are not, and the remedy."""
    by_hand = "; write the mapping by hand"
    if not table.unusable:
        return by_hand
    of_joints = ((n, why) for n, why in table.unusable.items() if any(f"holds '{j}'" in why for j in robot.joints))
    found = next(of_joints, None)
    name, why = found or next(iter(table.unusable.items()))
    if found is not None:
        remedy = ". The file has a row for each joint; write a row for each time, with columns q_JOINT and tau_JOINT"
    else:
        remedy = "; write a column for each joint" if "holds '[" in why else by_hand
    return f"; {len(table.unusable)} are not numeric: in '{name}' {why}{remedy}"


# ---------------------------------------------------------------------- joints by names


def _by_names(
    by_channel: Mapping[str, Mapping[str, str]], table: Table, robot: Robot, t: Array | None, found: Proposal
) -> None:
    """Assign the columns of each channel; numbers mean the same joints in all channels."""
    numbers: Mapping[int, str] = {}
    paired_rests: dict[str, str] = {}
    for channel, names in by_channel.items():
        options = [assign(family, robot.joints, numbers) for family in families(names)]
        options = [x for x in options if x.columns]
        exact = exactly(names, robot.joints)
        if len(exact.columns) > max((len(x.columns) for x in options), default=0):
            options = [exact]
        if not options:
            continue
        chosen = _best(options, channel, table, robot, t, found)
        if chosen.how == "order" and channel == "q":
            chosen = _in_order(chosen, by_channel, table, robot, t, found)
        numbers = numbers or chosen.numbers
        if channel == "q":
            paired_rests = pair_left(names, chosen.columns, robot, found)
        chosen = replace(chosen, columns=with_paired(names, chosen.columns, paired_rests))
        lost = [
            f"{name} ({joint})"
            for joint, name in chosen.columns.items()
            if channel != "q" and joint not in found.joints
        ]
        if lost:
            found.guesses.append(f"left out, because their joints have no position column: {', '.join(lost)}")
        for joint, name in chosen.columns.items():
            if channel == "q" or joint in found.joints:
                found.joints.setdefault(joint, {})[channel] = name
        if chosen.how == "likeness":
            pairs = ", ".join(f"{name} for {joint}" for joint, name in chosen.columns.items())
            found.guesses.append(f"names are only alike: {pairs}")


def _best(
    options: list[Assignment], channel: str, table: Table, robot: Robot, t: Array | None, found: Proposal
) -> Assignment:
    """Of several families of columns for one channel: most joints, then the torques that the URDF explains best."""
    most = max(len(x.columns) for x in options)
    options = [x for x in options if len(x.columns) == most]
    if len(options) == 1:
        return options[0]
    errors = [np.inf] * len(options)
    if channel in ("tau", "current") and t is not None and len(t) >= FEWEST_SAMPLES:
        errors = [_error(x, table, robot, t, found) for x in options]
    # with errors that are equal to a hundredth the shortest names are the plainest: tau_1 before tau_ext_1
    length = [len("".join(x.columns.values())) for x in options]
    ranked = sorted(range(len(options)), key=lambda k: (round(errors[k], 2), length[k]))
    first = next(iter(options[ranked[0]].columns.values()))
    others = ", ".join(next(iter(options[k].columns.values())) + " ..." for k in ranked[1:])
    why = "the URDF explains them best" if np.isfinite(errors[ranked[0]]) else "their names are the shortest"
    if not np.isfinite(errors[ranked[0]]) and length[ranked[0]] == length[ranked[1]]:
        found.guesses.append(f"{channel}: {first} ... and not {others}: neither names nor torques tell which")
    else:
        found.reasons.append(f"{channel}: {first} ... and not {others}, because {why}")
    return options[ranked[0]]


def _error(option: Assignment, table: Table, robot: Robot, t: Array, found: Proposal) -> float:
    """Mean logarithm of the share of torque columns that the URDF does not explain."""
    joints = [j for j in robot.joints if j in found.joints and j in option.columns]
    if not joints:
        return np.inf
    columns = [found.joints[j]["q"] for j in joints] + [option.columns[j] for j in joints]
    grid = Grid.of(_values(table, columns), t)
    J = len(joints)
    grid.y[:, :J] *= radians_per_unit(table, robot, found)
    return float(np.mean(np.log(unexplained(robot.keep(joints), grid, range(J), range(J, 2 * J)))))


def _in_order(
    chosen: Assignment,
    by_channel: Mapping[str, Mapping[str, str]],
    table: Table,
    robot: Robot,
    t: Array | None,
    found: Proposal,
) -> Assignment:
    """Columns that count joints, in the order that the torques confirm: the robot's, or that of the alphabet (ROS).

    Without such an order, the robot's is a guess.
    """
    own = [j for j in robot.joints if j in chosen.columns]
    columns = [chosen.columns[j] for j in own]
    count = {name: k for k, joint in chosen.numbers.items() for name in [chosen.columns[joint]]}
    for order, word in ((own, "the order of their numbers"), (sorted(own), "alphabetical order")):
        reading = Assignment(
            dict(zip(order, columns, strict=True)),
            "order",
            {count[name]: joint for joint, name in zip(order, columns, strict=True)},
        )
        if _is_confirmed(reading, by_channel, table, robot, t, found):
            pairs = f"{columns[0]} is {order[0]} ... {columns[-1]} is {order[-1]}"
            found.reasons.append(f"joints in {word} ({pairs}): the torques confirm this order")
            return reading
    pairs = f"{columns[0]} is {own[0]} ... {columns[-1]} is {own[-1]}"
    found.guesses.append(f"joints in the order of their numbers: {pairs}; no torque confirms this order")
    return chosen


def _is_confirmed(
    chosen: Assignment,
    by_channel: Mapping[str, Mapping[str, str]],
    table: Table,
    robot: Robot,
    t: Array | None,
    found: Proposal,
) -> bool:
    """Whether torques or currents confirm the order of the joints."""
    joints = [j for j in robot.joints if j in chosen.columns]
    for channel in ("tau", "current"):
        for family in families(by_channel[channel]):
            efforts = assign(family, robot.joints, chosen.numbers).columns
            if t is None or len(t) < 20 * FEWEST_SAMPLES or not set(joints) <= set(efforts):
                continue
            grid = Grid.of(_values(table, [*(chosen.columns[j] for j in joints), *(efforts[j] for j in joints)]), t)
            J = len(joints)
            read = replace(found, joints={j: {"q": chosen.columns[j]} for j in joints})
            grid.y[:, :J] *= radians_per_unit(table, robot, read)
            if order_is_confirmed(robot.keep(joints), grid, range(J), range(J, 2 * J)):
                return True
    return False


def _drop_unexplained_torques(table: Table, robot: Robot, t: Array | None, found: Proposal) -> None:
    """Leave out torque columns that the URDF does not explain, where it explains the currents beside them.

    Controllers also write torques that their own model leaves over, and forces at the tool.
    """
    joints = [j for j in robot.joints if {"tau", "current"} <= set(found.joints.get(j, ()))]
    if len(joints) < 2 or t is None or len(t) < 20 * FEWEST_SAMPLES:
        return
    J = len(joints)
    columns = [[found.joints[j][channel] for j in joints] for channel in ("q", "tau", "current")]
    grid = Grid.of(_values(table, [name for some in columns for name in some]), t)
    grid.y[:, :J] *= radians_per_unit(table, robot, found)
    torque, current = (unexplained(robot.keep(joints), grid, range(J), range(k * J, (k + 1) * J)) for k in (1, 2))
    if np.median(current) < UNEXPLAINED <= np.median(torque):
        found.guesses.append(
            f"{columns[1][0]} ... left out: the URDF does not explain these torques, and explains the currents "
            f"{columns[2][0]} ...; perhaps the controller's own model was subtracted from the torques"
        )
        for joint in joints:
            del found.joints[joint]["tau"]


def _take_set_torques(
    by_channel: dict[str, dict[str, str]], named: Mapping[str, tuple[str | None, str]], found: Proposal
) -> None:
    """Take desired torques where no other torque or current is in the file."""
    if by_channel["tau"] or by_channel["current"]:
        return
    for channel in ("tau", "current"):
        wanted = {n: rest for n, (kind, rest) in ((n, set_point(n)) for n in named) if kind == channel}
        if wanted:
            by_channel[channel] = wanted
            found.guesses.append(
                f"{next(iter(wanted))} ...: a desired value, taken because the file has no measured one; right only if "
                "it is the whole command to the drive, and not its feed-forward part alone"
            )
            return


def _readable(table: Table, time: str | None) -> Table:
    """The table with the wraps of angles undone, and without rows whose stamp is that of the row before."""
    fresh: Any = slice(None)
    if time is not None and (again := repeats([table.numeric[time]])).any():
        fresh, place = ~again, table.place
        table = replace(table, place=lambda row: place(int(np.flatnonzero(~again)[row])))
    numeric = {n: x[fresh] if n == time else _continuous(x[fresh]) for n, x in table.numeric.items()}
    return replace(table, numeric=numeric)


def _continuous(x: NDArray[Any]) -> NDArray[Any]:
    """A column with the wraps of an angle undone."""
    return continuous(x) if _is_angle(x) else x


def _is_angle(x: NDArray[Any]) -> bool:
    """Whether a column can be an angle that wraps."""
    return x.dtype.kind == "f" and len(x) > 1 and bool(np.isfinite(x).all())


def _in_degrees(x: NDArray[Any]) -> bool:
    """Whether a column jumps by 360."""
    return bool(degree_wraps_of(x[:, None]).any())


# ---------------------------------------------------------------------- joints by motion


def _by_motion(table: Table, names: list[str], robot: Robot, t: Array | None, found: Proposal) -> None:
    """Find positions, velocities and torques whose names say nothing."""
    if not names:
        return
    values = _values(table, names)
    usable = np.isfinite(values).all(axis=0) & (np.abs(values).max(axis=0, initial=0.0) < 1e9)
    names = [n for n, yes in zip(names, usable, strict=True) if yes]
    if len(names) < len(robot.joints) or table.rows < 20 * FEWEST_SAMPLES:
        return
    stamps = np.arange(table.rows) / USUAL_RATE if t is None else t
    layout = columns_by_motion(robot, Grid.of(values[:, usable], stamps))
    if layout is None:
        return
    for channel, columns in (("q", layout.q), ("v", layout.v), ("tau", layout.tau)):
        for joint, k in zip(robot.joints, columns, strict=False):
            found.joints.setdefault(joint, {})[channel] = names[k]
    said = [f"positions {names[layout.q[0]]} to {names[layout.q[-1]]}"]
    said += [f"velocities {names[layout.v[0]]} to {names[layout.v[-1]]} (their slopes)"] if layout.v else []
    if layout.tau:
        said.append(
            f"torques {names[layout.tau[0]]} to {names[layout.tau[-1]]} (the URDF explains them; in N·m or in A?)"
        )
    found.guesses.append(f"the names say nothing; by the motion, in the order of the robot's joints: {', '.join(said)}")


def _values(table: Table, names: list[str]) -> Array:
    return np.column_stack([np.asarray(table.numeric[n], dtype=float) for n in names])
