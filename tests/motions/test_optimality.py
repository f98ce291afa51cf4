"""What the criteria measure, by their definitions."""

import numpy as np
import pytest

from frischid.motions.optimality import Condition, DOptimal, Paper, Separation, inflation


def flat(W):
    """Rows of all samples and joints, (N J, p)."""
    return W.transpose(0, 2, 1).reshape(-1, W.shape[1])


@pytest.mark.parametrize("count", [1, 2, 3])
def test_separation_slope(count):
    W, direction = np.random.default_rng(2).normal(size=(2, 1, 12, 5, 2))
    criterion, h = Separation(count), 1e-6
    change = (criterion(W + h * direction)[0] - criterion(W - h * direction)[0]) / (2 * h)
    assert (criterion(W)[1] * direction).sum() == pytest.approx(change, rel=1e-5)


def test_separation_is_what_the_rest_leaves_of_the_last_columns():
    W = np.random.default_rng(3).normal(size=(1, 30, 5, 2))
    rows = flat(W[0])
    rest, last = rows[:, :3], rows[:, 3:]
    left = last - rest @ np.linalg.lstsq(rest, last, rcond=None)[0]
    assert Separation(2)(W)[0] == pytest.approx(-np.linalg.slogdet(left.T @ left / 30)[1] / 2)


def test_d_optimal_is_per_sample():
    W = np.random.default_rng(4).normal(size=(1, 30, 4, 2))
    assert DOptimal()(np.concatenate([W, W], axis=1))[0] == pytest.approx(DOptimal()(W)[0])
    assert DOptimal()(W)[0] == pytest.approx(-np.linalg.slogdet(flat(W[0]).T @ flat(W[0]) / 30)[1] / 4)


@pytest.mark.parametrize("draws", [1, 3])
def test_psi_is_the_largest_row_of_the_noises_correlation(draws):
    W = np.random.default_rng(5).normal(size=(1 + draws, 20, 4, 2))
    noise = np.concatenate([flat(moved - W[0]) for moved in W[1:]])
    S = noise.T @ noise / len(noise)
    expected = np.abs(S - np.diag(np.diag(S))).sum(axis=1).max()
    assert Paper(condition=0.0, smallest=0.0, draws=draws)(W)[0] == pytest.approx(expected)


def test_inflation_is_one_over_what_the_others_leave_of_a_column():
    W = np.random.default_rng(6).normal(size=(1, 30, 5, 2))
    W[0, :, 4] = W[0, :, 0] + 0.01 * W[0, :, 4]
    rows = flat(W[0])
    for k, found in enumerate(inflation(W[0])):
        others = np.delete(rows, k, axis=1)
        left = rows[:, k] - others @ np.linalg.lstsq(others, rows[:, k], rcond=None)[0]
        assert found == pytest.approx(np.linalg.norm(rows[:, k]) / np.linalg.norm(left))
        assert found <= Condition()(W)[0]


def test_inflation_of_a_column_without_torque_is_finite():
    W = np.random.default_rng(7).normal(size=(30, 3, 2))
    W[:, 1] = 0.0
    assert np.isfinite(inflation(W)).all()
    assert inflation(W).argmax() == 1
