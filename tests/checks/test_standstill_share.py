"""The share at standstill that `check` prints is that of the motion, not of the filter's reach around it."""

import numpy as np
import pytest

from frischid.logs.log import Log
from frischid.model.identification import identify
from frischid.model.log_examination import check
from frischid.model.log_quality import quality
from frischid.motions.simulation import Noise, simulate
from frischid.motions.trajectory import random_fourier
from frischid.robot.robot import Robot

ARM = Robot.load("planar2")


def with_pauses(seconds: float) -> Log:
    """A swinging arm that stands still for a while, twenty times."""
    moving = simulate(ARM, random_fourier(ARM, 40.0, seed=1), rate=100.0, noise=Noise(tau=0.01), seed=1)
    held = round(100 * seconds)
    repeats = np.ones(len(moving.t), int)
    repeats[100::200] += held
    rows = np.repeat(np.arange(len(moving.t)), repeats)
    rng = np.random.default_rng(0)
    tau = moving.tau[rows] + 0.01 * rng.standard_normal((len(rows), 2))
    return Log(0.01 * np.arange(len(rows)), moving.joints, moving.q[rows], tau=tau, source="pauses")


def test_check_and_report_say_one_share_at_standstill():
    """On the EMPS `check` had printed 18 %, and the report 1 %, of one log."""
    log = with_pauses(0.3)
    (found,) = check(ARM, [log])
    (of_report,) = quality(identify(ARM, [log], recursion="none").model, [log])
    shares = [found.joints[name]["standstill"] for name in ARM.joints]
    assert shares == pytest.approx(of_report.standstill, abs=0.02)
    assert shares == pytest.approx([6 / 46] * 2, abs=0.02)  # 20 pauses of 0.3 s in 46 s
