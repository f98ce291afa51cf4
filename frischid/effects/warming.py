"""Torques that change while a joint warms up: its friction, and the zero of its torque.

    τ_j = (fvt_j q̇_j + fct_j tanh(q̇_j/w) + offt_j) ϑ(t)

Where the log holds no temperature, ϑ = 1 − exp(−(t − t_start)/T): the joint warms up with a time constant T. Where the
log holds a temperature, ϑ = temperature − reference.

Sources: Bittencourt, Wernholt, Sander-Tavallaey and Brogårdh 2010, "An extended friction model to capture load and
temperature effects in robot joints", IEEE/RSJ IROS (friction); Albu-Schäffer, Haddadin, Ott, Stemmer, Wimböck and
Hirzinger 2007, "The DLR lightweight robot", Industrial Robot 34(5) (torque sensors in joints).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from frischid.core.types import Array
from frischid.effects.base import Effect
from frischid.effects.state import SIGN_WIDTH, State, Term
from frischid.effects.units import SPEED_UNITS, TEMPERATURE_UNITS, TIME_UNITS, is_number
from frischid.errors import InputError, UnknownNameError
from frischid.robot.robot import Robot

WARMTH_SOURCES = ("time", "temperature")


@dataclass(frozen=True)
class Warming(Effect):
    """An effect that follows the warmth of a joint, as a function of time or of its measured temperature.

    Attributes
    ----------
    constant : float
        Time constant of the warming, s; used when `by` is ``"time"``.
    by : {"time", "temperature"}
        ``"temperature"`` reads the log's channels ``temperature_<joint>``, °C.
    at : float
        Temperature at which the model's other parameters hold, °C.
    """

    shapes: ClassVar = {"constant": (10.0, 30.0, 100.0, 300.0, 1000.0)}
    units: ClassVar = {"constant": TIME_UNITS, "at": TEMPERATURE_UNITS}

    constant: float = 300.0
    by: str = "time"
    at: float = 25.0

    def __post_init__(self) -> None:
        if self.by not in WARMTH_SOURCES:
            raise UnknownNameError("source", str(self.by), WARMTH_SOURCES, f"{self.id}: by")
        if not is_number(self.at):
            raise InputError(f"{self.id}: at must be a temperature in °C, got {self.at}")
        self.require_positive(constant="time in s")

    @classmethod
    def variants(cls, joints: tuple[str, ...] | None) -> list[Self]:
        """Drift over time with every time constant, and drift with the measured temperature."""
        return [*super().variants(joints), cls(joints=joints, by="temperature")]

    @property
    def searched(self) -> Mapping[str, tuple[float, ...]]:
        """No time constant where the temperature is measured."""
        return self.shapes if self.by == "time" else {}

    def channels(self, robot: Robot) -> tuple[str, ...]:
        """``temperature_<joint>``, if the effect depends on the measured temperature."""
        if self.by == "time":
            return ()
        return tuple(f"temperature_{name}" for _, name, _ in self.acts_on(robot))

    @property
    def mark(self) -> tuple[str, str]:
        """Last letter of the parameters' names, and their unit besides that of the column."""
        return ("t", "") if self.by == "time" else ("T", "kelvin")

    def warmth(self, state: State, joint: str) -> Array:
        """ϑ of a joint at each sample, (N,)."""
        if self.by == "time" or len(state.t) == 0:
            return np.asarray(-np.expm1(-(state.t - state.start) / self.constant))
        channel = f"temperature_{joint}"
        if channel not in state.extra:
            raise UnknownNameError("channel", channel, state.extra, f"the log ({self.id} by temperature)")
        return np.asarray(state.extra[channel] - self.at)


@dataclass(frozen=True)
class ThermalDrift(Warming):
    """Friction that changes as the joint warms up.

    Attributes
    ----------
    constant, by, at
        As for `Warming`.
    width : float
        Speed over which the sign is smoothed, rad/s (m/s).
    """

    id = "thermal_drift"
    title = "friction that changes with temperature"
    equation = "(fvt·v + fct·tanh(v/width))·(1 − exp(−t/constant)), or ·(temperature − at)"
    sentence = (
        "the friction of {joint} changes from the beginning of the log to its end: the joint warms up (or cools down)"
    )
    looks_like = "the step and the slope of the friction shrink (or grow) steadily from the beginning to the end"
    confused_with = ("self_heating", "viscous", "coulomb", "torque_drift")
    confirmed_by = "start cold and repeat one motion for half an hour; if possible, record the joint's temperature too"
    reference = "Bittencourt, Wernholt, Sander-Tavallaey and Brogårdh 2010, IEEE/RSJ IROS"

    friction = True
    after_change = ("friction_change",)
    code: ClassVar = {
        "fvt": "{v} * -expm1(-{t} / {constant})",
        "fct": "tanh({v} / {width}) * -expm1(-{t} / {constant})",
        "fvT": "{v} * ({temperature} - {at})",
        "fcT": "tanh({v} / {width}) * ({temperature} - {at})",
    }
    dry = True
    smooths_sign = True
    units: ClassVar = {**Warming.units, "width": SPEED_UNITS}

    width: float = SIGN_WIDTH

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require_positive(width="speed in rad/s (m/s)")

    def terms(self, state: State) -> list[Term]:
        """Two columns per joint: its speed and the smoothed sign of its speed, both times ϑ."""
        warmth = {i: self.warmth(state, name) for i, name, _ in self.acts_on(state.robot)}
        mark, per = self.mark
        return [
            *self.per_joint(state, f"fv{mark}", f"velocity {per}".strip(), lambda i: state.v[:, i] * warmth[i]),
            *self.per_joint(state, f"fc{mark}", per, lambda i: np.tanh(state.v[:, i] / self.width) * warmth[i]),
        ]


@dataclass(frozen=True)
class TorqueDrift(Warming):
    """A torque whose zero moves as the joint warms up: a torque sensor in the joint, or a current sensor."""

    id = "torque_drift"
    title = "torque zero that drifts"
    equation = "offt·(1 − exp(−t/constant)), or offT·(temperature − at)"
    sentence = (
        "the zero of {joint}'s torque moves from the beginning of the log to its end, whatever the joint does: the "
        "torque sensor or the current sensor warms up (or cools down)"
    )
    looks_like = "the residual drawn against time is a slow curve, the same at rest and in motion"
    confused_with = ("thermal_drift", "offset", "joint_spring")
    confirmed_by = (
        "switch on, hold one pose for half an hour and record the torque; tare the sensor when the joint is warm"
    )
    reference = "Albu-Schäffer et al. 2007, Industrial Robot 34(5)"

    of_recording = True
    after_change = ("offset_change",)
    code: ClassVar = {
        "offt": "-expm1(-{t} / {constant})",
        "offT": "({temperature} - {at})",
    }

    def terms(self, state: State) -> list[Term]:
        """One column per joint: ϑ."""
        mark, per = self.mark
        names = {i: name for i, name, _ in self.acts_on(state.robot)}
        return self.per_joint(state, f"off{mark}", per, lambda i: self.warmth(state, names[i]))
