"""Do standard errors hold the truth? Coverage of all parameters at once, under noises that a real log has.

Every run fits one simulated log by `identify` (weighted least squares, no prior). The motion is the same in all runs of
a row, the noise is not. Then

    cover   share of runs in which the estimate ± Bonferroni t × s.e. holds all parameters at once (nominal 95 %),
    worst   the least share of a parameter within 1.96 s.e.,
    width   median over the parameters of s.e. / standard deviation of the estimates over the runs: 1 is ideal,
    bias    largest mean error of a parameter, in standard deviations of its estimates.

The noises: white torque noise of one percent; torque noise with a memory of 0.1 s; encoders of 4096 steps a turn after
a gear of 100, velocities derived; time stamps that are off by 0.5 ms; noise on all channels; and a closed loop, in
which noise of the positions reaches the motors through a controller, and the motion through the motors.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin
from common import parser, publish
from scipy import signal, stats

import frischid as fr
from frischid.core.types import Array
from frischid.effects import BASELINE
from frischid.logs.log import Log
from frischid.motions.simulation import parameters_of, torque
from frischid.motions.trajectory import Trajectory
from frischid.regression.accumulation import MAX_BLOCKS

RATE, SECONDS, SHARE = 200.0, 20.0, 0.01
MEMORY, JITTER, STEP = 0.1, 5e-4, 2 * np.pi / 4096 / 100
POSITION_NOISE, VELOCITY_NOISE = 2e-5, 2e-3
LOOP_RATE, BANDWIDTH = 1000.0, 8.0  # Hz
Recorder = Callable[[fr.Robot, Trajectory, np.random.Generator], Log]


def exact(robot: fr.Robot, motion: Trajectory, t: Array) -> Log:
    """The log of perfect sensors at some times."""
    q, v, a = motion(t)
    tau = torque(robot, BASELINE, parameters_of(robot, BASELINE), t, q, v, a)
    return Log(t, robot.joints, q, tau=tau, source="simulated")


def instants() -> Array:
    """Sampling times, s."""
    return np.arange(round(SECONDS * RATE) + 1) / RATE


def noisy_torque(log: Log, rng: np.random.Generator, memory: float = 0.0) -> Log:
    """Torque noise, white or of first order."""
    assert log.tau is not None
    noise = rng.normal(size=log.tau.shape)
    if memory:
        keep = np.exp(-1.0 / (RATE * memory))
        noise = signal.lfilter([np.sqrt(1 - keep**2)], [1.0, -keep], noise, axis=0)
    return replace(log, tau=log.tau + SHARE * log.tau.std(axis=0) * noise)


def white(robot: fr.Robot, motion: Trajectory, rng: np.random.Generator) -> Log:
    return noisy_torque(exact(robot, motion, instants()), rng)


def first_order(robot: fr.Robot, motion: Trajectory, rng: np.random.Generator) -> Log:
    return noisy_torque(exact(robot, motion, instants()), rng, MEMORY)


def quantised(robot: fr.Robot, motion: Trajectory, rng: np.random.Generator) -> Log:
    log = white(robot, motion, rng)
    start = rng.uniform(0.0, STEP, log.q.shape[1])  # where the encoder's steps lie
    return replace(log, q=STEP * np.round((log.q + start) / STEP) - start)


def jitter(robot: fr.Robot, motion: Trajectory, rng: np.random.Generator) -> Log:
    t = instants()
    true = np.clip(t + JITTER * rng.normal(size=len(t)), 0.0, SECONDS)
    return replace(noisy_torque(exact(robot, motion, true), rng), t=t)


def all_channels(robot: fr.Robot, motion: Trajectory, rng: np.random.Generator) -> Log:
    log = white(robot, motion, rng)
    v = motion(log.t)[1]
    return replace(
        log,
        q=log.q + POSITION_NOISE * rng.normal(size=log.q.shape),
        v=v + VELOCITY_NOISE * rng.normal(size=v.shape),
    )


def closed_loop(robot: fr.Robot, motion: Trajectory, rng: np.random.Generator) -> Log:
    """A controller with the model's torque ahead and feedback of noisy positions and speeds moves the robot."""
    t = np.arange(round(SECONDS * LOOP_RATE) + 1) / LOOP_RATE
    want = motion(t)
    theta = parameters_of(robot, BASELINE)
    ahead = torque(robot, BASELINE, theta, t, *want)
    q, v = want[0][0].copy(), want[1][0].copy()
    model, data = robot.model, robot.model.createData()
    gain = (2 * np.pi * BANDWIDTH) ** 2, 2 * 2 * np.pi * BANDWIDTH
    inertia = np.diag(pin.crba(model, data, robot.configuration(q[None])[0])).copy()
    rub = np.array([robot.dynamics[j] for j in robot.joints])
    width = next(e.parameters["width"] for e in BASELINE if e.id == "coulomb")
    measured, applied = np.empty((2, len(t), len(q)))
    for k in range(len(t)):
        measured[k] = q + POSITION_NOISE * rng.normal(size=q.shape)
        speed = v + VELOCITY_NOISE * rng.normal(size=q.shape)
        applied[k] = ahead[k] + inertia * (gain[0] * (want[0][k] - measured[k]) + gain[1] * (want[1][k] - speed))
        friction = rub[:, 0] * v + rub[:, 1] * np.tanh(v / float(width))
        a = pin.aba(model, data, robot.configuration(q[None])[0], v, applied[k] - friction)
        q = q + v / LOOP_RATE + 0.5 * a / LOOP_RATE**2
        v = v + a / LOOP_RATE
    every = round(LOOP_RATE / RATE)
    log = Log(t[::every], robot.joints, measured[::every], tau=applied[::every], source="simulated")
    return noisy_torque(log, rng)


NOISES: dict[str, Recorder] = {
    "white": white,
    "memory of 0.1 s": first_order,
    "quantised": quantised,
    "jitter": jitter,
    "all channels": all_channels,
    "closed loop": closed_loop,
}


def row(name: str, noise: str, runs: int, seed: int) -> dict[str, Any]:
    """One noise on one robot."""
    robot = fr.Robot.load(name)
    motion = fr.random_fourier(robot, SECONDS, seed=seed)
    estimates, errors = [], []
    for run in range(runs):
        log = NOISES[noise](robot, motion, np.random.default_rng([seed, run]))
        found = fr.identify(robot, [log], effects=BASELINE, prior="none", recursion="none", force=True)
        estimates.append(found.model.estimate.theta)
        errors.append(found.model.estimate.stderr)
    truth = found.reduction.mapping @ parameters_of(robot, BASELINE)
    theta, stderr = np.array(estimates), np.array(errors)
    z = (theta - truth) / stderr
    limit = stats.t.ppf(1 - 0.025 / len(truth), MAX_BLOCKS - 1)
    spread = theta.std(axis=0, ddof=1)
    return {
        "robot": name,
        "noise": noise,
        "runs": runs,
        "cover": float((np.abs(z) <= limit).all(axis=1).mean()),
        "worst": float((np.abs(z) <= 1.96).mean(axis=0).min()),
        "within 1.96": float((np.abs(z) <= 1.96).mean()),
        "width": float(np.median(np.median(stderr, axis=0) / spread)),
        "bias": float(np.abs((theta.mean(axis=0) - truth) / spread).max()),
    }


def main() -> None:
    """Print the table."""
    arguments = parser(__doc__)
    arguments.add_argument("--robots", nargs="+", default=["planar2", "ur10"])
    arguments.add_argument("--noises", nargs="+", default=list(NOISES), choices=list(NOISES))
    arguments.add_argument("--runs", type=int, default=50)
    arguments.add_argument("--seed", type=int, default=7)
    options = arguments.parse_args()
    rows = []
    for name in options.robots:
        for noise in options.noises:
            rows.append(row(name, noise, options.runs, options.seed))
            print({k: round(v, 3) if isinstance(v, float) else v for k, v in rows[-1].items()}, flush=True)
    publish("coverage of standard errors", rows, options.json)


if __name__ == "__main__":
    main()
