"""Armature and friction from commanded positions: frischid, mujoco.sysid and a random search, side by side.

The robots and logs are those of `commanded_mujoco.py`: MuJoCo moves a robot whose links are 5 to 20 % off the URDF, and
the log has commands and quantised positions. All three get the URDF, the servos' gains and the commands' delay.
frischid solves one linear problem with bounds. mujoco.sysid fits the simulated motion of the whole log, from three
times the true values: once with the URDF's links, and with `--links` once more with each link's mass and centre of mass
as further parameters, within the bounds that the package proposes (at most 50 evaluations). The random search keeps the
best of 5,000 simulations of the log, with the URDF's links. Both look between a tenth and ten times the true values; no
user knows that much.

Error of the values: median and largest over all joints, of armature, viscous and Coulomb friction. Inside: share of the
true values inside the tool's 95 % ranges. Simulated error: rms position error in MuJoCo along a motion that no tool has
seen, mean over the joints; with the peers' step and integrator, and with the fine ones of the true robot. The simulated
drives have no effort limit, so that of the URDF, which frischid writes as `forcerange`, is taken out.

Times are processor time. Loading a tool is not counted: mujoco.sysid is imported before, and frischid identifies a
small robot before.

mujoco.sysid runs in a process of its own: `pip install "mujoco[sysid]"` in another environment, and pass its
interpreter as `--python`.
"""

from __future__ import annotations

import re
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from commanded_mujoco import FINE_STEP, ROBOTS, recorded
from common import Worker, parser, publish
from hidden_mujoco import mjcf
from hidden_physics import STEP, Drive
from mujoco import rollout

import frischid as fr
from frischid.core.types import Array
from frischid.export.mjcf import mjcf_source

WORKER = Path(__file__).with_name("mujoco_worker.py")
FINER = 4
"""Steps of the peers' simulation per sample of the log: 1.25 or 2.5 ms."""
START = 3.0
"""Start of the peers over the true value."""
SPREAD = 10.0
"""Both peers look between this share of the true value and its multiple; the random search evenly in the logarithm."""


def scene(robot: fr.Robot, values: Array, gains: tuple[Array, Array], step: float) -> str:
    """The URDF's links in MuJoCo with armature, damping and friction loss (3, J), and a sensor for every position."""
    armature, damping, dry = values
    text = mjcf(robot.model, Drive(damping, dry, np.zeros(len(dry)), armature), *gains, stiff=True)
    text = text.replace(f'timestep="{STEP}" integrator="Euler"', f'timestep="{step:.17g}" integrator="implicitfast"')
    sensors = "".join(f'<jointpos name="q{i + 1}" joint="j{i + 1}"/>' for i in range(len(dry)))
    for i in range(len(dry)):
        text = text.replace(f'<general joint="j{i + 1}"', f'<general name="servo{i + 1}" joint="j{i + 1}"')
    return text.replace("</mujoco>", f"<sensor>{sensors}</sensor></mujoco>")


def positions(text: str, names: list[str], control: Array, first: Array, substeps: int = FINER) -> Array:
    """Simulated positions (N, J) at the log's samples under held commands (N, J)."""
    model = mujoco.MjModel.from_xml_string(text)
    place = [int(model.joint(n).qposadr[0]) for n in names]
    start = np.zeros(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS))
    start[[1 + k for k in place]] = first
    held = np.repeat(control, substeps, axis=0)
    states, _ = rollout.rollout(model, mujoco.MjData(model), start[None], held[None])
    moved = np.concatenate([start[None], np.asarray(states)[0]])[:-1:substeps]
    return np.asarray(moved[:, [1 + k for k in place]])


def finely(text: str, names: list[str], test: fr.Log) -> Array:
    """The same with the step and the integrator of the true robot."""
    text = re.sub(r'timestep="[^"]*"', f'timestep="{FINE_STEP}"', text)
    text = re.sub(r'integrator="[^"]*"', 'integrator="RK4"', text)
    return positions(text, names, late(test), test.q[0], round(1.0 / test.rate / FINE_STEP))


def late(log: fr.Log) -> Array:
    """Commands (N, J) as they act, two samples late."""
    assert log.qcmd is not None
    return np.concatenate([log.qcmd[:1], log.qcmd[:1], log.qcmd[:-2]])


def error(found: Array, log: fr.Log) -> float:
    """Rms error of positions, mean over the joints, rad."""
    return float(np.sqrt(((found - log.q) ** 2).mean(axis=0)).mean()) if np.isfinite(found).all() else float("inf")


def load_frischid() -> None:
    """Identify a small robot, so that every module is loaded before a time is taken."""
    robot = fr.Robot.load("planar2")
    log = fr.simulate(robot, fr.random_fourier(robot, 5.0, seed=1), rate=100.0)
    driven = replace(log, qcmd=log.q + log.tau / 100.0, tau=None, v=None, a=None, sha256=None)
    controller = fr.PDController(kp=100.0, delay=0.001)
    fr.drive_parameters(fr.identify(robot, [driven], controller=controller, recursion="none").model)


def ours(robot: fr.Robot, log: fr.Log, controller: fr.PDController) -> tuple[Array, Array, float, str]:
    """Values (3, J), their ranges (2, 3, J), seconds, and the model as MJCF."""
    begin = time.process_time()
    model = fr.identify(robot, [log], controller=controller, recursion="none").model
    drives = fr.drive_parameters(model)
    seconds = time.process_time() - begin
    model = fr.make_consistent(model).model
    kinds = ("armature", "viscous", "coulomb")
    found = np.array([[(x.value, x.lower, x.upper) for x in drives if x.quantity == kind] for kind in kinds])
    text = re.sub(r' forcerange="[^"]*"', "", mjcf_source(model))
    return found[:, :, 0], np.moveaxis(found[:, :, 1:], 2, 0), seconds, text


def searched(robot: fr.Robot, log: fr.Log, gains: tuple[Array, Array], truth: Array, simulations: int) -> Array:
    """The best of some random simulations, (3, J)."""
    rng, step = np.random.default_rng(0), 1.0 / log.rate / FINER
    best, least = truth, np.inf
    for _ in range(simulations):
        drawn = truth * SPREAD ** rng.uniform(-1.0, 1.0, truth.shape)
        names = [f"j{i + 1}" for i in range(truth.shape[1])]
        now = error(positions(scene(robot, drawn, gains, step), names, late(log), log.q[0]), log)
        best, least = (drawn, now) if now < least else (best, least)
    return best


def compared(name: str, given: Any) -> list[dict[str, Any]]:
    """Rows of one robot; `given` are the options of the command line."""
    seed, simulations = given.seed, given.simulations
    robot, log, drive, controller = recorded(name, seed)
    test = recorded(name, seed, other=seed + 1000)[1]
    gains = (controller.values("kp", robot.joints), controller.values("kd", robot.joints))
    truth, step = np.array([drive.rotor, drive.viscous, drive.coulomb]), 1.0 / log.rate / FINER
    names = [f"j{i + 1}" for i in range(len(robot.joints))]
    rows = []

    def row(tool: str, values: Array, seconds: float, said: tuple[str, list[str]], ranges: Any = None) -> None:
        moved = positions(*said, late(test), test.q[0])
        off = np.abs(values / truth - 1.0)
        inside = None if ranges is None else 100 * float(((ranges[0] <= truth) & (truth <= ranges[1])).mean())
        rows.append(
            {"robot": name, "tool": tool, "seconds": seconds, "× frischid": seconds / rows[0]["seconds"] if rows else 1}
            | {"median error %": 100 * float(np.median(off)), "largest error %": 100 * float(off.max())}
            | {"inside 95 % range %": inside, "simulated error mrad": 1e3 * error(moved, test)}
            | {"with fine steps mrad": 1e3 * error(finely(*said, test), test)}
        )
        print(rows[-1], flush=True)

    values, ranges, seconds, text = ours(robot, log, controller)
    text = text.replace("<option ", f'<option timestep="{step:.17g}" integrator="implicitfast" ')
    row("frischid", values, seconds, (text, list(robot.joints)), ranges)
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "arm.xml").write_text(scene(robot, START * truth, gains, step), encoding="utf-8")
        t = np.arange((len(log) - 1) * FINER + 1) * step
        control = np.repeat(late(log)[:-1], FINER, axis=0)
        measured = np.column_stack([np.interp(t[1:], log.t - log.t[0], x) for x in log.q.T])
        start = np.concatenate([[0.0], log.q[0], np.zeros(len(names))])
        inputs = {"t": t, "control": control, "sensor": measured, "start": start, "optimizer": "scipy"}
        inputs |= {"guess": START * truth, "low": truth / SPREAD, "high": truth * SPREAD}
        np.savez(Path(folder) / "inputs.npz", **inputs)
        with Worker(given.python, WORKER, folder, 'pip install "mujoco[sysid]"') as other:
            for said in ("drives", *["links"] * given.links):
                answer = other.run(said)
                found, half = np.array(answer["values"]), np.array(answer["half"])
                tool = f"mujoco.sysid {answer['version']}{', with links' * (said == 'links')}"
                row(tool, found, answer["seconds"], (answer["mjcf"], names), (found - half, found + half))
    if not simulations:
        return rows
    begin = time.process_time()
    best = searched(robot, log, gains, truth, simulations)
    seconds = time.process_time() - begin
    row(f"best of {simulations}", best, seconds, (scene(robot, best, gains, step), names))
    row("true values, URDF's links", truth, 0.0, (scene(robot, truth, gains, step), names))
    return rows


def main() -> None:
    """Print the table."""
    options = parser(__doc__)
    options.add_argument("--python", default=sys.executable, help="interpreter that has mujoco.sysid")
    options.add_argument("--robots", nargs="+", choices=list(ROBOTS), default=list(ROBOTS))
    options.add_argument("--seed", type=int, default=900)
    options.add_argument("--simulations", type=int, default=5000, help="of the random search; 0: none")
    options.add_argument("--links", action="store_true", help="mujoco.sysid also fits masses and centres of mass")
    given = options.parse_args()
    load_frischid()
    rows = [r for n in given.robots for r in compared(n, given)]
    publish("Drives from commanded positions, beside other tools", rows, given.json)


if __name__ == "__main__":
    main()
