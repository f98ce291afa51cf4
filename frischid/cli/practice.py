"""A folder with a robot, logs and a model, in which every command of the guides runs as it is printed.

The robot is a planar arm with a spring at joint 2 that its model does not know. `frischid demo --practice FOLDER`
writes the folder.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from frischid.core.files import write_text
from frischid.core.types import Array
from frischid.effects import BASELINE, parse_effects
from frischid.export.export import export
from frischid.logs.log import Log
from frischid.logs.readers import read_log, write_log
from frischid.logs.table_writing import write_table
from frischid.model.identification import identify
from frischid.motions.simulation import Noise, simulate
from frischid.motions.trajectory import random_fourier
from frischid.robot.robot import Robot

HIDDEN_VALUES = {
    "fv1": 0.4,
    "fc1": 0.6,
    "Ia1": 0.12,
    "off1": 0.4,
    "fv2": 0.3,
    "fc2": 0.5,
    "Ia2": 0.2,
    "off2": -0.2,
    "ks2": 1.5,
}
ARM = (*BASELINE, *parse_effects("joint_spring@joint2"))
SENSORS = Noise(q=2e-5, tau=0.01)


def record(robot: Robot, seed: int, values: dict[str, float] | None = None, payload: bool = False) -> Log:
    """A log of the practice arm; `payload` hangs 2 kg on its last link."""
    hung = parse_effects("payload@joint2") if payload else ()
    given = HIDDEN_VALUES | ({"dm2": 2.0, "dmx2": 1.6} if payload else {}) | (values or {})
    motion = random_fourier(robot, 20.0, seed=seed, harmonics=16, scale=0.9)
    return simulate(
        robot,
        motion,
        rate=100.0,
        effects=(*ARM, *hung),
        parameters=given,
        noise=SENSORS,
        channels=("v",),
        seed=seed,
    )


def in_amperes(log: Log, gains: tuple[float, ...]) -> Log:
    """The same log from a robot that reports motor currents instead of torques."""
    assert log.tau is not None
    return replace(log, tau=None, current=log.tau / np.array(gains))


def with_commands(log: Log) -> Log:
    """The same motion from a robot with kp = 400 and kd = 4 that reports commanded positions instead of torques."""
    assert log.tau is not None
    assert log.v is not None
    return replace(log, tau=None, v=None, qcmd=log.q + (log.tau + 4.0 * log.v) / 400.0)


def as_rtde(log: Log, gains: tuple[float, ...]) -> dict[str, Array]:
    """Columns of the same log as the RTDE client of a UR names them, with the set points of torque and current."""
    assert log.tau is not None
    assert log.v is not None
    current = log.tau / np.array(gains)
    named = {"actual_q": log.q, "actual_qd": log.v, "actual_current": current}
    named |= {"target_moment": log.tau - 0.5 * np.sign(log.v), "target_current": current}
    columns = {f"{name}_{j}": values[:, j] for name, values in named.items() for j in range(len(log.joints))}
    return {"timestamp": log.t + 18234.568, **columns}


def named(log: Log, time: str, q: str, tau: str, sign: int = 1) -> dict[str, Array]:
    """Times, positions and torques of the same log under other names; `{k}` is the number of a joint."""
    assert log.tau is not None
    columns = {
        name.format(k=j + 1): x[:, j] for name, x in ((q, log.q), (tau, sign * log.tau)) for j in range(x.shape[1])
    }
    return {time: log.t, **columns}


def as_mujoco(log: Log) -> dict[str, Array]:
    """Arrays of the same log under MuJoCo's names."""
    assert log.tau is not None
    assert log.v is not None
    return {"time": log.t, "qpos": log.q, "qvel": log.v, "qfrc_actuator": log.tau}


def fill(folder: Path, progress: Callable[[str], None] = lambda _: None) -> None:
    """Write every file that the guides name."""
    folder.mkdir(parents=True, exist_ok=True)
    robot = Robot.load("planar2")
    progress("simulating logs")
    write_text(folder / "robot.urdf", robot.urdf)
    log, loaded = record(robot, 1), record(robot, 3, payload=True)
    write_log(log, folder / "log.csv")
    write_log(record(robot, 2), folder / "test.csv")
    write_log(log, folder / "long.parquet")
    write_log(loaded, folder / "loaded.csv")
    write_log(in_amperes(record(robot, 3), (10.0, 5.0)), folder / "unloaded_currents.csv")
    write_log(in_amperes(loaded, (10.0, 5.0)), folder / "loaded_currents.csv")
    write_log(with_commands(log), folder / "commanded.csv")
    write_log(with_commands(loaded), folder / "loaded_commanded.csv")
    write_table(as_rtde(log, (10.0, 5.0)), folder / "rtde.csv")
    write_table(named(log, "stamp", "pos_{k}", "eff_{k}"), folder / "monday.csv")
    write_table(named(log, "t", "position_joint{k}", "effort_joint{k}"), folder / "friday.parquet")
    write_table(named(log, "t", "q_joint{k}", "tau_joint{k}", sign=-1), folder / "turned.csv")
    write_table(as_mujoco(log), folder / "run1.npz")
    write_table(as_mujoco(record(robot, 2)), folder / "run2.npz")
    for k in range(3):
        place = folder / "fleet" / f"robot{k}"
        place.mkdir(parents=True, exist_ok=True)
        write_log(record(robot, 10 + k, {"fv1": 0.4 + 0.01 * k}), place / "day1.parquet")
    progress("identifying the model")
    back = Path.cwd()
    os.chdir(folder)  # the model file keeps the log's path relative to itself
    try:
        model = identify(Robot.load("robot.urdf"), [read_log("log.csv", robot.joints)]).model
        model.save("model.json")
        export(model, "arm.xml")
    finally:
        os.chdir(back)
