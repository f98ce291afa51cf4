"""The normal equations ``H θ = b`` from moments, on columns scaled to unit norm, with their conditioning tested.

Moments hold the square of the regressor, so the condition number of H is the square of the regressor's.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from scipy import linalg

from frischid.core.types import Array
from frischid.errors import IdentifiabilityError

WORST_CONDITION = 1e6
"""Condition number of the column-scaled regressor; its square leaves four digits in the moments."""
ESTIMATE_MARGIN = 10.0
"""Factor below the worst condition number from which LAPACK's estimate decides, which errs by a factor of 3 at most."""


class NormalEquations:
    """``H θ = b`` on columns scaled to unit norm, with its conditioning tested.

    Parameters
    ----------
    moments : ndarray, shape (p + 1, p + 1)
        Weighted moments of [Y τ].
    names : sequence of str
        Parameter names, for the error.

    Raises
    ------
    IdentifiabilityError
        The data leave some combination of parameters undetermined; the message names its parameters.
    """

    def __init__(self, moments: Array, names: Sequence[str]) -> None:
        diagonal = np.sqrt(np.diag(moments)[:-1])
        if (diagonal == 0).any():
            blind = [n for n, d in zip(names, diagonal, strict=True) if d == 0]
            raise IdentifiabilityError(
                f"the log never excites {', '.join(blind)}; leave the effect out or move the joint"
            )
        self.scale = 1.0 / diagonal
        self.H = moments[:-1, :-1] * np.outer(self.scale, self.scale)
        self._check_condition(names)
        self.factor = linalg.cho_factor(self.H)
        self.theta = self.solve(moments[:-1, -1])

    @cached_property
    def condition(self) -> float:
        """Condition number of the column-scaled regressor."""
        values = linalg.eigvalsh(self.H)
        return float(np.sqrt(values[-1] / max(values[0], 1e-300)))

    def _check_condition(self, names: Sequence[str]) -> None:
        # ‖H⁻¹‖₁ from the Cholesky factor costs a tenth of the eigenvalues, which are needed near the limit only.
        factor, failed = linalg.lapack.dpotrf(self.H)
        if not failed:
            reciprocal, _ = linalg.lapack.dpocon(factor, float(np.abs(self.H).sum(axis=0).max()))
            if reciprocal * (WORST_CONDITION / ESTIMATE_MARGIN) ** 2 > 1.0:
                return
        values, vectors = linalg.eigh(self.H)
        self.condition = float(np.sqrt(values[-1] / max(values[0], 1e-300)))
        if self.condition > WORST_CONDITION:
            worst = np.abs(vectors[:, 0])
            blind = [names[i] for i in np.argsort(-worst)[:6] if worst[i] > 0.1 * worst.max()]
            raise IdentifiabilityError(
                f"this log cannot distinguish {', '.join(blind)} (condition number {self.condition:.1e} of the "
                "column-scaled regressor); record a motion that moves these joints more, or leave an effect out"
            )

    def solve(self, b: Array) -> Array:
        """H⁻¹ b in the parameters' own units."""
        scaled = b * (self.scale if b.ndim == 1 else self.scale[:, None])
        x = linalg.cho_solve(self.factor, scaled)
        return np.asarray(x * (self.scale if b.ndim == 1 else self.scale[:, None]))

    @property
    def inverse(self) -> Array:
        """H⁻¹ in the parameters' own units, shape (p, p)."""
        return self.solve(np.eye(len(self.scale)))
