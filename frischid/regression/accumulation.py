"""Moments of motions, summed over blocks of time.

    G_b = Σ_{k in block b} z_k z_kᵀ,   G = Σ_b G_b,   z = [y; τ]

Moments add, so a log of any length needs one pass over its chunks. The sums of each block are kept separately, so that
blocks can be left out by subtraction. Cross-validation and standard errors that respect correlation (block jackknife)
then need no second pass.

Source of the block jackknife: Künsch 1989, Annals of Statistics 17(3).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import chain, islice

import numpy as np

from frischid.core.threads import one_thread
from frischid.errors import InputError
from frischid.logs.filters import LowPass
from frischid.logs.preprocessing import Motion
from frischid.regression.joint_rows import JointRows
from frischid.regression.moment_blocks import Blocks
from frischid.regression.moments import PackedGram
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
    motions : iterable of Motion
        Read one at a time if `seconds` is given, otherwise all at once.
    joints : sequence of str
        Joints whose torque rows are used.
    seconds : float, optional
        Length of all motions together, s; computed by default.
    base : sequence of int, optional
        Columns to keep, all by default.
    """
    if seconds is None:
        motions = list(motions)
        seconds = float(sum(m.t[-1] - m.t[0] for m in motions))
    kept = Blocks()
    each, level = 1, 0  # number of blocks added into one, and their number in the last one so far
    with one_thread():
        rows = JointRows.of(regressor, joints, base)
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
    with one_thread():
        for block in (b for motion in motions for b in regressor.blocks(motion, lowpass)):
            for row, j in enumerate(index):
                found.add(row, block.Z[block.used[:, j]][:, keep, j])
    return found


def _sums(
    regressor: Regressor, motions: Iterable[Motion], lowpass: LowPass, rows: JointRows, whole: float
) -> Iterator[PackedGram]:
    seconds = max(min(1.0, whole / BLOCKS_OF_A_SHORT_LOG), whole / MAX_BLOCKS)
    for motion in motions:
        _check_torque_present(motion, regressor.robot, rows.joints)
        every = lowpass.decimation(motion.step)
        samples = seconds / motion.step
        parts = max(1, round(samples / max(CHUNK_SAMPLES, 2 * len(lowpass.taps(motion.step)))))
        chunk = max(1, round(samples / parts / every)) * every
        chunks = rows.chunks(motion, lowpass, chunk)
        for first in chunks:
            # one by one: the next one overwrites it
            yield rows.gram(chain([first], islice(chunks, parts - 1)))


def _check_torque_present(motion: Motion, robot: Robot, joints: Sequence[str]) -> None:
    missing = [n for n in joints if np.isnan(motion.tau[:, robot.joints.index(n)]).any()]
    if missing:
        raise InputError(
            f"{motion.source}: no torque for {', '.join(missing)}; give tau_<joint> columns, a mapping with current "
            "gains, or leave these joints' torque rows out"
        )
