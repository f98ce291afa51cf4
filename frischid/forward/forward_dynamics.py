"""Forward dynamics of a model: the motion that a torque makes.

    (M(q) + B(q)) q̈ + h(q, q̇) + s(q, q̇) + f = τ,     f dry friction, which holds a joint at standstill

The midpoint rule of Moreau, of second order between reversals:

    q' = q + h/2 q̇,   A (q̇⁺ − q̇) = h (τ − bias(q', q̇') − f),   q⁺ = q' + h/2 q̇⁺

with q̇' extrapolated to the middle of the step, A the inertia with the damping of viscous friction, which is taken at
the mean of q̇ and q̇⁺, and f from `frischid.forward.stiction`. A joint that dry friction holds has the velocity zero
exactly. Many robots move at once, with the same or other parameters: stretches of a log, and steps of a derivative.

A torque that the log recorded later than the motion (`time_delay`) acted earlier: it is read ahead by that delay.

Source: Moreau 1988, "Unilateral contact and dry friction in finite freedom dynamics", CISM 302.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from frischid.core.text import each_of
from frischid.core.types import Array
from frischid.effects.friction_memory import presliding
from frischid.errors import InputError
from frischid.forward.effect_torques import DryFriction, EffectTorques
from frischid.forward.simulated_motion import (
    Follower,
    Given,
    SimulatedMotion,
    Starts,
    Step,
    delay_of,
    started,
    wanted_times,
)
from frischid.forward.stiction import solve, step_with_friction
from frischid.forward.torque_sources import TorqueSource
from frischid.logs.controller import REST
from frischid.model.joint_inertia import LeastInertia
from frischid.model.model import Model
from frischid.model.model_argument import check_model
from frischid.model.physical_alarms import eigenvalue_in_words, remedy
from frischid.robot.mass_matrix import MassMatrices
from frischid.robot.motion_arrays import motion_of

LARGEST_STEP = 0.002
"""s. Longest step of the integration unless the caller names another."""
ACCELERATION_PASSES = 12
"""Evaluations of an acceleration: effects that are not linear in the acceleration are linearised about the last."""
RUNAWAY = 1e4
"""Speed that no joint of a robot reaches, rad/s (m/s): the simulated motion is unstable."""


@dataclass(eq=False)
class _Moving:
    """State of K robots between two steps."""

    t: Array
    q: Array
    v: Array
    a: Array
    which: NDArray[np.intp]
    z: list[Array]
    given: Given = field(default_factory=Given)


class _Balance(NamedTuple):
    """Inertia (K, J, J), torque at zero acceleration without dry friction (K, J), and dry friction or None."""

    inertia: Array
    bias: Array
    dry: DryFriction | None


Drive = Callable[[_Moving, Array, Array, Array, float], Array]
Recorded = Callable[[NDArray[np.intp], Array, Array, Array], Array]


class ForwardDynamics:
    """Forward dynamics of a model with one or more sets of parameters.

    Parameters
    ----------
    model : Model
    theta : ndarray, shape (P, C), optional
        Values of all columns of the full regressor, one row per set; the model's own by default.
    extra : mapping of str to (ndarray, ndarray), optional
        Times and values of further channels that effects read, for example ``temperature_<joint>``.
    begin : float
        Time on the source's clock at which the log begins, s, for effects that depend on the time.

    Raises
    ------
    InputError
        The model lacks the torque of a joint, or has an effect that cannot be simulated forward.

    Examples
    --------
    >>> import numpy as np
    >>> import frischid as fr
    >>> robot = fr.Robot.load("planar2")
    >>> log = fr.simulate(robot, fr.random_fourier(robot, 5.0, seed=1), rate=200.0)
    >>> model = fr.identify(robot, [log], recursion="none").model
    >>> forward = fr.ForwardDynamics(model)
    >>> q, v, a = log.q[300:301], log.v[300:301], log.a[300:301]
    >>> tau = model.inverse_dynamics(q, v, a)
    >>> bool(np.allclose(forward.acceleration(q, v, tau), a, atol=0.01))
    True
    """

    def __init__(
        self,
        model: Model,
        theta: Array | None = None,
        *,
        extra: Mapping[str, tuple[Array, Array]] | None = None,
        begin: float = 0.0,
    ) -> None:
        check_model(model)
        robot = model.robot
        if missing := [n for n in robot.joints if n not in model.joints]:
            raise InputError(
                f"the torque of {each_of(missing)} was not identified, so the motion cannot be simulated; lock "
                f"{'them' if len(missing) > 1 else 'it'} (--lock) and identify again"
            )
        values = model.full_theta[None] if theta is None else np.atleast_2d(np.asarray(theta, dtype=float))
        if values.shape[1] != model.full_theta.size:
            raise InputError(
                f"theta has the shape {values.shape}; a set of parameters has {model.full_theta.size} values, one for "
                "each column of the full regressor, as model.full_theta has"
            )
        rigid = len(robot.columns)
        self.model, self.robot = model, robot
        self.effects = EffectTorques(robot, model.effects, values, model.reference)
        self.rigid = MassMatrices(robot, values[:, :rigid])
        self._extra, self.begin = dict(extra or {}), begin
        self._channels = sorted({c for e in model.effects for c in e.channels(robot)})
        for name in self._channels:
            if name.startswith(REST):  # the source has this torque, of the simulated speed
                self._extra[name] = (np.zeros(1), np.zeros(1))
        for name in self._channels:
            if name not in self._extra:
                raise InputError(
                    f"an effect of the model reads the channel {name}, which the log does not have; add a column "
                    f"{name} to the log, or simulate a model without this effect"
                )

    def mass_matrix(self, q: Array, which: int = 0) -> Array:
        """Inertia of links, rotors and other effects of acceleration, (N, J, J), kg·m² (kg), at positions (N, J)."""
        (q,) = motion_of(self.robot.joints, q=q)
        state = self._start(Starts(q, np.zeros_like(q), which=np.full(len(q), which)))
        return self._balance(state, state.q, state.v, state.t).inertia

    def require_inertia(self, q: Array) -> None:
        """Refuse parameters whose mass matrix is not positive definite at some of the positions (N, J).

        Raises
        ------
        InputError
            The mass matrix has an eigenvalue that is not positive; the message names the joint.
        """
        for which in range(len(self.effects.delay)):
            values, vectors = np.linalg.eigh(self.mass_matrix(q, which))
            worst = int(values[:, 0].argmin())
            if not values[worst, 0] > 0.0:
                joint = int(np.abs(vectors[worst, :, 0]).argmax())
                name, share = self.robot.joints[joint], float((values[:, 0] <= 0.0).mean())
                found = LeastInertia(float(values[worst, 0]), name, float(q[worst, joint]), share)
                raise InputError(
                    f"the model's mass matrix is not positive definite: {eigenvalue_in_words(self.robot, found)}, so "
                    f"no motion follows from a torque. {remedy(self.model).removesuffix('.')}"
                )

    def remembered(self, t: Array, v: Array, samples: NDArray[np.intp]) -> list[Array]:
        """States of effects with memory at some samples of a measured motion, for `Starts`: (K, J) for each effect."""
        return [
            np.stack([presliding(t, v[:, j], memory.distance)[samples] for j in range(v.shape[1])], axis=1)
            for memory in self.effects.remembered
        ]

    def acceleration(self, q: Array, v: Array, tau: Array, t: Array | None = None) -> Array:
        """Acceleration (N, J) that a torque (N, J) makes at states (N, J), with the first set of parameters.

        A joint at standstill that dry friction can hold does not accelerate. Friction with memory is that after a long
        motion in the direction of the speed.
        """
        q, v, tau = motion_of(self.robot.joints, q=q, v=v, tau=tau)
        state = self._start(Starts(q, v, t))
        for _ in range(ACCELERATION_PASSES):
            inertia, bias, dry = self._balance(state, state.q, state.v, state.t)
            for memory, z in zip(self.effects.remembered, state.z, strict=True):
                bias = bias + memory.torque(state.which, state.q, z)
            if dry is None:
                state.a = solve(inertia, tau - bias)
                continue
            side = np.sign(state.v)
            state.a = step_with_friction(inertia, tau - bias, side, dry, state.v != 0.0)
        return state.a

    def simulate(
        self,
        source: TorqueSource,
        starts: Starts,
        t: Array,
        *,
        step: float = LARGEST_STEP,
        follower: Follower | None = None,
    ) -> SimulatedMotion:
        """Move K robots under a source of torque.

        Parameters
        ----------
        source : TorqueSource
        starts : Starts
        t : ndarray, shape (N,)
            Times since the start at which the motion is wanted, s: increasing, the first zero.
        step : float
            Longest step of the integration, s.
        follower : Follower, optional
            Sees every step, for example `frischid.forward.tangents.Tangents`.

        Returns
        -------
        SimulatedMotion

        Raises
        ------
        InputError
            The mass matrix at a start is not positive definite, the step is not positive, the times do not increase
            from zero, or a start or the source's torque is not of K robots with J joints.
        """
        if not step > 0:
            raise InputError(f"the step of a simulation must be a positive time in s, got {step}")
        state, t = self._start(starts), wanted_times(t)
        self.require_inertia(state.q)
        home = state.q.copy()
        q, v = np.full((2, len(home), len(t), home.shape[1]), np.nan)
        q[:, 0], v[:, 0] = state.q, state.v
        unstable, drive = np.full(len(home), np.inf), self._drive(source)
        with np.errstate(over="ignore", invalid="ignore"):  # of a motion that runs away, as `unstable` says
            for k, gap in enumerate(np.diff(t), start=1):
                count = max(1, int(np.ceil(gap / step - 1e-9)))
                for _ in range(count):
                    taken = self._advance(state, drive, gap / count)
                    if follower is not None:
                        follower.follow(taken)
                if follower is not None:
                    follower.note()
                if not np.abs(state.v).max() < RUNAWAY:
                    away = ~(np.abs(state.v) < RUNAWAY).all(axis=1)
                    unstable[away] = np.minimum(unstable[away], t[k])
                    state.q[away], state.v[away], state.a[away] = home[away], 0.0, 0.0
                alive = np.isinf(unstable)
                q[alive, k], v[alive, k] = state.q[alive], state.v[alive]
        return SimulatedMotion(t, q, v, unstable)

    def _start(self, starts: Starts) -> _Moving:
        q, v, t, which = started(starts, self.robot.joints, len(self.effects.delay))
        z = [np.sign(v) for _ in self.effects.remembered] if starts.remembered is None else list(starts.remembered)
        return _Moving(t, q, v, np.zeros_like(q), which, z)

    def recorded(self, source: TorqueSource) -> Recorded:
        """Torque (K, J) of a source for robots at times, positions and velocities, ahead by the delay of the log."""
        shift = self.effects.delay
        equal, any_shift = bool((shift == shift[:, :1]).all()), bool(shift.any())

        def torque(which: NDArray[np.intp], t: Array, q: Array, v: Array) -> Array:
            if not any_shift:
                return source.torque(t, q, v)
            ahead = shift[which]
            if equal:
                return source.torque(t + ahead[:, 0], q, v)
            each = [source.torque(t + ahead[:, j], q, v)[:, j] for j in range(q.shape[1])]
            return np.stack(each, axis=1)

        return torque

    def _drive(self, source: TorqueSource) -> Drive:
        """Torque that acts in a step: the source's, shifted by the delay of the log and held back by its own."""
        recorded, back = self.recorded(source), delay_of(source)

        def drive(s: _Moving, t: Array, q: Array, v: Array, h: float) -> Array:
            now = recorded(s.which, t, q, v)
            if np.shape(now) != q.shape:
                raise InputError(
                    f"the source of torque gives the shape {np.shape(now)} for {len(q)} robots with the joints "
                    f"{', '.join(self.robot.joints)}; it must give {q.shape}"
                )
            return now if back == 0.0 else s.given.held_back(now, h, back)

        return drive

    def extra_at(self, t: Array) -> dict[str, Array]:
        """Further channels that effects read, at times (K,) on the source's clock."""
        return {name: np.interp(t, *self._extra[name]) for name in self._channels}

    def _balance(self, s: _Moving, q: Array, v: Array, t: Array) -> _Balance:
        inertia, bias = self.rigid(s.which, q, v)
        smooth, slope, dry = self.effects.at(s.which, t - self.begin, q, v, s.a, self.extra_at(t))
        np.einsum("kii->ki", inertia)[...] += self.effects.inertia[s.which]
        return _Balance(inertia if slope is None else inertia + slope, bias + smooth, dry)

    def _advance(self, s: _Moving, drive: Drive, h: float) -> Step:
        """Move all robots by one step."""
        middle, half = s.q + 0.5 * h * s.v, 0.5 * h
        v = s.v + half * s.a
        v = np.where(v * s.v > 0.0, v, 0.0)  # friction decides about a reversal, not the extrapolation
        inertia, bias, dry = self._balance(s, middle, v, s.t + half)
        z = [x.moved(y, half * s.v) for x, y in zip(self.effects.remembered, s.z, strict=True)]
        for memory, y in zip(self.effects.remembered, z, strict=True):
            bias += memory.torque(s.which, middle, y)
        damping = np.maximum(self.effects.damping[s.which], 0.0)
        bias += damping * (s.v - v)
        push = np.einsum("kij,kj->ki", inertia, s.v) + h * (drive(s, s.t + half, middle, v, h) - bias)
        push += half * damping * s.v
        np.einsum("kii->ki", inertia)[...] += half * damping
        if dry is None:
            after = solve(inertia, push)
        else:
            after = step_with_friction(inertia, push, s.v, (h * dry.forwards, h * dry.backwards))
        step = Step(
            h=h,
            which=s.which,
            t=s.t + half,
            q=middle,
            v=v,
            a=s.a,
            v_before=s.v,
            z_before=s.z,
            z=z,
            inertia=inertia,
            damping=damping,
            dry=dry,
            v_after=after,
        )
        s.z = [x.moved(y, half * after) for x, y in zip(self.effects.remembered, z, strict=True)]
        s.a = np.where(step.keeps_on, (after - s.v) / h, 0.0)
        s.q, s.v, s.t = middle + half * after, after, s.t + h
        return step
