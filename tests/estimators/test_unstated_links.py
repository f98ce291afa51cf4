"""URDFs that describe the geometry only: no inertials, or one inertial for all links."""

import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from large_arm import large, log_of_large

from frischid.checks import inspect
from frischid.diagnosis.diagnosis import diagnose
from frischid.effects import BASELINE, parse_effects
from frischid.logs.log import Log
from frischid.model.identification import identify
from frischid.motions.simulation import Noise, simulate
from frischid.motions.trajectory import random_fourier
from frischid.regression.regressor import Regressor
from frischid.regression.structure import structure
from frischid.robot.robot import Robot
from frischid.robot.stated_inertials import link_lengths, unstated
from frischid.robot.urdf_reading import robot_names

ONE = '<inertial><mass value="2"/><inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial>'
DRY = {f"fv{i}": 3.0 for i in range(1, 7)} | {f"fc{i}": 2.0 for i in range(1, 7)} | {f"Ia{i}": 0.3 for i in range(1, 7)}
UR5 = Robot.load("ur5")


@cache
def text() -> str:
    return Path(robot_names()["ur5"]).read_text()


@pytest.fixture(params=["", ONE], ids=["no inertials", "one inertia"])
def geometry(request, tmp_path) -> Robot:
    path = tmp_path / "geometry.urdf"
    path.write_text(re.sub(r"<inertial>.*?</inertial>", request.param, text(), flags=re.DOTALL))
    return Robot.load(path)


@cache
def log_of(seed: int, seconds: float, effects: str = "") -> Log:
    return simulate(
        UR5,
        random_fourier(UR5, seconds, seed=seed, scale=0.8),
        rate=100.0,
        effects=(*BASELINE, *parse_effects(effects)),
        parameters=DRY | ({"ks5": 1.0} if effects else {}),
        noise=Noise(q=1e-5, tau=0.004),
        channels=(),
        seed=seed,
    )


def test_a_urdf_of_geometry_is_recognised(geometry):
    assert unstated(geometry) in {"no inertials", "one mass and inertia for all links"}
    assert not unstated(UR5)
    lengths = link_lengths(UR5)
    assert len(lengths) == 6
    assert lengths[2] == pytest.approx(0.443, abs=0.02)  # the upper arm


def test_masses_that_differ_are_stated(tmp_path):
    """One inertia for all links is a doubt, but the masses hold the gravity."""
    moments = r'ixx="[^"]*" ixy="[^"]*" ixz="[^"]*" iyy="[^"]*" iyz="[^"]*" izz="[^"]*"'
    same = 'ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"'
    path = tmp_path / "masses.urdf"
    path.write_text(re.sub(moments, same, text()))
    assert same in path.read_text()
    assert not unstated(Robot.load(path))


def test_no_fault_of_a_log_is_read_off_links_that_nobody_stated(geometry):
    """With one inertia for all links, `check` had found a wrong zero, a factor of 30 of all torques and a body."""
    report = inspect(geometry, log_of(1, 20.0), lambda: structure(Regressor(geometry, BASELINE), geometry.joints))
    assert not [issue.kind for issue in report.issues if issue.kind != "standstill"]
    assert "cannot be compared" in report.facts["nominal"]


def test_the_prior_does_no_harm(tmp_path):
    """A prior of a tenth of a kilogram for each link had made these held-out errors a fifth larger than without it."""
    robot, geometry = (large(tmp_path, links) for links in ("stated", "none"))
    ratios = []
    for seed in (10, 11, 12):
        fit, valid = [log_of_large(robot, seed, 12.0)], [log_of_large(robot, seed + 100, 20.0)]
        urdf, none = (
            identify(geometry, fit, valid=valid, recursion="none", prior=prior, force=True)
            for prior in ("urdf", "none")
        )
        ratios.append(urdf.comparison.nrmse / none.comparison.nrmse)
        assert any("not from the URDF" in note for note in urdf.notes)
    assert np.exp(np.mean(np.log(ratios))) < 1.05


def test_a_hidden_effect_is_found_without_stated_links(geometry):
    hidden = "joint_spring@wrist_2_joint"
    logs = [log_of(seed, 20.0, hidden) for seed in (1, 2)]
    model = identify(geometry, logs, recursion="none").model
    found = diagnose(model, logs)
    assert found.findings[0].effect == "joint_spring"
    assert found.findings[0].joints == ("wrist_2_joint",)
    assert np.isfinite(found.error)
