"""Errors in variables: least squares that accounts for the noise of the sensors behind the regressor.

Sample k measures ``z̃ = z + L ε`` (ε of unit covariance, L the square root of the sensors' covariance) and
``τ̃ = Y(z) θ + e``. Orthogonal distance regression chooses the states too,

    min_{θ, z_k}  Σ_k |L⁻¹(z̃_k − z_k)|² + |Y(z_k) θ − τ̃_k|²_{Σ_τ⁻¹}.

Eliminating the linearised states leaves the errors-in-variables likelihood, a generalised least squares

    min_θ Σ_k ρ_kᵀ Σ_ρ⁻¹ ρ_k,   ρ = Y(ẑ) θ + J(z̃ − ẑ) − τ̃,   Σ_ρ = Σ_τ + J L Lᵀ Jᵀ,   J = ∂(Yθ)/∂z,
    ẑ = z̃ − L Lᵀ Jᵀ Σ_ρ⁻¹ ρ,

solved by iteration (Boggs, Byrd and Schnabel 1987, SIAM J. Sci. Stat. Comput. 8(6)). Everything is evaluated at the
corrected state ẑ, whose error is uncorrelated with ρ. This, and not the weights alone, removes the bias of least
squares. Three points:

- *No* ``log det Σ_ρ``. ρ depends on θ, so its density is not that of the data; with the determinant even the straight
  line with errors in both variables is inconsistent, without it the estimate is Deming's.
- *Second order.* Where the torque is curved the residual of the true θ has the mean ½ tr(H P), H the Hessian and P =
  L Lᵀ − K Kᵀ the covariance of ẑ, ``K = L Lᵀ Jᵀ Σ_ρ^(-T/2)``. With C = ½ tr(∂²Y P) the equations solved are

      Σ_k Yᵀ Σ_ρ⁻¹ (τ̃ − J(z̃ − ẑ) − (Y − C) θ) = 0.

- *Dry friction* has no derivative at v = 0. Its columns enter as their mean over the sensors' noise, a smoothed sign,
  and their variance is added to Σ_ρ.

All derivatives are differences over ±√3 standard deviations, the nodes of a three-point Gauss-Hermite rule. Torque
noise is given, or starts at `frischid.logs.filters.noise_level` and is raised until the weighted squares average one
(Mandel and Paule 1970): residuals that the sensors do not explain count as torque noise. Filtered rows F Y are
corrected by Y(ẑ) − Y(z̃). The standard errors are a jackknife over blocks of time, which accounts for correlated
residuals. States, columns and slopes of all samples are needed in every iteration; they are in a `Store`, so that only
one stretch is in memory.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from frischid.core.array_store import Store, Stored
from frischid.core.types import Array, Column
from frischid.errors import IdentifiabilityError
from frischid.estimators.least_squares import JACKKNIFE_BLOCKS, Estimate
from frischid.estimators.normal_equations import WORST_CONDITION

NODE = np.sqrt(3.0)
EIV_BLOCKS = 64


@dataclass(frozen=True, eq=False)
class Samples:
    """A stretch of M samples of states, columns and torques, and how wrong the states are."""

    columns: Callable[[Array], Array]
    """States (M, S) -> columns (M, p + 1, R): the p parameters', and the torque known outright."""
    state: Array
    """What was measured, such as [q v a], (M, S)."""
    Y: Array
    """The measured columns of the R torque rows, filtered, (M, p + 1, R)."""
    tau: Array
    """Measured torque, N·m (N), (M, R)."""
    used: NDArray[np.bool_]
    """Shape (M, R)."""
    directions: Array
    """Rows l_d with ``Σ_d l_d l_dᵀ`` the covariance of a state's errors, (D, S)."""
    ratios: Array
    """Variance before the filter over this one, (D,); the unfiltered errors acted on Y."""
    torque: Array
    """Standard deviation of the torque's noise, (R,)."""
    dry: NDArray[np.bool_]
    """Columns without a derivative, (p,)."""
    torque_given: bool
    """Whether `torque` is exact and not raised."""


class _Stretch:
    """One `Samples`, its arrays in a store, with its current states as whitened corrections: ``ẑ = z̃ − ε L``.

    By name there are the measured ``state``, ``tau`` and ``used``; ``offset``, by which the measured columns differ
    from those at the measured state; ``epsilon`` (M, D); and, linearised at the current state, the columns ``Y`` and
    their curvature ``C`` (M, p + 1, R), ``JL`` (M, R, D), and the variance ``extra`` (M, R) of the dry columns.
    """

    def __init__(self, data: Samples, store: Store) -> None:
        self.columns, self.directions, self.ratios, self.dry = data.columns, data.directions, data.ratios, data.dry
        self.torque, self.torque_given, self.samples = data.torque, data.torque_given, len(data.tau)
        self._store, self._kept = store, dict[str, Stored]()
        self["state"], self["tau"], self["used"] = data.state, data.tau, data.used
        self["offset"] = data.Y - data.columns(data.state)
        self["epsilon"] = np.zeros((len(data.state), len(data.directions)))

    def __getitem__(self, name: str) -> NDArray[Any]:
        return self._kept[name].read()

    def __setitem__(self, name: str, x: NDArray[Any]) -> None:
        if name in self._kept:
            self._kept[name].replace(x)
        else:
            self._kept[name] = self._store.put(x)

    def measured(self) -> Array:
        """The measured columns, filtered, (M, p + 1, R)."""
        return np.asarray(self["offset"] + self.columns(self["state"]))

    def linearise(self, theta: Array, inflation: float) -> None:
        """Columns at the current states, their slopes and curvature, by differences along the sensors' errors."""
        plus_known, smooth = np.append(theta, 1.0), np.append(~self.dry, True)
        z = self["state"] - self["epsilon"] @ self.directions
        centre = self.columns(z)
        Y = self["offset"] + centre
        bend, square = np.zeros_like(Y), np.zeros_like(Y[:, :-1])
        JL = np.zeros((len(z), Y.shape[2], len(self.directions)))
        C = np.zeros_like(Y)
        for d, (direction, ratio) in enumerate(zip(self.directions, self.ratios, strict=True)):
            up, down = self.columns(z + NODE * direction), self.columns(z - NODE * direction)
            JL[:, :, d] = np.einsum("kcr,c->kr", (up - down)[:, smooth], plus_known[smooth]) / (2 * NODE)
            second = (up + down - 2 * centre) / 6.0
            bend += second
            C += ratio * second
            square += (up[:, :-1] ** 2 + down[:, :-1] ** 2 - 2 * centre[:, :-1] ** 2) / 6.0
        dry = np.flatnonzero(self.dry)
        mean = Y[:, dry] + bend[:, dry]
        left = np.maximum(Y[:, dry] ** 2 + square[:, dry] - mean**2, 0.0)
        Y[:, dry] = mean
        extra = np.einsum("kcr,c->kr", left, theta[dry] ** 2)
        root = np.linalg.cholesky(self.covariance(JL, extra, inflation))
        K = JL.swapaxes(1, 2) @ np.linalg.inv(root).swapaxes(1, 2)
        for r in range(K.shape[2]):
            step = K[:, :, r] @ self.directions
            C -= 0.5 * (self.columns(z + step) + self.columns(z - step) - 2 * centre)
        C[:, dry] = 0.0
        self["Y"], self["C"], self["JL"], self["extra"] = Y, C, JL, extra

    def covariance(self, JL: Array, extra: Array, inflation: float) -> Array:
        """Σ_ρ of each sample; unit rows and columns where a row is not used."""
        used = self["used"]
        diagonal = np.where(used, inflation * self.torque**2 + extra, 1.0)
        JL = JL * used[:, :, None]
        return np.asarray(JL @ JL.swapaxes(1, 2) + diagonal[:, :, None] * np.eye(diagonal.shape[1]))

    def weights(self, inflation: float) -> Array:
        """Σ_ρ⁻¹, zero on rows not used."""
        W, used = np.linalg.inv(self.covariance(self["JL"], self["extra"], inflation)), self["used"]
        return np.asarray(W * used[:, :, None] * used[:, None, :])

    def equations(self) -> Array:
        """Curvature-corrected columns, and last what to fit: ``τ̃ − J(z̃ − ẑ)`` less what is known; (M, p + 1, R)."""
        corrected = self["Y"] - self["C"]
        shift = np.einsum("krd,kd->kr", self["JL"], self["epsilon"])
        corrected[:, -1] = self["tau"] - shift - corrected[:, -1]
        return np.asarray(corrected)

    def residual(self, theta: Array) -> Array:
        """Curvature-corrected ρ of each sample, (M, R)."""
        return np.asarray(np.einsum("kcr,c->kr", self.equations(), np.append(theta, -1.0)))

    def correct(self, theta: Array, inflation: float) -> None:
        """Correct the states so that the data and θ agree best."""
        pull = np.einsum("krs,ks->kr", self.weights(inflation), self.residual(theta))
        self["epsilon"] = np.einsum("krd,kr->kd", self["JL"], pull)


def eiv(
    stretches: Iterable[Samples], columns: Sequence[Column], joints: Sequence[str], iterations: int = 3
) -> Estimate:
    """Errors-in-variables estimate of the base parameters.

    Parameters
    ----------
    stretches : iterable of Samples
        From `state_samples.samples`; read once, one of them in memory at a time (see `Store`).
    columns : sequence of Column
        The p base parameters.
    joints : sequence of str
        Joints of the R torque rows.
    iterations : int
        Iterations of linearising, solving and correcting the states; the third changes little.

    Raises
    ------
    IdentifiabilityError
        The data leave some combination of parameters undetermined.
    """
    names, store = [c.name for c in columns], Store()
    parts = [_Stretch(s, store) for s in stretches]
    largest = max(float(np.abs(part["tau"]).max(initial=0.0)) for part in parts)
    for part in parts:  # a torque without any noise would make Σ_ρ singular
        part.torque = np.maximum(part.torque, 1e-6 * largest)
    theta = _start(parts, names)
    inflation = 1.0
    given = all(part.torque_given for part in parts)
    for _ in range(iterations if given else iterations + 1):
        for part in parts:
            part.linearise(theta, inflation)
        if not given:
            inflation = _inflation(parts, theta)
        whole = _equations(parts, inflation).sum(axis=0)
        theta, condition = solve_scaled(whole[:, :-1], whole[:, -1], names)
        for part in parts:
            part.correct(theta, inflation)
    sums = _equations(parts, inflation)
    covariance = covariance_of(sums, theta)
    A, B = sums.sum(axis=0)[:, :-1], len(sums)
    torque = np.average([part.torque for part in parts], axis=0, weights=[part.samples for part in parts])
    notes = [f"only {B} blocks of data: standard errors are uncertain"] if B < JACKKNIFE_BLOCKS else []
    if inflation > 4.0:
        notes.append(
            "the sensors' noise explains only a part of the residual: the torque noise was set to "
            f"{np.sqrt(inflation):.3g} times its high-frequency level; a missing effect may be the cause"
        )
    return Estimate(
        columns=tuple(columns),
        theta=theta,
        covariance=covariance,
        joints=tuple(joints),
        sigma=_spread(parts, theta),
        weights=1.0 / (inflation * torque**2),
        condition=condition,
        estimator="eiv",
        information=information_of(A, covariance),
        notes=tuple(notes),
    )


def information_of(A: Array, covariance: Array) -> Array:
    """Symmetric part of a weighted normal matrix over the factor by which correlation inflates variances, (p, p)."""
    plain = (A + A.T) / 2
    inflation = float(np.median(np.diag(covariance) / np.abs(np.diag(np.linalg.inv(plain)))))
    return np.asarray(plain / max(1.0, inflation))


def _start(parts: Sequence[_Stretch], names: Sequence[str]) -> Array:
    """Least squares, torque rows in units of their spread."""
    A: Array = np.zeros((len(names), len(names)))
    b = np.zeros(len(names))
    squares = np.sum([(part["tau"] ** 2).sum(axis=0) for part in parts], axis=0)
    spread = np.sqrt(squares / sum(part.samples for part in parts)) + 1e-300
    for part in parts:
        measured = part.measured()
        Y = measured[:, :-1] * (part["used"] / spread)[:, None, :]
        A += np.tensordot(Y, Y, axes=([0, 2], [0, 2]))
        b += np.tensordot(Y, (part["tau"] - measured[:, -1]) / spread, axes=([0, 2], [0, 1]))
    return solve_scaled(A, b, names)[0]


def _spread(parts: Sequence[_Stretch], theta: Array) -> Array:
    """Root mean square residual of each row, states uncorrected, (R,)."""
    squares, count = np.zeros((2, len(parts[0].torque)))
    for part in parts:
        left = part["tau"] - np.einsum("kcr,c->kr", part.measured(), np.append(theta, 1.0))
        squares += (left**2 * part["used"]).sum(axis=0)
        count += part["used"].sum(axis=0)
    return np.asarray(np.sqrt(squares / np.maximum(count, 1)))


def _equations(parts: Sequence[_Stretch], inflation: float) -> Array:
    """Normal equations [A b] summed over blocks of time, (B, p, p + 1)."""
    total = sum(part.samples for part in parts)
    p = len(parts[0].dry)
    sums, first = np.zeros((min(EIV_BLOCKS, total), p, p + 1)), 0
    for part in parts:
        YW = part["Y"][:, :-1] @ part.weights(inflation)
        right = part.equations()
        block = (first + np.arange(len(YW))) * len(sums) // total
        for number in np.unique(block):
            s = block == number
            sums[number] += np.tensordot(YW[s], right[s], axes=([0, 2], [0, 2]))
        first += len(YW)
    return sums


def covariance_of(sums: Array, theta: Array) -> Array:
    """Delete-one-block jackknife of ``A θ = b`` from the blocks' [A b], (B, p, p + 1): see `least_squares`."""
    whole = sums.sum(axis=0)
    scale = 1.0 / np.sqrt(np.abs(np.diag(whole)))
    scores = (sums[:, :, -1] - sums[:, :, :-1] @ theta) * scale
    rest = (whole - sums)[:, :, :-1] * np.outer(scale, scale)
    changes = scale * np.linalg.solve(rest, scores[:, :, None])[:, :, 0]
    return np.asarray((len(sums) - 1) / len(sums) * changes.T @ changes)


def solve_scaled(A: Array, b: Array, names: Sequence[str]) -> tuple[Array, float]:
    """Solve ``A θ = b`` on a unit diagonal; also the condition number, as that of the root of A.

    Raises
    ------
    IdentifiabilityError
        Some combination of parameters is not determined.
    """
    diagonal = np.diag(A)
    if not (diagonal > 0).all():
        blind = [n for n, d in zip(names, diagonal, strict=True) if not d > 0]
        raise IdentifiabilityError(f"the log never excites {', '.join(blind)}; leave the effect out or move the joint")
    scale = 1.0 / np.sqrt(diagonal)
    scaled = A * np.outer(scale, scale)
    _, values, vectors = np.linalg.svd(scaled)
    condition = float(np.sqrt(values[0] / max(values[-1], 1e-300)))
    if condition > WORST_CONDITION:
        worst = np.abs(vectors[-1])
        blind = [names[i] for i in np.argsort(-worst)[:6] if worst[i] > 0.1 * worst.max()]
        raise IdentifiabilityError(
            f"this log cannot distinguish {', '.join(blind)} (condition number {condition:.1e}); "
            "record a motion that moves these joints more, or leave an effect out"
        )
    return scale * np.linalg.solve(scaled, scale * b), condition


def _inflation(parts: Sequence[_Stretch], theta: Array) -> float:
    """Factor on the torque's variance at which the weighted squares of the residuals average one; at least one."""
    rows = sum(int(part["used"].sum()) for part in parts)
    for part in parts:
        part["rho"] = part.residual(theta)

    def excess(log_factor: float) -> float:
        weighted = (
            np.einsum("kr,krs,ks->", part["rho"], part.weights(float(np.exp(log_factor))), part["rho"])
            for part in parts
        )
        return float(sum(weighted)) / max(1, rows - len(theta)) - 1.0

    top = 0.0
    if excess(top) <= 0:
        return 1.0
    while excess(top) > 0 and top < 60.0:
        top += 4.0
    return float(np.exp(brentq(excess, top - 4.0, top, xtol=1e-3)))
