"""The paper's case study as an experiment that can be repeated: the planar arm, its motion, and one noisy run of it.

What a run does follows the authors' Monte Carlo code (github.com/massastrello/Robot-Frisch at ed664b7,
"Identification/MCID.m"): white noise σ_q on q, 2σ_q on q̇ and q̈, 1 N·m on the torque; the rows of [W τ] sample by
sample, joint 1 then joint 2; the Frisch box of the whole log; BBRF with a window of 1000 rows that slides by one, where
a step that would empty the box is undone; and the point of the last box that minimises ``‖Wθ − τ‖ + ‖θ‖``. Two things
there are not in the paper's text. The windows are counted in samples but slide over rows, so that they see the first
half of the motion only: ``PAPER`` does the same, ``PAPER_WHOLE`` slides to the end. And runs whose first box misses the
true values are replaced by others: here every run counts, and `Run.discarded` says which would have been left out.

``CALIBRATED`` widens the vertices by their sampling error and takes windows of half the log: with 1000 rows some
vertices cannot be told from infinity.

Nothing here draws or prints, and a run depends on nothing but its arguments: any process or cluster can do it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear
from threadpoolctl import threadpool_limits

import frischid as fr
from frischid.core.types import Array
from frischid.estimators.bbrf import bbrf
from frischid.estimators.bbrf_windows import sample_extents
from frischid.estimators.frisch import Box, simplex
from frischid.motions.simulation import parameters_of
from frischid.motions.trajectory import Trajectory
from frischid.regression.base_parameters import Reduction
from frischid.regression.regressor import Regressor
from frischid.regression.structure import structure

EFFECTS = "viscous, coulomb(width=1e-6), rotor_inertia(coupled=true, ratio=0.1)"
ROTORS = {"Im1": 12.10, "Im2": 21.18}
RATE, DURATION, WINDOW, TORQUE_NOISE = 50.0, 99.0, 1000, 1.0
OLS, PAPER, PAPER_WHOLE, CALIBRATED = "OLS", "paper", "paper, all", "calibrated"
ESTIMATORS = (OLS, PAPER, PAPER_WHOLE, CALIBRATED)
CLASSICAL, STRICT, CALIBRATED_SHORT = "one-shot Frisch box", "BBRF strict", f"calibrated, window {WINDOW}"
BOXES = (CLASSICAL, STRICT, PAPER, PAPER_WHOLE, CALIBRATED_SHORT, CALIBRATED)


@dataclass(frozen=True, eq=False)
class Arm:
    """The arm with the paper's frames and effects: its base parameters in the paper's order, friction first."""

    regressor: Regressor
    reduction: Reduction
    base: tuple[int, ...]
    names: tuple[str, ...]
    expressions: tuple[str, ...]
    signs: tuple[int, ...]
    theta: Array

    def rows(self, t: Array, q: Array, v: Array, a: Array) -> Array:
        """Base regressor with the joints' rows sample by sample, shape (2N, 9)."""
        Y = self.regressor(t, q, v, a)[:, list(self.base)]
        return np.ascontiguousarray(Y.transpose(0, 2, 1)).reshape(-1, len(self.base))


@cache
def arm() -> Arm:
    """Load the arm; the URDF ships with frischid."""
    robot = fr.Robot.load("planar2", frames="far_end", known={"my1": 0.0, "my2": 0.0})
    effects = fr.parse_effects(EFFECTS)
    regressor = Regressor(robot, effects)
    reduction = structure(regressor, robot.joints)
    theta = reduction.mapping @ parameters_of(robot, effects, ROTORS)
    columns, expressions = reduction.base_columns(), reduction.expressions()
    order = sorted(range(len(columns)), key=lambda i: columns[i].effect == "rigid")
    return Arm(
        regressor,
        reduction,
        tuple(reduction.base[i] for i in order),
        tuple(columns[i].name for i in order),
        tuple(expressions[i] for i in order),
        tuple(columns[i].sign for i in order),
        theta[order],
    )


@dataclass(frozen=True, eq=False)
class Case:
    """The noise-free motion and its torque.

    Attributes
    ----------
    source : str
        Where the motion comes from.
    t : ndarray, shape (N,)
    q, v, a : ndarray, shape (N, 2)
    tau : ndarray, shape (2N,)
    points : tuple of ndarray
        t, q, v, a at the points that were joined, one a second.
    """

    source: str
    t: Array
    q: Array
    v: Array
    a: Array
    tau: Array
    points: tuple[Array, Array, Array, Array]


def case_study(folder: Path | None, seed: int) -> Case:
    """Join the authors' points by quintics, or without them take a random Fourier motion of the same length."""
    motion: Trajectory
    if folder is not None:
        file = folder / "frisch_planar" / "exciting_points.csv"
        table = np.loadtxt(file, delimiter=",", skiprows=1)
        points = (table[:, 0], table[:, 1:3], table[:, 3:5], table[:, 5:7])
        motion, source = fr.Quintic(*points), "the authors' 100 points, joined by quintics"
    else:
        motion = fr.random_fourier(arm().regressor.robot, DURATION, seed=seed)
        seconds = np.arange(DURATION + 1)
        points = (seconds, *motion(seconds))
        source = "a random Fourier motion (set FRISCHID_DATA for the authors' points)"
    t = np.arange(round(motion.duration * RATE) + 1) / RATE
    q, v, a = motion(t)
    return Case(source, t, q, v, a, arm().rows(t, q, v, a) @ arm().theta, points)


@dataclass(frozen=True, eq=False)
class Run:
    """What one noisy log gave.

    Attributes
    ----------
    same_orthant : bool
        Whether the ten least-squares solutions share an orthant.
    emptied : str
        Parameter in which strict BBRF contradicted itself; empty when it did not.
    discarded : bool
        Whether the authors' code would have replaced this run by another one.
    estimates : dict of str to ndarray, shape (9,)
        By every name in `ESTIMATORS`.
    boxes : dict of str to Box or None
        By every name in `BOXES`; None when the box is empty.
    lower, upper : ndarray, shape (len(history_steps(N)), 9)
        The bounds as the paper's recursion goes on.
    """

    same_orthant: bool
    emptied: str
    discarded: bool
    estimates: dict[str, Array]
    boxes: dict[str, Box | None]
    lower: Array
    upper: Array


def batch(case: Case, work: tuple[float, int, Sequence[int]]) -> list[Run]:
    """Do some runs: noise level, seed, and the numbers of the runs."""
    sigma, seed, numbers = work
    with threadpool_limits(limits=1):
        return [one_run(case, sigma, np.random.default_rng([seed, round(sigma * 1e9), k])) for k in numbers]


def one_run(case: Case, sigma: float, rng: np.random.Generator) -> Run:
    """Add noise and identify, by every method."""
    model, N = arm(), len(case.t)
    q, v, a = (x + s * sigma * rng.normal(size=x.shape) for x, s in ((case.q, 1), (case.v, 2), (case.a, 2)))
    tau = case.tau + TORQUE_NOISE * rng.normal(size=case.tau.shape)
    E = np.column_stack([model.rows(case.t, q, v, a), tau])
    moments = E.T @ E / len(E)
    vertices = simplex(moments, model.names)
    one_shot = vertices.box()
    strict, undo, short, calibrated = (
        bbrf(E, model.names, window=window, signs=model.signs, variant=variant)
        for variant, window in (("strict", WINDOW), ("undo", WINDOW), ("calibrated", WINDOW), ("calibrated", N))
    )
    half, lower, upper, crossed = as_published(E[:N], one_shot, model.signs)
    boxes = {
        CLASSICAL: one_shot,
        STRICT: strict.box,
        PAPER: half,
        PAPER_WHOLE: undo.box,
        CALIBRATED_SHORT: short.box,
        CALIBRATED: calibrated.box,
    }
    estimates = {OLS: vertices.ols}
    for name in (PAPER, PAPER_WHOLE):
        box = boxes[name]
        assert box is not None, "undone steps leave a box"
        estimates[name] = selected(moments * len(E), box)
    estimates[CALIBRATED] = least_squares(moments, calibrated.box or Box.unbounded(model.names))
    steps = history_steps(N)
    return Run(
        same_orthant=vertices.same_orthant,
        emptied="" if strict.emptied is None else strict.emptied.parameter,
        discarded=crossed or not one_shot.contains(model.theta),
        estimates=estimates,
        boxes=boxes,
        lower=lower[steps],
        upper=upper[steps],
    )


def history_steps(samples: int) -> NDArray[np.intp]:
    """Windows at which `Run` keeps the bounds, closer together at the beginning."""
    return np.unique(np.geomspace(1, samples - WINDOW + 1, 150).astype(int)) - 1


def as_published(rows: Array, one_shot: Box, signs: Sequence[int]) -> tuple[Box, Array, Array, bool]:
    """BBRF with the authors' start and their undone steps, over the windows their code looks at.

    The bounds start at the first window's vertices, but for parameters of known sign the lower one is that of the
    complete log, or zero. Where this start is empty the authors discard the run; here it starts without that window.

    Returns
    -------
    box : Box
    lower, upper : ndarray, shape (windows, 9)
        Bounds after each window.
    crossed : bool
        Whether the start was empty.
    """
    rms = np.sqrt(np.mean(rows**2, axis=0))
    unit = rms[-1] / rms[:-1]
    parts = list(sample_extents(np.ascontiguousarray(rows / rms), WINDOW, 1))
    usable = np.concatenate([part.usable for part in parts])[:, None]
    low = np.where(usable, np.concatenate([part.lower for part in parts]) * unit, -np.inf)
    high = np.where(usable, np.concatenate([part.upper for part in parts]) * unit, np.inf)
    known = np.asarray(signs) > 0
    low[0, known] = np.maximum(0.0, one_shot.lower[known])
    crossed = bool((low[0] > high[0]).any())
    if crossed:
        low[0, ~known], high[0] = -np.inf, np.inf
    for k in range(1, len(low)):
        tighter = np.maximum(low[k - 1], low[k]), np.minimum(high[k - 1], high[k])
        low[k], high[k] = (low[k - 1], high[k - 1]) if (tighter[0] > tighter[1]).any() else tighter
    return Box(one_shot.names, low[-1], high[-1]), low, high, crossed


def selected(sums: Array, box: Box) -> Array:
    """Minimise the authors' ``‖Wθ − τ‖ + ‖θ‖`` over a box.

    Square roots are concave: the tangents at the last iterate bound the objective from above by a quadratic one, whose
    minimum over the box is a descent step, ``min ‖Wθ − τ‖² + ρ‖θ‖²`` with ``ρ = ‖Wθ_k − τ‖ / ‖θ_k‖``.
    """
    theta = least_squares(sums, box)
    for _ in range(50):
        direction = np.append(theta, -1.0)
        misfit = np.sqrt(max(direction @ sums @ direction, 0.0))
        last, theta = theta, least_squares(sums, box, float(misfit / np.linalg.norm(theta)))
        if np.abs(theta - last).max() <= 1e-9 * np.abs(theta).max():
            break
    return theta


def least_squares(sums: Array, box: Box, pull: float = 0.0) -> Array:
    """Minimise ``‖Wθ − τ‖² + pull ‖θ‖²`` over a box, exactly (an active-set method), from the sums of [W τ]."""
    p = len(box.names)
    H = sums[:p, :p] + pull * np.eye(p)
    unit = 1.0 / np.sqrt(H.diagonal())
    root = np.linalg.cholesky(H * np.outer(unit, unit))
    target = np.linalg.solve(root, sums[:p, p] * unit)
    bounds = box.lower / unit, box.upper / unit
    phi = lsq_linear(root.T, target, bounds, method="bvls", tol=1e-13).x
    return np.asarray(np.clip(phi * unit, box.lower, box.upper))
