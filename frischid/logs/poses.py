"""Logs at standstill: an arm that holds one pose after another, and moves in none of the samples.

    τ_pose = Γ(q, 0, 0) θ + offset + s,      |s| ≤ τ_c

At standstill the torque shows gravity, up to the dry friction s, which takes any value up to break-away. Samples of one
pose repeat the same s, so a pose is *one* sample, however long it lasts: the mean position and the median torque. The
torques of many poses determine the gravity parameters, and the scatter s of their residuals shows the dry friction.
They say nothing about inertia and viscous friction.

A log is *static* if the arm stands still in nearly all samples, and leaves out the ways between the poses, or runs
through them faster than a motion that could be differentiated.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from frischid.core.types import Array
from frischid.errors import InputError
from frischid.logs.log import FEWEST_SAMPLES, STANDSTILL_SPAN, Log

Data = TypeVar("Data")
NOTHING_MOVES = (
    "at standstill no effect can be found: the torque shows gravity and dry friction only (frischid compare compares "
    "gravity). Record a motion of all joints (frischid excite plans one); if the arm did move, check the position "
    "columns and their unit"
)

LEAST_POSE = 0.5
"""s. A shorter rest is a reversal, not a pose."""
LONGEST_WAY = 0.5
"""s. A longer stretch between two poses is a motion: such a log is no static log."""
FEWEST_POSES = 5
"""Poses. With fewer, the gravity of an arm cannot be fitted and tested on poses that were left out."""
GAP_STEPS = 5.0
"""Usual steps of the stamps. A longer step ends a pose."""


class Poses(NamedTuple):
    """Figures of the P poses of a log."""

    t: Array
    """Middle of each pose, s, (P,)."""
    q: Array
    tau: Array
    """`q`, `tau`: Mean position and median torque, (P, J); NaN where there is no torque."""
    parts: tuple[slice, ...]
    """Samples of each pose."""


def poses_of(log: Log) -> Poses:
    """The poses at which every joint of a log stands still for at least `LEAST_POSE`.

    Returns
    -------
    Poses
        Empty where some joint moves all the time.

    Examples
    --------
    >>> import numpy as np
    >>> import frischid as fr
    >>> from frischid.logs.poses import is_static, poses_of
    >>> t = np.arange(0, 4, 0.01)
    >>> q = np.where(t < 2, 0.3, 1.2)[:, None]  # two poses; the way between them was not recorded
    >>> log = fr.Log(t, ("elbow",), q, tau=np.where(t < 2, 5.0, 2.0)[:, None])
    >>> poses_of(log).q[:, 0].round(3).tolist(), poses_of(log).tau[:, 0].tolist(), is_static(log)
    ([0.3, 1.2], [5.0, 2.0], True)
    """
    parts = tuple(_parts(log))
    tau = np.full_like(log.q, np.nan) if log.tau is None else log.tau
    J = len(log.joints)
    return Poses(
        np.array([(log.t[p.start] + log.t[p.stop - 1]) / 2 for p in parts]),
        np.array([log.q[p].mean(axis=0) for p in parts]).reshape(-1, J),
        np.array([np.median(tau[p], axis=0) for p in parts]).reshape(-1, J),
        parts,
    )


def is_static(log: Log) -> bool:
    """Whether a log holds poses only: no motion between two of them lasts longer than `LONGEST_WAY`."""
    parts = list(_parts(log))
    if not parts:
        return False
    edges = np.array([0, *(x for p in parts for x in (p.start, p.stop)), len(log)]).reshape(-1, 2)
    steps = np.diff(log.t)
    usual = float(np.median(steps))
    ways = [float(np.minimum(steps[a : max(a, b - 1)], GAP_STEPS * usual).sum()) for a, b in edges]
    return max(ways) <= LONGEST_WAY and sum(p.stop - p.start for p in parts) > len(log) / 2


def in_motion(logs: Sequence[Data], joints: Sequence[str]) -> tuple[Data, ...]:
    """The logs in which the arm moves; a long recording counts as one of them."""
    return tuple(log for log in logs if not isinstance(log, Log) or not is_static(log.select(joints)))


def need_motion(logs: Sequence[Data], joints: Sequence[str]) -> tuple[Data, ...]:
    """The same.

    Raises
    ------
    InputError
        There are logs, and the arm moves in none of them.
    """
    found = in_motion(logs, joints)
    if logs and not found:
        names = ", ".join(log.source for log in logs if isinstance(log, Log))
        raise InputError(f"{names}: the arm stands still; {NOTHING_MOVES}")
    return found


def _parts(log: Log) -> list[slice]:
    """Samples of each pose."""
    steps = np.diff(log.t)
    usual = float(np.median(steps))
    broken = (steps > GAP_STEPS * usual) | (np.abs(np.diff(log.q, axis=0)) > STANDSTILL_SPAN).any(axis=1)
    edges = [0, *(np.flatnonzero(broken) + 1).tolist(), len(log)]
    window = 2 * max(1, round(LEAST_POSE / usual / 2)) + 1
    found = []
    for start, stop in pairwise(edges):
        if (stop - start) * usual < LEAST_POSE:
            continue
        labels, count = ndimage.label(_rests(log.q[start:stop], window))
        for (part,) in ndimage.find_objects(labels, count):
            if (part.stop - part.start) * usual >= LEAST_POSE and part.stop - part.start >= FEWEST_SAMPLES:
                found.append(slice(start + part.start, start + part.stop))
    return found


def _rests(q: Array, window: int) -> NDArray[np.bool_]:
    """Whether no joint moves by more than `STANDSTILL_SPAN` within a window around each sample, (N,)."""
    travel = ndimage.maximum_filter1d(q, window, axis=0) - ndimage.minimum_filter1d(q, window, axis=0)
    return np.asarray((travel < STANDSTILL_SPAN).all(axis=1))
