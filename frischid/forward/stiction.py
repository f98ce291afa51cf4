"""One step of velocities with dry friction that can hold a joint.

    A (v⁺ − v_free) = −h f,     f_j = f⁺_j where v⁺_j > 0,  f⁻_j where v⁺_j < 0,  f⁻_j ≤ f_j ≤ f⁺_j where v⁺_j = 0

This is the optimality of a strictly convex problem in f with bounds, so the solution is unique. The active-set
iteration guesses which joints rest, solves a linear system, and corrects the guess. Nearly always the first guess, the
direction of the step before, is right.

Sources: Moreau 1988, "Unilateral contact and dry friction in finite freedom dynamics"; Hintermüller, Ito and Kunisch
2002, SIAM J. Optimization 13(3), on the active-set iteration.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from frischid.core.types import Array

MOST_GUESSES = 20
"""Corrections of the active set; after these, single joints are relaxed one by one, which always converges."""
RELAXATIONS = 200


def solve(A: Array, b: Array) -> Array:
    """Solutions (K, J) of K small systems (K, J, J)."""
    return np.asarray(b / A[:, 0] if A.shape[1] == 1 else np.linalg.solve(A, b[..., None])[..., 0])


def step_with_friction(
    A: Array, push: Array, v: Array, bounds: tuple[Array, Array], moving: NDArray[np.bool_] | None = None
) -> Array:
    """Velocities after a step.

    Parameters
    ----------
    A : ndarray, shape (K, J, J)
        Inertia of the step, positive definite.
    push : ndarray, shape (K, J)
        ``A v_free``: impulse without dry friction, N·m·s (N·s).
    v : ndarray, shape (K, J)
        Velocities before the step, the first guess of the directions.
    bounds : (ndarray, ndarray), each shape (K, J)
        Impulse ``h f`` of dry friction forwards and backwards.
    moving : ndarray of bool, shape (K, J), optional
        Joints whose friction is that of the direction of `v` in any case.

    Returns
    -------
    ndarray, shape (K, J)
        Exactly zero where a joint rests.
    """
    forwards, backwards = bounds
    side = np.sign(v)
    for _ in range(MOST_GUESSES):
        rests = side == 0.0
        friction = np.where(side > 0.0, forwards, np.where(side < 0.0, backwards, 0.0))
        if not rests.any():
            found = solve(A, push - friction)
        else:
            eye = np.eye(A.shape[1])
            held = np.where(rests[:, :, None], eye, A)
            found = solve(held, np.where(rests, 0.0, push - friction))
            found[rests] = 0.0
            friction = np.where(rests, push - np.einsum("kij,kj->ki", A, found), friction)
        better = np.where(
            rests,
            np.where(friction > forwards, 1.0, np.where(friction < backwards, -1.0, 0.0)),
            np.where(found * side < 0.0, 0.0, side),
        )
        if moving is not None:
            better = np.where(moving, side, better)
        if (better == side).all():
            return found
        side = better
    return _relaxed(A, push, found, bounds)


def _relaxed(A: Array, push: Array, v: Array, bounds: tuple[Array, Array]) -> Array:
    """The same by relaxing one joint after the other, the others fixed."""
    forwards, backwards = bounds
    v = v.copy()
    for _ in range(RELAXATIONS):
        before = v.copy()
        for j in range(A.shape[1]):
            alone = push[:, j] - np.einsum("kj,kj->k", A[:, j], v) + A[:, j, j] * v[:, j]
            v[:, j] = (
                np.where(alone > forwards[:, j], alone - forwards[:, j], np.minimum(alone - backwards[:, j], 0.0))
                / A[:, j, j]
            )
        if np.abs(v - before).max() <= 1e-12 * (1.0 + np.abs(v).max()):
            break
    return v
