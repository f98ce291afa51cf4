"""The paper's choice of one point of the box, as printed: eq. (24), with norms that are not squared.

    min_θ  f(θ) = ‖W θ − τ‖ + ‖θ‖    subject to    lower ≤ θ ≤ upper                                        (24)

Two ways lead from (24) to solvers: its second-order-cone form, or a one-dimensional search over box-constrained
quadratic programs, which ProxQP solves. The search is exact, as follows. Let θ(ρ) minimise

    ‖W θ − τ‖² + ρ ‖θ‖²    over the box,    r(ρ) = ‖W θ(ρ) − τ‖,    n(ρ) = ‖θ(ρ)‖.                        QP(ρ)

1. *A fixed point is the answer.* Where r, n > 0, the optimality condition of the convex problem (24) is
   −(Wᵀ(Wθ − τ)/r + θ/n) ∈ N, with N the normal cone of the box at θ. N is a cone, so the condition may be multiplied by
   r: it is then −(Wᵀ(Wθ − τ) + (r/n) θ) ∈ N, the condition of QP(ρ) at ρ = r/n. Both problems are convex, so both
   conditions suffice: θ(ρ) solves (24) if and only if ρ = r(ρ)/n(ρ).
2. *There is one crossing.* From the optimality of θ(ρ) at two values of ρ, r grows with ρ and n falls, so both are
   monotone and continuous. The fixed points are the minimisers of (24). These form a convex set, and f is strictly
   convex unless W θ − τ and θ keep their directions along it. So h(ρ) = r(ρ)/n(ρ) − ρ changes its sign once, from +
   to −.
   As r/n grows with ρ, the crossing is not below ρ = r(0)/n(0), where the search begins.
3. *The ends.* If h ≤ 0 already for ρ → 0, the answer is θ(0), least squares in the box: this is so for data without
   noise, where the kink of ‖Wθ − τ‖ holds the minimiser. If h ≥ 0 for every ρ, the answer is the box's point nearest
   to zero, where the kink of ‖θ‖ may hold it.

A bracketing root finder on log ρ therefore finds the global minimiser. The cone form would need another solver and
gives the same point; `tests/estimators/test_frisch_selection.py` compares the two.

Two properties of (24) are why `frischid.estimators.box_qp.select` stays as a choice (``frisch_squared``): kilograms add
to newton-metre-seconds in ‖θ‖, and the weight of the data grows with the square root of the log's length.

Source: S. Massaroli et al., *Frisch Scheme Identification of Robots Dynamic Parameters*, eq. (24).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from frischid.core.types import Array
from frischid.estimators.box_qp import Selection, select
from frischid.estimators.frisch import Box

_SPAN = 1e-12, 1e12
"""Range of ρ that is searched, in units of ``max_i (WᵀW)_ii``: beyond it ρ changes no digit of the solution."""
_RATIO = 1e-10
"""Relative precision of ρ at the fixed point; θ depends on ρ with a derivative of at most order one in log ρ."""


@dataclass(frozen=True, eq=False)
class PublishedSelection:
    """The minimiser of eq. (24), and the search that found it."""

    selection: Selection
    """The point, with the residuals of ProxQP's last problem."""
    ratio: float
    """ρ at the fixed point, ``‖Wθ − τ‖ / ‖θ‖``; 0 for least squares in the box, infinite for the point nearest to zero.
    """
    objective: float
    """``‖Wθ − τ‖ + ‖θ‖`` there."""
    problems: int
    """Quadratic programs that were solved."""


def select_published(sums: Array, box: Box) -> PublishedSelection:
    """Minimise ``‖W θ − τ‖ + ‖θ‖`` over a box, eq. (24) as printed.

    Parameters
    ----------
    sums : ndarray, shape (p + 1, p + 1)
        Sums of z zᵀ over the rows, z = [w τ], torque last. Sums, not means: the norms of (24) are not squared, so the
        number of rows decides how much ‖θ‖ weighs.
    box : Box
        Bounds of the p parameters; infinite ones are allowed.

    Raises
    ------
    EmptyBoxError
        The box allows nothing.
    IdentifiabilityError
        The columns of W are dependent.
    FrischidError
        ProxQP did not converge.
    """
    search = _Search(sums, box)
    found = search.solve(0.0)
    r, n = search.norms(found.theta)
    least, most = (bound * sums.diagonal()[:-1].max() for bound in _SPAN)
    low = max(r / n if n > 0 else most, least)  # r/n grows with ρ, so the fixed point is not below its value at zero
    if search.excess(np.log(low)) <= 0:
        ratio = 0.0 if low == least else low
    else:
        high = 10.0 * low
        while search.excess(np.log(high)) > 0 and high < most:
            low, high = high, 10.0 * high
        ratio = np.inf
        if high < most:
            ratio = float(np.exp(brentq(search.excess, np.log(low), np.log(high), xtol=_RATIO, rtol=_RATIO)))
    if ratio > 0:
        found = search.nearest_to_zero() if np.isinf(ratio) else search.solve(ratio)
    r, n = search.norms(found.theta)
    return PublishedSelection(found, ratio, r + n, search.problems)


class _Search:
    """QP(ρ) for one box, and how far ρ is from its fixed point."""

    def __init__(self, sums: Array, box: Box) -> None:
        self.sums, self.box, self.problems = sums, box, 0

    def solve(self, ratio: float) -> Selection:
        """Solve QP(ρ); the penalty of a parameter is ρ in the unit of its own torque energy, ρ / (WᵀW)_ii."""
        self.problems += 1
        return select(self.sums, self.box, ratio / self.sums.diagonal()[:-1])

    def norms(self, theta: Array) -> tuple[float, float]:
        """``‖Wθ − τ‖`` and ``‖θ‖``."""
        direction = np.append(theta, -1.0)
        return float(np.sqrt(max(direction @ self.sums @ direction, 0.0))), float(np.linalg.norm(theta))

    def excess(self, log_ratio: float) -> float:
        """``h(ρ)``, divided by ρ and with a sign that also holds where θ is zero."""
        ratio = float(np.exp(log_ratio))
        r, n = self.norms(self.solve(ratio).theta)
        return (r - ratio * n) / max(r, ratio * n, np.finfo(float).tiny)

    def nearest_to_zero(self) -> Selection:
        """Return the point of the box that is nearest to zero, the limit of QP(ρ) for ρ → ∞."""
        theta = np.clip(0.0, self.box.lower, self.box.upper)
        held = (theta == self.box.lower) | (theta == self.box.upper)
        at_bound = tuple(name for name, on in zip(self.box.names, held, strict=True) if on)
        return Selection(self.box.names, theta, 0.0, 0.0, at_bound, 0)
