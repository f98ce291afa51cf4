"""Correlation of a residual: as of the whole, whatever parts it comes in."""

import numpy as np
import pytest

from frischid.estimators.autocorrelation import FEWEST, LOST, Autocorrelation, correlation_time


def directly(x, lags=400):
    """By the definition."""
    x = x - x.mean()
    rho = np.array([x[k:] @ x[: len(x) - k] for k in range(min(len(x) // 2, lags))]) / (x @ x)
    lost = np.flatnonzero(rho <= LOST)
    return max(1.0, 1 + 2 * rho[1 : lost[0] if len(lost) else len(rho)].sum())


@pytest.mark.parametrize("mean", [0.0, 1e3])
@pytest.mark.parametrize("n", [FEWEST, 37, 399, 400, 801, 3000])
def test_parts_change_nothing(n, mean):
    rng = np.random.default_rng(n)
    x = mean + np.convolve(rng.normal(size=n + 30), np.ones(31) / 31, "valid")
    found = Autocorrelation.of(np.split(x, np.sort(rng.integers(0, n, 5))))
    assert found.std == pytest.approx(x.std(), rel=1e-10)
    assert found.time == pytest.approx(directly(x), rel=1e-10)
    assert correlation_time(x) == pytest.approx(directly(x), rel=1e-10)


def test_a_first_order_process_has_its_time():
    rng, rho = np.random.default_rng(0), 0.9
    x = np.zeros(100_000)
    for k, e in enumerate(rng.normal(size=len(x))):
        x[k] = rho * x[k - 1] + e
    assert correlation_time(x) == pytest.approx((1 + rho) / (1 - rho), rel=0.1)
    assert correlation_time(rng.normal(size=10_000)) == pytest.approx(1.0, abs=0.1)


def test_nothing_has_no_correlation():
    for x in (np.zeros(100), np.full(100, 3.0), np.arange(5.0), np.empty(0)):
        assert correlation_time(x) == 1.0
