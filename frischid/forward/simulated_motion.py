"""Where simulated robots start, how they move, and one step between: what a simulation and its followers share.

held back by d:   τ(t) = the torque that was given at t − d, between two steps of the integration
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from frischid.core.types import Array
from frischid.errors import InputError
from frischid.forward.effect_torques import DryFriction
from frischid.forward.torque_sources import TorqueSource
from frischid.robot.motion_arrays import motion_of, times_of


@dataclass(frozen=True, eq=False)
class SimulatedMotion:
    """Motions of K simulated robots.

    Attributes
    ----------
    t : ndarray, shape (N,)
        Time since each motion's start, s.
    q, v : ndarray, shape (K, N, J)
        rad, rad/s (m, m/s); NaN after a motion became unstable.
    unstable : ndarray, shape (K,)
        Time at which a motion became unstable, s; infinite for a stable one.
    """

    t: Array
    q: Array
    v: Array
    unstable: Array


@dataclass(frozen=True, eq=False)
class Starts:
    """Where K simulated robots start.

    Attributes
    ----------
    q, v : ndarray, shape (K, J)
        rad, rad/s (m, m/s).
    t : ndarray, shape (K,), optional
        Time of each start on the source's clock, s; zero by default.
    which : ndarray of int, shape (K,), optional
        Set of parameters of each robot; the first by default.
    remembered : sequence of ndarray, shape (K, J), optional
        State of each effect with memory, from `ForwardDynamics.remembered`; by default, each joint has moved a long
        way in the direction of its speed.

    Examples
    --------
    >>> import numpy as np
    >>> import frischid as fr
    >>> hanging = fr.Starts(q=np.zeros((1, 2)), v=np.array([[0.1, 0.0]]))
    >>> hanging.v.shape
    (1, 2)
    """

    q: Array
    v: Array
    t: Array | None = None
    which: NDArray[np.intp] | None = None
    remembered: Sequence[Array] | None = None


class Step(NamedTuple):
    """One step of K robots: its length `h`, what was before it, its middle, and the velocities after it.

    `t`, `q` and `v` belong to the middle, and so does `z`, the state of each effect with memory. `a` is the
    acceleration about which effects are linearised. `inertia` holds the damping of half a step.
    """

    h: float
    which: NDArray[np.intp]
    t: Array
    q: Array
    v: Array
    a: Array
    v_before: Array
    z_before: list[Array]
    z: list[Array]
    inertia: Array
    damping: Array
    dry: DryFriction | None
    v_after: Array

    @property
    def keeps_on(self) -> NDArray[np.bool_]:
        """Joints (K, J) that move after the step, in the direction of before."""
        return np.asarray((self.v_after != 0.0) & (self.v_before * self.v_after >= 0.0))


class Follower(Protocol):
    """Something that follows a simulation step by step."""

    def follow(self, step: Step) -> None:
        """See one step."""

    def note(self) -> None:
        """See that a wanted time is reached."""


def started(starts: Starts, joints: Sequence[str], sets: int) -> tuple[Array, Array, Array, NDArray[np.intp]]:
    """Positions, velocities (K, J), times and sets of parameters (K,) of K robots, as new arrays.

    Parameters
    ----------
    joints : sequence of str
        The robot's J joints.
    sets : int
        Number of sets of parameters.

    Raises
    ------
    InputError
        A shape is wrong, a number is not finite, or there is no such set of parameters.
    """
    q, v = (x.copy() for x in motion_of(joints, q=starts.q, v=starts.v))
    for name, x in (("q", q), ("v", v)):
        if not np.isfinite(x).all():
            k, j = np.argwhere(~np.isfinite(x))[0].tolist()
            raise InputError(
                f"the start of robot {k} has {name} = {x[k, j]} at {joints[j]}; it must be a finite number"
            )
    which = np.zeros(len(q), dtype=np.intp) if starts.which is None else np.asarray(starts.which, dtype=np.intp)
    if which.shape != (len(q),) or not ((which >= 0) & (which < sets)).all():
        raise InputError(
            f"which must name one of the {sets} sets of parameters, from 0, for each of {len(q)} robots; "
            f"got {which.tolist()}"
        )
    return q, v, times_of(starts.t, len(q)).copy(), which


def wanted_times(t: Any) -> Array:
    """Times at which a simulated motion is wanted, as floats, s.

    Raises
    ------
    InputError
        They are not finite numbers that increase from zero.
    """
    times = times_of(t, np.size(t))
    if not (times.size and times[0] == 0 and (np.diff(times) > 0).all()):
        raise InputError(
            "the times of a simulated motion must begin with 0 and increase: they count from its start, and "
            "Starts(t=...) says when that is"
        )
    return times


def delay_of(source: TorqueSource) -> float:
    """Time by which a source's torque acts late, s."""
    return float(getattr(source, "delay", 0.0))


@dataclass(eq=False)
class Given:
    """Values given in the steps of a simulation so far, as far as later steps need them; the steps may differ."""

    clock: float = 0.0
    """End of the last step since the first one began, s."""
    middles: list[float] = field(default_factory=list)
    """Middle of each step that is kept, on this clock, s."""
    values: list[Array] = field(default_factory=list)
    """What was given there."""

    def held_back(self, now: Array, h: float, by: float) -> Array:
        """The value given `by` seconds before the middle of a step of length `h`, which is given `now`.

        Between two steps the value lies on the line through both; before the first step it is the first one.
        """
        self.clock += h
        self.middles.append(self.clock - 0.5 * h)
        self.values.append(now)
        wanted = self.middles[-1] - by
        while len(self.middles) > 1 and self.middles[1] <= wanted:
            del self.middles[0], self.values[0]
        if len(self.middles) == 1 or wanted <= self.middles[0]:
            return self.values[0]
        share = (wanted - self.middles[0]) / (self.middles[1] - self.middles[0])
        return np.asarray((1.0 - share) * self.values[0] + share * self.values[1])
