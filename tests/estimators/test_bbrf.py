import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import lfilter

from frischid.errors import EmptyBoxError, IdentifiabilityError, InputError, UnknownNameError
from frischid.estimators import bbrf as module
from frischid.estimators.bbrf import Calibration, bbrf
from frischid.estimators.bbrf_windows import window_moments
from frischid.estimators.frisch import simplex

VARIANTS = ("strict", "undo", "calibrated")


def noisy_rows(rng, count, theta, noise=0.3, memory=0.0):
    """Errors-in-variables data: regressors and torque all carry independent noise of the given memory."""
    p = len(theta)

    def draw(columns):
        white = rng.normal(size=(count + 200, columns))
        return lfilter([np.sqrt(1 - memory**2)], [1, -memory], white, axis=0)[200:]

    Y = draw(p)
    return np.column_stack([Y, Y @ theta]) + noise * draw(p + 1)


def names_of(p):
    return [f"p{i}" for i in range(p)]


def direct_port(rows, window, stride, start_lower):
    """Algorithm 1 read off the paper: p + 1 least-squares fits in every window."""
    count = rows.shape[1]
    lower, upper = np.array(start_lower, dtype=float), np.full(count - 1, np.inf)
    history = []
    for start in range(0, len(rows) - window + 1, stride):
        part, vertices = rows[start : start + window], []
        for j in range(count):
            others = np.delete(np.arange(count), j)
            direction = np.full(count, -1.0)
            direction[others] = np.linalg.lstsq(part[:, others], part[:, j])[0]
            vertices.append(direction[:-1] / -direction[-1])
        lower = np.maximum(lower, np.min(vertices, axis=0))
        upper = np.minimum(upper, np.max(vertices, axis=0))
        if (lower > upper).any():
            return lower, upper, start // stride, history
        history.append((lower, upper))
    return lower, upper, None, history


@pytest.mark.parametrize("stride", [1, 3, 40, 100])
def test_equals_the_direct_port(stride):
    rows = noisy_rows(np.random.default_rng(0), 700, np.array([1.0, -1.5, 0.8])) * [1.0, 1e3, 1e-3, 10.0]
    result = bbrf(rows, names_of(3), window=80, stride=stride, signs=[1, 0, 0])
    lower, upper, emptied, history = direct_port(rows, 80, stride, [0.0, -np.inf, -np.inf])
    if emptied is None:
        np.testing.assert_allclose(result.box.lower, lower, rtol=1e-9)
        np.testing.assert_allclose(result.box.upper, upper, rtol=1e-9)
    else:
        assert result.emptied.window == emptied
    np.testing.assert_allclose(result.lower, [low for low, _ in history], rtol=1e-9)
    np.testing.assert_allclose(result.upper, [high for _, high in history], rtol=1e-9)


@pytest.mark.parametrize(("window", "stride"), [(50, 1), (50, 7), (50, 50), (50, 90), (1000, 1)])
def test_rolling_moments_equal_direct_sums(window, stride, monkeypatch):
    monkeypatch.setattr("frischid.estimators.bbrf_windows.BATCH", 16)
    rows = np.random.default_rng(0).normal(size=(1000, 4)) * np.geomspace(1, 100, 1000)[:, None]
    rolled = np.concatenate([batch.moments for batch in window_moments(rows, window, stride)])
    direct = [rows[s : s + window].T @ rows[s : s + window] / window for s in range(0, 1001 - window, stride)]
    np.testing.assert_allclose(rolled, direct, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("still", [0, 200], ids=["moving", "a column rests for a while"])
def test_inverses_that_follow_from_others_are_those_computed_anew(still, monkeypatch):
    rng = np.random.default_rng(1)
    rows = noisy_rows(rng, 1500, rng.normal(size=12))
    rows[600 : 600 + still, 3] = 0.0
    followed = bbrf(rows, names_of(12), window=150, variant="undo")
    monkeypatch.setattr("frischid.estimators.bbrf_windows._followed", lambda *_: None)
    anew = bbrf(rows, names_of(12), window=150, variant="undo")
    assert (followed.skipped, followed.undone) == (anew.skipped, anew.undone)
    assert (followed.skipped > 0) == (still > 0)
    np.testing.assert_allclose(followed.lower, anew.lower, rtol=1e-6)
    np.testing.assert_allclose(followed.upper, anew.upper, rtol=1e-6)


def test_two_inverses_a_batch_of_wide_windows(monkeypatch):
    inverted = []
    inverse = np.linalg.inv
    monkeypatch.setattr(np.linalg, "inv", lambda a: inverted.append(len(a)) or inverse(a))
    rng = np.random.default_rng(0)
    bbrf(noisy_rows(rng, 2000, rng.normal(size=12)), names_of(12), window=500, variant="undo")
    assert sum(inverted) == 2 * -(-1501 // 256)


def test_one_inverse_a_window(monkeypatch):
    inverted = []
    inverse = np.linalg.inv
    monkeypatch.setattr(np.linalg, "inv", lambda a: inverted.append(len(a)) or inverse(a))
    rows = noisy_rows(np.random.default_rng(0), 2000, np.ones(4))
    result = bbrf(rows, names_of(4), window=500, variant="undo")
    assert sum(inverted) == result.windows == 1501


@given(st.integers(0, 2**32 - 1), st.sampled_from(VARIANTS), st.integers(1, 4), st.integers(1, 30))
@settings(deadline=None, max_examples=60)
def test_bounds_never_widen(seed, variant, p, stride):
    rng = np.random.default_rng(seed)
    rows = noisy_rows(rng, 300, rng.normal(size=p), memory=0.5)
    result = bbrf(rows, names_of(p), window=40, stride=stride, variant=variant, signs=[0] * p)
    assert (result.lower <= result.upper).all()
    assert (result.lower[1:] >= result.lower[:-1]).all()
    assert (result.upper[1:] <= result.upper[:-1]).all()
    assert (result.box is None) == (result.emptied is not None)
    if result.box is not None:
        np.testing.assert_array_equal(result.lower[-1], result.box.lower)


def two_machines():
    """Half a log of one machine, half of another: no θ fits both."""
    rng = np.random.default_rng(0)
    first, second = np.array([1.0, 2.0]), np.array([1.0, 5.0])
    return np.vstack([noisy_rows(rng, 400, first, 0.1), noisy_rows(rng, 400, second, 0.1)])


@pytest.mark.parametrize("variant", ["strict", "calibrated"])
def test_contradicting_windows_empty_the_box(variant):
    result = bbrf(two_machines(), ["same", "other"], window=100, stride=100, variant=variant)
    assert result.box is None
    assert result.emptied is not None
    assert result.emptied.parameter == "other"
    assert result.emptied.window == 4
    assert result.windows == 5
    assert result.emptied.lower > result.emptied.upper
    assert result.steps.tolist() == [0, 1, 2, 3]
    with pytest.raises(EmptyBoxError, match="at window 4: parameter other"):
        result.require_box()


def test_undo_leaves_contradicting_windows_out():
    result = bbrf(two_machines(), ["same", "other"], window=100, stride=100, variant="undo")
    first_half = bbrf(two_machines()[:400], ["same", "other"], window=100, stride=100)
    assert result.undone == 4
    np.testing.assert_allclose(result.require_box().lower, first_half.require_box().lower, rtol=1e-12)


@given(st.integers(0, 2**32 - 1))
@settings(deadline=None, max_examples=30)
def test_undo_never_empties(seed):
    rng = np.random.default_rng(seed)
    result = bbrf(rng.normal(size=(200, 4)), names_of(3), window=10, variant="undo", signs=[1, 0, -1])
    assert result.emptied is None
    assert (result.require_box().width >= 0).all()


@pytest.mark.parametrize("memory", [0.0, 0.9])
def test_calibrated_covers_the_truth_where_strict_loses_it(memory):
    theta, runs = np.array([1.2, 0.8, 1.0]), 15
    covered, strict = 0, 0
    for seed in range(runs):
        rows = noisy_rows(np.random.default_rng(seed), 4000, theta, memory=memory)
        covered += bbrf(rows, names_of(3), window=200, variant="calibrated").require_box().contains(theta)
        box = bbrf(rows, names_of(3), window=200).box
        strict += box is not None and box.contains(theta)
    assert covered == runs  # nominal 95 %, and conservative where the truth is no vertex
    assert strict < runs // 2


def test_calibrated_widths_approach_the_population_box():
    theta = np.array([1.2, 0.8])
    moments = np.vstack([np.eye(2), theta]) @ np.vstack([np.eye(2), theta]).T + 0.09 * np.eye(3)
    population = simplex(moments, names_of(2)).box().width
    rows = noisy_rows(np.random.default_rng(0), 40_000, theta)
    excess = [
        (bbrf(rows, names_of(2), window=w, variant="calibrated").require_box().width - population).max()
        for w in (200, 1000, 5000)
    ]
    assert excess[0] > excess[1] > excess[2]
    assert abs(excess[2]) < 0.2 * population.min()


def test_correlated_rows_are_noticed():
    theta = np.array([1.0, 1.0])
    lengths = [
        bbrf(
            noisy_rows(np.random.default_rng(0), 8000, theta, memory=memory),
            names_of(2),
            window=800,
            variant="calibrated",
        ).correlation
        for memory in (0.0, 0.8, 0.99)
    ]
    assert lengths[0] == 13  # 1/64 of a window
    assert 13 < lengths[1] < 100
    assert lengths[2] == 100  # 1/8 of a window


def test_influence_function_gives_the_scatter_of_the_vertices():
    # one parameter: the widened interval minus the vertices, in units of the quantile, is the standard error
    theta, window = np.array([1.0]), 4000
    rows = noisy_rows(np.random.default_rng(0), window * 200, theta)
    low = np.array([e.lower for e in module.sample_extents(rows, window, window)]).ravel()
    wide = np.array([e.lower[0] for e in module.calibrated_extents(rows, window, window, 100, 1.0)]).ravel()
    assert np.mean(low - wide) == pytest.approx(np.std(low), rel=0.12)


@pytest.mark.parametrize("variant", VARIANTS)
def test_singular_windows_are_skipped_and_counted(variant):
    rows = noisy_rows(np.random.default_rng(0), 1000, np.array([1.0, 1.0]))
    rows[300:600, 0] = 0.0  # the first joint rests: windows within this stretch see no motion of it
    result = bbrf(rows, ["a", "b"], window=100, stride=10, variant=variant)
    assert result.skipped == 21
    moving = bbrf(rows, ["a", "b"], window=100, stride=10, variant="undo")
    assert np.isfinite(moving.require_box().width).all()


@pytest.mark.parametrize("variant", VARIANTS)
def test_noise_free_data_skip_every_window(variant):
    Y = np.random.default_rng(0).normal(size=(500, 2))
    rows = np.column_stack([Y, Y @ [1.0, -2.0]])
    result = bbrf(rows, ["a", "b"], window=50, variant=variant, signs=[1, 0])
    assert result.skipped == result.windows
    np.testing.assert_array_equal(result.require_box().lower, [0.0, -np.inf])


def test_windows_in_one_orthant_are_counted():
    rng = np.random.default_rng(0)
    clear = bbrf(noisy_rows(rng, 1000, np.array([1.0, 1.0]), 0.1), ["a", "b"], window=100, variant="undo")
    lost = bbrf(noisy_rows(rng, 1000, np.array([1.0, 0.0]), 0.1), ["a", "b"], window=100, variant="undo")
    assert clear.same_orthant == clear.windows
    assert lost.same_orthant < lost.windows


def test_long_histories_are_thinned(monkeypatch):
    monkeypatch.setattr(module, "HISTORY", 50)
    rows = noisy_rows(np.random.default_rng(0), 600, np.array([1.0]))
    result = bbrf(rows, ["a"], window=80, variant="undo")
    assert len(result.lower) == len(result.steps) <= 51
    assert result.steps[-1] == result.windows - 1
    np.testing.assert_array_equal(result.upper[-1], result.require_box().upper)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"window": 4}, "window of 4 rows .* at least 5.* 60 rows"),
        ({"window": 61}, "window of 61 rows .* 60 rows"),
        ({"window": 20, "stride": 0}, "stride must be at least 1"),
        ({"window": 20, "variant": "calibrated", "calibration": Calibration(correlation=6)}, "is 6 rows; .* 1 to 5"),
        ({"window": 20, "signs": [1]}, "1 signs given for 3"),
    ],
)
def test_unusable_options_say_the_numbers(options, says):
    rows = noisy_rows(np.random.default_rng(0), 60, np.ones(3))
    with pytest.raises(InputError, match=says):
        bbrf(rows, names_of(3), **options)


@pytest.mark.parametrize("confidence", [0.0, 1.0])
def test_a_confidence_is_a_share(confidence):
    with pytest.raises(InputError, match="strictly between 0 and 1, not"):
        Calibration(confidence)


def test_unusable_rows():
    rows = noisy_rows(np.random.default_rng(0), 60, np.ones(3))
    with pytest.raises(UnknownNameError, match="did you mean: strict"):
        bbrf(rows, names_of(3), window=20, variant="strictt")
    with pytest.raises(InputError, match=r"shape \(M, 3\)"):
        bbrf(rows, names_of(2), window=20)
    rows[7, 1] = np.nan
    with pytest.raises(InputError, match="row 7"):
        bbrf(rows, names_of(3), window=20)
    rows[:, 1] = 0.0
    with pytest.raises(IdentifiabilityError, match="p1 is zero"):
        bbrf(rows, names_of(3), window=20)
