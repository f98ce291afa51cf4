"""Moments of motions, summed over blocks of time.

    G_b = Σ_{k in block b} z_k z_kᵀ,   G = Σ_b G_b,   z = [y; τ]

Moments add, so a log of any length needs one pass over its chunks. The sums of each block are kept separately, so that
blocks can be left out by subtraction. Cross-validation and standard errors that respect correlation (block jackknife)
then need no second pass.

Source of the block jackknife: Künsch 1989, Annals of Statistics 17(3).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import chain, islice

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import ThreadpoolController

from frischid.core.types import Column
from frischid.errors import InputError
from frischid.logs.filters import LowPass
from frischid.logs.preprocessing import Motion
from frischid.regression.block import Block
from frischid.regression.moments import Blocks, Gram
from frischid.regression.regressor import CHUNK_SAMPLES, Regressor
from frischid.regression.streaming_qr import StreamingQR
from frischid.robot.robot import Robot

BLOCKS_OF_A_SHORT_LOG = 16
"""Least number of blocks. A log shorter than this many seconds has this many; blocks of longer logs last over 1 s."""
MAX_BLOCKS = 64
"""Blocks of a long log. More blocks hardly improve standard errors, and take memory."""
BLOCK_BYTES = 128 * 2**20
"""Bytes of all blocks together. With hundreds of parameters on dozens of joints, fewer blocks are kept."""
BLOCKS_KEPT = 24
"""Blocks that are kept however large they are, so that half of them still give standard errors."""


def gram_of(regressor: Regressor, block: Block, joints: Sequence[str]) -> Gram:
    """Moments of one block over the torque rows of `joints`: Σ_k z_k z_kᵀ and Σ_k z_k of each joint."""
    return _Rows.of(regressor, joints).gram([block])


@dataclass(frozen=True, eq=False)
class _Rows:
    """What of a block's columns enters each joint's moments: the kept columns that act on it, its torque, ones.

    Attributes
    ----------
    columns : tuple of Column
        The p kept columns.
    joints : tuple of str
    index : tuple of int
        Each joint's place in the robot.
    gathered : tuple of ndarray of int
        For each joint, rows of ``Z[k, :, j]``.
    ends : tuple of ndarray of int
        For each joint, where these rows, without the last, go among the p columns and the torque.
    places : tuple of ndarray of int
        For each joint, where the products of these rows go among the (p + 1)² moments.
    """

    columns: tuple[Column, ...]
    joints: tuple[str, ...]
    index: tuple[int, ...]
    gathered: tuple[NDArray[np.intp], ...]
    ends: tuple[NDArray[np.intp], ...]
    places: tuple[NDArray[np.intp], ...]

    @classmethod
    def of(cls, regressor: Regressor, joints: Sequence[str], base: Sequence[int] | None = None) -> _Rows:
        """For the columns `base`, all by default."""
        C = len(regressor.columns)
        kept = np.arange(C) if base is None else np.asarray(base, dtype=np.intp)
        index = tuple(regressor.robot.joints.index(name) for name in joints)
        own = [np.flatnonzero(np.isin(kept, regressor.active[j])) for j in index]
        gathered = tuple(np.append(kept[where], [C, C + 1]) for where in own)
        size = len(kept) + 1
        ends = tuple(np.append(where, len(kept)) for where in own)
        places = tuple((end[:, None] * size + end).ravel() for end in ends)
        return cls(tuple(regressor.columns[i] for i in kept), tuple(joints), index, gathered, ends, places)

    def gram(self, blocks: Iterable[Block]) -> Gram:
        """Moments of blocks together."""
        result = Gram.zeros(self.columns, self.joints)
        products = [np.zeros((len(gathered), len(gathered))) for gathered in self.gathered]
        for block in blocks:
            every = np.asarray(block.used.all(axis=0))
            for row, (sums, j, gathered) in enumerate(zip(products, self.index, self.gathered, strict=True)):
                Z = block.Z[:, :, j].T[gathered]  # columns first: gathered as a whole, and a faster product
                if not every[j]:
                    Z = Z[:, block.used[:, j]]
                sums += Z @ Z.T
                result.counts[row] += Z.shape[1]
        flat = result.moments.reshape(len(self.joints), -1)
        for row, (sums, ends, places) in enumerate(zip(products, self.ends, self.places, strict=True)):
            flat[row, places] = sums[:-1, :-1].ravel()
            result.sums[row, ends] = sums[-1, :-1]
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
    """Moments of motions in blocks of time.

    Blocks serve cross-validation and standard errors that respect correlation. There are about `MAX_BLOCKS` of equal
    length, each at least one second long where the logs are long enough for sixteen blocks. No block spans two motions,
    with one exception: if the blocks become more than twice `MAX_BLOCKS`, or larger than `BLOCK_BYTES`, neighbouring
    ones are added, so that memory does not grow with the logs.

    Parameters
    ----------
    regressor : Regressor
    motions : iterable of Motion
        Read one at a time if `seconds` is given, otherwise all at once.
    lowpass : LowPass
    joints : sequence of str
        Joints whose torque rows are used.
    seconds : float, optional
        Length of all motions together, s; computed by default.
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
    each, level = 1, 0  # number of blocks added into one, and their number in the last one so far
    # Small products are slower on several threads, and the rounding of sums would depend on the number of threads.
    with _threads().limit(limits=1, user_api="blas"):
        rows = _Rows.of(regressor, joints, base)
        for part in _sums(regressor, motions, lowpass, rows, seconds):
            if 0 < level < each:
                kept.merge(part)
                level += 1
                continue
            full = len(kept) >= 2 * MAX_BLOCKS or (len(kept) >= BLOCKS_KEPT and kept.nbytes > BLOCK_BYTES)
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
    """The threaded libraries, searched once: the search takes longer than a short sum."""
    return ThreadpoolController()


def _sums(
    regressor: Regressor, motions: Iterable[Motion], lowpass: LowPass, rows: _Rows, whole: float
) -> Iterator[Gram]:
    seconds = max(min(1.0, whole / BLOCKS_OF_A_SHORT_LOG), whole / MAX_BLOCKS)
    for motion in motions:
        _check_torque_present(motion, regressor.robot, rows.joints)
        every = lowpass.decimation(motion.step)
        samples = seconds / motion.step
        parts = max(1, round(samples / max(CHUNK_SAMPLES, 2 * len(lowpass.taps(motion.step)))))
        chunk = max(1, round(samples / parts / every)) * every
        blocks = regressor.blocks(motion, lowpass, chunk, kept=False)
        for first in blocks:
            # one by one: the next one overwrites it
            yield rows.gram(chain([first], islice(blocks, parts - 1)))


def _check_torque_present(motion: Motion, robot: Robot, joints: Sequence[str]) -> None:
    missing = [n for n in joints if np.isnan(motion.tau[:, robot.joints.index(n)]).any()]
    if missing:
        raise InputError(
            f"{motion.source}: no torque for {', '.join(missing)}; give tau_<joint> columns, a mapping with current "
            "gains, "
            "or leave these joints' torque rows out"
        )
