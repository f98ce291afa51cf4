"""Friction that depends on more than the speed: on the load of the gear, and on its temperature.

    τ_f,j = |τ_rigid,j| tanh(q̇_j/w) (fl_j + fsl_j exp(−|q̇_j|/v_s)) + (fvt_j q̇_j + fct_j tanh(q̇_j/w)) ϑ(t)

Where the log holds no temperature, ϑ = 1 − exp(−(t − t_start)/T): the gearbox warms up with a time constant T. Where
the log holds a temperature, ϑ = temperature − reference.

Source: Bittencourt, Wernholt, Sander-Tavallaey and Brogårdh 2010, "An extended friction model to capture load and
temperature effects in robot joints", IEEE/RSJ IROS.
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
class LoadFriction(Effect):
    """Coulomb friction that grows with the load, ``fl |τ_rigid| tanh(q̇/width)``.

    Attributes
    ----------
    width : float
        Speed over which the sign is smoothed, rad/s (m/s).
    """

    id: ClassVar[str] = "load_friction"
    title: ClassVar[str] = "load-dependent friction"
    equation: ClassVar[str] = "fl·|τ_rigid|·tanh(v/width)"
    sentence: ClassVar[str] = "the dry friction of {joint} grows with the load that the gear carries"
    looks_like: ClassVar[str] = (
        "the residual drawn against speed has a step at zero, and the step is larger where the load is high"
    )
    confused_with: ClassVar[tuple[str, ...]] = ("coulomb", "drive_gain", "hysteresis")
    confirmed_by: ClassVar[str] = (
        "record the same slow reversals with the arm stretched out and folded, or with a payload"
    )
    reference: ClassVar[str] = "Hamon, Gautier and Garrec 2010, IEEE/RSJ IROS"

    friction: ClassVar[bool] = True
    code: ClassVar[Mapping[str, str]] = {"fl": "abs({load}) * tanh({v} / {width})"}

    dry: ClassVar[bool] = True
    smooths_sign: ClassVar[bool] = True
    loaded: ClassVar[bool] = True

    units: ClassVar[Mapping[str, tuple[str, str]]] = {"width": SPEED_UNITS}

    width: float = SIGN_WIDTH

    def __post_init__(self) -> None:
        self.require_positive(width="speed in rad/s (m/s)")

    def terms(self, state: State) -> list[Term]:
        """One column per joint: the size of its load times the smoothed sign of its speed."""
        return self.per_joint(
            state, "fl", "torque", lambda i: np.abs(state.load[:, i]) * np.tanh(state.v[:, i] / self.width), sign=1
        )


@dataclass(frozen=True)
class LoadStribeck(Effect):
    """Stribeck friction that grows with the load, ``fsl |τ_rigid| tanh(q̇/width) exp(−|q̇|/speed)``.

    Attributes
    ----------
    speed : float
        Speed at which the extra friction has fallen to 1/e, rad/s (m/s).
    width : float
        Speed over which the sign is smoothed, rad/s (m/s).
    """

    id: ClassVar[str] = "load_stribeck"
    title: ClassVar[str] = "Stribeck friction that grows with the load"
    equation: ClassVar[str] = "fsl·|τ_rigid|·tanh(v/width)·exp(−|v|/speed)"
    sentence: ClassVar[str] = (
        "{joint} needs more torque just after a reversal, and the more so the larger the load: under load the "
        "lubricant film is pressed out and builds up again with speed"
    )
    looks_like: ClassVar[str] = (
        "the residual drawn against speed has a peak on each side of zero, and the peaks are higher where the load is "
        "high"
    )
    confused_with: ClassVar[tuple[str, ...]] = ("stribeck", "load_friction", "hysteresis")
    confirmed_by: ClassVar[str] = (
        "record slow constant speeds, from 0.01 to 0.5 rad/s, once with the arm folded and once stretched out or with "
        "a payload: the peak at low speed grows with the load"
    )
    reference: ClassVar[str] = "Bittencourt and Gunnarsson 2012, ASME J. Dyn. Systems, Meas. and Control 134(5)"

    friction: ClassVar[bool] = True
    code: ClassVar[Mapping[str, str]] = {
        "fsl": "abs({load}) * tanh({v} / {width}) * exp(-abs({v}) / {speed})",
    }

    dry: ClassVar[bool] = True
    smooths_sign: ClassVar[bool] = True
    loaded: ClassVar[bool] = True
    shapes: ClassVar[Mapping[str, tuple[float, ...]]] = {"speed": (0.03, 0.1, 0.3)}

    units: ClassVar[Mapping[str, tuple[str, str]]] = {"speed": SPEED_UNITS, "width": SPEED_UNITS}

    speed: float = 0.1
    width: float = SIGN_WIDTH

    def __post_init__(self) -> None:
        self.require_positive(speed="speed in rad/s (m/s)", width="speed in rad/s (m/s)")

    def terms(self, state: State) -> list[Term]:
        """One column per joint: the size of its load times the smoothed sign of its speed, fading with the speed."""

        def column(i: int) -> Array:
            v = state.v[:, i]
            fading = np.exp(-np.abs(v) / self.speed)
            return np.asarray(np.abs(state.load[:, i]) * np.tanh(v / self.width) * fading)

        return self.per_joint(state, "fsl", "torque", column, sign=1)


@dataclass(frozen=True)
class ThermalDrift(Effect):
    """Friction that changes as the joint warms up, as a function of time or of its measured temperature.

    Attributes
    ----------
    constant : float
        Time constant of the warming, s; used when `by` is ``"time"``.
    by : {"time", "temperature"}
        ``"temperature"`` reads the log's channels ``temperature_<joint>``, °C.
    at : float
        Temperature at which the model's other friction parameters hold, °C.
    width : float
        Speed over which the sign is smoothed, rad/s (m/s).
    """

    id: ClassVar[str] = "thermal_drift"
    title: ClassVar[str] = "friction that changes with temperature"
    equation: ClassVar[str] = "(fvt·v + fct·tanh(v/width))·(1 − exp(−t/constant)), or ·(temperature − at)"
    sentence: ClassVar[str] = (
        "the friction of {joint} changes from the beginning of the log to its end: the joint warms up (or cools down)"
    )
    looks_like: ClassVar[str] = (
        "the step and the slope of the friction shrink (or grow) steadily from the beginning to the end"
    )
    confused_with: ClassVar[tuple[str, ...]] = ("self_heating", "viscous", "coulomb")
    confirmed_by: ClassVar[str] = (
        "start cold and repeat one motion for half an hour; if possible, record the joint's temperature too"
    )
    reference: ClassVar[str] = "Bittencourt, Wernholt, Sander-Tavallaey and Brogårdh 2010, IEEE/RSJ IROS"

    friction: ClassVar[bool] = True
    code: ClassVar[Mapping[str, str]] = {
        "fvt": "{v} * -expm1(-{t} / {constant})",
        "fct": "tanh({v} / {width}) * -expm1(-{t} / {constant})",
        "fvT": "{v} * ({temperature} - {at})",
        "fcT": "tanh({v} / {width}) * ({temperature} - {at})",
    }

    dry: ClassVar[bool] = True
    smooths_sign: ClassVar[bool] = True
    shapes: ClassVar[Mapping[str, tuple[float, ...]]] = {"constant": (10.0, 30.0, 100.0, 300.0, 1000.0)}

    units: ClassVar[Mapping[str, tuple[str, str]]] = {
        "constant": TIME_UNITS,
        "at": TEMPERATURE_UNITS,
        "width": SPEED_UNITS,
    }

    constant: float = 300.0
    by: str = "time"
    at: float = 25.0
    width: float = SIGN_WIDTH

    def __post_init__(self) -> None:
        if self.by not in WARMTH_SOURCES:
            raise UnknownNameError("source", str(self.by), WARMTH_SOURCES, "thermal_drift: by")
        if not is_number(self.at):
            raise InputError(f"thermal_drift: at must be a temperature in °C, got {self.at}")
        self.require_positive(constant="time in s", width="speed in rad/s (m/s)")

    @classmethod
    def variants(cls, joints: tuple[str, ...] | None) -> list[Self]:
        """Drift over time with every time constant, and drift with the measured temperature."""
        return [*super().variants(joints), cls(joints=joints, by="temperature")]

    @property
    def searched(self) -> Mapping[str, tuple[float, ...]]:
        """No time constant where the temperature is measured."""
        return self.shapes if self.by == "time" else {}

    def channels(self, robot: Robot) -> tuple[str, ...]:
        """``temperature_<joint>``, if the friction depends on the measured temperature."""
        if self.by == "time":
            return ()
        return tuple(f"temperature_{name}" for _, name, _ in self.acts_on(robot))

    def terms(self, state: State) -> list[Term]:
        """Two columns per joint: its speed and the smoothed sign of its speed, both times ϑ."""
        warmth = {i: self._warmth(state, name) for i, name, _ in self.acts_on(state.robot)}
        mark, per = ("t", "") if self.by == "time" else ("T", "kelvin")
        return [
            *self.per_joint(state, f"fv{mark}", f"rate {per}".strip(), lambda i: state.v[:, i] * warmth[i]),
            *self.per_joint(state, f"fc{mark}", per, lambda i: np.tanh(state.v[:, i] / self.width) * warmth[i]),
        ]

    def _warmth(self, state: State, joint: str) -> Array:
        if self.by == "time" or len(state.t) == 0:
            return np.asarray(-np.expm1(-(state.t - state.start) / self.constant))
        channel = f"temperature_{joint}"
        if channel not in state.extra:
            raise UnknownNameError("channel", channel, state.extra, "the log (thermal_drift by temperature)")
        return np.asarray(state.extra[channel] - self.at)
