"""A fit that stretches of time with a large error hardly move: each stretch counts with the root of its energy.

Least squares spreads the error of a strong push over the whole log. Then the rest of the log looks wrong too, and no
stretch of time stands out. With ē_j² the mean of e_j² over 0.25 s and u_j the noise of joint j, the fit minimises

    Σ_j Σ_t √(1 + ē_j(t)² / u_j²)  +  ½ (θ − μ)ᵀ Λ (θ − μ),

which is convex, so there is one minimum. Least squares with weights 1/√(1 + ē_j²/u_j²), again and again, finds it.

Sources: Huber 1964, "Robust estimation of a location parameter", Ann. Math. Statist. 35(1); Yuan and Lin 2006, "Model
selection and estimation in regression with grouped variables", J. R. Stat. Soc. B 68(1) (a norm of groups).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, ndimage

from frischid.core.types import Array
from frischid.diagnosis.cross_validation import CrossValidator

_MOST_ROWS = 2000  # of a joint, spread evenly: more change a robust fit by less than its own error
_REWEIGHTINGS = 60  # at most
_SETTLED = 1e-4  # share of the sum by which it must still fall
_ROUNDING_SHARE = 1e-10  # share of each diagonal element that is added, against rounding


@dataclass(frozen=True, eq=False)
class _Rows:
    """Every n-th row of a joint over one motion, in units of the joint's noise."""

    active: NDArray[np.intp]
    """Columns that act on the joint, (k,)."""
    Y: Array
    tau: Array
    """`Y`, `tau`: Shape (n, k) and (n,)."""
    width: int
    """Rows in 0.25 s."""

    def energy(self, theta: Array) -> Array:
        """Mean of the squared residual over 0.25 s around each row, (n,)."""
        return np.asarray(ndimage.uniform_filter1d((self.tau - self.Y @ theta[self.active]) ** 2, self.width))


def robust_parameters(validator: CrossValidator, unit: Array) -> Array:
    """Parameters of the model, (p,), that strong errors in a minority of the time hardly move.

    Parameters
    ----------
    validator : CrossValidator
        Without added candidates.
    unit : ndarray, shape (J,)
        Noise of each joint, N·m (N).
    """
    parts = _rows(validator, unit)
    prior, theta = validator.fit.prior, validator.theta
    before = np.inf
    for _ in range(_REWEIGHTINGS):
        H, b, cost = prior.precision.copy(), prior.precision @ prior.mean, 0.0
        for part in parts:
            root = np.sqrt(1 + part.energy(theta))
            weighted = part.Y / root[:, None]
            H[np.ix_(part.active, part.active)] += weighted.T @ part.Y
            b[part.active] += weighted.T @ part.tau
            cost += float(root.sum())
        if before - cost < _SETTLED * cost:
            break
        before = cost
        H += _ROUNDING_SHARE * np.diag(np.diag(H) + 1e-300)
        theta = linalg.cho_solve(linalg.cho_factor(H), b)
    return np.asarray(theta)


def _rows(validator: CrossValidator, unit: Array) -> list[_Rows]:
    """Evenly spread rows of every joint, motion by motion."""
    found: list[_Rows] = []
    for row, count in enumerate(validator.counts.sum(axis=0).tolist()):
        every, passed = max(1, -(-count // _MOST_ROWS)), 0
        for data in validator.data.motions_of(row):
            chosen = slice(-passed % every, None, every)
            passed += len(data)
            t = data.motion.t.read()[data.picked][chosen]
            if len(t) > 1:
                width = validator.criteria.burst.samples(float(np.median(np.diff(t))))
                active = validator.data.cache.active[row]
                found.append(_Rows(active, data.Y[chosen] / unit[row], data.tau[chosen] / unit[row], width))
    return found
