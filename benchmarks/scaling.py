"""Time and memory of identify, compare and diagnose for growing numbers of samples, joints and candidates.

Each case runs in a process of its own, so that the peak of resident memory is that of the case. The log is a recording
that is generated while it is read: a periodic motion, its torque, and fresh noise on both. So the whole log is never in
memory or on a disk. Times are processor time and include the generation. `identify` reads the recording twice;
estimators that use the sensors' noise read it several times. `diagnose` gets two recordings, each predicted by a fit to
the other, and tries the first effects of the catalogue.
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import Any

import numpy as np
from common import parser, publish

import frischid as fr
from frischid.effects import EFFECTS
from frischid.logs.log import Log
from frischid.motions.simulation import torque
from frischid.regression.regressor import nominal_parameters

RATE, PERIOD, CUTOFF = 1000.0, 20.0, 8.0
LIMIT = 400  # MiB at 1e7 samples
ROBOTS = {2: "planar2", 6: "ur10", 7: "panda", 30: "chain"}


def main() -> None:
    """Print the tables."""
    arguments = parser(__doc__)
    arguments.add_argument("--samples", type=float, nargs="+", default=[1e4, 1e5, 1e6, 1e7], help="of a UR10")
    arguments.add_argument("--joints", type=int, nargs="+", default=[2, 6, 7, 30], choices=[*ROBOTS])
    arguments.add_argument("--joint-samples", type=float, default=1e5, help="samples of the robots of other sizes")
    arguments.add_argument("--candidates", type=int, nargs="*", default=[1, 5, 10, 0], help="effects tried, 0 for all")
    arguments.add_argument("--diagnosed", type=float, nargs="*", default=[1e4, 1e5], help="samples diagnosed")
    arguments.add_argument(
        "--estimators", nargs="*", default=["sensorwise", "eiv", "iv"], help="that use the sensors' noise"
    )
    arguments.add_argument("--estimated", type=float, nargs="*", default=[1e5, 3e5], help="samples they are given")
    arguments.add_argument("--case", help="run one case, JSON [kind, ...]; for the benchmark's own processes")
    options = arguments.parse_args()
    if options.case:
        what, first, samples = json.loads(options.case)
        kinds: dict[str, Callable[[Any, int], dict[str, Any]]]
        kinds = {"joints": case, "candidates": diagnosed, "estimator": estimated}
        print(json.dumps(kinds[what](first, int(samples))))
        return
    wanted = [(6, n) for n in options.samples] + [(j, options.joint_samples) for j in options.joints]
    rows = [run("joints", joints, samples) for joints, samples in dict.fromkeys(wanted)]
    asked = [(k, options.diagnosed[0]) for k in options.candidates if options.diagnosed]
    asked += [(0, n) for n in options.diagnosed]
    tried = [run("candidates", k, n) for k, n in dict.fromkeys(asked)]
    sensors = [run("estimator", kind, n) for kind in options.estimators for n in options.estimated]
    longest = max((row for row in rows if row["joints"] == 6), key=lambda row: row["samples"])
    reached = "yes" if longest["peak MiB"] < LIMIT else "NO"
    notes = [f"{longest['samples']:.0e} samples in {longest['peak MiB']:.0f} MiB (target {LIMIT}): {reached}"]
    publish(f"identify and compare, {RATE:g} Hz, low-passed at {CUTOFF:g} Hz", rows, options.json, notes)
    if tried:
        path = options.json and options.json.with_stem(options.json.stem + "_diagnose")
        publish("diagnose, UR10, two recordings", tried, path)
    if sensors:
        path = options.json and options.json.with_stem(options.json.stem + "_estimators")
        publish("estimators that use the sensors' noise, UR10", sensors, path)


def run(what: str, first: int | str, samples: float) -> dict[str, Any]:
    """One case in a process of its own."""
    command = [sys.executable, __file__, "--case", json.dumps([what, first, samples])]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        sys.exit(done.stderr)
    return dict(json.loads(done.stdout))


def case(joints: int, samples: int) -> dict[str, Any]:
    """Identify and compare: µs per sample of each, and the peak of memory."""
    robot = fr.Robot.load(ROBOTS[joints]) if joints != 30 else chain(joints)
    robot = robot.keep(robot.joints[:joints])
    recording = made_up(robot, samples)
    started = resident()
    start = time.process_time()
    for _ in recording.chunks():
        pass
    reading = time.process_time() - start
    start = time.process_time()
    found = fr.identify(robot, [recording], effects=fr.BASELINE, cutoff=CUTOFF, recursion="none")
    identified = time.process_time() - start
    start = time.process_time()
    error = fr.compare(found.model, [recording]).nrmse
    compared = time.process_time() - start
    return {
        "robot": robot.name,
        "joints": joints,
        "samples": samples,
        "base parameters": len(found.model.base),
        "generation µs": 1e6 * reading / samples,
        "identify µs": 1e6 * identified / samples,
        "compare µs": 1e6 * compared / samples,
        "NRMSE": error,
        "MiB at start": started,
        "peak MiB": resident(),
    }


def estimated(estimator: str, samples: int) -> dict[str, Any]:
    """Identify by an estimator that uses the sensors' noise: µs per sample, and the peak of memory."""
    robot = fr.Robot.load(ROBOTS[6])
    start = time.process_time()
    options: dict[str, Any] = {"cutoff": CUTOFF, "recursion": "none", "estimator": estimator}
    fr.identify(robot, [made_up(robot, samples)], effects=fr.BASELINE, **options)
    seconds = time.process_time() - start
    return {
        "estimator": estimator,
        "samples": samples,
        "µs per sample": 1e6 * seconds / samples,
        "peak MiB": resident(),
    }


def diagnosed(kinds: int, samples: int) -> dict[str, Any]:
    """Diagnose with the first `kinds` effects of the catalogue (0: all): ms per candidate, and the peak of memory."""
    robot = fr.Robot.load(ROBOTS[6])
    first, second = (made_up(robot, samples // 2, seed) for seed in (0, 1))
    known = fr.identify(robot, [first], effects=fr.BASELINE, cutoff=CUTOFF, recursion="none").model
    present = {effect.id for effect in fr.BASELINE}
    names = [n for n, kind in EFFECTS.items() if n not in present and kind.candidate != "never" and not kind.change]
    names = names[:kinds] if kinds else names
    places = sum(len(EFFECTS[n].candidates(robot)) for n in names)
    start = time.process_time()
    found = fr.diagnose(known, [first, second], situation="always", effects=names)
    seconds = time.process_time() - start
    return {
        "effects": len(names),
        "places": places,
        "shapes": sum(len(shapes) for n in names for shapes in EFFECTS[n].candidates(robot)),
        "samples": samples,
        "verdict": found.verdict,
        "seconds": seconds,
        "ms per place": 1e3 * seconds / places,
        "peak MiB": resident(),
    }


def resident() -> float:
    """Peak of resident memory so far, MiB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def made_up(robot: fr.Robot, samples: int, seed: int = 0) -> fr.Recording:
    """A generated recording: one period of a motion again and again, each time with fresh noise."""
    count = round(PERIOD * RATE)
    t = np.arange(count) / RATE
    rng = np.random.default_rng(seed)
    J, harmonics = len(robot.joints), np.arange(1, 6)
    a, b = rng.normal(size=(2, 5, J)) / harmonics[:, None]
    angle = 2 * np.pi / PERIOD * np.outer(t, harmonics)
    sin, cos, w = np.sin(angle), np.cos(angle), 2 * np.pi / PERIOD * harmonics[:, None]
    q, v = sin @ a + cos @ b, cos @ (a * w) - sin @ (b * w)
    acceleration = -(sin @ (a * w**2)) - cos @ (b * w**2)
    theta = nominal_parameters(robot, fr.BASELINE)
    tau = torque(robot, fr.BASELINE, theta, t, q, v, acceleration)
    spread = 0.02 * tau.std(axis=0)

    def read(size: int) -> Iterator[Log]:
        pieces = max(1, round(samples / size))
        edges = np.linspace(0, samples, pieces + 1).astype(int)
        for number, (first, last) in enumerate(pairwise(edges)):
            noise = np.random.default_rng([seed, number]).normal(size=(2, last - first, J))
            k = np.arange(first, last)
            yield Log(
                k / RATE,
                robot.joints,
                q[k % count] + 1e-5 * noise[0],
                tau=tau[k % count] + spread * noise[1],
                source=f"made up {seed}",
            )

    return fr.Recording(f"made up {seed}", read)


def chain(joints: int) -> fr.Robot:
    """An arm of equal links; each axis is turned against the one before."""
    text = ['<?xml version="1.0"?><robot name="chain"><link name="l0"/>']
    for i in range(1, joints + 1):
        text.append(
            f'<link name="l{i}"><inertial><origin xyz="0.01 0.02 0.05"/><mass value="1"/>'
            '<inertia ixx="0.01" iyy="0.012" izz="0.008" ixy="0" ixz="0" iyz="0"/></inertial></link>'
            f'<joint name="j{i}" type="revolute"><parent link="l{i - 1}"/><child link="l{i}"/>'
            f'<origin xyz="0 0 0.1" rpy="{1.3 * (-1) ** i} 0 0"/><axis xyz="0 0 1"/>'
            '<limit lower="-3" upper="3" velocity="5" effort="1000"/></joint>'
        )
    return fr.Robot(name="chain", source="made up", urdf="".join([*text, "</robot>"]))


if __name__ == "__main__":
    main()
