"""Corrections of a known position controller: the age of its commands, its position gain and its damping.

A log of commands has the torque that the controller, as it is known, computes (`frischid.logs.controller`):

    τ_computed,j = kp_j (c_j(t) − q_j) + r_j(t),      c_j(t) = q_cmd,j(t − d),      r_j = kd_j (v_cmd,j − q̇_j) + τ_ff,j

*Delay.* If the commands act δ later than d, the torque at the joint is another one:

    τ_computed,j ≈ τ_j + δ · d/dt (kp_j c_j + …)

*Position gain.* If the true gain is kp_j / (1 + g), the torque is τ_j = kp_j (c_j − q_j) / (1 + g) + r_j, so

    τ_computed,j = τ_j + g (τ_j − r_j)

The column is the torque of the reference parameters less r_j. The damping kd of the drive is not scaled. The position
error itself is no column: the computed torque is a multiple of the position error, so with any model error, least
squares would find that kp is zero and that the robot weighs nothing. The reference parameters were fitted with the
wrong kp, so 1 + g is nearly the ratio of the gains: name the corrected kp and identify again.

*Damping.* If kd is not known, the computed torque is kp_j (c_j − q_j) + τ_ff,j, and kd_j is a coefficient of the fit:

    τ_computed,j = τ_j + kd_j (q̇_j − v_c,j),      v_c,j(t) = v_cmd,j(t − d)

Without commanded velocities, v_c = 0 and the column is that of viscous friction: only kd + fv is known.

The columns need the commands, so these effects are tried on logs of commands only. They are no torques of the robot:
exported code leaves them out, and the table of drives has the corrected delay and gain.

Source: Franklin, Powell and Emami-Naeini 2019, Feedback Control of Dynamic Systems, 8th edition, Pearson.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

from frischid.core.types import Array
from frischid.effects.base import Effect
from frischid.effects.state import State, Term
from frischid.errors import InputError
from frischid.logs.controller import PUSH_RATE, REST, VELOCITY_COMMAND
from frischid.robot.robot import Robot


@dataclass(frozen=True)
class CommandDelay(Effect):
    """Commands that act later than is known: one delay for all joints, or one for each joint named."""

    id = "command_delay"
    title = "commands that act later"
    equation = "late·rate"
    symbols: ClassVar = {
        "late": "identified coefficient: time by which commands act later than the controller's delay says",
        "rate": "rate of the torque that follows from commands alone, kp·q_cmd + kd·v_cmd + τ_ff",
    }
    sentence = (
        "the commands of {joint} act later (or earlier) than the controller's delay says: name the delay (--delay)"
    )
    looks_like = (
        "an error like negative viscous friction, that follows the speed of the command and not that of the joint"
    )
    confused_with = ("viscous", "time_delay", "rotor_inertia")
    confirmed_by = "command a sudden small step and read how long the joint takes to begin to move"
    reference = "Franklin, Powell and Emami-Naeini 2019, Feedback Control of Dynamic Systems, Pearson"

    of_controller = True
    least = 5e-4  # s: half a period of the usual command loop, the rounding of a time stamp

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


@dataclass(frozen=True)
class PositionGain(Effect):
    """A position gain that is not the controller's: the true kp is the known one over ``1 + soft``."""

    id = "position_gain"
    title = "another position gain of the controller"
    equation = "soft·(τ_model − rest)"
    symbols: ClassVar = {
        "soft": "identified coefficient: the known kp over the true kp, less 1",
        "rest": "torque of the controller that the position error does not cause, kd·(v_cmd − q̇) + τ_ff",
    }
    sentence = (
        "the kp of {joint} is not the one that the controller was given: it is the given one over 1 + soft (--kp)"
    )
    looks_like = "the residual is a copy of the position error, on this joint only"
    confused_with = ("payload", "load_friction", "joint_spring")
    confirmed_by = "hang a known weight on the link, hold still, and read how far the joint stays behind its command"
    reference = "Franklin, Powell and Emami-Naeini 2019, Feedback Control of Dynamic Systems, Pearson"

    of_controller = True
    loaded = True

    def channels(self, robot: Robot) -> tuple[str, ...]:
        """``controller_rest_<joint>``, which a log of commands has."""
        return tuple(REST + name for _, name, _ in self.acts_on(robot))

    def terms(self, state: State) -> list[Term]:
        """One column per joint: its torque less the controller's torque beside the position error."""
        rest = {i: _channel(state, REST + name) for i, name, _ in self.acts_on(state.robot)}
        return self.per_joint(state, "soft", "torque", lambda i: state.torque[:, i] - rest[i])


@dataclass(frozen=True)
class VelocityGain(Effect):
    """A damping gain that the controller's description leaves open."""

    id = "velocity_gain"
    title = "damping gain of the controller"
    equation = "kd·(v − v_cmd)"
    symbols: ClassVar = {
        "kd": "identified coefficient: the drive's torque per velocity error",
        "v_cmd": "commanded velocity, zero where the log has none",
    }
    sentence = "the drive of {joint} damps the difference between its velocity and the commanded one"
    looks_like = "an error in proportion to the velocity less the commanded velocity"
    confused_with = ("viscous", "command_delay", "time_delay")
    confirmed_by = "command the same positions with their velocities, then with the velocity zero"
    reference = "Franklin, Powell and Emami-Naeini 2019, Feedback Control of Dynamic Systems, Pearson"

    of_controller = True
    candidate = "never"  # a kd that is named is taken as known; identify adds this column where kd is open

    def channels(self, robot: Robot) -> tuple[str, ...]:
        """``controller_velocity_command_<joint>``, which a log of commands has where kd is open."""
        return tuple(VELOCITY_COMMAND + name for _, name, _ in self.acts_on(robot))

    def terms(self, state: State) -> list[Term]:
        """One column per joint: its velocity less the commanded one."""
        wanted = {i: _channel(state, VELOCITY_COMMAND + name) for i, name, _ in self.acts_on(state.robot)}
        return self.per_joint(state, "kd", "velocity", lambda i: state.v[:, i] - wanted[i], sign=1)


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
