"""The motion that tells two effects apart.

Two effects A and B whose columns, beside all other parameters, span nearly the same space on a log explain it equally
well. Their largest canonical correlation given everything else,

    ρ = σ_max(S_AA^(−1/2) S_AB S_BB^(−1/2)),   S = M_ee − M_er M_rr⁻¹ M_re   (e: columns of A and B, r: all others),

is 1 where nothing can tell them apart and 0 where each is judged as if the other did not exist. A motion that makes
what is left of all their columns as large as possible (`criteria.Separation`) is searched for as any exciting motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import linalg

from frischid.criteria import Separation
from frischid.effects import BASELINE, Effect
from frischid.errors import IdentifiabilityError, InputError
from frischid.excitation import Plan, plan
from frischid.gram import Array
from frischid.identification import structure
from frischid.regressor import Regressor
from frischid.robot import Robot
from frischid.trajectory import Trajectory, random_fourier

TYPICAL = 10  # random motions the planned one is compared with
RATE = 50.0  # Hz, at which the correlation is computed


@dataclass(frozen=True, eq=False)
class Apart:
    """A motion that tells two effects apart.

    Attributes
    ----------
    plan : Plan
    first, second : str
        The effects.
    typical, correlation : float
        Their largest canonical correlation given all other parameters: median of random motions, and on this one.
    sharper : float
        How many times smaller the standard errors of both effects' parameters are (geometric mean) than in the median
        of random motions.
    """

    plan: Plan
    first: str
    second: str
    typical: float
    correlation: float
    sharper: float


def separate(
    robot: Robot, first: Effect, second: Effect, effects: Sequence[Effect] = BASELINE, *, seed: int = 0, **search: Any
) -> Apart:
    """Plan a motion on which two effects differ.

    Parameters
    ----------
    robot : Robot
    first, second : Effect
    effects : sequence of Effect
        What else is identified.
    seed : int
    **search
        Passed on to `plan`: duration, family, budget, ...

    Returns
    -------
    Apart

    Raises
    ------
    InputError
        The two are the same, or one of them is among the other effects.
    IdentifiabilityError
        No motion can tell one of them from the model's own parameters.
    """
    if str(first) == str(second):
        raise InputError(f"{first} and {second} are the same effect: there is nothing to tell apart")
    known = {(e.id, e.joints or robot.joints) for e in effects}
    for effect in (first, second):
        if any(effect.id == name and set(effect.joints or robot.joints) <= set(joints) for name, joints in known):
            raise InputError(f"{effect} is in the model already; name two effects that are not")
    together = (*effects, first, second)
    counts = [len(effect.columns(robot)) for effect in (first, second)]
    regressor = Regressor(robot, together)
    base = structure(regressor, robot.joints).base
    own = range(len(regressor.columns) - sum(counts), len(regressor.columns))
    missing = [regressor.columns[i].name for i in own if i not in base]
    if missing:
        raise IdentifiabilityError(
            f"no motion tells {first} and {second} apart: {', '.join(missing)} acts just as other parameters do; "
            "compare two logs, from before and after the change, with `diagnose --situation changed`"
        )
    planned = plan(robot, together, criterion=Separation(sum(counts)), seed=seed, **search)
    duration = planned.trajectory.duration
    others = [random_fourier(robot, duration, seed=seed + 1 + k) for k in range(TYPICAL)]
    told = [_told_apart(regressor, np.array(base), counts, m) for m in (*others, planned.trajectory)]
    correlations, volumes = zip(*told, strict=True)
    sharper = float(np.exp(volumes[-1] - np.median(volumes[:-1])))
    return Apart(planned, str(first), str(second), float(np.median(correlations[:-1])), correlations[-1], sharper)


def _told_apart(regressor: Regressor, base: Array, counts: Sequence[int], motion: Trajectory) -> tuple[float, float]:
    """Largest canonical correlation of the last columns, in two groups, given all others; mean log of their size."""
    t = np.arange(0.0, motion.duration, 1 / RATE)
    Y = regressor(t, *motion(t))[:, base].transpose(0, 2, 1).reshape(-1, len(base))
    norms = np.maximum(np.linalg.norm(Y, axis=0), 1e-300)
    rest, own = (Y / norms)[:, : -sum(counts)], (Y / norms)[:, -sum(counts) :]
    left = own - rest @ np.linalg.lstsq(rest, own, rcond=1e-10)[0]
    a, b = (linalg.orth(part, rcond=1e-8) for part in np.split(left, [counts[0]], axis=1))
    size = np.log(np.maximum(linalg.svdvals(left), 1e-300)).mean() + np.log(norms[-sum(counts) :]).mean()
    return float(linalg.svdvals(a.T @ b).max(initial=0.0)), float(size - 0.5 * np.log(len(t)))
