"""Physically consistent export: its price in held-out error, and whether the bounds contain the true parameters.

Real logs (FRISCHID_DATA): a UR10e, a Panda, a TIAGo. Simulated logs: the planar arm and arms of example-robot-data.
Every simulated link differs from the URDF (mass by up to 30 %, shape by up to 20 %, centre of mass by 1 cm), and the
URDF has no friction; torque noise is 2 %, encoder noise 1e-5 rad, and only q and the torque are measured. Bounds are
value ± Bonferroni t (95 %, all parameters at once) × s.e., so about one run in twenty may have a parameter outside; the
benchmark tests that there are not more. Every URDF is written, loaded again and compared on random states.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from common import data_folder, parser, publish
from real_robots import CASES
from scipy import stats

import frischid as fr
from frischid.motions.simulation import parameters_of
from frischid.robot.inertia import dynamic_parameters, is_physical, pseudo_inertia

SECONDS = 40.0
SIMULATED = ("planar2", "ur10", "kinova", "ur5")
FRICTION = "viscous, coulomb, offset, rotor_inertia"
ALLOWED = 1.05


def other_robot(robot: fr.Robot, rng: np.random.Generator) -> dict[str, float]:
    """True parameters: every link stretched, moved and made heavier or lighter, so that it stays physical."""
    values: dict[str, float] = {}
    for i, P in enumerate(pseudo_inertia(robot.nominal.reshape(-1, 10)), start=1):
        A = np.eye(4)
        A[:3, :3] = np.diag(rng.uniform(0.8, 1.2, 3))
        A[:3, 3] = rng.normal(0, 0.01, 3)
        theta = rng.uniform(0.7, 1.3) * dynamic_parameters(A @ P @ A.T)
        values |= dict(zip(robot.all_names[10 * (i - 1) : 10 * i], map(float, theta), strict=True))
    columns = [c for effect in fr.parse_effects(FRICTION) for c in effect.columns(robot)]
    values |= {c.name: float(rng.uniform(0.1, 1.0)) for c in columns}
    return values


def simulated(name: str, seed: int) -> tuple[fr.Robot, Sequence[fr.Log], Sequence[fr.Log], dict[str, float]]:
    """A robot, a log to fit, a held-out log of 20 s, and the truth."""
    robot = fr.Robot.load(name)
    truth = other_robot(robot, np.random.default_rng(seed))

    def log(seconds: float, motion: int) -> fr.Log:
        return fr.simulate(
            robot, fr.random_fourier(robot, seconds, seed=motion), rate=200, effects=fr.parse_effects(FRICTION),
            parameters=truth, noise=fr.Noise(q=1e-5, tau=0.02), channels=(), seed=motion,
        )  # fmt: skip

    return robot, [log(SECONDS, 10 * seed + 1)], [log(20.0, 10 * seed + 2)], truth


def judged(
    name: str, found: fr.Identification, valid: Sequence[fr.Log], truth: Mapping[str, float] | None
) -> dict[str, Any]:
    """One line of the table."""
    assert found.comparison is not None
    start = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        done = fr.export(found.model, Path(folder) / "robot.urdf")
    seconds = time.perf_counter() - start
    assert done.consistency is not None
    after, model = fr.compare(done.model, valid), found.model
    result = done.consistency.result
    ratio = after.nrmse / found.comparison.nrmse
    row: dict[str, Any] = {
        "robot": name,
        "links": len(model.robot.bodies),
        "p": len(model.base),
        "all physical": bool(result.feasible and is_physical(done.model.links).all()),
        "least eigenvalue": float(result.eigenvalues.min()),
        "χ²": result.misfit,
        "largest change/s.e.": float(np.abs(done.consistency.change).max()),
        "NRMSE before": found.comparison.nrmse,
        "NRMSE physical": after.nrmse,
        "ratio": ratio,
        f"≤ {ALLOWED}": bool(ratio <= ALLOWED),
        "URDF − model": done.difference,
        "truth in bounds": "–",
        "seconds": seconds,
    }
    if truth is not None:
        base = found.reduction.mapping @ parameters_of(model.robot, model.effects, truth)
        blocks = SECONDS  # blocks of about a second, as in the jackknife of the standard errors
        limit = stats.t.ppf(1 - 0.025 / len(base), blocks - 1) * model.estimate.stderr
        row["truth in bounds"] = int((np.abs(done.model.estimate.theta - base) <= limit).sum())
    return row


def worst(rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Several runs of one robot as one line: the worst of each figure."""
    p = rows[0]["p"]
    inside = [row["truth in bounds"] for row in rows]
    least = {key: min(row[key] for row in rows) for key in ("all physical", "least eigenvalue", f"≤ {ALLOWED}")}
    most = {key: max(row[key] for row in rows) for key in rows[0] if key not in {*least, "robot", "truth in bounds"}}
    told = f"{sum(inside)} of {p * len(rows)}, all in {sum(n == p for n in inside)} of {len(rows)} runs"
    return {key: {**most, **least, "truth in bounds": told}.get(key, x) for key, x in rows[0].items()}


def main() -> None:
    """Print the table."""
    options = parser(__doc__)
    options.add_argument("--robots", nargs="+", default=SIMULATED, help="robots to simulate")
    options.add_argument("--runs", type=int, default=20, help="runs of each simulated robot, each with another truth")
    arguments = options.parse_args()
    rows = []
    for place, name in enumerate(arguments.robots, start=1):
        runs = []
        for seed in range(100 * place, 100 * place + arguments.runs):  # no two robots share their noise
            robot, logs, valid, truth = simulated(name, seed)
            found = fr.identify(robot, logs, valid=valid, effects=fr.parse_effects(FRICTION), recursion="none")
            runs.append(judged(f"{name} (simulated)", found, valid, truth))
        rows.append(worst(runs))
    folder, notes = data_folder(), []
    for case in CASES if folder is not None else ():
        machine = fr.Robot.load(folder / case.urdf)
        fit, valid = (
            [fr.read_log(folder / path, machine.joints, case.mapping) for path in paths]
            for paths in (case.fit, case.valid)
        )
        found = fr.identify(machine, fit, valid=valid, torque_joints=case.torque_joints, recursion="none")
        rows.append(judged(f"{case.name} (measured)", found, valid, None))
    if folder is None:
        notes.append("FRISCHID_DATA is not set: no measured logs")
    notes.append(
        f"simulated robots: the worst of {arguments.runs} runs, none left out; truth in bounds: of physical links"
    )
    publish("physically consistent export", rows, arguments.json, notes)


if __name__ == "__main__":
    main()
