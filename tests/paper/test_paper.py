"""The paper, computed again: Table 2 to all printed digits, Tables 3 and 4 within the spread of the runs."""

import json
import os

import numpy as np
import pytest
from browser import needs_browser, opened
from click.testing import CliRunner
from scipy.io import savemat
from widths import assert_whole

from frischid.cli import main
from frischid.cli.pages import paper as pages
from frischid.errors import InputError
from frischid.estimators.frisch import Box
from frischid.motions.trajectory import Quintic
from frischid.paper.author_points import AuthorPoints, load_points
from frischid.paper.monte_carlo import ArmMotion, authors_recursion, deviation_as_printed, study
from frischid.paper.paper_tables import PUBLISHED, costs_19, table_2, table_3, table_4
from frischid.paper.planar_arm import points_arm, reduction, regrouping_error, study_arm
from frischid.paper.printed import COUNTS, PRINTED_PARAMETERS, SEARCHES, TABLE_2
from frischid.paper.reproduction import reproduce_paper
from frischid.robot.robot import Robot

DATA = os.environ.get("FRISCHID_DATA")
needs_points = pytest.mark.skipif(DATA is None, reason="the authors' points: FRISCHID_DATA is not set")
REFERENCE = np.array([row.reference for row in PRINTED_PARAMETERS])


@pytest.fixture(scope="module")
def points():
    return load_points()


def own_points(count=12, noise=None):
    rng = np.random.default_rng(3)
    q, v, a = (limit * rng.uniform(-1, 1, (count, 2)) for limit in (3, 5, 10))
    return AuthorPoints("made up", np.arange(float(count)), q, v, a, noise)


# ---- the arm


def test_the_urdf_has_the_papers_base_parameters():
    arm = points_arm(as_published=False)
    np.testing.assert_allclose(arm.theta, REFERENCE, atol=1e-12)
    for link in Robot.load("planar2_paper").nominal.reshape(-1, 10):
        m, c, inertia = link[0], link[1:4] / link[0], link[[4, 5, 7, 5, 6, 8, 7, 8, 9]].reshape(3, 3)
        about_centre = inertia - m * (c @ c * np.eye(3) - np.outer(c, c))
        assert (np.linalg.eigvalsh(about_centre) > 0).all(), "a link that can exist"


def test_the_links_as_printed_cannot_exist():
    m1, r1x, I1z = 21.0, 0.25, 0.4667
    assert I1z - m1 * r1x**2 == pytest.approx(-0.846, abs=1e-3)


def test_equation_16_is_wrong_as_printed_and_right_without_its_second_term():
    points = own_points()
    for arm in (points_arm(as_published=True), study_arm(as_published=True)):
        assert regrouping_error(arm, points.t, *points.states) > 0.1
    assert regrouping_error(points_arm(as_published=False), points.t, *points.states) < 1e-12


def test_counts_and_choice_of_dependent_columns():
    arm = points_arm(as_published=False)
    found = reduction(arm)
    assert (found.rank, len(found.absolute), len(found.linear)) == (COUNTS["rank"], 5, 7)
    assert len(found.none) + len(arm.regressor.robot.known) == COUNTS["not identifiable"]
    assert {found.columns[i].name for i in found.dependent} == set(arm.dependent)


# ---- Table 2


@needs_points
def test_table_2_to_all_printed_digits(points):
    figures = table_2(points, authors=True).numbers[PUBLISHED]
    for name in ("condition number", "σ_max", "σ_min"):
        assert f"{figures[name]:.4f}" == f"{TABLE_2[name]:.4f}"
    assert sum(search.evaluations for search in SEARCHES) == 399_671


@needs_points
def test_cost_19_with_the_authors_noise(points):
    if points.noise is None:
        pytest.skip("the authors' noise: final.mat is not below FRISCHID_DATA")
    (cost,) = costs_19(points_arm(as_published=True), points, points.noise[None])
    assert cost == pytest.approx(13.57394, abs=5e-6)


def test_cost_19_is_condition_and_smallest_singular_value_and_psi():
    points, arm = own_points(), points_arm(as_published=True)
    noise = np.random.default_rng(0).normal(size=points.states.shape)
    W = arm.rows(points.t, *points.states)
    moved = arm.rows(points.t, *(points.states + noise)) - W
    S = moved.T @ moved / len(moved)
    psi = np.linalg.norm(S - np.diag(S.diagonal()), np.inf)
    values = np.linalg.svd(W, compute_uv=False)
    expected = values[0] / values[-1] + 1 / values[-1] + psi
    np.testing.assert_allclose(costs_19(arm, points, np.stack([noise, 2 * noise]))[0], expected, rtol=1e-9)


# ---- the points' file


def test_points_and_noise_from_the_authors_file(tmp_path):
    noise = np.random.default_rng(1).normal(size=(3, 12, 2))
    given = own_points(noise=noise)
    names = dict(zip(("q", "qd", "qdd", "nq", "nqd", "nqdd"), (*given.states, *noise), strict=True))
    path = tmp_path / "final.mat"
    savemat(path, names)
    found = load_points(path)
    np.testing.assert_array_equal(found.states, given.states)
    np.testing.assert_array_equal(found.noise, noise)
    savemat(path, {name: names[name] for name in ("q", "qd")})
    with pytest.raises(InputError, match=r"final\.mat: variable qdd is missing"):
        load_points(path)
    path.write_text("no such thing")
    with pytest.raises(InputError, match="not a MATLAB file"):
        load_points(path)


def test_without_points_nothing_is_put_in_their_place(tmp_path, monkeypatch):
    monkeypatch.setenv("FRISCHID_DATA", str(tmp_path))
    with pytest.raises(InputError, match=r"no licence.*--points.*--own-motion"):
        load_points()


# ---- the Monte Carlo study


@needs_points
def test_tables_3_and_4_agree_with_the_printed_means(points):
    t = np.arange(4951) / 50.0
    states = np.stack(Quintic(points.t, points.q, points.v, points.a)(t))
    runs = study(ArmMotion.of(study_arm(as_published=True), t, states), 8, as_published=True)
    bounds, chosen = table_3(runs, [], authors=True), table_4(runs, [], REFERENCE, authors=True)
    assert "Every mean agrees" in bounds.notes[-1]
    assert max(bounds.numbers["distances"]) < 4
    assert len(chosen.rows) == 9
    width = np.array(bounds.numbers[PUBLISHED]["θ_max"]["mean"]) - bounds.numbers[PUBLISHED]["θ_min"]["mean"]
    printed = np.array([row.upper.mean - row.lower.mean for row in PRINTED_PARAMETERS])
    np.testing.assert_allclose(width, printed, rtol=0.1)


def test_the_printed_deviation_of_the_lower_bounds_is_a_slip():
    """The printed deviations of θ_min follow from the printed means and deviations of θ_max, and from one θ_min."""
    for row in PRINTED_PARAMETERS:
        n = 250
        slip = np.sqrt(row.upper.deviation**2 * (n - 2) / (n - 1) + (row.upper.mean - row.lower.mean) ** 2 / n)
        assert slip == pytest.approx(row.lower.deviation, rel=0.12), row.symbol
    rng = np.random.default_rng(0)
    lower, upper = rng.normal(-3, 0.1, (250, 9)), rng.normal(3, 0.1, (250, 9))
    np.testing.assert_allclose(deviation_as_printed(lower, upper), np.sqrt(0.1**2 + 6**2 / 250), rtol=0.2)


def test_the_authors_recursion_only_tightens():
    rng = np.random.default_rng(0)
    rows = rng.normal(size=(1400, 10))
    rows[:, -1] = rows[:, :-1] @ REFERENCE + rng.normal(size=1400)
    names = tuple("abcdefghi")
    found = authors_recursion(rows, Box(names, REFERENCE - 100, REFERENCE + 100))
    assert (np.diff(found.lower, axis=0) >= 0).all()
    assert (np.diff(found.upper, axis=0) <= 0).all()
    np.testing.assert_array_equal(found.lower[-1], found.last.lower)


# ---- the command


@pytest.fixture(scope="module")
def own():
    return reproduce_paper(own_motion=True, runs=2, search=False)


def test_everything_is_there_in_the_papers_order(own):
    titles = [table.title.partition(":")[0] for table in own.tables]
    assert titles == ["Equations", "Table 1", "Table 2", "Table 3", "Table 4"]
    assert [d.title.replace("\u00a0", " ")[:8] for d in own.drawings] == [f"Figure {k}" for k in (2, 3, 4)]
    assert not own.authors
    for title in ("Table 3", "Table 4"):
        assert "cannot be compared" in own.table(title).notes[-1]
    json.dumps(own.to_dict(), allow_nan=False)


def test_one_study_alone():
    found = reproduce_paper(own_motion=True, runs=2, which="corrected", search=False)
    assert [table.title.partition(":")[0] for table in found.tables] == ["Equations", "Table 1", "Table 2"]
    assert not any(PUBLISHED in row[1] for row in found.table("Equations").rows)


def test_figure_1_is_the_descent_of_our_own_search(monkeypatch):
    monkeypatch.setattr("frischid.paper.reproduction._SEARCH_BUDGET", 60)
    found = reproduce_paper(own_motion=True, runs=2, which="corrected")
    figure = found.drawings[0].figure
    ours, printed = figure.data
    assert found.drawings[0].title.startswith("Figure\u00a01") or found.drawings[0].title.startswith("Figure 1")
    assert (np.diff(ours.y) <= 0).all()
    assert printed.y[-1] == TABLE_2["cost (19)"]
    assert printed.x[-1] == 399_671


@needs_browser
@pytest.mark.parametrize("width", [1280, 390])
def test_the_page_opens_offline(own, tmp_path, width):
    page, _ = own.write(tmp_path / "out")
    with opened(page.as_uri(), width=width) as seen:
        plots = seen.page.locator(".plot")
        assert plots.count() == 3
        for k in range(3):
            plots.nth(k).scroll_into_view_if_needed()
            plots.nth(k).and_(seen.page.locator("[data-drawn]")).wait_for()
        assert seen.page.evaluate("document.documentElement.scrollWidth <= window.innerWidth")
        assert not seen.complaints
        assert not seen.outside


def test_the_tables_fit_a_narrow_terminal(own):
    assert_whole(pages.reproduction(own, []))


def test_the_command(tmp_path):
    done = CliRunner().invoke(main, ["paper", "--own-motion", "--runs", "2", "--as-corrected"])
    assert done.exit_code == 0, done.output
    for words in ("not the authors' motion", "(16) as corrected", "Table 2: exciting points"):
        assert words in done.output
    refused = CliRunner().invoke(main, ["paper", "--own-motion", "--points", "x.mat"])
    assert (refused.exit_code, "exclude each other" in refused.output) == (2, True)
    few = CliRunner().invoke(main, ["paper", "--own-motion", "--runs", "1"])
    assert (few.exit_code, "at least 2" in few.output) == (2, True)
    before = CliRunner().invoke(main, ["paper", "--own-motion", "--seed", "-1"])
    assert (before.exit_code, "the seed must be" in before.output) == (2, True)
