"""By how much an effect raises the squared errors of joints, in sums that are nearly independent of one another.

With the squared errors e_ij and e_ij' of sample i of joint j, without and with the effect, and E_j the sum of e_ij
over all samples, the sums are

    d_b = Σ_j Σ_{i in b} (e_ij' − e_ij) / E_j,      b: a block of time.

The error of a joint that rests in a pose is the same until it moves. So a rest is one observation, however long: its
seconds are no repetitions (S. Hurlbert, "Pseudoreplication", Ecological Monographs 54(2), 1984). All of a rest counts
in the block in which it begins. Nor are the joints repetitions, because they share poses, motions and causes: d_b is a
sum over all joints.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from frischid.core.types import Array
from frischid.regression.block import Block


class Rises:
    """Rises of the squared errors of J joints in blocks of time; a rest of a joint counts where it begins.

    Parameters
    ----------
    seconds : float
        Length of the blocks.
    """

    def __init__(self, joints: int, seconds: float) -> None:
        self._sums: dict[tuple[str, float], Array] = {}
        self._rests: list[tuple[str, float] | None] = [None] * joints
        self._seconds = seconds

    def add(self, part: Block, moves: NDArray[np.bool_], rise: Array) -> None:
        """Count the rises of a part, (M, J), in motion where `moves`; a rest may continue from the part before."""
        block = np.floor(part.t / self._seconds)
        for j, before in enumerate(self._rests):
            place = _places(block, moves[:, j])
            if before is not None and before[0] == part.source and not moves[0, j]:
                place[: _length_of_rest(moves[:, j])] = before[1]
            for where in np.unique(place).tolist():
                sums = self._sums.setdefault((part.source, where), np.zeros(len(self._rests)))
                sums[j] += rise[place == where, j].sum()
            self._rests[j] = None if moves[-1, j] else (part.source, float(place[-1]))

    def of_all(self, spread: Array) -> Array:
        """A sum over the joints for each block, each joint's rise over its squared error (J,)."""
        return np.array([float((sums / spread).sum()) for sums in self._sums.values()])


def _places(block: Array, moves: NDArray[np.bool_]) -> Array:
    """Block of each sample of a joint; of a sample at rest that of the rest's first sample."""
    begins = np.maximum.accumulate(np.where(moves | np.append(True, moves[:-1]), np.arange(len(moves)), 0))
    return np.asarray(block[begins])


def _length_of_rest(moves: NDArray[np.bool_]) -> int:
    """Samples before the first one in motion."""
    return int(moves.argmax()) if moves.any() else len(moves)
