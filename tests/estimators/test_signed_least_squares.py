"""Least squares over variables of known sign: SciPy's minimum, and the conditions of a minimum."""

import numpy as np
import pytest
from scipy import linalg, optimize

from frischid.estimators.signed_least_squares import nearest


def triangle(seed, widest):
    """A triangle in columns of unit length, whose columns may be nearly alike, with a target and a choice of signs."""
    rng = np.random.default_rng(seed)
    m = int(rng.integers(1, 60))
    rows = rng.normal(size=(2 * m, m)) + 10 ** rng.uniform(-1, widest) * rng.normal(size=(2 * m, 1))
    R = np.linalg.qr(rows / np.linalg.norm(rows, axis=0), mode="r")
    return R, rng.normal(size=m), rng.random(m) < rng.random()


@pytest.mark.parametrize("seed", range(60))
def test_the_minimum_is_scipys(seed):
    R, target, bounded = triangle(seed, 1.0)
    x = nearest(R, target, bounded)
    lower = np.where(bounded, 0.0, -np.inf)
    expected = optimize.lsq_linear(R, target, (lower, np.inf), method="bvls").x
    np.testing.assert_allclose(x, expected, rtol=0, atol=1e-11 * np.abs(expected).max(initial=1.0))
    assert ((x > 1e-12) == (expected > 1e-12))[bounded].all()


@pytest.mark.parametrize("seed", range(20))
def test_no_sign_and_no_slope_is_left_where_columns_are_nearly_alike(seed):
    R, target, bounded = triangle(seed, 4.0)
    x = nearest(R, target, bounded)
    slope = R.T @ (R @ x - target)
    assert (x[bounded] >= 0).all()
    assert (np.abs(slope[~bounded | (x > 0)]) < 1e-9).all()
    assert (slope[bounded & (x == 0)] > -1e-9).all()


def test_without_bounds_the_triangle_is_solved():
    R, target, bounded = triangle(3, 1.0)
    np.testing.assert_array_equal(nearest(R, target, bounded & False), linalg.solve_triangular(R, target))


def test_a_variable_that_was_held_too_early_comes_back():
    """Both variables come out negative one after the other, but only one of them belongs to its bound."""
    found = [triangle(seed, 1.0) for seed in range(60)]
    returned = 0
    for R, target, bounded in found:
        x, free = nearest(R, target, bounded), np.ones(len(R), bool)
        while True:  # hold what is negative, and let nothing return
            z = np.zeros(len(R))
            z[free] = np.linalg.lstsq(R[:, free], target)[0]
            if not (bounded & (z < 0)).any():
                break
            free &= ~(bounded & (z < 0))
        returned += int((x[~free] > 0).any())
        assert np.sum((R @ x - target) ** 2) <= np.sum((R @ z - target) ** 2) * (1 + 1e-12)
    assert returned > 5
