"""Parameters of known sign: the correction of a fit without signs, from a few entries of its covariance.

Let z minimise a squared error without regard to signs, and let C be the inverse of its normal matrix. The parameters B
have known signs s. The fit with s_i x_i ≥ 0 follows from a small dual problem over B alone,

    minimise  ½ λᵀ C_BB λ + λᵀ z_B   over   s_i λ_i ≥ 0;      x = z + C_:B λ,   rise of the squared error = λᵀ C_BB λ.

λ_i is zero where the data alone give the right sign, so most fits need no correction. `identify` fits with the same
bounds: a candidate is scored with the parameters that the model will have once the candidate is added.

Source: Lawson and Hanson 1974, Solving Least Squares Problems, chapter 23, on the active set.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, optimize

from frischid.core.types import Array

_SAME = 1e-9  # share of each variance that is added: two parameters that the data cannot tell apart have singular C


def multipliers(z: Array, covariance: Array, signs: NDArray[np.int_]) -> Array:
    """λ of the parameters of known sign.

    Parameters
    ----------
    z : ndarray, shape (m,)
        Their values in the fit without signs.
    covariance : ndarray, shape (m, m)
        C_BB.
    signs : ndarray of {-1, 1}, shape (m,)

    Returns
    -------
    ndarray, shape (m,)

    Examples
    --------
    The second parameter may not be negative; the first follows, because the two are correlated:

    >>> import numpy as np
    >>> from frischid.diagnosis.sign_bounds import multipliers
    >>> z, C = np.array([1.0, -0.5]), np.array([[2.0, 1.0], [1.0, 1.0]])
    >>> (z + C @ multipliers(z, C, np.array([1, 1]))).round(6) + 0.0
    array([1.5, 0. ])
    """
    scale = signs / np.sqrt(covariance.diagonal())
    unit = covariance * np.outer(scale, scale)
    factor = linalg.cholesky(unit + _SAME * np.eye(len(unit)))
    target = linalg.solve_triangular(factor, -z * scale, trans="T")
    return np.asarray(optimize.nnls(factor, target)[0] * scale)
