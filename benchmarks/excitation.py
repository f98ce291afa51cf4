"""How well planned motions excite a robot, and the time that planning takes.

First table: the planar arm and the paper's cost (19) at 100 points, one second apart. The motion keeps the authors'
bounds either at the points only (the authors report 13.57 after 399,671 evaluations) or at every instant. The cost uses
unit noise that is drawn once, like the authors' code. A search can adapt to that one draw, so the mean cost over 200
fresh draws is given too. With FRISCHID_DATA set, the authors' own points are judged in the same way.

Second table: motions of 20 s for robots of six and seven joints. The measure is the condition number of the base
regressor with columns at unit norm, compared with the best of 1,000 random Fourier motions of the same harmonics, each
enlarged until it reaches a limit. Limits are 0.9 of the URDF's; full speed is reached in 0.25 s. If the URDF has
collision shapes, planned motions avoid collisions with the robot itself and with the floor, and random motions are
shrunk until they do. The column "colliding" is the best of random motions that may collide, an easier task.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from common import data_folder, parser, publish

from frischid.core.types import Array
from frischid.effects import BASELINE, Coulomb, Effect, RotorInertia, Viscous
from frischid.motions.collision import Clearance
from frischid.motions.families import Family
from frischid.motions.limits import Excess, MotionLimits
from frischid.motions.motion_cost import Cost
from frischid.motions.optimality import Condition, Criterion, Paper
from frischid.motions.optimize import Search
from frischid.motions.plan import Plan, plan
from frischid.motions.plan_options import PlanOptions, default_size
from frischid.robot.robot import Robot

PAPER_EVALUATIONS = 399_671
DURATION = 20.0


def planar() -> tuple[Robot, tuple[Effect, ...], MotionLimits]:
    """Return the arm, effects and bounds of the paper's section 3.2."""
    robot = Robot.load("planar2", frames="far_end", known={"my1": 0.0, "my2": 0.0})
    rotor = RotorInertia(joints=(robot.joints[1],), coupled=True, ratio=0.1)
    ones = np.ones(2)
    bounds = MotionLimits(-3 * ones, 3 * ones, 5 * ones, 10 * ones, np.full(2, np.inf))
    return robot, (Viscous(), Coulomb(width=1e-3), rotor), bounds


def judge(robot: Robot, effects: Sequence[Effect], t: Array, states: Array, criterion: Criterion, seed: int) -> float:
    """Exact cost of a motion's states at times t."""
    return Cost(robot, effects, t, criterion, seed)(states)


def authors_points() -> Array | None:
    """States (3, 100, 2) of the published motion, if the data are there."""
    folder = data_folder()
    if folder is None:
        return None
    table = np.loadtxt(folder / "frisch_planar" / "exciting_points.csv", delimiter=",", skiprows=1)
    return np.moveaxis(table[:, 1:].reshape(len(table), 3, 2), 1, 0)


def planar_rows(seed: int, budget: int) -> list[dict[str, Any]]:
    """Cost (19) of the paper's motion, of the authors' points, and of three plans."""
    robot, effects, bounds = planar()
    t = np.arange(100.0)

    def fresh(states: Array) -> float:
        return judge(robot, effects, t, states, Paper(draws=200), seed + 1000)

    row = {"motion": "paper (as printed)", "cost": 13.57, "fresh noise": None, "target": None}
    rows = [{**row, "evaluations": PAPER_EVALUATIONS, "seconds": None, "CPU s": None, "violations": None}]
    points = authors_points()
    if points is not None:
        cost = judge(robot, effects, t, points, Paper(), seed)
        rows.append({**rows[0], "motion": "authors' points", "cost": cost, "fresh noise": fresh(points)})
    for family, where, target in (
        ("points", "points", 13.57),
        ("points", "everywhere", 19.0),
        ("fourier", "everywhere", 19.0),
    ):
        start = time.process_time()
        options = PlanOptions(
            duration=99.0, family=family, samples=None if family == "points" else 100,
            criterion="paper", bounds=where, limits=bounds, budget=budget, seed=seed,
        )  # fmt: skip
        found = plan(robot, effects, options)
        rows.append(
            {
                "motion": f"{family}, bounds {where}",
                "cost": found.cost,
                "fresh noise": fresh(np.stack(found.trajectory(t))),
                "target": target,
                "evaluations": found.evaluations,
                "seconds": found.seconds,
                "CPU s": time.process_time() - start,
                "violations": len(found.violations),
            }
        )
    return rows


def random_best(robot: Robot, harmonics: int, count: int, seed: int, clearance: Clearance | None) -> float:
    """Least condition number of `count` random motions that keep the limits; infinite if none of them does."""
    t = np.linspace(0.0, DURATION, 1000)
    coarse = np.linspace(0.0, DURATION, 100)
    family = Family.named("fourier", DURATION, harmonics)
    cost = Cost(robot, BASELINE, coarse, Condition(), seed)
    search = Search(family, cost, Excess(robot, MotionLimits.of(robot), clearance), DURATION, "everywhere", 0)
    rng = np.random.default_rng(seed)
    found: list[tuple[float, Array]] = []
    for _ in range(count):
        y = rng.normal(size=(2 * harmonics + 1, len(robot.joints)))
        y[0] = rng.uniform(-1.0, 1.0, len(robot.joints))
        X = search.lighter(search.random(y), search.at_watch)
        if search.excess.fits(search.at_watch @ X):
            found.append((cost(search.at_samples @ X), X))
    found.sort(key=lambda each: each[0])
    best = [np.stack(family.build(X)(t)) for _, X in found[:10]]
    return min((judge(robot, BASELINE, t, states, Condition(), seed) for states in best), default=np.inf)


def arm_row(name: str, robot: Robot, seed: int, budget: int | None, count: int) -> dict[str, Any]:
    """One robot: the planned motion compared with random ones."""
    t = np.linspace(0.0, DURATION, 1000)
    options = {} if budget is None else {"budget": budget}
    start = time.process_time()
    found: Plan = plan(robot, options=PlanOptions(duration=DURATION, seed=seed, **options))
    planning = time.process_time() - start
    size = default_size("fourier", DURATION)
    best = random_best(robot, size, count, seed, Clearance.of(robot))
    colliding = random_best(robot, size, count, seed, None)
    condition = judge(robot, BASELINE, t, np.stack(found.trajectory(t)), Condition(), seed)
    return {
        "robot": name,
        "condition": condition,
        "random": best,
        "ratio": condition / best,
        "target": 0.5,
        "colliding": colliding,
        "evaluations": found.evaluations,
        "seconds": found.seconds,
        "CPU s": planning,
        "violations": len(found.violations),
        "not checked": "; ".join(found.notes) or "-",
    }


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--seed", type=int, default=0)
    options.add_argument("--budget", type=int, help="evaluations for the arms (default: the planner's)")
    options.add_argument("--random", type=int, default=1000, help="random motions to compare with")
    options.add_argument("--only", choices=["planar", "arms"])
    chosen = options.parse_args()
    rows: list[dict[str, Any]] = []
    if chosen.only != "arms":
        rows = planar_rows(chosen.seed, PAPER_EVALUATIONS // 10)
        publish("Planar arm: cost (19) at 100 points, one second apart", rows, chosen.json)
    if chosen.only == "planar":
        return
    arms = {
        "panda": Robot.load("panda", joints=[f"panda_joint{i}" for i in range(1, 8)]),
        "ur10": Robot.load("ur10"),
    }
    folder = data_folder()
    if folder is not None:
        arms["ur10e"] = Robot.load(folder / "ur10e" / "ur10e.urdf")
    table = [arm_row(name, robot, chosen.seed, chosen.budget, chosen.random) for name, robot in arms.items()]
    path: Path | None = chosen.json and chosen.json.with_stem(chosen.json.stem + "_arms")
    publish("20 s motions: condition number, columns at unit norm", table, path)


if __name__ == "__main__":
    main()
