"""The benchmark that runs every command on robots that nobody had tuned to: one small trial."""

import sys
from contextlib import chdir
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))

from any_robot import commands, drawn, run

import frischid as fr


def test_every_command_ends_on_a_small_robot(tmp_path):
    trial = drawn(np.random.default_rng([99, 2]), tmp_path)
    assert len(trial.joints) == 2, "a small robot, so that the trial is short"
    with chdir(tmp_path):
        run(trial)
    assert set(trial.ends) == set(commands(trial))
    assert "failed" not in trial.ends.values()
    assert trial.named


def test_the_direction_of_another_joint_is_no_delay(tmp_path):
    """A delay explains two thirds of the error, and a term outside the catalogue all of it."""
    trial = drawn(np.random.default_rng([750, 20]), tmp_path)
    assert (trial.cause, len(trial.joints)) == ("direction of a joint", 2)
    robot = fr.Robot.load(trial.robot).keep(list(trial.joints))
    logs = [fr.read_log(tmp_path / f"log{k}.csv") for k in (0, 1)]
    found = fr.diagnose(fr.identify(robot, logs, recursion="none").model, logs)
    assert found.verdict == "unknown"
    assert "'sign(v1)'" in str(found.description)
