"""The benchmark of hidden effects in commanded motion: its robots, and one case from the simulation to the finding."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
pytest.importorskip("mujoco")

from hidden_commanded import KINDS, ROBOTS, case, cases, hidden, one, truth


def test_every_kind_meets_several_robots():
    met = {kind: {name for name, k, _ in cases(len(KINDS) * len(ROBOTS), 0) if k == kind} for kind in KINDS}
    assert all(len(robots) == len(ROBOTS) for robots in met.values())


@pytest.mark.parametrize("kind", KINDS)
def test_a_kind_changes_the_simulated_robot(kind):
    world = truth("elbow3", 3)
    before = np.array(world.model.gravity.linear)
    effect = hidden(kind, world, np.random.default_rng(4))
    text = '<joint name="j1" axis="0 0 1"/><joint name="j2" axis="0 0 1"/><joint name="j3" axis="0 0 1"/>'
    changed = effect.torque is not None or effect.xml(text) != text or effect.late != 2 or effect.gain != 1.0
    assert changed or not np.array_equal(before, world.model.gravity.linear)


def test_a_case_from_the_simulation_to_the_finding():
    robot, logs, controller, effect = case("elbow3", "joint_spring", 0)
    assert [log.has("tau").any() for log in logs] == [False, False]
    assert set(controller.kp) == set(robot.joints)
    row = one("elbow3", "joint_spring", 0)
    assert row["hit"]
    assert row["joint"] == robot.joints[effect.joint]
    assert row["simulated"] < 1.0
