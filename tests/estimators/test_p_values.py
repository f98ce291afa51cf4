"""P values equal those of scipy.stats, which takes too long to import."""

import numpy as np
import pytest
from scipy import stats

from frischid.estimators.p_values import depends, mean_above, mean_above_zero, ranks_above_zero


@pytest.mark.parametrize("n", [3, 5, 12, 13, 14, 30, 50, 51, 200])
@pytest.mark.parametrize("kind", ["all different", "a zero", "ties", "positive"])
def test_p_values_equal_those_of_scipy(n, kind):
    rng = np.random.default_rng(n)
    x = rng.normal(0.1, 1.0, size=n)
    if kind == "a zero":
        x[0] = 0.0
    if kind == "ties":
        x = np.where(x > 0, 0.5, -0.25) * rng.integers(1, 4, size=n)
    if kind == "positive":
        x = np.abs(x)
    with np.errstate(all="ignore"):
        assert ranks_above_zero(x) == pytest.approx(stats.wilcoxon(x, alternative="greater").pvalue, rel=1e-9)
    assert mean_above_zero(x) == pytest.approx(stats.ttest_1samp(x, 0.0, alternative="greater").pvalue, rel=1e-9)
    y = rng.normal(0.0, 3.0, size=7)
    there = stats.ttest_ind(x, y, equal_var=False, alternative="greater").pvalue
    assert mean_above(x, y) == pytest.approx(there, rel=1e-9)


@pytest.mark.parametrize("ties", [False, True])
@pytest.mark.parametrize("n", [4, 20, 300])
def test_the_p_value_of_a_dependence_equals_that_of_scipy(n, ties):
    rng = np.random.default_rng(n)
    x = rng.normal(size=n)
    y = np.abs(x) + rng.normal(size=n)
    if ties:
        y = np.round(2 * y)
    assert depends(x, y) == pytest.approx(stats.chatterjeexi(x, y).pvalue, rel=1e-9)


def test_a_constant_depends_on_nothing():
    assert depends(np.arange(5.0), np.ones(5)) == 1.0
