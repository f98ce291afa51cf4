"""Eq. (24) as printed: the search over quadratic programs finds the minimiser of the cone program."""

import cvxpy as cp
import numpy as np
import pytest

from frischid.errors import EmptyBoxError
from frischid.estimators.frisch import Box
from frischid.estimators.frisch_selection import select_published


def problem(seed, p=5, count=60, noise=2.0, shift=0.0):
    rng = np.random.default_rng(seed)
    W, theta = rng.normal(size=(count, p)) * rng.uniform(0.3, 3.0, p), rng.normal(size=p) + shift
    return W, W @ theta + noise * rng.normal(size=count), theta


def solved(W, tau, lower, upper):
    rows = np.column_stack([W, tau])
    names = tuple(f"p{i}" for i in range(W.shape[1]))
    return select_published(rows.T @ rows, Box(names, lower, upper))


def objective(W, tau, theta):
    return np.linalg.norm(W @ theta - tau) + np.linalg.norm(theta)


@pytest.mark.parametrize("seed", range(6))
def test_equals_the_second_order_cone_program(seed):
    W, tau, theta = problem(seed, shift=3.0 * (seed % 2))
    lower, upper = theta - 0.1 * (seed + 1), theta + 0.3
    lower[0], upper[1] = -np.inf, np.inf
    found = solved(W, tau, lower, upper)
    x = cp.Variable(len(theta))
    constraints = [x[1:] >= lower[1:], x[[0, 2, 3, 4]] <= upper[[0, 2, 3, 4]]]
    cone = cp.Problem(cp.Minimize(cp.norm(W @ x - tau) + cp.norm(x)), constraints)
    cone.solve(solver=cp.CLARABEL)
    np.testing.assert_allclose(found.selection.theta, x.value, atol=1e-4)
    assert found.objective <= objective(W, tau, np.clip(x.value, lower, upper)) + 1e-8
    assert found.ratio == pytest.approx(
        np.linalg.norm(W @ found.selection.theta - tau) / np.linalg.norm(found.selection.theta), rel=1e-6
    )


def test_no_point_of_the_box_is_better():
    W, tau, theta = problem(9)
    lower, upper = theta - 0.2, theta + 0.1
    found = solved(W, tau, lower, upper)
    rng = np.random.default_rng(0)
    others = rng.uniform(lower, upper, (2000, len(theta)))
    near = np.clip(found.selection.theta + 1e-3 * rng.normal(size=others.shape), lower, upper)
    assert min(objective(W, tau, x) for x in [*others, *near]) >= found.objective


def test_without_noise_the_truth_stays():
    W, tau, theta = problem(2, noise=0.0)
    found = solved(W, tau, theta - 1.0, theta + 1.0)
    np.testing.assert_allclose(found.selection.theta, theta, rtol=1e-7)
    assert found.ratio == pytest.approx(0.0, abs=1e-6)


def test_torque_without_weight_leaves_the_point_nearest_to_zero():
    W, tau, _ = problem(3)
    found = solved(1e-3 * W, tau, np.array([0.5, -1.0, -1.0, -1.0, -2.0]), np.array([1.0, 1.0, 1.0, 1.0, -1.0]))
    np.testing.assert_allclose(found.selection.theta, [0.5, 0, 0, 0, -1.0], atol=1e-2)
    zero = solved(1e-3 * W, tau, np.full(5, -1.0), np.full(5, 1.0))
    assert np.isinf(zero.ratio)
    np.testing.assert_array_equal(zero.selection.theta, 0.0)


def test_an_empty_box_is_refused():
    W, tau, _ = problem(4)
    with pytest.raises(EmptyBoxError):
        solved(W, tau, np.ones(5), np.zeros(5))
