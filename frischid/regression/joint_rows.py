"""Rows of each joint with their active columns only, for moments.

    z_jk = [y_jk ; τ_jk ; 1],   G_j = Σ_k z_jk z_jkᵀ

A link's parameters act on the joints that move the link, and an effect's column acts on one or two joints. So a sample
is one row of numbers, joint after joint: the kept columns that act on the joint, its torque, a one. Pinocchio writes
all columns of some samples into a small array that stays in the processor's cache, and one gather takes the rows out.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from frischid.core.types import Array, Column
from frischid.logs.filters import LowPass
from frischid.logs.preprocessing import Motion
from frischid.regression.block import Samples
from frischid.regression.chunks import filtered_chunks, part_of
from frischid.regression.moments import PackedGram
from frischid.regression.regressor import EFFECT_SAMPLES, Regressor

CACHE_BYTES = 2**19
"""Bytes of the array that holds all columns of some samples: half a megabyte stays in the cache of a core."""

Chunk = tuple[Array, Array, NDArray[np.bool_]]


@dataclass(frozen=True, eq=False)
class JointRows:
    """Where each joint's numbers come from, and where they stand in the row of a sample."""

    regressor: Regressor
    columns: tuple[Column, ...]
    """The p kept columns."""
    joints: tuple[str, ...]
    """Joints whose rows are summed."""
    index: tuple[int, ...]
    """Place of each of them in the robot."""
    effects: Mapping[tuple[int, int], int]
    """Place of an effect's column among the K kept ones, for each (column, joint of the robot)."""
    taken: NDArray[np.intp]
    """For each number of a row, its place in [links' columns (J × R), effects (K), torques (J), 1], (W,)."""
    parts: tuple[slice, ...]
    """For each joint, its numbers in a row."""
    ends: tuple[NDArray[np.intp], ...]
    """For each joint, where these numbers, without the one, go among the p columns and the torque."""

    @classmethod
    def of(cls, regressor: Regressor, joints: Sequence[str], base: Sequence[int] | None = None) -> JointRows:
        """For the columns `base`, all by default."""
        robot, active = regressor.robot, regressor.active
        J, rigid = len(robot.joints), len(robot.columns)
        kept = np.arange(len(regressor.columns)) if base is None else np.asarray(base, dtype=np.intp)
        index = tuple(robot.joints.index(name) for name in joints)
        own = [np.flatnonzero(np.isin(kept, active[j])) for j in index]
        pairs = [(int(c), j) for j, o in zip(index, own, strict=True) for c in kept[o] if c >= rigid]
        effects = {pair: place for place, pair in enumerate(pairs)}
        torque, taken, ends = J * rigid + len(pairs), list[int](), [0]
        for j, o in zip(index, own, strict=True):
            taken += [j * rigid + int(c) if c < rigid else J * rigid + effects[int(c), j] for c in kept[o]]
            taken += [torque + j, torque + J]
            ends.append(len(taken))
        return cls(
            regressor,
            tuple(regressor.columns[i] for i in kept),
            tuple(joints),
            index,
            effects,
            np.array(taken, dtype=np.intp),
            tuple(slice(a, b) for a, b in pairwise(ends)),
            tuple(np.append(o, len(kept)) for o in own),
        )

    def chunks(self, motion: Motion, lowpass: LowPass, chunk: int) -> Iterator[Chunk]:
        """Filtered chunks of a motion: times (M,), rows (M, W) and whether each torque counts, (M, J).

        The next chunk overwrites the rows of the one before.
        """
        regressor, samples = self.regressor, Samples.of(motion)
        J, rigid = len(regressor.robot.joints), len(regressor.robot.columns)
        beside = self._beside_the_links(motion)
        width = J * rigid + len(self.effects) + J + 1
        every = np.empty((max(1, min(chunk, CACHE_BYTES // (8 * width))), width))

        def fill(part: slice, out: Array) -> None:
            for first in range(part.start, part.stop, len(every)):
                some = slice(first, min(first + len(every), part.stop))
                row, now = every[: some.stop - first], samples.part(some)
                links = row[:, : J * rigid].reshape(-1, J, rigid)
                regressor.robot.regressor(now.q, now.v, now.a, links.transpose(0, 2, 1))
                row[:, J * rigid :] = beside(some)
                there = out[first - part.start : some.stop - part.start]
                np.take(row, self.taken, axis=1, out=there, mode="clip")  # without a check of each place

        for t, Z, standstill in filtered_chunks(motion, lowpass, self.taken.shape, fill, chunk, shared=True):
            yield t, Z, regressor.counted(standstill)

    def _beside_the_links(self, motion: Motion) -> Callable[[slice], Array]:
        """Effects, torques and a one of some samples, (n, K + J + 1); computed for many samples at once."""
        regressor, K, J = self.regressor, len(self.effects), len(self.regressor.robot.joints)
        samples, remembered = Samples.of(motion), regressor.remember(motion)
        known, values = slice(0, 0), np.empty((0, K + J + 1))

        def beside(part: slice) -> Array:
            nonlocal known, values
            if part.stop > known.stop:
                known = slice(part.start, min(max(part.stop, part.start + EFFECT_SAMPLES), len(motion.t)))
                now, size = samples.part(known), known.stop - known.start
                values = values if len(values) >= size else np.ones((size, K + J + 1))
                load = regressor.load(now) if regressor.loaded else None
                for column, joint, x in regressor.effect_columns(now, part_of(remembered, known), load):
                    place = self.effects.get((column, joint))
                    if place is not None:
                        values[:size, place] = x
                torque = regressor.robot.known_torque(now.q, now.v, now.a)
                values[:size, K : K + J] = motion.tau[known] if torque is None else motion.tau[known] - torque
            return values[part.start - known.start : part.stop - known.start]

        return beside

    def gram(self, chunks: Iterable[Chunk]) -> PackedGram:
        """Moments of at least one chunk together."""
        squares: list[Array] = []
        counts, sums = np.zeros(len(self.joints)), np.zeros((len(self.joints), len(self.columns) + 1))
        for _, Z, used in chunks:
            rows = self.of_joints(Z, used)
            products = [z.T @ z for z in rows]
            squares = [a + b for a, b in zip(squares, products, strict=True)] if squares else products
            counts += [len(z) for z in rows]
        for row, (square, ends) in enumerate(zip(squares, self.ends, strict=True)):
            sums[row, ends] = square[-1, :-1]
        return PackedGram(self.columns, self.joints, self.ends, tuple(x[:-1, :-1] for x in squares), sums, counts)

    def of_joints(self, Z: Array, used: NDArray[np.bool_]) -> list[Array]:
        """The rows of each joint that count, (n, numbers of the joint); views of the chunk where all of them count."""
        every = np.asarray(used.all(axis=0))
        parts = zip(self.index, self.parts, strict=True)
        return [Z[:, part] if every[j] else Z[used[:, j], part] for j, part in parts]
