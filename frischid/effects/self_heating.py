"""Friction that changes with the heat of a joint's own motion.

Friction turns power into heat, f(q̇) q̇, and the heat flows off with a time constant T. So the oil of a joint is warm
after fast motion and cold after slow motion, whatever the time since the log began:

    dh/dt = (|q̇|ⁿ − h) / T,     τ_f,j = (fvh_j q̇_j + fch_j tanh(q̇_j/w)) h_j.

n = 1 is the power of dry friction, n = 2 that of viscous friction; a joint with both lies between. `ThermalDrift` is
the case of a joint that moves in the same way all the time: h = |q̇|ⁿ (1 − exp(−t/T)). The two differ on logs of
different speed: one model of a slow and a fast log needs the heat.

From sample to sample, with the mean power of the two, the step of h is exact (`heat`).

Source: Bittencourt and Axelsson 2014, "Modeling and experiment design for identification of wear in a robot joint under
load and temperature uncertainties based on friction data", IEEE/ASME Trans. Mechatronics 19(5); Simoni, Beschi,
Legnani and Visioli 2015, "Friction modeling with temperature effects for industrial robot manipulators", IEEE/RSJ IROS.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from frischid.core.types import Array
from frischid.effects.base import Effect
from frischid.effects.state import SIGN_WIDTH, State, Term
from frischid.effects.units import SPEED_UNITS, TIME_UNITS

_AT_ONCE = 20.0  # time constants that are summed at once: exp(20) costs 9 of 16 digits of what has long decayed


def heat(t: Array, v: Array, constant: float, exponent: float) -> Array:
    """Heat h along a motion: the mean of |v|ⁿ over the past time constant, from a cold start.

    Parameters
    ----------
    t, v : ndarray, shape (N,)
        Time, s, and speed, rad/s (m/s).
    constant : float
        Time constant, s.
    exponent : float
        n.

    Returns
    -------
    ndarray, shape (N,)

    Examples
    --------
    >>> import numpy as np
    >>> from frischid.effects.self_heating import heat
    >>> t = np.linspace(0, 100, 1001)
    >>> heat(t, np.full(1001, 2.0), 10.0, 2.0)[[0, 100, 1000]].round(3)
    array([0.   , 2.528, 4.   ])
    """
    if len(t) < 2:
        return np.zeros(len(t))
    power = np.abs(v) ** exponent
    age = (t - t[0]) / constant
    added = -np.expm1(-np.diff(age)) * 0.5 * (power[1:] + power[:-1])
    h, now = np.zeros(len(t)), 0.0
    edges = np.flatnonzero(np.diff(np.floor(age[1:] / _AT_ONCE), prepend=-1.0))
    for first, stop in zip(edges.tolist(), [*edges[1:].tolist(), len(added)], strict=True):
        since = age[first + 1 : stop + 1] - age[first + 1]
        before = now * np.exp(age[first] - age[first + 1])
        h[first + 1 : stop + 1] = np.exp(-since) * (before + np.cumsum(added[first:stop] * np.exp(since)))
        now = float(h[stop])
    return h


@dataclass(frozen=True)
class SelfHeating(Effect):
    """Friction that changes with the heat that the joint's own motion makes.

    Attributes
    ----------
    constant : float
        Time constant with which the heat flows off, s.
    exponent : float
        Power of the speed to which the heat is proportional: 1 for dry friction, 2 for viscous friction.
    width : float
        Speed over which the sign is smoothed, rad/s (m/s).
    """

    id = "self_heating"
    title = "friction that changes with the joint's own heat"
    equation = "(fvh·v + fch·tanh(v/width))·h,  dh/dt = (|v|^exponent − h)/constant"
    sentence = (
        "the friction of {joint} changes with the heat of its own motion: after fast motion the friction is not the "
        "same as after slow motion"
    )
    looks_like = "the step and the slope of the friction shrink (or grow) after fast motion, and return in slow motion"
    confused_with = ("thermal_drift", "viscous", "coulomb", "cubic_viscous")
    confirmed_by = (
        "move the joint slowly, then fast for a few minutes, then slowly again: the two slow parts have different "
        "friction"
    )
    reference = "Bittencourt and Axelsson 2014, IEEE/ASME Trans. Mechatronics 19(5)"

    friction = True
    after_change = ("friction_change",)
    code: ClassVar = {"fvh": "{v} * {heat}", "fch": "tanh({v} / {width}) * {heat}"}
    dry = True
    smooths_sign = True
    memory = True
    shapes: ClassVar = {"constant": (10.0, 30.0, 100.0, 300.0, 1000.0), "exponent": (1.0, 2.0)}
    units: ClassVar = {"constant": TIME_UNITS, "width": SPEED_UNITS}

    constant: float = 100.0
    exponent: float = 2.0
    width: float = SIGN_WIDTH

    def __post_init__(self) -> None:
        self.require_positive(constant="time in s", exponent="power of the speed", width="speed in rad/s (m/s)")

    def terms(self, state: State) -> list[Term]:
        """Two columns per joint: its speed and the smoothed sign of its speed, both times the heat."""
        warm = {i: heat(state.t, state.v[:, i], self.constant, self.exponent) for i, *_ in self.acts_on(state.robot)}
        return [
            *self.per_joint(state, "fvh", "velocity", lambda i: state.v[:, i] * warm[i]),
            *self.per_joint(state, "fch", "", lambda i: np.tanh(state.v[:, i] / self.width) * warm[i]),
        ]
