"""Rules of least squares from moments: blocks and whole agree, weights are of the noise, copies of data add nothing."""

from dataclasses import replace

import numpy as np
import pytest

from frischid.core.types import Column
from frischid.estimators.held_out import held_out_variance
from frischid.estimators.least_squares import Prior, least_squares_folds, ols, wls
from frischid.regression.moment_blocks import total
from frischid.regression.moments import Gram

JOINTS, P, BLOCKS, EACH_BLOCK = ("base", "wrist"), 4, 40, 50
COLUMNS = tuple(Column(f"p{i}", "", "base", "rigid") for i in range(P))
TRUTH, NOISE = np.array([1.0, -2.0, 0.5, 3.0]), np.array([1.0, 0.1])


def gram(Y, tau):
    """Moments of rows Y (N, J, p) and torques (N, J)."""
    Z = np.concatenate([Y, tau[:, :, None]], axis=2)
    moments = np.einsum("nja,njb->jab", Z, Z)
    return Gram(COLUMNS, JOINTS, moments, Z.sum(axis=0), np.full(len(JOINTS), len(Z)))


def rows(seed=0):
    rng = np.random.default_rng(seed)
    Y = rng.normal(size=(BLOCKS * EACH_BLOCK, len(JOINTS), P))
    return Y, Y @ TRUTH + rng.normal(size=Y.shape[:2]) * NOISE


def blocks_of(Y, tau):
    return [gram(y, t) for y, t in zip(np.split(Y, BLOCKS), np.split(tau, BLOCKS), strict=True)]


def test_blocks_give_what_the_rows_give():
    Y, tau = rows()
    estimate = wls(blocks_of(Y, tau))
    root = np.sqrt(estimate.weights)[None, :]
    direct = np.linalg.lstsq((Y * root[..., None]).reshape(-1, P), (tau * root).ravel(), rcond=None)[0]
    np.testing.assert_allclose(estimate.theta, direct, rtol=1e-9)
    whole = gram(Y, tau)
    np.testing.assert_allclose(total(blocks_of(Y, tau)).moments, whole.moments, rtol=1e-12, atol=1e-9)


def test_weights_are_the_inverse_noise_variances():
    estimate = wls(blocks_of(*rows()))
    np.testing.assert_allclose(estimate.weights, estimate.sigma**-2.0, rtol=1e-3)
    np.testing.assert_allclose(estimate.sigma, NOISE, rtol=0.1)
    assert ols(blocks_of(*rows())).weights.tolist() == [1.0, 1.0]


def test_the_information_of_independent_rows_is_the_inverse_covariance():
    estimate = wls(blocks_of(*rows()))
    share = np.diag(np.linalg.inv(estimate.information)) / np.diag(estimate.covariance)
    assert (share > 0.5).all()
    assert (share < 2.0).all()


@pytest.mark.parametrize("copies", [4, 16])
@pytest.mark.parametrize("fit", [wls, ols, lambda parts: wls(parts, prior=Prior(np.zeros(P), 1e-6 * np.eye(P)))])
def test_copies_of_every_row_are_no_further_information(fit, copies):
    # The extreme of correlated residuals: each row `copies` times over. Values, standard errors and information stay.
    once = blocks_of(*rows())
    copied = [total([block] * copies) for block in once]
    before, after = fit(once), fit(copied)
    np.testing.assert_allclose(after.theta, before.theta, rtol=1e-5)
    np.testing.assert_allclose(after.stderr, before.stderr, rtol=0.35)
    shares = np.diag(after.information) / np.diag(before.information)
    assert (shares < 1.4).all(), f"{copies} copies count as {shares.max():.1f} times the information"
    assert (shares > 0.6).all()


@pytest.mark.parametrize("count", [10, 20])
def test_the_standard_error_of_a_mean_is_that_of_its_blocks(count):
    tau = 2.0 + np.random.default_rng(0).normal(size=(count, EACH_BLOCK))
    blocks = []
    for values in tau:
        z = np.column_stack([np.ones(EACH_BLOCK), values])
        blocks.append(Gram(COLUMNS[:1], JOINTS[:1], (z.T @ z)[None], z.sum(axis=0)[None], np.array([len(z)])))
    estimate = wls(blocks)
    assert estimate.theta == pytest.approx(tau.mean())
    assert estimate.covariance[0, 0] == pytest.approx(tau.mean(axis=1).var(ddof=1) / count, rel=1e-9)


def test_cross_validation_is_a_refit_without_each_fifth():
    Y, tau = rows()
    parts = blocks_of(Y, tau)
    estimate = wls(parts)
    held, root = np.zeros(len(JOINTS)), np.sqrt(estimate.weights)[None, :]
    for fold in np.array_split(np.arange(BLOCKS), 5):
        out = np.zeros(len(Y), bool)
        out[fold[0] * EACH_BLOCK : (fold[-1] + 1) * EACH_BLOCK] = True
        A, b = (Y * root[..., None])[~out].reshape(-1, P), (tau * root)[~out].ravel()
        theta = np.linalg.lstsq(A, b, rcond=None)[0]
        held += ((tau - Y @ theta)[out] ** 2).sum(axis=0)
    left_out = held_out_variance(least_squares_folds(parts, estimate.weights))
    np.testing.assert_allclose(left_out, held / len(Y), rtol=1e-8)


def test_a_prior_is_counted_once_and_not_once_per_block():
    parts, prior = blocks_of(*rows()), Prior(np.zeros(P), 1e4 * np.eye(P))
    estimate, whole = wls(parts, prior=prior), total(blocks_of(*rows()))
    H = whole.weighted(estimate.weights)
    np.testing.assert_allclose(estimate.theta, np.linalg.solve(H[:P, :P] + prior.precision, H[:P, P]), rtol=1e-8)
    few = wls([total(parts[:20]), total(parts[20:])], prior=prior)
    np.testing.assert_allclose(few.theta, estimate.theta, rtol=1e-3)


def test_parameters_that_the_logs_hardly_determine_are_named():
    """Without a prior by their standard error, with one by the share of the knowledge that comes from the logs."""
    Y, tau = rows()
    found = wls(blocks_of(Y, tau - Y[:, :, 2] * TRUTH[2]))
    assert found.hardly_known == ("p2",)
    assert replace(found, from_data=np.array([0.9, 0.4, 0.6, 0.1])).hardly_known == ("p1", "p3")
