"""Streaming QR: the triangular factor of the stacked regression, which keeps the digits that moments lose.

    R_k = qr([R_{k−1}; Z_k]),   Z = [Y τ],   RᵀR = ZᵀZ

R and the moments ZᵀZ both have the size of the parameters, however many rows Z has. But the rounding error of a
solution from the moments grows with cond(Y)², and that of a solution from R only with cond(Y): at a condition number of
1e5, six correct digits instead of eleven. Moments are three to four times cheaper, and they can be added *and*
subtracted. So moments do all of the work, and R replaces their solution where the condition number is too large for
them.

Sources: Golub and Van Loan 2013, §5.3; Björck 1996, §2.3.
"""

from __future__ import annotations

import numpy as np
from scipy import linalg

from frischid.core.types import Array

SAFE_CONDITION = 1e4
"""Condition number of the column-scaled regressor, up to which moments give eight correct digits."""


class StreamingQR:
    """Triangular factors of [Y τ], one per joint.

    Parameters
    ----------
    joints : int
        J.
    columns : int
        C, of Y.
    """

    def __init__(self, joints: int, columns: int) -> None:
        self.columns = columns
        self.factors: list[Array] = [np.empty((0, columns + 1)) for _ in range(joints)]
        self._waiting: list[list[Array]] = [[] for _ in range(joints)]

    def add(self, joint: int, rows: Array) -> None:
        """Add rows of [Y τ], shape (n, C + 1), of a joint."""
        waiting = self._waiting[joint]
        waiting.append(rows)
        if sum(len(x) for x in waiting) >= 4 * (self.columns + 1):
            self._reduce(joint)

    def _reduce(self, joint: int) -> None:
        stacked = np.concatenate([self.factors[joint], *self._waiting[joint]])
        self._waiting[joint] = []
        # Columns that are zero for this joint stay zero and are left out.
        active = np.flatnonzero(stacked.any(axis=0))
        factor = np.linalg.qr(stacked[:, active], mode="r")
        self.factors[joint] = np.zeros((len(factor), self.columns + 1))
        self.factors[joint][:, active] = factor

    def solve(self, weights: Array) -> Array:
        """Least-squares parameters, with a weight for each joint's squared residuals.

        Parameters
        ----------
        weights : ndarray, shape (J,)

        Returns
        -------
        ndarray, shape (C,)
        """
        for joint in range(len(self.factors)):
            self._reduce(joint)
        stacked = np.concatenate([np.sqrt(w) * R for w, R in zip(weights, self.factors, strict=True)])
        return solve(stacked)


def solve(rows: Array) -> Array:
    """Least-squares solution from rows of [Y τ], shape (n, C + 1), by one QR of columns scaled to unit norm."""
    scale = np.linalg.norm(rows[:, :-1], axis=0)
    R = np.asarray(np.linalg.qr(np.column_stack([rows[:, :-1] / scale, rows[:, -1]]), mode="r"))
    C = len(scale)
    return np.asarray(linalg.solve_triangular(R[:C, :C], R[:C, C]) / scale)
