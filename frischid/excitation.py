"""The motion that tells a robot's parameters apart best, within what the robot may do.

Every family of motions is linear in its coefficients X, (P, J): ``q(t) = β(t) X``, and q̇, q̈ with the derivatives of the
row β. Three things follow, and they are the whole method.

- The limits of position, velocity and acceleration are linear in X, and shrinking a motion about a pose is scaling X: any
  motion is made feasible joint by joint, exactly.
- A cost f of the base regressor Π at N samples has a cheap gradient. A sample's rows depend on that sample's 3J numbers
  alone, so 3J displaced regressors give ``∂f/∂(q, q̇, q̈) = ⟨∂f/∂Π, ∂Π⟩`` of all N at once, and βᵀ carries it to X.
- What is not linear (torque, distances) needs a slope only at the samples where it is broken.

The search has two phases. SciPy's differential evolution looks for a basin among random Fourier motions that fit the
limits by construction. Then L-BFGS-B descends on

    log f_k(X) + w Σ max(0, |excess|)²

with soft extremes of sharpness k (`criteria`) and weight w, both rising. What is left of an excess is scaled away.

References: J. Swevers et al., IEEE Trans. Robotics and Automation 13(5), 1997 (Fourier series); M. Gautier and W. Khalil,
Int. J. Robotics Research 11(4), 1992 (condition number); S. Massaroli et al., "Frisch Scheme Identification of Robots
Dynamic Parameters", section 3.2 (points and quintics).
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import differential_evolution, minimize

from frischid.clearance import Clearance
from frischid.criteria import EXACT, Criterion, criterion_of
from frischid.effects import BASELINE, Effect
from frischid.envelope import Envelope, Motion, Violation, extremes, nominal_torque, violations
from frischid.errors import InputError, UnknownNameError
from frischid.identify import structure
from frischid.log import Log
from frischid.readers import write_log
from frischid.regressor import Regressor
from frischid.robot import Robot
from frischid.trajectory import BSpline, Fourier, Quintic

Array = NDArray[np.float64]
Progress = Callable[[float, float], None]
"""Called with the share of the budget that is used, and the best cost so far."""
Bounds = Literal["everywhere", "points"]

FAMILIES = ("fourier", "bspline", "points")
STEP = 1e-6  # displacement of a sample for the slope of its rows
STAGES = ((4.0, 1e1), (12.0, 1e2), (40.0, 1e3), (150.0, 1e4))  # sharpness and weight of each descent
SHARE = 0.25  # of the budget, for the first phase
TIGHT = 0.999  # what the descent may use of the limits, so that little is left to scale away


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
        Evaluations used, and the best feasible cost by then.
    evaluations : int
        Base regressors of all N samples that were computed; a gradient counts as the 3J and more that it takes.
    seconds : float
    violations : tuple of Violation
        Limits that could not be met, anywhere on the motion, with joint and time.
    notes : tuple of str
        What was not checked.
    """

    joints: tuple[str, ...]
    trajectory: Motion
    criterion: str
    cost: float
    history: Array
    evaluations: int
    seconds: float
    violations: tuple[Violation, ...]
    notes: tuple[str, ...]

    def to_log(self, rate: float) -> Log:
        """Sample t, q, v and a at `rate` Hz, both ends included if the duration is a whole number of steps."""
        if not (np.isfinite(rate) and rate > 0):
            raise InputError(f"the rate must be a positive number of Hz, got {rate}")
        t = np.arange(int(np.floor(rate * self.trajectory.duration * (1 + 1e-12))) + 1) / rate
        q, v, a = self.trajectory(t)
        return Log(t, self.joints, q, v, a, source=f"exciting motion ({self.criterion} {self.cost:.4g})")

    def save(self, path: str | Path, rate: float = 100.0) -> None:
        """Write columns t, q_<joint>, v_<joint>, a_<joint> as CSV, Parquet or NPZ, by the file's ending."""
        write_log(self.to_log(rate), path)


@dataclass(frozen=True, eq=False)
class Family:
    """Motions linear in their coefficients.

    Attributes
    ----------
    build : callable
        Coefficients (P, J) -> motion.
    constant : ndarray, shape (P,)
        Coefficients of the motion that stays at 1.
    """

    build: Callable[[Array], Motion]
    constant: Array

    @classmethod
    def named(cls, name: str, duration: float, size: int) -> Family:
        """Build a family by name, of `size` harmonics, control points or via points."""
        if name == "fourier":
            return cls(
                lambda X: Fourier.rested(X[0], X[1 : size + 1], X[size + 1 :], duration), np.eye(2 * size + 1)[0]
            )
        if name == "bspline":
            return cls(lambda X: BSpline.rested(X, duration), np.ones(size))
        if name != "points":
            raise UnknownNameError("family", name, FAMILIES)
        t = np.linspace(0.0, duration, size)

        def joined(X: Array) -> Quintic:
            rest = np.zeros((1, X.shape[1]))
            v, a = X[size : 2 * size - 2], X[2 * size - 2 :]
            return Quintic(t, X[:size], np.concatenate([rest, v, rest]), np.concatenate([rest, a, rest]))

        return cls(joined, np.concatenate([np.ones(size), np.zeros(2 * size - 4)]))

    def basis(self, t: Array) -> Array:
        """Rows β, β̇, β̈ at times t: the family's motion with unit coefficients, (3, N, P)."""
        return np.stack(self.build(np.eye(len(self.constant)))(t))


class Cost:
    """A criterion at the samples of a motion, with its gradient; it counts the regressors it computes."""

    def __init__(
        self, robot: Robot, effects: Sequence[Effect], t: Array, criterion: Criterion, seed: int
    ) -> None:
        self.regressor, self.criterion, self.t = Regressor(robot, effects), criterion, t
        self.base = np.array(structure(self.regressor, robot.joints).base)
        shifts = criterion.displacements(len(t), len(robot.joints), seed)
        self.shifts = np.concatenate([np.zeros((1, *shifts.shape[1:])), shifts])
        self.evaluations = 0

    def __call__(self, states: Array, sharpness: float = EXACT) -> float:
        """Cost of q, q̇, q̈ at the samples, (3, N, J)."""
        return self.criterion(self._full(states)[:, :, self.base], sharpness)[0]

    def gradient(self, states: Array, sharpness: float) -> tuple[float, Array]:
        """Cost, and its derivative by the states, (3, N, J)."""
        here = self._full(states)
        cost, slope = self.criterion(here[:, :, self.base], sharpness)
        direction = np.zeros_like(here)
        direction[:, :, self.base] = slope
        gradient = np.empty_like(states)
        for order, j in np.ndindex(3, states.shape[2]):
            moved = states.copy()
            moved[order, :, j] += STEP
            gradient[order, :, j] = np.einsum("dncj,dncj->n", self._full(moved) - here, direction) / STEP
        return cost, gradient

    def _full(self, states: Array) -> Array:
        """Regressor at the motion and at its displaced copies, (1 + D, N, C, J)."""
        self.evaluations += len(self.shifts)
        return np.stack([self.regressor(self.t, *(states + shift)) for shift in self.shifts])


@dataclass(frozen=True, eq=False)
class Excess:
    """How far a motion goes beyond its envelope on a grid of times, as one smooth number and its slope.

    Every limit contributes ``Σ max(0, |x|/limit − 1)²``, distances ``Σ max(0, (margin − d)/0.1 m)²``.
    """

    robot: Robot
    envelope: Envelope
    clearance: Clearance | None

    def __call__(self, states: Array, slope: bool = True) -> tuple[float, Array]:
        """Excess of q, q̇, q̈ on the grid, and its derivative by them, both (3, M, J)."""
        value, gradient = self._kinematic(states)
        for part in (self._torque, self._distance):
            more, rows, part_gradient = part(states, slope)
            value += more
            gradient[:, rows] += part_gradient
        return value, gradient

    def loads(self, states: Array) -> float:
        """Excess of torque and distance only."""
        return self._torque(states, False)[0] + self._distance(states, False)[0]

    def _kinematic(self, states: Array) -> tuple[float, Array]:
        e = self.envelope
        size = np.stack([e.half, e.velocity, e.acceleration])[:, None]
        relative = states / size
        relative[0] -= e.middle / e.half
        excess = np.maximum(np.abs(relative) - TIGHT, 0.0)
        return float((excess**2).sum()), 2.0 * excess * np.sign(relative) / size

    def _torque(self, states: Array, slope: bool) -> tuple[float, NDArray[np.intp], Array]:
        limit = TIGHT * self.envelope.torque
        none = np.empty(0, dtype=np.intp)
        if not np.isfinite(limit).any():
            return 0.0, none, states[:, none]
        torque = nominal_torque(self.robot, *states)
        excess = np.maximum(np.abs(torque) / limit - 1.0, 0.0)
        rows = np.flatnonzero(excess.any(axis=1))
        gradient = np.zeros((3, len(rows), states.shape[2]))
        if slope and len(rows):
            by_torque = (2.0 * excess * np.sign(torque) / limit)[rows]
            for order, j in np.ndindex(3, states.shape[2]):
                moved = states[:, rows].copy()
                moved[order, :, j] += STEP
                change = nominal_torque(self.robot, *moved) - torque[rows]
                gradient[order, :, j] = (by_torque * change).sum(axis=1) / STEP
        return float((excess**2).sum()), rows, gradient

    def _distance(self, states: Array, slope: bool) -> tuple[float, NDArray[np.intp], Array]:
        none = np.empty(0, dtype=np.intp)
        if self.clearance is None:
            return 0.0, none, states[:, none]
        q = states[0]
        distance, pair = self.clearance.nearest(q)
        excess = np.maximum(self.clearance.margin - distance, 0.0) / 0.1
        rows = np.flatnonzero(excess)
        gradient = np.zeros((3, len(rows), q.shape[1]))
        if slope and len(rows):
            for j in range(q.shape[1]):
                moved = q[rows].copy()
                moved[:, j] += STEP
                change = self.clearance.distance(moved, pair[rows]) - distance[rows]
                gradient[0, :, j] = -2.0 * excess[rows] * change / (0.1 * STEP)
        return float((excess**2).sum()), rows, gradient


@dataclass(eq=False)
class Search:
    """Coefficients that lower the cost within the envelope."""

    family: Family
    cost: Cost
    excess: Excess
    grid: Array
    duration: float
    bounds: Bounds
    budget: int
    progress: Progress | None = None
    best: float = np.inf
    found: Array | None = None
    history: list[tuple[int, float]] = field(default_factory=list)

    def __post_init__(self) -> None:
        e = self.excess.envelope
        self.at_samples, self.at_grid = self.family.basis(self.cost.t), self.family.basis(self.grid)
        self.size = np.stack([e.half, e.velocity, e.acceleration])
        # One unit of a coefficient uses up the limit that it meets first.
        reach = np.abs(self.at_grid).max(axis=1)[:, :, None] / self.size[:, None]
        self.unit = 1.0 / reach.max(axis=0)

    # ------------------------------------------------------------------ feasibility

    def within(self, X: Array, grow: bool = False) -> Array:
        """Scale each joint about its middle pose until its limits hold on the grid; `grow` up to them."""
        states = self.at_grid @ X
        return self._scaled(X, states.min(axis=1), states.max(axis=1), grow)

    def exactly_within(self, X: Array) -> Array:
        """As `within`, at the true extremes between the grid's times."""
        _, values = extremes(self.family.build(X), X.shape[1])
        return self._scaled(X, values[:, 0], values[:, 1], False)

    def _scaled(self, X: Array, low: Array, high: Array, grow: bool) -> Array:
        e = self.excess.envelope
        middle, half = (high[0] + low[0]) / 2, (high[0] - low[0]) / 2
        sizes = np.stack([half, *np.maximum(np.abs(low[1:]), np.abs(high[1:]))])
        factor = (self.size / np.maximum(sizes, 1e-12)).min(axis=0)
        factor = factor if grow else np.minimum(factor, 1.0)
        room = np.maximum(e.half - factor * half, 0.0)
        pose = np.clip(middle, e.middle - room, e.middle + room)
        return self._about(X, middle, factor, pose)

    def _about(self, X: Array, middle: Array, factor: Array | float, pose: Array) -> Array:
        """Scale a motion about `middle` and move that to `pose`."""
        constant = self.family.constant[:, None]
        return np.asarray((X - constant * middle) * factor + constant * pose)

    def lighter(self, X: Array, t: Array) -> Array:
        """Shrink all joints together about their middle poses until torques and distances hold at times t."""
        basis = self.family.basis(t)
        if self.excess.loads(basis @ X) == 0.0:
            return X
        q = basis[0] @ X
        middle = (q.max(axis=0) + q.min(axis=0)) / 2
        low, high = 0.0, 1.0
        for _ in range(10):
            factor = (low + high) / 2
            fits = self.excess.loads(basis @ self._about(X, middle, factor, middle)) == 0.0
            low, high = (factor, high) if fits else (low, factor)
        # No factor at all: better the motion with its violations named than none.
        return self._about(X, middle, low, middle) if low > 0.0 else X
