"""The regressor of a motion, chunk by chunk.

    τ = Y θ,   Y = [Γ(q, q̇, q̈) | C_effect1 | C_effect2 | ...]

Pinocchio computes Γ sample by sample. Effects add their columns over a whole chunk of samples. The same low-pass filter
is applied to τ and Y ("parallel" filtering), and every D-th sample is kept. Only one chunk is in memory at a time. The
last samples of a chunk that the filter still needs are carried into the next chunk, so the length of the chunks has no
influence on the result.

Source: C. Atkeson, C. An and J. Hollerbach, "Estimation of inertial parameters of manipulator loads and links", Int. J.
Robotics Research 5(3), 1986.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from frischid.core.remembered import Remembered
from frischid.core.types import Array, Column
from frischid.effects import Coulomb, Effect, State, columns_of
from frischid.effects.dynamics import RigidDynamics
from frischid.logs.filters import LowPass
from frischid.logs.preprocessing import Motion
from frischid.regression.block import COLUMNS_BESIDE_Y, Block, Samples
from frischid.regression.chunks import filtered_chunks, part_of
from frischid.robot.robot import Robot

CHUNK_SAMPLES = 256
"""Samples that are evaluated at once, so that their columns fit into the processor's cache."""
EFFECT_SAMPLES = 4096
"""Samples at which the torque of the effects is computed at once."""
STANDSTILL_WEIGHT = 0.01
"""Share of a filtered sample's weight that may come from standstill before its torque is left out."""
_MOTION_STATES = Remembered[State]()


class Regressor:
    """Builds Y for a robot and its effects.

    Parameters
    ----------
    reference : mapping of str to float, optional
        Parameter values that give the load for effects that depend on the load; the URDF's values by default.

    Attributes
    ----------
    columns : tuple of Column
        The C columns: first those of the links, then each effect's.
    reference : ndarray, shape (C,)
        Value of each column's parameter in `reference`.
    active : list of ndarray of int
        For each joint, the columns that can be nonzero.
    loaded : bool
        Whether an effect depends on the load.
    drops_standstill : ndarray of bool, shape (J,)
        Joints whose torque at standstill is left out, because dry friction is undetermined there.

    Examples
    --------
    >>> import numpy as np
    >>> import frischid as fr
    >>> from frischid.regression.regressor import Regressor, nominal_parameters
    >>> robot = fr.Robot.load("planar2")
    >>> regressor = Regressor(robot, effects=())
    >>> t = np.arange(5) / 100
    >>> q, v, a = np.ones((3, 5, 2))
    >>> Y = regressor(t, q, v, a)
    >>> Y.shape[1] == len(regressor.columns)
    True
    >>> torque = np.einsum("ncj,c->nj", Y, nominal_parameters(robot, ()))
    >>> bool(np.allclose(torque, robot.inverse_dynamics(q, v, a)))
    True
    """

    def __init__(self, robot: Robot, effects: Sequence[Effect], reference: Mapping[str, float] | None = None) -> None:
        self.robot, self.effects = robot, tuple(effects)
        self.columns: tuple[Column, ...] = columns_of(robot, effects)
        self.loaded = any(effect.loaded for effect in effects)
        if reference is None:
            self.reference = nominal_parameters(robot, effects)
        else:
            self.reference = np.array([reference.get(c.name, 0.0) for c in self.columns])
        self.active = self._active()
        dry = {n for effect in effects if effect.dry for _, n, _ in effect.acts_on(robot)}
        self.drops_standstill = np.array([n in dry for n in robot.joints])

    def with_effects(self, effects: Sequence[Effect]) -> Regressor:
        """The same robot and reference with other effects; a parameter that the reference lacks is zero there."""
        found = Regressor(self.robot, effects)
        values = dict(zip((c.name for c in self.columns), self.reference, strict=True))
        found.reference = np.array([values.get(c.name, 0.0) for c in found.columns])
        return found

    def _active(self) -> list[NDArray[np.intp]]:
        """For each joint, the columns that can be nonzero: those of links it moves and of effects that act on it."""
        J, rigid = len(self.robot.joints), len(self.robot.columns)
        mask = np.zeros((len(self.columns), J), bool)
        q, v, a = np.random.default_rng(0).uniform(-1.0, 1.0, (3, 8, J))
        sample = np.empty((8, rigid, J))
        self.robot.regressor(q, v, a, sample)
        mask[:rigid] = (np.abs(sample) > 1e-12).any(axis=0)
        terms = [term for effect in self.effects for term in effect.terms(State.empty(self.robot))]
        for row, term in enumerate(terms, start=rigid):
            mask[row, list(term.rows)] = True
        return [np.flatnonzero(mask[:, j]) for j in range(J)]

    def __call__(
        self,
        t: Array,
        q: Array,
        v: Array,
        a: Array,
        out: Array | None = None,
        extra: Mapping[str, Array] | None = None,
    ) -> Array:
        """Regressor of N consecutive samples.

        Parameters
        ----------
        t : ndarray, shape (N,)
            Time, s.
        q, v, a : ndarray, shape (N, J)
        out : ndarray, shape (N, C, J), optional
            Where to write.
        extra : mapping of str to ndarray, shape (N,), optional
            Further channels that effects read.

        Returns
        -------
        ndarray, shape (N, C, J)
            ``τ[k] = Y[k].T @ θ``; samples first, so that filters run along axis 0.
        """
        return self.evaluate(Samples(t, q, v, a, float(t[0]) if len(t) else 0.0, extra or {}), out=out)

    def evaluate(
        self,
        samples: Samples,
        remembered: Mapping[int, list[dict[int, Array]]] | None = None,
        out: Array | None = None,
    ) -> Array:
        """Regressor of N consecutive samples of a longer motion.

        Parameters
        ----------
        remembered : mapping, optional
            Columns of effects with memory at these samples, as `remember` computes them for a whole motion. Without
            them, an effect with memory starts at the first sample.
        out : ndarray, shape (N, C, J), optional
            Where to write.

        Returns
        -------
        ndarray, shape (N, C, J)
        """
        t, q, v, a = samples.t, samples.q, samples.v, samples.a
        rows = (len(t), len(self.robot.joints), len(self.columns))
        Y = np.empty(rows).transpose(0, 2, 1) if out is None else out  # rows of Pinocchio's array stay rows
        rigid = len(self.robot.columns)
        load = None
        if self.loaded:
            self.robot.regressor(q, v, a, Y[:, :rigid])
            load = self._load_of(samples, Y[:, :rigid])
        written = self.effect_columns(samples, remembered or {}, load)
        # Chunk by chunk: all columns of a sample are written while the sample is in the processor's cache.
        for first in range(0, len(t), 2 * CHUNK_SAMPLES):
            s = slice(first, first + 2 * CHUNK_SAMPLES)
            if not self.loaded:
                self.robot.regressor(q[s], v[s], a[s], Y[s, :rigid])
            Y[s, rigid:] = 0.0
            for k, joint, values in written:
                Y[s, k, joint] = values[s]
        return Y

    def of_effects(self, samples: Samples) -> Array:
        """Columns of the effects alone, (N, C - R, J), without those of the R link parameters.

        An effect with memory starts at the first sample. The links are evaluated only where an effect needs their load.
        """
        rigid, N, J = len(self.robot.columns), len(samples.t), len(self.robot.joints)
        load = None
        if self.loaded:
            links = np.empty((N, J, rigid)).transpose(0, 2, 1)  # rows of Pinocchio's array stay rows
            self.robot.regressor(samples.q, samples.v, samples.a, links)
            load = self._load_of(samples, links)
        Y = np.zeros((N, len(self.columns) - rigid, J))
        for k, joint, values in self.effect_columns(samples, {}, load):
            Y[:, k - rigid, joint] = values
        return Y

    def effect_columns(
        self, samples: Samples, remembered: Mapping[int, list[dict[int, Array]]], load: Array | None
    ) -> list[tuple[int, int, Array]]:
        """Values of the effects' columns at N samples: (column, joint, values) of each joint that a column acts on.

        Parameters
        ----------
        remembered : mapping
            Columns of effects with memory at these samples; see `evaluate`.
        load : ndarray, shape (N, J), or None
            Torque of the reference's links, which effects that depend on the load need (`loaded`); None for zero.
        """
        none = np.zeros(samples.q.shape)
        load = none if load is None else load
        written: list[tuple[int, int, Array]] = []
        column = rigid = len(self.robot.columns)
        for number, effect in enumerate(self.effects):
            if number in remembered:
                rows = remembered[number]
            else:
                torque = self._with_effects(load, written) if effect.loaded else none
                state = self._state_of(samples, load, torque, self.reference[:rigid])
                rows = [dict(term.rows) for term in effect.terms(state)]
            written += [(column + k, joint, values) for k, row in enumerate(rows) for joint, values in row.items()]
            column += len(rows)
        return written

    def _with_effects(self, load: Array, written: Sequence[tuple[int, int, Array]]) -> Array:
        """Torque of the reference parameters: that of the links and that of some effects' columns."""
        torque = load.copy()
        for k, joint, values in written:
            torque[:, joint] += self.reference[k] * values
        return torque

    def remember(self, motion: Motion) -> dict[int, list[dict[int, Array]]]:
        """Columns of effects with memory over a whole motion: position of the effect -> per column, joint -> values."""
        with_memory = [effect for effect in self.effects if effect.memory]
        if not with_memory:
            return {}
        if any(effect.loaded for effect in with_memory):
            state = self.state(motion)
        else:  # no torque is needed
            none = np.zeros_like(motion.q)
            state = self._state_of(Samples.of(motion), none, none, self.reference[: len(self.robot.columns)], self.dry)
        return {
            number: [dict(term.rows) for term in effect.terms(state)]
            for number, effect in enumerate(self.effects)
            if effect.memory
        }

    def state(self, motion: Motion) -> State:
        """State of a whole motion for effects, with the torque of the reference parameters (static columns only).

        Refits with other effects read the same state. Its torques are kept as long as the motion, without its slopes,
        which need many times the memory of the motion.
        """
        values = dict(zip((c.name for c in self.columns), self.reference, strict=True))
        used = [e for e in self.effects if not e.memory and any(values[c.name] for c in e.columns(self.robot))]
        reference = tuple(values[c.name] for c in columns_of(self.robot, used))
        key = (self.robot, tuple((type(e), str(e)) for e in used), reference, self.dry.tobytes())
        return replace(_MOTION_STATES.of(motion, key, lambda: self._state_with(motion, used)))

    def _state_with(self, motion: Motion, used: Sequence[Effect]) -> State:
        static = self.with_effects(used)  # effects that were added after the reference have none there
        load = static.load(motion)
        torque = load + static._torque_of_effects(motion, static.reference, load, {})
        rigid = static.reference[: len(self.robot.columns)]
        return self._state_of(Samples.of(motion), load, torque, rigid, self.dry)

    def load(self, motion: Motion | Samples) -> Array:
        """Torque (N, J) of the reference's links, with the known parameters of the robot."""
        links = RigidDynamics.of(self.robot, self.reference[: len(self.robot.columns)])
        return links.torque(motion.q, motion.v, motion.a)

    def _load_of(self, samples: Samples, links: Array) -> Array:
        """The same from the links' columns (N, R, J): a gear carries the known links too."""
        unknown = np.asarray(self.reference[: links.shape[1]] @ links)
        known = self.robot.known_torque(samples.q, samples.v, samples.a)
        return unknown if known is None else unknown + known

    def _state_of(self, samples: Samples, load: Array, torque: Array, rigid: Array, dry: Array | None = None) -> State:
        """State for effects at some samples."""
        motion = (samples.t, samples.q, samples.v, samples.a)
        return State(self.robot, *motion, load, torque, samples.start, samples.extra, rigid, dry)

    @property
    def dry(self) -> Array:
        """Dry friction on each joint according to the reference parameters, N·m (N), (J,)."""
        level = np.zeros(len(self.robot.joints))
        for column, value in zip(self.columns, self.reference, strict=True):
            if column.effect == Coulomb.id:
                level[self.robot.joints.index(column.joint)] = max(float(value), 0.0)
        return level

    def torque(self, motion: Motion, theta: Array) -> Array:
        """Unfiltered torque of all columns and of known parameters over a motion, (N, J), for the parameters (C,).

        The links' torque is that of inverse dynamics, which costs a fifth of the links' columns.
        """
        links = RigidDynamics.of(self.robot, theta[: len(self.robot.columns)]).torque(motion.q, motion.v, motion.a)
        load = self.load(motion) if self.loaded else np.zeros(motion.q.shape)
        return links + self._torque_of_effects(motion, theta, load, self.remember(motion))

    def _torque_of_effects(
        self, motion: Motion, theta: Array, load: Array, remembered: Mapping[int, list[dict[int, Array]]]
    ) -> Array:
        """Torque (N, J) of the effects' columns over a motion, for the parameters (C,) and the reference's load."""
        out, rigid = np.zeros(motion.q.shape), self.reference[: len(self.robot.columns)]
        for start in range(0, len(motion.t), EFFECT_SAMPLES):
            part = slice(start, start + EFFECT_SAMPLES)
            samples, before = Samples.of(motion).part(part), load[part].copy()
            column = len(rigid)
            for number, effect in enumerate(self.effects):
                if number in remembered:
                    rows = [{joint: x[part] for joint, x in row.items()} for row in remembered[number]]
                else:
                    state = self._state_of(samples, load[part], before.copy(), rigid)
                    rows = [dict(term.rows) for term in effect.terms(state)]
                for k, row in enumerate(rows, start=column):
                    for joint, values in row.items():
                        out[part, joint] += theta[k] * values
                        before[:, joint] += self.reference[k] * values
                column += len(rows)
        return out

    def blocks(self, motion: Motion, lowpass: LowPass, chunk: int = CHUNK_SAMPLES) -> Iterator[Block]:
        """Filtered and decimated blocks of a motion, in order.

        Parameters
        ----------
        chunk : int
            Samples that are evaluated at once; the samples of all blocks together do not depend on this number.
        """
        remembered = self.remember(motion)
        shape = (len(self.robot.joints), len(self.columns) + COLUMNS_BESIDE_Y)

        def fill(part: slice, out: Array) -> None:
            self._fill(
                Samples.of(motion).part(part), motion.tau[part], part_of(remembered, part), out.transpose(0, 2, 1)
            )

        for t, Z, standstill in filtered_chunks(motion, lowpass, shape, fill, chunk):
            yield Block(t, Z.transpose(0, 2, 1), self.counted(standstill), motion.source)

    def counted(self, standstill: Array) -> NDArray[np.bool_]:
        """Whether each filtered torque counts, from the share of its weight that comes from standstill, both (N, J)."""
        return np.asarray((standstill < STANDSTILL_WEIGHT) | ~self.drops_standstill)

    def _fill(self, samples: Samples, tau: Array, remembered: Mapping[int, list[dict[int, Array]]], out: Array) -> None:
        """Write the columns of a `Block.Z`, unfiltered."""
        C = len(self.columns)
        self.evaluate(samples, remembered, out[:, :C])
        q, v, a = samples.q, samples.v, samples.a
        known = self.robot.known_torque(q, v, a)
        out[:, C + 2] = 0.0 if known is None else known
        out[:, C] = tau - out[:, C + 2]
        out[:, C + 1] = 1.0
        out[:, C + 3], out[:, C + 4], out[:, C + 5] = q, v, a


def usual_shares(robot: Robot, effects: Sequence[Effect]) -> Array:
    """Usual size of every coefficient, as a share of that which alone would cause the measured torque; links have 1."""
    return np.array([1.0] * len(robot.columns) + [x for effect in effects for x in effect.usual(robot)])


def nominal_parameters(robot: Robot, effects: Sequence[Effect]) -> Array:
    """The URDF's own value of every column of the regressor: inertials, damping and friction; zero elsewhere.

    The URDF says nothing of a change.
    """
    values = dict(zip(robot.all_names, robot.nominal, strict=True))
    rigid = [values[c.name] for c in robot.columns]
    return np.array(rigid + [0.0 if effect.changed else x for effect in effects for x in effect.nominal(robot)])
