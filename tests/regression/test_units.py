"""The base parameters of a robot do not depend on the units of its URDF, nor on its size."""

import json
from functools import cache

import numpy as np
import pytest
from click.testing import CliRunner
from scaled_robots import scaled, torque_factor

from frischid.cli import main
from frischid.effects import BASELINE
from frischid.errors import InputError
from frischid.model.identification import identify
from frischid.motions.simulation import Noise, parameters_of, simulate
from frischid.motions.trajectory import random_fourier
from frischid.regression.regressor import Regressor, nominal_parameters
from frischid.regression.structure import MERGED_SHARE, structure
from frischid.robot.robot import Robot
from frischid.robot.scale import RobotScale, dimensions
from frischid.robot.urdf_reading import robot_names

MANY_JOINTS = 20
"""Robots with more joints are left out: their decompositions take seconds."""


@cache
def _loaded(name):
    try:
        return Robot.load(name)
    except InputError:
        return None


NAMES = sorted(n for n in robot_names() if _loaded(n) is not None and len(_loaded(n).joints) <= MANY_JOINTS)


def base_torque(robot, q, v, a):
    """Reduction of a robot, and the torque of its base parameters at some states, (N, J)."""
    regressor = Regressor(robot, BASELINE)
    found = structure(regressor, robot.joints)
    theta = nominal_parameters(robot, BASELINE)
    Y = regressor(np.arange(len(q)) * 1.0, q, v, a)
    return found, np.einsum("npj,p->nj", Y[:, list(found.base)], found.mapping @ theta)


@pytest.mark.parametrize("name", NAMES)
def test_another_unit_of_length_and_mass_changes_nothing(name):
    rng = np.random.default_rng(len(name))
    robot = _loaded(name)
    J = len(robot.joints)
    lower, upper = np.maximum(robot.limits.lower, -3.0), np.minimum(robot.limits.upper, 3.0)
    q, v, a = rng.uniform(lower, upper, (30, J)), rng.normal(size=(30, J)), rng.normal(size=(30, J))
    found, torque = base_torque(robot, q, v, a)
    assert found.cost <= MERGED_SHARE
    length, mass = 10.0 ** rng.uniform(-3.0, 3.0, 2)
    own = np.where(robot.prismatic, length, 1.0)
    other, again = base_torque(scaled(robot, length, mass), q * own, v * own, a * own)
    assert (other.rank, other.base, other.none, other.dependent) == (
        found.rank,
        found.base,
        found.none,
        found.dependent,
    )
    size = np.abs(torque).max(axis=0)
    error = np.abs(again / torque_factor(robot, length, mass) - torque).max(axis=0)
    assert (error <= 1e-9 * np.where(size > 0.0, size, 1.0)).all()


@pytest.mark.parametrize("length", [1e-3, 1e3])
@pytest.mark.parametrize("name", ["ur10", "so101", "panda"])
def test_a_smaller_robot_has_the_same_base_parameters(name, length):
    """The same shape under the same gravity."""
    robot = _loaded(name)
    found, other = (
        structure(Regressor(r, BASELINE), r.joints) for r in (robot, scaled(robot, length, length**3, length**0.5))
    )
    assert (other.base, other.none, other.dependent) == (found.base, found.none, found.dependent)


@pytest.mark.parametrize(("name", "rank"), [("so100", 36), ("so101", 38), ("tiago_pro", 151)])
def test_what_acts_on_the_torque_is_not_merged(name, rank):
    """Angles of so101 are off by 0.01 rad, on purpose: two more parameters act on its first joint."""
    robot = _loaded(name)
    found = structure(Regressor(robot, ()), robot.joints)
    assert found.rank == rank
    assert found.cost <= MERGED_SHARE


def test_merging_prints_its_cost():
    found = structure(Regressor(_loaded("xarm7"), BASELINE), _loaded("xarm7").joints)
    assert 1e-8 < found.cost <= MERGED_SHARE, "1.5708 is not π/2"
    clean = structure(Regressor(_loaded("ur10"), BASELINE), _loaded("ur10").joints)
    assert clean.cost < 1e-9
    printed = CliRunner().invoke(main, ["info", "xarm7", "--json"])
    assert json.loads(printed.stdout)["merging_cost"] == pytest.approx(found.cost)
    assert "merging near-dependencies costs" in " ".join(CliRunner().invoke(main, ["info", "xarm7"]).stdout.split())


def test_a_robot_of_millimetres_is_identified():
    """Links of 0.6 mm: its estimates were thousands of standard errors off."""
    length = 1e-3
    tiny = scaled(_loaded("ur10"), length, length**3, length**0.5)
    motion = random_fourier(tiny, 20.0 * length**0.5, seed=3)
    log = simulate(tiny, motion, rate=200 / length**0.5, noise=Noise(tau=0.01), seed=1)
    found = identify(tiny, [log], effects=BASELINE, prior="none", recursion="none")
    truth = found.reduction.mapping @ parameters_of(tiny, found.model.effects)
    z = (found.model.estimate.theta - truth) / found.model.estimate.stderr
    assert np.sqrt(np.mean(z**2)) < 1.5


def test_dimensions_of_units():
    assert dimensions("kg·m²") == dimensions("N·m·s²/rad") == (1, 2, 0)
    assert dimensions("N·m·s/(rad·K)") == (1, 2, -1)
    assert dimensions("1") == dimensions("") == dimensions("A") == (0, 0, 0)
    assert dimensions("m/N") == (-1, 0, 2)


def test_the_scale_of_a_robot_scales():
    first = RobotScale.of(_loaded("ur10"))
    other = RobotScale.of(scaled(_loaded("ur10"), 10.0, 8.0, 2.0))
    assert other.mass == pytest.approx(8.0 * first.mass)
    assert other.length == pytest.approx(10.0 * first.length)
    assert other.time == pytest.approx(2.0 * first.time)
