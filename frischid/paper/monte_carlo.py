"""The Monte Carlo study of Tables 3 and 4, as the authors' code does it and as it should be done.

A run adds white noise to the motion and to its torque and identifies. As published (their `MCID.m`): the Frisch box of
the log, θ_min and θ_max; BBRF over windows of 1000 rows of [W τ]; the point of its last box by eq. (24). Four rules of
the code are not in the text:

- A run whose Frisch box misses the true values is replaced by another run.
- The lower bounds of the five positive parameters start at zero or at the box of the complete log, all other bounds at
  the first window. A window that would empty the box is left out.
- Windows are counted in samples but slide over rows, two per sample. So they see the first half of the motion.
- The printed standard deviation of θ_min is that of another quantity (`deviation_as_printed`).

As corrected: every run counts; BBRF is the calibrated one over the complete log; deviations are of what they stand
beside. Both use eq. (24) for θ*, and least squares on the same rows stands beside.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from frischid.core.threads import one_thread
from frischid.core.types import Array
from frischid.estimators.bbrf import bbrf
from frischid.estimators.bbrf_windows import sample_extents
from frischid.estimators.box_qp import select
from frischid.estimators.frisch import Box, simplex
from frischid.estimators.frisch_selection import select_published
from frischid.paper.planar_arm import SIGNS, PlanarArm
from frischid.paper.printed import NOISE_AS_RUN, TORQUE_NOISE, WINDOW

SHOWN_SECONDS = 30.0
"""Seconds of torque that a run keeps for Figure 4: the length that Figure 2 shows."""
_HISTORY = 120
"""Windows at which a run keeps its bounds for Figure 3, closer together at the beginning."""
_TRIES = 4
"""Runs tried at most for each one wanted, before the study as published gives up on replacing discarded runs."""


@dataclass(frozen=True, eq=False)
class ArmMotion:
    """The noise-free motion of an arm and its torque."""

    arm: PlanarArm
    t: Array
    """Shape (N,)."""
    states: Array
    """q, q̇, q̈, (3, N, 2)."""
    torque: Array
    """Rows sample by sample, (2N,)."""

    @classmethod
    def of(cls, arm: PlanarArm, t: Array, states: Array) -> ArmMotion:
        """Move the arm, with its true values."""
        return cls(arm, t, states, arm.rows(t, *states) @ arm.theta)


@dataclass(frozen=True, eq=False)
class StudyRun:
    """Results of one noisy log; every array holds the nine parameters in the order of Table 3."""

    one_shot: Box
    """θ_min and θ_max."""
    last: Box
    """The box that the recursion ended with."""
    selected: Array
    squared: Array
    least_squares: Array
    """`selected`, `squared`, `least_squares`: By eq. (24) in the last box, by squared norms in the last box, and
    without a box, (9,)."""
    same_orthant: bool
    """Whether Theorem 1 backs the one-shot box."""
    contradicted: bool
    """Whether Algorithm 1 as printed contradicts itself, over the windows that were looked at."""
    discarded: bool
    """Whether the authors' code replaces this run."""
    lower: Array
    upper: Array
    """`lower`, `upper`: Bounds after the windows `history_steps`, (H, 9); as published only."""
    measured: NDArray[np.float32]
    rebuilt: NDArray[np.float32]
    """`measured`, `rebuilt`: Torque of the first seconds, as measured and from θ*, (S, 2)."""


def study(
    motion: ArmMotion,
    runs: int,
    *,
    as_published: bool,
    seed: int = 0,
    progress: Callable[[int, int], None] = lambda done, of: None,
) -> list[StudyRun]:
    """Do the runs; as published, runs that the authors would discard are kept apart and replaced.

    Parameters
    ----------
    progress : callable
        Called with the runs done and the runs wanted.

    Returns
    -------
    list of StudyRun
        `runs` that are not discarded, as published followed by the discarded ones; exactly `runs` as corrected.
    """
    kept: list[StudyRun] = []
    left: list[StudyRun] = []
    with one_thread():
        for k in range(runs * _TRIES):
            run = _run(motion, np.random.default_rng([seed, k]), as_published)
            (left if as_published and run.discarded else kept).append(run)
            progress(len(kept), runs)
            if len(kept) == runs:
                break
    return kept + left


def _run(motion: ArmMotion, rng: np.random.Generator, as_published: bool) -> StudyRun:
    arm, N = motion.arm, len(motion.t)
    sigma = NOISE_AS_RUN * np.array([1.0, 2.0, 2.0])
    states = motion.states + sigma[:, None, None] * rng.normal(size=motion.states.shape)
    measured = motion.torque + TORQUE_NOISE * rng.normal(size=motion.torque.shape)
    E = np.column_stack([arm.rows(motion.t, *states), measured])
    sums = E.T @ E
    triangle = simplex(sums / len(E), arm.names)
    one_shot = triangle.box()
    if as_published:
        found = authors_recursion(E[:N], one_shot)
    else:
        last = bbrf(E, arm.names, window=N, signs=SIGNS, variant="calibrated").require_box()
        strict = bbrf(E, arm.names, window=WINDOW, signs=SIGNS, variant="strict")
        found = AuthorsRecursion(last, np.empty((0, 9)), np.empty((0, 9)), False, int(strict.box is None))
    last = found.last
    selected = select_published(sums, last).selection.theta
    shown = slice(0, 2 * int(np.searchsorted(motion.t, SHOWN_SECONDS, side="right")))
    return StudyRun(
        one_shot=one_shot,
        last=last,
        selected=selected,
        squared=select(sums, last).theta,
        least_squares=triangle.ols,
        same_orthant=triangle.same_orthant,
        contradicted=found.undone > 0,
        discarded=found.crossed or not one_shot.contains(arm.theta),
        lower=found.lower,
        upper=found.upper,
        measured=measured[shown].reshape(-1, 2).astype(np.float32),
        rebuilt=(E[shown, :-1] @ selected).reshape(-1, 2).astype(np.float32),
    )


def history_steps(samples: int) -> NDArray[np.intp]:
    """Windows at which `StudyRun` keeps the bounds, counted from zero."""
    return np.unique(np.geomspace(1, samples - WINDOW + 1, _HISTORY).astype(int)) - 1


class AuthorsRecursion(NamedTuple):
    """Result of the recursion as published."""

    last: Box
    lower: Array
    upper: Array
    """`lower`, `upper`: Bounds after the windows `history_steps`, (H, 9)."""
    crossed: bool
    """Whether the start is empty already; the box of the complete log then takes its place."""
    undone: int
    """Windows left out because they would have emptied the box."""


def authors_recursion(rows: Array, one_shot: Box) -> AuthorsRecursion:
    """BBRF with the start, the windows and the undone steps of the authors' code.

    Parameters
    ----------
    rows : ndarray, shape (N, 10)
        The first N rows of [W τ], N the number of samples.
    one_shot : Box
        Of the complete log.
    """
    first = simplex(rows[:WINDOW].T @ rows[:WINDOW], one_shot.names).box()
    known = np.asarray(SIGNS) > 0
    low, high = np.where(known, np.maximum(0.0, one_shot.lower), first.lower), first.upper
    crossed = bool((low > high).any())
    if crossed:
        low, high = one_shot.lower, one_shot.upper
    rms = np.sqrt(np.mean(rows**2, axis=0))
    unit = rms[-1] / rms[:-1]
    history, undone = [(low, high)], 0
    # From the second window on the authors' windows hold one row more than the first.
    for extents in sample_extents(np.ascontiguousarray(rows[1:] / rms), WINDOW + 1, 1):
        for a, b, usable in zip(extents.lower * unit, extents.upper * unit, extents.usable, strict=True):
            tighter = np.maximum(low, a), np.minimum(high, b)
            if usable and (tighter[0] > tighter[1]).any():
                undone += 1
            elif usable:
                low, high = tighter
            history.append((low, high))
    steps = np.minimum(history_steps(len(rows)), len(history) - 1)
    kept = [history[k] for k in steps]
    lower, upper = (np.array(bounds) for bounds in zip(*kept, strict=True))
    return AuthorsRecursion(Box(one_shot.names, low, high), lower, upper, crossed, undone)


def deviation_as_printed(lower: Array, upper: Array) -> Array:
    """The deviation that Table 3 prints beside θ_min.

    Their `MC_ANALISYS.m` appends each run's θ_min to the list of θ_max, not to its own. After the last run the list
    holds θ_max of all runs but the last one, and one θ_min: its deviation says more about the box's width.

    Parameters
    ----------
    lower, upper : ndarray, shape (runs, 9)

    Returns
    -------
    ndarray, shape (9,)
    """
    return np.asarray(np.vstack([upper[:-1], lower[-1:]]).std(axis=0, ddof=1))
