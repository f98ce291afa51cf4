"""The URDF as a prior: each parameter's value in the URDF, how far the value usually is off, and whether that helps.

    θ ~ N(θ_URDF, S²),   S = diag(S_links / √strength, S_effects);   base parameters θ_b = K θ ~ N(K θ_URDF, K S² Kᵀ)

S_links says how far a URDF is usually off: half a link's mass plus a tenth of the heaviest, 15 cm in a centre of mass,
5 cm squared in an inertia. S_effects says that an effect makes no more torque than its joint measured. The strength of
*this* URDF is chosen by cross-validation, and so is whether the prior is used at all. Long logs do without: with ten
independent torque rows per parameter they determine the parameters, and the output only says how a prior would do.

Source: Gautier, Janot and Vandanjon 2013, IEEE T-CST 21(2), on least squares for robots; the prior as further rows of
data, Theil and Goldberger 1961, International Economic Review 2(1).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from frischid.core.types import Array
from frischid.errors import IdentifiabilityError
from frischid.estimators.least_squares import Prior, cross_validated, wls
from frischid.regression.base_parameters import Reduction
from frischid.regression.moments import Gram, total
from frischid.regression.regressor import Regressor, nominal_parameters

PLAIN = 0.0
"""Strength that stands for no prior at all."""


@dataclass(frozen=True)
class PriorCriteria:
    """Every number that decides what the URDF prior says and whether it is used.

    Attributes
    ----------
    strengths : tuple of float
        Candidate strengths, without unit; strength 1 takes the URDF to be as far off as URDFs usually are. A decade
        apart, for cross-validation chooses among them and the error changes slowly with the strength.
    mass_share : float
        Standard deviation of a link's mass, as a share of that mass. A rule of thumb; how good this URDF is, the
        strength says. With it five seconds of a UR10e are predicted with NRMSE 0.08, not 0.36 (README).
    heaviest_share : float
        A further share, of the heaviest link's mass, so that a link which the URDF gives no mass may still have some.
    centre_of_mass : float
        m. Standard deviation of a link's centre of mass in each direction.
    squared_gyration : float
        m². Standard deviation of an inertia per mass: a radius of gyration of about 22 cm.
    enough_rows : float
        Independent torque rows per parameter from which logs do without a prior, unless the user asks for it.
    worthwhile : float
        The prior is used if it brings the cross-validated error below this share of plain least squares': an
        assumption about the robot must pay for itself.
    remarkable : float
        A prior that is not used is mentioned if the error with it is below this share of the error without.
        Stricter than `worthwhile`, so that the note is rare.
    """

    strengths: tuple[float, ...] = (0.01, 0.1, 1.0, 10.0, 100.0, 1000.0, 10000.0)
    mass_share: float = 0.5
    heaviest_share: float = 0.1
    centre_of_mass: float = 0.15
    squared_gyration: float = 0.05
    enough_rows: float = 10.0
    worthwhile: float = 0.95
    remarkable: float = 0.9

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON values."""
        return asdict(self) | {"strengths": list(self.strengths)}


@dataclass(frozen=True, eq=False)
class UrdfPrior:
    """What the URDF says of every parameter of a regressor, each independent of the others.

    Attributes
    ----------
    names : tuple of str
        The C parameters, rigid ones and those of the effects.
    mean : ndarray, shape (C,)
        The URDF's values, each in its parameter's unit.
    spread : ndarray, shape (C,)
        Standard deviations at this strength.
    strength : float
        How much better than usual the URDF's links are taken to be: variances are divided by it.
    """

    names: tuple[str, ...]
    mean: Array
    spread: Array
    strength: float

    def of_base(self, mapping: Array) -> Prior:
        """The same of base parameters.

        Parameters
        ----------
        mapping : ndarray, shape (p, C)
            Regrouping K of the parameters, ``θ_b = K θ`` (`Reduction.mapping`).

        Returns
        -------
        Prior
            Of p parameters.
        """
        return gaussian(mapping @ self.mean, mapping * self.spread)

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON values."""
        values = {n: [float(m), float(s)] for n, m, s in zip(self.names, self.mean, self.spread, strict=True)}
        return {"kind": "urdf", "strength": self.strength, "parameters": values}


@dataclass(frozen=True, eq=False)
class PriorChoice:
    """Whether the prior is used, how strongly, and why.

    Attributes
    ----------
    prior : UrdfPrior or None
        None: the logs alone.
    errors : dict of float to float
        Cross-validated NRMSE by strength. Strength 0 is plain least squares. An error is infinite where the fit has no
        solution.
    criteria : PriorCriteria
        The numbers that decided.
    """

    prior: UrdfPrior | None
    errors: dict[float, float]
    criteria: PriorCriteria

    @property
    def strength(self) -> float | None:
        """Strength of the prior in use."""
        return None if self.prior is None else self.prior.strength

    @property
    def sentence(self) -> str:
        """The choice and its reason, in words; empty when there is nothing to say."""
        plain = self.errors[PLAIN]
        if self.prior is not None:
            without = "they do not determine all parameters" if np.isinf(plain) else f"{plain:.4f} by the logs alone"
            return (
                f"the URDF is used as a prior (MAP, strength {self.prior.strength:g}): cross-validated NRMSE "
                f"{self.errors[self.prior.strength]:.4f} with it, {without}"
            )
        best = min(error for strength, error in self.errors.items() if strength != PLAIN)
        if best < self.criteria.remarkable * plain:
            return f"with the URDF as a prior (--prior urdf) the cross-validated NRMSE is {best:.4f}, not {plain:.4f}"
        return ""


def urdf_priors(
    regressor: Regressor, reduction: Reduction, whole: Gram, criteria: PriorCriteria | None = None
) -> dict[float, UrdfPrior]:
    """The URDF as a prior at every candidate strength; of effects it says little at any of them.

    Parameters
    ----------
    regressor : Regressor
    reduction : Reduction
        Base parameters of `regressor`.
    whole : Gram
        Moments of the base columns, for the size of effects.
    criteria : PriorCriteria, optional

    Returns
    -------
    dict of float to UrdfPrior
        By strength.
    """
    criteria = criteria or PriorCriteria()
    names = tuple(c.name for c in regressor.columns)
    links = np.array([c.effect == "rigid" for c in regressor.columns])
    spread = np.where(links, link_spread(regressor, criteria), _effect_spread(reduction, whole))
    mean = nominal_parameters(regressor.robot, regressor.effects)
    return {s: UrdfPrior(names, mean, np.where(links, spread / np.sqrt(s), spread), s) for s in criteria.strengths}


def gaussian(mean: Array, scaled: Array) -> Prior:
    """The prior N(mean, scaled scaledᵀ), kept invertible in directions without a spread of their own.

    Parameters
    ----------
    mean : ndarray, shape (p,)
    scaled : ndarray, shape (p, C)
        A root of the covariance.
    """
    covariance = scaled @ scaled.T
    scale = np.sqrt(np.diag(covariance))
    correlation = covariance / np.outer(scale, scale) + 1e-9 * np.eye(len(scale))
    return Prior(mean, np.linalg.inv(correlation) / np.outer(scale, scale))


def _effect_spread(reduction: Reduction, whole: Gram) -> Array:
    """Values of each parameter, (C,), at which it alone would make the torque that was measured."""
    K = reduction.mapping  # a column is the base columns times its column of K, and so is its power
    power = np.maximum(np.einsum("pc,jpq,qc->jc", K, whole.moments[:, :-1, :-1], K, optimize=True), 0.0)
    measured = whole.moments[:, -1, -1]
    spread = np.ones(power.shape[1])
    for k in range(len(spread)):
        felt = power[:, k] > 1e-12 * power[:, k].max()
        if felt.any():
            spread[k] = np.sqrt((measured[felt] / power[felt, k]).min())
    return spread


def link_spread(regressor: Regressor, criteria: PriorCriteria | None = None) -> Array:
    """How far a URDF's rigid parameters usually are from the truth.

    Parameters
    ----------
    regressor : Regressor
    criteria : PriorCriteria, optional

    Returns
    -------
    ndarray, shape (C,)
        One standard deviation in each parameter's unit; NaN for columns that are not rigid.
    """
    criteria = criteria or PriorCriteria()
    centre = criteria.centre_of_mass
    lever = {"m": 1.0, "mx": centre, "my": centre, "mz": centre}
    robot = regressor.robot
    nominal = dict(zip(robot.all_names, robot.nominal, strict=True))
    heaviest = max(nominal[f"m{i}"] for i in robot.numbers.values()) or 1.0
    spread = np.full(len(regressor.columns), np.nan)
    for k, column in enumerate(regressor.columns):
        if column.effect == "rigid":
            kind, body = column.name.rstrip("0123456789"), column.name.lstrip("mxyzI")
            mass = criteria.mass_share * nominal[f"m{body}"] + criteria.heaviest_share * heaviest
            spread[k] = mass * lever.get(kind, criteria.squared_gyration)
    return spread


def choose_prior(
    blocks: Sequence[Gram],
    priors: Mapping[float, UrdfPrior],
    mapping: Array,
    *,
    always: bool,
    independent: float,
    criteria: PriorCriteria | None = None,
) -> PriorChoice:
    """Choose the strength that predicts best the stretches left out of the fit, or no prior.

    Parameters
    ----------
    blocks : sequence of Gram
        Moments of consecutive stretches of time, base columns only.
    priors : mapping of float to UrdfPrior
        By strength.
    mapping : ndarray, shape (p, C)
        Regrouping of the parameters into base parameters.
    always : bool
        Use the prior even where the logs alone do as well.
    independent : float
        Torque rows the logs are worth, all joints together: two per second and hertz of bandwidth.
    criteria : PriorCriteria, optional

    Raises
    ------
    IdentifiabilityError
        The logs determine the parameters neither alone nor with the prior; or they do not alone, and are too long for
        the prior to be used unasked.
    """
    criteria = criteria or PriorCriteria()
    whole = total(blocks)
    errors: dict[float, float] = {}
    failed: IdentifiabilityError | None = None
    short = _is_short(whole, independent, criteria)
    for strength in (PLAIN, *priors):
        if failed is not None and not (short or always):
            break
        prior = priors[strength].of_base(mapping) if strength in priors else None
        try:
            fit = wls(blocks, prior=prior)
            errors[strength] = _mean_nrmse(whole, cross_validated(blocks, fit, prior=prior))
        except IdentifiabilityError as error:
            failed = failed or error
            errors[strength] = float("inf")
    best = min(errors, key=lambda s: np.inf if s == PLAIN else errors[s])
    helps = always or (short and errors[best] < criteria.worthwhile * errors[PLAIN])
    if best != PLAIN and np.isfinite(errors[best]) and helps:
        return PriorChoice(priors[best], errors, criteria)
    if np.isinf(errors[PLAIN]):
        raise IdentifiabilityError(f"{failed}; or give what is lacking to the URDF (--prior urdf)") from failed
    return PriorChoice(None, errors, criteria)


def _is_short(whole: Gram, independent: float, criteria: PriorCriteria) -> bool:
    """Whether logs are too short for their parameters, yet more than a guess: rows enough, every parameter felt."""
    felt = (np.diagonal(whole.moments, axis1=1, axis2=2)[:, :-1] > 0).any(axis=0).all()
    p = len(whole.columns)
    return bool(felt and whole.rows > p and independent < criteria.enough_rows * p)


def _mean_nrmse(whole: Gram, variance: Array) -> float:
    return float(np.mean(np.sqrt(variance * whole.counts / whole.torque_ss())))
