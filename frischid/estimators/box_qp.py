"""The best point of a box: a quadratic program with box constraints, solved by ProxQP.

The Frisch scheme and its recursion end in a box, and every point of the box explains the data. One point has to become
the model:

    min_θ  ‖W θ − τ‖² + ρ Σ_i (w_i θ_i)²    subject to    lower ≤ θ ≤ upper,     w_i² = (WᵀW)_ii.

Here the penalty on a parameter is the torque energy it accounts for on its own. So ρ is a pure number (0.01: one
percent of that energy), the same for moments that are sums or means. The paper's own criterion has norms that are not
squared; `frischid.estimators.frisch_selection` solves it as a sequence of the programs here.

Written in φ_i = θ_i w_i √(1 + ρ) / ‖τ‖ the Hessian has unit diagonal, and ProxQP meets a well-scaled problem. Source:
A. Bambade et al., "PROX-QP: Yet another quadratic programming solver for robotics and beyond", 2022.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from proxsuite import proxqp
from scipy.optimize import lsq_linear

from frischid.core.types import Array
from frischid.errors import FrischidError, IdentifiabilityError, InputError
from frischid.estimators.frisch import CONDITION_LIMIT, Box, unit_diagonal

KKT_TOLERANCE = 1e-8
"""Largest accepted residual of the optimality conditions, of a problem scaled to order one."""


@dataclass(frozen=True, eq=False)
class Selection:
    """The parameters chosen in a box, and how well they satisfy the optimality conditions."""

    names: tuple[str, ...]
    """The p parameters."""
    theta: Array
    """The minimiser, in the parameters' units, (p,); inside the box exactly."""
    primal: float
    """Largest amount by which ProxQP's own iterate left the box, in scaled units."""
    dual: float
    """``max_i |φ − clip(φ − ∇f(φ), l, u)|`` of the scaled problem: zero at the minimiser and nowhere else."""
    at_bound: tuple[str, ...]
    """Parameters that lie on a bound: there the data fit better outside the box."""
    iterations: int
    """Iterations ProxQP took."""


def select(moments: Array, box: Box, ridge: float | Array = 0.0) -> Selection:
    """Minimise the squared torque residual over a box.

    Parameters
    ----------
    moments : ndarray, shape (p + 1, p + 1)
        Sums or means of z zᵀ, z = [y τ], torque last (`Gram.weighted`).
    box : Box
        Bounds of the p parameters; infinite ones are allowed.
    ridge : float or ndarray, shape (p,)
        ρ above, a pure number, or one for each parameter; 0 is plain least squares within the box.

    Raises
    ------
    EmptyBoxError
        The box is empty.
    IdentifiabilityError
        The minimiser is not unique: dependent columns and no ridge.
    FrischidError
        ProxQP did not converge; the message holds the residuals.
    """
    penalty = np.asarray(ridge, dtype=float)
    if not (np.isfinite(penalty) & (penalty >= 0)).all():
        raise InputError(f"the ridge must be a nonnegative number, not {ridge}")
    replace(box)  # checks its bounds again: ProxQP returns nonsense for an empty box
    p = len(box.names)
    scaled, rms = unit_diagonal(moments, box.names)
    stiff = np.sqrt(1.0 + penalty) * np.ones(p)  # brings the diagonal back to one, however large the penalty
    H, g = (scaled[:p, :p] + penalty * np.eye(p)) / np.outer(stiff, stiff), -scaled[:p, p] / stiff
    condition = float(np.linalg.cond(H))
    if condition > CONDITION_LIMIT:
        raise IdentifiabilityError(
            f"many points of the box fit equally well (condition number {condition:.3g}); reduce to base "
            "parameters or pass a small ridge such as 1e-6"
        )
    unit = rms[p] / (rms[:p] * stiff)
    lower, upper = box.lower / unit, box.upper / unit
    raw, iterations = _proxqp(H, g, lower, upper)
    primal = float(np.maximum(np.maximum(lower - raw, raw - upper), 0.0).max(initial=0.0))
    phi, dual = _polished(H, g, lower, upper, np.clip(raw, lower, upper))
    if not max(primal, dual) <= KKT_TOLERANCE:  # also catches NaN
        raise FrischidError(
            f"ProxQP did not converge in {iterations} iterations: primal residual {primal:.3g}, "
            f"dual {dual:.3g}, at most {KKT_TOLERANCE:g} accepted; condition {condition:.3g}; pass a ridge"
        )
    # the bounds are taken from the box itself: scaling there and back would miss them by a rounding error
    theta = np.where(phi <= lower, box.lower, np.where(phi >= upper, box.upper, phi * unit))
    theta = np.clip(theta, box.lower, box.upper)
    held = (theta == box.lower) | (theta == box.upper)
    at_bound = tuple(name for name, on in zip(box.names, held, strict=True) if on)
    return Selection(box.names, theta, primal, dual, at_bound, iterations)


def _proxqp(H: Array, g: Array, lower: Array, upper: Array) -> tuple[Array, int]:
    """Solve ``min ½ φᵀHφ + gᵀφ`` in the box with ProxQP; returns its iterate and the iterations taken."""
    qp = proxqp.dense.QP(len(g), 0, 0, True)  # no equalities, no general inequalities, box constraints
    qp.settings.eps_abs = 1e-10
    qp.settings.eps_rel = 0.0
    qp.settings.max_iter = 10_000
    qp.init(H=H, g=g, l_box=lower, u_box=upper)
    qp.solve()
    return np.array(qp.results.x), int(qp.results.info.iter)


def _polished(H: Array, g: Array, lower: Array, upper: Array, phi: Array) -> tuple[Array, float]:
    """Solve exactly for the parameters off their bounds; returns the best point and its `_stationarity`.

    ProxQP stops at a small *gradient*, which an ill-conditioned H turns into a thousandfold larger error of φ. ProxQP
    may also stop near a bound that the minimiser is on. Each pass solves for one choice of the parameters on their
    bounds and chooses again. A pass may lead away before it leads to the minimiser, so the best point is kept.
    """
    best, least = phi, _stationarity(H, g, lower, upper, phi)
    for _ in range(2 * len(g)):
        multiplier = H @ phi + g
        below, above = phi - multiplier <= lower, phi - multiplier >= upper
        free = ~(below | above)
        phi = np.where(below, lower, np.where(above, upper, 0.0))
        phi[free] = np.linalg.solve(H[np.ix_(free, free)], -g[free] - H[free] @ phi)
        phi = np.clip(phi, lower, upper)
        residual = _stationarity(H, g, lower, upper, phi)
        if residual >= least and least <= KKT_TOLERANCE:
            break
        if residual < least:
            best, least = phi, residual
    if least > KKT_TOLERANCE and (lower < upper).all():  # the passes go round in a circle: choose one bound at a time
        root = np.linalg.cholesky(H)
        phi = lsq_linear(root.T, np.linalg.solve(root, -g), (lower, upper), method="bvls", tol=1e-14).x
        residual = _stationarity(H, g, lower, upper, np.clip(phi, lower, upper))
        if residual < least:
            best, least = np.clip(phi, lower, upper), residual
    return best, least


def _stationarity(H: Array, g: Array, lower: Array, upper: Array, phi: Array) -> float:
    """Distance φ moves in one projected gradient step."""
    step = np.clip(phi - (H @ phi + g), lower, upper)
    return float(np.abs(phi - step).max(initial=0.0))
