"""A quick choice of the shapes of an effect to cross-validate: those whose columns explain most of the residual.

Many effects have shape parameters (a Stribeck speed, a cogging order) and a grid of values for each. Where the grid is
large, each shape is first fitted to the residual e alone. Its columns C are *not filtered*, which saves time:

    gain = Σ_j ω_j (eᵀ C̃) (C̃ᵀ C̃)⁺ (C̃ᵀ e),     C̃ = C less its means.

The shapes with the largest gains go on to cross-validation, which decides.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from frischid.core.types import Array
from frischid.diagnosis.cached_motion import JointData
from frischid.diagnosis.candidate_columns import columns_by_joint
from frischid.diagnosis.dataset import RegressionData
from frischid.effects import Effect

_SINGULAR = 1e-6  # of the largest singular value of a shape's columns: below it a direction is rounding error


def screened(
    data: RegressionData,
    places: Sequence[Sequence[Effect]],
    residual: Callable[[JointData], Array],
    omega: Array,
) -> list[Sequence[Effect]]:
    """Keep the shapes of each effect that best fit the residual.

    Parameters
    ----------
    places : sequence of sequence of Effect
        Shapes of one effect in one place each.
    residual : callable
        Residual of a joint's rows, (n,).
    omega : ndarray, shape (J,)
        Weight of each joint's squared residual.

    Returns
    -------
    list of sequence of Effect
        As many as `places`; shapes are in the order of the grid.
    """
    keep = data.cache.criteria.shapes_screened
    many = [n for n, effects in enumerate(places) if len(effects) > 2 * keep and not any(e.memory for e in effects)]
    sums: dict[tuple[int, int, int], Array] = {}
    for number, state in enumerate(data.cache.sampled_states() if many else ()):
        joints = [data.of_motion(row, number) for row in range(len(data.cache.active))]
        known = [(joint.picked, residual(joint)) for joint in joints]
        for n in many:
            for i, effect in enumerate(places[n]):
                for row, C in columns_by_joint(effect.terms(state), data.cache.position, len(state.t)).items():
                    picked, x = known[row]
                    Z = np.column_stack([np.ones(len(x)), C[picked], x])
                    sums[n, i, row] = sums.get((n, i, row), 0.0) + Z.T @ Z
    gains = {n: np.zeros(len(places[n])) for n in many}
    for (n, i, row), S in sums.items():
        gains[n][i] += omega[row] * _explained(S)
    best = {n: sorted(np.argsort(gain)[::-1][:keep].tolist()) for n, gain in gains.items()}
    return [[effects[i] for i in best[n]] if n in best else effects for n, effects in enumerate(places)]


def _explained(sums: Array) -> float:
    """Sum of squares of x that columns C explain, means subtracted, from the sums of [1 C x]ᵀ [1 C x]."""
    n, mean = sums[0, 0], sums[0, 1:-1]
    values, vectors = np.linalg.eigh(sums[1:-1, 1:-1] - np.outer(mean, mean) / n)
    along = vectors.T @ (sums[1:-1, -1] - mean * sums[0, -1] / n)
    keep = values > _SINGULAR**2 * max(values[-1], 1e-300)
    return float((along[keep] ** 2 / values[keep]).sum())
