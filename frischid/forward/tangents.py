"""Derivatives of simulated motions by the model's parameters, carried along the steps of the integration.

With θ = θ_0 + D z, a step of `frischid.forward.forward_dynamics` solves R(q', q̇', (q̇⁺ − q̇)/h, θ) = τ(t, q', q̇') at its
middle for the velocities q̇⁺ after it. Its derivative gives those after the step from those before,

    A ∂q̇⁺ = A ∂q̇ − h ( R_q ∂q' + R_v ∂q̇' + R_θ D − ∂τ ),      ∂ = ∂/∂z,

and ∂q̇⁺ = 0 at a joint that dry friction holds. R is linear in θ, so R_θ is the regressor, with the friction of the side
to which a joint moves. R_q and R_v of the links are Pinocchio's derivatives of inverse dynamics. Those of effects, and
of the source of torque, are central differences at one state, which cost no simulation.

Where a joint begins or ceases to rest, the moment depends on z, but velocity and friction are continuous there, so the
derivative of the motion is continuous too.

Sources: Carpentier and Mansard 2018, "Analytical derivatives of rigid body dynamics algorithms", RSS; Leineweber 1999,
on internal numerical differentiation: the derivative of the integrator, not of the equation.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from frischid.core.types import Array
from frischid.effects.state import SIGN_WIDTH
from frischid.forward.effect_torques import DryFriction, EffectTorques
from frischid.forward.forward_dynamics import ForwardDynamics
from frischid.forward.simulated_motion import Given, Step, delay_of
from frischid.forward.torque_sources import RecordedTorque, TorqueSource
from frischid.regression.block import Samples

CLOSE_BY = 1e-6
"""rad, rad/s, rad/s² (m, m/s, m/s²), s: half the distance of a central difference."""


class Tangents:
    """Derivatives of K simulated motions by P parameters z.

    Parameters
    ----------
    forward : ForwardDynamics
        With one set of parameters.
    directions : ndarray, shape (C, P)
        D: change of the values of all columns of the regressor with z.
    source : TorqueSource
        Of the simulation that is followed.
    robots : int
        K.

    Attributes
    ----------
    noted : list of ndarray, shape (K, J, P)
        ∂q/∂z at every wanted time but the first, where it is zero.

    Examples
    --------
    >>> import numpy as np
    >>> import frischid as fr
    >>> from frischid.forward.tangents import Tangents
    >>> robot = fr.Robot.load("planar2")
    >>> log = fr.simulate(robot, fr.random_fourier(robot, 5.0, seed=1), rate=100.0)
    >>> model = fr.identify(robot, [log], recursion="none").model
    >>> def moved(theta, follower=None):
    ...     forward = fr.ForwardDynamics(model, theta[None])
    ...     start = fr.Starts(log.q[50:51], log.v[50:51], log.t[50:51])
    ...     return forward.simulate(source, start, np.array([0.0, 0.2]), follower=follower).q[0, -1]
    >>> source, theta = fr.RecordedTorque(log.t, log.tau), model.full_theta
    >>> one = np.eye(len(theta))[:, model.base[0]]
    >>> tangents = Tangents(fr.ForwardDynamics(model, theta[None]), one[:, None], source, 1)
    >>> _ = moved(theta, tangents)
    >>> difference = (moved(theta + 1e-5 * one) - moved(theta - 1e-5 * one)) / 2e-5
    >>> bool(np.allclose(tangents.noted[-1][0, :, 0], difference, rtol=1e-3))
    True
    """

    def __init__(self, forward: ForwardDynamics, directions: Array, source: TorqueSource, robots: int) -> None:
        model, effects, J, P = forward.model, forward.effects, len(forward.robot.joints), directions.shape[1]
        self.forward, self.effects = forward, effects
        self.q, self.v, self.a = np.zeros((3, robots, J, P))
        self.z = [np.zeros((robots, J, P)) for _ in effects.remembered]
        self.noted: list[Array] = []
        self._recorded, self._back = forward.recorded(source), delay_of(source)
        self._still = isinstance(source, RecordedTorque)
        self._given = Given()
        self._moves = EffectTorques(forward.robot, model.effects, directions.T, model.reference)
        self._links = directions[: len(forward.robot.columns)]

    def note(self) -> None:
        """Keep ∂q/∂z: a wanted time is reached."""
        self.noted.append(self.q.copy())

    def follow(self, step: Step) -> None:
        """Carry the derivatives over one step."""
        s, h, e = step, step.h, self.effects
        half, acceleration = 0.5 * h, (s.v_after - s.v_before) / h
        q = self.q + half * self.v
        v = np.where((s.v != 0.0)[..., None], self.v + half * self.a, 0.0)
        z = []
        for memory, before, path in zip(e.remembered, self.z, s.z_before, strict=True):
            z.append(_remembered(memory.distance, path, half * s.v_before, before, half * self.v))
        by_q, by_v, by_a = self._slopes(s, acceleration)
        damping = s.damping[..., None]
        change = by_q @ q + by_v @ v - damping * v + self._by_parameters(s, acceleration)
        if by_a is not None:
            change += by_a @ self.a
        for memory, y in zip(e.remembered, z, strict=True):
            change += memory.spring[s.which][..., None] * q + memory.size[s.which][..., None] * y
        change -= self._torque(s, q, v)
        push = s.inertia @ self.v - h * damping * self.v - h * change
        rests = np.zeros(s.q.shape, bool) if s.dry is None else s.v_after == 0.0
        held = np.where(rests[..., None], np.eye(s.q.shape[1]), s.inertia)
        after = np.linalg.solve(held, np.where(rests[..., None], 0.0, push))
        for n, (memory, y, before) in enumerate(zip(e.remembered, z, s.z, strict=True)):
            self.z[n] = _remembered(memory.distance, before, half * s.v_after, y, half * after)
        self.a = np.where(s.keeps_on[..., None], (after - self.v) / h, 0.0)
        self.q, self.v = q + half * after, after

    def _slopes(self, s: Step, acceleration: Array) -> tuple[Array, Array, Array | None]:
        """Derivatives (K, J, J) of links and effects by position, velocity and the acceleration of linearisation."""
        by_q, by_v = self.forward.rigid.slopes(s.which, s.q, s.v, acceleration)
        extra, t = self.forward.extra_at(s.t), s.t - self.forward.begin
        side = np.sign(s.v_after)

        def torque(q: Array, v: Array, a: Array) -> Array:
            found = self.effects.at(s.which, t, q, v, a, extra)
            out = found.smooth
            if found.inertia is not None:
                out = out + np.einsum("kij,kj->ki", found.inertia, acceleration)
            if found.dry is not None:
                out = out + np.where(side > 0, found.dry.forwards, np.where(side < 0, found.dry.backwards, 0.0))
            return out

        if not self.effects.bent:
            np.einsum("kii->ki", by_v)[...] += self.effects.damping[s.which]
            return by_q, by_v, None
        if self.effects.of_one_joint:
            np.einsum("kii->ki", by_q)[...] += _central(lambda x: torque(s.q + x, s.v, s.a))
            np.einsum("kii->ki", by_v)[...] += _central(lambda x: torque(s.q, s.v + x, s.a))
            return by_q, by_v, None
        by_a = np.empty_like(by_q)
        for j, one in enumerate(np.eye(s.q.shape[1])):
            by_q[:, :, j] += _central(lambda x, e=one: torque(s.q + x * e, s.v, s.a))  # type: ignore[misc]
            by_v[:, :, j] += _central(lambda x, e=one: torque(s.q, s.v + x * e, s.a))  # type: ignore[misc]
            by_a[:, :, j] = _central(lambda x, e=one: torque(s.q, s.v, s.a + x * e))  # type: ignore[misc]
        return by_q, by_v, by_a

    def _by_parameters(self, s: Step, acceleration: Array) -> Array:
        """R_θ D, (K, J, P)."""
        moves, robot = self._moves, self.forward.robot
        Y = np.empty((len(s.q), len(self._links), len(robot.joints)))
        robot.regressor(s.q, s.v, acceleration, Y)
        out = Y.transpose(0, 2, 1) @ self._links + moves.smooth_of_each(self._middle(s, acceleration))
        mean = 0.5 * (s.v_before + s.v_after) - s.v
        out += np.where(s.damping > 0.0, mean, 0.0)[..., None] * moves.damping.T
        for memory, y in zip(moves.remembered, s.z, strict=True):
            out += memory.spring.T * s.q[..., None] + memory.size.T * y[..., None]
        return np.asarray(out if s.dry is None else out + self._friction(s, s.dry))

    def _friction(self, s: Step, dry: DryFriction) -> Array:
        """Derivative of dry friction by z, on the side to which each joint moves, (K, J, P)."""
        forwards, backwards = self._moves.dry_of_each(self._middle(s, s.a))
        side = np.sign(s.v_after)[..., None]
        slip = np.where(side > 0, forwards, np.where(side < 0, backwards, 0.0))
        turned = dry.forwards == dry.backwards
        if turned.any():
            smooth = np.tanh(s.v / SIGN_WIDTH)[..., None]
            level = (forwards + backwards) / 2 + (forwards - backwards) / 2 * smooth
            slip = np.where(turned[..., None], level, slip)
        return np.asarray(slip)

    def _middle(self, s: Step, a: Array) -> Samples:
        """The middle of a step as samples, with an acceleration (K, J)."""
        return Samples(s.t - self.forward.begin, s.q, s.v, a, 0.0, self.forward.extra_at(s.t))

    def _torque(self, s: Step, q: Array, v: Array) -> Array:
        """∂τ of the source, (K, J, P)."""
        now = np.zeros_like(q)
        if not self._still:
            now = _central(lambda x: self._recorded(s.which, s.t, s.q + x, s.v))[..., None] * q
            now += _central(lambda x: self._recorded(s.which, s.t, s.q, s.v + x))[..., None] * v
        if self._moves.delay.any():
            rate = _central(lambda x: self._recorded(s.which, s.t + x, s.q, s.v))
            now = now + rate[..., None] * self._moves.delay.T
        return now if self._back == 0.0 else self._given.held_back(now, s.h, self._back)


def _central(function: Callable[[float], Array]) -> Array:
    return np.asarray((function(CLOSE_BY) - function(-CLOSE_BY)) / (2 * CLOSE_BY))


def _remembered(distance: float, z: Array, path: Array, by_z: Array, by_path: Array) -> Array:
    """Derivative of `RememberedFriction.moved`."""
    side, left = np.sign(path), np.exp(-np.abs(path) / distance)
    slope = (side - z) * left * side / distance
    return np.asarray(left[..., None] * by_z + slope[..., None] * by_path)
