"""The condition of normal equations is tested without eigenvalues where it is far from the limit."""

import numpy as np
import pytest

from frischid.errors import IdentifiabilityError
from frischid.estimators.normal_equations import WORST_CONDITION, NormalEquations


def moments_of(condition, size=6, seed=0):
    """Moments of rows whose columns, at unit norm, have about this condition number."""
    rng = np.random.default_rng(seed)
    left, right = (np.linalg.qr(rng.normal(size=(n, size)))[0] for n in (50, size))
    Y = left * np.geomspace(1.0, 1.0 / condition, size) @ right.T
    Z = np.column_stack([Y / np.linalg.norm(Y, axis=0), rng.normal(size=50)])
    return Z.T @ Z, float(np.linalg.cond(Z[:, :-1]))


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("condition", np.geomspace(1e1, 1e8, 15))
def test_the_limit_is_that_of_the_eigenvalues(condition, seed):
    moments, true = moments_of(condition, seed=seed)
    names = [f"p{k}" for k in range(6)]
    if true > 1.01 * WORST_CONDITION:
        with pytest.raises(IdentifiabilityError, match="cannot distinguish"):
            NormalEquations(moments, names)
    elif true < 0.99 * WORST_CONDITION:
        assert NormalEquations(moments, names).condition == pytest.approx(true, rel=1e-3 if true < 1e5 else 0.1)
