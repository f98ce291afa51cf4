"""Motions in closed form: derivatives, rest at the ends, and extremes that no sample beats."""

import numpy as np
import pytest
from cases import joint, link, made, urdf

from frischid.errors import InputError, UnknownNameError
from frischid.motions.families import FAMILIES, Family
from frischid.motions.trajectory import BSpline, Fourier, Quintic, random_fourier
from frischid.robot.robot import Robot

rng = np.random.default_rng(0)
MOTIONS = {
    "fourier": Fourier.rested(rng.normal(size=2), *rng.normal(size=(2, 7, 2)), 10.0),
    "one harmonic": Fourier(np.zeros(2), np.array([[1.0, 0.3]]), np.array([[0.2, 0.0]]), 4.0),
    "quintic": Quintic(np.arange(6.0) + 3.0, *rng.normal(size=(3, 6, 2))),
    "bspline": BSpline.rested(rng.normal(size=(9, 2)), 10.0),
    "still": BSpline.rested(np.ones((6, 2)), 2.0),
}


@pytest.mark.parametrize("motion", MOTIONS.values(), ids=MOTIONS)
def test_derivatives(motion):
    t = np.linspace(0.01, motion.duration - 0.01, 60)
    h = 1e-5
    for order in (1, 2):
        slope = (motion(t + h)[order - 1] - motion(t - h)[order - 1]) / (2 * h)
        np.testing.assert_allclose(motion(t)[order], slope, atol=1e-6 * (1 + np.abs(slope).max()))


@pytest.mark.parametrize("motion", MOTIONS.values(), ids=MOTIONS)
@pytest.mark.parametrize("order", [0, 1, 2])
def test_no_sample_beats_the_extremes(motion, order):
    dense = motion(np.linspace(0.0, motion.duration, 20001))[order]
    for j in range(2):
        t = np.concatenate([[0.0, motion.duration], motion.turning(order, j)])
        assert ((t >= 0) & (t <= motion.duration)).all()
        values = motion(t)[order][:, j]
        assert values.max() >= dense[:, j].max() - 1e-9
        assert values.min() <= dense[:, j].min() + 1e-9


@pytest.mark.parametrize("name", FAMILIES)
@pytest.mark.parametrize("size", [6, 11])
def test_families_are_linear_and_rest_at_both_ends(name, size):
    family = Family.named(name, 5.0, size)
    X = np.random.default_rng(1).normal(size=(len(family.constant), 3))
    t = np.linspace(0.0, 5.0, 40)
    states = np.stack(family.build(X)(t))
    np.testing.assert_allclose(states, family.basis(t) @ X, atol=1e-9)
    np.testing.assert_allclose(states[1:, [0, -1]], 0.0, atol=1e-9)
    still = np.stack(family.build(np.outer(family.constant, [1.0, -2.0, 0.5]))(t))
    np.testing.assert_allclose(still[0], np.tile([1.0, -2.0, 0.5], (40, 1)), atol=1e-12)
    np.testing.assert_allclose(still[1:], 0.0, atol=1e-9)


def test_quintic_meets_its_points():
    motion = MOTIONS["quintic"]
    np.testing.assert_allclose(np.stack(motion(motion.t - motion.t[0])), [motion.q, motion.v, motion.a], atol=1e-9)


def test_random_fourier_keeps_the_limits():
    robot = Robot.load("planar2")
    motion = random_fourier(robot, 10.0, seed=3)
    q, v, _ = motion(np.linspace(0, 10, 2000))
    assert (q <= robot.limits.upper).all()
    assert (q >= robot.limits.lower).all()
    assert (np.abs(v) <= robot.limits.velocity).all()


@pytest.mark.parametrize(("limit", "fastest"), [(0.3, 0.21), (0.0, 1.4)])  # zero: the URDF gives none, 2 rad/s hold
def test_random_fourier_takes_its_share_of_the_speed(limit, fastest):
    inside = f'<limit lower="-3" upper="3" velocity="{limit}" effort="50"/>'
    machine = made(urdf(link("base"), link("a", 3.0), joint("turn", "base", "a", inside=inside)))
    _, v, _ = random_fourier(machine, 10.0, seed=3)(np.linspace(0, 10, 4000))
    assert np.abs(v).max() == pytest.approx(fastest, rel=0.01)


def test_bad_requests():
    with pytest.raises(UnknownNameError, match="bspline"):
        Family.named("spline", 1.0, 5)
    with pytest.raises(InputError, match="at least 6"):
        BSpline(np.zeros((4, 1)), 1.0)
    with pytest.raises(InputError, match="increasing"):
        Quintic(np.zeros(2), *np.zeros((3, 2, 1)))
    with pytest.raises(InputError, match=r"must be 0.01 to 3600 s"):
        random_fourier(Robot.load("planar2"), -1.0, seed=0)


@pytest.mark.parametrize(
    ("points", "words"),
    [
        (([0, np.nan], [[0], [1]], [[0], [0]], [[0], [0]]), "strictly increasing"),
        (([0, 1], [[0], [1]], [[0, 0], [0, 0]], [[0], [0]]), r"v of points .* has the shape \(2, 2\)"),
        (([0, 1], [[0]], [[0]], [[0]]), r"q of points .* has the shape \(1, 1\); expected \(2, J\)"),
        (([0, 1], [[0], [1]], [[0], [np.inf]], [[0], [0]]), "v of point 1 is not finite"),
        (([0, 1], [[0], [1, 2]], [[0], [0]], [[0], [0]]), "q of points to interpolate must be an array of numbers"),
    ],
)
def test_points_that_are_none_are_refused(points, words):
    with pytest.raises(InputError, match=words):
        Quintic(*points)


def test_points_may_be_lists():
    q, _, _ = Quintic([0, 1], [[0], [1]], [[0], [0]], [[0], [0]])(np.array([0.5]))
    assert q.tolist() == [[0.5]]
