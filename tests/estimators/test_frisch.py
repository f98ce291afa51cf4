import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from frischid.errors import EmptyBoxError, IdentifiabilityError, InputError
from frischid.estimators.frisch import Box, simplex

THETA = np.array([2.0, -0.7, 0.03])
NAMES = ("m", "fv", "Ia")


def noise_free_moments(theta=THETA, correlation=0.3):
    """Return population moments of correlated regressors and their exact torque."""
    p = len(theta)
    regressor = np.full((p, p), correlation) + (1 - correlation) * np.eye(p)
    stack = np.vstack([np.eye(p), theta])
    return stack @ regressor @ stack.T


def random_rows(rng, count=300, p=5, noise=0.5):
    Y = rng.normal(size=(count, p)) @ rng.normal(size=(p, p)) * rng.uniform(0.01, 100, p)
    return np.column_stack([Y, Y @ rng.normal(size=p) + noise * rng.normal(size=count)])


def regress_each_on_the_others(rows):
    """All p + 1 fits, one lstsq each, written as solutions [θ; −1]: the definition of the vertices."""
    count = rows.shape[1]
    vertices = []
    for j in range(count):
        others = np.delete(np.arange(count), j)
        direction = np.full(count, -1.0)
        direction[others] = np.linalg.lstsq(rows[:, others], rows[:, j])[0]
        vertices.append(direction[:-1] / -direction[-1])
    return np.column_stack(vertices)


@pytest.mark.parametrize("seed", range(5))
def test_vertices_are_the_p_plus_1_least_squares_fits(seed):
    rows = random_rows(np.random.default_rng(seed))
    found = simplex(rows.T @ rows / len(rows), list("abcde"))
    np.testing.assert_allclose(found.vertices, regress_each_on_the_others(rows), rtol=1e-7)
    np.testing.assert_allclose(found.ols, np.linalg.lstsq(rows[:, :-1], rows[:, -1])[0], rtol=1e-8)
    assert not found.exact


@given(st.integers(0, 2**32 - 1), st.integers(1, 8))
@settings(deadline=None, max_examples=50)
def test_every_vertex_lies_in_the_box(seed, p):
    rows = random_rows(np.random.default_rng(seed), p=p)
    found = simplex(rows.T @ rows, [f"p{i}" for i in range(p)])
    box = found.box()
    assert all(box.contains(vertex) for vertex in found.vertices.T)


def test_sums_and_means_give_the_same_simplex():
    rows = random_rows(np.random.default_rng(1))
    sums = simplex(rows.T @ rows, list("abcde"))
    means = simplex(rows.T @ rows / len(rows), list("abcde"))
    np.testing.assert_allclose(sums.vertices, means.vertices, rtol=1e-10)


@pytest.mark.parametrize("units", [1.0, np.array([1e-4, 1.0, 1e5, 1e-2])])
def test_noise_free_data_give_the_truth_at_every_vertex(units):
    rng = np.random.default_rng(0)
    Y = rng.normal(size=(200, 3))
    rows = np.column_stack([Y, Y @ THETA]) * units
    found = simplex(rows.T @ rows, NAMES)
    truth = THETA * (1.0 if np.isscalar(units) else units[-1] / units[:-1])
    assert found.exact
    assert found.same_orthant
    assert found.condition < 10
    np.testing.assert_allclose(found.vertices, np.column_stack([truth] * 4), rtol=1e-12)
    assert found.box().contains(truth, tol=1e-9 * np.abs(truth).max())


def test_independent_noise_leaves_the_truth_in_the_box_of_an_orthant():
    found = simplex(noise_free_moments() + np.diag([1e-4, 2e-4, 1e-4, 3e-4]), NAMES)
    assert found.same_orthant
    assert found.disagreeing == ()
    assert found.box().contains(THETA)
    assert not np.allclose(found.ols, THETA, rtol=1e-5)  # least squares alone is biased


@given(st.lists(st.floats(0.0, 0.5), min_size=4, max_size=4))
@settings(deadline=None)
def test_theorem_1_whatever_the_noises(variances):
    found = simplex(noise_free_moments() + np.diag(variances), NAMES)
    if found.same_orthant:
        assert found.box().contains(THETA, tol=1e-9)


def test_one_parameter_lost_in_the_noise_breaks_the_orthant():
    theta, noise = np.array([1.0, 1.0, 0.0]), np.diag([0.3, 0.1, 0.2, 0.1])
    whole = simplex(noise_free_moments(theta, 0.6) + noise, ("m", "fv", "absent"))
    assert not whole.same_orthant
    assert set(whole.disagreeing) == {"m", "fv", "absent"}  # blaming `absent` flips every sign
    without = simplex(noise_free_moments(theta[:2], 0.6) + noise[:3, :3], ("m", "fv"))
    assert without.same_orthant


def test_a_torque_that_ignores_a_column_leaves_the_box_open():
    found = simplex(np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.5], [0.0, 0.5, 1.0]]), ("idle", "used"))
    assert found.box().lower[0] == -np.inf
    assert found.box().upper[0] == np.inf


def test_dependent_columns_are_named():
    rng = np.random.default_rng(0)
    Y = rng.normal(size=(100, 3))
    Y[:, 2] = 2 * Y[:, 1]
    rows = np.column_stack([Y, Y @ THETA + 0.1 * rng.normal(size=100)])
    with pytest.raises(IdentifiabilityError, match=r"condition number .* mostly (fv, Ia|Ia, fv); reduce"):
        simplex(rows.T @ rows, NAMES)


@pytest.mark.parametrize(("zero", "culprit"), [(1, "parameter fv"), (3, "the torque")])
def test_a_variable_without_motion_is_named(zero, culprit):
    moments = noise_free_moments() + np.eye(4)
    moments[zero], moments[:, zero] = 0, 0
    with pytest.raises(IdentifiabilityError, match=culprit):
        simplex(moments, NAMES)


def test_moments_that_cannot_be_moments():
    with pytest.raises(InputError, match=r"shape \(4, 4\)"):
        simplex(np.eye(3), NAMES)
    with pytest.raises(InputError, match="NaN"):
        simplex(np.full((4, 4), np.nan), NAMES)
    with pytest.raises(InputError, match="no parameter"):
        simplex(np.eye(1), ())
    with pytest.raises(InputError, match="negative squared error of the torque"):
        simplex(np.array([[1.0, 2.0], [2.0, 1.0]]), ("m",))


def test_box_operations():
    box = Box(("a", "b"), np.array([-1.0, 0.0]), np.array([1.0, 2.0]))
    np.testing.assert_array_equal(box.width, [2, 2])
    assert box.contains(np.array([1.0, 0.0]))
    assert not box.contains(np.array([1.1, 0.0]))
    assert box.contains(np.array([1.1, 0.0]), tol=0.2)
    signed = box.with_signs([1, 0])
    np.testing.assert_array_equal(signed.lower, [0, 0])
    np.testing.assert_array_equal(box.with_signs([-1, 1]).upper, [0, 2])
    assert Box.unbounded(["a"]).contains(np.array([1e300]))


def test_contradicting_bounds_say_which():
    box = Box(("a", "b"), np.array([-1.0, 1.0]), np.array([1.0, 2.0]))
    with pytest.raises(EmptyBoxError, match="parameter b has lower bound 1 above upper bound 0"):
        box.with_signs([0, -1])
    with pytest.raises(EmptyBoxError) as caught:
        Box(("a", "b"), np.array([2.0, 0.0]), np.array([1.0, 2.0]))
    assert (caught.value.parameter, caught.value.lower, caught.value.upper) == ("a", 2.0, 1.0)
    with pytest.raises(InputError, match="shape"):
        Box(("a",), np.zeros(2), np.ones(2))
    with pytest.raises(InputError, match="NaN"):
        Box(("a",), np.array([np.nan]), np.ones(1))
    with pytest.raises(InputError, match="3 signs"):
        box.with_signs([0, 0, 1])
