"""Search for the coefficients of a motion that make a criterion small within limits, in two phases.

All families are linear in their coefficients X, (P, J): ``q(t) = β(t) X``, and q̇ and q̈ follow with the derivatives of
the row β. The method rests on three consequences:

- The limits of position, velocity and acceleration are linear in X, and scaling X shrinks a motion about a pose. So any
  motion can be made to keep these limits exactly, joint by joint.
- βᵀ maps the gradient of a cost at N samples (`frischid.motions.motion_cost`) to the gradient with respect to X.
- A nonlinear limit (torque, distance) needs a gradient only at the samples where it is exceeded.

First, SciPy's differential evolution (Storn and Price 1997) searches a good start among Fourier motions that keep the
limits by construction. Then L-BFGS-B (Byrd et al. 1995) minimises

    log f_k(X) + w Σ max(0, excess)²

with the criterion f_k in soft extremes of exponent k (`frischid.motions.optimality`) and a weight w; k and w rise from
step to step. In the end the motion is scaled down until no excess remains.

References: R. Storn and K. Price, J. Global Optimization 11, 1997; R. Byrd et al., SIAM J. Scientific Computing 16(5),
1995.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from itertools import count
from typing import Literal

import numpy as np
from scipy.optimize import Bounds as Box
from scipy.optimize import differential_evolution, minimize
from scipy.stats import qmc

from frischid.core.types import Array
from frischid.motions.families import Family
from frischid.motions.limits import CHECK_RATE, Excess, extremes
from frischid.motions.motion_cost import Cost
from frischid.motions.trajectory import Fourier

Progress = Callable[[float, float], None]
"""Called with the share of the budget that is used, and the best cost so far."""
Bounds = Literal["everywhere", "points"]

STAGES = ((4.0, 1e1), (12.0, 1e2), (40.0, 1e3), (150.0, 1e4))
"""Sharpness k and weight w of each descent: from a smooth problem with soft limits to the true one."""
EXPLORE_SHARE = 0.05
"""Share of the budget for the first phase."""
POPULATION = 64
"""Motions that differential evolution keeps."""
WIDER_MARGIN_EXCESS = 1e-6
"""An excess over the widened margins below this value means that the true margins are kept."""
ATTEMPTS = 4
"""Starts that are tried until a motion keeps its limits."""
REPAIRS = 3
"""Most repairs of limits that are exceeded between the times of the grid."""
RESERVE = 0.1
"""Share of the budget for these repairs."""
GRID_PER_PERIOD = 24.0
"""Times of the grid per period of the family's highest frequency."""
WATCH = 4
"""Iterations of a descent between two evaluations of the true cost."""


class _SpentError(Exception):
    """The share of the budget is used up."""


@dataclass(eq=False)
class Search:
    """Search for the coefficients that lower the cost within the limits."""

    family: Family
    cost: Cost
    excess: Excess
    duration: float
    """Length of the motion, s."""
    bounds: Bounds
    """Whether the limits hold at all times or only at the via points."""
    budget: int
    """Evaluations of the cost."""
    box: tuple[Array, Array] | None = None
    """Lower and upper bounds of the coefficients, where `bounds` is ``"points"``."""
    progress: Progress | None = None
    best: float = np.inf
    found: Array | None = None
    """`best`, `found`: Least cost of a motion that keeps its limits, and its coefficients."""
    history: list[tuple[int, float]] = field(default_factory=list)
    """Number of evaluations, and the best cost so far."""

    def __post_init__(self) -> None:
        # Between the times of the grid, bodies come a little closer.
        self.wary = self.excess.wider(1.5)
        e = self.excess.limits
        coefficients = len(self.family.constant)
        wanted = max(8 * coefficients, round(GRID_PER_PERIOD * self.family.fastest * self.duration))
        self.grid = np.linspace(0.0, self.duration, int(np.clip(wanted, 200, 2000)))
        self.at_samples, self.at_grid = self.family.basis(self.cost.t), self.family.basis(self.grid)
        coarse = max(2, round(len(self.grid) / (8 * coefficients)))
        self.at_watch = self.at_grid[:, ::coarse]  # a coarser grid: torques and distances are expensive
        self.size = np.stack([e.half, e.velocity, e.acceleration])
        # One unit of a coefficient reaches the first limit.
        reach = np.abs(self.at_grid).max(axis=1)[:, :, None] / self.size[:, None]
        self.unit = 1.0 / reach.max(axis=0)

    def run(self, seed: int) -> Array:
        """Do both phases and return the coefficients of the best motion, scaled to keep its limits exactly."""
        X = self._attempt(seed)
        for again in range(1, ATTEMPTS):
            # A search that is stuck between two bodies stops early and leaves budget for another start.
            if self.found is not None or self.cost.evaluations > self.budget / 2:
                break
            X = self._attempt(seed + again)
        best = X if self.found is None else self.found
        if self.bounds == "points":
            return best
        fine = np.linspace(0.0, self.duration, int(np.ceil(CHECK_RATE * self.duration)) + 1)
        at_fine = self.family.basis(fine)
        for left in range(REPAIRS, 0, -1):
            X = self.exactly_within(best)
            broken = self.excess.broken(at_fine @ X)
            if self.found is None or len(broken) == 0:
                break
            # From now on the grid contains these times; the best motion so far no longer counts.
            self.at_watch = np.concatenate([self.at_watch, at_fine[:, broken]], axis=1)
            self.best, self.found = np.inf, None
            last = self.descend(X, STAGES[-1], (self.budget - self.cost.evaluations) / left)
            best = last if self.found is None else self.found
        return self.lighter(self.exactly_within(best), at_fine)

    def _attempt(self, seed: int) -> Array:
        """Do both phases once, with the rest of the budget."""
        X = self.explore(seed)
        share = (1.0 - RESERVE) * (self.budget - self.cost.evaluations) / len(STAGES)
        for stage in STAGES:
            X = self.descend(X, stage, share)
        return X

    def within(self, X: Array, grow: bool = False) -> Array:
        """Scale each joint about its middle pose until its limits hold on the grid; `grow`: up to the limits."""
        states = self.at_grid @ X
        return self._scaled(X, states.min(axis=1), states.max(axis=1), grow)

    def exactly_within(self, X: Array) -> Array:
        """Like `within`, but for the exact extremes, also between the grid's times."""
        _, values = extremes(self.family.build(X), X.shape[1])
        return self._scaled(X, values[:, 0], values[:, 1], False)

    def _scaled(self, X: Array, low: Array, high: Array, grow: bool) -> Array:
        e = self.excess.limits
        middle, half = (high[0] + low[0]) / 2, (high[0] - low[0]) / 2
        sizes = np.stack([half, *np.maximum(np.abs(low[1:]), np.abs(high[1:]))])
        factor = (self.size / np.maximum(sizes, 1e-12)).min(axis=0)
        factor = factor if grow else np.minimum(factor, 1.0)
        room = np.maximum(e.half - factor * half, 0.0)
        pose = np.clip(middle, e.middle - room, e.middle + room)
        return self._about(X, middle, factor, pose)

    def _about(self, X: Array, middle: Array, factor: Array | float, pose: Array) -> Array:
        """Scale a motion about the pose `middle`, and shift this pose to `pose`."""
        constant = self.family.constant[:, None]
        return np.asarray((X - constant * middle) * factor + constant * pose)

    def lighter(self, X: Array, basis: Array) -> Array:
        """Shrink all joints together until torques and distances keep their limits at the basis' times.

        The motion shrinks about the joints' middle poses. If even standing there is impossible, it also shifts towards
        the middle of the joints' ranges.
        """
        if self.excess.fits(basis @ X):
            return X
        q = basis[0] @ X
        middle = (q.max(axis=0) + q.min(axis=0)) / 2
        for pose in (middle, self.excess.limits.middle):
            shrunk = [
                self._about(X, middle, f, middle + (1 - f) * (pose - middle)) for f in np.linspace(0.95, 0.05, 19)
            ]
            fitting = next((each for each in shrunk if self.excess.fits(basis @ each)), None)
            if fitting is not None:
                return fitting
        # A motion with named violations is better than none.
        return X

    def explore(self, seed: int) -> Array:
        """Coefficients of the best Fourier motion that differential evolution finds, all scaled to the limits."""
        J, H = len(self.excess.robot.joints), self.waves
        rows = len(self.family.constant) if self.family.fastest else 2 * H + 1
        sobol = qmc.Sobol(rows * J, seed=seed).random(POPULATION)
        generations = max(0, int(EXPLORE_SHARE * self.budget / (POPULATION * len(self.cost.shifts))) - 1)

        def level(y: Array) -> float:
            X = self.random(y.reshape(-1, J))
            cost = self.cost(self.at_samples @ X)
            excess, _ = self.wary.loads(self.at_watch @ X, slope=False)
            self._record(X, cost, excess <= WIDER_MARGIN_EXCESS)
            return self._level(cost) + STAGES[1][1] * excess

        result = differential_evolution(
            level,
            [(-1.0, 1.0)] * sobol.shape[1],
            init=2.0 * sobol - 1.0,
            maxiter=generations,
            polish=False,
            tol=0.0,
            seed=seed,
        )
        return self.random(result.x.reshape(-1, J))

    @property
    def waves(self) -> int:
        """Harmonics of the motions of `explore`: up to 0.5 Hz, at least a few."""
        return max(5, round(0.5 * self.duration))

    def random(self, y: Array) -> Array:
        """Coefficients of the Fourier motion with the shape of y, (2H + 1, J), enlarged until it reaches a limit."""
        if self.family.fastest:
            return self.within(y * self.unit, grow=True)
        return self.within(self._projection @ np.concatenate(self._fourier(y)(self.grid)), grow=True)

    def _fourier(self, y: Array) -> Fourier:
        """Motion with the shape of y, (2H + 1, J), as large as the limits allow; the first row chooses its pose."""
        e, H = self.excess.limits, len(y) // 2
        shape = Fourier.rested(np.zeros(y.shape[1]), y[1 : H + 1], y[H + 1 :], self.duration)
        states = np.stack(shape(self.grid))
        low, high = states.min(axis=1), states.max(axis=1)
        sizes = np.stack([(high - low)[0] / 2, *np.maximum(np.abs(low[1:]), np.abs(high[1:]))])
        factor = (self.size / np.maximum(sizes, 1e-12)).min(axis=0)
        room = np.maximum(e.half - factor * sizes[0], 0.0)
        pose = e.middle + y[0] * room - factor * (low + high)[0] / 2
        return Fourier(pose, shape.A * factor, shape.B * factor, self.duration)

    @cached_property
    def _projection(self) -> Array:
        """Matrix (P, 3M) that fits coefficients to states on the grid; q, q̇ and q̈ are each scaled to unit size."""
        weight = 1.0 / np.sqrt((self.at_grid**2).mean(axis=(1, 2)))
        scaled = self.at_grid * weight[:, None, None]
        inverse = np.linalg.pinv(np.concatenate(scaled))
        return np.asarray(inverse * np.repeat(weight, len(self.grid)))

    def descend(self, X: Array, stage: tuple[float, float], share: float) -> Array:
        """L-BFGS-B on the soft cost plus the weighted excess, for `share` evaluations."""
        stop = self.cost.evaluations + share
        each = (3 * X.shape[1] + 3) * len(self.cost.shifts)  # a gradient, a true cost, and one for the end
        rounds, last = count(1), X

        def level(z: Array) -> tuple[float, Array]:
            if self.cost.evaluations + each > stop:
                raise _SpentError
            return self.objective(z.reshape(X.shape), *stage)

        def watch(z: Array) -> None:
            nonlocal last
            last = z.reshape(X.shape) * self.unit
            if next(rounds) % WATCH == 0:
                self._look(last)

        # The line search of one iteration may take twenty gradients, so `maxfun` would exceed the budget.
        options = {"maxfun": self.budget, "maxiter": self.budget, "maxcor": 30, "ftol": 1e-10, "gtol": 1e-9}
        before = np.inf
        with suppress(_SpentError):
            while True:
                z = (last / self.unit).ravel()
                result = minimize(
                    level, z, jac=True, method="L-BFGS-B", bounds=self._box(), callback=watch, options=options
                )
                # At a kink of a distance the search may stop early; restarted without memory, it often goes on.
                if not result.fun < before - 1e-3:
                    break
                before = result.fun
        self._look(last)
        return last

    def objective(self, Z: Array, exponent: float, weight: float) -> tuple[float, Array]:
        """Soft cost plus weighted excess of the coefficients ``Z · unit``, and its derivative by Z as a vector."""
        X = Z * self.unit
        cost, slope = self.cost.gradient(self.at_samples @ X, exponent)
        value = self._level(cost)
        if self.cost.criterion.positive:
            slope = slope / cost
        gradient = np.einsum("onp,onj->pj", self.at_samples, slope)
        if self.bounds == "everywhere":
            for excess_of, basis in ((self.excess.kinematic, self.at_grid), (self.wary.loads, self.at_watch)):
                excess, slope = excess_of(basis @ X)
                value += weight * excess
                gradient += weight * np.einsum("onp,onj->pj", basis, slope)
        return value, (gradient * self.unit).ravel()

    def _look(self, X: Array) -> None:
        """Scale coefficients into the limits, evaluate the true cost, and keep them if they are the best."""
        fits = True
        if self.bounds == "everywhere":
            X = self.within(X)
            fits = self.wary.fits(self.at_watch @ X, WIDER_MARGIN_EXCESS)
        self._record(X, self.cost(self.at_samples @ X), fits)

    def _box(self) -> Box | None:
        """Limits at the via points, where the coefficients are positions, velocities and accelerations."""
        if self.box is None:
            return None
        low, high = self.box
        return Box((low / self.unit).ravel(), (high / self.unit).ravel())

    def _level(self, cost: float) -> float:
        return float(np.log(cost)) if self.cost.criterion.positive else cost

    def _record(self, X: Array, cost: float, fits: bool) -> None:
        """Keep the best motion that fits, and report the progress of the search."""
        if fits and cost < self.best:
            self.best, self.found = cost, X
            self.history.append((self.cost.evaluations, cost))
        if self.progress is not None:
            self.progress(min(1.0, self.cost.evaluations / self.budget), self.best)
