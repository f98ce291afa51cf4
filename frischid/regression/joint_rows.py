"""Rows of each joint with their active columns only, for moments.

    z_jk = [y_jk ; τ_jk ; 1],   G_j = Σ_k z_jk z_jkᵀ

A link's parameters act on the joints that move the link, and an effect's column acts on one or two joints. So a chunk
is an array (samples, joints, places): the columns of the links, the effects that act on this joint, the torque, a one.
The columns of a serial arm that act on a joint are neighbours, so a matrix product takes them without a copy.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from frischid.core.types import Array, Column
from frischid.logs.filters import LowPass
from frischid.logs.preprocessing import Motion
from frischid.regression.block import Samples
from frischid.regression.chunks import filtered_chunks, part_of
from frischid.regression.moments import Gram
from frischid.regression.regressor import Regressor


@dataclass(frozen=True, eq=False)
class JointRows:
    """Where each joint's columns stand in an array (samples, joints, places), and what becomes of them.

    Attributes
    ----------
    regressor : Regressor
    columns : tuple of Column
        The p kept columns.
    joints : tuple of str
        Joints whose rows are summed.
    index : tuple of int
        Place of each of them in the robot.
    effects : dict
        Place of an effect's column in a joint's row, for each (column, joint of the robot).
    torque : ndarray of int, shape (all joints,)
        Place of the torque in each joint's row; a one follows.
    places : tuple of ndarray of int
        For each joint, the places that are summed: active kept columns, torque, one.
    ends : tuple of ndarray of int
        For each joint, where these places, without the last, go among the p columns and the torque.
    """

    regressor: Regressor
    columns: tuple[Column, ...]
    joints: tuple[str, ...]
    index: tuple[int, ...]
    effects: dict[tuple[int, int], int]
    torque: NDArray[np.intp]
    places: tuple[NDArray[np.intp], ...]
    ends: tuple[NDArray[np.intp], ...]

    @classmethod
    def of(cls, regressor: Regressor, joints: Sequence[str], base: Sequence[int] | None = None) -> JointRows:
        """For the columns `base`, all by default."""
        rigid = len(regressor.robot.columns)
        kept = np.arange(len(regressor.columns)) if base is None else np.asarray(base, dtype=np.intp)
        effects: dict[tuple[int, int], int] = {}
        torque = np.full(len(regressor.robot.joints), rigid)
        for j, active in enumerate(regressor.active):
            for c in np.intersect1d(kept[kept >= rigid], active):
                effects[int(c), j] = int(torque[j])
                torque[j] += 1
        index = tuple(regressor.robot.joints.index(name) for name in joints)
        own = [np.flatnonzero(np.isin(kept, regressor.active[j])) for j in index]
        places = tuple(
            np.array([*(int(c) if c < rigid else effects[int(c), j] for c in kept[o]), torque[j], torque[j] + 1])
            for j, o in zip(index, own, strict=True)
        )
        ends = tuple(np.append(o, len(kept)) for o in own)
        columns = tuple(regressor.columns[i] for i in kept)
        return cls(regressor, columns, tuple(joints), index, effects, torque, places, ends)

    def chunks(self, motion: Motion, lowpass: LowPass, chunk: int) -> Iterator[tuple[Array, NDArray[np.bool_]]]:
        """Filtered chunks of a motion and whether each torque counts; the next chunk overwrites the one before."""
        regressor = self.regressor
        remembered = regressor.remember(motion)
        shape = (len(regressor.robot.joints), int(self.torque.max(initial=0)) + 2)

        def fill(part: slice, out: Array) -> None:
            samples, rigid = Samples.of(motion).part(part), len(regressor.robot.columns)
            regressor.robot.regressor(samples.q, samples.v, samples.a, out[:, :, :rigid].transpose(0, 2, 1))
            load = out[:, :, :rigid] @ regressor.reference[:rigid] if regressor.loaded else None
            for column, joint, values in regressor.effect_columns(samples, part_of(remembered, part), load):
                place = self.effects.get((column, joint))
                if place is not None:
                    out[:, joint, place] = values
            known = regressor.robot.known_torque(samples.q, samples.v, samples.a)
            tau = motion.tau[part] if known is None else motion.tau[part] - known
            every = np.arange(len(self.torque))
            out[:, every, self.torque] = tau
            out[:, every, self.torque + 1] = 1.0

        for _, Z, standstill in filtered_chunks(motion, lowpass, shape, fill, chunk, shared=True):
            yield Z, regressor.counted(standstill)

    def gram(self, chunks: Iterable[tuple[Array, NDArray[np.bool_]]]) -> Gram:
        """Moments of chunks together."""
        result = Gram.zeros(self.columns, self.joints)
        summed = [_summed(places) for places in self.places]
        products = [np.zeros((len(places), len(places))) for places in self.places]
        for Z, used in chunks:
            every = np.asarray(used.all(axis=0))
            for row, (sums, j, places) in enumerate(zip(products, self.index, summed, strict=True)):
                z = Z[:, j, places]
                if not every[j]:
                    z = z[used[:, j]]
                sums += z.T @ z
                result.counts[row] += len(z)
        for row, (sums, ends) in enumerate(zip(products, self.ends, strict=True)):
            result.moments[row][ends[:, None], ends] = sums[:-1, :-1]
            result.sums[row, ends] = sums[-1, :-1]
        return result


def _summed(places: NDArray[np.intp]) -> slice | NDArray[np.intp]:
    """The places, as a slice if they are neighbours: a product takes a slice without a copy."""
    first, last = int(places[0]), int(places[-1])
    return slice(first, last + 1) if last - first == len(places) - 1 else places
