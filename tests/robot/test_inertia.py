"""Ten numbers and a distribution of mass are the same body; Pinocchio says so too."""

import numpy as np
import pinocchio as pin
import pytest

from frischid.robot.inertia import dynamic_parameters, is_physical, parameter_transform, pseudo_inertia

THETA = np.random.default_rng(0).normal(size=(3, 10))


def test_pseudo_inertia_is_the_integral_over_the_mass():
    rng = np.random.default_rng(1)
    points, masses = rng.normal(size=(20, 3)), rng.uniform(0.1, 1.0, 20)
    turned = [(p @ p) * np.eye(3) - np.outer(p, p) for p in points]
    inertia = sum(m * part for m, part in zip(masses, turned, strict=True))
    upper = inertia[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]
    theta = np.concatenate([[masses.sum()], masses @ points, upper])
    rows = np.column_stack([points, np.ones(20)])
    np.testing.assert_allclose(pseudo_inertia(theta), (rows * masses[:, None]).T @ rows)
    assert is_physical(theta)
    assert not is_physical(theta - 2 * theta[0] * np.eye(10)[0])


def test_there_and_back():
    np.testing.assert_allclose(dynamic_parameters(pseudo_inertia(THETA)), THETA, atol=1e-14)


@pytest.mark.parametrize("seed", range(3))
def test_a_change_of_frame_is_pinocchios(seed):
    pin.seed(seed)
    body, frame = pin.Inertia.Random(), pin.SE3.Random()
    there = parameter_transform(frame.homogeneous) @ body.toDynamicParameters()
    np.testing.assert_allclose(there, frame.act(body).toDynamicParameters(), atol=1e-12)
