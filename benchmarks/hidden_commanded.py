"""Hidden effects in commanded motion: whether a diagnosis finds them where no torque was recorded.

MuJoCo integrates a robot under position servos (implicit steps of 0.25 ms); the robot's links are 5 to 20 % off its
URDF, its friction really sticks, its encoders are quantised, and it has one hidden effect. The log has commanded and
measured positions, nothing else. frischid gets the URDF, the servos' gains and the commands' delay, identifies the
robot from two motions, diagnoses the motions, and simulates the robot with the first finding and without
(`frischid.simulate_findings`).

A case is a hit when the first finding names the true effect, or names it among the effects that the logs cannot tell
from the finding.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pinocchio as pin
from commanded_mujoco import drawn_drive
from common import parser, publish
from hidden_mujoco import mjcf
from hidden_physics import STEP, Drive, arm, perturbed

import frischid as fr
from frischid.core.types import Array

FINE_STEP = 2.5e-4
"""s. Step of MuJoCo, an eighth of the longest step of `frischid.ForwardDynamics`."""
BANDWIDTH = 2 * np.pi * 6.0
"""Of the position loops, rad/s."""
RATE, SECONDS, COUNTS = 200.0, 20.0, 2**16
"""Samples per second, seconds of each of two motions, and encoder counts per turn."""
HOLD = round(1.0 / RATE / FINE_STEP)
LATE = 2
"""Steps of the log after which a command acts."""
SMOOTH = 4e-3
"""Speed over which hidden dry friction changes its direction, rad/s."""
ROBOTS = ("elbow3", "go2", "so101", "ur5", "panda")


def load(name: str) -> fr.Robot:
    """The robot as its user knows it."""
    if name == "go2":
        return fr.Robot.load(name, joints=["FL_hip_joint", "FL_thigh_joint", "FL_calf_joint"])
    if name == "so101":
        return fr.Robot.load(name, lock={"gripper": 0.0})
    return arm(name)


@dataclass(frozen=True, eq=False)
class Truth:
    """A robot as it is, before the hidden effect is put in: its motion, its loads, its drives."""

    robot: fr.Robot
    model: Any
    drive: Drive
    kp: Array
    kd: Array
    size: Array
    speed: Array
    motions: tuple[Array, Array]


@dataclass(frozen=True)
class Hidden:
    """A hidden effect: what the diagnosis should name, and how the simulated robot differs."""

    names: tuple[str, ...]
    joint: int
    torque: Callable[[Array, Array, Array], Array] | None = None
    xml: Callable[[str], str] = lambda text: text
    late: int = LATE
    gain: float = 1.0


def truth(name: str, seed: int) -> Truth:
    """Draw a robot, its drives, its servos and two motions."""
    rng, robot = np.random.default_rng(seed), load(name)
    motions = [fr.random_fourier(robot, SECONDS, seed=10 * seed + k, harmonics=16, scale=0.8) for k in (0, 1)]
    drive, size, speed, inertia = drawn_drive(robot, motions[0](np.arange(0.0, SECONDS, 1.0 / RATE)), 0.3, rng)
    kp, kd = inertia * BANDWIDTH**2, 1.4 * inertia * BANDWIDTH
    commands = tuple(m(np.arange(0.0, SECONDS, 1.0 / RATE))[0] for m in motions)
    return Truth(robot, perturbed(robot.model, rng), drive, kp, kd, size, speed, (commands[0], commands[1]))


def hidden(kind: str, world: Truth, rng: np.random.Generator) -> Hidden:
    """Draw a hidden effect of a kind; its torque is 10 to 30 % of that of its joint."""
    J = len(world.robot.joints)
    j = int(rng.integers(J))
    size, speed, share = world.size[j], world.speed[j], rng.uniform(0.1, 0.3)
    span = np.std(world.motions[0][:, j])
    unit = np.eye(J)[j]
    steep = rng.uniform(0.05, 0.2) * speed
    order, phase = int(rng.integers(4, 20)), rng.uniform(0, 2 * np.pi)
    if kind == "joint_spring":
        return Hidden((kind,), j, lambda q, v, f: unit * share * size / span * q)
    if kind == "stribeck":
        return Hidden(
            (kind, "load_stribeck"), j, lambda q, v, f: unit * share * size * np.exp(-np.abs(v) / steep) * _sign(v)
        )
    if kind == "quadratic_viscous":
        return Hidden((kind, "cubic_viscous"), j, lambda q, v, f: unit * share * size / speed**2 * v * np.abs(v))
    if kind == "asymmetric_viscous":
        return Hidden((kind,), j, lambda q, v, f: unit * share * size / speed * np.abs(v))
    if kind == "load_friction":
        return Hidden((kind, "load_stribeck"), j, lambda q, v, f: unit * share * np.abs(f) * _sign(v))
    if kind == "position_friction":  # twice the mean at one end of the range, and next to nothing at the other
        middle = np.mean(world.motions[0][:, j])
        return Hidden((kind,), j, lambda q, v, f: unit * share * size * (1 + np.tanh((q - middle) / span)) * _sign(v))
    if kind == "cogging":
        return Hidden((kind,), j, lambda q, v, f: unit * share * size * np.sin(order * q + phase))
    if kind == "gravity_tilt":
        lean = rng.uniform(0.08, 0.2) * np.array([np.cos(phase), np.sin(phase), 0.0])
        world.model.gravity = pin.Motion(pin.exp3(lean) @ world.model.gravity.linear, np.zeros(3))
        return Hidden((kind,), j)
    if kind == "position_gain":
        return Hidden((kind,), j, gain=float(rng.choice([0.7, 1.4])))
    if kind == "command_delay":
        return Hidden((kind,), j, late=LATE + int(rng.integers(2, 5)))
    if kind == "joint_coupling":
        i = j - 1 if j == J - 1 else j + 1
        both = unit + np.eye(J)[i]
        return Hidden(
            (kind,), j, lambda q, v, f: both * share * size * (_sign(v[i] + v[j]) + (v[i] + v[j]) / speed) / 2
        )
    link = world.kp[j] / BANDWIDTH**2 - world.drive.rotor[j]
    omega = 2 * np.pi * rng.uniform(4.0, 8.0)  # of the link against a motor that is held
    if kind == "elasticity":
        spring = f'stiffness="{link * omega**2:.17g}" damping="{0.2 * link * omega:.17g}"'
        return Hidden((kind,), j, xml=lambda text: _second_mass(text, j, spring))
    gap = rng.uniform(0.02, 0.05)
    limit = f'range="{-gap:.17g} {gap:.17g}" limited="true" solreflimit="0.002 1" damping="{0.2 * link:.17g}"'
    return Hidden(("backlash", "gear_play"), j, xml=lambda text: _second_mass(text, j, limit))


KINDS = (
    "joint_spring", "stribeck", "quadratic_viscous", "asymmetric_viscous", "load_friction", "cogging", "gravity_tilt",
    "position_gain", "command_delay", "joint_coupling", "elasticity", "backlash", "position_friction",
)  # fmt: skip


def _sign(v: Array) -> Array:
    return np.asarray(np.tanh(v / SMOOTH))


def _second_mass(text: str, j: int, joint: str) -> str:
    """A second hinge in series: the servo and the encoder are on the motor's side."""
    found = re.search(rf'<joint name="j{j + 1}" axis="([^"]*)"[^/]*/>', text)
    assert found is not None
    return text.replace(found[0], found[0] + f'<joint name="flex" axis="{found[1]}" {joint}/>')


def recorded(world: Truth, effect: Hidden, number: int) -> fr.Log:
    """A log of commands and quantised positions."""
    import mujoco

    J, q = len(world.robot.joints), world.motions[number]
    kp = world.kp * np.where(np.arange(J) == effect.joint, effect.gain, 1.0)
    text = mjcf(world.model, world.drive, kp, world.kd, stiff=True)
    text = text.replace(f'timestep="{STEP}" integrator="Euler"', f'timestep="{FINE_STEP}" integrator="implicitfast"')
    simulated = mujoco.MjModel.from_xml_string(effect.xml(text))
    data = mujoco.MjData(simulated)
    place = [int(simulated.joint(f"j{i + 1}").qposadr[0]) for i in range(J)]
    data.qpos[place] = q[0]
    moved = np.empty_like(q)
    for n in range(len(q)):
        moved[n] = data.qpos[place]
        data.ctrl[:] = q[max(0, n - effect.late)]
        if effect.torque is None:
            mujoco.mj_step(simulated, data, HOLD)
            continue
        for _ in range(HOLD):
            load = data.qfrc_bias[place]
            data.qfrc_applied[place] = -effect.torque(data.qpos[place], data.qvel[place], load)
            mujoco.mj_step(simulated, data)
    count = 2 * np.pi / COUNTS
    t = np.arange(len(q)) / RATE
    log = fr.Log(t, world.robot.joints, q=np.round(moved / count) * count, qcmd=q, source=f"motion {number}")
    return fr.stretch(log, start=1.0)


def case(name: str, kind: str, seed: int) -> tuple[fr.Robot, list[fr.Log], fr.PDController, Hidden]:
    """A robot, its two logs, the controller as its user knows it, and the hidden effect."""
    world = truth(name, seed)
    effect = hidden(kind, world, np.random.default_rng([seed, 2]))
    if effect.gain != 1.0 and world.size[effect.joint] < 0.2 * world.size.max():
        effect = replace(effect, joint=int(np.argmax(world.size)))
    logs = [recorded(world, effect, number) for number in (0, 1)]
    named, damping = (dict(zip(world.robot.joints, x.tolist(), strict=True)) for x in (world.kp, world.kd))
    return world.robot, logs, fr.PDController(named, damping, delay=(LATE + 0.5) / RATE), effect


def one(name: str, kind: str, seed: int) -> dict[str, Any]:
    """Diagnose one case."""
    robot, logs, controller, effect = case(name, kind, seed)
    model = fr.identify(robot, logs, controller=controller, recursion="none").model
    found = fr.diagnose(model, logs)
    try:
        moved = fr.simulate_findings(model, found, logs).findings
    except fr.InputError:  # the model without the effect cannot hold the robot: there is no motion to compare with
        moved = ()
    first = found.findings[0] if found.findings else None
    said = (first.effect, *first.confused_with) if first is not None and found.verdict == "effect" else (found.verdict,)
    return {
        "robot": name,
        "hidden": kind,
        "joint": robot.joints[effect.joint],
        "seed": seed,
        "hit": bool(set(said) & set(effect.names)),
        "said": said[0],
        "joints": "" if first is None else " ".join(first.joints),
        "probability": 0.0 if first is None else first.probability,
        "error": found.error,
        "after": float("nan") if first is None else first.error_after,
        "floor": found.noise_floor,
        "simulated": moved[0].ratio if moved and not moved[0].refused else float("nan"),
        "least simulated": min(moved, key=lambda f: f.ratio).finding.effect if moved else "",
    }


def cases(runs: int, first: int) -> Sequence[tuple[str, str, int]]:
    """Robots and kinds in turn, so that every kind meets several robots."""
    return [(ROBOTS[k % len(ROBOTS)], KINDS[k % len(KINDS)], first + k) for k in range(runs)]


def main() -> None:
    """Print the table."""
    options = parser(__doc__)
    options.add_argument("--runs", type=int, default=40, help="cases")
    options.add_argument("--first", type=int, default=0, help="first seed")
    given = options.parse_args()
    rows = []
    for name, kind, seed in cases(given.runs, given.first):
        rows.append(one(name, kind, seed))
        print(rows[-1], flush=True)
    hits = sum(row["hit"] for row in rows)
    publish(f"Hidden effects in commanded motion: {hits} of {len(rows)} named first", rows, given.json)


if __name__ == "__main__":
    main()
