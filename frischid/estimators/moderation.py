"""Standard errors that many parameters estimate together.

The jackknife over B blocks estimates the variance of each parameter from B numbers only; where few blocks move a joint,
from a handful. Its estimate s²_i then scatters like a χ² of ν_i degrees of freedom, too narrow about as often as too
wide, and with dozens of parameters some are always too narrow. But all parameters see the same residuals, so what the
correlation of the residuals does to the variance is alike for all of them:

    r_i = s²_i / u²_i,      u²_i the variance for independent residuals,
    log r_i = log ρ_i + noise of variance ψ'(ν_i / 2),     log ρ_i scattered with variance ψ'(d / 2) about one mean.

d and the mean ρ follow from the scatter of the r_i; the moderated variance is the posterior mean

    r̃_i = (d ρ + ν_i r_i) / (d + ν_i).

Residuals that are independent, or correlated in the same way for all, have d → ∞: every r̃_i is the mean. Residuals that
matter for some parameters more than for others have a small d: every parameter keeps its own.

Sources: G. K. Smyth, "Linear models and empirical Bayes methods", Statistical Applications in Genetics and Molecular
Biology 3(1), 2004; degrees of freedom: F. Satterthwaite, Biometrics 2(6), 1946, R. Bell and D. McCaffrey, Survey
Methodology 28(2), 2002.
"""

from __future__ import annotations

import numpy as np
from scipy import optimize, special

from frischid.core.types import Array

FEWEST_PARAMETERS = 4
"""Parameters from which on the scatter of their ratios says something."""


def satterthwaite(shares: Array) -> Array:
    """Degrees of freedom of a sum of squares of independent normal numbers.

    Parameters
    ----------
    shares : ndarray, shape (B, p)
        Variance of each of the B numbers, for p sums.

    Returns
    -------
    ndarray, shape (p,)
        B where all are alike, 1 where one outweighs the others.

    Examples
    --------
    >>> import numpy as np
    >>> from frischid.estimators.moderation import satterthwaite
    >>> satterthwaite(np.array([[1.0, 8.0], [1.0, 0.0], [1.0, 0.0]]))
    array([3., 1.])
    """
    return np.asarray(shares.sum(axis=0) ** 2 / (shares**2).sum(axis=0))


def moderated(ratios: Array, degrees: Array) -> Array:
    """Ratios of estimated to expected variances, each moved towards the others as far as they agree.

    Parameters
    ----------
    ratios : ndarray, shape (p,)
        r_i, positive.
    degrees : ndarray, shape (p,)
        ν_i.

    Returns
    -------
    ndarray, shape (p,)
        r̃_i.

    Examples
    --------
    >>> import numpy as np
    >>> from frischid.estimators.moderation import moderated
    >>> np.ptp(moderated(np.array([0.8, 1.1, 0.9, 1.2, 1.0]), np.full(5, 20.0))) < 1e-9
    np.True_
    """
    if len(ratios) < FEWEST_PARAMETERS:
        return ratios
    half = degrees / 2.0
    level = np.log(ratios) - special.digamma(half) + np.log(half)
    own = special.polygamma(1, half)
    weight = 1.0 / own
    mean = float((weight * level).sum() / weight.sum())
    scatter = float((weight * ((level - mean) ** 2 * len(level) / (len(level) - 1) - own)).sum() / weight.sum())
    if scatter <= 0.0:
        return np.full(len(ratios), np.exp(mean))
    d = 2.0 * _trigamma_inverse(scatter)
    centre = np.exp(mean + special.digamma(d / 2.0) - np.log(d / 2.0))
    return np.asarray((d * centre + degrees * ratios) / (d + degrees))


def _trigamma_inverse(value: float) -> float:
    """X with ψ'(x) = value."""
    low, high = 1e-8, 1e12
    if value <= special.polygamma(1, high):
        return high
    return float(np.exp(optimize.brentq(lambda u: special.polygamma(1, np.exp(u)) - value, np.log(low), np.log(high))))
