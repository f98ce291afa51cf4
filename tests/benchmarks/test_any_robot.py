"""The benchmark that runs every command on robots that nobody had tuned to: one small trial."""

import sys
from contextlib import chdir
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))

from any_robot import commands, drawn, run


def test_every_command_ends_on_a_small_robot(tmp_path):
    trial = drawn(np.random.default_rng([99, 2]), tmp_path)
    assert len(trial.joints) == 2, "a small robot, so that the trial is short"
    with chdir(tmp_path):
        run(trial)
    assert set(trial.ends) == set(commands(trial))
    assert "failed" not in trial.ends.values()
    assert trial.named
