"""Standard errors that parameters estimate together: where they agree, and where they do not."""

import numpy as np
import pytest
from scipy import stats

from frischid.core.types import Column
from frischid.estimators.least_squares import ols
from frischid.estimators.moderation import moderated, satterthwaite
from frischid.regression.moments import Gram

P, BLOCKS, EACH = 24, 40, 60
COLUMNS = tuple(Column(f"p{i}", "", "joint", "rigid") for i in range(P))


def blocks_of(Y, tau):
    """Moments of stretches of rows."""
    Z = np.column_stack([Y, tau])
    return [Gram(COLUMNS, ("joint",), (z.T @ z)[None], z.sum(axis=0)[None], np.array([len(z)]))
            for z in np.split(Z, BLOCKS)]  # fmt: skip


def sparse_rows(rng):
    """Columns of which half move in four stretches only, as joints that reverse seldom."""
    Y = rng.normal(size=(BLOCKS * EACH, P))
    for i in range(P // 2):
        quiet = np.ones(BLOCKS, bool)
        quiet[rng.choice(BLOCKS, 4, replace=False)] = False
        Y[np.repeat(quiet, EACH), i] *= 0.02
    return Y


def test_all_parameters_at_once_lie_within_their_standard_errors():
    """The jackknife alone held all of a UR10's parameters in three of four logs, at a nominal 95 %."""
    limit, inside, widths = stats.t.ppf(1 - 0.025 / P, BLOCKS - 1), [], []
    for seed in range(120):
        rng = np.random.default_rng(seed)
        Y = sparse_rows(rng)
        estimate = ols(blocks_of(Y, Y @ np.ones(P) + rng.normal(size=len(Y))))
        inside.append((np.abs(estimate.theta - 1.0) <= limit * estimate.stderr).all())
        widths.append(np.median(estimate.stderr / np.sqrt(np.diag(np.linalg.inv(Y.T @ Y)))))
    assert np.mean(inside) >= 0.93
    assert np.median(widths) < 1.3


def test_what_differs_between_parameters_is_kept():
    """Noise in a few columns' directions only: their errors are wider, and those of the others are not."""
    rng = np.random.default_rng(1)
    degrees = np.full(40, 60.0)
    true = np.where(np.arange(40) < 20, 25.0, 1.0)
    found = moderated(true * rng.chisquare(60, 40) / 60, degrees)
    np.testing.assert_allclose(found, true, rtol=0.6)
    together = moderated(rng.chisquare(60, 40) / 60, degrees)
    np.testing.assert_allclose(together, 1.0, rtol=0.1)


def test_few_parameters_keep_their_own():
    ratios = np.array([0.5, 2.0, 1.0])
    np.testing.assert_array_equal(moderated(ratios, np.full(3, 10.0)), ratios)


@pytest.mark.parametrize("count", [1, 7, 30])
def test_degrees_of_freedom_of_equal_shares_are_their_number(count):
    np.testing.assert_allclose(satterthwaite(np.full((count, 2), 3.0)), count)
