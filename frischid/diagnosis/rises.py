"""By how much an effect raises the squared errors of joints, in sums that are independent of one another.

With the squared errors e_i and e_i' of sample i of joint j, without and with the effect, the sums are

    d_k = Σ_{i in k} (e_i' − e_i),      k: a block of time in motion, or a rest of the joint from stop to start.

The error of a joint that rests in a pose is the same until it moves. So a rest is one observation, however long: its
seconds are no repetitions (S. Hurlbert, "Pseudoreplication", Ecological Monographs 54(2), 1984).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from frischid.core.types import Array
from frischid.regression.block import Block


class Rises:
    """Rises of the squared errors of J joints: a sum for each block of time in motion, and one for each rest.

    Parameters
    ----------
    seconds : float
        Length of the blocks.
    """

    def __init__(self, joints: int, seconds: float) -> None:
        self._sums: list[list[float]] = [[] for _ in range(joints)]
        self._last: list[tuple[str, float | None] | None] = [None] * joints
        self._seconds = seconds

    def add(self, part: Block, moves: NDArray[np.bool_], rise: Array) -> None:
        """Count the rises of a part, (M, J), in motion where `moves`; a rest or a block may go on from before."""
        block = np.floor(part.t / self._seconds)
        for j, sums in enumerate(self._sums):
            place = np.where(moves[:, j], block, np.nan)  # at rest, none
            begins = np.flatnonzero(~((place[1:] == place[:-1]) | (np.isnan(place[1:]) & np.isnan(place[:-1])))) + 1
            starts = np.append(0, begins)
            found = np.add.reduceat(rise[:, j], starts).tolist()
            first, last = ((part.source, None if np.isnan(x) else float(x)) for x in place[[0, -1]])
            if first == self._last[j]:
                sums[-1] += found.pop(0)
            sums += found
            self._last[j] = last

    def of_all(self, spread: Array) -> Array:
        """All sums, each over the squared error (J,) of its joint."""
        return np.concatenate([np.array(sums) / x for sums, x in zip(self._sums, spread, strict=True)])
