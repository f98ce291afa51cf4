"""Armature and damping of every joint of an arm with known links: mujoco.sysid compared with frischid.

MuJoCo simulates one log: torque sines on five joints, positions and velocities with noise. mujoco.sysid simulates the
whole log for every parameter at every iteration and fits the trajectory. frischid solves one linear least-squares
problem of the torques. Both get the same log. mujoco.sysid runs in a process of its own: `pip install "mujoco[sysid]"`
in another environment, and pass its interpreter as `--python`. Times are processor time.
"""

from __future__ import annotations

import statistics
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from common import Worker, parser, publish
from mujoco import rollout

import frischid as fr
from frischid.logs.log import Log

WORKER = Path(__file__).with_name("mujoco_worker.py")
STEP = 0.002
LENGTH = 0.15
ARMATURE, DAMPING = (0.5, 0.4, 0.3, 0.2, 0.1), (1.0, 0.8, 0.6, 0.4, 0.2)
MASSES = (1.0, 0.8, 0.6, 0.4, 0.2)
AXES = ("0 0 1", "0 1 0", "0 1 0", "0 0 1", "0 1 0")


def main() -> None:
    """Print the table."""
    arguments = parser(__doc__)
    arguments.add_argument("--python", default=sys.executable, help="interpreter that has mujoco.sysid")
    arguments.add_argument("--seconds", type=float, nargs="+", default=[2.0, 8.0])
    arguments.add_argument("--noise", type=float, default=1e-5, help="of positions, rad")
    arguments.add_argument("--rounds", type=int, default=2)
    options = arguments.parse_args()
    rows: list[dict[str, Any]] = []
    version = ""
    for seconds in options.seconds:
        t, control, states = simulated(seconds, options.noise)
        times: dict[str, list[float]] = {"frischid": [], "mujoco.sysid": []}
        with tempfile.TemporaryDirectory() as folder:
            (Path(folder) / "arm.xml").write_text(mjcf(), encoding="utf-8")
            start = np.zeros(11)
            start[1:] = states[0]
            inputs = {"t": t, "control": control, "sensor": states[1:], "start": start, "optimizer": "mujoco"}
            ones = np.ones((2, len(ARMATURE)))  # armature and damping
            np.savez(Path(folder) / "inputs.npz", **inputs, guess=0.5 * ones, low=1e-3 * ones, high=5.0 * ones)
            with Worker(options.python, WORKER, folder, 'pip install "mujoco[sysid]"') as other:
                for _ in range(options.rounds):
                    begin = time.process_time()
                    ours = identified(t, control, states)
                    times["frischid"].append(time.process_time() - begin)
                    answer = other.run()
                    times["mujoco.sysid"].append(answer["seconds"])
        version = answer["version"]
        rows_of = zip(("Ia", "fv"), answer["values"], strict=True)
        theirs = {f"{symbol}{i}": x for symbol, row in rows_of for i, x in enumerate(row, start=1)}
        for name, values in (("frischid", ours), ("mujoco.sysid", theirs)):
            rows.append(
                {
                    "tool": name,
                    "samples": len(t),
                    "seconds": statistics.median(times[name]),
                    "× frischid": statistics.median(a / b for a, b in zip(times[name], times["frischid"], strict=True)),
                    "worst error of an armature %": worst(values, "Ia", ARMATURE),
                    "worst error of a damping %": worst(values, "fv", DAMPING),
                }
            )
    notes = [f"five joints, ten unknown parameters, mujoco {version}, median of {options.rounds} rounds"]
    publish("armature and damping of an arm with known links", rows, options.json, notes)


def worst(values: dict[str, float], symbol: str, truth: tuple[float, ...]) -> float:
    """Largest relative error, percent."""
    return 100 * max(abs(values[f"{symbol}{i}"] / x - 1) for i, x in enumerate(truth, start=1))


def identified(t: np.ndarray, control: np.ndarray, states: np.ndarray) -> dict[str, float]:
    """Parameters that frischid finds."""
    robot = fr.Robot(name="arm", source="made up", urdf=urdf())
    known = dict(zip(robot.all_names, map(float, robot.nominal), strict=True))
    robot = fr.Robot(name="arm", source="made up", urdf=urdf(), known=known)
    # A control is constant from one sample to the next: the torque at a sample is the mean of the controls around it.
    tau = (control[1:] + control[:-1]) / 2
    log = Log(t[1:-1], robot.joints, states[1:-1, :5], tau=tau, source="made up")
    effects = fr.parse_effects("viscous, rotor_inertia")
    found = fr.identify(robot, [log], effects=effects, recursion="none")
    estimate = found.model.estimate
    return dict(zip((c.name for c in estimate.columns), map(float, estimate.theta), strict=True))


def simulated(seconds: float, noise: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time (N,), controls (N - 1, 5), positions and velocities with noise (N, 10)."""
    model = mujoco.MjModel.from_xml_string(mjcf(true=True))
    t = np.arange(round(seconds / STEP) + 1) * STEP
    rates, phases = np.array([0.5, 0.7, 0.4, 0.9, 0.6]), np.arange(5) * 0.5
    control = np.array([5.0, 4.0, 3.0, 2.0, 1.0]) * np.sin(2 * np.pi * rates * t[:-1, None] + phases)
    start = np.zeros(11)
    states, _ = rollout.rollout(model, mujoco.MjData(model), start[None], control[None])
    states = np.concatenate([start[None], np.asarray(states)[0]])[:, 1:]
    rng = np.random.default_rng(0)
    return t, control, states + noise * rng.normal(size=states.shape) * np.repeat([1.0, 100.0], 5)


def mjcf(true: bool = False) -> str:
    """The arm for MuJoCo, with the true armature and damping or without."""
    inner = ""
    for i in reversed(range(5)):
        extra = f'armature="{ARMATURE[i]}" damping="{DAMPING[i]}"' if true else ""
        inner = (
            f'<body name="link{i + 1}" pos="0 0 {LENGTH}"><inertial pos="0 0 {LENGTH / 2}" mass="{MASSES[i]}" '
            f'diaginertia="{_inertia(i)}"/><joint name="joint{i + 1}" type="hinge" axis="{AXES[i]}" {extra}/>{inner}'
            "</body>"
        )
    motors = "".join(f'<motor joint="joint{i}"/>' for i in range(1, 6))
    sensors = "".join(
        f'<joint{kind} name="joint{i}_{kind}" joint="joint{i}"/>' for kind in ("pos", "vel") for i in range(1, 6)
    )
    return (
        f'<mujoco><compiler angle="radian"/><option integrator="implicitfast" timestep="{STEP}">'
        f'<flag contact="disable"/></option><worldbody>{inner}</worldbody><actuator>{motors}</actuator>'
        f"<sensor>{sensors}</sensor></mujoco>"
    )


def _inertia(i: int) -> str:
    return f"{0.01 * MASSES[i]} {0.01 * MASSES[i]} {0.005 * MASSES[i]}"


def urdf() -> str:
    """The same arm for frischid."""
    text = ['<?xml version="1.0"?><robot name="arm"><link name="link0"/>']
    for i in range(5):
        text.append(
            f'<link name="link{i + 1}"><inertial><origin xyz="0 0 {LENGTH / 2}"/><mass value="{MASSES[i]}"/>'
            f'<inertia ixx="{0.01 * MASSES[i]}" iyy="{0.01 * MASSES[i]}" izz="{0.005 * MASSES[i]}" ixy="0" ixz="0" '
            f'iyz="0"/></inertial></link><joint name="joint{i + 1}" type="continuous"><parent link="link{i}"/>'
            f'<child link="link{i + 1}"/><origin xyz="0 0 {LENGTH}"/><axis xyz="{AXES[i]}"/>'
            '<limit velocity="50" effort="100"/></joint>'
        )
    return "".join([*text, "</robot>"])


if __name__ == "__main__":
    main()
