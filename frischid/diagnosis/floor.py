"""The noise floor of held-out errors: sensor noise, the uncertainty of the prediction, and what the data refute.

A fit to some folds predicts another one with parameters that are uncertain. So even without any missing effect, the
held-out error of joint j is above the sensor noise n_j by the variance of the prediction (leverage),

    floor_j² = n_j² + (n_j / σ_j)² Σ_f tr(H_f⁻¹ G_fj) / N_j,

with H_f the information of the parameters without fold f, G_fj the moments of joint j in fold f, N_j the rows of the
joint, and σ_j the residual that H_f counts with: the part of the variance that sensor noise alone would cause.

A floor is computed from assumptions on the noise. A held-out error below the floor proves that the floor is wrong
there: then that error is the floor.

Source: Hastie, Tibshirani and Friedman 2009, The Elements of Statistical Learning, section 7.3.
"""

from __future__ import annotations

import numpy as np
from scipy import linalg

from frischid.core.types import Array
from frischid.diagnosis.cross_validation import CrossValidator


def with_leverage(validator: CrossValidator, floor: Array) -> Array:
    """The floor with the variance of the prediction.

    Parameters
    ----------
    validator : CrossValidator
    floor : ndarray, shape (J,)
        Sensor noise of each joint, N·m (N).
    """
    gram = validator.columns.gram[:, :, :-1, :-1]  # (folds, J, p, p)
    variance = np.zeros(len(floor))
    for fold, moments in enumerate(gram):
        factor, _ = validator.fit.systems[fold]
        variance += [float(np.trace(linalg.cho_solve(factor, G))) for G in moments]
    share = np.minimum(floor / np.maximum(validator.fit.sigma, 1e-300), 1.0) ** 2
    return np.asarray(np.sqrt(floor**2 + share * variance / validator.counts.sum(axis=0)))


def refuted(floor: Array, full: CrossValidator) -> Array:
    """The floor, lowered where the model with all effects that entered has a smaller held-out error."""
    return np.asarray(np.minimum(floor, full.base_nrmse() * full.spread))
