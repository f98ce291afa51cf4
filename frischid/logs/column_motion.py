"""Columns that follow from each other: velocities are slopes of positions, torques follow the URDF's.

    v ≈ dq/dt        τ_j ≈ s τ_nominal,j(q, q̇, q̈) + friction_j(q̇) + Ia_j q̈_j + offset_j

Columns are averaged over short stretches, so that noise of the positions does not drown their slopes. The share of a
torque column's variance that the second line leaves is small only if the positions and the torque are those of joint j
of this robot. So it tells torque columns from others, and the right order of joints from a wrong one. The factor s is
free: neither the unit nor the sign of the torque matters here.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from frischid.core.types import Array
from frischid.robot.robot import Robot

GRID_STEP = 0.04
"""s. Columns are averaged over so long: robots move slower, and noise of positions is averaged out."""
MOST_SAMPLES = 400
"""Samples on which a hypothesis about columns is tried."""
INDEPENDENT_TIME = 0.5
"""s. Residuals of robots' torques are correlated over about so long: one independent sample."""
CLEAR_ODDS = 100.0
"""Odds from which one order of the joints counts as confirmed against another."""
UNEXPLAINED = 0.5
"""Share of a torque's variance. Where the URDF and friction leave more, they do not explain the column."""
SLOPE_CORRELATION = 0.9
"""Correlation from which a column is the slope of another one."""
STRIDES = (1, 2, 3, 4, 5, 6)
"""Distance of the columns of neighbouring joints: 1 in blocks, else the number of channels."""


@dataclass(frozen=True, eq=False)
class Grid:
    """Columns averaged over short stretches of equal length; y (M, K), step in seconds."""

    y: Array
    step: float

    @classmethod
    def of(cls, columns: Array, t: Array) -> Grid:
        """Average columns (N, K) with stamps (N,)."""
        dt = float(np.median(np.diff(t)))
        every = max(1, min(int(np.ceil(GRID_STEP / dt)), len(t) // 20))
        rows = len(t) // every * every
        y = columns[:rows].reshape(-1, every, columns.shape[1]).mean(axis=1)
        return cls(y, every * (float(t[-1]) - float(t[0])) / max(1, len(t) - 1))

    @property
    def seconds(self) -> float:
        """Length of the log."""
        return len(self.y) * self.step

    def slope(self) -> Array:
        """Slopes of all columns, (M, K)."""
        return np.asarray(np.gradient(self.y, self.step, axis=0))


def slope_correlation(grid: Grid) -> Array:
    """Correlation of the slope of column i with column j, (K, K); zero for a column that does not change."""

    def normed(x: Array) -> Array:
        x = x - x.mean(axis=0)
        return np.asarray(x / np.maximum(np.linalg.norm(x, axis=0), 1e-12 * (1 + np.abs(x).max(initial=0.0))))

    return np.asarray(normed(grid.slope()).T @ normed(grid.y))


def unexplained(robot: Robot, grid: Grid, q: Sequence[int], tau: Sequence[int]) -> Array:
    """Share of each torque column's variance that the URDF's torque and friction leave, (J,).

    Parameters
    ----------
    robot : Robot
        With J joints.
    q, tau : sequence of int
        Columns of the positions and torques, in the order of the robot's joints.
    """
    position = grid.y[:, list(q)]
    v = np.gradient(position, grid.step, axis=0)
    a = np.gradient(v, grid.step, axis=0)
    some = slice(2, -2, max(1, len(position) // MOST_SAMPLES))
    position, v, a, effort = position[some], v[some], a[some], grid.y[some][:, list(tau)]
    nominal = robot.inverse_dynamics(position, v, a)
    left = np.ones(len(tau))
    for j in range(len(tau)):
        y = effort[:, j] - effort[:, j].mean()
        if not np.ptp(y) > 0:
            continue
        X = np.column_stack([nominal[:, j], v[:, j], np.tanh(v[:, j] / 1e-2), a[:, j], np.ones(len(v))])
        X = X / np.maximum(np.linalg.norm(X, axis=0), 1e-300)
        solution = np.linalg.lstsq(X, y, rcond=1e-9)[0]
        left[j] = np.clip(np.mean((y - X @ solution) ** 2) / np.mean(y**2), 1e-6, 1.0)
    return left


def order_is_confirmed(robot: Robot, grid: Grid, q: Sequence[int], tau: Sequence[int]) -> bool:
    """Whether the torques confirm this order of the joints against its reversal and against shifted numbers."""
    robot_order = unexplained(robot, grid, q, tau)
    samples = max(1.0, grid.seconds / INDEPENDENT_TIME)
    others = [np.arange(len(q))[::-1], *(np.roll(np.arange(len(q)), k) for k in range(1, len(q)))]
    for order in others:
        other = unexplained(robot, grid, [q[k] for k in order], [tau[k] for k in order])
        if 0.5 * samples * float(np.sum(np.log(other / robot_order))) < np.log(CLEAR_ODDS):
            return False
    return bool(np.median(robot_order) < UNEXPLAINED)


@dataclass(frozen=True)
class Layout:
    """Columns of each channel in the order of the joints."""

    q: tuple[int, ...]
    v: tuple[int, ...] = ()
    tau: tuple[int, ...] = ()


def columns_by_motion(robot: Robot, grid: Grid) -> Layout | None:
    """Positions, velocities and torques of a file whose names say nothing; None if the motion does not tell either.

    Columns of neighbouring joints have the same distance (blocks of positions, velocities, torques; or all channels of
    one joint side by side).
    """
    K, J = grid.y.shape[1], len(robot.joints)
    likeness = np.abs(slope_correlation(grid))
    moving = np.ptp(grid.y, axis=0) > 1e-3
    best: tuple[float, tuple[int, ...], tuple[int, ...]] | None = None
    for q in _runs(K, J):
        use = moving[list(q)]
        if use.sum() * 2 <= J:
            continue
        for v in _runs(K, J, q):
            score = float(np.median(likeness[list(q), list(v)][use]))
            if score > SLOPE_CORRELATION and (best is None or score > best[0] + 0.05):
                best = (score, q, v)
    if best is not None:
        _, q, v = best
        torques = [(float(np.sum(np.log(unexplained(robot, grid, q, tau)))), tau) for tau in _runs(K, J, q, v)]
        least = min(torques, default=None)
        good = least is not None and least[0] < J * np.log(UNEXPLAINED)
        return Layout(q, v, least[1] if good and least is not None else ())
    pairs = [
        (float(np.sum(np.log(unexplained(robot, grid, q, tau)))), q, tau)
        for q in _runs(K, J)
        if moving[list(q)].sum() * 2 > J and np.abs(grid.y[:, list(q)]).max() < 1e4
        for tau in _runs(K, J, q)
        if tau[1:2] and tau[-1] - tau[0] == q[-1] - q[0]
    ]
    if not pairs or min(pairs)[0] > J * np.log(0.3):
        return None
    _, q, tau = min(pairs)
    return Layout(q, (), tau)


def _runs(count: int, joints: int, *taken: tuple[int, ...]) -> Iterator[tuple[int, ...]]:
    """Columns with equal distances, none of them taken; beside others with the distance of these."""
    used = {k for run in taken for k in run}
    strides = {run[1] - run[0] for run in taken if len(run) > 1} or (STRIDES if joints > 1 else (1,))
    for stride in strides:
        for start in range(count - stride * (joints - 1)):
            run = tuple(range(start, start + stride * joints, stride))
            if not used.intersection(run):
                yield run
