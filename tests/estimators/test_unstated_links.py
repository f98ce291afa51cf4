"""URDFs that describe the geometry only: no inertials, or one inertial for all links."""

import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest

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


LARGE = (
    ("0 0 0.675", "0 0 -1", 250, "0.1 0 -0.15", (18, 20, 16)),
    ("0.35 0 0", "0 1 0", 180, "0.5 -0.2 0", (5, 35, 34)),
    ("1.15 0 0", "0 1 0", 200, "0.15 0.02 0.12", (8, 14, 12)),
    ("1.0 0 -0.041", "-1 0 0", 60, "-0.2 0 0", (0.8, 3, 3)),
    ("0 0 0", "0 1 0", 35, "0.03 0 0.01", (0.4, 0.5, 0.4)),
    ("0 0 0", "-1 0 0", 15, "0.18 0.01 0", (0.15, 0.12, 0.12)),
)
"""An arm for 300 kg: place and axis of each joint, mass, centre and moments of each link."""


def large(folder: Path, *, stated: bool) -> Robot:
    """The arm, with its inertials or without."""
    parts = []
    for k, (place, axis, mass, centre, (xx, yy, zz)) in enumerate(LARGE, 1):
        inertia = f'<inertia ixx="{xx}" ixy="0" ixz="0" iyy="{yy}" iyz="0" izz="{zz}"/>'
        inertial = f'<inertial><origin xyz="{centre}"/><mass value="{mass}"/>{inertia}</inertial>' if stated else ""
        limit = '<limit effort="0" lower="-2" upper="2" velocity="3"/>'
        parts += [
            f'<link name="l{k}">{inertial}</link>',
            f'<joint name="a{k}" type="revolute"><origin xyz="{place}"/><parent link="l{k - 1}"/><child link="l{k}"/>'
            f'<axis xyz="{axis}"/>{limit}</joint>',
        ]
    path = folder / f"{'stated' if stated else 'bare'}.urdf"
    path.write_text(f'<robot name="large"><link name="l0"/>{"".join(parts)}</robot>')
    return Robot.load(path)


def test_the_prior_does_no_harm(tmp_path):
    """A prior of a tenth of a kilogram for each link had made the held-out error half as large again as without it."""
    robot, geometry = (large(tmp_path, stated=stated) for stated in (True, False))
    drive = {"fv": 500.0, "fc": 200.0, "Ia": 80.0}
    drives = {f"{name}{k}": value * scale for k, scale in enumerate((1, 1, 0.8, 0.2, 0.2, 0.1), 1)
              for name, value in drive.items()}  # fmt: skip

    def logged(seed: int, seconds: float) -> Log:
        return simulate(
            robot,
            random_fourier(robot, seconds, seed=seed, scale=0.8),
            rate=50.0,
            effects=(*BASELINE, *parse_effects("counterbalance(rest=0.3, ratio=2.5)@a2, load_friction@a3")),
            parameters=drives | {"cp2": -6000.0, "cs2": 1500.0, "fl3": 0.06},
            noise=Noise(q=2e-5, tau=0.01),
            channels=(),
            seed=seed,
        )

    ratios = []
    for seed in (10, 11, 12):
        fit, valid = [logged(seed, 12.0)], [logged(seed + 100, 20.0)]
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
