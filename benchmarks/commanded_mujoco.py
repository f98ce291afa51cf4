"""Drives from commanded positions alone, on arms and a leg that MuJoCo moves: error and coverage of the ranges.

MuJoCo integrates the true robot (links 5 to 20 % off the URDF) with position actuators: friction loss that really
sticks, damping, armature, and commands that are held over a step of the log and act two steps late. The log has
commanded positions and quantised encoders, nothing else. `frischid.identify` gets the URDF, the gains and the delay of
two steps, and that commands are held.

Per robot, over all drives and seeds: the share of values that are called identified or roughly known, their median
and 90 % relative error, the share within 5 %, and the share of true values inside the 95 % ranges, of these and of all.
The share that is called identified alone, with a range within 5 %, and the share of these within 5 % of the truth.

With `--delay-doubt`, the delay that frischid gets has a random error, and frischid knows its size.

With `--unknown`, gains and delay are not named, only that commands are held: kp comes from the URDF's masses, the delay
from the likelihood. A second table has their errors. A joint whose kp cannot be found gets the true one and is counted.

With `--open-damping`, the log has commanded velocities too, which the drives follow, and kd is not named: kd is one of
the values of the table.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from common import parser, publish
from hidden_mujoco import mjcf
from hidden_physics import STEP, Drive, perturbed

import frischid as fr
from frischid.core.types import Array

ROBOTS: dict[str, dict[str, Any]] = {
    "so101": {"rate": 100.0, "counts": 4096, "lock": {"gripper": 0.0}},
    "panda": {"rate": 200.0, "counts": 2**19, "lock": {"panda_finger_joint1": 0.0, "panda_finger_joint2": 0.0}},
    "go2": {"rate": 200.0, "counts": 2**15, "joints": ["FL_hip_joint", "FL_thigh_joint", "FL_calf_joint"]},
}
"""Robot -> samples per second, encoder counts per turn, and joints that are locked or move."""
BANDWIDTH = 2 * np.pi * 4.0
"""Of the position loops, rad/s: soft, so that position errors are many counts."""
SECONDS = 20.0
FINE_STEP = 2.5e-4
"""s. Step of MuJoCo, with its Runge-Kutta integrator of fourth order. An integrator of first order with the step h
moves commands by h/2 and adds an armature of kd h/2: even with 25 μs, more than a standard error of the friction."""
TRUE = {"armature": "rotor", "viscous": "viscous", "coulomb": "coulomb"}


def load(name: str) -> fr.Robot:
    """The robot as its user knows it."""
    rule = ROBOTS[name]
    if "joints" in rule:
        return fr.Robot.load(name, joints=rule["joints"])
    return fr.Robot.load(name, lock={j: x for j, x in rule["lock"].items() if j in fr.Robot.load(name).joints})


def drawn_drive(
    robot: fr.Robot, motion: tuple[Array, Array, Array], most: float, rng: np.random.Generator
) -> tuple[Drive, Array, Array, Array]:
    """Drives whose friction is a tenth to `most` of the joint's torque; that torque, the rms speed, the inertia."""
    J, (q, v, a) = len(robot.joints), motion
    torque = robot.inverse_dynamics(q, v, a)
    size = np.sqrt(torque.std(axis=0) ** 2 + (0.1 * torque.std(axis=0).max()) ** 2)
    speed, jerk = (np.sqrt((x**2).mean(axis=0)) for x in (v, a))
    viscous, coulomb = rng.uniform(0.1, most, J) * size / speed, rng.uniform(0.1, most, J) * size
    drive = Drive(viscous, coulomb, np.zeros(J), rng.uniform(0.1, 0.5, J) * size / jerk)
    return drive, size, speed, size / jerk + drive.rotor


def recorded(
    name: str, seed: int, other: int | None = None, velocities: bool = False
) -> tuple[fr.Robot, fr.Log, Drive, fr.PDController]:
    """A log of commands and quantised positions, the true drives, and the controller; or of another motion.

    With `velocities`, the log has commanded velocities too, and the drives follow them.
    """
    rng, rule, robot = np.random.default_rng(seed), ROBOTS[name], load(name)
    hold = round(1.0 / rule["rate"] / FINE_STEP)
    motion = fr.random_fourier(robot, SECONDS, seed=seed, harmonics=25, scale=0.8)
    q, v, a = motion(np.arange(0.0, SECONDS, hold * FINE_STEP))
    drive, _, _, inertia = drawn_drive(robot, (q, v, a), 0.4, rng)
    kp, kd = inertia * BANDWIDTH**2, 1.4 * inertia * BANDWIDTH
    text = mjcf(perturbed(robot.model, rng), drive, kp, kd, stiff=True)
    if other is not None:
        q, v, _ = fr.random_fourier(robot, SECONDS, seed=other, harmonics=25, scale=0.8)(
            np.arange(len(q)) / rule["rate"]
        )
    moved = followed(text, q + kd / kp * v if velocities else q, hold)
    count = 2 * np.pi / rule["counts"]
    log = fr.Log(
        np.arange(len(q)) * hold * FINE_STEP,
        robot.joints,
        q=np.round(moved / count) * count,
        qcmd=q,
        vcmd=v if velocities else None,
        source=f"{name} {seed}",
    )
    named = {joint: float(x) for joint, x in zip(robot.joints, kp, strict=True)}
    damping = {joint: float(x) for joint, x in zip(robot.joints, kd, strict=True)}
    return (
        robot,
        fr.stretch(log, start=1.0),
        drive,
        fr.PDController(named, damping, delay=2.0 * hold * FINE_STEP, held=True),
    )


def followed(text: str, pushed: Array, hold: int) -> Array:
    """Positions (N, J) at the log's samples; the commands (N, J) act two samples late, and are held for `hold` steps.

    `text` is the robot's MJCF.
    """
    import mujoco
    from mujoco import rollout

    J = pushed.shape[1]
    rule_of_motion = f'timestep="{STEP}" integrator="Euler"', f'timestep="{FINE_STEP}" integrator="RK4"'
    true = mujoco.MjModel.from_xml_string(text.replace(*rule_of_motion))
    late = np.concatenate([pushed[:1], pushed[:1], pushed[:-2]])
    control = np.repeat(late, hold, axis=0)
    start = np.zeros(mujoco.mj_stateSize(true, mujoco.mjtState.mjSTATE_FULLPHYSICS))
    start[1 : 1 + J] = pushed[0]
    states, _ = rollout.rollout(true, mujoco.MjData(true), start[None], control[None])
    return np.concatenate([start[None], np.asarray(states)[0]])[:-1:hold, 1 : 1 + J]


def one(name: str, seed: int, doubt: float = 0.0, open_damping: bool = False) -> list[dict[str, Any]]:
    """Every value of every drive of one run, beside the truth; `doubt` is that of the delay, in steps of the log."""
    robot, log, drive, controller = recorded(name, seed, velocities=open_damping)
    damping = controller.values("kd", robot.joints)
    if open_damping:
        controller = replace(controller, kd=None)
    if doubt:
        s = doubt / log.rate
        told = float(controller.values("delay", robot.joints)[0]) + s * np.random.default_rng([seed, 3]).normal()
        controller = replace(controller, delay=told, delay_doubt=s)
    model = fr.identify(robot, [log], controller=controller, recursion="none").model
    rows = []
    for x in fr.drive_parameters(model):
        if x.quantity in TRUE or (open_damping and x.quantity == "damping"):
            truths = getattr(drive, TRUE[x.quantity]) if x.quantity in TRUE else damping
            truth = float(truths[robot.joints.index(x.joint)])
            rows.append({**x.to_dict(), "truth": truth, "inside": bool(x.lower <= truth <= x.upper), "seed": seed})
    return rows


def unnamed(name: str, seed: int) -> list[dict[str, Any]]:
    """Gains and delay, found from one run, beside the truth."""
    robot, log, _, true = recorded(name, seed)
    given = fr.PDController(delay=None, held=True)
    try:
        found = fr.identify(robot, [log], controller=given, recursion="none").model.controller
    except fr.InputError as error:
        lost = [n for n in robot.joints if n in str(error).partition(" cannot be found")[0]]
        if not lost:
            raise
        given = fr.PDController({n: true.gain(n) for n in lost}, delay=None, held=True)
        found = fr.identify(robot, [log], controller=given, recursion="none").model.controller
    assert found is not None
    rows = []
    for n in robot.joints:
        doubt = found.gain_doubt(n)
        off = true.gain(n) / found.gain(n) - 1.0  # of 1 / kp, whose range is symmetric
        rows.append({"what": "kp", "found": doubt > 0, "error": abs(off), "doubt": doubt})
    delay, stderr, truth = (
        float(c.values(x, robot.joints)[0]) for c, x in ((found, "delay"), (found, "delay_doubt"), (true, "delay"))
    )
    return [*rows, {"what": "delay", "found": delay > 0, "error": abs(delay - truth), "doubt": stderr}]


def summary_of_unnamed(name: str, rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Two lines of the second table."""
    lines = []
    for what, unit in (("kp", "of kp"), ("delay", "s")):
        of = [x for x in rows if x["what"] == what]
        known = [x for x in of if x["found"]]
        inside = float(np.mean([x["error"] <= 1.96 * x["doubt"] for x in known])) if known else float("nan")
        errors = [x["error"] for x in known] or [float("nan")]
        lines.append(
            {"robot": name, "value": what, "values": len(of), "found": len(known), "unit": unit}
            | {"median error": float(np.median(errors)), "worst": max(errors), "inside 95 %": inside}
            | {"median standard error": float(np.median([x["doubt"] for x in known] or [float("nan")]))}
        )
    return lines


def summary(name: str, rows: list[dict[str, Any]]) -> dict[str, Any]:
    """One line of the table."""
    known = [x for x in rows if x["known"] in ("identified", "roughly")]
    close = [abs(x["value"] / x["truth"] - 1.0) < 0.05 for x in rows if x["known"] == "identified"]
    error: Array = np.array([abs(x["value"] / x["truth"] - 1.0) for x in known] or [np.nan])
    return {
        "robot": name,
        "first seed": min(x["seed"] for x in rows),
        "runs": len({x["seed"] for x in rows}),
        "values": len(rows),
        "identified": len(known) / len(rows),
        "median error": float(np.median(error)),
        "90 % error": float(np.quantile(error, 0.9)),
        "within 5 %": float((error < 0.05).mean()),
        "range within 5 %": len(close) / len(rows),
        "of these within 5 %": float(np.mean(close)) if close else None,
        "inside, identified": float(np.mean([x["inside"] for x in known] or [np.nan])),
        "inside, all": float(np.mean([x["inside"] for x in rows])),
    }


def main() -> None:
    """Print the table."""
    options = parser(__doc__)
    options.add_argument("--runs", type=int, default=10, help="seeds per robot")
    options.add_argument("--first", type=int, default=0, help="first seed")
    options.add_argument("--robots", nargs="+", choices=list(ROBOTS), default=list(ROBOTS))
    options.add_argument("--delay-doubt", type=float, default=0.0, help="standard error of the delay, steps of the log")
    options.add_argument("--unknown", action="store_true", help="find gains and delay too, and print their errors only")
    options.add_argument("--open-damping", action="store_true", help="commanded velocities, and a kd that is not named")
    given = options.parse_args()
    seeds = range(given.first, given.first + given.runs)
    if given.unknown:
        found = [x for n in given.robots for x in summary_of_unnamed(n, [r for k in seeds for r in unnamed(n, k)])]
        publish("gains and delay from commanded positions, neither of them named", found, given.json)
        return
    rows = [
        summary(name, [row for seed in seeds for row in one(name, seed, given.delay_doubt, given.open_damping)])
        for name in given.robots
    ]
    publish("Drives from commanded positions, moved by MuJoCo", rows, given.json)


if __name__ == "__main__":
    main()
