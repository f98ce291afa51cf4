"""The regressor of a motion, chunk by chunk, and its moments.

    τ = Y θ,   Y = [Γ(q, q̇, q̈) | C_effect1 | C_effect2 | ...]

Pinocchio writes Γ sample by sample, effects add their columns over a whole chunk, the parallel low-pass goes over τ and
Y together and keeps every D-th sample. Only one chunk is ever in memory; a filter's reach is carried from one chunk
to the next, so chunks change nothing.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import chain, islice

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import ThreadpoolController

from frischid.core.types import Array, Column
from frischid.effects import Coulomb, Effect, State, columns_of
from frischid.errors import InputError
from frischid.logs.filters import LowPass, decimating_filter
from frischid.logs.preprocessing import Motion
from frischid.regression.moments import Blocks, Gram, total
from frischid.regression.streaming_qr import StreamingQR
from frischid.robot.robot import Robot

CHUNK = 256  # samples; fits the processor's cache
EXTRA = 6  # columns filtered beside Y: τ, ones, known torque, q, q̇, q̈
RESTING = 0.01  # share of a filtered sample's weight that may come from standstill
LEAST_BLOCKS, MAX_BLOCKS = 16, 64
BLOCK_BYTES = 128 * 2**20  # of all blocks together: hundreds of parameters on dozens of joints have fewer blocks
FEWEST_KEPT = 24  # all the same, so that half of them still make standard errors


@dataclass(frozen=True, eq=False)
class Block:
    """Filtered and decimated samples of one stretch of motion.

    Attributes
    ----------
    t : ndarray, shape (M,)
    Z : ndarray, shape (M, C + 6, J)
        The C columns of Y, then `tau`, ones, `known`, `q`, `v`, `a`: one array, because one filter serves them all.
    used : ndarray of bool, shape (M, J)
        False where the joint rests and its dry friction is anybody's guess: such torque rows are neither fitted nor
        counted in errors.
    source : str
        The log.
    """

    t: Array
    Z: Array
    used: NDArray[np.bool_]
    source: str

    @property
    def Y(self) -> Array:
        """Regressor, shape (M, C, J): ``τ[k] = Y[k].T @ θ``."""
        return self.Z[:, :-EXTRA]

    @property
    def tau(self) -> Array:
        """Measured torque less that of parameters known outright, (M, J), N·m (N); NaN where not measured."""
        return self.Z[:, -6]

    @property
    def known(self) -> Array:
        """Torque of the parameters known outright, (M, J), N·m (N)."""
        return self.Z[:, -4]

    @property
    def q(self) -> Array:
        """Filtered positions, (M, J)."""
        return self.Z[:, -3]

    @property
    def v(self) -> Array:
        """Filtered velocities, (M, J)."""
        return self.Z[:, -2]

    @property
    def a(self) -> Array:
        """Filtered accelerations, (M, J)."""
        return self.Z[:, -1]


class Regressor:
    """Builds Y for a robot and its effects.

    Parameters
    ----------
    robot : Robot
    effects : sequence of Effect
    reference : mapping of str to float, optional
        Parameter values that effects which depend on the load take it from; the URDF's own by default.
    """

    def __init__(self, robot: Robot, effects: Sequence[Effect], reference: Mapping[str, float] | None = None) -> None:
        self.robot, self.effects = robot, tuple(effects)
        self.columns: tuple[Column, ...] = columns_of(robot, effects)
        self.loaded = any(effect.loaded for effect in effects)
        values = nominal_parameters(robot, effects) if reference is None else None
        self.reference = (
            values if values is not None else np.array([(reference or {}).get(c.name, 0.0) for c in self.columns])
        )
        self.active = self._active()
        C = len(self.columns)
        # what a joint's moments are made of: its columns, its torque, ones
        self.gathered = [np.append(active, [C, C + 1]) for active in self.active]
        dry = {n for effect in effects if effect.dry for _, n, _ in effect.acts_on(robot)}
        self.resting = np.array([n in dry for n in robot.joints])

    def _active(self) -> list[NDArray[np.intp]]:
        """For each joint, the columns that can be other than zero: links it moves, and effects that act on it."""
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
        start = float(t[0]) if len(t) else 0.0
        return self._evaluate(t, q, v, a, start, extra or {}, {}, out)

    def _evaluate(
        self,
        t: Array,
        q: Array,
        v: Array,
        a: Array,
        start: float,
        extra: Mapping[str, Array],
        remembered: Mapping[int, list[dict[int, Array]]],
        out: Array | None = None,
    ) -> Array:
        """Y of some samples; effects with memory come from `remembered` where it holds them."""
        Y = np.empty((len(t), len(self.columns), len(self.robot.joints))) if out is None else out
        rigid = len(self.robot.columns)
        none = np.zeros((len(t), len(self.robot.joints)))
        if self.loaded:
            self.robot.regressor(q, v, a, Y[:, :rigid])
        load = np.einsum("ncj,c->nj", Y[:, :rigid], self.reference[:rigid]) if self.loaded else none
        written: list[tuple[int, int, Array]] = []
        column = rigid
        for number, effect in enumerate(self.effects):
            if number in remembered:
                rows = remembered[number]
            else:
                torque = self._torque_of(Y, written, column) if effect.loaded else none
                state = State(self.robot, t, q, v, a, load, torque, start, extra, self.reference[:rigid])
                rows = [dict(term.rows) for term in effect.terms(state)]
            written += [(column + k, joint, values) for k, row in enumerate(rows) for joint, values in row.items()]
            column += len(rows)
        # Chunk by chunk, so that a sample's columns are all written while they are in the processor's cache.
        for first in range(0, len(t), 2 * CHUNK):
            s = slice(first, first + 2 * CHUNK)
            if not self.loaded:
                self.robot.regressor(q[s], v[s], a[s], Y[s, :rigid])
            Y[s, rigid:] = 0.0
            for k, joint, values in written:
                Y[s, k, joint] = values[s]
        return Y

    def _torque_of(self, Y: Array, written: Sequence[tuple[int, int, Array]], columns: int) -> Array:
        """Torque of the reference parameters over the rigid columns and the effects' columns before `columns`."""
        rigid = len(self.robot.columns)
        torque = np.einsum("ncj,c->nj", Y[:, :rigid], self.reference[:rigid])
        for k, joint, values in written:
            if k < columns:
                torque[:, joint] += self.reference[k] * values
        return np.asarray(torque)

    def remember(self, motion: Motion) -> dict[int, list[dict[int, Array]]]:
        """Columns of effects with memory over a whole motion: effect's place -> for each column, joint -> values."""
        if not any(effect.memory for effect in self.effects):
            return {}
        state = self.state(motion)
        return {
            number: [dict(term.rows) for term in effect.terms(state)]
            for number, effect in enumerate(self.effects)
            if effect.memory
        }

    def state(self, motion: Motion) -> State:
        """A whole motion as effects see it, with the torque of the reference parameters (static columns only)."""
        static = Regressor(self.robot, [e for e in self.effects if not e.memory])
        values = dict(zip((c.name for c in self.columns), self.reference, strict=True))
        static.reference = np.array([values[c.name] for c in static.columns])
        rigid = len(self.robot.columns)
        load, torque = np.empty((2, *motion.q.shape))
        for start in range(0, len(motion.t), CHUNK):
            s = slice(start, start + CHUNK)
            Y = static._evaluate(
                motion.t[s], motion.q[s], motion.v[s], motion.a[s], motion.start, _part(motion.extra, s), {}
            )
            load[s] = np.einsum("ncj,c->nj", Y[:, :rigid], static.reference[:rigid])
            torque[s] = np.einsum("ncj,c->nj", Y, static.reference)
        motion_of = (motion.t, motion.q, motion.v, motion.a)
        reference = static.reference[:rigid]
        return State(self.robot, *motion_of, load, torque, motion.start, motion.extra, reference, self.dry)

    @property
    def dry(self) -> Array:
        """Level of the reference's dry friction on each joint, N·m (N), (J,)."""
        level = np.zeros(len(self.robot.joints))
        for column, value in zip(self.columns, self.reference, strict=True):
            if column.effect == Coulomb.id:
                level[self.robot.joints.index(column.joint)] = max(float(value), 0.0)
        return level

    def torque(self, motion: Motion, theta: Array) -> Array:
        """Unfiltered torque of all columns (and of what is known) over a motion, shape (N, J), for parameters (C,)."""
        out, remembered = np.empty(motion.q.shape), self.remember(motion)
        for start in range(0, len(motion.t), CHUNK):
            part = slice(start, min(start + CHUNK, len(motion.t)))
            Z = np.empty((part.stop - start, len(self.columns) + EXTRA, motion.q.shape[1]))
            self._fill(motion, part, remembered, Z)
            out[part] = np.einsum("ncj,c->nj", Z[:, :-EXTRA], theta) + Z[:, len(self.columns) + 2]
        return out

    def blocks(self, motion: Motion, lowpass: LowPass, chunk: int = CHUNK) -> Iterator[Block]:
        """Filtered, decimated pieces of a motion, in order; together they are the same for any `chunk`."""
        taps, every = lowpass.taps(motion.step), lowpass.decimation(motion.step)
        reach = len(taps) - 1
        stride = max(1, chunk // every) * every
        width, J = len(self.columns) + EXTRA, len(self.robot.joints)
        # One room for all pieces where a filter makes something new of them; its end is moved to its beginning.
        filtered = bool(reach) or every > 1
        room = np.empty((min(stride + reach, len(motion.t)) if filtered else 0, width, J))
        tail, resting = room[:0], np.empty((0, J))
        remembered = self.remember(motion)
        position = 0
        while position < len(motion.t):
            part = slice(position, min(position + stride + reach - len(tail), len(motion.t)))
            position = part.stop
            size = len(tail) + part.stop - part.start
            buffer = room[:size] if filtered else np.empty((size, width, J))
            buffer[: len(tail)] = tail
            self._fill(motion, part, remembered, buffer[len(tail) :])
            rest = np.concatenate([resting, motion.standstill[part]])
            kept, still = buffer, rest
            if filtered:
                F = decimating_filter(taps, len(buffer), every)
                kept, still = (F @ buffer.reshape(len(buffer), -1)).reshape(-1, width, J), abs(F) @ rest
            if len(kept) == 0:
                return
            done = len(kept) * every
            times = motion.t[position - len(buffer) + reach // 2 :][:done:every]
            yield Block(times, kept, self.counted(still), motion.source)
            tail, resting = buffer[done:], rest[done:]

    def counted(self, still: Array) -> NDArray[np.bool_]:
        """Which filtered torques count, from the share of their weight that comes from standstill, both (N, J)."""
        return np.asarray((still < RESTING) | ~self.resting)

    def _fill(self, motion: Motion, part: slice, remembered: Mapping[int, list[dict[int, Array]]], out: Array) -> None:
        """Write the columns of a `Block.Z`, unfiltered."""
        C = len(self.columns)
        t, q, v, a = motion.t[part], motion.q[part], motion.v[part], motion.a[part]
        here = {n: [{j: x[part] for j, x in row.items()} for row in rows] for n, rows in remembered.items()}
        self._evaluate(t, q, v, a, motion.start, _part(motion.extra, part), here, out[:, :C])
        known = self.robot.known_torque(q, v, a)
        out[:, C + 2] = 0.0 if known is None else known
        out[:, C] = motion.tau[part] - out[:, C + 2]
        out[:, C + 1] = 1.0
        out[:, C + 3], out[:, C + 4], out[:, C + 5] = q, v, a


def _part(extra: Mapping[str, Array], s: slice) -> dict[str, Array]:
    return {name: values[s] for name, values in extra.items()}


def nominal_parameters(robot: Robot, effects: Sequence[Effect]) -> Array:
    """The URDF's own value of every column of the regressor: inertials, damping and friction; zero elsewhere."""
    values = dict(zip(robot.all_names, robot.nominal, strict=True))
    rigid = [values[c.name] for c in robot.columns]
    return np.array(rigid + [x for effect in effects for x in effect.nominal(robot)])


def gram_of(regressor: Regressor, block: Block, joints: Sequence[str]) -> Gram:
    """Moments of one block over the torque rows of `joints`."""
    result = Gram.zeros(regressor.columns, joints)
    for row, name in enumerate(joints):
        j = regressor.robot.joints.index(name)
        Z = block.Z[:, :, j].T[regressor.gathered[j]]  # columns first: gathered whole, and the product likes it
        if not block.used[:, j].all():
            Z = Z[:, block.used[:, j]]
        sums, where = Z @ Z.T, regressor.gathered[j][:-1]
        result.moments[row, where[:, None], where] = sums[:-1, :-1]
        result.sums[row, where] = sums[-1, :-1]
        result.counts[row] = Z.shape[1]
    return result


def accumulate(
    regressor: Regressor,
    motions: Iterable[Motion],
    lowpass: LowPass,
    joints: Sequence[str],
    *,
    seconds: float | None = None,
    base: Sequence[int] | None = None,
) -> Blocks:
    """Moments of motions in blocks of consecutive time.

    Blocks serve cross-validation and standard errors that respect correlation: about `MAX_BLOCKS` of equal length,
    at least one second each where the logs are long enough for sixteen. No block spans two motions, unless there are
    more than twice `MAX_BLOCKS`, or than `BLOCK_BYTES` hold: neighbours are then added, so that memory does not grow
    with the logs.

    Parameters
    ----------
    regressor : Regressor
    motions : iterable of Motion
        Gone through once when `seconds` is given.
    lowpass : LowPass
    joints : sequence of str
        Joints whose torque rows are used.
    seconds : float, optional
        Length of all motions together; summed up by default.
    base : sequence of int, optional
        Columns to keep, all by default.

    Returns
    -------
    Blocks
    """
    if seconds is None:
        motions = list(motions)
        seconds = float(sum(m.t[-1] - m.t[0] for m in motions))
    kept = Blocks()
    each, level = 1, 0  # blocks added into one, and how many of them the last one has
    # Small products are slower on several threads, and sums then depend on their number.
    with _threads().limit(limits=1, user_api="blas"):
        for gram in _sums(regressor, motions, lowpass, joints, seconds):
            part = gram if base is None else gram.select(base)
            if 0 < level < each:
                kept.merge(part)
                level += 1
                continue
            full = len(kept) >= 2 * MAX_BLOCKS or (len(kept) >= FEWEST_KEPT and kept.nbytes > BLOCK_BYTES)
            if full and len(kept) % 2 == 0:
                kept.halve()
                each *= 2
            kept.append(part)
            level = 1
    return kept


def streaming_qr(
    regressor: Regressor, motions: Iterable[Motion], lowpass: LowPass, joints: Sequence[str], base: Sequence[int]
) -> StreamingQR:
    """Streaming QR of the same rows and columns; see `frischid.regression.streaming_qr`."""
    found = StreamingQR(len(joints), len(base))
    keep = np.append(np.asarray(base, dtype=int), len(regressor.columns))
    index = [regressor.robot.joints.index(name) for name in joints]
    with _threads().limit(limits=1, user_api="blas"):
        for block in (b for motion in motions for b in regressor.blocks(motion, lowpass)):
            for row, j in enumerate(index):
                found.add(row, block.Z[block.used[:, j]][:, keep, j])
    return found


@lru_cache(maxsize=1)
def _threads() -> ThreadpoolController:
    """Looking for the threaded libraries takes longer than many a sum."""
    return ThreadpoolController()


def _sums(
    regressor: Regressor, motions: Iterable[Motion], lowpass: LowPass, joints: Sequence[str], whole: float
) -> Iterator[Gram]:
    seconds = max(min(1.0, whole / LEAST_BLOCKS), whole / MAX_BLOCKS)
    for motion in motions:
        _check_torque_present(motion, regressor.robot, joints)
        every = lowpass.decimation(motion.step)
        samples = seconds / motion.step
        pieces = max(1, round(samples / max(CHUNK, 2 * len(lowpass.taps(motion.step)))))
        chunk = max(1, round(samples / pieces / every)) * every
        grams = (gram_of(regressor, block, joints) for block in regressor.blocks(motion, lowpass, chunk))
        for first in grams:
            # one by one: in long blocks there are many, and they need not all be there at once
            yield total(chain([first], islice(grams, pieces - 1)))


def _check_torque_present(motion: Motion, robot: Robot, joints: Sequence[str]) -> None:
    missing = [n for n in joints if np.isnan(motion.tau[:, robot.joints.index(n)]).any()]
    if missing:
        raise InputError(
            f"{motion.source}: no torque for {', '.join(missing)}; give tau_<joint> columns, a mapping with current "
            "gains, "
            "or leave these joints' torque rows out"
        )


def stack(blocks: Sequence[Block], robot: Robot, joints: Sequence[str]) -> tuple[Array, Array, NDArray[np.intp]]:
    """Rows of several blocks, sample by sample, the joints of a sample in order, resting joints left out.

    Returns
    -------
    Y : ndarray, shape (R, C)
    tau : ndarray, shape (R,)
    which : ndarray of int, shape (R,)
        Position in `joints` of each row's joint.
    """
    index: NDArray[np.intp] = np.array([robot.joints.index(n) for n in joints])
    used = np.concatenate([b.used[:, index].ravel() for b in blocks])
    rows = [b.Y[:, :, index].transpose(0, 2, 1).reshape(-1, b.Y.shape[1])[b.used[:, index].ravel()] for b in blocks]
    tau = np.concatenate([b.tau[:, index].ravel() for b in blocks])
    return np.concatenate(rows), tau[used], np.resize(np.arange(len(index)), len(used))[used]
