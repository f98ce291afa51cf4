"""P values of four one-sided tests: of a mean, of two means, of signed ranks, and of a dependence of any shape.

    Student: t = mean(x) / sqrt(var(x) / n),       Welch: t = (m₁ − m₂) / sqrt(v₁/n₁ + v₂/n₂),
    Wilcoxon: W = Σ_{x>0} rank |x|,                Chatterjee: ξ = 1 − n Σ |r_{i+1} − r_i| / (2 Σ l_i (n − l_i)),

where r_i and l_i are the ranks of y, from below and from above, in the order of x.

They equal those of `scipy.stats`. They are written out here because they are asked for thousands of times, and
`scipy.stats` checks its arguments for longer than a test takes; its import takes longer than to evaluate a log.
Tails of known distributions are called from `scipy.special` where they are needed.

References: B. Welch, Biometrika 34, 1947; F. Wilcoxon, Biometrics Bulletin 1(6), 1945; S. Chatterjee, Journal of the
American Statistical Association 116(536), 2021, theorem 2.2.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import special

from frischid.core.types import Array

EXACT = 50
"""Largest number of values whose ranks are compared with their exact distribution, if no two ranks are equal."""
EXACT_WITH_TIES = 13
"""The same, where some are equal or zero."""


def mean_above_zero(x: Array) -> float:
    """P value that the mean of values (N,) is above zero: Student's t.

    Examples
    --------
    >>> import numpy as np
    >>> from frischid.estimators.p_values import mean_above_zero
    >>> round(mean_above_zero(np.array([-1.0, 0.0, 1.0])), 3), mean_above_zero(np.array([1.0, 1.1, 1.2])) < 0.01
    (0.5, True)
    """
    t = x.mean() / np.sqrt(x.var(ddof=1) / len(x))
    return float(special.stdtr(len(x) - 1, -t))


def mean_above(inside: Array, outside: Array) -> float:
    """P value that the mean of some values (N,) is above that of others (M,) of another variance: Welch's t."""
    parts = np.array([x.var(ddof=1) / len(x) for x in (inside, outside)])
    t = (inside.mean() - outside.mean()) / np.sqrt(parts.sum())
    freedom = parts.sum() ** 2 / (parts**2 / [len(inside) - 1, len(outside) - 1]).sum()
    return float(special.stdtr(freedom, -t))


def ranks_above_zero(x: Array) -> float:
    """P value that values (N,) lie symmetrically about something above zero: Wilcoxon's signed ranks.

    The sum of the positive values' ranks is compared with its distribution over all signs. For many values, or more
    than a few of which some are equal, that is nearly a normal distribution. Zeros are left out.
    """
    nonzero = x[x != 0]
    size, where, count = np.unique(np.abs(nonzero), return_inverse=True, return_counts=True)
    ranks = (np.cumsum(count) - (count - 1) / 2)[where]
    above = float(ranks[nonzero > 0].sum())
    tied = len(size) < len(x)
    if len(x) <= (EXACT_WITH_TIES if tied else EXACT):
        chances = _sums(np.round(2 * ranks).astype(int))
        return float(min(1.0, chances[round(2 * above) :].sum()))
    n = len(nonzero)
    spread = np.sqrt((n * (n + 1) * (2 * n + 1) - (count**3 - count).sum() / 2) / 24)
    return float(special.ndtr(-(above - n * (n + 1) / 4) / spread))


def depends(x: Array, y: Array) -> float:
    """P value that values y (N,) depend on values x (N,) in whatever shape: Chatterjee's rank correlation.

    Examples
    --------
    >>> import numpy as np
    >>> from frischid.estimators.p_values import depends
    >>> x = np.linspace(-1.0, 1.0, 50)
    >>> depends(x, x**2) < 1e-6, depends(x, np.ones(50))
    (True, 1.0)
    """
    n, y = len(x), y[np.argsort(x)]
    ordered = np.sort(y)
    r = np.searchsorted(ordered, y, side="right").astype(float)  # values no larger
    above = n - np.searchsorted(ordered, y, side="left")  # values no smaller
    spread = float((above * (n - above)).sum())
    if spread == 0:
        return 1.0
    xi = 1 - n * np.abs(np.diff(r)).sum() / (2 * spread)
    u, left = np.sort(r), n - np.arange(1, n + 1)
    a = ((2 * left + 1) * u**2).sum() / n**4
    b = ((np.cumsum(u) + left * u) ** 2).sum() / n**5
    c = ((2 * left + 1) * u).sum() / n**3
    return float(special.ndtr(-xi * np.sqrt(n / (a - 2 * b + c**2)) * spread / n**3))


def _sums(steps: NDArray[np.int_]) -> Array:
    """Probability of each sum of some steps, where each step is in the sum with probability one half."""
    chances = np.zeros(steps.sum() + 1)
    chances[0] = 1.0
    for step in steps:
        chances[step:] += chances[: len(chances) - step].copy()
        chances /= 2
    return chances
