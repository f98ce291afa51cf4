"""Links that are not quite where the motor's encoder says: elastic joints and gears with play.

The encoder sits on the motor, the link lags behind by a deflection δ that depends on the torque it needs. To first
order in δ the motor feels

    τ = τ_rigid(q − δ e_j) ≈ τ_rigid − (∂τ/∂q_j δ + ∂τ/∂q̇_j δ̇ + M_j δ̈),

with ``δ = load_j / k`` for a spring of stiffness k, and ``δ = g tanh(load_j / w)`` for a gap of ±g that the load
keeps closed on one side or the other. While the gap is crossed the motor loses the link's inertia and weight, and
when it is, it is hit: both are in δ̈.

Sources: Spong 1987, ASME J. Dynamic Systems, Measurement and Control 109(4); Nordin and Gutman 2002, "Controlling
mechanical systems with backlash: a survey", Automatica 38(10).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from frischid.effects.base import Array, Effect, State, Term, torque_unit


def deflected(state: State, joint: int, deflection: Array) -> dict[int, Array]:
    """First-order change of the torque on every joint when a link lags its joint's encoder by `deflection`, (N,)."""
    position, velocity, acceleration = (slope[:, :, joint] for slope in state.slopes)
    change = (
        position * deflection[:, None]
        + velocity * state.rate(deflection)[:, None]
        + acceleration * state.rate(deflection, order=2)[:, None]
    )
    return {i: -change[:, i] for i in range(change.shape[1])}


@dataclass(frozen=True)
class Elasticity(Effect):
    """Flexible transmission seen from the motor: the link lags by its load times the compliance ``ce = 1/k``."""

    id: ClassVar[str] = "elasticity"
    title: ClassVar[str] = "joint elasticity"
    equation: ClassVar[str] = "ce·(∂τ_rigid/∂δ)[−load],  that is −ce·(∂τ/∂q·load + ∂τ/∂v·load′ + M·load″)"
    sentence: ClassVar[str] = (
        "{joint} gives way under its load: its transmission is elastic, and the link lags behind the motor's encoder"
    )
    looks_like: ClassVar[str] = "an error like the load's second derivative, largest where the motion is most sudden"
    confused_with: ClassVar[tuple[str, ...]] = ("backlash", "time_delay", "rotor_inertia")
    confirmed_by: ClassVar[str] = (
        "fast oscillations up to the first resonance; or load the tip and measure how it sinks"
    )
    reference: ClassVar[str] = "Spong 1987, ASME J. Dynamic Systems, Measurement and Control 109(4)"

    memory: ClassVar[bool] = True
    loaded: ClassVar[bool] = True

    def terms(self, state: State) -> list[Term]:
        """One column a joint, felt by all."""
        return [
            Term(
                self.column("ce", torque_unit(state.robot, i, "torque slope torque"), name, number, sign=1),
                deflected(state, i, state.load[:, i]),
            )
            for i, name, number in self.acts_on(state.robot)
        ]


@dataclass(frozen=True)
class Backlash(Effect):
    """Play in a gear: around the load's reversal the link crosses the gap, and the motor loses its load meanwhile.

    Attributes
    ----------
    width : float
        Load over which the gap is crossed, as a share of the joint's typical load (`RigidDynamics.spread`).
    """

    id: ClassVar[str] = "backlash"
    title: ClassVar[str] = "backlash"
    equation: ClassVar[str] = "gap·(∂τ_rigid/∂δ)[−tanh(load/w)],  w = width·typical load"
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
    shapes: ClassVar[Mapping[str, tuple[float, ...]]] = {"width": (0.02, 0.1, 0.3)}

    width: float = 0.1

    def __post_init__(self) -> None:
        self.require_positive(width="share of the joint's typical load")

    def terms(self, state: State) -> list[Term]:
        """One column a joint, half its gap, felt by all."""
        reach = np.maximum(self.width * state.rigid.spread, 1e-12)
        return [
            Term(
                self.column("gap", torque_unit(state.robot, i, "torque slope"), name, number, sign=1),
                deflected(state, i, np.tanh(state.load[:, i] / reach[i])),
            )
            for i, name, number in self.acts_on(state.robot)
        ]
