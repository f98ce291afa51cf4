"""Channels that a log must have before a model can be used on it."""

from __future__ import annotations

from collections.abc import Sequence

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
                f"the log has {', '.join(head.joints)}; name the column in a mapping file (`frischid map LOG ROBOT -o "
                "map.toml` proposes one), or leave the log out"
            )
        if isinstance(log, Log):
            check_torque(head, joints, fitted=True)
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
