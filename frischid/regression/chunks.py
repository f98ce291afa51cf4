"""Filtered and decimated chunks of a motion: one array of channels at a time, whatever the channels are.

The last samples of a chunk that the filter still needs are carried into the next chunk, so the length of the chunks has
no influence on the result.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

import numpy as np

from frischid.core.types import Array
from frischid.logs.filters import LowPass, decimating_filter
from frischid.logs.preprocessing import Motion


def filtered_chunks(
    motion: Motion,
    lowpass: LowPass,
    shape: tuple[int, ...],
    fill: Callable[[slice, Array], None],
    chunk: int,
    shared: bool = False,
) -> Iterator[tuple[Array, Array, Array]]:
    """Chunks of a motion's channels, in order.

    Parameters
    ----------
    lowpass : LowPass
        Filters the channels, and keeps every D-th sample.
    shape : tuple of int
        Shape (A, ...) of the channels at one sample.
    fill : callable
        ``fill(part, out)`` writes the unfiltered channels of n samples into ``out`` (n, A, ...). ``out`` holds
        old numbers, or zeros at first if it is shared.
    chunk : int
        Samples that are evaluated at once.
    shared : bool
        Whether a chunk may be overwritten when the next one is asked for. Where nothing is filtered, this saves memory
        and time.

    Yields
    ------
    t : ndarray, shape (M,)
    Z : ndarray, shape (M, A, ...)
    standstill : ndarray, shape (M, J)
        Share of each filtered sample's weight that comes from standstill.
    """
    taps, every = lowpass.taps(motion.step), lowpass.decimation(motion.step)
    reach = len(taps) - 1
    stride = max(1, chunk // every) * every
    # With a filter, all chunks share one buffer; the samples that the filter still needs move to its beginning.
    filtered = bool(reach) or every > 1
    shared = filtered or shared
    room = np.zeros((min(stride + reach, len(motion.t)) if shared else 0, *shape))
    tail, standing = room[:0], np.empty((0, motion.standstill.shape[1]))
    position = 0
    while position < len(motion.t):
        part = slice(position, min(position + stride + reach - len(tail), len(motion.t)))
        position = part.stop
        size = len(tail) + part.stop - part.start
        buffer = room[:size] if shared else np.empty((size, *shape))
        buffer[: len(tail)] = tail
        fill(part, buffer[len(tail) :])
        at_standstill = np.concatenate([standing, motion.standstill[part]])
        Z, weight = buffer, at_standstill
        if filtered:
            F = decimating_filter(taps, len(buffer), every)
            Z, weight = (F @ buffer.reshape(len(buffer), -1)).reshape(-1, *shape), abs(F) @ at_standstill
        if len(Z) == 0:
            return
        done = len(Z) * every
        yield motion.t[position - len(buffer) + reach // 2 :][:done:every], Z, weight
        tail, standing = buffer[done:], at_standstill[done:]


def part_of(remembered: Mapping[int, list[dict[int, Array]]], part: slice) -> dict[int, list[dict[int, Array]]]:
    """Columns of effects with memory at a slice of a motion's samples."""
    return {n: [{joint: x[part] for joint, x in row.items()} for row in rows] for n, rows in remembered.items()}
