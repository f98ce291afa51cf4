"""The prior that is always on: what it says, what it may not do, and how many rows a motion is worth."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from frischid.core.types import Column
from frischid.errors import IdentifiabilityError
from frischid.estimators.held_out import held_out_variance
from frischid.estimators.map_estimate import (
    effective_rows,
    friction_alone,
    map_estimate,
    map_folds,
    shapes,
)
from frischid.estimators.map_problem import MapProblem
from frischid.estimators.parameter_prior import ParameterPrior, ScaleRule
from frischid.regression.moment_blocks import total
from frischid.regression.moments import Gram

NAMES = ("m1", "mx1", "fv1", "Ia1")


def blocks(theta, noise=0.0, samples=400, count=8, seed=0, scale=(1.0, 1.0, 1.0, 1.0)):
    """Moments of a joint with four independent columns."""
    rng = np.random.default_rng(seed)
    columns = tuple(Column(n, "1", "j", "rigid" if n.startswith("m") else "other") for n in NAMES)
    found = []
    for _ in range(count):
        Y = rng.normal(size=(samples // count, 4)) * scale
        Z = np.column_stack([Y, Y @ theta + noise * rng.normal(size=len(Y))])
        found.append(Gram(columns, ("j",), (Z.T @ Z)[None], Z.sum(axis=0)[None], np.array([float(len(Z))])))
    return found


def prior(mean=(1.0, 0.5, 0.0, 0.0), spread=(0.5, 0.3, 1.0, 1.0), negative=0.0):
    return ParameterPrior(
        NAMES,
        np.array(mean),
        np.array(spread),
        ("link", "link", "", ""),
        np.array([False, False, True, True]),
        np.array([0.0, 0.0, 0.0, negative]),
        {},
    )


def test_without_noise_the_log_decides():
    truth = np.array([2.0, -0.7, 0.3, 0.1])
    found = map_estimate(blocks(truth), np.eye(4), prior())
    np.testing.assert_allclose(found.theta, truth, rtol=2e-3)
    assert found.from_log.min() > 0.99


def test_a_column_that_the_log_does_not_show_keeps_its_prior():
    truth = np.array([2.0, -0.7, 0.3, 0.1])
    found = map_estimate(blocks(truth, noise=0.1, scale=(1.0, 1e-6, 1.0, 1.0)), np.eye(4), prior())
    assert found.theta[1] == pytest.approx(0.5, abs=1e-3)
    assert found.from_log[1] < 0.01
    assert found.theta[0] == pytest.approx(2.0, abs=0.1)


def test_known_signs_are_bounds_and_a_contradiction_is_counted_in_standard_errors():
    found = map_estimate(blocks(np.array([1.0, 0.5, -0.8, 0.1]), noise=0.05), np.eye(4), prior())
    assert found.full[2] == 0.0
    contradicted = dict(found.contradicted)
    assert contradicted["fv1"] > 2
    assert "Ia1" not in contradicted


def test_a_parameter_with_a_negative_side_may_go_below_zero():
    truth = np.array([1.0, 0.5, 0.2, -0.3])
    held = map_estimate(blocks(truth, noise=0.05), np.eye(4), prior())
    free = map_estimate(blocks(truth, noise=0.05), np.eye(4), prior(negative=0.5))
    assert held.full[3] == 0.0
    assert free.full[3] == pytest.approx(-0.3, abs=0.06)


def test_a_longer_log_of_the_same_motion_does_not_make_the_model_surer():
    """The model's own error repeats with the motion: ten times the rows, the same covariance."""
    once = blocks(np.array([2.0, -0.7, 0.3, 0.1]), noise=0.3, seed=1)
    often = [replace(b, moments=10 * b.moments, sums=10 * b.sums, counts=10 * b.counts) for b in once]
    one, ten = (map_estimate(b, np.eye(4), prior()) for b in (once, often))
    np.testing.assert_allclose(np.diag(ten.covariance), np.diag(one.covariance), rtol=1e-2)
    np.testing.assert_allclose(ten.theta, one.theta, rtol=1e-2)


def test_a_link_that_is_far_from_the_urdf_gets_a_wide_prior():
    near, far = (
        map_estimate(blocks(np.array(t), noise=0.02), np.eye(4), prior())
        for t in ([1.0, 0.5, 0.3, 0.1], [4.0, -2, 0.3, 0.1])
    )
    assert far.prior.scales["link"] > 3 * near.prior.scales["link"]


def test_an_estimate_is_as_far_off_as_its_covariance_says():
    """Simulated model error: a fixed function of the motion that no column explains, drawn anew in each run."""
    truth, inside = np.array([1.3, 0.3, 0.4, 0.2]), []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        Y = np.cumsum(rng.normal(size=(8, 40, 4)), axis=1)
        # model error: a random quadratic of the columns, the same for equal states
        Q = rng.normal(size=(4, 4)) * 0.02
        columns = tuple(Column(n, "1", "j", "other") for n in NAMES)
        parts = []
        for y in Y:
            tau = y @ truth + np.einsum("ni,ij,nj->n", y, Q, y) / 4
            Z = np.column_stack([y, tau])
            parts.append(Gram(columns, ("j",), (Z.T @ Z)[None], Z.sum(axis=0)[None], np.array([40.0])))
        found = map_estimate(parts, np.eye(4), prior(mean=(1.0, 0.5, 0.0, 0.0)))
        inside.append(np.abs(found.theta - truth) / np.sqrt(np.diag(found.covariance)) < 2.0)
    assert np.mean(inside) > 0.85


@given(st.integers(1, 12), st.floats(1e-3, 1e3))
def test_shapes_count_orthogonal_columns_whatever_their_size(count, scale):
    assert shapes(np.diag(np.full(count, scale))) == pytest.approx(count)
    assert shapes(np.full((count, count), scale)) == pytest.approx(1.0)


def test_rows_are_pairs_of_shapes_of_the_median_joint():
    assert effective_rows(np.stack([np.eye(4), np.eye(4), np.ones((4, 4))])) == pytest.approx(10.0)
    assert effective_rows(np.zeros((2, 3, 3))) == 1.0


def test_friction_alone_leaves_all_others_to_the_urdf():
    known = prior(negative=0.5)
    found = friction_alone(blocks(np.array([1.0, 0.5, 0.3, 0.4])), np.eye(4), known, known.names[2:3])
    np.testing.assert_allclose(found[:2], [1.0, 0.5], atol=1e-3)
    assert found[2] == pytest.approx(0.3, abs=0.05)
    assert found[3] == pytest.approx(0.0, abs=1e-3)


def test_cross_validation_leaves_out_what_it_scores():
    parts = blocks(np.array([1.0, 0.5, 0.3, 0.1]), noise=0.2, samples=80)
    found = map_estimate(parts, np.eye(4), prior())
    held = held_out_variance(map_folds(parts, np.eye(4), found))
    assert held[0] > (sum(b.residual_ss(found.theta) for b in parts) / 80)[0]
    with pytest.raises(IdentifiabilityError, match="too short"):
        map_folds(parts[:1], np.eye(4), found)


def test_no_row_at_all_is_an_error():
    empty = [replace(b, counts=np.zeros(1), moments=0 * b.moments) for b in blocks(np.zeros(4))]
    with pytest.raises(IdentifiabilityError, match="no joint has a torque row"):
        map_estimate(empty, np.eye(4), prior())


def test_the_residual_variance_pays_for_the_parameters_that_were_fitted():
    """σ² = RSS/n · κ/(κ − γ); of four independent columns κ is 10, and a wide prior leaves γ at 4."""
    (whole,) = blocks(np.array([2.0, -0.7, 0.3, 0.1]), noise=0.3, samples=4000, count=1)
    found = map_estimate([whole], np.eye(4), prior(spread=(1e3,) * 4), ScaleRule(least=1.0, most=1.0))
    assert found.rows == pytest.approx(10.0, rel=0.01)
    spent = found.rows / (found.rows - 4.0)
    assert found.variance[0] == pytest.approx(whole.residual_ss(found.theta)[0] / 4000 * spent, rel=0.01)


def test_a_link_that_the_log_does_not_show_keeps_the_scale_one():
    found = map_estimate(
        blocks(np.array([1.0, 0.5, 0.3, 0.1]), noise=0.1, scale=(1e-6, 1e-6, 1, 1)), np.eye(4), prior()
    )
    assert found.prior.scales["link"] == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize("group", ["another link", "another rotor"])
def test_links_share_the_scale_of_their_urdf_and_rotors_do_not(group):
    """The log shows that one link is as the URDF says. Of the group that the log does not show, only a link gains."""
    negative = np.array([0.0, 0.0, 0.0, 0.0 if group == "another link" else 0.1])
    before = replace(prior(), group=("link",) * 3 + (group,), nonnegative=np.zeros(4, bool), negative=negative)
    seen = blocks(np.array([1.0, 0.5, 0.0, 0.1]), noise=1e-3, scale=(1.0, 1.0, 1.0, 1e-6))
    scales = map_estimate(seen, np.eye(4), before).prior.scales
    assert scales["link"] < 0.75
    if group == "another link":
        assert scales["link"] < scales[group] < 0.9
    else:
        assert scales[group] == pytest.approx(1.0, abs=0.01)


def test_the_scale_stays_within_its_bounds():
    exact = blocks(np.array([1.0, 0.5, 0.3, 0.1]), noise=1e-9)
    far = blocks(np.array([20.0, 0.5, 0.3, 0.1]), noise=1e-9)
    rule = ScaleRule(freedom=0.0, least=0.03, most=10.0)
    scales = [map_estimate(b, np.eye(4), prior(), rule).prior.scales["link"] for b in (exact, far)]
    assert scales == [0.03, 10.0]


def test_held_out_stretches_do_not_make_the_prior_stronger():
    """Of stretches that are all alike every one is predicted as well as it was fitted."""
    alike = blocks(np.array([2.0, -0.7, 0.3, 0.1]), noise=0.5, samples=40, count=1) * 5
    found = map_estimate(alike, np.eye(4), prior(spread=(0.05,) * 4))
    fitted = sum(b.residual_ss(found.theta) for b in alike) / sum(b.counts for b in alike)
    np.testing.assert_allclose(held_out_variance(map_folds(alike, np.eye(4), found)), fitted, rtol=1e-6)


def test_a_parameter_at_its_bound_is_not_certain():
    found = map_estimate(blocks(np.array([1.0, 0.5, -0.8, 0.1]), noise=0.3), np.eye(4), prior())
    free = map_estimate(blocks(np.array([1.0, 0.5, 0.8, 0.1]), noise=0.3), np.eye(4), prior())
    assert found.full[2] == 0.0
    assert found.full_covariance[2, 2] > 0.5 * free.full_covariance[2, 2]


def test_a_contradiction_is_the_distance_of_the_free_fit_in_its_standard_errors():
    parts = blocks(np.array([1.0, 0.5, -0.4, 0.1]), noise=0.3, seed=3)
    found, whole = map_estimate(parts, np.eye(4), prior()), total(parts)
    weight = found.rows / (whole.counts * found.variance)
    H = np.einsum("j,jab->ab", weight, whole.moments[:, :-1, :-1]) + np.diag(found.prior.scaled_spread**-2.0)
    b = weight @ whole.moments[:, :-1, -1] + found.prior.mean / found.prior.scaled_spread**2
    kept = [k for k in range(4) if k == 2 or not found.prior.nonnegative[k] or found.full[k] > 0]
    C = np.linalg.inv(H[np.ix_(kept, kept)])
    at = kept.index(2)
    assert dict(found.contradicted)["fv1"] == pytest.approx(-(C @ b[kept])[at] / np.sqrt(C[at, at]), rel=1e-6)


@pytest.mark.parametrize("unit", [1e-8, 1e6])
def test_no_unit_of_a_column_decides(unit):
    """Columns a million times larger, or smaller, have coefficients as much smaller, and nothing else changes."""
    theta, size = np.array([1.2, 0.4, 0.8, 0.1]), np.array([1.0, 1.0, unit, 1.0])
    plain = map_estimate(blocks(theta, 0.1), np.eye(4), prior())
    other = map_estimate(
        blocks(theta / size, 0.1, scale=size), np.eye(4), prior(spread=np.array([0.5, 0.3, 1.0, 1.0]) / size)
    )
    assert other.rows == pytest.approx(plain.rows, rel=1e-9)
    np.testing.assert_allclose(other.theta * size, plain.theta, rtol=1e-8)
    np.testing.assert_allclose(other.variance, plain.variance, rtol=1e-8)


# One column, seen in one row at which the torque is 6, is the sum of the parameters of two links.
SUM, TWO = np.array([[1.0, 1.0]]), ParameterPrior(
    ("m1", "m2"), np.array([1.0, 3.0]), np.array([0.5, 0.5]), ("a", "b"), np.zeros(2, bool), np.zeros(2), {}
)  # fmt: skip
ROW = np.array([[1.0, 6.0]])
ONE = Gram((Column("m1", "kg", "j", "rigid"),), ("j",), (ROW.T @ ROW)[None], ROW, np.ones(1))


def test_a_log_without_noise_outweighs_its_prior_by_twenty_digits():
    """H = AᵀMA + P keeps nothing of P in double precision."""
    rows = MapProblem(ONE, SUM, TWO).rows(np.array([1e20]), TWO.spread**-2)
    np.testing.assert_allclose(rows.solve(), [2.0, 4.0], rtol=1e-6)  # the sum is the log's, the difference the prior's
    root = rows.root()
    np.testing.assert_allclose(np.sum(([1.0, -1.0] @ root) ** 2), 0.5, rtol=1e-6)
    np.testing.assert_allclose(np.sum(([1.0, 1.0] @ root) ** 2), 1e-20, rtol=1e-3)


def test_what_neither_the_log_nor_the_prior_determines_is_an_error():
    with pytest.raises(IdentifiabilityError, match="do not determine every parameter"):
        MapProblem(ONE, SUM, TWO).rows(np.ones(1), np.full(2, 1e-40)).solve()
