"""A value that a log of commands leaves open is free: other values make up for it, and the motion stays."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
pytest.importorskip("mujoco")

from commanded_free import directions, one
from commanded_mujoco import ROBOTS, recorded

import frischid as fr


def test_values_that_are_not_identified_leave_the_motion() -> None:
    noise = 2 * np.pi / ROBOTS["go2"]["counts"] / np.sqrt(12)
    open_values = [row for row in one("go2", 1) if row["known"] != "identified"]
    assert {row["known"] for row in open_values} == {"roughly"}
    assert all(row["by"] > 0.05 for row in open_values)
    assert all(max(row["moved"], row["moved elsewhere"]) < noise for row in open_values)
    assert all(row["alone"] > 2 * noise for row in open_values)


def test_the_others_are_fitted_again_as_the_posterior_says() -> None:
    """The direction is that of the least rise of the squared error: one unit for a move by one standard error."""
    robot, log, _, controller = recorded("go2", 1)
    model = fr.identify(robot, [log], controller=controller, recursion="none").model
    again, kept, names = directions(model)
    base, k = list(model.base), names.index("fv2")  # a base parameter by itself
    assert again[k, k] == pytest.approx(1.0)
    assert kept[k, k] == 1.0
    rise = again[base, k] @ np.linalg.solve(model.estimate.covariance, again[base, k])
    assert rise == pytest.approx(1.0 / model.estimate.stderr[base.index(k)] ** 2, rel=1e-6)
    assert rise < kept[base, k] @ np.linalg.solve(model.estimate.covariance, kept[base, k])
