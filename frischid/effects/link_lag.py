"""Motion of a link behind its motor: on a spring, or across the gap of a gear with play.

Along the motor's measured motion, the link of joint j lags the motor by the deflection δ, which follows

    M_jj δ̈ + (∂τ_j/∂q̇_j + d) δ̇ + (∂τ_j/∂q_j + k) δ = load_j + f,    |δ| ≤ g,

with k and d of its spring. A link that crosses a gap of ±g has neither spring nor damper, and stops at the gap's ends.
f is the dry friction behind the gear. This friction follows the link's own speed. Where the motor turns back, friction
holds the link until the spring is wound up the other way or the gap is crossed,

    f = f_c sign(q̇_j − δ̇),    |f| ≤ f_c where q̇_j = δ̇.

The midpoint rule computes the motion. The rule takes no energy from the swing, and friction and stops are solved for
within each step (Moreau 1988, "Unilateral contact and dry friction in finite freedom dynamics").

Source: Nordin and Gutman 2002, "Controlling mechanical systems with backlash: a survey", Automatica 38(10).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from frischid.core.types import Array
from frischid.effects.state import SIGN_WIDTH, State

SWING_DAMPING = 0.05
"""Damping of a link that swings on its spring, as a share of critical damping. Gears damp little; the exact value only
decides how long a swing rings."""

STIFFNESS_LEFT = 0.1
"""Share of a spring's stiffness that must be left when the weight of the link works against the spring. A spring with
less would let the link fall."""

SAMPLES_PER_SWING = 5.0
"""Samples per period of a swing. With fewer samples the swing does not show, and the spring counts as rigid."""

TRAVEL_STEP = 0.004
"""Step of the link's computed motion, s. Of a log that is sampled more finely, every n-th sample is used."""

START_WINDOW = 0.1
"""Time from a motion's first sample, s, over which the load on the link is averaged to find where the link starts."""

TOGETHER_FROM = 9
"""Number of links from which moving all at once as arrays is faster than moving each alone as numbers."""

NUMBERS_AT_ONCE = 1_000_000
"""Numbers in memory at once for links that move together, 8 MB per channel."""


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
        every = max(1, int(TRAVEL_STEP / np.median(np.diff(state.t))))
        grid = np.unique(np.append(np.arange(0, len(state.t), every), len(state.t) - 1))
        pull, drag, inertia = (np.diagonal(slope[grid], axis1=1, axis2=2) for slope in state.slopes)
        inertia, v = np.maximum(inertia, 0.05 * state.rigid.inertia), state.v[grid]
        at = np.stack([v, np.tanh(v / SIGN_WIDTH), state.load[grid], inertia, drag, pull], axis=1)
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
    many = max(1, NUMBERS_AT_ONCE // len(road.t))
    for first in range(0, len(gears), many):
        yield from _lags(state, road, gears[first : first + many])


def _lags(state: State, road: _Road, gears: Sequence[Gear]) -> Iterator[Lag]:
    joints = np.array([gear.joint for gear in gears])
    period, gap = (np.array([getattr(gear, name) for gear in gears]) for name in ("period", "gap"))
    rigid = period < SAMPLES_PER_SWING * np.median(np.diff(state.t))
    omega, inertia = 2 * np.pi / np.where(rigid, np.inf, period), state.rigid.inertia[joints]
    stiffness = omega**2 * inertia
    weak = stiffness + road.over[:, 5].min(axis=0)[joints] < STIFFNESS_LEFT * stiffness
    dry = np.array([gear.rubbing for gear in gears]) * (0.0 if state.dry is None else state.dry[joints])
    # At first a link is where its load keeps it, and follows; which noise must not hide.
    soon = np.flatnonzero(state.t <= max(state.t[0] + START_WINDOW, state.t[1]))
    carried = state.load[soon][:, joints] + dry * np.tanh(state.v[soon][:, joints] / SIGN_WIDTH)
    slope, first = np.polyfit(state.t[soon] - state.t[0], carried, 1)
    kept = np.where(stiffness > 0, stiffness, 1.0)
    start = np.where(np.isinf(gap), first / kept, np.copysign(gap, first))
    rate = np.where(np.isinf(gap), slope / kept, 0.0)
    moved = ~rigid & ~(weak & np.isinf(gap))
    links = np.stack([start, rate, stiffness, 2 * SWING_DAMPING * omega * inertia, gap, dry])[:, moved]
    travelled = iter(_moved(road, joints[moved], links).transpose(2, 1, 0))
    for n, joint in enumerate(joints):
        if rigid[n]:
            carries = state.load[:, joint] + dry[n] * np.tanh(state.v[:, joint] / SIGN_WIDTH)
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
    if len(joints) < TOGETHER_FROM:
        each = [
            list(_travel(road.over[:, :, joint].tolist(), steps, link.tolist(), min, max))
            for joint, link in zip(joints, links.T, strict=True)
        ]
        return np.array(each).reshape(len(joints), len(steps), 2).transpose(1, 2, 0)
    along = (at[:, joints] for at in road.over)
    return np.array(list(_travel(along, steps, links, np.minimum, np.maximum)))
