"""Diagnosis, excitation and Monte Carlo do their work where `cluster` says, with the same result."""

import subprocess
import sys
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from frischid.core.parallel import Here, workers
from frischid.diagnosis.diagnosis import diagnose
from frischid.effects import BASELINE, parse_effects
from frischid.model.identification import identify
from frischid.motions.plan import plan
from frischid.motions.plan_options import PlanOptions
from frischid.motions.simulation import Noise, simulate
from frischid.motions.trajectory import random_fourier
from frischid.robot.robot import Robot

ARM = Robot.load("planar2")
TRIED = ("joint_spring", "stribeck", "hysteresis", "elasticity")


@pytest.fixture(scope="module")
def process():
    """One process besides this one."""
    with workers("local", 1) as pool:
        yield pool


@cache
def logs():
    effects = (*BASELINE, *parse_effects("joint_spring@joint2"))
    values = {"fv1": 0.2, "fv2": 0.2, "fc1": 0.3, "fc2": 0.3, "ks2": 1.5}
    motions = [random_fourier(ARM, 12.0, seed=k) for k in (1, 2)]
    noise = Noise(q=1e-5, tau=0.01)
    return [simulate(ARM, m, rate=100.0, effects=effects, parameters=values, noise=noise, seed=1) for m in motions]


def test_a_diagnosis_is_the_same_in_another_process(process):
    model = identify(ARM, logs()[:1], recursion="none").model
    here, there = (diagnose(model, logs(), effects=TRIED, workers=pool).to_dict() for pool in (None, process))
    assert here["findings"][0]["effect"] == "joint_spring"
    assert there == here


def test_starts_of_a_search_are_the_same_in_another_process(process):
    options = PlanOptions(duration=4.0, samples=30, budget=150, seed=3, starts=2)
    plain, here, there = (plan(ARM, options=options, workers=pool) for pool in (None, Here(), process))
    t = np.linspace(0.0, 4.0, 50)
    for other in (here, there):
        assert other.cost == pytest.approx(plain.cost, rel=1e-10)
        np.testing.assert_allclose(other.trajectory(t)[0], plain.trajectory(t)[0], rtol=1e-10, atol=1e-12)
    single = plan(ARM, options=replace(options, starts=1))
    assert plain.cost <= single.cost
    assert plain.evaluations > single.evaluations


INTERRUPTED = """
import os, signal, sys, threading, time
from frischid.core.parallel import workers
if __name__ == "__main__":
    try:
        with workers("local", 2) as pool:
            threading.Timer(0.5, lambda: os.killpg(0, signal.SIGINT)).start()
            pool.gather(pool.map(time.sleep, [30, 30]))
    except KeyboardInterrupt:
        sys.exit(130)
"""


def test_ctrl_c_reaches_this_process_and_no_worker(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(INTERRUPTED)
    done = subprocess.run(
        [sys.executable, str(script)], capture_output=True, text=True, timeout=600, start_new_session=True, check=False
    )
    assert done.returncode == 130
    assert "Traceback" not in done.stderr
    assert "KeyboardInterrupt" not in done.stderr
