"""Links that are not quite where the motor's encoder says: elastic joints and gears with play.

The encoder sits on the motor, the link lags behind by a deflection δ. To first order in δ the link needs

    τ = τ_rigid(q − δ e_j) ≈ τ_rigid − (∂τ/∂q_j δ + ∂τ/∂q̇_j δ̇ + M_j δ̈),

which the motor feels, and so do the other joints. Along the motor's measured motion the link moves by

    M_jj δ̈ + (∂τ_j/∂q̇_j + d) δ̇ + (∂τ_j/∂q_j + k) δ = load_j + f,    |δ| ≤ g,

with k and d of its spring; or with neither while it crosses a gap of ±g, at whose ends it stops. f is the dry friction
behind the gear. It follows the link's own speed: where the motor turns back, it holds the link until the spring is
wound up the other way or the gap is crossed,

    f = f_c sign(q̇_j − δ̇),    |f| ≤ f_c where q̇_j = δ̇,

while in the rigid model it changes sides with the motor; so f − f_c sign(q̇_j) is felt besides.

The motion is computed by the midpoint rule, which takes no energy from the swing, friction and stops being solved for
within each step (Moreau 1988, "Unilateral contact and dry friction in finite freedom dynamics").

Sources: Spong 1987, ASME J. Dynamic Systems, Measurement and Control 109(4); Nordin and Gutman 2002, "Controlling
mechanical systems with backlash: a survey", Automatica 38(10).
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from frischid.core.types import Array
from frischid.effects.base import ANGLE, SECONDS, WIDTH, Effect, State, Term, is_number, torque_unit
from frischid.errors import InputError

DAMPING = 0.05
"""Of a link that swings on its spring, as a share of what stops it from swinging."""

WEAK = 0.1
"""Share of a spring's stiffness that the weight of the link must leave."""

RESOLVED = 5.0
"""Samples in a period, fewer than which do not show a swing."""

STEP = 0.004
"""Of the link's motion, s; where a log is sampled more finely, some of its samples are taken."""

SOON = 0.1
"""From a motion's first sample on, s, over which the load that a link hangs on at first is averaged."""

MANY = 9
"""Links from which on it pays to move them at once."""

HELD = 1_000_000
"""Numbers held at a time for links that move at once."""


@dataclass(frozen=True)
class Gear:
    """What lies between a motor and its link.

    Attributes
    ----------
    joint : int
    rubbing : float
        Share of the joint's dry friction that is behind the gear.
    period : float
        In which the link, in a pose of mean inertia, swings on the gear's spring while the motor stands still, s;
        infinite where there is no spring.
    gap : float
        Half the play, rad (m); infinite where a spring carries the link.
    """

    joint: int
    rubbing: float
    period: float = np.inf
    gap: float = np.inf


@dataclass(frozen=True, eq=False)
class _Road:
    """What links meet along a motion.

    Attributes
    ----------
    t : ndarray, shape (G,)
        Grid of times, s.
    over : ndarray, shape (G - 1, 6, J)
        Halfway between them: the motor's speed and its sign, the link's load, its inertia, and what drags it and pulls
        it back of itself (∂τ_j/∂q̇_j, ∂τ_j/∂q_j).
    """

    t: Array
    over: Array

    @classmethod
    def of(cls, state: State) -> _Road:
        """Of a motion of at least two samples."""
        every = max(1, int(STEP / np.median(np.diff(state.t))))
        grid = np.unique(np.append(np.arange(0, len(state.t), every), len(state.t) - 1))
        pull, drag, inertia = (np.diagonal(slope[grid], axis1=1, axis2=2) for slope in state.slopes)
        inertia, v = np.maximum(inertia, 0.05 * state.rigid.inertia), state.v[grid]
        at = np.stack([v, np.tanh(v / WIDTH), state.load[grid], inertia, drag, pull], axis=1)
        return cls(state.t[grid], (at[1:] + at[:-1]) / 2)


def _travel(
    road: Iterable[Any], steps: Iterable[float], links: Iterable[Any], least: Any, most: Any
) -> Iterator[tuple[Any, Any]]:
    """Deflection at the end of each step, and friction within it beyond what the motor's speed would make of it.

    Of one link, all being numbers, or of many, all being arrays; `least` and `most` give the smaller and the larger of
    two numbers or arrays.
    """
    deflection, rate, stiffness, damping, gap, dry = links
    for (speed, sign, load, inertia, drag, pull), h in zip(road, steps, strict=True):
        inert, spring = 2 / h * inertia, stiffness + pull
        held = inert + most(drag + damping, 0.0) + h / 2 * spring
        push = held * speed - load - inert * rate + spring * deflection
        friction = most(least(push, dry), -dry)
        wanted = speed - (push - friction) / held
        found = most(least(wanted, (gap - deflection) / h), (-gap - deflection) / h)
        loose = found == wanted
        deflection = deflection + h * found
        rate = (2 * found - rate) * loose
        yield deflection, (friction - dry * sign) * loose


class Lag(NamedTuple):
    """How a link lags behind its motor along a motion, per unit of the gear's parameter: compliance 1/k, half a gap g.

    Attributes
    ----------
    place, rate, acceleration : ndarray, shape (N,)
        δ and its derivatives, times k or over g: of a spring, the torque it carries, N·m (N).
    friction : ndarray, shape (N,)
        What the motor feels of f − f_c sign(q̇), likewise.
    """

    place: Array
    rate: Array
    acceleration: Array
    friction: Array


def lags(state: State, gears: Sequence[Gear]) -> Iterator[Lag]:
    """How links lag behind their motors along a motion; each as if all other joints were rigid.

    Parameters
    ----------
    state : State
    gears : sequence of Gear

    Yields
    ------
    Lag
        In the order of the gears; not a number where the link's weight overcomes the spring.

    Raises
    ------
    InputError
        The samples are not in the order of time.
    """
    state.require_times()
    count = len(state.t)
    if count < 3:
        yield from (Lag(*np.zeros((4, count))) for _ in gears)
        return
    road = _Road.of(state)
    many = max(1, HELD // len(road.t))
    for first in range(0, len(gears), many):
        yield from _lags(state, road, gears[first : first + many])


def _lags(state: State, road: _Road, gears: Sequence[Gear]) -> Iterator[Lag]:
    joints = np.array([gear.joint for gear in gears])
    period, gap = (np.array([getattr(gear, name) for gear in gears]) for name in ("period", "gap"))
    rigid = period < RESOLVED * np.median(np.diff(state.t))
    omega, inertia = 2 * np.pi / np.where(rigid, np.inf, period), state.rigid.inertia[joints]
    stiffness = omega**2 * inertia
    weak = stiffness + road.over[:, 5].min(axis=0)[joints] < WEAK * stiffness
    dry = np.array([gear.rubbing for gear in gears]) * (0.0 if state.dry is None else state.dry[joints])
    # At first a link is where its load keeps it, and follows; which noise must not hide.
    soon = np.flatnonzero(state.t <= max(state.t[0] + SOON, state.t[1]))
    carried = state.load[soon][:, joints] + dry * np.tanh(state.v[soon][:, joints] / WIDTH)
    slope, first = np.polyfit(state.t[soon] - state.t[0], carried, 1)
    kept = np.where(stiffness > 0, stiffness, 1.0)
    start = np.where(np.isinf(gap), first / kept, np.copysign(gap, first))
    rate = np.where(np.isinf(gap), slope / kept, 0.0)
    moved = ~rigid & ~(weak & np.isinf(gap))
    links = np.stack([start, rate, stiffness, 2 * DAMPING * omega * inertia, gap, dry])[:, moved]
    travelled = iter(_moved(road, joints[moved], links).transpose(2, 1, 0))
    for n, joint in enumerate(joints):
        if rigid[n]:
            carries = state.load[:, joint] + dry[n] * np.tanh(state.v[:, joint] / WIDTH)
            yield Lag(carries, *state.rates(carries), np.zeros(len(state.t)))
        elif not moved[n]:
            yield Lag(*np.full((4, len(state.t)), np.nan))
        else:
            deflection, friction = next(travelled)
            place, unit = np.append(start[n], deflection), stiffness[n] if np.isinf(gap[n]) else 1 / gap[n]
            speed, acceleration = np.diff(place) / np.diff(road.t), np.zeros(len(place))
            acceleration[1:-1] = 2 * np.diff(speed) / (road.t[2:] - road.t[:-2])
            parts = place, _at_samples(speed), acceleration, _at_samples(friction)
            yield Lag(*(unit * np.interp(state.t, road.t, x) for x in parts))


def _at_samples(between: Array) -> Array:
    """Values at the samples of a grid from those halfway between them."""
    return np.asarray((np.append(between[0], between) + np.append(between, between[-1])) / 2)


def _moved(road: _Road, joints: NDArray[np.intp], links: Array) -> Array:
    """Travels of links, (G - 1, 2, links): at once where there are many, for a step of an array takes that of nine."""
    steps = np.diff(road.t).tolist()
    if len(joints) < MANY:
        each = [
            list(_travel(road.over[:, :, joint].tolist(), steps, link.tolist(), min, max))
            for joint, link in zip(joints, links.T, strict=True)
        ]
        return np.array(each).reshape(len(joints), len(steps), 2).transpose(1, 2, 0)
    along = (at[:, joints] for at in road.over)
    return np.array(list(_travel(along, steps, links, np.minimum, np.maximum)))


def require_share(effect: str, rubbing: float) -> None:
    """Raise InputError unless this can be a share of the friction."""
    if not is_number(rubbing) or rubbing < 0:
        raise InputError(f"{effect}: rubbing must be a share of the friction, 0 or more, got {rubbing}")


def deflected(state: State, joint: int, lag: Lag) -> dict[int, Array]:
    """First-order change of the torque on every joint when a link lags its joint's encoder."""
    position, velocity, acceleration = (slope[:, :, joint] for slope in state.slopes)
    change = position * lag.place[:, None] + velocity * lag.rate[:, None] + acceleration * lag.acceleration[:, None]
    change[:, joint] -= lag.friction
    return {i: -change[:, i] for i in range(change.shape[1])}


@dataclass(frozen=True)
class _Geared(Effect):
    """What lies between motor and link: one column a joint, felt by all."""

    memory: ClassVar[bool] = True
    loaded: ClassVar[bool] = True
    symbol: ClassVar[str]
    per: ClassVar[str]

    @abstractmethod
    def gear(self, joint: int) -> Gear:
        """What a joint's link hangs on."""

    @classmethod
    def each(cls, effects: Sequence[Self], state: State) -> Iterator[list[Term]]:
        """Columns of several effects over `state`, whose links move at once."""
        acting = [effect.acts_on(state.robot) for effect in effects]
        found = lags(state, [e.gear(i) for e, where in zip(effects, acting, strict=True) for i, *_ in where])
        for effect, where in zip(effects, acting, strict=True):
            yield [
                Term(
                    effect.column(cls.symbol, torque_unit(state.robot, i, cls.per), name, number, sign=1),
                    deflected(state, i, next(found)),
                )
                for i, name, number in where
            ]

    def terms(self, state: State) -> list[Term]:
        """One column a joint, felt by all."""
        return next(self.each([self], state))


@dataclass(frozen=True)
class Elasticity(_Geared):
    """Flexible transmission seen from the motor: the link lags by its spring's torque times the compliance ``ce``.

    Attributes
    ----------
    period : float
        In which the link, in a pose of mean inertia, swings while the motor stands still, s; 0: it is too stiff to.
    rubbing : float
        Share of the joint's dry friction that acts behind the transmission, on the link.
    """

    id: ClassVar[str] = "elasticity"
    title: ClassVar[str] = "joint elasticity"
    equation: ClassVar[str] = (
        "ce·((∂τ_rigid/∂δ)[−s] + k·(f − f_c·sign(v))),  "
        "s the spring's torque: s + (∂τ/∂q·s + ∂τ/∂v·s′ + M·s″)/k = load + f"
    )
    sentence: ClassVar[str] = (
        "{joint} gives way under its load: its transmission is elastic, and the link lags behind the motor's encoder"
    )
    looks_like: ClassVar[str] = "an error like the load's second derivative, largest where the motion is most sudden"
    confused_with: ClassVar[tuple[str, ...]] = ("backlash", "time_delay", "rotor_inertia")
    confirmed_by: ClassVar[str] = (
        "record fast oscillations up to the first resonance; or load the tip and measure how it sinks"
    )
    reference: ClassVar[str] = "Spong 1987, ASME J. Dynamic Systems, Measurement and Control 109(4)"

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

    symbol: ClassVar[str] = "ce"
    per: ClassVar[str] = "torque slope torque"

    def gear(self, joint: int) -> Gear:
        """Spring that a joint's link hangs on."""
        return Gear(joint, self.rubbing, period=self.period)


@dataclass(frozen=True)
class Backlash(_Geared):
    """Play in a gear: when the load changes sides the link crosses the gap, and the motor loses its load meanwhile.

    Attributes
    ----------
    size : float
        Half the play for which the link's fall is calculated, rad (m); the parameter, the play found, should agree.
    rubbing : float
        Share of the joint's dry friction that acts behind the gear, on the link.
    """

    id: ClassVar[str] = "backlash"
    title: ClassVar[str] = "backlash"
    equation: ClassVar[str] = (
        "gap·((∂τ_rigid/∂δ)[−δ] + f − f_c·sign(v))/size,  M·δ″ = load + f while |δ| < size, else δ = ±size"
    )
    sentence: ClassVar[str] = (
        "{joint} loses its load for a moment whenever the load changes sides, and is hit when it catches it again: "
        "play in its gear"
    )
    looks_like: ClassVar[str] = "short pulses where the joint's load torque passes through zero, whatever the speed"
    confused_with: ClassVar[tuple[str, ...]] = ("elasticity", "hysteresis", "stribeck")
    confirmed_by: ClassVar[str] = "hold the motor, push the link to and fro: it moves freely over the gap"
    reference: ClassVar[str] = "Nordin and Gutman 2002, Automatica 38(10)"

    shapes: ClassVar[Mapping[str, tuple[float, ...]]] = {
        "size": (0.0003, 0.0007, 0.0015, 0.003, 0.006, 0.012, 0.025, 0.05, 0.1),
        "rubbing": (0.0, 0.5),
    }

    units: ClassVar[Mapping[str, tuple[str, str]]] = {"size": ANGLE}

    size: float = 0.003
    rubbing: float = 0.0

    def __post_init__(self) -> None:
        self.require_positive(size="angle in rad (distance in m)")
        require_share(self.id, self.rubbing)

    symbol: ClassVar[str] = "gap"
    per: ClassVar[str] = "torque slope"

    def gear(self, joint: int) -> Gear:
        """Gap that a joint's link crosses."""
        return Gear(joint, self.rubbing, gap=self.size)
