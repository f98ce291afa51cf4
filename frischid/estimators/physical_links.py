"""Standard parameters of links that could exist, as close to their prior as the measurements allow.

A rigid body is a distribution of mass, and its ten parameters are the moments of this distribution,

    P = [[Σ, h], [hᵀ, m]] = ∫ [r; 1] [r; 1]ᵀ dm ⪰ 0,      Σ = ½ tr(I) 1 − I,

the pseudo-inertia. Positive mass, positive inertia and the triangle inequality together mean that P is positive
semidefinite (Wensing, Kim and Slotine 2018, IEEE RA-L 3(1)). Base parameters ``θ_b = K θ`` determine θ only in part,
and because of noise, possibly no such body has them. So, in two convex steps,

    χ²* = min_θ  (K θ − θ_b)ᵀ Σ_b⁻¹ (K θ − θ_b)                       every link physical
    θ*  = argmin Σ_i tr(P_i P_0i⁻¹) − log det(P_i P_0i⁻¹) − 4 + ½ ((m_i / m_0i − 1) / MASS_ERROR)²
                                                                      χ²(θ) ≤ χ²* + PRIOR_SLACK p

The second is the log-det divergence from the nominal links P_0, which does not depend on frames or units (Lee, Wensing
and Park 2020, IEEE T-RO 36(2)), and the error of the nominal masses. The divergence alone lets a mass grow cheaply,
although a mass is what data sheets know best: where the measurements leave a mass open, it stays near the nominal one.
With ``P_i = L_i X_i L_iᵀ`` and ``P_0i = L_i L_iᵀ`` every unknown is near one, for light and heavy links.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import special

from frischid.core.types import Array
from frischid.errors import FrischidError, InputError
from frischid.estimators.nominal_links import Links, reference_inertias
from frischid.robot.inertia import dynamic_parameters, pseudo_inertia

PARAMETERS = ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
PRIOR_SLACK = 0.02  # share of χ²'s mean p by which the prior may raise χ²
MASS_ERROR = 0.1  # relative error of a nominal mass; with it, masses of a UR10e's URDF stay within 13 % (0.01 to 0.2)
LEAST_LINK_SHARE = 1e-3  # least share of the nominal link in any direction: simulators refuse bodies that are flat
SHARPEST = 1e5  # the nominal link over the smallest standard error that any combination is given
BOUND_CONFIDENCE = 0.999  # confidence of the bounds that a consistent robot must keep
AT_BOUNDARY = 3.0  # × LEAST_LINK_SHARE: a link this close to it is called at the boundary


class InfeasibleError(FrischidError):
    """No body satisfies the constraints of a link; the message names the link and the constraint."""


@dataclass(frozen=True, eq=False)
class Extras:
    """E further parameters besides the links': effects' coefficients."""

    names: tuple[str, ...]
    nominal: Array
    """Shape (E,)."""
    scale: Array
    """Typical size of each, (E,)."""
    signs: NDArray[np.int_]
    """Known sign, (E,); 0 when either is possible."""


class Active(NamedTuple):
    """A constraint that decides the result: its place and its name."""

    where: str
    constraint: str


@dataclass(frozen=True, eq=False)
class Consistent:
    """Physically consistent standard parameters."""

    theta: Array
    """Links' parameters, then the extras, (10 L + E,)."""
    base: Array
    """``K θ``, (p,)."""
    misfit: float
    """χ²*, in squared standard errors: the misfit that the constraints force."""
    chi_squared: float
    """χ² of the returned links: `misfit`, and what nearness to the nominal links costs, up to ``PRIOR_SLACK p``."""
    reproduces: bool
    """Whether the base parameters stay within their bounds: ``χ²* ≤`` the `BOUND_CONFIDENCE` quantile of χ² with p
    degrees of freedom."""
    eigenvalues: Array
    """Least eigenvalue of each P relative to the nominal link's, as computed from `theta`, (L,); all at least
    `LEAST_LINK_SHARE`."""
    divergence: Array
    """Log-det divergence from the nominal link, (L,)."""
    active: tuple[Active, ...]
    """Links at their boundary, centres of mass at a face, signs that hold a parameter at zero."""
    blame: tuple[tuple[str, float], ...]
    """If the base parameters are not reproduced: links, and the fall of χ² if the link need not be physical; worst
    first."""
    notes: tuple[str, ...]
    """Nominal links that could not exist, and the links that replace them as a prior."""

    @property
    def feasible(self) -> bool:
        """Whether every returned link is physical, by its eigenvalues."""
        return bool((self.eigenvalues > 0.5 * LEAST_LINK_SHARE).all())


def consistent(theta: Array, information: Array, mapping: Array, links: Links, extras: Extras) -> Consistent:
    """Find the physical links nearest to the nominal ones among those that reproduce base parameters.

    Parameters
    ----------
    theta : ndarray, shape (p,)
        Base parameters θ_b as estimated.
    information : ndarray, shape (p, p)
        Their precision Σ_b⁻¹.
    mapping : ndarray, shape (p, 10 L + E)
        K in ``θ_b = K θ``; zero for known parameters.

    Raises
    ------
    InfeasibleError
        A link cannot satisfy its own constraints.
    InputError
        The shapes disagree.
    """
    L, E = len(links.names), len(extras.names)
    if mapping.shape != (len(theta), 10 * L + E) or information.shape != (len(theta),) * 2:
        raise InputError(
            f"{len(theta)} base parameters of {L} links and {E} further parameters need a mapping of shape "
            f"{(len(theta), 10 * L + E)} and an information of {(len(theta),) * 2}, "
            f"got {mapping.shape} and {information.shape}"
        )
    reference, notes = reference_inertias(links)
    problem = _Problem(
        theta, information, mapping, links, extras, np.asarray(np.linalg.cholesky(reference), dtype=float)
    )
    if not problem.solve_fit():
        raise InfeasibleError(_reason(problem, links))
    misfit = problem.misfit
    reproduces = misfit <= 2 * float(special.gammaincinv(len(theta) / 2, BOUND_CONFIDENCE))
    blame = () if reproduces else problem.blame(misfit)
    problem.solve_nearest(misfit + PRIOR_SLACK * len(theta))
    values, chi_squared = problem.values, problem.misfit
    inverse = np.linalg.inv(problem.roots)
    X = inverse @ pseudo_inertia(values[: 10 * L].reshape(L, 10)) @ inverse.transpose(0, 2, 1)
    spectrum = np.linalg.eigvalsh(X)
    divergence = spectrum.sum(axis=1) - np.log(np.maximum(spectrum, 1e-300)).sum(axis=1) - 4.0
    found = problem.active()
    sizes = (misfit, chi_squared, reproduces, spectrum[:, 0], divergence)
    return Consistent(values, mapping @ values, *sizes, found, blame, notes)


class _Problem:
    """The convex problem in the scaled unknowns X (4 × 4 a link) and the extras."""

    def __init__(
        self, theta: Array, information: Array, mapping: Array, links: Links, extras: Extras, roots: Array
    ) -> None:
        import cvxpy as cp  # the import takes a second, so it is done only for physical links

        self.links, self.extras, self.roots = links, extras, roots
        L = len(links.names)
        self.X = [cp.Variable((4, 4), symmetric=True) for _ in range(L)]
        self.e = cp.Variable(len(extras.names)) if extras.names else None
        # ten parameters of a link, linear in the sixteen entries of X
        units = np.eye(16).reshape(16, 4, 4)
        self.unscale = [dynamic_parameters(C @ units @ C.T).T for C in roots]
        self.parameters = [M @ cp.vec(X, order="C") for M, X in zip(self.unscale, self.X, strict=True)]
        columns = [mapping[:, 10 * i : 10 * i + 10] @ M for i, M in enumerate(self.unscale)]
        columns.append(mapping[:, 10 * L :] * extras.scale)
        A, b = _whitened(np.hstack(columns), theta, information)
        unknown = cp.hstack([*(cp.vec(X, order="C") for X in self.X), *([] if self.e is None else [self.e])])
        self.error = A @ unknown - b
        self.cones = [X >> LEAST_LINK_SHARE * np.eye(4) for X in self.X]
        self.own = [self._demands(i) for i in range(L)]
        self.signs = self._signs()

    def _demands(self, i: int) -> dict[str, Any]:
        """Constraints of one link besides its existence, by their description."""
        demands: dict[str, Any] = {}
        x, known, box = self.parameters[i], self.links.known[i], self.links.boxes[i]
        given = np.flatnonzero(~np.isnan(known))
        if len(given):
            size = np.abs(self.unscale[i][given]).max(axis=1)
            words = ", ".join(f"{PARAMETERS[k]} = {known[k]:g}" for k in given)
            demands[f"values known outright ({words})"] = x[given] / size == known[given] / size
        if box is not None:
            A, b = box
            demands["centre of mass within its box"] = (A @ x[1:4] - b * x[0]) / self.roots[i][3, 3] ** 2 <= 0
        return demands

    def _signs(self) -> list[Any]:
        if self.e is None or not self.extras.signs.any():
            return []
        free = np.flatnonzero(self.extras.signs)
        return [np.diag(self.extras.signs[free]) @ self.e[free] >= 0]

    @property
    def constraints(self) -> list[Any]:
        return [*self.cones, *(c for own in self.own for c in own.values()), *self.signs]

    def _run(self, objective: Any, constraints: Sequence[Any]) -> bool:
        import cvxpy as cp

        problem = cp.Problem(objective, list(constraints))
        try:
            with warnings.catch_warnings():
                # "may be inaccurate": the result is checked later, so the solver's warning is not needed
                warnings.simplefilter("ignore", UserWarning)
                problem.solve(solver=cp.CLARABEL, max_iter=300)
        except cp.SolverError:
            return False
        return problem.status in (cp.OPTIMAL, cp.OPTIMAL_INACCURATE)

    def solve_fit(self) -> bool:
        """Least misfit with physical links."""
        import cvxpy as cp

        return self._run(cp.Minimize(cp.norm(self.error)), self.constraints)

    def solve_nearest(self, allowed: float) -> None:
        """Nearest links with at most this misfit."""
        import cvxpy as cp

        divergence = sum(cp.trace(X) - cp.log_det(X) for X in self.X)
        for x, nominal in zip(self.parameters, self.links.nominal[:, 0], strict=True):
            if nominal > 0:
                divergence = divergence + 0.5 * cp.square((x[0] / nominal - 1.0) / MASS_ERROR)
        if self.e is not None:
            divergence = divergence + 0.5 * cp.sum_squares(self.e - self.extras.nominal / self.extras.scale)
        kept = [X.value for X in self.X], None if self.e is None else self.e.value
        within = cp.norm(self.error) <= float(np.sqrt(allowed))
        if not self._run(cp.Minimize(divergence), [*self.constraints, within]):
            for X, value in zip(self.X, kept[0], strict=True):
                X.value = value
            if self.e is not None:
                self.e.value = kept[1]

    @property
    def misfit(self) -> float:
        return float(np.sum(np.asarray(self.error.value) ** 2))

    @property
    def links_value(self) -> Array:
        return np.array([(X.value + X.value.T) / 2 for X in self.X])

    @property
    def values(self) -> Array:
        # known parameters are exact, not to the solver's tolerance
        links = np.where(np.isnan(self.links.known), self._link_parameters(), self.links.known).ravel()
        if self.e is None:
            return np.asarray(links)
        e = self.e.value * (np.abs(self.e.value) > 1e-7)
        return np.concatenate([links, np.where(self.extras.signs * e < 0, 0.0, e) * self.extras.scale])

    def blame(self, misfit: float) -> tuple[tuple[str, float], ...]:
        """For each link, the fall of the misfit if this link need not be physical; worst first."""
        import cvxpy as cp

        saved = []
        for name, cone in zip(self.links.names, self.cones, strict=True):
            if self._run(cp.Minimize(cp.norm(self.error)), [c for c in self.constraints if c is not cone]):
                saved.append((name, misfit - self.misfit))
        self.solve_fit()
        return tuple(sorted(((n, x) for n, x in saved if x > 0.01 * misfit), key=lambda pair: -pair[1]))

    def active(self) -> tuple[Active, ...]:
        """Constraints that the result reaches."""
        found = []
        for name, X, C, x, box in zip(
            self.links.names, self.links_value, self.roots, self._link_parameters(), self.links.boxes, strict=True
        ):
            values, vectors = np.linalg.eigh(X)
            if values[0] < AT_BOUNDARY * LEAST_LINK_SHARE:
                found.append(Active(name, _flat(np.linalg.solve(C.T, vectors[:, 0]), x[0] / C[3, 3] ** 2)))
            if box is not None and ((box[0] @ x[1:4] - box[1] * x[0]) > -1e-4 * x[0]).any():
                found.append(Active(name, "its centre of mass lies on a face of its box"))
        limited = () if self.e is None else np.flatnonzero((self.extras.signs != 0) & (np.abs(self.e.value) < 1e-4))
        return (*found, *(Active(self.extras.names[k], "held at zero by the known sign") for k in limited))

    def _link_parameters(self) -> Array:
        return np.array([M @ X.ravel() for M, X in zip(self.unscale, self.links_value, strict=True)])


def _whitened(A: Array, theta: Array, information: Array) -> tuple[Array, Array]:
    """Rows of ``A z − θ`` in standard errors, none sharper than `SHARPEST`."""
    root = np.linalg.cholesky(information + 1e-12 * np.diag(np.diag(information))).T
    U, s, Vt = np.linalg.svd(root @ A, full_matrices=False)
    limited = np.minimum(s, SHARPEST) / np.where(s > 0, s, 1.0)
    return limited[:, None] * (s[:, None] * Vt), limited * (U.T @ (root @ theta))


def _flat(direction: Array, share: float) -> str:
    """Meaning of an empty direction v of the pseudo-inertia: all mass lies in the plane v·(r, 1) = 0."""
    if share < 2 * AT_BOUNDARY * LEAST_LINK_SHARE:
        return "its mass tends to zero"
    axis = direction[:3] / max(float(np.linalg.norm(direction[:3])), 1e-300)
    axis = axis * np.sign(axis[np.argmax(np.abs(axis))])
    return f"its mass tends to lie in one plane, across ({', '.join(f'{x:.2f}' for x in axis)})"


def _reason(problem: _Problem, links: Links) -> str:
    """Name the link that cannot exist, and the constraint that forbids it: constraints are each link's own."""
    import cvxpy as cp

    for name, cone, own in zip(links.names, problem.cones, problem.own, strict=True):
        if not own or problem._run(cp.Minimize(0), [cone, *own.values()]):
            continue
        alone = [what for what, c in own.items() if not problem._run(cp.Minimize(0), [cone, c])]
        return f"{name}: no rigid body has its {' and its '.join(alone or own)}; correct it or take it back"
    return "the solver found no physical links, although each link alone can exist; look at the model's standard errors"
