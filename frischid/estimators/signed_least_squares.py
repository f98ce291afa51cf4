"""Least squares with a triangle, over variables that are free or not negative.

    minimise ½ ‖R x − t‖²   over   x_k ≥ 0 where bounded

The iteration is that of `scipy.optimize.lsq_linear(method="bvls")`, with the same tolerance: first, variables that come
out negative go to their bound, until none is; then the variable that gains most by leaving its bound leaves it. But
SciPy solves each step by singular values. R has full rank, so a QR decomposition serves, in a tenth of the time.

Source: Stark and Parker 1995, Bounded-variable least squares, Computational Statistics 10.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from frischid.core.types import Array

FLAT = 1e-10
"""Gradient, and relative fall of the squares in a step, at which the iteration ends."""


def nearest(R: Array, target: Array, bounded: NDArray[np.bool_]) -> Array:
    """Minimise ‖R x − t‖ over x with x ≥ 0 where `bounded`.

    Parameters
    ----------
    R : ndarray, shape (m, m)
        Upper triangle of full rank, in columns of about unit length.
    target : ndarray, shape (m,)
    bounded : ndarray of bool, shape (m,)

    Returns
    -------
    ndarray, shape (m,)

    Examples
    --------
    >>> import numpy as np
    >>> from frischid.estimators.signed_least_squares import nearest
    >>> R = np.array([[1.0, 0.8], [0.0, 0.6]])
    >>> nearest(R, np.array([1.0, -0.5]), np.array([False, True])) + 0.0
    array([1., 0.])
    """
    x: Array = np.asarray(linalg.solve_triangular(R, target))
    held = bounded & (x <= 0.0)
    if not (x[held] < 0.0).any():
        return x
    x[held] = 0.0
    x, held = _first_guess(R, target, bounded, x, held)
    squares, gradient = _state(R, target, x)
    for _ in range(len(x)):
        if _violation(gradient, held) < FLAT:
            break
        held[np.argmax(np.where(held, -gradient, 0.0))] = False
        x, held = _within(R, target, bounded, x, held)
        before = squares
        squares, gradient = _state(R, target, x)
        if before - squares < FLAT * before:
            break
    x[bounded] = np.maximum(x[bounded], 0.0)
    return x


def _first_guess(
    R: Array, target: Array, bounded: NDArray[np.bool_], x: Array, held: NDArray[np.bool_]
) -> tuple[Array, NDArray[np.bool_]]:
    """Hold every variable that comes out negative, until none does: x and the variables that are held."""
    while not held.all():
        free = np.flatnonzero(~held)
        z = _solve(R, target, free)
        below = bounded[free] & (z < 0.0)
        held[free[below]] = True
        x[free] = np.where(below, 0.0, z)
        if not below.any():
            break
    return x, held


def _within(
    R: Array, target: Array, bounded: NDArray[np.bool_], x: Array, held: NDArray[np.bool_]
) -> tuple[Array, NDArray[np.bool_]]:
    """Go from x to the minimum over the variables that are not held; each bound on the way holds its variable."""
    while True:
        free = np.flatnonzero(~held)
        z, here = _solve(R, target, free), x[free]
        below = np.flatnonzero(bounded[free] & (z < 0.0))
        if not len(below):
            x[free] = z
            return x, held
        shares = -here[below] / (z[below] - here[below])
        first = int(np.argmin(shares))
        x[free] = here + shares[first] * (z - here)
        held[free[below[first]]] = True


def _solve(R: Array, target: Array, free: NDArray[np.intp]) -> Array:
    """The minimum over the free variables, the others zero."""
    count = len(free)
    reduced: Array = np.asarray(np.linalg.qr(np.column_stack([R[:, free], target]), mode="r"))
    return np.asarray(linalg.solve_triangular(reduced[:count, :count], reduced[:count, count]))


def _state(R: Array, target: Array, x: Array) -> tuple[float, Array]:
    """Half the squares, and their gradient."""
    r = R @ x - target
    return 0.5 * float(r @ r), np.asarray(R.T @ r)


def _violation(gradient: Array, held: NDArray[np.bool_]) -> float:
    """Largest slope of a free variable, or of a held one away from its bound."""
    return float(np.where(held, -gradient, np.abs(gradient)).max())
