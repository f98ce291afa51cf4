"""The motion of commands from which the parameters of position drives can be estimated best.

    plan_for_drives(robot, PlanOptions(duration=20, family="chirps")).save("commands.csv")

The planned motion is sent as commands, and the joints follow as well as their drives can. The plan minimises the mean
log variance of armature, friction, delay and gains, beside the links with the usual errors of a URDF
(`frischid.motions.drive_information`). The answer says how much narrower their bounds are than on random motions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from frischid.core.parallel import Workers
from frischid.core.types import Array
from frischid.effects import BASELINE, Effect, RotorInertia
from frischid.estimators.urdf_prior import PriorCriteria, link_spread
from frischid.motions.discrimination import TYPICAL
from frischid.motions.drive_information import DriveInformation
from frischid.motions.limits import MotionLimits, nominal_torque
from frischid.motions.optimize import Progress
from frischid.motions.plan import Plan, plan
from frischid.motions.plan_options import PlanOptions
from frischid.motions.trajectory import Trajectory, random_fourier
from frischid.regression.regressor import Regressor, nominal_parameters
from frischid.regression.structure import structure
from frischid.robot.robot import Robot

DRIVES_FAMILY = "chirps"
"""The family of motions where none is named: its ranges are the narrowest (`benchmarks/drive_excitation.py`)."""
NOISE_SHARE = 0.02
"""Noise of the computed torque over the torque's size, as that of an encoder of 12 bits under a soft position loop."""
ROWS_PER_SECOND = 20.0
"""Independent rows of a log in a second: about two per hertz of the filter's cut-off."""
DELAY_SPREAD = 0.02
"""s. Usual delay of a command."""
TORQUE_STATES = 200
"""Random states from which the size of each joint's torque is known."""


@dataclass(frozen=True, eq=False)
class DrivePlan:
    """A motion of commands, planned for the drives.

    Attributes
    ----------
    plan : Plan
    narrower : dict of str to float
        Kind of parameter (``"armature"``, ``"friction"``, ``"delay"``, ``"gains"``) -> standard errors in the median of
        random motions over those on this motion, geometric mean over the joints.

    Examples
    --------
    >>> import frischid as fr
    >>> options = fr.PlanOptions(duration=6.0, family="chirps", budget=60)
    >>> fr.plan_for_drives(fr.Robot.load("planar2"), options).plan.trajectory.duration
    6.0
    """

    plan: Plan
    narrower: dict[str, float]


def plan_for_drives(
    robot: Robot,
    options: PlanOptions | None = None,
    effects: Sequence[Effect] = BASELINE,
    *,
    workers: Workers | None = None,
    progress: Progress | None = None,
) -> DrivePlan:
    """Plan a motion of commands for the parameters of position drives.

    Parameters
    ----------
    robot : Robot
    options : PlanOptions, optional
        As for `frischid.plan`, except that the criterion is always the drives'; the family ``"chirps"`` by default.
    effects : sequence of Effect
        Effects to identify besides the links; those that a joint has alone count as its drive's.
    workers, progress
        As for `frischid.plan`.

    Returns
    -------
    DrivePlan

    Raises
    ------
    InputError
        The limits are not usable, or the motion is too short.

    Examples
    --------
    >>> import frischid as fr
    >>> options = fr.PlanOptions(duration=6.0, family="chirps", budget=60)
    >>> found = fr.plan_for_drives(fr.Robot.load("planar2"), options)
    >>> sorted(found.narrower)
    ['armature', 'delay', 'friction', 'gains']
    >>> found.plan.violations
    ()
    """
    options = options or PlanOptions(family=DRIVES_FAMILY)
    given = options.limits
    limits = given if isinstance(given, MotionLimits) else MotionLimits.of(robot, given)
    options = options.within(limits)
    regressor = Regressor(robot, effects)
    wanted = _information(regressor, options, limits)
    planned = plan(robot, effects, replace(options, criterion=wanted), workers=workers, progress=progress)
    duration = planned.trajectory.duration
    others = [random_fourier(robot, duration, seed=options.seed + 1 + k) for k in range(TYPICAL)]
    spreads = np.array([_errors(regressor, wanted, m, options) for m in (*others, planned.trajectory)])
    ratio = np.median(np.log(spreads[:-1]), axis=0) - np.log(spreads[-1])
    kinds = _kinds(regressor)
    narrower = {k: float(np.exp(ratio[[x == k for x in kinds]].mean())) for k in dict.fromkeys(kinds)}
    return DrivePlan(planned, narrower)


def _kinds(regressor: Regressor) -> list[str]:
    """Kind of every parameter of the drives, in order."""
    of = ["armature" if c.effect == RotorInertia.id else "friction" for c in regressor.columns if c.effect != "rigid"]
    return [*of, "delay", *["gains"] * len(regressor.robot.joints)]


def _information(regressor: Regressor, options: PlanOptions, limits: MotionLimits) -> DriveInformation:
    """The criterion for a robot with its effects."""
    robot, columns = regressor.robot, regressor.columns
    rng, J = np.random.default_rng(0), len(robot.joints)
    shares = rng.uniform(-1.0, 1.0, (3, TORQUE_STATES, J))
    states = shares * np.stack([limits.half, limits.velocity, limits.acceleration])[:, None]
    states[0] += limits.middle
    level = np.sqrt((nominal_torque(robot, *states) ** 2).mean(axis=0))
    drives = np.array([c.effect != "rigid" for c in columns])
    links = link_spread(regressor, PriorCriteria())
    Y = regressor(np.arange(TORQUE_STATES, dtype=float), *states)  # (N, C, J)
    size = np.sqrt((Y**2).mean(axis=0))
    with np.errstate(divide="ignore"):
        alone = (level / size).min(axis=1)  # the value at which a column alone would be the torque
    spread = np.where(drives, np.where(np.isfinite(alone), alone, 1.0), links)
    t = options.instants()
    return DriveInformation(
        mapping=structure(regressor, robot.joints).mapping,
        theta=np.array(nominal_parameters(robot, regressor.effects), dtype=float),
        spread=np.concatenate([spread, [DELAY_SPREAD], np.ones(J)]),
        drives=drives,
        noise=NOISE_SHARE * level,
        rows=ROWS_PER_SECOND * options.duration,
        step=float(t[1] - t[0]),
    )


def _errors(regressor: Regressor, wanted: DriveInformation, motion: Trajectory, options: PlanOptions) -> Array:
    """Standard errors of the drives' parameters after a motion."""
    t = options.instants()
    base = np.array(structure(regressor, regressor.robot.joints).base)
    W = regressor(t, *motion(t))[:, base]
    return np.asarray(np.sqrt(np.diag(wanted.covariance(W))[wanted.wanted]))
