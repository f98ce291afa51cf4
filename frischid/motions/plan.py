"""The motion from which a robot's parameters can be estimated best, within the robot's limits.

    plan(robot, options=PlanOptions(duration=20)).save("exciting.csv")

The plan minimises a criterion of the base regressor Π of the motion (`optimality`): its condition number, the volume of
the confidence ellipsoid, or the paper's cost (19). The decision variables are the coefficients of a family of motions
(`trajectory`): Fourier series, B-splines, or m points (q, q̇, q̈) joined by quintics, all at standstill at both ends.
The limits hold at every instant, not only at samples (`limits`), and bodies touch neither one another nor the floor
(`collision`). `optimize` explains the search.

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

from frischid.core.arguments import check_kind
from frischid.core.parallel import Workers
from frischid.core.shown import Shown
from frischid.core.threads import one_thread
from frischid.core.types import Array
from frischid.effects import BASELINE, Effect
from frischid.effects.base import check_effects
from frischid.errors import InputError
from frischid.logs.log import Log
from frischid.logs.readers import write_log
from frischid.motions.collision import Clearance
from frischid.motions.families import Family
from frischid.motions.limits import CHECK_RATE, Excess, MotionLimits, Violation, assumed_limits, violations
from frischid.motions.motion_cost import Cost
from frischid.motions.motion_request import check_rate, check_runs
from frischid.motions.optimality import criterion_of, inflation
from frischid.motions.optimize import ATTEMPTS, Progress, Search
from frischid.motions.plan_options import PlanOptions
from frischid.motions.trajectory import ClosedForm
from frischid.robot.robot import Robot
from frischid.robot.stated_inertials import unstated

CLOSED = 1e-6
"""rad (m). A motion that ends this near to its start can run again without a jump."""


@dataclass(frozen=True, eq=False)
class Plan(Shown):
    """A motion that excites a robot's parameters.

    Attributes
    ----------
    joints : tuple of str
    trajectory : Fourier, BSpline or Quintic
    criterion : str
        Name of the criterion.
    cost : float
        Its value for the final motion, sampled at 100 Hz. The search looks at fewer samples and so finds a slightly
        lower value. Cost (19) of the paper is that of its points.
    history : ndarray, shape (n, 2)
        Number of evaluations, and the best cost so far, at the samples of the search, of a motion that seemed to keep
        its limits. A step up marks a repair: the motion exceeded a limit between the times of the grid.
    evaluations : int
        Number of computed regressors of all N samples; a gradient counts as the displaced regressors that it needs.
    seconds : float
        Time of the search, s.
    inflation : dict of str to float
        Standard error of each base parameter on this motion, over its standard error where all others are known, the
        largest first (`frischid.motions.optimality.inflation`).
    violations : tuple of Violation
        Limits that the motion does not keep, with joint and time.
    notes : tuple of str
        Limits and distances that were not checked.

    Examples
    --------
    >>> import frischid as fr
    >>> found = fr.plan(fr.Robot.load("planar2"), options=fr.PlanOptions(duration=4.0, budget=20, seed=0))
    >>> found.joints, found.violations
    (('joint1', 'joint2'), ())
    >>> found.to_log(rate=50.0).q.shape
    (201, 2)
    """

    joints: tuple[str, ...]
    trajectory: ClosedForm
    criterion: str
    cost: float
    history: Array
    evaluations: int
    seconds: float
    inflation: dict[str, float]
    violations: tuple[Violation, ...]
    notes: tuple[str, ...]

    def to_log(self, rate: float, repeat: int = 1) -> Log:
        """Sample t, q, v and a at `rate` Hz, from the start on.

        Parameters
        ----------
        rate : float
            Samples per second, Hz.
        repeat : int
            Runs of the motion, one after another without a pause: what differs between the runs is noise.

        Raises
        ------
        InputError
            There is no run, or a motion that comes again does not end where it began.
        """
        duration = self.trajectory.duration
        check_rate(rate, duration)
        self.check_repeat(repeat)
        steps = int(np.floor(rate * repeat * duration * (1 + 1e-12)))
        t = np.arange(steps + 1) / rate
        within = t if repeat == 1 else t - duration * np.minimum(np.floor(t / duration * (1 + 1e-12)), repeat - 1)
        q, v, a = self.trajectory(np.clip(within, 0.0, duration))
        return Log(t, self.joints, q, v, a, source=f"exciting motion ({self.criterion} {self.cost:.4g})")

    def check_repeat(self, repeat: int) -> None:
        """Refuse a number of runs that is none, and runs of a motion that does not end where it began.

        Raises
        ------
        InputError
            The number is not positive, or the motion cannot be repeated without a jump.
        """
        check_runs(repeat)
        (start, *_), (end, *_) = (self.trajectory(np.array([when])) for when in (0.0, self.trajectory.duration))
        if repeat > 1 and np.abs(end - start).max() > CLOSED:
            joint = self.joints[int(np.abs(end - start).max(axis=0).argmax())]
            raise InputError(
                f"this motion cannot be repeated: {joint} does not end where it began; plan with the family fourier"
            )

    def save(self, path: str | Path, rate: float = 100.0, repeat: int = 1) -> None:
        """Write columns t, q_<joint>, v_<joint>, a_<joint> as CSV, Parquet or NPZ, by the file's ending.

        `repeat` is the number of runs of the motion, see `to_log`.
        """
        write_log(self.to_log(rate, repeat), path)


def plan(
    robot: Robot,
    effects: Sequence[Effect] = BASELINE,
    options: PlanOptions | None = None,
    *,
    workers: Workers | None = None,
    progress: Progress | None = None,
) -> Plan:
    """Search for an exciting motion.

    Parameters
    ----------
    robot : Robot
    effects : sequence of Effect
        Effects to identify besides the rigid bodies.
    options : PlanOptions, optional
        ``PlanOptions()`` by default.
    workers : Workers, optional
        Processes that do the searches, this process by default; the motion is the same.
    progress : callable, optional
        Called with the share of the budget that is used and the best cost so far; with workers, with the share of
        finished searches.

    Returns
    -------
    Plan

    Raises
    ------
    InputError
        The limits are not usable, or the samples are too few for the base parameters.

    Examples
    --------
    >>> import frischid as fr
    >>> from frischid.motions.plan import plan
    >>> from frischid.motions.plan_options import PlanOptions
    >>> found = plan(fr.Robot.load("planar2"), options=PlanOptions(duration=3.0, samples=20, budget=100))
    >>> found.violations, len(found.to_log(rate=50.0))
    ((), 151)
    """
    began = time.perf_counter()
    options = options or PlanOptions()
    check_kind("robot", robot, Robot, "robot=frischid.Robot.load(path or name)")
    check_kind("options", options, PlanOptions, "options=frischid.PlanOptions(duration=10.0)")
    check_effects(effects)
    given = options.limits
    limits = given if isinstance(given, MotionLimits) else MotionLimits.of(robot, given)
    options = options.within(limits)
    clearance = Clearance.of(robot) if options.clearance is None else options.clearance
    task = _Task(robot, tuple(effects), options, limits, clearance)
    seeds = [options.seed + ATTEMPTS * k for k in range(options.starts)]
    if workers is None:
        done = []
        for k, own in enumerate(seeds):
            done.append(_searched(own, task, None if progress is None else _share(progress, k, options.starts)))
    else:
        told = progress or (lambda share, best: None)
        done = workers.gather(workers.map(_searched, seeds, task), lambda count, of: told(count / of, np.nan))
    best = min(done, key=lambda each: (len(each.violations), each.cost))
    evaluations = sum(each.evaluations for each in done)
    return replace(best, evaluations=evaluations, seconds=time.perf_counter() - began)


@dataclass(frozen=True, eq=False)
class _Task:
    """Data that all starts of a search share."""

    robot: Robot
    effects: tuple[Effect, ...]
    options: PlanOptions
    limits: MotionLimits
    clearance: Clearance


def _searched(seed: int, task: _Task, progress: Progress | None = None) -> Plan:
    """The search from one start, in any process."""
    options, shape = task.options, task.options.shape()
    search = Search(
        family=shape,
        cost=Cost(task.robot, task.effects, options.instants(), criterion_of(options.criterion), seed),
        excess=Excess(task.robot, task.limits, task.clearance),
        duration=options.duration,
        bounds=options.bounds,
        budget=options.budget,
        box=_box(task.limits, shape) if options.family == "points" else None,
        progress=progress,
    )
    # Small products are slower on several threads.
    with one_thread():
        X = search.run(seed)
    motion = shape.build(X)
    sampled = np.linspace(0.0, search.duration, int(np.ceil(CHECK_RATE * search.duration)) + 1)
    W = search.cost.base_regressor(sampled, np.stack(motion(sampled)))
    inflated = dict(zip(search.cost.names, inflation(W).tolist(), strict=True))
    return Plan(
        joints=task.robot.joints,
        trajectory=motion,
        criterion=search.cost.criterion.name,
        cost=_final_cost(search, W, X),
        history=np.array(search.history).reshape(-1, 2),
        evaluations=search.cost.evaluations,
        seconds=0.0,
        inflation=dict(sorted(inflated.items(), key=lambda item: -item[1])),
        violations=tuple(violations(task.robot, motion, task.limits, task.clearance)),
        notes=tuple(filter(None, (*task.clearance.notes, assumed_limits(task.robot), *_of_torques(task.robot)))),
    )


def _of_torques(robot: Robot) -> list[str]:
    what = unstated(robot)
    said = "the torques of this plan, and their comparison with limits, mean nothing; run the motion slowly first"
    return [f"the URDF has {what}: {said}"] if what else []


def _final_cost(search: Search, W: Array, X: Array) -> float:
    """Cost of the motion with coefficients X as a log will hold it: W is its base regressor, (M, p, J)."""
    if search.bounds == "points" or search.cost.criterion.of_points:
        return search.cost(search.at_samples @ X)
    return search.cost.criterion(W[None])[0]


def _share(progress: Progress, number: int, starts: int) -> Progress:
    """Progress of all starts from the progress of one."""
    return lambda share, best: progress((number + share) / starts, best)


def _box(limits: MotionLimits, shape: Family) -> tuple[Array, Array]:
    """Limits at the via points, as limits of the family's coefficients."""
    count = int(shape.constant.sum())
    repeats = (count, count - 2, count - 2)
    high = np.repeat(np.stack([limits.upper, limits.velocity, limits.acceleration]), repeats, axis=0)
    low = np.repeat(np.stack([limits.lower, -limits.velocity, -limits.acceleration]), repeats, axis=0)
    return low, high
