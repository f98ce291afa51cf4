import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.optimize import lsq_linear

from frischid.errors import EmptyBoxError, FrischidError, IdentifiabilityError, InputError
from frischid.estimators import box_qp as module
from frischid.estimators.box_qp import select
from frischid.estimators.frisch import Box


def names_of(p):
    return tuple(f"p{i}" for i in range(p))


def problem(seed, p=6, count=80, noise=0.3):
    rng = np.random.default_rng(seed)
    units = 10.0 ** rng.uniform(-3, 3, p)
    W = rng.normal(size=(count, p)) @ rng.normal(size=(p, p)) * units
    theta = rng.normal(size=p) / units
    return W, W @ theta + noise * rng.normal(size=count), theta, units


def moments_of(W, tau):
    rows = np.column_stack([W, tau])
    return rows.T @ rows


@given(st.integers(0, 2**32 - 1), st.sampled_from([0.0, 1e-4, 0.1]))
@example(107638378, 0.0)  # a mixing matrix of condition 1e6, so moments of 4e12
@settings(deadline=None, max_examples=60)
def test_equals_bvls(seed, ridge):
    W, tau, theta, units = problem(seed)
    rng = np.random.default_rng(seed)
    lower = theta + rng.uniform(-1, 0.5, len(theta)) / units
    upper = lower + rng.uniform(0.01, 1, len(theta)) / units
    upper[0], lower[1] = np.inf, -np.inf
    moments, box, norms = moments_of(W, tau), Box(names_of(6), lower, upper), np.linalg.norm(W, axis=0)
    if ridge == 0.0 and np.linalg.cond(moments[:6, :6] / np.outer(norms, norms)) > module.CONDITION_LIMIT:
        with pytest.raises(IdentifiabilityError, match="pass a small ridge"):
            select(moments, box)
        return
    found = select(moments, box, ridge)
    extended = np.vstack([W, np.sqrt(ridge) * np.diag(norms)]) / norms  # bvls needs columns of one size too
    expected = lsq_linear(
        extended, np.append(tau, np.zeros(6)), (lower * norms, upper * norms), method="bvls", tol=1e-14
    )
    np.testing.assert_allclose(found.theta * norms, expected.x, rtol=1e-6, atol=1e-7 * np.linalg.norm(tau))
    assert max(found.primal, found.dual) < 1e-9


@pytest.mark.parametrize("seed", [10, 32, 55, 78, 268, 300])
def test_a_box_as_narrow_as_rounding_allows(seed):
    rng = np.random.default_rng(seed)
    W = rng.normal(size=(80, 9)) @ rng.normal(size=(9, 9))
    tau = W @ rng.normal(size=9) + 0.02 * rng.normal(size=80)
    width = 10.0 ** rng.uniform(-6, -3, 9)
    lower = np.linalg.lstsq(W, tau)[0] + width * rng.uniform(-1, 0.2, 9)
    found = select(moments_of(W, tau), Box(names_of(9), lower, lower + width))
    assert found.dual <= module.KKT_TOLERANCE


def test_an_open_box_gives_least_squares():
    W, tau, _, _ = problem(0)
    found = select(moments_of(W, tau), Box.unbounded(names_of(6)))
    np.testing.assert_allclose(found.theta, np.linalg.lstsq(W, tau)[0], rtol=1e-8)
    assert found.at_bound == ()


def test_noise_free_data_give_the_truth():
    W, tau, theta, _ = problem(0, noise=0.0)
    box = Box(names_of(6), theta - np.abs(theta), theta + np.abs(theta))
    np.testing.assert_allclose(select(moments_of(W, tau), box).theta, theta, rtol=1e-8)


def test_bounds_that_bind_are_met_exactly_and_named():
    W, tau, theta, _ = problem(0, noise=0.0)
    lower = np.full(6, -np.inf)
    lower[2] = theta[2] + abs(theta[2])
    found = select(moments_of(W, tau), Box(names_of(6), lower, np.full(6, np.inf)))
    assert found.theta[2] == lower[2]
    assert found.at_bound == ("p2",)


def test_sums_and_means_give_the_same_answer_with_ridge():
    W, tau, _, _ = problem(0)
    box = Box.unbounded(names_of(6))
    sums, means = select(moments_of(W, tau), box, 0.05), select(moments_of(W, tau) / 80, box, 0.05)
    np.testing.assert_allclose(sums.theta, means.theta, rtol=1e-10)


def test_a_point_is_a_box_too():
    W, tau, theta, _ = problem(0)
    np.testing.assert_array_equal(select(moments_of(W, tau), Box(names_of(6), theta, theta)).theta, theta)


def test_ridge_decides_where_the_data_do_not():
    W, tau, _, _ = problem(0)
    W[:, 1] = W[:, 0]
    box = Box.unbounded(names_of(6))
    with pytest.raises(IdentifiabilityError, match="pass a small ridge"):
        select(moments_of(W, tau), box)
    found = select(moments_of(W, tau), box, 1e-6)
    assert found.theta[0] == pytest.approx(found.theta[1])


def test_ill_conditioned_columns_still_give_least_squares():
    rng = np.random.default_rng(0)
    W = rng.normal(size=(200, 5))
    W[:, 4] = W[:, 3] + 1e-4 * W[:, 4]  # condition number 1e8 of the moments
    theta = np.arange(1.0, 6.0)
    found = select(moments_of(W, W @ theta), Box(names_of(5), np.zeros(5), np.full(5, 10.0)))
    np.testing.assert_allclose(found.theta, theta, rtol=1e-6)


def test_an_empty_box_never_reaches_the_solver(monkeypatch):
    monkeypatch.setattr(module, "_proxqp", lambda *_: pytest.fail("ProxQP was called"))
    W, tau, _, _ = problem(0)
    box = Box(names_of(6), np.zeros(6), np.ones(6))
    box.lower[3] = 2.0  # an array can be written to after the box was checked
    with pytest.raises(EmptyBoxError, match="parameter p3"):
        select(moments_of(W, tau), box)


def test_a_solver_that_gives_up_is_an_error(monkeypatch):
    monkeypatch.setattr(module, "_proxqp", lambda H, g, lower, upper: (np.full(len(g), np.nan), 10_000))
    W, tau, _, _ = problem(0)
    with pytest.raises(FrischidError, match="did not converge in 10000 iterations"):
        select(moments_of(W, tau), Box.unbounded(names_of(6)))


@pytest.mark.parametrize("ridge", [-1.0, np.nan])
def test_unusable_ridge(ridge):
    with pytest.raises(InputError, match="ridge"):
        select(np.eye(2), Box.unbounded(["a"]), ridge)
