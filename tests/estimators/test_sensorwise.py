import numpy as np
import pytest
from scipy.stats import t as student

from frischid.errors import IdentifiabilityError, InputError, UnknownNameError
from frischid.estimators.errors_in_variables import covariance_of
from frischid.estimators.frisch import simplex
from frischid.estimators.sensorwise import TORQUE, SensorMoments, sensorwise

THETA = np.array([1.5, -0.7])
NAMES = ("a", "b")


def own_noise(moments, counts):
    """Every variable is its own sensor: the classical scheme."""
    B, n, _ = moments.shape
    noise = np.zeros((n, B, n, n))
    for s in range(n):
        noise[s, :, s, s] = counts
    return SensorMoments(NAMES, ("x", "y", TORQUE), moments, noise)


def one_sensor(moments, counts, gains):
    """One sensor moves both columns by known gains, another only the torque."""
    B = len(moments)
    d = np.append(gains, 0.0)
    noise = np.zeros((2, B, 3, 3))
    noise[0] = np.outer(d, d) * np.reshape(counts, (-1, 1, 1))
    noise[1, :, 2, 2] = counts
    return SensorMoments(NAMES, ("z", TORQUE), moments, noise)


def population(sigmas, B=10, n=100):
    """Moments without sampling error, columns of unit power, correlated by one half."""
    X = np.array([[1.0, 0.5], [0.5, 1.0]])
    full = np.block([[X, (X @ THETA)[:, None]], [(X @ THETA)[None], np.array([[THETA @ X @ THETA]])]])
    return np.repeat(n * (full + np.diag(np.square(sigmas)))[None], B, axis=0), np.full(B, n)


def sampled(rng, sigma, gains, B=40, n=50):
    """One noisy data set of the one-sensor problem."""
    true = rng.normal(size=(B, n, 2)) @ np.linalg.cholesky(np.array([[1.0, 0.5], [0.5, 1.0]])).T
    tau = true @ THETA + sigma[1] * rng.normal(size=(B, n))
    seen = true + sigma[0] * rng.normal(size=(B, n, 1)) * gains
    rows = np.concatenate([seen, tau[..., None]], axis=2)
    return one_sensor(rows.swapaxes(1, 2) @ rows, np.full(B, n), gains)


def test_a_sensor_a_column_is_the_classical_scheme():
    data = own_noise(*population([0.2, 0.1, 0.3]))
    found = sensorwise(data)
    np.testing.assert_allclose(found.vertices, simplex(data.moments.sum(axis=0), NAMES).vertices, rtol=1e-9)
    box = simplex(data.moments.sum(axis=0), NAMES).box()
    np.testing.assert_allclose(found.hull.lower, box.lower, rtol=1e-9)
    np.testing.assert_allclose(found.hull.upper, box.upper, rtol=1e-9)
    assert found.hull.contains(THETA)


@pytest.mark.parametrize("count", [8, 20])
def test_of_a_noisy_torque_alone_the_standard_error_is_that_of_the_blocks(count):
    tau = 2.0 + np.random.default_rng(0).normal(size=(count, 50))
    rows = np.stack([np.ones_like(tau), tau], axis=2)
    noise = np.zeros((2, count, 2, 2))
    noise[0, :, 0, 0] = noise[1, :, 1, 1] = 50.0
    found = sensorwise(SensorMoments(("a",), ("x", TORQUE), rows.swapaxes(1, 2) @ rows, noise), limits={"x": (0, 0)})
    assert found.theta == pytest.approx(tau.mean())
    # the variance that the torque keeps moves a little with each block, the mean hardly
    assert found.covariance[0, 0] == pytest.approx(tau.mean(axis=1).var(ddof=1) / count, rel=0.01)


@pytest.mark.parametrize("count", [8, 20])
def test_every_jackknife_gives_the_standard_error_of_a_mean(count):
    tau = 2.0 + np.random.default_rng(1).normal(size=(count, 50))
    rows = np.stack([np.ones_like(tau), tau], axis=2)
    moments, expected = rows.swapaxes(1, 2) @ rows, tau.mean(axis=1).var(ddof=1) / count
    assert covariance_of(moments[:, :1], np.array([tau.mean()]))[0, 0] == pytest.approx(expected, rel=1e-9)


def test_limits_cut_the_set_down_to_the_truth():
    data = own_noise(*population([0.2, 0.1, 0.3]))
    free = sensorwise(data).hull
    known = sensorwise(data, limits={"x": (0.15, 0.25), "y": (0.0, 0.2)}).hull
    exact = sensorwise(data, limits={"x": (0.2, 0.2), "y": (0.1, 0.1)})
    assert (known.width < 0.7 * free.width).all()
    assert known.contains(THETA)
    np.testing.assert_allclose(exact.theta, THETA, rtol=1e-9)
    np.testing.assert_allclose(exact.hull.width, 0.0, atol=1e-9)
    assert exact.variances[-1] == pytest.approx(0.09)


def test_no_point_of_the_set_lies_outside_the_hull():
    data = own_noise(*population([0.4, 0.3, 0.5]))
    hull = sensorwise(data).hull
    rng = np.random.default_rng(0)
    sums = data.noise.sum(axis=1)
    for d in rng.dirichlet(np.ones(3), 300):
        M = data.moments.sum(axis=0)
        L = np.linalg.inv(np.linalg.cholesky(M))
        w, V = np.linalg.eigh(L @ np.tensordot(d, sums, 1) @ L.T)
        u = L.T @ V[:, -1]
        assert hull.contains(-u[:2] / u[2], tol=1e-9), w[-1]


def test_joint_coverage():
    rng = np.random.default_rng(1)
    gains, sigma = np.array([1.0, 0.4]), (0.2, 0.3)
    covered = [sensorwise(sampled(rng, sigma, gains)).box.contains(THETA) for _ in range(200)]
    assert np.mean(covered) >= 0.93


def test_units_do_not_matter():
    data = sampled(np.random.default_rng(2), (0.2, 0.3), np.array([1.0, 0.4]))
    scale = np.array([1e3, 1e-2, 10.0])
    outer = np.outer(scale, scale)
    other = SensorMoments(
        NAMES, data.sensors, data.moments * outer, data.noise * outer * np.reshape([1e4, 1.0], (2, 1, 1, 1))
    )
    here, there = sensorwise(data), sensorwise(other)
    unit = scale[2] / scale[:2]
    np.testing.assert_allclose(there.box.lower, here.box.lower * unit, rtol=1e-6)
    np.testing.assert_allclose(there.box.upper, here.box.upper * unit, rtol=1e-6)


def test_exact_data_have_one_solution():
    moments, counts = population([0.0, 0.0, 0.0])
    found = sensorwise(own_noise(moments, counts))
    assert found.exact
    np.testing.assert_allclose(found.box.lower, THETA)
    np.testing.assert_allclose(found.box.width, 0.0)


def test_a_sensor_that_could_hide_the_regressor_opens_the_bounds():
    rng = np.random.default_rng(3)
    rows = rng.normal(size=(40, 5, 3))
    data = own_noise(rows.swapaxes(1, 2) @ rows, np.full(40, 5))
    found = sensorwise(data)
    assert np.isinf(found.box.width).any()
    assert "from the data sheet" in found.notes[0]


def test_limits_too_tight_are_noted():
    data = own_noise(*population([0.2, 0.1, 0.3]))
    found = sensorwise(data, limits={"x": (0.0, 0.1), "y": (0.0, 0.1), TORQUE: (0.0, 0.1)})
    assert "the model lacks an effect" in found.notes[0]


def test_what_cannot_be_used_is_said():
    data = own_noise(*population([0.2, 0.1, 0.3]))
    with pytest.raises(UnknownNameError, match="unknown sensor 'gyro'"):
        sensorwise(data, limits={"gyro": (0.0, 1.0)})
    with pytest.raises(InputError, match="lower ≤ upper"):
        sensorwise(data, limits={"x": (2.0, 1.0)})
    with pytest.raises(InputError, match="confidence"):
        sensorwise(data, confidence=1.0)
    with pytest.raises(IdentifiabilityError, match="more error than the log has"):
        sensorwise(data, limits={"x": (3.0, 4.0)})
    short = SensorMoments(NAMES, data.sensors, data.moments[:3], data.noise[:, :3])
    with pytest.raises(IdentifiabilityError, match="3 blocks"):
        sensorwise(short)


@pytest.mark.parametrize(("share", "closed"), [(0.97, False), (1.03, True)])
def test_bounds_close_where_a_t_test_over_blocks_sees_the_slope(share, closed):
    """With all noise in x, θ = ⟨ττ⟩/⟨xτ⟩: the bounds are finite where the mean of ⟨xτ⟩ over blocks is not zero."""
    count = 8
    z = np.random.default_rng(0).normal(size=count)
    z = (z - z.mean()) / z.std(ddof=1)
    t = student.isf(0.025, count - 1)
    slopes = 1e-4 * (z + share * t / np.sqrt(count))  # their own t is `share` of the critical one
    moments = 100 * np.array([[[1.0, c], [c, 1.0]] for c in slopes])
    noise = np.zeros((2, count, 2, 2))
    noise[0, :, 0, 0] = noise[1, :, 1, 1] = 100
    found = sensorwise(SensorMoments(("a",), ("x", TORQUE), moments, noise), confidence=0.95)
    assert np.isfinite(found.box.width[0]) == closed
