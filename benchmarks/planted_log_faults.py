"""Faults planted in simulated logs: how often `check` names them first, alone and two at a time.

Arms of example-robot-data move with friction and with links that differ from their URDF's by `--urdf-error`. Each fault
is planted at a random joint with a random size. Printed are, for each fault, the share of runs in which it is the first
issue, with its joints; for pairs of faults the share in which both are named; the share of clean logs in which nothing
is; and the share of right ones among all issues that are "certain". With `--measured` the faults are planted in
measured logs; what `check` says of such a log as it is does not count.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from itertools import combinations
from typing import Any

import numpy as np
from common import data_folder, parser, publish
from log_faults import ALONE, FAULTS, PHYSICS, Case, NoJointError
from real_robots import TIAGO_ROWS
from trust import Part, read

from frischid.checks.log_issue import LogIssue
from frischid.effects import BASELINE
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


class Study:
    """Counts of right answers over the logs that were examined."""

    def __init__(self, *, planted_in_measured: bool, urdf_error: float, verbose: bool) -> None:
        self.measured, self.urdf_error, self.verbose = planted_in_measured, urdf_error, verbose
        self.right: Counter[str] = Counter()
        self.runs: Counter[str] = Counter()
        self.certain: Counter[bool] = Counter()
        self.of_the_log: dict[str, set[tuple[str, tuple[str, ...]]]] = {}

    def start(self, name: str, seed: int) -> Case:
        """A log without planted faults."""
        return measured(name, seed) if self.measured else clean(name, seed, self.urdf_error)

    def note_own_issues(self, name: str) -> None:
        """A measured log may have faults of its own: what `check` says of the log as it is does not count later."""
        own = issues_of(self.start(name, 0))
        self.of_the_log[name] = {(i.kind, i.where) for i in own}
        print(name, "as measured:", [(i.kind, i.where, i.sure) for i in own], flush=True)

    def plant(self, label: str, name: str, seed: int, faults: Sequence[str], *, first: bool) -> None:
        """Plant faults, physics before sensors, and examine; a robot without a joint for them is left out."""
        case = self.start(name, seed)
        with suppress(NoJointError):
            for fault in sorted(faults, key=PHYSICS.__contains__, reverse=True):
                FAULTS[fault](case)
            self.examine(label, name, case, first=first)

    def examine(self, label: str, name: str, case: Case, *, first: bool) -> None:
        """Ask `check`, and count."""
        before = self.of_the_log.get(name, set())
        if any((kind, where or ()) in before for kind, where in case.said):
            return  # the log has this fault already
        issues = [i for i in issues_of(case) if (i.kind, i.where) not in before]
        ok = all(named(issues, said, first=first) for said in case.said) if case.said else not issues
        self.right[label] += ok
        self.runs[label] += 1
        for issue in issues:
            if issue.sure == "certain":
                true = any(issue.kind == k and (w is None or set(issue.where) <= set(w)) for k, w in case.said)
                self.certain[true] += 1
        if self.verbose and not ok:
            print(label, name, case.said, "->", [(i.kind, i.where, i.sure) for i in issues], flush=True)

    def rows(self) -> list[dict[str, Any]]:
        """Lines of the table."""
        alone = [k for k in self.runs if k not in ("clean", "two faults")]
        counts = {k: (self.right[k], self.runs[k]) for k in self.runs}
        counts["alone, all"] = sum(self.right[k] for k in alone), sum(self.runs[k] for k in alone)
        counts["certain is right"] = self.certain[True], self.certain.total()
        return [{"fault": k, "right": r, "runs": n, "share": r / max(n, 1)} for k, (r, n) in counts.items()]


def issues_of(case: Case) -> list[LogIssue]:
    """What `check` says of a log, but for what the motion does not excite."""
    (report,) = check(case.robot, [case.log], torque_joints=case.judged)
    return [i for i in report.issues if i.kind != "weak excitation"]


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
    robots = given.robots or list(MEASURED if given.measured else ROBOTS)
    study = Study(planted_in_measured=given.measured, urdf_error=given.urdf_error, verbose=given.verbose)
    for name in robots:
        if given.measured:
            study.note_own_issues(name)
        for run in range(given.runs):
            seed = given.seed + 97 * run
            for fault in given.faults:
                study.plant(fault, name, seed, [fault], first=True)
            for more in range(0 if given.measured else 3):
                study.examine("clean", name, study.start(name, seed + 11 * more), first=True)
    rng = np.random.default_rng(given.seed)
    pairs = [p for p in combinations(given.faults, 2) if not ALONE & set(p)]
    for n in range(given.pairs if pairs else 0):
        pair = pairs[int(rng.integers(len(pairs)))]
        study.plant("two faults", robots[n % len(robots)], given.seed + 31 * n, pair, first=False)
    publish("faults planted in logs", study.rows(), given.json)


if __name__ == "__main__":
    main()
