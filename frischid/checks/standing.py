"""Logs at standstill: what such a log can be used for, and whether something pushed the arm.

An arm that holds a pose feels gravity and dry friction, and both stay as they are. The torque of a drive then changes
only slowly (its controller, its temperature). A torque that appears for a while comes from outside: a contact. It is a
burst (`frischid.core.bursts`) of

    x_j = τ_j − median of τ_j in the pose.

A torque that is still settling when the pose begins, or that builds up until the arm moves again or until the log ends,
is no push.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from frischid.checks.channels import resolved_noise
from frischid.checks.check_criteria import DEFAULT_CRITERIA, CheckCriteria
from frischid.checks.log_issue import Notebook
from frischid.core.bursts import robust_std
from frischid.core.text import listed
from frischid.core.types import Array
from frischid.logs.log import STANDSTILL_SPAN, Log
from frischid.logs.poses import FEWEST_POSES, Poses, poses_of


@dataclass(frozen=True)
class Push:
    """A torque that appears while the arm stands still."""

    start: float
    stop: float
    """`start`, `stop`: s."""
    joints: tuple[str, ...]
    """Joints whose torque shows it."""
    torque: float
    """Largest change of a torque, N·m (N)."""
    strength: float
    """Largest smoothed change in robust standard deviations."""


def pushes(log: Log, criteria: CheckCriteria = DEFAULT_CRITERIA) -> list[Push]:
    """Torques that appear while every joint of a log stands still.

    Returns
    -------
    list of Push
        In the order of time.

    Examples
    --------
    >>> import numpy as np
    >>> import frischid as fr
    >>> from frischid.checks.standing import pushes
    >>> t = np.arange(0, 20, 0.01)
    >>> noise = np.random.default_rng(0).standard_normal((len(t), 1))
    >>> torque = 5 + 0.1 * noise + 3 * np.exp(-((t - 8) ** 2))[:, None]  # somebody leans on the arm at 8 s
    >>> (push,) = pushes(fr.Log(t, ("elbow",), np.zeros((len(t), 1)), tau=torque))
    >>> push.joints, bool(7 > push.start > 5 and 9 < push.stop < 11)
    (('elbow',), True)
    """
    if log.tau is None:
        return []
    found = []
    for part in poses_of(log).parts:
        if log.t[part.stop - 1] - log.t[part.start] >= criteria.least_rest:
            found += _of_pose(log, part, criteria)
    return found


def _of_pose(log: Log, part: slice, criteria: CheckCriteria) -> list[Push]:
    assert log.tau is not None
    t, x = log.t[part], np.nan_to_num(log.tau[part])
    step = float(np.median(np.diff(t)))
    change = x - np.median(x, axis=0)
    least = np.maximum(resolved_noise(x, criteria), 1e-9 * np.abs(x).max(initial=1.0))
    unit = np.maximum(robust_std(change), least)
    z, bursts = criteria.push.bursts((change / unit) ** 2, step)
    found = []
    for where in bursts:
        settles = t[where.start] - t[0] < criteria.settling_seconds
        breaks_away = part.stop < len(log) and t[-1] - t[where.stop - 1] < criteria.settling_seconds
        stays = where.stop == len(t)  # at the end of the log: what builds up there may break the joint away
        if settles or breaks_away or stays:
            continue
        felt = np.flatnonzero(z[where].max(axis=0) > criteria.push.edge)
        names = tuple(log.joints[j] for j in felt)
        most = float(_smooth(change[where][:, felt], criteria.push.samples(step)).max())
        found.append(Push(float(t[where.start]), float(t[where.stop - 1]), names, most, float(np.sqrt(z[where].max()))))
    return found


def _smooth(x: Array, window: int) -> Array:
    return np.asarray(np.abs(ndimage.uniform_filter1d(x, min(window, len(x)), axis=0)))


def check_standing(log: Log, notes: Notebook) -> None:
    """Say what a static log can be used for."""
    poses = poses_of(log)
    count = len(poses.t)
    notes.facts["poses"] = count
    notes.per_joint("standstill", np.ones(len(log.joints)))
    enough = count >= FEWEST_POSES
    use = (
        "gravity can be fitted (identify) and compared (compare); inertia and friction cannot"
        if enough
        else f"too few to fit gravity ({FEWEST_POSES} poses are needed, in one file or in several given together)"
    )
    notes.add(
        "standstill",
        f"the arm stands still in the whole log, at {count} pose{'s' * (count != 1)}{_reach(log, poses)}: {use}",
        (),
        "certain",
        "for inertia and friction record a motion of all joints (frischid excite plans one); if the arm did move, "
        "check the position columns and their unit",
    )


def check_pushes(log: Log, notes: Notebook) -> None:
    """Report torques that appear while the arm stands still."""
    span = np.ptp(log.q, axis=0)
    never = {n for n, x in zip(log.joints, span, strict=True) if x < STANDSTILL_SPAN <= span.max()}
    first = float(log.t[0])  # times count from here, as those of `frischid cut`
    for push in pushes(log, notes.criteria):
        doubtful = [n for n in push.joints if n in never]
        cause = f", or {listed(doubtful)} moves and the position was not recorded" if doubtful else ""
        notes.add(
            "contact",
            f"while the arm stands still, a torque of up to {push.torque:.3g} N·m (N) appears from "
            f"{push.start - first:.2f} to {push.stop - first:.2f} s ({push.strength:.3g} standard deviations of the "
            f"rest): something pushes the arm{cause}",
            push.joints,
            "possible" if doubtful else "likely",
            "leave this stretch out (frischid cut) if the log is to be fitted; a fit leaves out samples at standstill "
            "in any case",
        )


def _reach(log: Log, poses: Poses) -> str:
    """Joints whose angle is the same in all poses, in words."""
    if len(poses.t) < 2:
        return ""
    same = [n for n, span in zip(log.joints, np.ptp(poses.q, axis=0), strict=True) if span < 0.1]
    return f" ({listed(same)} at one angle only)" if same else ""
