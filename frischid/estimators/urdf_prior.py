"""What is known of the parameters before a log is seen: the URDF, and how far to believe it.

    θ_b = K θ ~ N(K θ_URDF, K (S_links² / strength + S_effects²) Kᵀ)

S says how far a URDF is usually off: half a link's mass and a tenth of the heaviest, 15 cm in its centre of mass, 5 cm
squared in its inertias; an effect makes no more torque than its joint measured. How far to believe *this* URDF, the
strength, is chosen by cross-validation, and so is whether to believe it at all. Long logs are left alone: with ten
independent torque rows a parameter the logs speak for themselves, and what a prior would do is only said.

Source: Gautier, Janot and Vandanjon 2013, IEEE T-CST 21(2), on least squares for robots; the prior as further rows of
data, Theil and Goldberger 1961, International Economic Review 2(1).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from frischid.core.types import Array
from frischid.errors import IdentifiabilityError
from frischid.estimators.least_squares import Estimate, Prior, cross_validated, wls
from frischid.regression.base_parameters import Reduction
from frischid.regression.moments import Gram, total
from frischid.regression.regressor import Regressor, nominal_parameters

STRENGTHS = (0.01, 0.1, 1.0, 10.0, 100.0, 1000.0, 10000.0)
MASS, HEAVIEST = 0.5, 0.1  # a link's mass may be off by this share of it, and this share of the heaviest link's
LENGTH, GYRATION = {"m": 1.0, "mx": 0.15, "my": 0.15, "mz": 0.15}, 0.05  # m and m²: what such a mass does elsewhere
ENOUGH = 10.0  # independent torque rows a parameter from which a prior must be asked for
WORTH = 0.95  # the prior is used if it brings the cross-validated error below this share of plain least squares'
REMARKABLE = 0.9  # share below which a prior that is not used is mentioned


@dataclass(frozen=True, eq=False)
class Choice:
    """Whether a prior is used, how strongly, and why.

    Attributes
    ----------
    estimate : Estimate
        With the prior or without.
    prior : Prior or None
        None: the logs alone.
    strength : float or None
    errors : dict of float to float
        Cross-validated NRMSE by strength; strength 0 is plain least squares, infinite where that has no solution.
    """

    estimate: Estimate
    prior: Prior | None
    strength: float | None
    errors: dict[float, float]

    @property
    def sentence(self) -> str:
        """What was chosen and why, in words; empty when there is nothing to say."""
        plain, best = self.errors[0.0], min(self.errors[s] for s in STRENGTHS)
        if self.prior is not None:
            without = "they do not determine all parameters" if np.isinf(plain) else f"{plain:.4f} by the logs alone"
            return (
                f"the URDF is used as a prior (MAP, strength {self.strength:g}): cross-validated NRMSE "
                f"{self.errors[self.strength or 0.0]:.4f} with it, {without}"
            )
        if best < REMARKABLE * plain:
            return f"with the URDF as a prior (--prior urdf) the cross-validated NRMSE is {best:.4f}, not {plain:.4f}"
        return ""


def urdf_priors(regressor: Regressor, reduction: Reduction, whole: Gram) -> dict[float, Prior]:
    """Belief in the URDF at every one of `STRENGTHS`; of effects it says little at any of them.

    Parameters
    ----------
    regressor : Regressor
    reduction : Reduction
        Base parameters of `regressor`.
    whole : Gram
        Moments of the base columns, for the size of effects.

    Returns
    -------
    dict of float to Prior
        Over the base parameters.
    """
    spread = _doubt(regressor, reduction, whole)
    links = np.array([c.effect == "rigid" for c in regressor.columns])
    mean = reduction.mapping @ nominal_parameters(regressor.robot, regressor.effects)
    by_strength = {s: np.where(links, spread / np.sqrt(s), spread) for s in STRENGTHS}
    return {s: gaussian(mean, reduction.mapping * doubt) for s, doubt in by_strength.items()}


def gaussian(mean: Array, scaled: Array) -> Prior:
    """The prior N(mean, scaled scaledᵀ), with what has no spread of its own kept invertible."""
    covariance = scaled @ scaled.T
    scale = np.sqrt(np.diag(covariance))
    correlation = covariance / np.outer(scale, scale) + 1e-9 * np.eye(len(scale))
    return Prior(mean, np.linalg.inv(correlation) / np.outer(scale, scale))


def _doubt(regressor: Regressor, reduction: Reduction, whole: Gram) -> Array:
    """How far each parameter may be from the URDF's, one standard deviation."""
    links = doubt_of_links(regressor)
    K = reduction.mapping  # a column is the base columns times its column of K, and so is its power
    power = np.maximum(np.einsum("pc,jpq,qc->jc", K, whole.moments[:, :-1, :-1], K, optimize=True), 0.0)
    measured = whole.moments[:, -1, -1]
    spread = np.empty(len(regressor.columns))
    for k, column in enumerate(regressor.columns):
        if column.effect == "rigid":
            spread[k] = links[k]
        else:
            felt = power[:, k] > 1e-12 * power[:, k].max()
            spread[k] = np.sqrt((measured[felt] / power[felt, k]).min()) if felt.any() else 1.0
    return spread


def doubt_of_links(regressor: Regressor) -> Array:
    """How far a URDF's rigid parameters usually are from the truth, one standard deviation; NaN for other columns."""
    robot = regressor.robot
    nominal = dict(zip(robot.all_names, robot.nominal, strict=True))
    largest = max(nominal[f"m{i}"] for i in robot.numbers.values()) or 1.0
    spread = np.full(len(regressor.columns), np.nan)
    for k, column in enumerate(regressor.columns):
        if column.effect == "rigid":
            kind, body = column.name.rstrip("0123456789"), column.name.lstrip("mxyzI")
            spread[k] = (MASS * nominal[f"m{body}"] + HEAVIEST * largest) * LENGTH.get(kind, GYRATION)
    return spread


def chosen(blocks: Sequence[Gram], priors: Mapping[float, Prior], *, always: bool, independent: float) -> Choice:
    """Fit with the prior at the strength that predicts best what was left out, or without it.

    Parameters
    ----------
    blocks : sequence of Gram
        Moments of consecutive stretches of time, base columns only.
    priors : mapping of float to Prior
        By strength.
    always : bool
        Use the prior even where the logs alone do as well.
    independent : float
        Torque rows the logs are worth, all joints together: two a second and hertz of bandwidth.

    Raises
    ------
    IdentifiabilityError
        The logs determine the parameters neither alone nor with the prior, or there are too many of them to be excused.
    """
    whole = total(blocks)
    errors: dict[float, float] = {}
    fits: dict[float, Estimate] = {}
    failed: IdentifiabilityError | None = None
    short = _is_short(whole, independent)
    for strength in (0.0, *priors):
        if failed is not None and not (short or always):
            break
        belief = priors.get(strength)
        try:
            fits[strength] = wls(blocks, prior=belief)
            errors[strength] = _error(whole, cross_validated(blocks, fits[strength], prior=belief))
        except IdentifiabilityError as error:
            failed = failed or error
            errors[strength] = float("inf")
    best = min(errors, key=lambda s: errors[s] if s else np.inf)
    if best and np.isfinite(errors[best]) and (always or (short and errors[best] < WORTH * errors[0.0])):
        return Choice(fits[best], priors[best], best, errors)
    if 0.0 not in fits and failed is not None:
        raise IdentifiabilityError(f"{failed}; or give what is lacking to the URDF (--prior urdf)") from failed
    return Choice(fits[0.0], None, None, errors)


def _is_short(whole: Gram, independent: float) -> bool:
    """Whether logs are too short for their parameters, yet more than a guess: rows enough, every parameter felt."""
    felt = (np.diagonal(whole.moments, axis1=1, axis2=2)[:, :-1] > 0).any(axis=0).all()
    return bool(felt and whole.rows > len(whole.columns) and independent < ENOUGH * len(whole.columns))


def _error(whole: Gram, variance: Array) -> float:
    return float(np.mean(np.sqrt(variance * whole.counts / whole.torque_ss())))
