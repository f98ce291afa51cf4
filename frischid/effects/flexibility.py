"""Links that lag behind the motor's encoder: elastic joints and gears with play.

The encoder sits on the motor, and the link lags behind by a deflection δ. To first order in δ the link needs

    τ = τ_rigid(q − δ e_j) ≈ τ_rigid − (∂τ/∂q_j δ + ∂τ/∂q̇_j δ̇ + M_j δ̈),

and the motors of all joints feel the change. The dry friction f behind the gear follows the speed of the link, but in
the rigid model it follows the speed of the motor. So the joint also feels f − f_c sign(q̇_j).
`frischid.effects.link_lag` computes δ and f.

Sources: Spong 1987, ASME J. Dynamic Systems, Measurement and Control 109(4); Nordin and Gutman 2002, "Controlling
mechanical systems with backlash: a survey", Automatica 38(10).
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from frischid.core.types import Array
from frischid.effects.base import Effect
from frischid.effects.link_lag import Gear, Lag, lags
from frischid.effects.state import State, Term
from frischid.effects.units import ANGLE_UNITS, TIME_UNITS, is_number, torque_unit
from frischid.errors import InputError


def require_share(effect: str, rubbing: float) -> None:
    """Raise InputError unless `rubbing` can be a share of the friction."""
    if not is_number(rubbing) or rubbing < 0:
        raise InputError(f"{effect}: rubbing must be a share of the friction, 0 or more, got {rubbing}")


def deflected(slopes: Sequence[Array], joint: int, lag: Lag) -> dict[int, Array]:
    """First-order change of the torque on every joint when a link lags its joint's encoder.

    Parameters
    ----------
    slopes : sequence of ndarray, shape (J, N)
        ∂τ/∂q_j, ∂τ/∂q̇_j and M_j of the joint along the motion.
    """
    position, velocity, acceleration = slopes
    change = position * -lag.place
    change -= velocity * lag.rate
    change -= acceleration * lag.acceleration
    change[joint] += lag.friction
    return dict(enumerate(change))


@dataclass(frozen=True)
class _Geared(Effect):
    """Transmission between motor and link: one column per joint, in the rows of all joints."""

    memory = True
    loaded = True
    symbol: ClassVar[str]
    per: ClassVar[str]

    @abstractmethod
    def gear(self, joint: int) -> Gear:
        """The gear or spring between the joint's motor and its link."""

    @classmethod
    def each(cls, effects: Sequence[Self], state: State) -> Iterator[list[Term]]:
        """Columns of several effects over `state`; the motions of all links are computed at once."""
        acting = [effect.acts_on(state.robot) for effect in effects]
        found = lags(state, [e.gear(i) for e, where in zip(effects, acting, strict=True) for i, *_ in where])
        joints = sorted({i for where in acting for i, *_ in where})
        slopes = {i: [np.ascontiguousarray(slope[:, :, i].T) for slope in state.slopes] for i in joints}
        for effect, where in zip(effects, acting, strict=True):
            yield [
                Term(
                    effect.column(cls.symbol, torque_unit(state.robot, i, cls.per), name, number, sign=1),
                    deflected(slopes[i], i, next(found)),
                )
                for i, name, number in where
            ]

    def terms(self, state: State) -> list[Term]:
        """One column per joint, in the rows of all joints."""
        return next(self.each([self], state))


@dataclass(frozen=True)
class Elasticity(_Geared):
    """Flexible transmission seen from the motor: the link lags by its spring's torque times the compliance ``ce``.

    Attributes
    ----------
    period : float
        Period of the link's swing while the motor stands still, in a pose of mean inertia, s; 0: too stiff to swing.
    rubbing : float
        Share of the joint's dry friction that acts behind the transmission, on the link.
    """

    id = "elasticity"
    title = "joint elasticity"
    equation = (
        "ce·((∂τ_rigid/∂δ)[−s] + k·(f − f_c·sign(v))),  "
        "s the spring's torque: s + (∂τ/∂q·s + ∂τ/∂v·s′ + M·s″)/k = load + f"
    )
    symbols: ClassVar = {
        "ce": "identified coefficient: compliance, the deflection per torque",
        "δ": "deflection of the link behind the motor",
        "s": "torque of the spring",
        "k": "stiffness of the spring",
    }
    sentence = (
        "the transmission of {joint} is elastic: it bends under load, and the link lags behind the motor's encoder"
    )
    looks_like = "an error like the second time derivative of the load, largest where the motion changes fastest"
    confused_with = ("backlash", "time_delay", "rotor_inertia")
    confirmed_by = "record fast oscillations up to the first resonance; or load the tip and measure how it sinks"
    reference = "Spong 1987, ASME J. Dynamic Systems, Measurement and Control 109(4)"

    shapes: ClassVar = {
        "period": (0.0, 0.08, 0.11, 0.14, 0.17, 0.21, 0.26, 0.33, 0.42),
        "rubbing": (0.0, 0.33, 0.67),
    }
    units: ClassVar = {"period": TIME_UNITS}

    period: float = 0.0
    rubbing: float = 0.0

    def __post_init__(self) -> None:
        if not is_number(self.period) or self.period < 0:
            raise InputError(f"{self.id}: period must be a time in s, 0 or more, got {self.period}")
        require_share(self.id, self.rubbing)

    symbol = "ce"
    per = "torque slope torque"

    def gear(self, joint: int) -> Gear:
        """The spring between the joint's motor and its link."""
        return Gear(joint, self.rubbing, period=self.period)


@dataclass(frozen=True)
class Backlash(_Geared):
    """Play in a gear: when the load changes its sign, the link crosses the gap, and the motor has no load meanwhile.

    Attributes
    ----------
    size : float
        Half the play for which the link's motion is calculated, rad (m). The identified parameter is half the play; it
        should be close to `size`.
    rubbing : float
        Share of the joint's dry friction that acts behind the gear, on the link.
    """

    id = "backlash"
    title = "backlash"
    equation = "gap·((∂τ_rigid/∂δ)[−δ] + f − f_c·sign(v))/size,  M·δ″ = load + f while |δ| < size, else δ = ±size"
    symbols: ClassVar = {
        "gap": "identified coefficient: half the play",
        "δ": "place of the link within the play",
    }
    sentence = (
        "the gear of {joint} has play: when the load changes sign, the torque first drops, then jumps as the teeth "
        "meet again"
    )
    looks_like = "short pulses where the joint's load torque passes through zero, whatever the speed"
    confused_with = ("gear_play", "elasticity", "hysteresis", "stribeck")
    confirmed_by = "hold the motor and push the link to and fro: the link moves freely over the gap"
    reference = "Nordin and Gutman 2002, Automatica 38(10)"

    shapes: ClassVar = {
        "size": (0.0003, 0.0007, 0.0015, 0.003, 0.006, 0.012, 0.025, 0.05, 0.1),
        "rubbing": (0.0, 0.5),
    }
    units: ClassVar = {"size": ANGLE_UNITS}

    size: float = 0.003
    rubbing: float = 0.0

    def __post_init__(self) -> None:
        self.require_positive(size="angle in rad (distance in m)")
        require_share(self.id, self.rubbing)

    symbol = "gap"
    per = "torque slope"

    def gear(self, joint: int) -> Gear:
        """The gap that the joint's link crosses."""
        return Gear(joint, self.rubbing, gap=self.size)
