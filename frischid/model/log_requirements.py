"""Channels that a log, and arrays that a motion, must have before a model can be used on them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from frischid.core.types import Array
from frischid.effects import Effect, State
from frischid.errors import InputError
from frischid.logs.log import Log, check_torque
from frischid.logs.recording import Recording, check_logs, preview_of
from frischid.robot.robot import Robot


def check_logs_fit(robot: Robot, joints: Sequence[str], logs: Sequence[Log | Recording]) -> None:
    """Refuse logs that lack a joint of the robot, or the torque of one of `joints`, which a model was fitted to.

    Raises
    ------
    InputError
    """
    check_logs(logs, ())
    for log in logs:
        head = preview_of(log)
        absent = [n for n in robot.joints if n not in head.joints]
        if absent:
            raise InputError(
                f"{log.source}: no position (q_<joint>) of {', '.join(absent)}, and the model needs every joint's; "
                f"the log has {', '.join(head.joints)}"
            )
        if isinstance(log, Log):
            check_torque(head, joints)
        there = head.has("tau")
        missing = [n for n, j in zip(joints, head.index(joints), strict=True) if not there[j]]
        if missing:
            raise InputError(
                f"{log.source}: no torque (tau_<joint>) of {', '.join(missing)}, which the model was fitted to; "
                "leave the log out, or identify again with --torque-joints that it has"
            )


def check_effects_act(robot: Robot, joints: Sequence[str], effects: Sequence[Effect]) -> None:
    """Refuse effects on a joint that act on none of `joints`, the joints whose torque a model was fitted to.

    Raises
    ------
    InputError
    """
    fitted = {robot.joints.index(name) for name in joints}
    for effect in effects:
        rows = [(term.column.joint, set(term.rows)) for term in effect.terms(State.empty(robot))]
        for i, name, _ in effect.acts_on(robot) if effect.joints else ():
            mine = [acts for joint, acts in rows if joint == name or i in acts]
            if mine and not any(acts & fitted for acts in mine):
                raise InputError(
                    f"{effect}: the logs that the model was fitted to have no torque of {name}, so nothing shows this "
                    f"effect there; name joints whose torque was fitted: {', '.join(joints)}"
                )


def motion_of(joints: Sequence[str], q: Any, v: Any, a: Any) -> tuple[Array, Array, Array]:
    """Positions, velocities and accelerations as arrays of floats, (N, J) each.

    Parameters
    ----------
    joints : sequence of str
        The robot's J joints.
    q, v, a : array_like, shape (N, J) or (J,)

    Raises
    ------
    InputError
        An array does not have J columns, or the lengths differ.
    """
    q, v, a = (np.atleast_2d(np.asarray(x, dtype=float)) for x in (q, v, a))
    for name, x in (("q", q), ("v", v), ("a", a)):
        if x.ndim != 2 or x.shape[1] != len(joints) or len(x) != len(q):
            raise InputError(
                f"{name} has the shape {x.shape}; expected ({len(q)}, {len(joints)}): a row for each sample of q, a "
                f"column for each of {', '.join(joints)}"
            )
    return q, v, a
