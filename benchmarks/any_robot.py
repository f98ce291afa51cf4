"""Every command in turn on robots that nobody had tuned to: which command fails, and whether the hidden cause is named.

A trial draws a robot of example-robot-data, or a chain of two to seven of its joints, links of other weight than the
URDF's, a hidden cause and sensors of some kind. Three logs are simulated with Pinocchio and written as CSV: positions
and torques, as most robots record them. Then the commands run in turn in this process, and warnings are errors.

A command may refuse in a sentence. Every other error is printed with its trial, and the logs stay in `--keep`.

    python benchmarks/any_robot.py --trials 100 --seed 1
"""

from __future__ import annotations

import json
import sys
import traceback
import warnings
from collections import Counter
from collections.abc import Callable
from contextlib import chdir
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

import numpy as np
import pinocchio as pin
from click.testing import CliRunner
from common import parser, publish
from numpy.typing import NDArray

import frischid as fr
from frischid.cli import main as command_line
from frischid.robot.urdf_reading import robot_names

Array = NDArray[np.float64]
SHARE = 0.15
"""Size of the hidden torque over the standard deviation of its joint's torque."""
NOISE = 0.01
"""White noise of a torque over its standard deviation."""
LONGEST = 7
"""Joints of the longest chain; a diagnosis of more takes minutes."""
COARSE = 2e-3
"""Resolution of a coarse encoder, rad (m)."""
SENSORS = ("plain", "no torque of a joint", "late stamps", "coarse")


@dataclass(frozen=True)
class Motion:
    """Times (N,), and positions, velocities and accelerations (N, J) of the true motion."""

    t: Array
    q: Array
    v: Array
    a: Array

    @classmethod
    def drawn(cls, joints: int, rng: np.random.Generator) -> Motion:
        """Four sines per joint, below half a hertz."""
        t = np.arange(0.0, rng.uniform(8.0, 30.0), 1.0 / rng.choice([100.0, 125.0, 200.0]))
        w, phase = 2 * np.pi * rng.uniform(0.05, 0.5, (2, joints, 4))
        size = rng.uniform(0.06, 0.3, (joints, 4))
        angle = w * t[:, None, None] + 12.0 * phase
        waves = np.sin(angle), w * np.cos(angle), -(w**2) * np.sin(angle)
        return cls(t, *((size * x).sum(axis=2) for x in waves))


Torque = Callable[[Motion, int, int], Array]


def presliding(v: Array, t: Array, distance: float) -> Array:
    """Dahl's friction of unit size less its sign: after a reversal it changes over a distance, rad (m)."""
    force, out = 0.0, np.zeros(len(v))
    for i in range(1, len(v)):
        moved = v[i] * (t[i] - t[i - 1])
        force += (1.0 - force * np.sign(moved)) * moved / distance
        out[i] = force - np.sign(v[i])
    return out


CAUSES: dict[str, tuple[Torque | None, str]] = {
    "nothing": (None, "none"),
    "presliding": (lambda m, j, k: presliding(m.v[:, j], m.t, 0.05 * float(np.ptp(m.q[:, j]))), "hysteresis"),
    "warming": (lambda m, j, k: np.sign(m.v[:, j]) * np.exp(-m.t / 5.0), "thermal_drift"),
    "square of speed": (lambda m, j, k: m.v[:, j] * np.abs(m.v[:, j]), "quadratic_viscous"),
    "spring": (lambda m, j, k: m.q[:, j], "joint_spring"),
    "ripple": (lambda m, j, k: np.sin(31.0 * m.q[:, j]), "cogging"),
    "direction of a joint": (lambda m, j, k: np.sign(m.v[:, k]), "unknown"),
    "product of positions": (lambda m, j, k: np.tanh(3.0 * m.q[:, j] * m.q[:, k]), "unknown"),
    "bursts": (lambda m, j, k: (np.mod(m.t, 7.0) < 1.2).astype(float), "contact"),
}
"""Cause -> its torque on joint j, where k is another joint, and the verdict or the effect that names it."""
OF_ANOTHER = ("direction of a joint", "product of positions")
"""Causes that need two joints."""


@dataclass
class Trial:
    """A robot, its hidden cause, and how each command ended."""

    robot: str
    joints: tuple[str, ...]
    cause: str
    sensors: str
    joint: str
    named: bool = False
    ends: dict[str, str] = field(default_factory=dict)


def drawn(rng: np.random.Generator, folder: Path) -> Trial:
    """Draw a trial and write its three logs."""
    name, robot = loaded(rng)
    J = len(robot.joints)
    cause, sensors = str(rng.choice([c for c in CAUSES if J > 1 or c not in OF_ANOTHER])), str(rng.choice(SENSORS))
    j, other = (int(x) for x in rng.permutation(J)[[0, -1]])
    links = robot.pinocchio((robot.nominal.reshape(-1, 10) * rng.uniform(0.8, 1.25, (len(robot.bodies), 1))).ravel())
    motions = [Motion.drawn(J, rng) for _ in range(3)]
    torques = [rigid(robot, links, m) for m in motions]
    scale = torques[0].std(axis=0) + 1e-6
    viscous, dry = rng.uniform(0.05, 0.2, (2, J))
    fastest, hidden = motions[0].v.std(axis=0) + 1e-9, CAUSES[cause][0]
    size = 1.0 if hidden is None else SHARE * scale[j] / (hidden(motions[0], j, other).std() + 1e-9)
    for number, (m, tau) in enumerate(zip(motions, torques, strict=True)):
        tau += scale * (viscous * m.v / fastest + dry * np.tanh(m.v / 1e-3) + NOISE * rng.normal(size=tau.shape))
        if hidden is not None:
            tau[:, j] += size * hidden(m, j, other)
        t, q = m.t, m.q + 10.0 ** rng.uniform(-6, -4.5) * rng.normal(size=m.q.shape)
        if sensors == "no torque of a joint" and J > 1:
            tau[:, (j + 1) % J] = np.nan
        if sensors == "late stamps":
            t = np.sort(t + rng.uniform(0.0, 0.3, len(t)) * (t[1] - t[0]))
        if sensors == "coarse":
            q = np.round(q / COARSE) * COARSE
        head = ["t", *(f"q_{n}" for n in robot.joints), *(f"tau_{n}" for n in robot.joints)]
        table = np.column_stack([t - t[0], q, tau])
        np.savetxt(folder / f"log{number}.csv", table, fmt="%.9g", delimiter=",", header=",".join(head), comments="")
    return Trial(name, robot.joints, cause, sensors, robot.joints[j])


def loaded(rng: np.random.Generator) -> tuple[str, fr.Robot]:
    """Draw a robot, or a chain of its joints, until frischid accepts its URDF; it refuses two."""
    names = sorted(n for n in robot_names() if not n.startswith("planar2"))
    while True:
        name = str(rng.choice(names))
        try:
            return name, chain(fr.Robot.load(name), rng)
        except fr.InputError as error:
            print(f"{name}: {error}", file=sys.stderr)


def chain(robot: fr.Robot, rng: np.random.Generator) -> fr.Robot:
    """The robot, or some joints of it that follow one another."""
    if len(robot.joints) <= LONGEST and rng.random() < 0.8:
        return robot
    parents = {n: robot.model.names[robot.model.parents[robot.model.getJointId(n)]] for n in robot.joints}
    name, found, most = str(rng.choice(robot.joints)), list[str](), int(rng.integers(2, LONGEST + 1))
    while name in parents and len(found) < most:
        found.append(name)
        name = parents[name]
    try:
        return robot.keep(found[::-1])
    except fr.InputError:  # Pinocchio cannot lock a joint that has the name of a link
        return robot


def rigid(robot: fr.Robot, links: Any, m: Motion) -> Array:
    """Torque of links of other weight than the URDF's, (N, J)."""
    data = links.createData()
    rows = zip(robot.configuration(m.q), robot.full_rates(m.v), robot.full_rates(m.a), strict=True)
    torque = np.array([pin.rnea(links, data, *row) for row in rows]).reshape(len(m.t), -1)
    return np.array(robot.project(torque, axis=1))


def commands(trial: Trial) -> dict[str, list[str]]:
    """Every command, in the order in which a user runs them."""
    robot, only = trial.robot, ["--joints", ",".join(trial.joints)]
    fit, test = ["log0.csv", "log1.csv"], "log2.csv"
    return {
        "info": ["info", robot, *only],
        "map": ["map", "log0.csv", robot, "-o", "map.toml"],
        "cut": ["cut", "log0.csv", "--from", "1", "--until", "5", "-o", "cut.csv"],
        "check": ["check", robot, *fit, *only],
        "identify": ["identify", robot, *fit, *only, "-o", "model.json"],
        "identify, frisch": ["identify", robot, *fit, *only, "--estimator", "frisch", "-o", "frisch.json"],
        "identify, no prior": ["identify", robot, *fit, *only, "--prior", "none", "-o", "none.json"],
        "compare": ["compare", "model.json", test],
        "diagnose": ["diagnose", "model.json", *fit, "--json"],
        "diagnose another log": ["diagnose", "none.json", test],
        "improve": ["improve", "model.json", *fit, "--valid", test, "--max-steps", "2", "-o", "better.json"],
        "add": ["add", "model.json", f"hysteresis@{trial.joint}", *fit, "-o", "added.json"],
        "history": ["history", "better.json"],
        "report": ["report", "better.json", test, "-o", "page.html"],
        "consistent": ["consistent", "model.json", "-o", "physical.json"],
        **{f"export {kind}": ["export", "model.json", "-o", f"out.{kind}"] for kind in ("urdf", "xml", "c", "py")},
        "payload": ["payload", "model.json", test],
        "simulate": ["simulate", robot, *only, "--duration", "5", "-o", "simulated.csv"],
        "excite": ["excite", robot, *only, "--budget", "300", "--duration", "8", "-o", "motion.csv"],
    }


def run(trial: Trial) -> None:
    """Run the commands in the current folder; the trial takes how they ended, and whether the cause was named."""
    for name, arguments in commands(trial).items():
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            done = CliRunner().invoke(command_line, arguments)
        failed = done.exception is not None and not isinstance(done.exception, SystemExit)
        trial.ends[name] = "failed" if failed else "refused" if done.exit_code == 2 else "done"
        Path(f"{name}.txt").write_text(done.output, encoding="utf-8")
        if failed:
            print(f"{trial}: {name}", *traceback.format_exception(*done.exc_info)[-2:], sep="\n", file=sys.stderr)
        if name == "diagnose" and trial.ends[name] == "done":
            trial.named = names(trial, json.loads(done.output))


def names(trial: Trial, found: dict[str, Any]) -> bool:
    """Whether a diagnosis names the cause, on its joint if the cause is an effect."""
    wanted = CAUSES[trial.cause][1]
    if wanted in ("none", "unknown", "contact"):
        return bool(found["verdict"] == wanted)
    first = next(iter(found["findings"]), {"effect": "", "joints": []})
    called = found["verdict"] == "effect" and first["effect"] == wanted
    return bool(called and first["significant"] and trial.joint in first["joints"])


def main() -> None:
    """Print how often each cause was named, and how the commands ended."""
    options = parser(__doc__)
    options.add_argument("--trials", type=int, default=40)
    options.add_argument("--seed", type=int, default=0)
    options.add_argument("--keep", type=Path, help="folder for the files of every trial; a temporary one by default")
    given = options.parse_args()
    folder, trials = given.keep or Path(mkdtemp()), []
    for number in range(given.trials):
        inside = folder / str(number)
        inside.mkdir(parents=True)
        trial = drawn(np.random.default_rng([given.seed, number]), inside)
        with chdir(inside):
            run(trial)
        trials.append(trial)
        print(f"{number}: {trial.robot}, {trial.cause}, {trial.sensors}, named: {trial.named}", file=sys.stderr)
    rows = []
    for cause in CAUSES:
        met = [t for t in trials if t.cause == cause]
        ends = Counter(end for t in met for end in t.ends.values())
        row = {"cause": cause, "trials": len(met), "named": sum(t.named for t in met), "commands": ends.total()}
        rows.append(row | {end: ends[end] for end in ("refused", "failed")})
    refused = Counter(name for t in trials for name, end in t.ends.items() if end == "refused")
    told = [f"refused by {name}: {count}" for name, count in refused.most_common()]
    publish("every command on robots that nobody had tuned to", rows, given.json, [f"seed {given.seed}", *told])


if __name__ == "__main__":
    main()
