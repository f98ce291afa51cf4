"""Coefficients of a motion that make a criterion small within an envelope: cost, gradient, and the two phases.

All families are linear in their coefficients X, (P, J): ``q(t) = β(t) X``, q̇ and q̈ with the derivatives of the row β.
Three things follow, and they are the whole method.

- The limits of position, velocity and acceleration are linear in X, and shrinking a motion about a pose is scaling X:
  any motion is made feasible joint by joint, exactly.
- A cost f of the base regressor Π at N samples has a cheap gradient. A sample's rows depend on that sample's 3J numbers
  alone, so 3J displaced regressors give ``∂f/∂(q, q̇, q̈) = ⟨∂f/∂Π, ∂Π⟩`` of all N at once, and βᵀ carries it to X.
- What is not linear (torque, distances) needs a slope only at the samples where it is broken.

SciPy's differential evolution (Storn and Price 1997) first looks for a basin among Fourier motions that fit the limits
by construction. Then L-BFGS-B (Byrd et al. 1995) descends on

    log f_k(X) + w Σ max(0, excess)²

with soft extremes of sharpness k (`criteria`) and weight w, both rising. What is left of an excess is scaled away.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
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
from frischid.effects import Effect
from frischid.errors import InputError
from frischid.motions.limits import RATE, Excess, extremes
from frischid.motions.optimality import EXACT, Criterion
from frischid.motions.trajectory import Family, Fourier
from frischid.regression.regressor import Regressor
from frischid.regression.structure import structure
from frischid.robot.robot import Robot

Progress = Callable[[float, float], None]
"""Called with the share of the budget that is used, and the best cost so far."""
Bounds = Literal["everywhere", "points"]

STEP = 1e-6  # displacement of a sample for the slope of its rows
STAGES = ((4.0, 1e1), (12.0, 1e2), (40.0, 1e3), (150.0, 1e4))  # sharpness and weight of each descent
SHARE = 0.05  # of the budget, for the first phase
POPULATION = 64
NEARLY = 1e-6  # excess over the wider margins that is none over the true ones
ATTEMPTS = 4  # starts, until a motion fits
REPAIRS = 3  # most times that what is broken between the grid's times is repaired
RESERVE = 0.1  # of the budget, for that
WATCH = 4  # rounds of a descent from one look at the true cost to the next


class Cost:
    """A criterion at the samples of a motion, with its gradient; it counts the regressors it computes."""

    def __init__(self, robot: Robot, effects: Sequence[Effect], t: Array, criterion: Criterion, seed: int) -> None:
        self.regressor, self.criterion, self.t = Regressor(robot, effects), criterion, t
        self.base = np.array(structure(self.regressor, robot.joints).base)
        rows = len(t) * len(robot.joints)
        if rows <= len(self.base):
            raise InputError(
                f"{len(t)} samples of {len(robot.joints)} joints give {rows} equations for {len(self.base)} base "
                f"parameters; use {-(-3 * len(self.base) // len(robot.joints))} samples or more"
            )
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
        there = np.empty_like(here)
        for order, j in np.ndindex(3, states.shape[2]):
            moved = states.copy()
            moved[order, :, j] += STEP
            change = np.subtract(self._full(moved, there), here, out=there)
            gradient[order, :, j] = np.einsum("dncj,dncj->n", change, direction) / STEP
        return cost, gradient

    def _full(self, states: Array, out: Array | None = None) -> Array:
        """Regressor at the motion and at its displaced copies, (1 + D, N, C, J)."""
        if out is None:
            out = np.empty((len(self.shifts), len(self.t), len(self.regressor.columns), states.shape[2]))
        for Y, shift in zip(out, self.shifts, strict=True):
            q, v, a = states + shift
            self.regressor(self.t, q, v, a, out=Y)
        self.evaluations += len(self.shifts)
        return out


class _SpentError(Exception):
    """The share of the budget is used up."""


@dataclass(eq=False)
class Search:
    """Coefficients that lower the cost within the envelope."""

    family: Family
    cost: Cost
    excess: Excess
    duration: float
    bounds: Bounds
    budget: int
    box: tuple[Array, Array] | None = None
    progress: Progress | None = None
    best: float = np.inf
    found: Array | None = None
    history: list[tuple[int, float]] = field(default_factory=list)

    def __post_init__(self) -> None:
        # Bodies come a little closer between the times that are watched.
        self.wary = self.excess.wider(1.5)
        e = self.excess.envelope
        coefficients = len(self.family.constant)
        self.grid = np.linspace(0.0, self.duration, int(np.clip(8 * coefficients, 200, 2000)))
        self.at_samples, self.at_grid = self.family.basis(self.cost.t), self.family.basis(self.grid)
        self.at_watch = self.at_grid[:, ::2]  # torques and distances cost more to look at
        self.size = np.stack([e.half, e.velocity, e.acceleration])
        # One unit of a coefficient uses up the limit that it meets first.
        reach = np.abs(self.at_grid).max(axis=1)[:, :, None] / self.size[:, None]
        self.unit = 1.0 / reach.max(axis=0)

    def run(self, seed: int) -> Array:
        """Both phases; returns the coefficients of the best motion that fits, made to fit exactly."""
        X = self._attempt(seed)
        for again in range(1, ATTEMPTS):
            # A motion caught between two bodies stops early, and leaves budget for another start.
            if self.found is not None or self.cost.evaluations > self.budget / 2:
                break
            X = self._attempt(seed + again)
        best = X if self.found is None else self.found
        if self.bounds == "points":
            return best
        fine = np.linspace(0.0, self.duration, int(np.ceil(RATE * self.duration)) + 1)
        at_fine = self.family.basis(fine)
        for left in range(REPAIRS, 0, -1):
            X = self.exactly_within(best)
            broken = self.excess.broken(at_fine @ X)
            if self.found is None or len(broken) == 0:
                break
            # What happens there is watched from now on; what was best before no longer counts.
            self.at_watch = np.concatenate([self.at_watch, at_fine[:, broken]], axis=1)
            self.best, self.found = np.inf, None
            last = self.descend(X, STAGES[-1], (self.budget - self.cost.evaluations) / left)
            best = last if self.found is None else self.found
        return self.lighter(self.exactly_within(best), at_fine)

    def _attempt(self, seed: int) -> Array:
        """Both phases once, with what is left of the budget."""
        X = self.explore(seed)
        share = (1.0 - RESERVE) * (self.budget - self.cost.evaluations) / len(STAGES)
        for stage in STAGES:
            X = self.descend(X, stage, share)
        return X

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

    def lighter(self, X: Array, basis: Array) -> Array:
        """Shrink all joints together until torques and distances hold at the basis' times.

        About their middle poses, or towards the middle of their ranges if even standing there is impossible.
        """
        if self.excess.fits(basis @ X):
            return X
        q = basis[0] @ X
        middle = (q.max(axis=0) + q.min(axis=0)) / 2
        for pose in (middle, self.excess.envelope.middle):
            shrunk = [
                self._about(X, middle, f, middle + (1 - f) * (pose - middle)) for f in np.linspace(0.95, 0.05, 19)
            ]
            fitting = next((each for each in shrunk if self.excess.fits(basis @ each)), None)
            if fitting is not None:
                return fitting
        # Better the motion with its violations named than none.
        return X

    # ------------------------------------------------------------------ first phase

    def explore(self, seed: int) -> Array:
        """Differential evolution over Fourier motions grown up to the limits; returns the best one's coefficients."""
        J, H = len(self.excess.robot.joints), self.waves
        sobol = qmc.Sobol((2 * H + 1) * J, seed=seed).random(POPULATION)
        generations = max(0, int(SHARE * self.budget / (POPULATION * len(self.cost.shifts))) - 1)

        def level(y: Array) -> float:
            X = self.random(y.reshape(-1, J))
            cost = self.cost(self.at_samples @ X)
            excess, _ = self.wary.loads(self.at_watch @ X, slope=False)
            self._record(X, cost, excess <= NEARLY)
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
        """Harmonics of the motions that `explore` looks at: up to 0.5 Hz, and a few at least."""
        return max(5, round(0.5 * self.duration))

    def random(self, y: Array) -> Array:
        """Coefficients of the Fourier motion with the shape of y, (2H + 1, J), grown until a limit stops it."""
        return self.within(self._projection @ np.concatenate(self._fourier(y)(self.grid)), grow=True)

    def _fourier(self, y: Array) -> Fourier:
        """Motion with the shape of y, (2H + 1, J), as large as the limits allow; the first row chooses its pose."""
        e, H = self.excess.envelope, len(y) // 2
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
        """Least squares of states on the grid by this family, every order by its own size: (P, 3M)."""
        weight = 1.0 / np.sqrt((self.at_grid**2).mean(axis=(1, 2)))
        scaled = self.at_grid * weight[:, None, None]
        inverse = np.linalg.pinv(np.concatenate(scaled))
        return np.asarray(inverse * np.repeat(weight, len(self.grid)))

    # ------------------------------------------------------------------ second phase

    def descend(self, X: Array, stage: tuple[float, float], share: float) -> Array:
        """L-BFGS-B on the soft cost plus the weighted excess, for `share` evaluations."""
        stop = self.cost.evaluations + share
        each = (3 * X.shape[1] + 3) * len(self.cost.shifts)  # a gradient, a look, and one to spare for the end
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

        # The line search of one round may take twenty gradients, so `maxfun` would not keep to the budget.
        options = {"maxfun": self.budget, "maxiter": self.budget, "maxcor": 30, "ftol": 1e-10, "gtol": 1e-9}
        before = np.inf
        with suppress(_SpentError):
            while True:
                z = (last / self.unit).ravel()
                result = minimize(
                    level, z, jac=True, method="L-BFGS-B", bounds=self._box(), callback=watch, options=options
                )
                # At a kink of a distance the search may stop short; without its memory it often goes on.
                if not result.fun < before - 1e-3:
                    break
                before = result.fun
        self._look(last)
        return last

    def objective(self, Z: Array, sharpness: float, weight: float) -> tuple[float, Array]:
        """Soft cost plus weighted excess of the coefficients ``Z · unit``, and its derivative by Z, raveled."""
        X = Z * self.unit
        cost, slope = self.cost.gradient(self.at_samples @ X, sharpness)
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
        """Judge coefficients as a user would: scaled into the limits, by the true cost."""
        fits = True
        if self.bounds == "everywhere":
            X = self.within(X)
            fits = self.wary.fits(self.at_watch @ X, NEARLY)
        self._record(X, self.cost(self.at_samples @ X), fits)

    def _box(self) -> Box | None:
        """Limits at the points themselves, where the coefficients are positions, velocities and accelerations."""
        if self.box is None:
            return None
        low, high = self.box
        return Box((low / self.unit).ravel(), (high / self.unit).ravel())

    def _level(self, cost: float) -> float:
        return float(np.log(cost)) if self.cost.criterion.positive else cost

    def _record(self, X: Array, cost: float, fits: bool) -> None:
        """Keep the best motion that fits, and tell how far the search is."""
        if fits and cost < self.best:
            self.best, self.found = cost, X
            self.history.append((self.cost.evaluations, cost))
        if self.progress is not None:
            self.progress(min(1.0, self.cost.evaluations / self.budget), self.best)
