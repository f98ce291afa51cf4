"""Unknown scale of each joint's torque, where the URDF's links are the only scale there is.

A drive with an unknown gain kp gives a signal u in place of a torque, such as the position error of its controller.
With μ the URDF's links, δ their error, and E_j ψ_j the joint's friction, rotor and offset in units of the signal,

    u_j = κ_j Y_j (μ + δ) + E_j ψ_j + noise,     κ_j = 1 / kp_j,     δ_c ~ N(0, s_l² d_c²).

The signals determine links only up to a factor in each joint. The URDF fixes this factor, as well as it knows the
links. ψ has no prior, because its unit is that of the signal. In the product κ_j δ the last iteration's gain κ'_j
stands for κ_j, so that the model is linear in (κ, δ, ψ),

    minimise Σ_j w_j ‖u_j − κ_j Y_j μ − κ'_j Y_j δ − E_j ψ_j‖²  +  Σ_c (δ_c / (s_l d_c))²,    w_j = κ_rows / (n_j σ_j²),

with the data counted, and the scales s_l of the links found, as in `frischid.estimators.map_estimate`. The covariance
of κ then holds the doubt about the links.

*Known torques.* A controller may add torques r_j of known size in N·m: feed-forward, and damping about a commanded
velocity. The position error then makes τ_j − r_j, so that u_j = κ_j (Y_j μ − r_j) + …, and r_j is a scale as well,
often a better one than the masses. The column Y_j μ − r_j is that of the effect `position_gain`.

The full likelihood, in which κ also scales the variance of κ δ, was tried and is biased: links that are better than
their prior look like smaller links under a smaller κ (kp 15 to 100 % too large on simulated arms). The estimate here
uses the mean of the signal only, and is right whatever s is (quasi-likelihood: Wedderburn 1974, Biometrika 61(3)).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from frischid.core.types import Array
from frischid.estimators.map_estimate import EXACT_FIT, effective_rows, link_scales
from frischid.estimators.map_problem import MapProblem, bounded_minimum
from frischid.estimators.parameter_prior import ParameterPrior, ScaleRule
from frischid.regression.moments import Gram

_MOST_ITERATIONS = 40  # they settle in about ten
_LEAST = 0.05  # share of the signal that the links cause at the least; they cannot cause more than all of it
_HELD = 1e-4  # relative doubt about a κ that is known
_SETTLED_INVERSE = 1e-3  # relative change of κ
_FLAT = 1e2  # times the value at which an effect alone would cause the signal: no prior


@dataclass(frozen=True, eq=False)
class TorqueScales:
    """Gains of J joints, from their signals and the prior of the links."""

    inverse: Array
    """κ = 1/kp, (J,): signal per unit of torque. A negative value contradicts the sign of the signal."""
    stderr: Array
    """Of κ, (J,)."""
    most: Array
    """κ with which the URDF's links alone would cause a signal as large as the whole one, (J,). A larger κ is no gain:
    the links' columns then stand for an error of the model."""
    variance: Array
    """Residual variance of each signal, (J,)."""
    share: Array
    """The same over the variance of the signal, (J,)."""
    rows: float
    """Rows that each signal counts for."""
    others: Array
    """δ and ψ, (C,): errors of the links in their units, and effects in units of the signal."""


def torque_scales(
    whole: Gram,
    mapping: Array,
    prior: ParameterPrior,
    known: NDArray[np.bool_],
    rule: ScaleRule | None = None,
    means: Mapping[int, int] | None = None,
) -> TorqueScales:
    """Find the gains.

    Parameters
    ----------
    whole : Gram
        Moments of the base columns and the signal u, for the J joints.
    mapping : ndarray, shape (p, C)
        Regrouping of all parameters into base parameters.
    prior : ParameterPrior
        Of the C parameters, in units of the signal; only that of the links is used.
    known : ndarray of bool, shape (J,)
        Joints whose signal is their torque: κ is 1.
    rule : ScaleRule, optional
        Of the links' scales.
    means : mapping of int to int, optional
        Joint -> parameter whose column is the torque of the URDF's links less the known torques, in N·m; by default
        there are no known torques.

    Raises
    ------
    IdentifiabilityError
        The signals and the prior together leave a parameter undetermined.
    """
    rule, links = rule or ScaleRule(), prior.of_links
    prior = replace(prior, group=tuple(g if link else "" for g, link in zip(prior.group, links, strict=True)))
    means = means or {}
    only_means = np.isin(np.arange(len(links)), list(means.values()))  # these columns have no other coefficient than κ
    spread = np.where(links, prior.spread, np.where(only_means, _HELD, _FLAT) * prior.spread)
    flat = replace(prior, spread=spread, negative=np.zeros(len(links)))
    problem = MapProblem(whole, mapping, flat)
    size, J, m = np.outer(prior.spread, prior.spread), len(whole.joints), len(links)
    rows = effective_rows(problem.G * size)
    floor = EXACT_FIT * problem.torque / problem.counts + 1e-300
    variance = np.maximum(0.1 * problem.torque / problem.counts, floor)
    nominal = np.tile(np.where(links, prior.mean, 0.0), (J, 1))
    for joint, column in means.items():
        nominal[joint] = np.eye(m)[column]
    bounded = np.append(problem.bounded & ~links, np.zeros(J, bool))
    most = np.sqrt(problem.torque / np.maximum(np.einsum("ja,jab,jb->j", nominal, problem.G, nominal), 1e-300))
    inverse, scales = np.where(known, 1.0, np.sqrt(_LEAST) * most), {g: 1.0 for g in prior.group if g}
    for _ in range(_MOST_ITERATIONS):
        before, weights = inverse, rows / (problem.counts * variance)
        G, b = _columns(problem, nominal, np.where(links, inverse[:, None], 1.0))
        precision = np.append(problem.precision(scales), np.zeros(J))
        H = np.einsum("j,jab->ab", weights, G) + np.diag(precision)
        held = np.append(np.zeros(m), known / _HELD**2) * np.diag(H)
        H += np.diag(held)
        x = bounded_minimum(H, weights @ b + held, bounded)
        free = np.flatnonzero(~bounded | (x > 0))
        C = np.zeros_like(H)
        unit = 1.0 / np.sqrt(np.diag(H)[free])
        C[np.ix_(free, free)] = np.linalg.inv(H[np.ix_(free, free)] * np.outer(unit, unit)) * np.outer(unit, unit)
        used = weights * np.einsum("jab,ba->j", G, C)
        squares = np.maximum(problem.torque - 2 * b @ x + x @ (G @ x).T, 0.0)
        variance = np.maximum(squares / problem.counts * rows / np.maximum(rows - used, 0.05 * rows), floor)
        scales = link_scales(prior, x[:m], np.diag(C)[:m], rule)
        stderr = np.sqrt(np.diag(C)[m:])
        inverse = np.where(known, 1.0, np.clip(np.abs(x[m:]), _LEAST * most, most))
        if np.allclose(inverse, before, rtol=_SETTLED_INVERSE):
            break
    power = np.maximum(whole.torque_ss() / problem.counts, 1e-300)
    return TorqueScales(x[m:], stderr, most, variance, variance / power, rows, x[:m])


def _columns(problem: MapProblem, nominal: Array, scale: Array) -> tuple[Array, Array]:
    """Moments of [δ, ψ, κ] (J, m + J, m + J) and with the signal (J, m + J); `scale` (J, m) is that of each column."""
    J, m = scale.shape
    G, b = np.zeros((J, m + J, m + J)), np.zeros((J, m + J))
    for j, (own, signal, mean) in enumerate(zip(problem.G, problem.b, nominal, strict=True)):
        G[j, :m, :m] = own * np.outer(scale[j], scale[j])
        G[j, m + j, :m] = G[j, :m, m + j] = scale[j] * (own @ mean)
        G[j, m + j, m + j] = mean @ own @ mean
        b[j, :m], b[j, m + j] = scale[j] * signal, signal @ mean
    return G, b
