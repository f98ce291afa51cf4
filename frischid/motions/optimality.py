"""Criteria of a motion: numbers, with gradients, that are small when the motion determines the parameters well.

The covariance of least-squares parameters is proportional to the inverse of the moments ``M = Πᵀ Π`` of the base
regressor Π. A motion is good when M is large, and about equally large in every direction:

    condition    √(λ_max/λ_min) of D M D,  D = diag(M)^(−1/2)           (Gautier and Khalil 1992, columns scaled)
    d_optimal    −(log det M/N)/p          the volume of the confidence ellipsoid (Swevers et al. 1997)
    paper        λ₁ cond Π + λ₂/σ_min(Π) + ψ                            (Massaroli et al., eq. 19)
    separation   −(log det M − log det M_rest)/k    D_s-optimality of the last k columns; M_rest: the other columns

with ψ the ∞-norm of the off-diagonal of ``S = Ñᵀ Ñ / (nN)``, ``Ñ = Π(x + noise) − Π(x)``. ψ measures the correlation of
noise between the columns that comes from noise on q, q̇, q̈; the Frisch scheme assumes that there is none. The noise is
drawn once.

Extreme eigenvalues have a derivative only where they are simple, and at an optimum several become equal. So every
criterion uses the soft extremes ``λ_max ≈ (Σ λᵏ)^(1/k)``, ``λ_min ≈ (Σ λ⁻ᵏ)^(−1/k)``, which are smooth, and exact for
k → ∞. The search raises the exponent k step by step. An eigenvalue changes by
``dλ_i = u_iᵀ dM u_i``, so every gradient is one matrix G with ``df = tr(G dM)``, and ``∂f/∂Π = 2 Π G``.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from frischid.core.types import Array
from frischid.errors import InputError, UnknownNameError

UNSMOOTHED = np.inf
"""Exponent k at which soft extremes are the exact ones."""
CRITERIA: dict[str, type[Criterion]] = {}
"""Every criterion by name; defining a subclass adds one."""


class Criterion(ABC):
    """A cost of base regressors.

    A criterion gets the base regressor as W of shape (1 + D, N, p, J): at the motion itself, and at D copies of the
    motion displaced by `displacements`.
    """

    name: ClassVar[str]
    title: ClassVar[str]
    positive: ClassVar[bool] = True
    listed: ClassVar[bool] = True
    """Whether the criterion can be chosen by its name alone."""
    of_points: ClassVar[bool] = False
    """Whether the cost belongs to its instants, and is not that of the motion between them."""
    scaled: ClassVar[bool] = True
    """Whether other units of the parameters change the cost by a constant at most."""

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        if "name" in cls.__dict__ and cls.listed:
            CRITERIA[cls.name] = cls

    def displacements(self, samples: int, joints: int, seed: int) -> Array:
        """Displacements of (q, q̇, q̈) for each of the D copies, shape (D, 3, N, J); none by default."""
        return np.empty((0, 3, samples, joints))

    @abstractmethod
    def __call__(self, W: Array, exponent: float = UNSMOOTHED) -> tuple[float, Array]:
        """Cost and its derivative with respect to every entry of W.

        Parameters
        ----------
        W : ndarray, shape (1 + D, N, p, J)
        exponent : float
            Exponent k of the soft extremes.

        Returns
        -------
        cost : float
        gradient : ndarray, shape (1 + D, N, p, J)
        """


@dataclass(frozen=True)
class Condition(Criterion):
    """Condition number of the base regressor with its columns at unit norm."""

    name: ClassVar[str] = "condition"
    title: ClassVar[str] = "condition number, columns at unit norm"

    def __call__(self, W: Array, exponent: float = UNSMOOTHED) -> tuple[float, Array]:
        """See `Criterion`."""
        M = _moments(W[0])
        size = np.maximum(M.diagonal(), 1e-300)
        root = np.sqrt(size)
        S = M / np.outer(root, root)
        (high, low), (G_high, G_low) = _log_extremes(S, exponent)
        cost = float(np.exp(0.5 * (high - low)))
        G = 0.5 * cost * (G_high - G_low)
        # The unit norms change with M as well.
        G_M = G / np.outer(root, root) - np.diag((G * S).sum(axis=1) / size)
        return cost, _through_moments(W, G_M)


@dataclass(frozen=True)
class DOptimal(Criterion):
    """Mean log variance of the parameters; other units of the parameters only add a constant."""

    name: ClassVar[str] = "d_optimal"
    title: ClassVar[str] = "−log det of the moments per sample and parameter"
    positive: ClassVar[bool] = False

    def __call__(self, W: Array, exponent: float = UNSMOOTHED) -> tuple[float, Array]:
        """See `Criterion`."""
        M = _moments(W[0]) / W.shape[1]
        values, vectors = _spectrum(M)
        G = -(vectors / values) @ vectors.T / len(M)
        return float(-np.log(values).mean()), _through_moments(W, G / W.shape[1])


@dataclass(frozen=True)
class Paper(Criterion):
    """Cost (19) of Massaroli et al."""

    name: ClassVar[str] = "paper"
    title: ClassVar[str] = "cost (19): λ₁ cond + λ₂/σ_min + ψ"
    of_points: ClassVar[bool] = True
    scaled: ClassVar[bool] = False

    condition: float = 1.0
    smallest: float = 1.0
    correlation: float = 1.0
    """`condition`, `smallest`, `correlation`: Weights λ₁ of cond Π, λ₂ of 1/σ_min(Π), and of ψ."""
    noise: float = 1.0
    """Standard deviation of the synthetic noise on q, q̇ and q̈; the authors' code uses 1."""
    draws: int = 1
    """Noise realisations over which ψ is averaged. With a single one, as the authors use, the motion can adapt to it.
    """

    def __post_init__(self) -> None:
        if not (np.isfinite(self.noise) and self.noise >= 0 and self.draws >= 1):
            raise InputError(f"criterion paper: noise {self.noise} must be 0 or more, draws {self.draws} at least 1")

    def displacements(self, samples: int, joints: int, seed: int) -> Array:
        """See `Criterion`: standard normal noise, fixed by the seed."""
        noise = np.random.default_rng(seed).normal(size=(self.draws, 3, samples, joints))
        return np.asarray(self.noise * noise)

    def __call__(self, W: Array, exponent: float = UNSMOOTHED) -> tuple[float, Array]:
        """See `Criterion`."""
        (high, low), (G_high, G_low) = _log_extremes(_moments(W[0]), exponent)
        cond, inverse = float(np.exp(0.5 * (high - low))), float(np.exp(-0.5 * low))
        G = 0.5 * self.condition * cond * (G_high - G_low) - 0.5 * self.smallest * inverse * G_low
        gradient = _through_moments(W, G)
        psi, slope = self._psi(W, exponent)
        cost = self.condition * cond + self.smallest * inverse + self.correlation * psi
        return cost, gradient + self.correlation * slope

    def _psi(self, W: Array, exponent: float) -> tuple[float, Array]:
        """ψ and its derivative with respect to every entry of W."""
        moved = W[1:] - W[0]
        scale = 1.0 / (moved.shape[0] * moved.shape[1] * moved.shape[3])
        S = scale * sum(_moments(each) for each in moved)
        off = S - np.diag(S.diagonal())
        rows = np.maximum(np.abs(off).sum(axis=1), 1e-300)
        value, weights = _soft_max(np.log(rows), exponent)
        psi = float(np.exp(value))
        G = (psi * weights / rows)[:, None] * np.sign(off)
        slope = np.zeros_like(W)
        slope[1:] = scale * np.einsum("pq,dnqj->dnpj", G + G.T, moved)
        slope[0] = -slope[1:].sum(axis=0)
        return psi, slope


@dataclass(frozen=True)
class Separation(Criterion):
    """Joint variance of the parameters of the last columns, beside all other parameters (D_s-optimality).

    A. C. Atkinson, A. N. Donev and R. D. Tobias, Optimum Experimental Designs, with SAS, Oxford 2007, section 10.3.
    """

    name: ClassVar[str] = "separation"
    title: ClassVar[str] = "−log det of the moments of both effects' columns, given all other columns"
    positive: ClassVar[bool] = False
    listed: ClassVar[bool] = False

    count: int
    """Number of these columns, at the end of the base regressor."""

    def __call__(self, W: Array, exponent: float = UNSMOOTHED) -> tuple[float, Array]:
        """See `Criterion`."""
        M = _moments(W[0]) / W.shape[1]
        rest = len(M) - self.count
        (values, vectors), (others, directions) = _spectrum(M), _spectrum(M[:rest, :rest])
        G = -(vectors / values) @ vectors.T
        G[:rest, :rest] += (directions / others) @ directions.T
        cost = float(np.log(others).sum() - np.log(values).sum()) / self.count
        return cost, _through_moments(W, G / (self.count * W.shape[1]))


def criterion_of(criterion: str | Criterion) -> Criterion:
    """The criterion of a name; an unknown name is an `UnknownNameError` that lists the valid names."""
    if isinstance(criterion, Criterion):
        return criterion
    if criterion not in CRITERIA:
        raise UnknownNameError("criterion", criterion, CRITERIA)
    return CRITERIA[criterion]()


def inflation(W: Array) -> Array:
    """Standard error of each parameter, over its standard error where all other parameters are known.

    The variance of θ_i is proportional to ``(M⁻¹)_ii``, and to ``1/M_ii`` where all others are known. So this is the
    square root of the variance inflation factor; no value exceeds the condition number of columns at unit norm.
    Source: D. W. Marquardt 1970, Technometrics 12(3).

    Parameters
    ----------
    W : ndarray, shape (N, p, J)
        Base regressor along a motion.

    Returns
    -------
    ndarray, shape (p,)

    Examples
    --------
    >>> import numpy as np
    >>> from frischid.motions.optimality import inflation
    >>> W = np.array([[1.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])[:, :, None]  # two alike, one on its own
    >>> inflation(W).round(2).tolist()
    [1.41, 1.41, 1.0]
    """
    M = _moments(W)
    root = np.sqrt(np.maximum(M.diagonal(), 1e-300))
    values, vectors = _spectrum(M / np.outer(root, root))
    return np.asarray(np.sqrt((vectors**2 / values).sum(axis=1)))


def _moments(W: Array) -> Array:
    """Π'Π of a regressor of shape (N, p, J)."""
    flat = W.transpose(1, 0, 2).reshape(W.shape[1], -1)
    return np.asarray(flat @ flat.T)


def _through_moments(W: Array, G: Array) -> Array:
    """Derivative of a cost with respect to W, from its (symmetric) derivative G with respect to the moments of W[0]."""
    gradient = np.zeros_like(W)
    gradient[0] = 2.0 * np.matmul(G, W[0])
    return gradient


def _spectrum(M: Array) -> tuple[Array, Array]:
    """Eigenvalues, at least the level of rounding, and eigenvectors."""
    values, vectors = np.linalg.eigh(M)
    return np.maximum(values, 1e-15 * max(values[-1], 1e-300)), vectors


def _log_extremes(M: Array, exponent: float) -> tuple[tuple[float, float], tuple[Array, Array]]:
    """Logarithms of the soft largest and smallest eigenvalue, and their derivatives with respect to M."""
    values, vectors = _spectrum(M)
    high, w_high = _soft_max(np.log(values), exponent)
    low, w_low = _soft_max(-np.log(values), exponent)
    return (high, -low), ((vectors * (w_high / values)) @ vectors.T, (vectors * (w_low / values)) @ vectors.T)


def _soft_max(x: Array, exponent: float) -> tuple[float, Array]:
    """``log(Σ exp(k x))/k`` and its derivative."""
    top = x.argmax()
    if np.isinf(exponent):
        return float(x[top]), np.eye(len(x))[top]
    weights = np.exp(exponent * (x - x[top]))
    total = weights.sum()
    return float(x[top] + np.log(total) / exponent), weights / total
