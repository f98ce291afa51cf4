"""The motion that distinguishes two effects.

If the columns of two effects A and B span nearly the same space on a log, beside all other parameters, both effects
explain the log equally well. Their largest canonical correlation given all other columns,

    ρ = σ_max(S_AA^(−1/2) S_AB S_BB^(−1/2)),   S = M_ee − M_er M_rr⁻¹ M_re   (e: columns of A and B, r: all others),

is 1 where no data can distinguish the two, and 0 where the estimate of each does not depend on the other. The planned
motion maximises the part of both effects' columns that no other column explains
(`frischid.motions.optimality.Separation`). The search is that of any exciting motion.

If one effect has the other's columns and more (a hose is a spring with friction), the two differ only by the further
columns. The correlation is then that of the further columns with all others. Columns that act just as other parameters
do say nothing: the rotor's share of a coupled motor is an inertia of the links. The other columns tell the effect.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import linalg

from frischid.core.parallel import Workers
from frischid.core.types import Array
from frischid.effects import BASELINE, Effect
from frischid.errors import IdentifiabilityError, InputError
from frischid.motions.optimality import Separation
from frischid.motions.optimize import Progress
from frischid.motions.plan import Plan, plan
from frischid.motions.plan_options import PlanOptions
from frischid.motions.trajectory import Trajectory, random_fourier
from frischid.regression.regressor import Regressor
from frischid.regression.structure import structure
from frischid.robot.robot import Robot

TYPICAL = 10
"""Number of random motions that the planned one is compared with."""
CORRELATION_RATE = 50.0
"""Samples per second at which the correlation is computed, Hz."""


@dataclass(frozen=True, eq=False)
class Apart:
    """A motion that distinguishes two effects."""

    plan: Plan
    first: str
    second: str
    """`first`, `second`: The effects."""
    typical: float
    correlation: float
    """`typical`, `correlation`: Largest canonical correlation of the two given all other parameters: median over random
    motions, and on this motion. If the second effect contains the first: correlation of its further columns with all
    others."""
    sharper: float
    """Standard errors of both effects' parameters (geometric mean) in the median of random motions, over those on this
    motion."""
    shared: tuple[str, ...] = ()
    """Columns of the second effect that the first has as well."""


def separate(
    robot: Robot,
    first: Effect,
    second: Effect,
    effects: Sequence[Effect] = BASELINE,
    options: PlanOptions | None = None,
    *,
    workers: Workers | None = None,
    progress: Progress | None = None,
) -> Apart:
    """Plan a motion that distinguishes two effects.

    Parameters
    ----------
    effects : sequence of Effect
        Effects that are identified beside the two.
    options : PlanOptions, optional
        As for `plan`, except that the criterion is always `Separation`.
    workers, progress
        As for `plan`.

    Raises
    ------
    InputError
        The two are the same, or one of them is among the other effects.
    IdentifiabilityError
        On every motion, one of the two acts just as other parameters of the model do, in all of its columns.
    """
    if str(first) == str(second):
        raise InputError(f"{first} and {second} are the same effect; name two different ones")
    known = {(e.id, e.joints or robot.joints) for e in effects}
    for effect in (first, second):
        if any(effect.id == name and set(effect.joints or robot.joints) <= set(joints) for name, joints in known):
            raise InputError(f"{effect} is in the model already; name two effects that are not")
    pair = f"{first} and {second}"
    lost = [name for e in (first, second) if not _further(robot, effects, e) for name in _lost(robot, effects, e)]
    if not lost and not _further(robot, (*effects, first), second):
        first, second = second, first  # the effect with more columns comes last
    inside = set(_lost(robot, effects, second))
    shared = [] if lost else [name for name in _lost(robot, (*effects, first), second) if name not in inside]
    further = _further(robot, (*effects, first), second)
    if lost or not further:
        raise IdentifiabilityError(
            f"no motion can distinguish {pair}: {', '.join(lost or shared)} acts just as other parameters do; "
            "compare two logs, from before and after the change, with `diagnose --situation changed`"
        )
    together = (*effects, first, second)
    regressor = Regressor(robot, together)
    base = np.array(structure(regressor, robot.joints).base)
    own = (0 if shared else _further(robot, effects, first), further)
    options = replace(options or PlanOptions(), criterion=Separation(sum(own)))
    planned = plan(robot, together, options, workers=workers, progress=progress)
    duration = planned.trajectory.duration
    others = [random_fourier(robot, duration, seed=options.seed + 1 + k) for k in range(TYPICAL)]
    told = [_told_apart(regressor, base, own, m) for m in (*others, planned.trajectory)]
    correlations, volumes = zip(*told, strict=True)
    sharper = float(np.exp(volumes[-1] - np.median(volumes[:-1])))
    typical = float(np.median(correlations[:-1]))
    return Apart(planned, str(first), str(second), typical, correlations[-1], sharper, tuple(shared))


def _further(robot: Robot, effects: Sequence[Effect], effect: Effect) -> int:
    """Number of an effect's columns that act unlike those of other effects."""
    return len(effect.columns(robot)) - len(_lost(robot, effects, effect))


def _lost(robot: Robot, effects: Sequence[Effect], effect: Effect) -> list[str]:
    """Columns of an effect that act just as those of other effects do."""
    regressor = Regressor(robot, (*effects, effect))
    base = structure(regressor, robot.joints).base
    own = range(len(regressor.columns) - len(effect.columns(robot)), len(regressor.columns))
    return [regressor.columns[i].name for i in own if i not in base]


def _told_apart(regressor: Regressor, base: Array, counts: tuple[int, int], motion: Trajectory) -> tuple[float, float]:
    """Largest canonical correlation of the last columns, in two groups, given all others; and mean log of their size.

    If the first group is empty: the correlation of the second group with all other columns.
    """
    t = np.arange(0.0, motion.duration, 1 / CORRELATION_RATE)
    Y = regressor(t, *motion(t))[:, base].transpose(0, 2, 1).reshape(-1, len(base))
    norms = np.maximum(np.linalg.norm(Y, axis=0), 1e-300)
    rest, own = (Y / norms)[:, : -sum(counts)], (Y / norms)[:, -sum(counts) :]
    left = own - rest @ np.linalg.lstsq(rest, own, rcond=1e-10)[0]
    size = np.log(np.maximum(linalg.svdvals(left), 1e-300)).mean() + np.log(norms[-sum(counts) :]).mean()
    groups = np.split(left, [counts[0]], axis=1) if counts[0] else (rest, own)
    a, b = (linalg.orth(part, rcond=1e-8) for part in groups)
    return float(linalg.svdvals(a.T @ b).max(initial=0.0)), float(size - 0.5 * np.log(len(t)))
