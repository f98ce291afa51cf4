"""Fill a folder with a robot, logs and a model, so that every command of the guides runs as it is printed.

The robot is a planar arm with a spring at joint 2 that its model does not know.
Run ``python practice_folder.py FOLDER``.
"""

from __future__ import annotations

import os
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

import frischid as fr

TRUTH = {"fv1": 0.4, "fc1": 0.6, "Ia1": 0.12, "off1": 0.4, "fv2": 0.3, "fc2": 0.5, "Ia2": 0.2, "off2": -0.2, "ks2": 1.5}
EFFECTS = (*fr.BASELINE, *fr.parse_effects("joint_spring@joint2"))
NOISE = fr.Noise(q=2e-5, tau=0.01)


def record(robot: fr.Robot, seed: int, values: dict[str, float] | None = None, payload: bool = False) -> fr.Log:
    """A log of the practice arm; `payload` hangs 2 kg on its last link."""
    hung = fr.parse_effects("payload@joint2") if payload else ()
    given = TRUTH | ({"dm2": 2.0, "dmx2": 1.6} if payload else {}) | (values or {})
    motion = fr.random_fourier(robot, 20.0, seed=seed, harmonics=16, scale=0.9)
    return fr.simulate(
        robot, motion, rate=100.0, effects=(*EFFECTS, *hung), parameters=given, noise=NOISE, channels=("v",), seed=seed
    )


def in_amperes(log: fr.Log, gains: tuple[float, ...]) -> fr.Log:
    """The same log from a robot that reports motor currents instead of torques."""
    assert log.tau is not None
    return replace(log, tau=None, current=log.tau / np.array(gains))


def with_commands(log: fr.Log, kp: float = 400.0, kd: float = 4.0) -> fr.Log:
    """The same motion from a robot that reports commanded positions instead of torques."""
    assert log.tau is not None
    assert log.v is not None
    return replace(log, tau=None, v=None, qcmd=log.q + (log.tau + kd * log.v) / kp)


def fill(folder: Path) -> None:
    """Write every file that the guides name."""
    folder.mkdir(parents=True, exist_ok=True)
    robot = fr.Robot.load("planar2")
    (folder / "robot.urdf").write_text(robot.urdf, encoding="utf-8")
    log, loaded = record(robot, 1), record(robot, 3, payload=True)
    fr.write_log(log, folder / "log.csv")
    fr.write_log(record(robot, 2), folder / "test.csv")
    fr.write_log(log, folder / "long.parquet")
    fr.write_log(loaded, folder / "loaded.csv")
    fr.write_log(in_amperes(record(robot, 3), (10.0, 5.0)), folder / "unloaded_currents.csv")
    fr.write_log(in_amperes(loaded, (10.0, 5.0)), folder / "loaded_currents.csv")
    fr.write_log(with_commands(log), folder / "commanded.csv")
    for k in range(3):
        place = folder / "fleet" / f"robot{k}"
        place.mkdir(parents=True, exist_ok=True)
        fr.write_log(record(robot, 10 + k, {"fv1": 0.4 + 0.01 * k}), place / "day1.parquet")
    back = Path.cwd()
    os.chdir(folder)  # the model file keeps the log's path relative to itself
    try:
        fr.identify(fr.Robot.load("robot.urdf"), [fr.read_log("log.csv", robot.joints)]).model.save("model.json")
    finally:
        os.chdir(back)


if __name__ == "__main__":
    fill(Path(sys.argv[1] if len(sys.argv) > 1 else "practice"))
