"""Speed of the bounding-box recursion compared with a direct port of the published algorithm.

Both slide a window by one row over the same rows of [Y τ] and leave out a window that would empty the box. The direct
port follows Algorithm 1 and the authors' code. For each window it computes

1. the moments of the window's rows;
2. for each of the p + 1 variables the largest variance that the variable's noise can have, a ratio of two determinants;
3. the null space of the moments less this variance, by an SVD;
4. the extent of these p + 1 vertices.

The direct port is timed over the first windows only and extrapolated, because every window costs the same. frischid
updates the moments and computes all p + 1 vertices from one inverse (`bbrf`); it is timed over all windows. Columns are
scaled to unit mean square, because the determinants would lose accuracy otherwise.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from common import data_folder, parser, publish
from planar_case import RATE, TORQUE_NOISE, WINDOW, Array, arm, case_study

import frischid as fr
from frischid.estimators.bbrf import bbrf
from frischid.regression.regressor import Regressor
from frischid.regression.structure import structure

TARGET, AGREEMENT = 30.0, 1e-6
SIGMA = 1e-2
SIX_JOINTS, SIX_EFFECTS = "ur10", "viscous, rotor_inertia"


@dataclass(frozen=True, eq=False)
class Problem:
    """Rows of [Y τ] of unit mean square, and the number of windows for the direct port."""

    name: str
    names: tuple[str, ...]
    rows: Array
    windows: int


def main() -> None:
    """Print the table."""
    arguments = parser(__doc__)
    arguments.add_argument("--samples", type=int, default=4951, help="samples of the planar arm; the UR10 gets 2/5")
    arguments.add_argument("--windows", type=int, default=400, help="windows of the direct port; a tenth on the UR10")
    arguments.add_argument("--rounds", type=int, default=5)
    options = arguments.parse_args()
    if options.windows < 10 or options.rounds < 1 or 2 * options.samples < WINDOW + options.windows:
        arguments.error(f"needs 10 windows, a round, and more samples than half of {WINDOW} rows and the windows")
    problems = [planar(options.samples, options.windows), six_joints(2 * options.samples // 5, options.windows // 10)]
    rows, notes = [], []
    for problem in problems:
        row, note = compared(problem, options.rounds)
        rows.append(row)
        notes.append(note)
    publish("bounding-box recursion, window of 1000 rows, stride 1", rows, options.json, notes)


def planar(samples: int, windows: int) -> Problem:
    """Rows of the paper's arm and motion with noise."""
    case = case_study(data_folder(), 0)
    rng = np.random.default_rng(0)
    t, q, v, a = (x[:samples] for x in (case.t, case.q, case.v, case.a))
    q, v, a = (x + s * SIGMA * rng.normal(size=x.shape) for x, s in ((q, 1), (v, 2), (a, 2)))
    tau = case.tau.reshape(len(case.t), -1)[:samples].ravel()
    E = np.column_stack([arm().rows(t, q, v, a), tau + TORQUE_NOISE * rng.normal(size=len(tau))])
    return Problem("planar arm", arm().names, _unit(E), windows)


def six_joints(samples: int, windows: int) -> Problem:
    """Rows of a UR10 in random motion with noise."""
    robot, effects = fr.Robot.load(SIX_JOINTS), fr.parse_effects(SIX_EFFECTS)
    regressor = Regressor(robot, effects)
    reduction = structure(regressor, robot.joints)
    rng, t = np.random.default_rng(0), np.arange(samples) * 2.5 / RATE
    motion = fr.random_fourier(robot, float(t[-1]), seed=0)
    base, columns = list(reduction.base), reduction.base_columns()

    def stacked(q: Array, v: Array, a: Array) -> Array:
        return regressor(t, q, v, a)[:, base].transpose(0, 2, 1).reshape(-1, len(base))

    q, v, a = motion(t)
    W = stacked(q, v, a)
    tau = W @ rng.normal(size=len(base))
    noisy = stacked(*(x + SIGMA * rng.normal(size=x.shape) for x in (q, v, a)))
    E = np.column_stack([noisy, tau + 0.05 * tau.std() * rng.normal(size=len(tau))])
    return Problem(SIX_JOINTS, tuple(c.name for c in columns), _unit(E), windows)


def _unit(E: Array) -> Array:
    return np.ascontiguousarray(E / np.sqrt(np.mean(E**2, axis=0)))


def direct(rows: Array, windows: int) -> tuple[Array, Array, int]:
    """The published algorithm, a null space for every vertex of every window.

    Returns
    -------
    lower, upper : ndarray, shape (p,)
        The last box.
    undone : int
        Windows left out.
    """
    lower, upper, undone = np.full(rows.shape[1] - 1, -np.inf), np.full(rows.shape[1] - 1, np.inf), 0
    for k in range(windows):
        X = rows[k : k + WINDOW]
        low, high = extent_of(X.T @ X / WINDOW)
        tighter = np.maximum(lower, low), np.minimum(upper, high)
        if (tighter[0] > tighter[1]).any():
            undone += 1
        else:
            lower, upper = tighter
    return lower, upper, undone


def extent_of(S: Array) -> tuple[Array, Array]:
    """Extent of all vertices: subtract the largest noise of one variable from the moments, and take the null vector."""
    n = len(S)
    vertices = np.empty((n - 1, n))
    whole = np.linalg.det(S)
    for i in range(n):
        others = np.delete(np.delete(S, i, axis=0), i, axis=1)
        reduced = S.copy()
        reduced[i, i] -= whole / np.linalg.det(others)
        null = np.linalg.svd(reduced)[2][-1]
        vertices[:, i] = -null[:-1] / null[-1]
    return vertices.min(axis=1), vertices.max(axis=1)


def compared(problem: Problem, rounds: int) -> tuple[dict[str, object], str]:
    """Time both, and compare their boxes on the windows that both were given."""
    count = len(problem.rows) - WINDOW + 1
    start = time.perf_counter()
    lower, upper, undone = direct(problem.rows, problem.windows)
    port = (time.perf_counter() - start) / problem.windows
    ours = statistics.median(_seconds(problem, problem.rows) for _ in range(rounds)) / count
    few = bbrf(problem.rows[: WINDOW + problem.windows - 1], problem.names, window=WINDOW, variant="undo")
    box = few.require_box()
    off = max(_difference(lower, box.lower), _difference(upper, box.upper))
    ratio = port / ours
    row: dict[str, object] = {
        "robot": problem.name,
        "p": len(problem.names),
        "windows": count,
        "direct port, µs per window": 1e6 * port,
        "frischid, µs per window": 1e6 * ours,
        "ratio": ratio,
        "target": TARGET,
        "reached": ratio >= TARGET,
        "largest difference": off,
        "agree": bool(off <= AGREEMENT and undone == few.undone),
    }
    note = (
        f"{problem.name}: direct port timed over {problem.windows} windows, all {count} would take "
        f"{port * count:.0f} s against {ours * count:.2f} s (median of {rounds}); on these {problem.windows} windows "
        f"the boxes differ by {off:.1e} of a bound, windows undone {undone} and {few.undone}"
    )
    return row, note


def _seconds(problem: Problem, rows: Array) -> float:
    start = time.perf_counter()
    bbrf(rows, problem.names, window=WINDOW, variant="undo")
    return time.perf_counter() - start


def _difference(a: Sequence[float] | Array, b: Array) -> float:
    return float((np.abs(a - b) / np.maximum(np.abs(b), 1e-12)).max())


if __name__ == "__main__":
    main()
