"""The age of a position controller's commands, where another age is known.

A log of commands has the torque that the controller, as it is known, computes (`frischid.logs.controller`):

    τ_computed,j = kp_j (c_j(t) − q_j) + …,      c_j(t) = q_cmd,j(t − d)

If the commands act δ later than d, the torque at the joint is another one:

    τ_computed,j ≈ τ_j + δ · d/dt (kp_j c_j + …)

The column needs the commands, so this effect is tried on logs of commands only. It is no torque of the robot, so
exported code leaves it out; the table of drives has the corrected delay.

A wrong kp has no effect of its own. Its column would be the position error, of which the computed torque is a multiple:
with any model error, least squares would find that kp is zero and that the robot weighs nothing. `drive_gain`, whose
column is the torque of the reference parameters, finds a wrong kp.

Source: Franklin, Powell and Emami-Naeini 2019, Feedback Control of Dynamic Systems, 8th edition, Pearson.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Self

from frischid.core.types import Array
from frischid.effects.base import Effect
from frischid.effects.state import State, Term
from frischid.errors import InputError
from frischid.logs.controller import PUSH_RATE
from frischid.robot.robot import Robot


@dataclass(frozen=True)
class CommandDelay(Effect):
    """Commands that act later than is known: one delay for all joints, or one for each joint named."""

    id: ClassVar[str] = "command_delay"
    title: ClassVar[str] = "commands that act later"
    equation: ClassVar[str] = "late·rate"
    symbols: ClassVar[Mapping[str, str]] = {
        "late": "identified coefficient: time by which commands act later than the controller's delay says",
        "rate": "rate of the torque that follows from commands alone, kp·q_cmd + kd·v_cmd + τ_ff",
    }
    sentence: ClassVar[str] = (
        "the commands of {joint} act later (or earlier) than the controller's delay says: name the delay (--delay)"
    )
    looks_like: ClassVar[str] = (
        "an error like negative viscous friction, that follows the speed of the command and not that of the joint"
    )
    confused_with: ClassVar[tuple[str, ...]] = ("viscous", "time_delay", "rotor_inertia")
    confirmed_by: ClassVar[str] = "command a sudden small step and read how long the joint takes to begin to move"
    reference: ClassVar[str] = "Franklin, Powell and Emami-Naeini 2019, Feedback Control of Dynamic Systems, Pearson"

    of_controller: ClassVar[bool] = True
    least: ClassVar[float] = 5e-4  # s: half a period of the usual command loop, the rounding of a time stamp

    @classmethod
    def candidates(cls, robot: Robot) -> list[list[Self]]:
        """The same delay on all joints, or a delay on one joint alone."""
        return [cls.variants(None), *(cls.variants((name,)) for name in robot.joints)]

    def channels(self, robot: Robot) -> tuple[str, ...]:
        """``controller_push_rate_<joint>``, which a log of commands has."""
        return tuple(PUSH_RATE + name for _, name, _ in self.acts_on(robot))

    def terms(self, state: State) -> list[Term]:
        """Rate of the commanded torque: all joints in one column, or one column for each joint named."""
        rates = {i: _channel(state, PUSH_RATE + name) for i, name, _ in self.acts_on(state.robot)}
        if self.joints is not None:
            return self.per_joint(state, "late", "torque rate", lambda i: rates[i])
        return [Term(self.column("late", "s", state.robot.joints[0], ""), rates)]


def _channel(state: State, name: str) -> Array:
    """Values of a channel; a motion without samples only asks for names.

    Raises
    ------
    InputError
        The log has no commands.
    """
    if len(state.t) and name not in state.extra:
        raise InputError(
            f"the log has no channel '{name}': this effect corrects a controller, so it needs a log of commands "
            "(qcmd_<joint>) and a model with a controller (--controller pd)"
        )
    return state.extra[name] if len(state.t) else state.t
