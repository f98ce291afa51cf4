"""Channels that a log must have before a model can be compared with it."""

from __future__ import annotations

from collections.abc import Sequence

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
        there = head.select(joints).has("tau")
        missing = [n for n, known in zip(joints, there, strict=True) if not known]
        if missing:
            raise InputError(
                f"{log.source}: no torque (tau_<joint>) of {', '.join(missing)}, which the model was fitted to; "
                "leave the log out, or identify again with --torque-joints that it has"
            )
