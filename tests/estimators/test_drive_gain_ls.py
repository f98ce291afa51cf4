"""Standard errors of drive gains: where the gain is a mean over blocks of time, that of the mean."""

import numpy as np
import pytest

from frischid.estimators.drive_gain_ls import in_amperes


@pytest.mark.parametrize("count", [6, 20])
def test_the_standard_error_of_a_single_gain_is_that_of_its_blocks(count):
    """One joint, one known torque of equal power in every block: κ is the mean of the blocks' own κ."""
    own = 0.1 + 0.01 * np.random.default_rng(0).normal(size=count)
    blocks = [50 * np.array([[[1.0, k], [k, k**2 + 1e-4]]]) for k in own]  # 50 rows of [w, i], i = κ w + noise
    x, covariance, _ = in_amperes(blocks, np.array([50.0 * count]), np.array([10.0]), np.ones(1), ["the gain"])
    assert x[0] == pytest.approx(own.mean())
    assert covariance[0, 0] == pytest.approx(own.var(ddof=1) / count)


@pytest.mark.parametrize("copies", [4, 16])
def test_copies_of_every_row_are_no_further_information(copies):
    """Correlation inflates the jackknife over the formula for independent rows; the information follows it."""
    own = 0.1 + 0.01 * np.random.default_rng(1).normal(size=20)

    def fitted(rows):
        blocks = [rows * np.array([[[1.0, k], [k, k**2 + 1e-4]]]) for k in own]
        return in_amperes(blocks, np.array([rows * 20.0]), np.array([10.0]), np.ones(1), ["the gain"])

    (_, once, before), (_, often, after) = fitted(50.0), fitted(50.0 * copies)
    np.testing.assert_allclose(often, once)
    assert after[0, 0] < 1.05 * max(before[0, 0], 1 / once[0, 0])
