"""The quality of a log: noise is that of the sensors, whatever the clock does."""

import numpy as np
import pytest

import frischid as fr
from frischid.model.log_quality import quality


def test_the_noise_of_velocities_is_measured_at_the_times_of_the_samples():
    """With stamps that jitter, the motion between two of them counted as noise: 0.0009 instead of 0.0001 rad/s."""
    robot, rng = fr.Robot.load("planar2"), np.random.default_rng(0)
    motion = fr.random_fourier(robot, 20, seed=1)
    t = np.arange(0.01, 19.9, 0.01)
    logs = []
    for jitter in (0.0, 0.002):
        stamps = t + jitter * rng.uniform(-1, 1, len(t))
        q, v, a = motion(stamps)
        noise = rng.standard_normal((3, *q.shape))
        tau = robot.inverse_dynamics(q, v, a) + 0.01 * noise[0]
        logs.append(fr.Log(stamps, robot.joints, q + 1e-5 * noise[1], v + 1e-4 * noise[2], tau=tau, source=f"{jitter}"))
    model = fr.identify(robot, logs[:1], recursion="none").model
    for found in quality(model, logs):
        assert found.noise["v"] == pytest.approx(1e-4, rel=0.15)
