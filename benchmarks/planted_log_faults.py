"""Faults planted in simulated logs: how often `check` names them first, alone and two at a time.

Arms of example-robot-data move with friction and with links that differ from their URDF's by `--urdf-error`. Each fault
is planted at a random joint with a random size. Printed are, for each fault, the share of runs in which it is the first
issue, with its joints; for pairs of faults the share in which both are named; the share of clean logs in which nothing
is; and the share of right ones among all issues that are "certain". With `--measured` the faults are planted in
measured logs; what `check` says of such a log as it is does not count.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np
from common import data_folder, parser, publish
from real_robots import TIAGO_ROWS
from scipy import signal
from scipy.spatial.transform import Rotation
from trust import Part, read

from frischid.checks.log_issue import LogIssue
from frischid.core.types import Array
from frischid.effects import BASELINE
from frischid.logs.log import Log
from frischid.model.log_examination import check
from frischid.motions.simulation import Noise, simulate
from frischid.motions.trajectory import random_fourier
from frischid.regression.regressor import Regressor
from frischid.robot.robot import Robot

ROBOTS: dict[str, dict[str, Any]] = {
    "ur10": {},
    "panda": {"joints": [f"panda_joint{k}" for k in range(1, 8)]},
    "xarm7": {},
    "kinova": {},
    "tiago": {"joints": [f"arm_{k}_joint" for k in range(1, 8)]},
    "ur5": {},
}
"""The first three are for development, the others for the figures that are reported."""


class NoJointError(Exception):
    """The robot has no joint left at which a fault would show."""


@dataclass
class Case:
    """A simulated log and what was done to it: kind of issue, joints (None: any)."""

    robot: Robot
    log: Log
    said: list[tuple[str, tuple[str, ...] | None]]
    rng: np.random.Generator
    used: set[int]
    judged: list[str] | None = None

    def joint(self) -> int:
        """A joint without a fault whose torque is not friction alone: otherwise most faults change nothing."""
        rigid = self.robot.inverse_dynamics(self.log.q, np.zeros_like(self.log.q), self.derivative(2))
        share = rigid.std(axis=0) / np.asarray(self.log.tau).std(axis=0)
        free = [j for j in range(len(self.robot.joints)) if j not in self.used and share[j] > 0.3]
        if not free:
            raise NoJointError
        j = int(self.rng.choice(free))
        self.used.add(j)
        return j

    def derivative(self, order: int) -> Array:
        """Velocity (order 1) or acceleration (2) of the positions, through a window of 0.1 s at least five wide."""
        step = float(np.median(np.diff(self.log.t)))
        width = max(5, 2 * round(0.05 / step) + 1)
        return np.asarray(signal.savgol_filter(self.log.q, width, 3, deriv=order, delta=step, axis=0))

    def column(self, channel: str, j: int, change: Callable[[Array], Array]) -> None:
        """Change one column."""
        values = getattr(self.log, channel)
        if values is None:
            return
        values = np.array(values)
        values[:, j] = change(values[:, j])
        self.log = replace(self.log, **{channel: values})

    def name(self, *columns: int) -> tuple[str, ...]:
        """Names of joints, in the robot's order."""
        return tuple(self.robot.joints[j] for j in sorted(columns))


def all_signs(c: Case) -> None:
    c.log = replace(c.log, tau=-np.asarray(c.log.tau))
    c.said.append(("torque sign", tuple(c.judged or c.robot.joints)))


def one_sign(c: Case) -> None:
    j = c.joint()
    c.column("tau", j, np.negative)
    c.said.append(("torque sign", c.name(j)))


def swapped_torques(c: Case) -> None:
    i, j = c.joint(), c.joint()
    tau = np.array(c.log.tau)
    tau[:, [i, j]] = tau[:, [j, i]]
    c.log = replace(c.log, tau=tau)
    c.said.append(("swapped torques", c.name(i, j)))


def swapped_joints(c: Case) -> None:
    i, j = c.joint(), c.joint()
    order = np.arange(len(c.robot.joints))
    order[[i, j]] = j, i
    v = None if c.log.v is None else c.log.v[:, order]
    c.log = replace(c.log, q=c.log.q[:, order], v=v, tau=np.asarray(c.log.tau)[:, order])
    c.said.append(("swapped joints", c.name(i, j)))


def axis_reversed(c: Case) -> None:
    j = c.joint()
    for channel in ("q", "v", "tau"):
        c.column(channel, j, np.negative)
    c.said.append(("position sign", c.name(j)))


def _seen_zero(c: Case, delta: float) -> int:
    """A joint whose zero changes the torque: that of a vertical first axis does not."""
    q, zero = c.log.q[::50], np.zeros_like(c.log.q[::50])
    own = c.robot.inverse_dynamics(q, zero, zero)
    while True:
        j = c.joint()
        other = c.robot.inverse_dynamics(q + delta * np.eye(q.shape[1])[j], zero, zero)
        if np.abs(other - own).max() > 0.2 * np.abs(own).max():
            return j


def zero_right_angle(c: Case) -> None:
    # not π: at a spherical shoulder a zero that is off by half a turn is the same as a turned neighbouring axis
    delta = float(c.rng.choice([np.pi / 2, -np.pi / 2]))
    j = _seen_zero(c, delta)
    c.column("q", j, lambda q: q - delta)
    c.said.append(("joint zero", c.name(j)))


def zero_free(c: Case) -> None:
    delta = float(c.rng.uniform(0.6, 1.2) * c.rng.choice([-1, 1]))
    j = _seen_zero(c, delta)
    c.column("q", j, lambda q: q - delta)
    c.said.append(("joint zero", c.name(j)))


def one_gain(c: Case) -> None:
    j = c.joint()
    factor = float(c.rng.choice([0.1, 0.3, 3.0, 10.0]))
    c.column("tau", j, lambda x: factor * x)
    c.said.append(("torque scale", c.name(j)))


def unit(c: Case) -> None:
    c.log = replace(c.log, tau=1e3 * np.asarray(c.log.tau))
    c.said.append(("torque scale", tuple(c.judged or c.robot.joints)))


def wrapped(c: Case) -> None:
    """A joint whose angle passes ±π."""
    j = c.joint()
    q = c.log.q[:, j]
    c.column("q", j, lambda x: (x + 2 * np.pi - np.median(q)) % (2 * np.pi) + np.median(q) - 2 * np.pi)
    c.said.append(("wrapped angle", c.name(j)))


def tilted(c: Case) -> None:
    """A base that is tilted: the torque changes by that of the other gravity."""
    axis = c.rng.normal(size=2)
    roll, pitch = c.rng.uniform(0.3, 0.8) * axis / np.linalg.norm(axis)
    turned = Rotation.from_euler("xyz", [roll, pitch, 0.0]).inv().apply(c.robot.gravity)
    other = Robot.from_dict({**c.robot.to_dict(), "gravity": turned.tolist()})
    zero = np.zeros_like(c.log.q)
    more = other.inverse_dynamics(c.log.q, zero, zero) - c.robot.inverse_dynamics(c.log.q, zero, zero)
    c.log = replace(c.log, tau=np.asarray(c.log.tau) + more)
    c.said.append(("mounting", None))


def payload(c: Case) -> None:
    q, v, a = c.log.q, c.derivative(1), c.derivative(2)
    last = [k for k, column in enumerate(c.robot.columns) if column.joint == c.robot.joints[-1]]
    Y = np.empty((len(q), len(c.robot.columns), len(c.robot.joints)))
    c.robot.regressor(q, v, a, Y)
    mass = 0.15 * float(c.robot.nominal[0::10].sum())
    body = mass * np.array([1.0, 0.02, 0.0, 0.1, 0.02, 0, 0.02, 0, 0, 0.01])
    c.log = replace(c.log, tau=np.asarray(c.log.tau) + np.einsum("ncj,c->nj", Y[:, last], body))
    c.said.append(("payload", None))


def spring(c: Case) -> None:
    j = c.joint()
    load = float(np.asarray(c.log.tau)[:, j].std())
    q = c.log.q[:, j]
    c.column("tau", j, lambda x: x + 1.5 * load * (q - q.mean()) / q.std())
    c.said.append(("spring", c.name(j)))


def coupling(c: Case) -> None:
    """A motor that turns with two neighbouring joints."""
    i = int(c.rng.integers(0, len(c.robot.joints) - 1))
    c.used |= {i, i + 1}
    tau, v, a = np.array(c.log.tau), c.derivative(1), c.derivative(2)
    w = v[:, i] + v[:, i + 1]
    size = float(max(tau[:, i].std(), tau[:, i + 1].std()))
    torque = size * (np.tanh(w / 0.05) + w / w.std() + 0.3 * (a[:, i] + a[:, i + 1]))
    tau[:, [i, i + 1]] += torque[:, None]
    c.log = replace(c.log, tau=tau)
    c.said.append(("motor coupling", c.name(i, i + 1)))


def late(c: Case) -> None:
    delay = float(c.rng.uniform(0.04, 0.1))
    tau = np.column_stack([np.interp(c.log.t - delay, c.log.t, x) for x in np.asarray(c.log.tau).T])
    c.log = replace(c.log, tau=tau)
    c.said.append(("late torque", None))


def arrival(c: Case) -> None:
    stamps = c.log.t + np.minimum(c.rng.exponential(0.15, len(c.log)), 0.9) / c.log.rate
    c.log = replace(c.log, t=stamps)
    c.said.append(("host clock", None))


FAULTS: dict[str, Callable[[Case], None]] = {
    f.__name__: f
    for f in (
        all_signs, one_sign, swapped_torques, swapped_joints, axis_reversed, zero_right_angle, zero_free, one_gain,
        unit, wrapped, tilted, payload, spring, coupling, late, arrival,
    )
}  # fmt: skip
PHYSICS = {"tilted", "payload", "spring", "coupling"}
"""What the robot has. It acts before the sensors: planted after an exchange, a coupling would couple other joints."""
ALONE = {"all_signs", "unit"}
"""Faults of all joints, which are not planted with another fault of torques' signs or units."""


def clean(name: str, seed: int, urdf_error: float) -> Case:
    """A log of a robot whose links are not quite those of its URDF."""
    rng = np.random.default_rng(seed)
    robot = Robot.load(name, **ROBOTS[name])
    effort = np.where(np.isfinite(robot.limits.effort), np.minimum(robot.limits.effort, 100), 20)
    values = {}
    for body, k in robot.numbers.items():
        names = [f"{p}{k}" for p in ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")]
        own = dict(zip(robot.all_names, robot.nominal, strict=True))
        factor = np.exp(urdf_error * rng.normal())
        values |= {n: own[n] * factor for n in names}
        if body in robot.joints:
            size = float(effort[robot.joints.index(body)]) * rng.uniform(0.3, 1.0, 3)
            values |= {f"fv{k}": 0.025 * size[0], f"fc{k}": 0.03 * size[1], f"Ia{k}": 0.004 * size[2]}
    known = {column.name for column in Regressor(robot, BASELINE).columns}
    values = {n: float(x) for n, x in values.items() if n in known}
    motion = random_fourier(robot, 20, seed=seed)
    log = simulate(robot, motion, rate=100, noise=Noise(q=1e-5, tau=0.02), parameters=values, channels=(), seed=seed)
    return Case(robot, log, [], rng, set())


MEASURED = {
    "ur10e": "ident_30s_12harm",
    "panda": "ident_0_14s",
    "tiago": "ident_0_48s",
    "lbr_med7": "measurements",
    "staubli_tx40": "ident_0_5s",
}
"""Measured logs in which faults are planted; those of one joint, and of commands alone, leave no choice of joints."""


def measured(name: str, seed: int) -> Case:
    """A measured log with the signs and gains of its card."""
    folder = data_folder()
    assert folder is not None
    urdf = next(p for p in sorted(folder.joinpath(name).glob("*.urdf")) if "with_hand" not in p.name)
    robot = Robot.load(urdf)
    judged = list(TIAGO_ROWS) if name == "tiago" else None
    log = read(folder, robot, name, Part(MEASURED[name]))
    robot = robot.keep([joint for joint in robot.joints if joint in log.joints])
    silent = set() if judged is None else {j for j, n in enumerate(robot.joints) if n not in judged}
    return Case(robot, log, [], np.random.default_rng(seed), silent, judged)


def named(issues: Sequence[LogIssue], said: tuple[str, tuple[str, ...] | None], *, first: bool) -> bool:
    """Whether a fault is among the issues (or the first), with its joints."""
    kind, where = said
    found = issues[:1] if first else issues
    return any(i.kind == kind and (where is None or set(i.where) == set(where)) for i in found)


def main() -> None:
    """Run the benchmark and print its table."""
    options = parser(__doc__)
    options.add_argument("--runs", type=int, default=3, help="runs of each fault on each robot")
    options.add_argument("--pairs", type=int, default=40, help="pairs of faults in all")
    options.add_argument("--seed", type=int, default=1000)
    options.add_argument("--robots", nargs="+", help="all by default")
    options.add_argument("--faults", nargs="+", default=list(FAULTS))
    options.add_argument("--urdf-error", type=float, default=0.1, help="standard deviation of ln(mass of a link)")
    options.add_argument("--measured", action="store_true", help="plant the faults in measured logs (FRISCHID_DATA)")
    options.add_argument("--verbose", action="store_true")
    given = options.parse_args()
    right: Counter[str] = Counter()
    runs: Counter[str] = Counter()
    certain: Counter[bool] = Counter()
    robots = given.robots or list(MEASURED if given.measured else ROBOTS)
    of_the_log: dict[str, set[Any]] = {}

    def start(name: str, seed: int) -> Case:
        return measured(name, seed) if given.measured else clean(name, seed, given.urdf_error)

    def issues_of(case: Case) -> list[LogIssue]:
        (report,) = check(case.robot, [case.log], torque_joints=case.judged)
        return [i for i in report.issues if i.kind != "weak excitation"]

    def examine(label: str, name: str, case: Case, *, first: bool) -> None:
        before = of_the_log.get(name, set())
        if any((kind, where or ()) in before for kind, where in case.said):
            return  # the log has this fault already
        issues = [i for i in issues_of(case) if (i.kind, i.where) not in before]
        ok = all(named(issues, said, first=first) for said in case.said) if case.said else not issues
        right[label] += ok
        runs[label] += 1
        for issue in issues:
            if issue.sure == "certain":
                true = any(issue.kind == k and (w is None or set(issue.where) <= set(w)) for k, w in case.said)
                certain[true] += 1
        if given.verbose and not ok:
            print(label, name, case.said, "->", [(i.kind, i.where, i.sure) for i in issues], flush=True)

    for name in robots:
        if given.measured:  # a measured log may have faults of its own
            clean_issues = issues_of(start(name, 0))
            of_the_log[name] = {(i.kind, i.where) for i in clean_issues}
            print(name, "as measured:", [(i.kind, i.where, i.sure) for i in clean_issues], flush=True)
        for run in range(given.runs):
            seed = given.seed + 97 * run
            for fault in given.faults:
                case = start(name, seed)
                with suppress(NoJointError):
                    FAULTS[fault](case)
                    examine(fault, name, case, first=True)
            for more in range(0 if given.measured else 3):
                examine("clean", name, start(name, seed + 11 * more), first=True)
    rng = np.random.default_rng(given.seed)
    pairs = [p for p in combinations(given.faults, 2) if not ALONE & set(p)]
    for n in range(given.pairs if pairs else 0):
        one, other = pairs[int(rng.integers(len(pairs)))]
        name = robots[n % len(robots)]
        case = start(name, given.seed + 31 * n)
        with suppress(NoJointError):
            for fault in sorted((one, other), key=PHYSICS.__contains__, reverse=True):
                FAULTS[fault](case)
            examine("two faults", name, case, first=False)
    rows = [{"fault": k, "right": right[k], "runs": runs[k], "share": right[k] / runs[k]} for k in runs]
    alone = [k for k in runs if k not in ("clean", "two faults")]
    total = sum(runs[k] for k in alone)
    rows.append(
        {"fault": "alone, all", "right": sum(right[k] for k in alone), "runs": total,
         "share": sum(right[k] for k in alone) / max(total, 1)}
    )  # fmt: skip
    all_certain = certain[True] + certain[False]
    rows.append(
        {"fault": "certain is right", "right": certain[True], "runs": all_certain,
         "share": certain[True] / max(all_certain, 1)}
    )  # fmt: skip
    publish("faults planted in logs", rows, given.json)


if __name__ == "__main__":
    main()
