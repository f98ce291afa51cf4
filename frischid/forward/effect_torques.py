"""Torque of a model's effects at many states at once, in the parts that an integrator needs.

    τ_effects(q, q̇, q̈) = s(q, q̇) + B(q) q̈ + f,     f ∈ [f⁻, f⁺] where q̇ = 0

s is smooth, B belongs to effects of acceleration, and f is dry friction. A model smooths the sign of the speed over a
width, because the measured speed at standstill is noise; a simulated speed has none. So dry friction here is that of
Coulomb: f⁺ forwards, f⁻ backwards, and anything in between at standstill, where the joint rests. Where the
parameters make f⁺ smaller than f⁻, no joint could rest: that friction stays smooth, as in the model.

Effects whose class states their columns in `Effect.code` by a joint's own motion are compiled to array expressions. All
others are evaluated by the regressor, whose columns are linearised in the acceleration about that of the step before.

Source: Moreau 1988, "Unilateral contact and dry friction in finite freedom dynamics", for set-valued friction.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from frischid.core.types import Array
from frischid.effects import Effect, State
from frischid.effects.state import SIGN_WIDTH
from frischid.errors import InputError
from frischid.forward.remembered_friction import REMEMBERED
from frischid.regression.block import Samples
from frischid.regression.regressor import Regressor
from frischid.robot.robot import Robot

Worlds = NDArray[np.intp]
Formula = Callable[[Array, Array, Array], Array]

CRAWL = 1e-9
"""Speed that stands for "just above standstill", rad/s (m/s); its sign is smoothed over a thousandth of this speed."""
FUNCTIONS = {
    **{name: getattr(np, name) for name in ("tanh", "exp", "expm1", "sin", "cos", "tan", "abs", "sqrt", "log", "sign")},
    "pow": np.power,
    "max": np.maximum,
}
"""Functions of `Effect.code`: those that generated code has too (`frischid.export.code_body.NumPy`)."""
BEYOND = {"load", "torque", "temperature", "t", "z"}
"""Quantities of `Effect.code` that a joint's own position, speed and acceleration do not give."""
DELAYS = "time_delay"


class DryFriction(NamedTuple):
    """Dry friction of K states, each (K, J), N·m (N): forwards, and backwards (f⁺ and f⁻)."""

    forwards: Array
    backwards: Array


@dataclass(frozen=True, eq=False)
class _Compiled:
    """One coefficient of an effect on some joints, with its column as an array expression."""

    joints: NDArray[np.intp]
    values: Array  # (P, joints)
    formula: Formula  # of dry friction with the sharp sign

    def add(self, out: Array, which: Worlds, q: Array, v: Array, a: Array) -> None:
        """Add the coefficient's torque to `out`, (K, J)."""
        j = self.joints
        out[:, j] += self.values[which] * self.formula(q[:, j], v[:, j], a[:, j])

    def add_each(self, out: Array, q: Array, v: Array) -> None:
        """Add the torque of every set of parameters to `out`, (K, J, P)."""
        j = self.joints
        out[:, j] += (
            np.broadcast_to(self.formula(q[:, j], v[:, j], 0.0 * v[:, j]), (len(q), len(j)))[..., None] * self.values.T
        )


class EffectTorques:
    """Torques of effects with P sets of parameters.

    Parameters
    ----------
    theta : ndarray, shape (P, C)
        Values of all columns of the regressor, one row per set of parameters.
    reference : mapping of str to float, optional
        Reference parameters of effects that depend on the load; None: the URDF's.

    Raises
    ------
    InputError
        An effect cannot be simulated forward; the message names the effect.
    """

    def __init__(
        self, robot: Robot, effects: Sequence[Effect], theta: Array, reference: Mapping[str, float] | None = None
    ) -> None:
        self.robot, self.J = robot, len(robot.joints)
        self.constant = np.zeros((len(theta), self.J))
        self.levels = np.zeros((2, len(theta), self.J))
        self.smooth: list[_Compiled] = []
        self.dry: list[_Compiled] = []
        self.inertia = np.zeros((len(theta), self.J))
        self.damping = np.zeros((len(theta), self.J))
        self.delay = np.zeros((len(theta), self.J))
        parts = _parts(robot, effects, theta)
        self.remembered = [REMEMBERED[e.id](robot, e, values) for e, values in parts if e.id in REMEMBERED]
        general = np.zeros(theta.shape)
        sharp = np.zeros(theta.shape)
        start = len(robot.columns)
        for effect, values in parts:
            columns = slice(start, start + values.shape[1])
            start = columns.stop
            if effect.id in REMEMBERED:
                continue
            if effect.id == DELAYS:
                self._add_delay(effect, values)
            elif effect.memory:
                raise InputError(
                    f"the effect {effect} cannot be simulated forward: its torque follows from the whole measured "
                    "motion; simulate a model without it (`frischid add` and `improve` take effects one at a time)"
                )
            elif not self._compile(effect, values):
                (sharp if _own_dry(robot, effect) else general)[:, columns] = values
        self._general = general if general.any() else None
        self._sharp = sharp if sharp.any() else None
        self._rubs = bool(self.dry or self.remembered or self.levels.any()) or self._sharp is not None
        if self._general is not None or self._sharp is not None:
            known = [e for e in effects if not e.memory]
            remembers = [e.memory for e, values in parts for _ in range(values.shape[1])]
            kept = np.append(np.zeros(len(robot.columns), bool), ~np.array(remembers, bool))
            self._weights = general[:, kept], sharp[:, kept]
            self._regressor = Regressor(robot, known, reference)
            self._sharp_regressor = Regressor(robot, [e.with_sign_width(1e-3 * CRAWL) for e in known], reference)

    @property
    def of_one_joint(self) -> bool:
        """Whether every effect's torque depends on the motion of its own joint alone."""
        return self._general is None and self._sharp is None

    @property
    def bent(self) -> bool:
        """Whether some torque depends on the state by more than the directions of the speeds and viscous friction."""
        return bool(self.smooth or self.dry) or not self.of_one_joint

    def smooth_of_each(self, now: Samples) -> Array:
        """Smooth torque of every set of parameters at the same K states, (K, J, P)."""
        out = self.constant.T + self.damping.T * now.v[..., None] + self.inertia.T * now.a[..., None]
        for part in self.smooth:
            part.add_each(out, now.q, now.v)
        if self._general is not None:
            out += self._regressor.of_effects(now).transpose(0, 2, 1) @ self._weights[0].T
        return np.asarray(out)

    def dry_of_each(self, now: Samples) -> tuple[Array, Array]:
        """Dry friction of every set of parameters at the same K states, forwards and backwards, (K, J, P)."""
        sides = [np.broadcast_to(level.T, (*now.q.shape, len(level))).copy() for level in self.levels]
        for out, speed in zip(sides, (np.maximum(now.v, CRAWL), np.minimum(now.v, -CRAWL)), strict=True):
            for part in self.dry:
                part.add_each(out, now.q, speed)
        if self._sharp is not None:
            weights = self._weights[1].T
            self._add_by_direction(now, sides, lambda Y: np.asarray(Y.transpose(0, 2, 1) @ weights))
        for memory in self.remembered:
            if memory.replaces:
                sides[0] -= memory.size.T
                sides[1] += memory.size.T
        return sides[0], sides[1]

    def _add_delay(self, effect: Effect, values: Array) -> None:
        if effect.joints is None:
            self.delay += values
        else:
            self.delay[:, [i for i, *_ in effect.acts_on(self.robot)]] += values

    def _compile(self, effect: Effect, values: Array) -> bool:
        """Sort an effect's columns into the compiled parts; False where the class does not state them."""
        columns = effect.columns(self.robot)
        symbols = [c.name.removesuffix(str(self.robot.numbers[c.joint])) for c in columns]
        if not columns or not set(symbols) <= set(effect.code):
            return False
        if any(BEYOND & set(re.findall(r"\{(\w+)\}", effect.code[symbol])) for symbol in symbols):
            return False
        if any(len(term.rows) > 1 for term in effect.terms(State.empty(self.robot))):
            return False
        for symbol in dict.fromkeys(symbols):
            mine = [k for k, s in enumerate(symbols) if s == symbol]
            joints = np.array([self.robot.joints.index(columns[k].joint) for k in mine])
            text = effect.code[symbol]
            if text == "{a}":
                self.inertia[:, joints] += values[:, mine]
            elif text == "{v}":
                self.damping[:, joints] += values[:, mine]
            else:
                shapes = {**effect.parameters, "middle": self.robot.limits.middle[joints]}
                dry = effect.dry and effect.smooths_sign
                given = {**shapes, "width": 1e-3 * CRAWL, "lead": 0.0} if dry else shapes
                self._sort(_Compiled(joints, values[:, mine], _compiled(text, given)), dry)
        return True

    def _sort(self, part: _Compiled, dry: bool) -> None:
        """File a compiled part; torque that no state changes, save the direction, is computed once."""
        rng = np.random.default_rng(0)
        q, v, a = rng.normal(size=(3, 9, 1)) * np.ones(len(part.joints))
        sides = [np.broadcast_to(part.formula(q, side * np.abs(v) + side * CRAWL, a), q.shape) for side in (1.0, -1.0)]
        same = [bool((x == x[0]).all()) for x in sides]
        if dry and all(same):
            for level, x in zip(self.levels, sides, strict=True):
                level[:, part.joints] += part.values * x[0]
        elif not dry and all(same) and (sides[0][0] == sides[1][0]).all():
            self.constant[:, part.joints] += part.values * sides[0][0]
        else:
            (self.dry if dry else self.smooth).append(part)

    def at(self, which: Worlds, t: Array, q: Array, v: Array, a: Array, extra: Mapping[str, Array]) -> EffectsAt:
        """Torques at K states.

        Parameters
        ----------
        which : ndarray of int, shape (K,)
            Set of parameters of each state.
        t : ndarray, shape (K,)
            Time since the beginning of the log, s.
        q, v, a : ndarray, shape (K, J)
            Position and velocity, and the acceleration about which effects are linearised.
        extra : mapping of str to ndarray, shape (K,)
            Further channels that effects read.
        """
        smooth = self.constant[which] + self.damping[which] * v
        if self.smooth:
            none = np.zeros_like(q)
            for part in self.smooth:
                part.add(smooth, which, q, v, none)
        inertia: Array | None = None
        if self._general is not None:
            torque, inertia = self._evaluate_general(which, t, q, v, a, extra)
            smooth += torque
        dry = self._dry(which, t, q, v, a, extra)
        return EffectsAt(smooth, inertia, dry)

    def _dry(
        self, which: Worlds, t: Array, q: Array, v: Array, a: Array, extra: Mapping[str, Array]
    ) -> DryFriction | None:
        if not self._rubs:
            return None
        sides = [level[which] for level in self.levels]
        if self.dry:
            none = np.zeros_like(q)
            for out, speed in zip(sides, (np.maximum(v, CRAWL), np.minimum(v, -CRAWL)), strict=True):
                for part in self.dry:
                    part.add(out, which, q, speed, none)
        if self._sharp is not None:
            weights = self._weights[1][which]
            self._add_by_direction(
                Samples(t, q, v, a, 0.0, extra), sides, lambda Y: np.asarray(np.einsum("kcj,kc->kj", Y, weights))
            )
        for memory in self.remembered:
            memory.reduce(which, *sides)
        forwards, backwards = sides
        if (turned := forwards < backwards).any():
            level = (forwards + backwards) / 2 + (forwards - backwards) / 2 * np.tanh(v / SIGN_WIDTH)
            forwards, backwards = np.where(turned, level, forwards), np.where(turned, level, backwards)
        return DryFriction(forwards, backwards)

    def _add_by_direction(self, now: Samples, sides: Sequence[Array], weighted: Callable[[Array], Array]) -> None:
        """Add dry friction without compiled columns. The load on a joint is that at the speeds of all joints.

        Only within the step of a reversal, the load is that of the arm at standstill.
        """
        v = now.v

        def friction(speed: Array) -> Array:
            return weighted(self._sharp_regressor.of_effects(Samples(now.t, now.q, speed, now.a, 0.0, now.extra)))

        turned, speed = friction(np.where(v > 0.0, -CRAWL, CRAWL)), v.reshape(*v.shape, *[1] * (sides[0].ndim - 2))
        sides[0][...] += np.where(speed >= 0.0, friction(np.where(v == 0.0, CRAWL, v)), turned)
        sides[1][...] += np.where(speed <= 0.0, friction(np.where(v == 0.0, -CRAWL, v)), turned)

    def _evaluate_general(
        self, which: Worlds, t: Array, q: Array, v: Array, a: Array, extra: Mapping[str, Array]
    ) -> tuple[Array, Array]:
        """Torque at zero acceleration of effects without compiled columns, and its slope (K, J, J), about `a`."""
        n = self.J + 1
        around = np.repeat(a, n, axis=0).reshape(len(q), n, self.J)
        around[:, 1:] += np.eye(self.J)
        many = {name: np.repeat(x, n) for name, x in extra.items()}
        times, places, speeds = (np.repeat(x, n, axis=0) for x in (t, q, v))
        samples = Samples(times, places, speeds, around.reshape(-1, self.J), 0.0, many)
        Y = self._regressor.of_effects(samples)
        torque = np.einsum("kncj,kc->knj", Y.reshape(len(q), n, *Y.shape[1:]), self._weights[0][which])
        slope = (torque[:, 1:] - torque[:, :1]).transpose(0, 2, 1)
        return torque[:, 0] - np.einsum("kij,kj->ki", slope, a), slope


class EffectsAt(NamedTuple):
    """Torque of the effects at K states: smooth (K, J), its slope by acceleration (K, J, J) or None, dry friction."""

    smooth: Array
    inertia: Array | None
    dry: DryFriction | None


def _parts(robot: Robot, effects: Sequence[Effect], theta: Array) -> list[tuple[Effect, Array]]:
    """Each effect with the values of its columns, (P, columns)."""
    found, start = [], len(robot.columns)
    for effect in effects:
        stop = start + len(effect.columns(robot))
        found.append((effect, theta[:, start:stop]))
        start = stop
    return found


def _own_dry(robot: Robot, effect: Effect) -> bool:
    """Whether an effect is dry friction of each joint by itself, so that a sharp sign can replace the smoothed one."""
    if not (effect.dry and effect.smooths_sign):
        return False
    return all(len(term.rows) == 1 for term in effect.terms(State.empty(robot)))


def _compiled(text: str, shapes: Mapping[str, float | bool | str | Array]) -> Formula:
    """Array function of (q, v, a) from an effect's class, as `Effect.code` states it; shape parameters are values."""
    body = re.sub(r"\{(\w+)\}", r"\1", text)
    space: dict[str, object] = {"__builtins__": {}, **FUNCTIONS, **shapes}
    formula: Formula = eval(compile(f"lambda q, v, a: {body}", "<effect>", "eval"), space)
    return formula
