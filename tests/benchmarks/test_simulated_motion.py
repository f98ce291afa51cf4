"""The model of the EMPS's score is chosen within the fitted log: its halves hold each sample once."""

import sys
from pathlib import Path

import numpy as np

import frischid as fr

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))

from simulated_motion import halves


def test_the_halves_hold_each_sample_once():
    t = np.arange(101) / 100.0
    log = fr.Log(t, ("slide",), q=np.sin(t)[:, None], tau=np.cos(t)[:, None], extra={"temperature": 20.0 + t})
    first, second = halves(log)
    assert np.array_equal(np.concatenate([first.t, second.t]), t)
    assert np.array_equal(np.concatenate([first.tau, second.tau]), log.tau)
    assert np.array_equal(np.concatenate([x.extra["temperature"] for x in (first, second)]), log.extra["temperature"])
