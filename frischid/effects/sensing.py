"""Errors of measured channels: the gain of a torque, a delay, the zero of an encoder.

    τ_measured,j(t) = (1 + gain_j) τ_j(t − delay_j) ≈ τ_j + gain_j τ_j + delay_j (τ_j(t − size) − τ_j)/size

with τ the torque of the reference parameters. With ``q_measured,j = q_j + zero_j`` the arm's true pose differs from the
log's, so ``τ(q) ≈ τ(q_measured) − ∂τ/∂q_j zero_j``.

Sources: Gautier and Briot 2014, ASME J. Dynamic Systems, Measurement and Control 136(5); Leboutet, Roux, Janot,
Guadarrama-Olvera and Cheng 2021, "Inertial parameter identification in robotics: a survey", Applied Sciences 11(9);
Mooring, Roth and Driels 1991, Fundamentals of Manipulator Calibration, Wiley.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from frischid.effects.base import Effect
from frischid.effects.dynamics import felt_slopes
from frischid.effects.state import State, Term
from frischid.effects.units import TIME_UNITS, is_number, torque_unit
from frischid.errors import InputError
from frischid.robot.robot import Robot


@dataclass(frozen=True)
class DriveGain(Effect):
    """A torque channel with a wrong scale, ``1 + gain``: a wrong motor constant or gear ratio."""

    id = "drive_gain"
    title = "mis-scaled torque channel"
    equation = "gain·τ_model"
    sentence = (
        "the torque of {joint} is too large or too small by a constant factor: the motor constant, the current scale "
        "or the gear ratio is wrong"
    )
    looks_like = "the residual is a copy of the torque itself, on this joint only"
    confused_with = ("payload", "load_friction", "time_delay")
    confirmed_by = "put a known weight on the link: the torque must change by the torque of that weight"
    reference = "Gautier and Briot 2014, ASME J. Dynamic Systems, Measurement and Control 136(5)"

    of_recording = True
    loaded = True
    code: ClassVar = {"gain": "{torque}"}

    def terms(self, state: State) -> list[Term]:
        """One column per joint: its torque."""
        return self.per_joint(state, "gain", "torque", lambda i: state.torque[:, i])


@dataclass(frozen=True)
class TimeDelay(Effect):
    """Torque recorded later than positions: one delay for all joints, or one for each joint named.

    Attributes
    ----------
    size : float
        Delay for which the change of the torque is calculated, s. The identified parameter is the delay; it should be
        close to `size`.
    """

    id = "time_delay"
    title = "delay between torque and position"
    equation = "delay·(τ_model(t − size) − τ_model(t))/size"
    symbols: ClassVar = {
        "delay": "identified coefficient: time by which the torque is late; negative where it is early",
    }
    sentence = (
        "the torque of {joint} is recorded later than the position (earlier, if the delay is negative): the channels "
        "are shifted"
    )
    looks_like = "an error like the time derivative of the torque, largest where the torque changes fastest"
    confused_with = ("viscous", "elasticity", "rotor_inertia", "hysteresis")
    confirmed_by = "record a sudden step of one joint and compare the times at which the two channels move"
    reference = "Leboutet, Roux, Janot, Guadarrama-Olvera and Cheng 2021, Applied Sciences 11(9)"

    memory = True
    least = 5e-4  # s: half a period of the usual torque loop, the rounding of a time stamp
    internal = ("size",)
    of_recording = True
    loaded = True
    shapes: ClassVar = {"size": (-0.03, -0.003, 0.003, 0.01, 0.03, 0.1)}
    units: ClassVar = {"size": TIME_UNITS}

    size: float = 0.003

    def __post_init__(self) -> None:
        if not (is_number(self.size) and self.size != 0):
            raise InputError(f"{self.id}: size must be a time in s other than zero, got {self.size}")

    @property
    def reverse(self) -> Self:
        """The same shift in the other direction."""
        return dataclasses.replace(self, size=-self.size)

    @classmethod
    def candidates(cls, robot: Robot) -> list[list[Self]]:
        """The same delay on all joints, or a delay on one joint alone."""
        return [cls.variants(None), *(cls.variants((name,)) for name in robot.joints)]

    def terms(self, state: State) -> list[Term]:
        """Change of the torque over `size`: all joints in one column, or one column for each joint named."""
        change = (state.earlier(state.torque, self.size) - state.torque) / self.size
        if self.joints is not None:
            return self.per_joint(state, "delay", "torque rate", lambda i: change[:, i])
        column = self.column("delay", "s", state.robot.joints[0], "")
        return [Term(column, {i: change[:, i] for i in range(change.shape[1])})]


@dataclass(frozen=True)
class EncoderZero(Effect):
    """An encoder zero with a small error: the arm's true pose differs from the log's."""

    id = "encoder_zero"
    title = "shifted encoder zero"
    equation = "−zero·∂τ_rigid/∂q"
    symbols: ClassVar = {
        "zero": "identified coefficient: offset of the encoder's zero",
    }
    sentence = "the angle of {joint} has a constant error: the encoder was zeroed at a wrong angle, or slipped"
    looks_like = "errors that follow the pose, on this joint and on the joints that it turns against gravity"
    confused_with = ("gravity_tilt", "payload", "offset")
    confirmed_by = "drive the joint to its mechanical mark and read the angle"
    reference = "Mooring, Roth and Driels 1991, Fundamentals of Manipulator Calibration, Wiley"

    loaded = True

    def terms(self, state: State) -> list[Term]:
        """One column per joint whose angle changes some torque: minus the derivative of the torque by that angle."""
        slope, felt = state.slopes.position, felt_slopes(state.robot)
        return [
            Term(
                self.column("zero", torque_unit(state.robot, j, "torque slope"), name, number),
                {i: -slope[:, i, j] for i in np.flatnonzero(felt[:, j]).tolist()},
            )
            for j, name, number in self.acts_on(state.robot)
            if felt[:, j].any()
        ]
