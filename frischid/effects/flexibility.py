"""Links that are not quite where the motor's encoder says: elastic joints and gears with play.

The encoder sits on the motor, the link lags behind by a deflection δ that depends on the torque it needs. To first
order in δ the motor feels

    τ = τ_rigid(q − δ e_j) ≈ τ_rigid − (∂τ/∂q_j δ + ∂τ/∂q̇_j δ̇ + M_j δ̈),

The load of a link on a spring of stiffness k deflects it, and so does its swinging, which the motor does not see:

    M_jj δ̈ + (∂τ_j/∂q̇_j + d) δ̇ + (∂τ_j/∂q_j + k) δ = load_j,

``δ = load_j / k`` for a stiff spring. In a gap of ±g the load keeps the link on one side, ``δ = ±g``, until it changes
its sign; then nothing holds the link and it falls to the other side,

    δ̈ = load_j / M_jj   while |δ| < g,

and stops there. While it falls the motor loses its inertia and weight, and when it arrives, the motor is hit: both are
in δ̈.

Sources: Spong 1987, ASME J. Dynamic Systems, Measurement and Control 109(4); Nordin and Gutman 2002, "Controlling
mechanical systems with backlash: a survey", Automatica 38(10).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from scipy import linalg

from frischid.effects.base import ANGLE, SECONDS, Array, Effect, State, Term, is_number, torque_unit
from frischid.errors import InputError


def require_share(effect: str, rubbing: float) -> None:
    """Raise InputError unless this can be a share of the friction."""
    if not is_number(rubbing) or rubbing < 0:
        raise InputError(f"{effect}: rubbing must be a share of the friction, 0 or more, got {rubbing}")


def deflected(state: State, joint: int, deflection: Array) -> dict[int, Array]:
    """First-order change of the torque on every joint when a link lags its joint's encoder by `deflection`, (N,)."""
    if not np.isfinite(deflection).all():
        return {i: np.full(len(deflection), np.nan) for i in range(len(state.robot.joints))}
    position, velocity, acceleration = (slope[:, :, joint] for slope in state.slopes)
    first, second = state.rates(deflection)
    change = position * deflection[:, None] + velocity * first[:, None] + acceleration * second[:, None]
    return {i: -change[:, i] for i in range(change.shape[1])}


DAMPING = 0.05
"""Of a link that swings on its spring, as a share of what stops it from swinging."""

WEAK = 0.1
"""Share of a spring's stiffness that the weight of the link must leave."""

RESOLVED = 5.0
"""Samples in a period, fewer than which do not show a swing."""


def swing(state: State, joint: int, load: Array, period: float) -> Array:
    """Torque of the spring that carries a link, (N,): what the link needs, and what its swinging adds.

    Implicit differences, stable for any stiffness: k δ is the solution of a lower triangular system of bandwidth two.
    What would drive the swing is left out, for it would grow without end; not a number where the spring is so weak that
    the link's weight overcomes it.

    Parameters
    ----------
    state : State
    joint : int
    load : ndarray, shape (N,)
        Torque the link needs where its joint's encoder says, N·m (N).
    period : float
        Of the link's swing, in a pose of mean inertia, while the motor stands still, s. What is shorter than a few
        samples is taken as none.
    """
    if len(load) < 3 or period < RESOLVED * np.median(np.diff(state.t)):
        return load
    position, velocity, acceleration = (slope[:, joint, joint] for slope in state.slopes)
    inertia, omega = state.rigid.inertia[joint], 2 * np.pi / period
    k = omega**2 * inertia
    stiff, inert = 1 + position / k, np.maximum(acceleration, 0.05 * inertia) / k
    if stiff.min() < WEAK:
        return np.full(len(load), np.nan)
    damped = np.maximum(velocity / k + 2 * DAMPING / omega, 0.0)
    before, after = np.diff(state.t)[:-1], np.diff(state.t)[1:]
    both = before + after
    held, drag, swung = stiff[1:-1] / 4, damped[1:-1] / both, 2 * inert[1:-1] / both
    bands, right = np.zeros((3, len(load))), load.copy()
    bands[0, :2], right[:2] = 1.0, load[:2] / stiff[:2]
    bands[0, 2:] = swung / after + drag + held
    bands[1, 1:-1] = -swung * (1 / before + 1 / after) + 2 * held
    bands[2, :-2] = swung / before - drag + held
    right[2:] = load[1:-1]
    return np.asarray(linalg.solve_banded((2, 0), bands, right))


@dataclass(frozen=True)
class Elasticity(Effect):
    """Flexible transmission seen from the motor: the link lags by its spring's torque times the compliance ``ce``.

    Attributes
    ----------
    period : float
        In which the link, in a pose of mean inertia, swings while the motor stands still, s; 0: it is too stiff to.
    rubbing : float
        Share of the joint's friction that acts behind the transmission, on the link.
    """

    id: ClassVar[str] = "elasticity"
    title: ClassVar[str] = "joint elasticity"
    equation: ClassVar[str] = "ce·(∂τ_rigid/∂δ)[−s],  s the spring's torque: s + (∂τ/∂q·s + ∂τ/∂v·s′ + M·s″)/k = load"
    sentence: ClassVar[str] = (
        "{joint} gives way under its load: its transmission is elastic, and the link lags behind the motor's encoder"
    )
    looks_like: ClassVar[str] = "an error like the load's second derivative, largest where the motion is most sudden"
    confused_with: ClassVar[tuple[str, ...]] = ("backlash", "time_delay", "rotor_inertia")
    confirmed_by: ClassVar[str] = (
        "record fast oscillations up to the first resonance; or load the tip and measure how it sinks"
    )
    reference: ClassVar[str] = "Spong 1987, ASME J. Dynamic Systems, Measurement and Control 109(4)"

    memory: ClassVar[bool] = True
    loaded: ClassVar[bool] = True
    shapes: ClassVar[Mapping[str, tuple[float, ...]]] = {
        "period": (0.0, 0.08, 0.11, 0.14, 0.17, 0.21, 0.26, 0.33, 0.42),
        "rubbing": (0.0, 0.33, 0.67),
    }

    units: ClassVar[Mapping[str, tuple[str, str]]] = {"period": SECONDS}

    period: float = 0.0
    rubbing: float = 0.0

    def __post_init__(self) -> None:
        if not is_number(self.period) or self.period < 0:
            raise InputError(f"{self.id}: period must be a time in s, 0 or more, got {self.period}")
        require_share(self.id, self.rubbing)

    def terms(self, state: State) -> list[Term]:
        """One column a joint, felt by all."""
        return [
            Term(
                self.column("ce", torque_unit(state.robot, i, "torque slope torque"), name, number, sign=1),
                deflected(state, i, swing(state, i, state.passed(i, self.rubbing), self.period)),
            )
            for i, name, number in self.acts_on(state.robot)
        ]


def play(t: Array, load: Array, inertia: Array, gap: float) -> Array:
    """How far a link lies from the middle of its gear's play.

    Parameters
    ----------
    t, load, inertia : ndarray, shape (N,)
        Time, s; torque the link needs, N·m (N); its inertia about the joint, kg·m² (kg).
    gap : float
        Half the play, rad (m).

    Returns
    -------
    ndarray, shape (N,)
        Between −gap and gap.
    """
    pull, step = load / np.maximum(inertia, 0.05 * np.abs(inertia).max(initial=1e-300)), np.diff(t, prepend=t[:1])
    out = np.empty(len(t))
    here, side = 0, float(np.sign(load[0]) or 1.0) if len(t) else 1.0
    while here < len(t):
        loose = np.flatnonzero(side * load[here:] < 0)
        free = here + (int(loose[0]) if len(loose) else len(t) - here)
        out[here:free] = side * gap
        fall, here = _fall(pull, step, free, side * gap)
        out[free:here] = fall
        if here < len(t):
            side = float(np.sign(fall[-1]))
    return np.clip(out, -gap, gap)


def _fall(pull: Array, step: Array, start: int, position: float, piece: int = 256) -> tuple[Array, int]:
    """Free motion from rest at one end of the play until an end is reached; it, and the sample after."""
    found, speed = [], 0.0
    limit = abs(position)
    while start < len(pull):
        part = slice(start, start + piece)
        v = speed + np.cumsum(pull[part] * step[part])
        x = position + np.cumsum(v * step[part])
        out = np.flatnonzero(np.abs(x) >= limit)
        if len(out):
            found.append(x[: out[0] + 1])
            return np.concatenate(found), start + int(out[0]) + 1
        found.append(x)
        start, position, speed = start + len(x), float(x[-1]), float(v[-1])
    return np.concatenate(found) if found else np.empty(0), start


@dataclass(frozen=True)
class Backlash(Effect):
    """Play in a gear: when the load changes sides the link crosses the gap, and the motor loses its load meanwhile.

    Attributes
    ----------
    size : float
        Half the play for which the link's fall is calculated, rad (m); the parameter, the play found, should agree.
    rubbing : float
        Share of the joint's friction that acts behind the gear, on the link.
    """

    id: ClassVar[str] = "backlash"
    title: ClassVar[str] = "backlash"
    equation: ClassVar[str] = "gap·(∂τ_rigid/∂δ)[−δ/size],  δ″ = load/M while |δ| < size, else δ = ±size"
    sentence: ClassVar[str] = (
        "{joint} loses its load for a moment whenever the load changes sides, and is hit when it catches it again: "
        "play in its gear"
    )
    looks_like: ClassVar[str] = "short pulses where the joint's load torque passes through zero, whatever the speed"
    confused_with: ClassVar[tuple[str, ...]] = ("elasticity", "hysteresis", "stribeck")
    confirmed_by: ClassVar[str] = "hold the motor, push the link to and fro: it moves freely over the gap"
    reference: ClassVar[str] = "Nordin and Gutman 2002, Automatica 38(10)"

    memory: ClassVar[bool] = True
    loaded: ClassVar[bool] = True
    shapes: ClassVar[Mapping[str, tuple[float, ...]]] = {
        "size": (0.0003, 0.001, 0.003, 0.01, 0.03),
        "rubbing": (0.0, 0.5),
    }

    units: ClassVar[Mapping[str, tuple[str, str]]] = {"size": ANGLE}

    size: float = 0.003
    rubbing: float = 0.0

    def __post_init__(self) -> None:
        self.require_positive(size="angle in rad (distance in m)")
        require_share(self.id, self.rubbing)

    def terms(self, state: State) -> list[Term]:
        """One column a joint, half its gap, felt by all."""
        return [
            Term(
                self.column("gap", torque_unit(state.robot, i, "torque slope"), name, number, sign=1),
                deflected(state, i, self._place(state, i)),
            )
            for i, name, number in self.acts_on(state.robot)
        ]

    def _place(self, state: State, joint: int) -> Array:
        """Where in its gap the link is, -1 to 1."""
        inertia = state.slopes.acceleration[:, joint, joint]
        return play(state.t, state.passed(joint, self.rubbing), inertia, self.size) / self.size
