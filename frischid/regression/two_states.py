"""When do some columns act? For each moment one of two states, s(t) = 0 or 1, beside parameters that always act.

    y = X θ + s(t) · C φ

Of all stretches of time between the ends of short blocks, `best_stretch` finds the one whose φ explains most: the
moments of C over a stretch are a difference of two sums, and θ is eliminated, so

    fall of the squared error  =  rᵀ S⁻¹ r,     S = CᵀC − CᵀX (XᵀX)⁻¹ XᵀC,     r = Cᵀ(y − X θ̂),

with the sums CᵀC, CᵀX and r over the stretch. With θ and φ known, `likeliest_states` finds the best sequence of states,
which may change often, at a price for each change.

Sources: Bai and Perron 1998, "Estimating and testing linear models with multiple structural changes", Econometrica
66(1); Forney 1973, "The Viterbi algorithm", Proc. IEEE 61(3).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from frischid.core.types import Array

_RIDGE_SHARE = 1e-4  # of a column's squared norm: a part that the other columns span says nothing


def best_stretch(cross: Array, left: Array, own: Array) -> tuple[float, int, int]:
    """The stretch of blocks whose columns explain most.

    Parameters
    ----------
    cross : ndarray, shape (B, p, k)
        Of each block, the moments of the k columns with the p others, times the inverse of the transposed Cholesky
        factor of the others' moments over all blocks.
    left : ndarray, shape (B, k)
        Moments with the residual of the other columns.
    own : ndarray, shape (B, k, k)
        Moments of the k columns.

    Returns
    -------
    (gain, first, last) : (float, int, int)
        Fall of the squared error; the stretch is ``blocks[first:last]``.

    Examples
    --------
    Columns of one, and a step up in the third and fourth of five blocks of one row each:

    >>> import numpy as np
    >>> from frischid.regression.two_states import best_stretch
    >>> y = np.array([0.0, 0.0, 1.0, 1.0, 0.0])
    >>> cross = np.full((5, 1, 1), 1 / np.sqrt(5))
    >>> gain, first, last = best_stretch(cross, (y - y.mean())[:, None], np.ones((5, 1, 1)))
    >>> round(gain, 3), first, last
    (1.2, 2, 4)
    """
    ends = [np.concatenate([np.zeros((1, *x.shape[1:])), np.cumsum(x, axis=0)]) for x in (cross, left, own)]
    best = (0.0, 0, 0)
    for first in range(len(left)):
        A, r, D = (x[first + 1 :] - x[first] for x in ends)
        size = np.sqrt(np.einsum("nkk->nk", D))
        scale = np.where(size > 0, size, 1.0)  # zero where no row has a value
        S = (D - A.transpose(0, 2, 1) @ A) / (scale[:, :, None] * scale[:, None])
        right = r / scale
        S += _RIDGE_SHARE * np.eye(S.shape[1])
        gains = (right * np.linalg.solve(S, right[..., None])[..., 0]).sum(axis=1)
        last = int(np.argmax(gains))
        best = max(best, (float(gains[last]), first, first + 1 + last))
    return best


def likeliest_states(gain: Array, price: float) -> NDArray[np.bool_]:
    """The states, (n,), with the largest sum of gains while they are True, less a price for each change.

    Parameters
    ----------
    gain : ndarray, shape (n,)
        Fall of the squared error of each moment where the columns act there, in units of the noise.

    Examples
    --------
    >>> import numpy as np
    >>> from frischid.regression.two_states import likeliest_states
    >>> likeliest_states(np.array([-3.0, 3.0, -1.0, 4.0, -9.0, 1.0]), price=2.0).astype(int)
    array([0, 1, 1, 1, 0, 0])
    """
    best, stays = np.zeros(2), np.empty((len(gain), 2), bool)
    for k, g in enumerate(gain.tolist()):
        other = best[::-1] - price
        stays[k] = best >= other
        best = np.maximum(best, other) + np.array([0.0, g])
    states = np.empty(len(gain), bool)
    state = int(np.argmax(best))
    for k in range(len(gain) - 1, -1, -1):
        states[k] = bool(state)
        state = state if stays[k, state] else 1 - state
    return states
