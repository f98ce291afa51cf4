"""Fits of single rows of a sketch: how well the URDF and friction explain one torque.

    y_j ≈ τ_nominal,j + fv v + fc sign v + Ia a + off,      fv, fc, Ia ≥ 0,

where y_j is a torque column, as it was measured or with a fault undone. The checks of torques, positions and robots
compare their hypotheses by these fits.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from scipy.optimize import nnls

from frischid.checks.sketch import Sketch
from frischid.checks.sketch_motion import Beside
from frischid.core.types import Array

Result = TypeVar("Result")


class RowFits:
    """Fits of single rows of a sketch.

    Parameters
    ----------
    other : RowFits, optional
        Fits of a sketch with the same torques and another motion. The rows on which the motions do not differ are read
        once: a wrong position of one limb changes no torque of another limb.
    """

    def __init__(self, sketch: Sketch, other: RowFits | None = None) -> None:
        self.sketch, self.criteria = sketch, sketch.criteria
        self.names, self.rows = sketch.names, [int(j) for j in sketch.rows]
        step = float(np.median(np.diff(sketch.t))) if len(sketch) > 1 else 1.0
        seconds = step * np.array([sketch.used[:, j].sum() for j in self.rows])
        self.weight = np.minimum(seconds / self.criteria.independent_time, self.criteria.most_independent)
        self.uses = [sketch.motion.uses(j) for j in self.rows]
        self.nominal = [sketch.nominal[use, j] for use, j in zip(self.uses, self.rows, strict=True)]
        self._kept: dict[tuple[int, Hashable], Any] = {}
        self._source = [self if other is None or not self._agrees(other, k) else other for k in range(len(self.rows))]

    def _agrees(self, other: RowFits, k: int) -> bool:
        """Whether row k of other fits reads the same numbers."""
        if self.sketch.tau is not other.sketch.tau or self.rows != other.rows:
            return False
        fits = [x.sketch.motion.fit(self.rows[k]) for x in (self, other)]
        return fits[0] is fits[1] and bool(np.array_equal(self.nominal[k], other.nominal[k]))

    def of(self, k: int, tau: Array, j: int | None = None) -> Array:
        """Samples of a torque column that row k uses."""
        return np.asarray(tau[self.uses[k], self.rows[k] if j is None else j])

    @cached_property
    def spreads(self) -> Array:
        """Standard deviation of each torque column at the samples that each row uses, (R, R): [row, column]."""
        columns = self.sketch.tau[:, self.rows]
        return np.maximum([columns[use].std(axis=0) for use in self.uses], 1e-12)

    @cached_property
    def _products(self) -> tuple[Array, Array, Array, Array, Array]:
        """What bounds the error of each row with each torque column: see `least_errors`."""
        columns, R = self.sketch.tau[:, self.rows], len(self.rows)
        own, mixed, rigid = np.empty((R, R)), np.empty((R, R)), np.empty(R)
        seen, modelled = [], []
        for k, (use, nominal) in enumerate(zip(self.uses, self.nominal, strict=True)):
            tau, Q = columns[use], self.sketch.motion.fit(self.rows[k]).Q
            own[k], mixed[k], rigid[k] = np.einsum("nr,nr->r", tau, tau), nominal @ tau, nominal @ nominal
            seen.append(tau.T @ Q)
            modelled.append(Q.T @ nominal)
        return own, mixed, rigid, np.array(seen), np.array(modelled)

    def least_errors(self, factor: float) -> Array:
        """Bounds below the NRMSE of each row with each torque column times a factor, (R, R): [row, column].

        Without the signs of the friction a fit is a projection on the columns Q of the row, whatever torque t it reads:
        ‖f t − n‖² − ‖Qᵀ(f t − n)‖², where n is the nominal torque. With the signs an error can only be larger.
        """
        own, mixed, rigid, seen, modelled = self._products
        whole = factor**2 * own - 2 * factor * mixed + rigid[:, None]
        explained = np.square(factor * seen - modelled[:, None]).sum(axis=2)
        rounding = 1e-12 * (factor**2 * own + rigid[:, None])
        samples = np.array([len(x) for x in self.nominal])[:, None]
        left = np.sqrt(np.maximum(whole - explained - rounding, 0.0) / samples)
        return np.asarray(left / (abs(factor) * self.spreads))

    def error(self, k: int, y: Array, spread: float) -> float:
        """NRMSE of row k with the torque y."""
        return self.sketch.motion.fit(self.rows[k]).solve(y - self.nominal[k])[0] / spread

    def beside(self, k: int, y: Array, beside: Beside) -> tuple[float, Array]:
        """RMS of y after the friction of row k and further columns of either sign, and their torque (M,)."""
        motion, j = self.sketch.motion, self.rows[k]
        rms, x = motion.fit(j, beside).solve(y)
        X = motion.columns(j, beside)
        x = x[-2 * X.shape[1] :].reshape(2, -1)
        return rms, X @ (x[0] - x[1])

    def gain(self, k: int, y: Array) -> tuple[float, float]:
        """RMS of y after a multiple ≥ 0 of the nominal torque and friction, and the multiple."""
        A = np.column_stack([self.nominal[k], self._friction(k)])
        x, norm = nnls(A, y)
        return float(norm / np.sqrt(len(y))), float(x[0])

    def follows_load(self, k: int, y: Array, error: float, spread: float) -> bool:
        """Whether y follows the load: an NRMSE with a multiple of the nominal torque pays for it (Schwarz 1978)."""
        without = float(nnls(self._friction(k), y)[1]) / np.sqrt(len(y)) / spread
        return self.value(k, error) - self.value(k, without) > 0.5 * math.log(max(self.weight[k], 2.0))

    def _friction(self, k: int) -> Array:
        return np.asarray(self.sketch.motion.friction(self.rows[k])[self.uses[k]])

    def value(self, k: int, error: float) -> float:
        """Log-likelihood of row k; below the error that URDFs have anyway, less error is worth little."""
        capped = min(error, self.criteria.nrmse_cap)
        return -0.5 * float(self.weight[k]) * math.log(capped**2 + self.criteria.urdf_error**2)

    def values(self, errors: Array) -> Array:
        """`value` of each row with each torque column, for errors (R, R): [row, column]."""
        capped = np.minimum(errors, self.criteria.nrmse_cap)
        return np.asarray(-0.5 * self.weight[:, None] * np.log(capped**2 + self.criteria.urdf_error**2))

    def once(self, k: int, key: Hashable, read: Callable[[RowFits], Result]) -> Result:
        """A result for row k and a key; `read` computes it once for all fits in which row k reads the same numbers."""
        if self._source[k] is not self:
            return self._source[k].once(k, key, read)
        if (k, key) not in self._kept:
            self._kept[k, key] = read(self)
        found: Result = self._kept[k, key]
        return found

    def total(self, errors: Array) -> float:
        """Log-likelihood of all rows."""
        return sum(self.value(k, float(e)) for k, e in enumerate(errors))
