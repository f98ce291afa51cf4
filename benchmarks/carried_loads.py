"""How often `diagnose` names a load that a robot carries for a part of a log, and how often it takes a push for one.

Random arms, whose links differ from the URDF's, take a body of random mass and centre and put it down at random times.
The torque has friction, and white noise of 0.5 to 4 % of its standard deviation. Beside the load nothing is missing, or
a spring. In other logs something pushes the arm with a constant or swelling torque, or nothing happens.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from common import parser, publish

import frischid as fr
from frischid.core.types import Array

ROBOTS = ("ur3", "ur5", "ur10", "kinova", "xarm7", "z1", "panda")
KINDS = ("load", "load beside a spring", "steady push", "swelling push", "nothing")
KNOWN_MASS = 3.0  # standard errors
KNOWN_TIME = 0.5  # s


def case(kind: str, seed: int) -> tuple[fr.Robot, fr.Log, float, tuple[float, float]]:
    """A robot, a log, the mass of the body, and when the robot carries it, s from the log's first sample."""
    rng = np.random.default_rng(seed)
    robot = fr.Robot.load(str(rng.choice(ROBOTS)))
    length = float(rng.uniform(15.0, 40.0))
    motion = fr.random_fourier(robot, length, seed=seed)
    urdf = dict(zip(robot.all_names, robot.nominal, strict=True))
    last, total = robot.numbers[robot.joints[-1]], float(robot.nominal[0::10].sum())
    mass = total * float(np.exp(rng.uniform(np.log(0.01), np.log(0.08))))
    body = mass * np.array([1.0, *(0.05 * rng.normal(size=3))])
    heavier = {f"{n}{last}": urdf[f"{n}{last}"] + x for n, x in zip(("m", "mx", "my", "mz"), body, strict=True)}
    own = {f"m{k}": urdf[f"m{k}"] * float(np.exp(0.1 * rng.normal())) for k in robot.numbers.values() if k != last}
    start = float(rng.uniform(0.0, 0.6)) * length
    stop = min(length, start + float(rng.uniform(0.15, 0.5)) * length)
    bare, loaded = (
        fr.simulate(robot, motion, rate=100.0, effects=fr.BASELINE, parameters=own | more, channels=())
        for more in ({}, heavier)
    )
    t, spread = bare.t - bare.t[0], bare.tau.std(axis=0)
    tau = np.where((t >= start) & (t < stop) if "load" in kind else False, loaded.tau.T, bare.tau.T).T
    speed = np.gradient(bare.q, t, axis=0)
    tau = tau + spread * (0.2 * np.tanh(speed / 0.01) + 0.1 * speed) + torque(kind, t, bare.q, spread, rng)
    noise = float(np.exp(rng.uniform(np.log(0.005), np.log(0.04))))
    tau = tau + noise * spread * rng.normal(size=tau.shape)
    q = bare.q + 1e-5 * rng.normal(size=bare.q.shape)
    return robot, replace(bare, q=q, v=None, a=None, tau=tau, source=f"{kind} {seed}"), mass, (start, stop)


def torque(kind: str, t: Array, q: Array, spread: Array, rng: np.random.Generator) -> Array:
    """Torque of a spring on one joint, or of a push, (N, J)."""
    found, joint = np.zeros_like(q), int(rng.integers(q.shape[1]))
    if "spring" in kind:
        found[:, joint] = 0.5 * spread[joint] * (q[:, joint] - q[:, joint].mean()) / q[:, joint].std()
    if "push" in kind:
        start, length = float(rng.uniform(0.1, 0.7)) * t[-1], float(rng.uniform(0.5, 3.0))
        inside = (t >= start) & (t < start + length)
        shape = np.where(inside, 1.0 if "steady" in kind else np.sin(np.pi * (t - start) / length), 0.0)
        reach = np.arange(q.shape[1]) <= max(joint, 1)  # a push turns the joints before the touched link
        found += shape[:, None] * np.where(reach, spread * rng.uniform(0.1, 1.0, q.shape[1]), 0.0)
    return found


def judged(kind: str, seed: int) -> dict[str, Any]:
    """One case."""
    robot, log, mass, (start, stop) = case(kind, seed)
    found = fr.diagnose(fr.identify(robot, [log], recursion="none").model, [log])
    load = found.load
    if load is None or load.mass is None or load.mass_error is None:
        return {"named": load is not None, "mass": False, "times": False}
    (_, first, _), (_, _, last) = load.stretches[0], load.stretches[-1]
    times = [first - log.t[0] - start, last - log.t[0] - stop]
    near = abs(load.mass - mass) < KNOWN_MASS * load.mass_error + 0.02 * mass
    return {"named": True, "mass": near, "times": bool(np.max(np.abs(times)) < KNOWN_TIME)}


def main() -> None:
    """Run the benchmark and print its table."""
    options = parser(__doc__)
    options.add_argument("--cases", type=int, default=40, help="cases of each kind")
    options.add_argument("--seed", type=int, default=900, help="first seed")
    given = options.parse_args()
    rows = []
    for kind in KINDS:
        found = [judged(kind, given.seed + k) for k in range(given.cases)]
        named, mass, times = (sum(x[key] for x in found) for key in ("named", "mass", "times"))
        rows.append({"log": kind, "cases": given.cases, "load named": named, "mass right": mass, "times right": times})
    publish("a load for a part of a log", rows, given.json)


if __name__ == "__main__":
    main()
