"""Linear models whose right-hand side has an unknown scale in every joint, solved from moments.

    i_j = κ_j (A_j φ) + noise,     φ = (unknowns, 1)

The coefficient of one column of A is known, which determines the common factor. The moments of joint j are those of
[A_j i_j].

Sources: Van Huffel and Vandewalle 1991, The Total Least Squares Problem, SIAM, chapter 3 (columns without noise);
Gautier and Briot 2014, ASME J. Dynamic Systems, Measurement and Control 136(5).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy import linalg

from frischid.core.types import Array
from frischid.errors import IdentifiabilityError

GAIN_PASSES = 5  # iterations of the joints' weights, which depend on g
GAIN_CONVERGED = 1e-8  # relative change at which the iteration has converged


def total_least_squares(M: Array, counts: Array) -> tuple[Array, Array]:
    """Scales g = 1/κ and φ by mixed least squares - total least squares: only i is noisy.

    Parameters
    ----------
    M : ndarray, shape (J, n + 2, n + 2)
        Moments of [A i], the known column of A last but one.
    counts : ndarray, shape (J,)
        Rows of each joint.

    Returns
    -------
    g : ndarray, shape (J,)
    phi : ndarray, shape (n + 1,)

    Raises
    ------
    IdentifiabilityError
        The known column hardly contributes to the torques.
    """
    size = np.sqrt(np.einsum("jaa->a", M)[:-1])
    if size[-1] == 0:
        raise IdentifiabilityError(
            "the known payload causes no torque in the loaded logs; move the joints that carry it"
        )
    size = np.where(size > 0, size, 1.0)
    noise = np.array([_left(m) for m in M]) / counts
    weights = 1.0 / M[:, -1, -1]
    for _ in range(GAIN_PASSES):
        A = np.einsum("j,jab->ab", weights, M[:, :-1, :-1]) / np.outer(size, size)
        AV = weights[:, None] * M[:, :-1, -1] / size
        solved = linalg.solve(A + 1e-13 * np.trace(A) / len(A) * np.eye(len(A)), AV.T, assume_a="pos")
        S = np.diag(weights * M[:, -1, -1]) - AV @ solved
        root = 1.0 / np.sqrt(weights * counts * noise)
        g = root * np.linalg.eigh(S * np.outer(root, root))[1][:, 0]
        phi = (solved @ g) / size
        if not (np.abs(g) > 0).all() or abs(phi[-1]) * size[-1] < 1e-9 * np.abs(phi * size).max():
            raise IdentifiabilityError(
                "the loaded logs do not determine the gains: the known payload hardly changes the torque; use a "
                "heavier payload, or motions that lift it"
            )
        g, phi = g / phi[-1], phi / phi[-1]
        weights = 1.0 / (g**2 * noise)
    return g, phi


def in_amperes(
    blocks: Sequence[Array], counts: Array, gains: Array, phi: Array, names: Sequence[str]
) -> tuple[Array, Array, Array]:
    """Most likely φ and κ for noisy i: Gauss-Newton, every joint weighted by its own residual variance.

    Parameters
    ----------
    blocks : sequence of ndarray, shape (J, n + 2, n + 2)
        Moments of consecutive stretches of time.
    counts : ndarray, shape (J,)
        Rows of each joint, all blocks together.
    gains, phi : ndarray
        Start values.
    names : sequence of str
        Names of the n + J unknowns, for errors.

    Returns
    -------
    x : ndarray, shape (n + J,)
        φ without its last entry, then κ.
    covariance, information : ndarray, shape (n + J, n + J)
        The jackknife over blocks, and the Gauss-Newton matrix divided by the inflation from correlation.
    """
    M, J = np.sum(blocks, axis=0), len(gains)
    x = np.concatenate([phi[:-1], 1.0 / gains])
    for _ in range(50):
        weights = counts / _misfits(M, x)
        H, gradient = _normal(M, x, weights)
        step = _solve(H, gradient, names)
        x = x + step
        if np.abs(step * np.sqrt(np.diag(H))).max() < GAIN_CONVERGED * np.sqrt(counts.sum()):
            break
    weights = counts / _misfits(M, x)
    H, _ = _normal(M, x, weights)
    changes = []
    for block in blocks:
        part, gradient = _normal(block, x, weights)
        changes.append(_solve(H - part, gradient, names))
    D = np.array(changes)
    covariance = (len(D) - 1) / len(D) * D.T @ D
    inflation = float(np.median(np.diag(covariance) / np.diag(_solve(H, np.eye(len(H)), names))))
    if (x[-J:] <= 0).any():
        wrong = [n for n, c in zip(names[-J:], x[-J:], strict=True) if c <= 0]
        raise IdentifiabilityError(
            f"{', '.join(wrong)} would be negative: is a current's sign wrong (sign in the mapping), are the logs "
            "with and without the payload exchanged, or does the payload hardly change the torque?"
        )
    return x, covariance, H / max(1.0, inflation)


def _left(m: Array) -> float:
    """Sum of squares of the last column that the others do not explain."""
    size = np.sqrt(np.diag(m))
    used = size > 0
    scaled = m[np.ix_(used, used)] / np.outer(size[used], size[used])
    values, vectors = np.linalg.eigh(scaled[:-1, :-1])
    keep = values > 1e-12 * values[-1]
    projected = vectors[:, keep].T @ scaled[:-1, -1] / np.sqrt(values[keep])
    return float(max(1.0 - projected @ projected, 1e-12) * m[-1, -1])


def _misfits(M: Array, x: Array) -> Array:
    """Sum of squares of ``i − κ (A φ)`` of each joint."""
    phi, kappa = np.append(x[: -len(M)], 1.0), x[-len(M) :]
    d = np.column_stack([-kappa[:, None] * phi, np.ones(len(M))])
    return np.asarray(np.maximum(np.einsum("ja,jab,jb->j", d, M, d), 1e-12 * M[:, -1, -1]))


def _normal(M: Array, x: Array, weights: Array) -> tuple[Array, Array]:
    """Gauss-Newton matrix and gradient in (φ, κ)."""
    J = len(M)
    n = len(x) - J
    phi, kappa = np.append(x[:n], 1.0), x[n:]
    H, g = np.zeros((n + J, n + J)), np.zeros(n + J)
    for j, (m, c, w) in enumerate(zip(M, kappa, weights, strict=True)):
        A, b = m[: n + 1, : n + 1], m[: n + 1, -1]
        Aphi = A @ phi
        left = b - c * Aphi
        H[:n, :n] += w * c**2 * A[:n, :n]
        H[:n, n + j] = H[n + j, :n] = w * c * Aphi[:n]
        H[n + j, n + j] = w * phi @ Aphi
        g[:n] += w * c * left[:n]
        g[n + j] = w * phi @ left
    return H, g


def _solve(H: Array, b: Any, names: Sequence[str]) -> Array:
    size = np.sqrt(np.diag(H))
    blind = [n for n, s in zip(names, size, strict=True) if not s > 0]
    if blind:
        raise IdentifiabilityError(
            f"the logs never excite {', '.join(blind)}; move these joints or leave the effect out"
        )
    scaled = H / np.outer(size, size)
    values, vectors = np.linalg.eigh(scaled)
    if values[0] < 1e-11 * values[-1]:
        worst = np.abs(vectors[:, 0])
        blind = [names[i] for i in np.argsort(-worst)[:6] if worst[i] > 0.1 * worst.max()]
        raise IdentifiabilityError(
            f"these logs cannot distinguish {', '.join(blind)}; record motions in which the payload causes more torque"
        )
    right = b / size if b.ndim == 1 else b / size[:, None]
    solution = vectors @ ((vectors.T @ right).T / values).T
    return np.asarray(solution / size if b.ndim == 1 else solution / size[:, None])
