"""Motion of a link behind its motor: on a spring, or across the gap of a gear with play.

Along the motor's measured motion, the link of joint j lags the motor by the deflection δ, which follows

    M_jj δ̈ + (∂τ_j/∂q̇_j + d) δ̇ + (∂τ_j/∂q_j + k) δ = load_j + f,    |δ| ≤ g,

with k and d the stiffness and the damping of its spring. A link that crosses a gap of ±g has neither spring nor damper,
and stops at the ends of the gap.
f is the dry friction behind the gear. This friction follows the link's own speed. Where the motor reverses, friction
holds the link until the spring is wound in the other direction or the link has crossed the gap,

    f = f_c sign(q̇_j − δ̇),    |f| ≤ f_c where q̇_j = δ̇.

The motion is computed by the midpoint rule, which does not damp the oscillation. Each step solves for friction and for
the stops (Moreau 1988, "Unilateral contact and dry friction in finite freedom dynamics").

Source: Nordin and Gutman 2002, "Controlling mechanical systems with backlash: a survey", Automatica 38(10).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from frischid.core.remembered import Remembered
from frischid.core.types import Array
from frischid.effects.state import SIGN_WIDTH, State

SWING_DAMPING = 0.05
"""Damping of a link that oscillates on its spring, as a share of critical damping. Gears damp little; the exact value
only decides how long an oscillation lasts."""

STIFFNESS_LEFT = 0.1
"""Least share of a spring's stiffness that must remain when the weight of the link works against the spring. With a
smaller share the link would fall."""

SAMPLES_PER_SWING = 5.0
"""Samples per period of a swing. With fewer samples the swing does not show, and the spring counts as rigid."""

TRAVEL_STEP = 0.004
"""Step of the link's computed motion, s. From a log with a smaller step, every n-th sample is used."""

START_WINDOW = 0.1
"""Time from a motion's first sample, s, over which the load on the link is averaged to find where the link starts."""

TOGETHER_FROM = 30
"""From this number of links on, moving all links at once as arrays is faster than moving each link as plain numbers."""

STEPS_AT_ONCE = 256
"""Steps for which links that move together get their drives at once; the drives then stay in the processor's cache."""

NUMBERS_AT_ONCE = 1_000_000
"""Numbers in memory at once for links that move together, 8 MB per channel."""


@dataclass(frozen=True)
class Gear:
    """The transmission between a motor and its link.

    Attributes
    ----------
    rubbing : float
        Share of the joint's dry friction that acts behind the gear.
    period : float
        Period of the link's swing on the gear's spring while the motor stands still, in a pose of mean inertia, s;
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
    """Speeds, loads and inertias that drive the links along a motion.

    Attributes
    ----------
    t : ndarray, shape (G,)
        Grid of times, s.
    over : ndarray, shape (G - 1, 6, J)
        Values halfway between the times: speed of the motor, smoothed sign of that speed, load on the link, inertia of
        the link, and the derivatives ∂τ_j/∂q̇_j and ∂τ_j/∂q_j.
    """

    t: Array
    over: Array

    @classmethod
    def of(cls, state: State) -> _Road:
        """Compute the drive of the links from a motion of at least two samples."""
        every = max(1, int(TRAVEL_STEP / np.median(np.diff(state.t))))
        grid = np.unique(np.append(np.arange(0, len(state.t), every), len(state.t) - 1))
        pull, drag, inertia = (np.diagonal(slope[grid], axis1=1, axis2=2) for slope in state.slopes)
        inertia, v = np.maximum(inertia, 0.05 * state.rigid.inertia), state.v[grid]
        at = np.stack([v, np.tanh(v / SIGN_WIDTH), state.load[grid], inertia, drag, pull], axis=1)
        return cls(state.t[grid], (at[1:] + at[:-1]) / 2)


_ROADS = Remembered[_Road]()


class _Steps(NamedTuple):
    """The drive of links within each step of a road, (G - 1, ...): one column per link where many move together.

    ``push`` is the part of the push on the link that does not depend on its deflection.
    """

    h: Array
    speed: Array
    push: Array
    inert: Array
    spring: Array
    held: Array
    back: Array

    @classmethod
    def of(cls, road: _Road, joints: NDArray[np.intp], links: Array) -> _Steps:
        """Drive the links of some joints; `links` (6, links) are their properties (`_moved`)."""
        _, _, stiffness, damping, _, dry = links
        kinds, kind = np.unique([joints, stiffness, damping], axis=1, return_inverse=True)  # apart from their friction
        of_kind, stiffness, damping = kinds[0].astype(int), *kinds[1:]
        speed, sign, load, inertia, drag, pull = road.over[:, :, of_kind].swapaxes(0, 1)
        h = np.diff(road.t)[:, None]
        inert, spring = 2 / h * inertia, stiffness + pull
        held = inert + np.maximum(drag + damping, 0.0) + h / 2 * spring
        kind = kind.ravel()  # numpy 2.0 keeps the axes
        speed, push, inert, spring, held = (x[:, kind] for x in (speed, held * speed - load, inert, spring, held))
        return cls(h, speed, push, inert, spring, held, dry * sign[:, kind])


def _travel_together(road: _Road, joints: NDArray[np.intp], links: Array) -> Array:
    """Deflection at the end of each step, and f − f_c sign(q̇_j) within the step, (links, 2, G - 1)."""
    deflection, rate, _, _, gap, dry = links
    stops, against, back = bool(np.isfinite(gap).any()), -dry, -gap
    found = np.empty((links.shape[1], 2, len(road.over)))
    for first in range(0, len(road.over), STEPS_AT_ONCE):
        steps = slice(first, first + STEPS_AT_ONCE)
        along = _Steps.of(_Road(road.t[first : first + STEPS_AT_ONCE + 1], road.over[steps]), joints, links)
        places, rubbed = np.empty((2, len(along.h), links.shape[1]))
        for place, friction, h, speed, push, inert, spring, held in zip(places, rubbed, *along[:-1], strict=True):
            # In place where possible: a new array takes as long as a sum of this size.
            pushed = spring * deflection
            pushed += push
            pushed -= inert * rate
            np.maximum(np.minimum(pushed, dry, out=friction), against, out=friction)
            pushed -= friction
            pushed /= held
            moved = speed - pushed
            np.multiply(h, moved, out=place)
            place += deflection
            moved *= 2
            moved -= rate
            if stops:
                after = place.copy()
                np.maximum(np.minimum(after, gap, out=place), back, out=place)
                moved *= place == after
            deflection, rate = place, moved
        rubbed -= along.back
        if stops:
            rubbed *= np.abs(places) < gap
        found[:, 0, steps], found[:, 1, steps] = places.T, rubbed.T
    return found


def _travel_alone(along: _Steps, number: int, link: Array) -> Array:
    """The same for one of the links, (2, G - 1), as plain numbers: ten times as fast for one link.

    A link that rests at an end of its gap has no memory: the step alone decides whether the link leaves. So steps are
    taken one by one only while the link crosses its gap.
    """
    deflection, rate, _, _, gap, dry = link.tolist()
    steps = _Steps(*(x[:, min(number, x.shape[1] - 1)] for x in along))
    count = len(steps.h)
    places, within = np.empty(count), np.zeros(count)
    leaves = {end: np.append(_leaves(steps, end, dry), count) for end in (gap, -gap) if np.isfinite(gap)}
    ahead = zip(*(x.tolist() for x in steps[:-1]), strict=True)
    n = 0
    while n < count:
        if rate == 0.0 and deflection in leaves:
            left = leaves[deflection]
            first, n = n, int(left[left.searchsorted(n)])
            places[first:n] = deflection
            next(islice(ahead, n - first, n - first), None)
        moving: list[float] = []
        rubbed: list[float] = []
        for h, speed, push, inert, spring, held in ahead:
            pushed = push - inert * rate + spring * deflection
            friction = dry if pushed > dry else -dry if pushed < -dry else pushed
            moved = speed - (pushed - friction) / held
            after = deflection + h * moved
            if not -gap <= after <= gap:
                deflection, rate = (gap if after > gap else -gap), 0.0
                break
            deflection, rate = after, 2 * moved - rate
            moving.append(deflection)
            rubbed.append(friction)
        first, n = n, n + len(moving)
        places[first:n], within[first:n] = moving, np.array(rubbed) - steps.back[first:n]
        if n < count:  # the step in which the link met the end of its gap
            places[n] = deflection
            n += 1
    return np.stack([places, within])


def _leaves(steps: _Steps, end: float, dry: float) -> NDArray[np.intp]:
    """Steps in which a link that rests at an end of its gap is not pushed beyond that end."""
    pushed = steps.push + steps.spring * end
    moved = steps.speed - (pushed - np.clip(pushed, -dry, dry)) / steps.held
    return np.flatnonzero(np.copysign(1.0, end) * (end + steps.h * moved) <= abs(end))


class Lag(NamedTuple):
    """Lag of a link behind its motor along a motion, per unit of the gear's parameter: compliance 1/k or half a gap g.

    Attributes
    ----------
    place, rate, acceleration : ndarray, shape (N,)
        δ and its derivatives, times k or over g. For a spring, k δ is the torque that the spring carries, N·m (N).
    friction : ndarray, shape (N,)
        f − f_c sign(q̇_j) on the motor's side, also times k or over g.
    """

    place: Array
    rate: Array
    acceleration: Array
    friction: Array


def lags(state: State, gears: Sequence[Gear]) -> Iterator[Lag]:
    """Lags of links behind their motors along a motion; each link is computed as if all other joints were rigid.

    Yields
    ------
    Lag
        One per gear, in the order of the gears; NaN where the weight of the link overcomes the spring.

    Raises
    ------
    InputError
        The samples are not in order of time.
    """
    state.require_times()
    count = len(state.t)
    if count < 3:
        yield from (Lag(*np.zeros((4, count))) for _ in gears)
        return
    road = _ROADS.of(state, TRAVEL_STEP, lambda: _Road.of(state))
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
    # A link starts at the deflection of its load. The mean over the first samples keeps noise out of this start.
    soon = np.flatnonzero(state.t <= max(state.t[0] + START_WINDOW, state.t[1]))
    carried = state.load[soon][:, joints] + dry * np.tanh(state.v[soon][:, joints] / SIGN_WIDTH)
    slope, first = np.polyfit(state.t[soon] - state.t[0], carried, 1)
    kept = np.where(stiffness > 0, stiffness, 1.0)
    start = np.where(np.isinf(gap), first / kept, np.copysign(gap, first))
    rate = np.where(np.isinf(gap), slope / kept, 0.0)
    moved = ~rigid & ~(weak & np.isinf(gap))
    signs = np.tanh(state.v / SIGN_WIDTH)
    load_rates, sign_rates = (np.array(state.rates(x)) if rigid.any() else np.empty(0) for x in (state.load, signs))
    links = np.stack([start, rate, stiffness, 2 * SWING_DAMPING * omega * inertia, gap, dry])[:, moved]
    travelled = iter(_moved(road, joints[moved], links))
    for n, joint in enumerate(joints):
        if rigid[n]:
            carries = state.load[:, joint] + dry[n] * signs[:, joint]
            rate, acceleration = load_rates[..., joint] + dry[n] * sign_rates[..., joint]
            yield Lag(carries, rate, acceleration, np.zeros(len(state.t)))
        elif not moved[n]:
            yield Lag(*np.full((4, len(state.t)), np.nan))
        else:
            deflection, friction = next(travelled)
            place, unit = np.append(start[n], deflection), stiffness[n] if np.isinf(gap[n]) else 1 / gap[n]
            speed, acceleration = np.diff(place) / np.diff(road.t), np.zeros(len(place))
            acceleration[1:-1] = 2 * np.diff(speed) / (road.t[2:] - road.t[:-2])
            parts = place, _at_samples(speed), acceleration, _at_samples(friction)
            every = len(road.t) == len(state.t)
            yield Lag(*(unit * (x if every else np.interp(state.t, road.t, x)) for x in parts))


def _at_samples(between: Array) -> Array:
    """Values at the samples of a grid, from the values halfway between the samples."""
    found = np.empty(len(between) + 1)
    found[0], found[-1] = between[0], between[-1]
    found[1:-1] = (between[:-1] + between[1:]) / 2
    return found


def _moved(road: _Road, joints: NDArray[np.intp], links: Array) -> Array:
    """Travels of links, (links, 2, G - 1); many links move at once, because a step of arrays takes as long as thirty.

    The rows of `links` are deflection and its rate at the start, stiffness, damping, half the gap, and dry friction.
    """
    if len(joints) >= TOGETHER_FROM:
        return _travel_together(road, joints, links)
    along = _Steps.of(road, joints, links)
    each = [_travel_alone(along, n, link) for n, link in enumerate(links.T)]
    return np.array(each).reshape(len(joints), 2, len(along.h))
