"""MJCF round trip: the XML that `export --into` writes must simulate the motion of the arm that was measured.

An arm of four joints is drawn at random: MuJoCo simulates it with other masses, centres of mass, inertias, armature,
damping and frictionloss than its XML says (the *truth*). A controller moves it along a random motion, and MuJoCo's own
arrays (time, qpos, qvel, qfrc_actuator) are the log. The arm is identified from the *original* XML and the arrays, and
the identified numbers are written into a copy of that XML.

Each XML then simulates another motion, which no fit has seen:

- *open loop*: the recorded torque alone drives the arm, in stretches of `HORIZON` seconds that begin at the recorded
  state. Nothing holds the arm, so errors grow as those of a falling pendulum do;
- *controlled*: the controller of the log moves the arm along the whole log.

    error = max over joints and samples |q − q_log| / (range of q_log of this joint)

Besides the numbers of inertial and joint tags nothing of the XML may change; a column says whether that holds.
"""

from __future__ import annotations

import re
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import mujoco
import numpy as np
from common import parser, publish

import frischid as fr
from frischid.core.types import Array

JOINTS = 4
HORIZON = 1.0
"""s. Length of a stretch of open-loop simulation."""
SECONDS = 20.0
NUMBERS = re.compile(r'\s(armature|damping|frictionloss|pos|mass|diaginertia|fullinertia)="[^"]*"')
AXES = ("0 0 1", "0 1 0", "0 1 0", "1 0 0")
MASSES = (4.0, 3.0, 2.0, 1.0)


def arm_xml(rng: np.random.Generator | None) -> str:
    """The arm's XML; with a generator, the arm that is measured: other numbers of every body and joint."""

    def other(nominal: float, low: float, high: float) -> float:
        return nominal if rng is None else nominal * float(rng.uniform(low, high))

    text, ends = "", ""
    for k in range(JOINTS):
        mass = other(MASSES[k], 0.6, 1.6)
        inertia = " ".join(f"{other(x * MASSES[k], 0.7, 1.4):.6f}" for x in (0.012, 0.011, 0.009))
        centre = " ".join(f"{x + (0.0 if rng is None else rng.uniform(-0.03, 0.03)):.5f}" for x in (0.02, 0.0, 0.12))
        joint = f'armature="{other(0.08, 0.4, 2.5):.5f}" damping="{other(0.4, 0.4, 3.0):.5f}"'
        text += (
            f'<body name="link{k + 1}" pos="0 0 {0.1 if k == 0 else 0.25}">'
            f'<joint name="j{k + 1}" type="hinge" axis="{AXES[k]}" range="-2 2" limited="false" {joint} '
            f'frictionloss="{other(0.15, 0.3, 3.0):.5f}"/>'
            f'<inertial pos="{centre}" mass="{mass:.5f}" diaginertia="{inertia}"/>'
            f'<geom name="g{k + 1}" type="capsule" size="0.04" fromto="0 0 0 0 0 0.25" contype="0" conaffinity="0"/>'
        )
        ends += "</body>"
    motors = "".join(f'<motor name="m{k + 1}" joint="j{k + 1}" gear="1"/>' for k in range(JOINTS))
    return (
        '<mujoco model="arm"><!-- mine --><compiler angle="radian"/>'
        '<option timestep="0.001" integrator="implicitfast"/>'
        f"<worldbody>{text}{ends}</worldbody><actuator>{motors}</actuator></mujoco>"
    )


def controlled(xml: str, robot: fr.Robot, seed: int) -> dict[str, Array]:
    """MuJoCo's arrays of an arm that a controller moves along a random motion."""
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    step = model.opt.timestep
    t = np.arange(0.0, SECONDS, step)
    motion = fr.random_fourier(robot, SECONDS, seed=seed)
    wanted, speed = (np.asarray(x) for x in motion(t)[:2])
    data.qpos[:], data.qvel[:] = wanted[0], speed[0]
    q, v, tau = np.zeros((3, len(t), JOINTS))
    stiff, soft = 60.0 * np.array(MASSES), 6.0 * np.array(MASSES)
    for i in range(len(t)):
        data.ctrl[:] = stiff * (wanted[i] - data.qpos) + soft * (speed[i] - data.qvel)
        mujoco.mj_forward(model, data)
        q[i], v[i], tau[i] = data.qpos, data.qvel, data.qfrc_actuator
        mujoco.mj_step(model, data)
    return {"time": t, "qpos": q, "qvel": v, "qfrc_actuator": tau}


def controlled_error(found: dict[str, Array], log: dict[str, Array]) -> float:
    """Largest difference of the positions over the range of the joint."""
    return float((np.abs(found["qpos"] - log["qpos"]) / np.ptp(log["qpos"], axis=0)).max())


def open_loop_error(xml: str, log: dict[str, Array]) -> float:
    """Largest error of the position in open loop, over the range of the joint."""
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    size, worst = round(HORIZON / model.opt.timestep), 0.0
    spread = np.ptp(log["qpos"], axis=0)
    for first in range(0, len(log["time"]) - size, size):
        mujoco.mj_resetData(model, data)
        data.qpos[:], data.qvel[:] = log["qpos"][first], log["qvel"][first]
        for i in range(first, first + size):
            worst = max(worst, float((np.abs(data.qpos - log["qpos"][i]) / spread).max()))
            data.ctrl[:] = log["qfrc_actuator"][i]
            mujoco.mj_step(model, data)
    return worst


def round_trip(seed: int, folder: Path) -> dict[str, Any]:
    """One arm: errors of the original and of the written XML on a motion that no fit has seen."""
    original, path = arm_xml(None), folder / "arm.xml"
    path.write_text(original)
    robot = fr.Robot.load(path)
    truth = arm_xml(np.random.default_rng(seed))
    log, test = (controlled(truth, robot, 2 * seed + k) for k in (1, 2))
    np.savez(folder / "log.npz", **log)
    found = fr.identify(robot, [fr.read_log(folder / "log.npz", robot.joints)], recursion="none")
    fr.export(found.model, folder / "new.xml", into=path)
    written = (folder / "new.xml").read_text()
    figures: dict[str, Any] = {"arm": seed}
    for name, xml in (("original", original), ("written", written)):
        figures[f"open loop, {name}"] = open_loop_error(xml, test)
        figures[f"controlled, {name}"] = controlled_error(controlled(xml, robot, 2 * seed + 2), test)
    assert found.headline is not None
    return figures | {
        "nothing else changed": NUMBERS.sub("", written) == NUMBERS.sub("", original),
        "NRMSE": found.headline.nrmse,
    }


def main() -> None:
    """Print the table."""
    options = parser(__doc__)
    options.add_argument("--arms", type=int, default=5, help="arms to draw")
    options.add_argument("--first", type=int, default=1, help="seed of the first arm")
    given = options.parse_args()
    rows = []
    for seed in range(given.first, given.first + given.arms):
        with TemporaryDirectory() as folder:
            rows.append(round_trip(seed, Path(folder)))
    publish(
        f"MJCF round trip: largest position error over its range, {HORIZON:g} s open loop, {SECONDS:g} s controlled",
        rows,
        given.json,
        (f"largest, written XML: open loop {max(r['open loop, written'] for r in rows):.2%}",),
    )


if __name__ == "__main__":
    main()
