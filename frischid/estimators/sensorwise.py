"""The sensor-wise Frisch scheme: bounds from the noise of the sensors.

In the classical scheme (`frisch`) every column of the regressor has its own noise. On a robot, all columns are
functions of the same few sensors z = (q, q̇, q̈), and the torque is a further sensor. Let x = [y(z) τ] be a row, with
``x θ̃ = 0`` for exact readings and θ̃ = [θ; −1]. Let sensor s have independent errors of unknown variance σ_s². To
second order in the errors, Taylor's formula gives their contribution to the moments Σ = E[x xᵀ],

    Σ = Σ̂ + Σ_s σ_s² S_s,      S_s = ½ E[∂²(x xᵀ)/∂z_s²] = E[x_s x_sᵀ] + ½ E[x_ss xᵀ + x x_ssᵀ],      Σ̂ θ̃ = 0,

with x_s, x_ss the derivatives by z_s. The second half of S_s, the curvature, is of the same order as the first: without
it, gravity alone would bias θ by ½ σ_q². The curvature also makes the sign of a velocity tractable: sgn² = 1 with any
noise, so the curvature cancels the infinite x_s x_sᵀ, and the sum is finite (`sensor_noise` takes differences of
moments, never of columns).

**Statement.** Let V be the variances σ² ≥ 0, within a data sheet's limits if there is one, for which Σ − Σ_s σ_s² S_s
is positive semidefinite and singular, and θ(σ²) the null vector there, scaled to θ̃_L = −1. To second order the true
θ is θ(σ²) of the true variances, which lie in V; so every parameter lies between the extremes of θ_i over V. The
vertices need not share an orthant: Theorem 1 of the classical scheme is not used.

**Rays.** In direction d the set V is reached at the λ where Σ − λ Σ_s d_s S_s becomes singular, a generalised
eigenproblem. The axes give one *vertex* per sensor; that of the torque is ordinary least squares. V is nearly a flat
simplex and θ nearly linear on it, so sequential linear programs find the extremes: with u = θ̃ and c_s = uᵀS_s u,

    ∂θ/∂σ_s² = Σ̂_yy⁻¹ (S_s u)_y,      maximise g·σ²  subject to  c·σ² = budget, limits:  a fractional knapsack.

**Sampling.** Along the true direction the sample's θ errs by ``δu = −Σ̂⁺ (δM − δλ D) u`` with D = Σ_s d_s S_s,
δM the sampling error of Σ − λ D and δλ = uᵀδM u / uᵀDu. A jackknife over blocks of time, longer than the correlation,
estimates its covariance. The bounds are the extremes over V of θ_i ± t·stderr, t by Bonferroni over the p parameters.
No correction for the variances is needed: the bounds fail only where the one true direction fails.

**When it fails.** Three conditions break the bounds. Errors are so large that fourth-order terms count (0.05 rad is
small enough, 0.3 rad is not). Errors depend on one another but are declared independent (a q̇ derived from q belongs to
the same sensor, as in `sensor_noise`). The model has an error that no sensor explains: then, on a real log, the bounds
hold for the parameters that explain this error as noise.

The scheme is frischid's own: the idea of Frisch (1934) and Koopmans (1937) with a noise covariance of known shape and
moments corrected in the sense of Nakamura (1990, Biometrika 77) and of SIMEX (Cook and Stefanski 1994, JASA 89).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy import linalg, special

from frischid.core.types import Array
from frischid.errors import IdentifiabilityError, InputError, UnknownNameError
from frischid.estimators.frisch import Box, simplex, unit_diagonal

TORQUE = "torque"
EXTREME_ROUNDS = 3  # linear programs in sequence for each extreme; the set is so flat that the second rarely moves
SENSORWISE_BLOCKS = 8

Limits = Mapping[str, tuple[float, float]]


@dataclass(frozen=True, eq=False)
class SensorMoments:
    """Moments of [y τ] in blocks of time, and the contribution of each sensor's noise to them."""

    names: tuple[str, ...]
    """The p parameters."""
    sensors: tuple[str, ...]
    """The S sensors, ``"torque"`` last."""
    moments: Array
    """Weighted ``Σ_k x_k x_kᵀ`` of each block, torque last, (B, p + 1, p + 1)."""
    noise: Array
    """The block's S_s, (S, B, p + 1, p + 1): the contribution of one unit of the sensor's variance to the block's
    moments."""


@dataclass(frozen=True, eq=False)
class SensorWise:
    """Result of the sensor-wise scheme."""

    names: tuple[str, ...]
    sensors: tuple[str, ...]
    theta: Array
    """The middle of V, (p,): every sensor explains an equal share of the residual."""
    covariance: Array
    """Sampling covariance of `theta`, (p, p); the box, not this covariance, holds the uncertainty about the variances.
    """
    vertices: Array
    """Solution in which the sensor explains as much as possible, (p, S); NaN where its noise explains nothing."""
    variances: Array
    """The sensor's variance at its vertex, (S,): no sensor is noisier than this."""
    hull: Box
    """Extremes over V, as if the moments were exact."""
    box: Box
    """Extremes widened by the sampling error: every parameter at once, with the confidence asked for."""
    exact: bool
    """The data leave no residual; all of the above is the same solution."""
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class _Point:
    """A point of V: variances, scaled θ, its covariance and its gradient by the variances (p, S)."""

    x: Array
    theta: Array
    covariance: Array
    gradient: Array
    cost: Array
    bounded: bool


def sensorwise(data: SensorMoments, *, confidence: float = 0.95, limits: Limits | None = None) -> SensorWise:
    """Bounds of all parameters from the sensors' noise, its variances unknown or known within limits.

    Parameters
    ----------
    confidence : float
        Joint confidence of all bounds.
    limits : mapping of str to (float, float)
        Least and largest standard deviation of a sensor, in its own unit, where a data sheet gives them; the others
        are between zero and infinity.

    Raises
    ------
    IdentifiabilityError
        The columns are dependent, blocks are too few, or the least noise the limits ask for is more than there is.
    UnknownNameError
        The limits name an unknown sensor.
    """
    if not 0 < confidence < 1:
        raise InputError(f"the confidence must lie strictly between 0 and 1, not {confidence}")
    lower, upper = _variance_limits(data.sensors, limits or {})
    triangle = simplex(data.moments.sum(axis=0), data.names)
    if triangle.exact:
        return _exact(data, triangle.ols)
    if len(data.moments) < SENSORWISE_BLOCKS:
        raise IdentifiabilityError(
            f"{len(data.moments)} blocks of time cannot show the sampling error; record at least {SENSORWISE_BLOCKS} s"
        )
    quantile = -float(special.stdtrit(len(data.moments) - 1, (1 - confidence) / (2 * len(data.names))))
    scheme = _Scheme(data, lower, upper, quantile)
    corners = scheme.corners()
    found = [c for c in corners if c is not None]
    middle = scheme.point(np.mean([c.x for c in found], axis=0)) if found else None
    if middle is None:
        raise IdentifiabilityError(
            "no noise of the sensors within its limits explains the residual error; look for a missing effect "
            "(frischid diagnose), or give wider limits"
        )
    return scheme.result(middle, corners, [middle, *found, *scheme.extremes(middle)])


def _variance_limits(sensors: tuple[str, ...], limits: Limits) -> tuple[Array, Array]:
    for name, (low, high) in limits.items():
        if name not in sensors:
            raise UnknownNameError("sensor", name, sensors)
        if not 0 <= low <= high:
            raise InputError(
                f"sensor {name}: the limits of the standard deviation must be 0 ≤ lower ≤ upper, got {low} and {high}"
            )
    pairs = [limits.get(name, (0.0, np.inf)) for name in sensors]
    return np.array([low**2 for low, _ in pairs]), np.array([high**2 for _, high in pairs])


def _exact(data: SensorMoments, theta: Array) -> SensorWise:
    p, S = len(data.names), len(data.sensors)
    box, vertices = Box(data.names, theta, theta), np.repeat(theta[:, None], S, axis=1)
    note = "the residual error is zero, so the sensors have no noise, and lower and upper bounds are equal"
    return SensorWise(
        data.names, data.sensors, theta, np.zeros((p, p)), vertices, np.zeros(S), box, box, exact=True, notes=(note,)
    )


def _bordered(M: Array, border: Array, rhs: Array) -> Array:
    """Solve ``M x = rhs`` orthogonally to the null vector in the border; `rhs` in rows (k, n) or one vector (n,)."""
    whole = border.copy()
    whole[:-1, :-1] += M
    padding = [(0, 0)] * (rhs.ndim - 1) + [(0, 1)]
    return np.asarray(np.linalg.solve(whole, np.pad(rhs, padding).T).T[..., :-1])


class _Scheme:
    """The set V of one data set, on moments of unit diagonal."""

    def __init__(self, data: SensorMoments, lower: Array, upper: Array, quantile: float) -> None:
        self.data, self.lower, self.upper, self.quantile = data, lower, upper, quantile
        _, self.rms = unit_diagonal(data.moments.sum(axis=0), data.names)
        outer = np.outer(self.rms, self.rms)
        self.moments, self.noise = data.moments / outer, data.noise / outer
        self.sums = self.noise.sum(axis=1)
        self.start = self.moments.sum(axis=0) - np.tensordot(lower, self.sums, axes=1)
        if np.linalg.eigvalsh(self.start)[0] <= 0:
            raise IdentifiabilityError(
                "the lower limits of the sensors' noise alone cause more error than the log has; give smaller lower "
                "limits"
            )
        self.size = np.abs(self.sums).max(axis=(1, 2))  # of each sensor's effect, to compare directions
        self.seen: dict[bytes, _Point | None] = {}

    def point(self, x: Array) -> _Point | None:
        """Point of V on the ray from the lower limits through `x`; None where the ray never gets there."""
        direction = x - self.lower
        if not direction.any():
            direction = np.append(np.zeros(len(x) - 1), 1.0)  # all limits are used up: the torque takes the rest
        key = (direction / np.abs(direction * self.size).max()).round(9).tobytes()
        if key not in self.seen:
            self.seen[key] = self._solve(direction)
        return self.seen[key]

    def _solve(self, direction: Array) -> _Point | None:
        D = np.tensordot(direction, self.sums, axes=1)
        last = len(D) - 1
        w, U = linalg.eigh(D, self.start, subset_by_index=[last, last])
        if not w[0] > 0:
            return None
        x, u = self.lower + direction / w[0], U[:, 0] / np.linalg.norm(U[:, 0])
        blocks = self.moments - np.tensordot(x, self.noise, axes=1)
        M = blocks.sum(axis=0)
        cost = np.einsum("a,sab,b->s", u, self.sums, u)
        r = blocks @ u
        r -= np.outer(r @ u / (direction @ cost), D @ u)
        rank = np.zeros((len(u) + 1, len(u) + 1))
        rank[-1, :-1] = rank[:-1, -1] = u
        gradient = _bordered(M, rank, self.sums @ u)
        left = np.stack([_bordered(M - b, rank, -s) for b, s in zip(blocks, r, strict=True)])  # without that block
        B, theta = len(r), -u[:-1] / u[-1]
        bounded = abs(u[-1]) > self.quantile * np.sqrt((B - 1) / B * (left[:, -1] ** 2).sum())
        moved, gradient = (-(x[:, :-1] + np.outer(x[:, -1], theta)) / u[-1] for x in (left, gradient))
        covariance = (B - 1) / B * moved.T @ moved
        return _Point(x, theta, covariance, gradient.T, cost, bool(bounded))

    def corners(self) -> list[_Point | None]:
        """For each sensor, the point of V at which it explains as much as it may and the torque the rest."""
        S = len(self.lower)
        torque = self.point(np.append(self.lower[:-1], self.lower[-1] + 1.0))
        if torque is None:
            return [None] * S
        return [self.point(self._knapsack(torque, 2.0 * np.eye(S)[s] - 1.0)) for s in range(S - 1)] + [torque]

    def extremes(self, middle: _Point) -> list[_Point]:
        """Points at which the parameters are extreme over V, two per parameter."""
        found = []
        for i in range(len(middle.theta)):
            for sign in (-1.0, 1.0):
                here: _Point | None = middle
                for _ in range(EXTREME_ROUNDS):
                    if here is None:
                        break
                    gain = sign * (here.gradient[i] - here.gradient[i, -1] * here.cost / here.cost[-1])
                    here = self.point(self._knapsack(here, gain))
                    if here is not None:
                        found.append(here)
        return found

    def _knapsack(self, here: _Point, gain: Array) -> Array:
        """Maximise ``gain·x`` with the same residual explained; the torque explains the remaining residual."""
        cost = np.maximum(here.cost, 1e-12 * here.cost.max())
        left = cost @ (here.x - self.lower)
        x = self.lower.copy()
        gain = np.append(gain[:-1], 0.0)
        for s in np.argsort(-gain / cost, kind="stable"):
            room = min(self.upper[s] - self.lower[s], left / cost[s])
            x[s] += room
            left = max(0.0, left - room * cost[s])
        x[-1] += left / cost[-1]
        return x

    def result(self, middle: _Point, corners: list[_Point | None], points: list[_Point]) -> SensorWise:
        """Put the box around the points, in the parameters' own units."""
        data, unit = self.data, self.rms[-1] / self.rms[:-1]
        theta = np.array([c.theta for c in points])
        spread = self.quantile * np.sqrt([np.diag(c.covariance) for c in points])
        spread[[not c.bounded for c in points]] = np.inf
        hull = Box(data.names, theta.min(axis=0) * unit, theta.max(axis=0) * unit)
        box = Box(data.names, (theta - spread).min(axis=0) * unit, (theta + spread).max(axis=0) * unit)
        vertices = np.stack([np.full(len(unit), np.nan) if c is None else c.theta * unit for c in corners], axis=1)
        variances = np.array([np.nan if c is None else c.x[s] for s, c in enumerate(corners)])
        notes = []
        loose = [n for n, c in zip(data.sensors, corners, strict=True) if c is not None and not c.bounded]
        if not all(c.bounded for c in points):
            notes.append(
                f"some bounds are infinite: noise of {', '.join(loose) or 'several sensors'} could explain the whole "
                "residual error, and would be as large as the signal; give limits of the noise, for example from the "
                "data sheet"
            )
        excess = min(c.x[-1] for c in points)
        if excess > self.upper[-1] * (1 + 1e-9):
            notes.append(
                f"the sensors' noise within its limits leaves a torque residual of {np.sqrt(excess):.3g}, more than "
                f"the {np.sqrt(self.upper[-1]):.3g} allowed: the model lacks an effect, or the limits are too tight"
            )
        best, covariance = middle.theta * unit, middle.covariance * np.outer(unit, unit)
        return SensorWise(
            data.names, data.sensors, best, covariance, vertices, variances, hull, box, exact=False, notes=tuple(notes)
        )
