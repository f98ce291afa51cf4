"""Locked joints and the positions that logs hold of them: a locked joint stands still, at the angle of its lock."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from frischid.core.text import listed
from frischid.logs.log import Log
from frischid.logs.wraps import unwrapped
from frischid.robot.robot import Robot

MOVING_LOCKED = 0.05
"""A locked joint that moves by more than this, rad (m), is not locked; one so far from its lock stands elsewhere."""
LET_MOVE = "let them move and leave their torque out instead (--torque-joints)"
"""Remedy for locked joints that move, where every log has their positions."""


class Elsewhere(NamedTuple):
    """A joint that stands still at another angle than that of its lock, rad (m)."""

    locked: float
    stands: float


class LockedMotion:
    """Motion of a robot's locked joints in logs, chunk by chunk.

    Attributes
    ----------
    absent : dict of str to str
        Locked joints of which a log has no position, and the first such log.
    """

    def __init__(self, robot: Robot) -> None:
        self._locked = dict(robot.locked)
        whole = replace(robot, locked={}, known={}, frames="joint") if robot.locked else robot
        self._slides = {name for name, slides in zip(whole.joints, whole.prismatic, strict=True) if slides}
        self._range: dict[str, tuple[float, float]] = {}
        self.absent: dict[str, str] = {}

    def see(self, chunk: Log) -> None:
        """Take the positions of the locked joints that a chunk holds."""
        for name in self._locked:
            if name not in chunk.joints:
                self.absent.setdefault(name, chunk.source)
                continue
            own = chunk.select([name])
            q = (own if name in self._slides else unwrapped(own, np.array([self._locked[name]]))).q[:, 0]
            low, high = self._range.get(name, (np.inf, -np.inf))
            self._range[name] = (min(low, float(q.min())), max(high, float(q.max())))

    @property
    def moving(self) -> dict[str, float]:
        """Locked joints that move nevertheless, and their range, rad (m)."""
        return {name: high - low for name, (low, high) in self._range.items() if high - low > MOVING_LOCKED}

    @property
    def elsewhere(self) -> dict[str, Elsewhere]:
        """Locked joints that stand still elsewhere than at their lock; whole turns of a turning joint do not count."""
        found = {}
        for name, (low, high) in self._range.items():
            angle, stands = self._locked[name], (low + high) / 2
            off = abs(stands - angle)
            if name not in self._slides:
                off = min(off, abs(np.remainder(stands - angle + np.pi, 2 * np.pi) - np.pi))
            if name not in self.moving and off > MOVING_LOCKED:
                found[name] = Elsewhere(angle, stands)
        return found


def moving_but_locked(moving: Mapping[str, float], absent: Mapping[str, str] | None = None) -> list[str]:
    """Warning about locked joints that move in a log: the model is then of another robot."""
    if not moving:
        return []
    return [f"locked but moving in a log: {spans_of(moving)}; {remedy(moving, absent or {})}"]


def remedy(moving: Iterable[str], absent: Mapping[str, str]) -> str:
    """The remedy for locked joints that move; `absent` names a log for each joint that a log does not hold."""
    names = list(moving)
    advice = [LET_MOVE] if any(name not in absent for name in names) else []
    for source in dict.fromkeys(absent[name] for name in names if name in absent):
        lost = [name for name in names if absent.get(name) == source]
        columns = listed([f"q_{name}" for name in lost])
        advice.append(f"{listed(lost)}: {source} has no position; leave that log out, or record {columns} there too")
    return "; ".join(advice)


def standing_elsewhere(found: Mapping[str, Elsewhere]) -> list[str]:
    """Warning about joints that stand at another angle than that of their lock."""
    return [f"{places_of(found)}; {lock_there(found)}"] if found else []


def places_of(found: Mapping[str, Elsewhere]) -> str:
    """Joints, the angles of their locks, and those at which they stand, in words."""
    said = [
        f"{name} is locked at {x.locked:.4g} and stands at {x.stands:.4g} rad (m) in a log" for name, x in found.items()
    ]
    return ", ".join(said)


def lock_there(found: Mapping[str, Elsewhere]) -> str:
    """Options that lock joints where they stand."""
    options = " ".join(f"--lock {shlex.quote(f'{name}={x.stands:.4g}')}" for name, x in found.items())
    return f"lock where the log says ({options}), or correct the position column"


def spans_of(moving: Mapping[str, float]) -> str:
    """Joints and their ranges of motion, in words."""
    return ", ".join(f"{name} by {span:.2g} rad (m)" for name, span in moving.items())
