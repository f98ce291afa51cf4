"""The motion that tells a robot's parameters apart best, within what the robot may do.

    plan(robot, duration=20).save("exciting.csv")

A criterion of the base regressor Π of the motion is made small (`criteria`): its condition number, the volume of the
confidence ellipsoid, or the paper's cost (19). The decision variables are the coefficients of a family of motions
(`trajectory`): Fourier series, B-splines, or m points (q, q̇, q̈) joined by quintics, all at rest at both ends. The
limits hold at every instant, not only at samples (`envelope`), and bodies keep clear of one another and of the floor
(`clearance`). How the search works is told in `search`.

References: J. Swevers et al., "Optimal robot excitation and identification", IEEE Trans. Robotics and Automation 13(5),
1997; M. Gautier and W. Khalil, "Exciting trajectories for the identification of base inertial parameters of robots",
Int. J. Robotics Research 11(4), 1992; S. Massaroli et al., "Frisch Scheme Identification of Robots Dynamic Parameters",
section 3.2.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from frischid.core.parallel import Workers
from frischid.core.types import Array
from frischid.effects import BASELINE, Effect
from frischid.errors import InputError, UnknownNameError
from frischid.logs.log import Log
from frischid.logs.readers import write_log
from frischid.motions.collision import Clearance
from frischid.motions.limits import Excess, MotionLimits, Violation, violations
from frischid.motions.optimality import Criterion, criterion_of
from frischid.motions.optimize import ATTEMPTS, Bounds, Cost, Progress, Search
from frischid.motions.trajectory import FAMILIES, ClosedForm, Family
from frischid.robot.robot import Robot

BUDGET = 30_000


@dataclass(frozen=True, eq=False)
class Plan:
    """A motion to excite a robot with.

    Attributes
    ----------
    joints : tuple of str
    trajectory : Fourier, BSpline or Quintic
    criterion : str
        Name of the cost.
    cost : float
        Its value at the samples of the final motion.
    history : ndarray, shape (n, 2)
        Evaluations used, and the best cost by then of a motion that seemed to fit; a step up marks a repair of one that
        did not between the times that were watched.
    evaluations : int
        Regressors of all N samples that were computed; a gradient counts as all the displaced ones it takes.
    seconds : float
        Time the search took.
    violations : tuple of Violation
        Limits that are not met somewhere on the motion, with joint and time.
    notes : tuple of str
        What was not checked.
    """

    joints: tuple[str, ...]
    trajectory: ClosedForm
    criterion: str
    cost: float
    history: Array
    evaluations: int
    seconds: float
    violations: tuple[Violation, ...]
    notes: tuple[str, ...]

    def to_log(self, rate: float) -> Log:
        """Sample t, q, v and a at `rate` Hz, from the start on."""
        if not (np.isfinite(rate) and rate > 0):
            raise InputError(f"the rate must be a positive number of Hz, got {rate}")
        steps = int(np.floor(rate * self.trajectory.duration * (1 + 1e-12)))
        t = np.arange(steps + 1) / rate
        q, v, a = self.trajectory(t)
        return Log(t, self.joints, q, v, a, source=f"exciting motion ({self.criterion} {self.cost:.4g})")

    def save(self, path: str | Path, rate: float = 100.0) -> None:
        """Write columns t, q_<joint>, v_<joint>, a_<joint> as CSV, Parquet or NPZ, by the file's ending."""
        write_log(self.to_log(rate), path)


def plan(
    robot: Robot,
    effects: Sequence[Effect] = BASELINE,
    *,
    duration: float = 20.0,
    family: str = "fourier",
    size: int | None = None,
    samples: int | None = None,
    criterion: str | Criterion = "condition",
    bounds: Bounds = "everywhere",
    envelope: MotionLimits | float = 0.9,
    clearance: Clearance | None = None,
    budget: int = BUDGET,
    seed: int = 0,
    starts: int = 1,
    workers: Workers | None = None,
    progress: Progress | None = None,
) -> Plan:
    """Search for an exciting motion.

    Parameters
    ----------
    robot : Robot
    effects : sequence of Effect
        What is to be identified besides the rigid bodies.
    duration : float
        Seconds.
    family : {"fourier", "bspline", "points"}
    size : int, optional
        Harmonics, control points, or via points; by default as many as the limits let the robot make use of, and one
        via point a second.
    samples : int, optional
        Equally spaced instants the criterion is computed at; the via points themselves in the family ``"points"``.
    criterion : str or Criterion
        Name in `CRITERIA`, or an instance.
    bounds : {"everywhere", "points"}
        ``"points"`` keeps the limits at the via points only, as the paper does; `Plan.violations` tells what happens
        between. Torque and distances are then ignored.
    envelope : MotionLimits or float
        Limits, or the share of the URDF's limits to use.
    clearance : Clearance, optional
        Pairs of bodies to keep apart; made from the URDF's collision shapes, floor at the base, when not given.
    budget : int
        Evaluations of the criterion of each start, the cost of its gradients included.
    seed : int
        The same seed gives the same motion.
    starts : int
        Searches from different beginnings; the best motion that fits is taken.
    workers : Workers, optional
        Where the searches are done, this process by default; the motion is the same.
    progress : callable, optional
        Called with the share of the budget that is used and the best cost so far; elsewhere, with the share of the
        searches that are done.

    Returns
    -------
    Plan
    """
    began = time.perf_counter()
    if starts < 1:
        raise InputError(f"a search needs at least one start, got {starts}")
    if not (np.isfinite(duration) and duration > 0):
        raise InputError(f"the duration must be a positive number of seconds, got {duration}")
    if family not in FAMILIES:
        raise UnknownNameError("family", family, FAMILIES)
    if bounds not in {"everywhere", "points"}:
        raise UnknownNameError("bounds", bounds, ["everywhere", "points"])
    if bounds == "points" and family != "points":
        raise InputError(f"bounds at the points need family 'points'; '{family}' has none")
    limits = envelope if isinstance(envelope, MotionLimits) else MotionLimits.of(robot, envelope)
    space = Clearance.of(robot) if clearance is None else clearance
    shape = Family.named(family, duration, _size(family, size, duration))
    instants = _instants(family, shape, samples, duration)
    box = _box(limits, shape) if family == "points" else None
    looked_at = criterion_of(criterion)
    task = _Task(robot, tuple(effects), shape, instants, looked_at, limits, space, duration, bounds, budget, box)
    seeds = [seed + ATTEMPTS * k for k in range(starts)]
    if workers is None:
        done = []
        for k, own in enumerate(seeds):
            done.append(_searched(own, task, None if progress is None else _share(progress, k, starts)))
    else:
        told = progress or (lambda share, best: None)
        done = workers.gather(workers.map(_searched, seeds, task), lambda count, of: told(count / of, np.nan))
    best = min(done, key=lambda each: (len(each.violations), each.cost))
    evaluations = sum(each.evaluations for each in done)
    return replace(best, evaluations=evaluations, seconds=time.perf_counter() - began)


@dataclass(frozen=True, eq=False)
class _Task:
    """What every start of a search has in common."""

    robot: Robot
    effects: tuple[Effect, ...]
    shape: Family
    instants: Array
    criterion: Criterion
    limits: MotionLimits
    space: Clearance
    duration: float
    bounds: Bounds
    budget: int
    box: tuple[Array, Array] | None


def _searched(seed: int, task: _Task, progress: Progress | None = None) -> Plan:
    """One start, in any process."""
    search = Search(
        family=task.shape,
        cost=Cost(task.robot, task.effects, task.instants, task.criterion, seed),
        excess=Excess(task.robot, task.limits, task.space),
        duration=task.duration,
        bounds=task.bounds,
        budget=task.budget,
        box=task.box,
        progress=progress,
    )
    # Small products are slower on several threads.
    with threadpool_limits(limits=1, user_api="blas"):
        X = search.run(seed)
    motion = task.shape.build(X)
    return Plan(
        joints=task.robot.joints,
        trajectory=motion,
        criterion=search.cost.criterion.name,
        cost=search.cost(search.at_samples @ X),
        history=np.array(search.history).reshape(-1, 2),
        evaluations=search.cost.evaluations,
        seconds=0.0,
        violations=tuple(violations(task.robot, motion, task.limits, task.space)),
        notes=task.space.notes,
    )


def _share(progress: Progress, number: int, starts: int) -> Progress:
    """Progress of one start as progress of all."""
    return lambda share, best: progress((number + share) / starts, best)


def default_size(family: str, duration: float) -> int:
    """Harmonics up to 1.2 Hz, two control points a second, or one via point a second; a few at least."""
    wanted = {"fourier": round(1.2 * duration), "bspline": round(2 * duration), "points": round(duration) + 1}
    return max(wanted[family], 6)


def _size(family: str, size: int | None, duration: float) -> int:
    """Check the size of a family, or choose it."""
    least = 2 if family == "fourier" else 3
    chosen = default_size(family, duration) if size is None else size
    if chosen < least:
        raise InputError(f"family '{family}' needs a size of at least {least}, got {size}")
    return chosen


def _instants(family: str, shape: Family, samples: int | None, duration: float) -> Array:
    """When the criterion looks at the motion."""
    if family == "points":
        count = int(shape.constant.sum())
        if samples not in {None, count}:
            raise InputError(f"family 'points' is judged at its {count} points; leave the samples out")
        return np.linspace(0.0, duration, count)
    count = max(100, round(7.5 * duration)) if samples is None else samples
    if count < 2:
        raise InputError(f"a criterion needs at least 2 samples, got {samples}")
    return np.linspace(0.0, duration, count)


def _box(limits: MotionLimits, shape: Family) -> tuple[Array, Array]:
    """Limits at the via points, as limits of their coefficients."""
    count = int(shape.constant.sum())
    repeats = (count, count - 2, count - 2)
    high = np.repeat(np.stack([limits.upper, limits.velocity, limits.acceleration]), repeats, axis=0)
    low = np.repeat(np.stack([limits.lower, -limits.velocity, -limits.acceleration]), repeats, axis=0)
    return low, high
