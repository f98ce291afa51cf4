"""The parameters that the robots of a fleet share, with the URDF as prior.

    robots → five parts → maximum a posteriori θ, scales of the links, noise of the joints      (`map_estimate`)
    Var(θ) = posterior + (R − 1)/R Σ_r δ_r δ_rᵀ,    δ_r the change of θ when robot r is left out

Cross-validation leaves out a fifth of the robots at a time. The posterior has the prior's part and the model's own
error, and the jackknife over robots has their differences and the noise. Comparing robots is linear algebra on their
moments: there, the prior with the fleet's scales is Gaussian, N(Kμ, K diag(s²d²) Kᵀ) for the base parameters K θ, and
acts like one further log.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from frischid.core.types import Array
from frischid.estimators.least_squares import Estimate, Prior, wls
from frischid.estimators.map_estimate import MapEstimate, map_estimate
from frischid.estimators.urdf_prior import PriorCriteria, gaussian, urdf_prior
from frischid.fleet.deviation import Centre, Deviation, Null
from frischid.regression.base_parameters import Reduction
from frischid.regression.moment_blocks import total
from frischid.regression.moments import Gram
from frischid.regression.regressor import Regressor


@dataclass(frozen=True, eq=False)
class SharedFit:
    """A fit to all robots."""

    whole: Gram
    """Sum of the robots' moments."""
    estimate: Estimate
    posterior: MapEstimate | None
    """Of all parameters; None: the logs alone."""
    mapping: Array
    """Regrouping of all parameters into base parameters, (p, C)."""

    @cached_property
    def prior(self) -> Prior | None:
        """The URDF's prior of the base parameters, at the scales that the fleet gives its links."""
        if self.posterior is None:
            return None
        urdf = self.posterior.prior
        return gaussian(self.mapping @ urdf.mean, self.mapping * urdf.total_spread)

    @cached_property
    def centre(self) -> Centre:
        """The centre that robots are compared with: least squares with the `prior`, without the bounds of signs."""
        return Centre.of(self.whole, self.estimate.weights, self.prior)


def shared_fit(parts: Sequence[Gram], regressor: Regressor, reduction: Reduction, prior: str) -> SharedFit:
    """Fit the parameters that robots share.

    Parameters
    ----------
    parts : sequence of Gram
        Moments of groups of robots.
    prior : {"urdf", "none"}

    Raises
    ------
    IdentifiabilityError
        Without a prior: the logs do not determine the parameters.
    """
    whole, mapping = total(parts), reduction.mapping
    if prior == "none":
        return SharedFit(whole, wls([whole]), None, mapping)
    criteria = PriorCriteria()
    found = map_estimate(parts, mapping, urdf_prior(regressor, reduction, whole, criteria), criteria.scale_rule)
    return SharedFit(whole, found.base_estimate(whole, mapping), found, mapping)


def with_spread(fit: SharedFit, inside: Sequence[Deviation], null: Null) -> Estimate:
    """The estimate with the spread of its robots, `inside` those that do not differ."""
    estimate, R = fit.estimate, len(inside)
    enough = len(estimate.joints) < R
    pulls = np.array([d.pull for d in inside])
    jackknife = (R - 1) / R * pulls.T @ pulls
    if fit.posterior is not None:
        covariance = estimate.covariance + (jackknife if enough else 0.0)
    else:
        covariance = jackknife if enough else estimate.covariance
    plain = fit.whole.weighted(1.0 / estimate.sigma**2)[:-1, :-1]
    # Robots vary by (κ − κ_within) times the uncertainty of one robot's own data: the prior for any single robot.
    information = plain / (null.scale + R * max(0.0, null.scale - null.within))
    if fit.prior is not None:
        information = information + fit.prior.precision
    notes = () if enough else ("too few robots: standard errors take residuals as uncorrelated",)
    return replace(estimate, covariance=covariance, information=information, notes=notes)
