"""A sample of the blocks of logs of any length: stretches spread evenly over all logs, in bounded memory."""

from __future__ import annotations

from dataclasses import replace

from frischid.core.types import Array
from frischid.regression.block import COLUMNS_BESIDE_Y, Block

CONSECUTIVE_SAMPLES = 1000  # filtered samples kept or left out together, so that residuals stay consecutive
SAMPLES_KEPT = 60_000  # filtered samples in memory: an hour of motion at usual cut-offs, 20 MB for a six-joint arm


class SampledBlocks:
    """Blocks in memory, in stretches spread evenly over the logs: all of them, or every second, fourth, ... stretch.

    Where a model fails is judged on at most `SAMPLES_KEPT` samples; the errors themselves are sums over all.

    Parameters
    ----------
    limit : int
        Samples in memory at most, but never less than one stretch.
    """

    def __init__(self, limit: int = SAMPLES_KEPT) -> None:
        self.limit = limit
        self.stretches: list[list[tuple[Block, Array]]] = []
        self.every, self.number, self.samples, self.length = 1, -1, 0, CONSECUTIVE_SAMPLES

    @property
    def blocks(self) -> list[tuple[Block, Array]]:
        """The blocks in memory, in order."""
        return [pair for stretch in self.stretches for pair in stretch]

    def add(self, block: Block, fitted: Array) -> None:
        """Keep the next block, or leave it out."""
        if self.length >= CONSECUTIVE_SAMPLES:
            self.number, self.length = self.number + 1, 0
            if self.number % self.every == 0:
                self.stretches.append([])
        self.length += len(block.t)
        if self.number % self.every:
            return
        # Only the parts that residuals need, as copies: columns are most of a block, and views keep whole motions.
        self.stretches[-1].append((replace(block, t=block.t.copy(), Z=block.Z[:, -COLUMNS_BESIDE_Y:].copy()), fitted))
        self.samples += len(block.t)
        if self.samples > self.limit:
            self.stretches, self.every = self.stretches[::2], 2 * self.every
            self.samples = sum(len(b.t) for b, _ in self.blocks)
