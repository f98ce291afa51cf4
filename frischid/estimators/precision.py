"""The precision of estimates, Σ⁻¹, from their covariance Σ = D R D with the correlation R and the standard errors D.

Only R is inverted: D holds the units of the parameters, whose sizes differ by any power of ten. R has the spectrum
R = V diag(λ) Vᵀ. An eigenvalue below the rounding of the largest one is rounding, and counts as that rounding. So the
precision is positive definite, as that of estimates is.
"""

from __future__ import annotations

import numpy as np
from scipy import linalg

from frischid.core.types import Array


def precision_of(covariance: Array) -> Array:
    """Invert a covariance.

    Parameters
    ----------
    covariance : ndarray, shape (p, p)
        Symmetric, with a positive diagonal.

    Returns
    -------
    ndarray, shape (p, p)
        Symmetric and positive definite.

    Examples
    --------
    >>> import numpy as np
    >>> from frischid.estimators.precision import precision_of
    >>> precision_of(np.diag([4.0, 1e-40]))
    array([[2.5e-01, 0.0e+00],
           [0.0e+00, 1.0e+40]])
    """
    error = np.sqrt(np.diag(covariance))
    values, axes = linalg.eigh(covariance / np.outer(error, error))
    values = np.maximum(values, len(values) * np.finfo(float).eps * values[-1])
    root = axes / np.sqrt(values) / error[:, None]
    return np.asarray(root @ root.T)
