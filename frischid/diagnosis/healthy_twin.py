"""The healthy twin: the held-out error that a perfect model of the robot would have on the logs.

The twin is a robot like the model. It moves along the logs' path, and sensors as noisy as the logs' record it
(`frischid.model.noisy_motion`). Nothing is missing from its model. But noise in q, q̇, q̈ is noise in the regressor's
columns, and a fit to noisy columns is biased: every fold has another bias, so parameters of the other folds leave an
error. An error of the logs that is no more than that of the twin is no evidence for a missing effect.

**Parameters of the twin.** The model is a biased fit itself: with much noise its inertias are too small, and so is the
error of its twin. So where the fit b(θ) to the records of the model's twin differs from θ by more than chance, the twin
gets the parameters whose fit is that of the logs θ̂ (indirect inference). A few steps from the model lead there,

    θ ← θ + θ̂ − b(θ).

**What noise explains.** Effects explain a part of the twin's error too: a column that is computed from noisy positions
follows their noise. This part varies from draw to draw of the noise. With the mean x̄ and the standard deviation s of
the parts of n draws, and Student's t of n − 1 degrees of freedom, the part of a further draw is below

    x̄ + t s √(1 + 1/n).

Where an effect explains no more of the error of the logs, it is not called missing: that is a test by a bootstrap from
the model of the null hypothesis.

Sources: Efron and Tibshirani 1993, An Introduction to the Bootstrap, section 16.4 (a test by a bootstrap from the model
of the null hypothesis); Gouriéroux, Monfort and Renault 1993, "Indirect inference", J. Applied Econometrics 8(S1);
Hahn and Meeker 1991, Statistical Intervals, section 4.8 (the limit for a further draw).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from scipy import special

from frischid.core.types import Array
from frischid.diagnosis.candidate_columns import Candidate
from frischid.diagnosis.cross_validation import CrossValidator
from frischid.diagnosis.scored_candidate import ScoredCandidate, scored, usable_candidates
from frischid.effects import Effect
from frischid.logs.cutoff_choice import clean_cutoff
from frischid.logs.filters import LowPass
from frischid.logs.preprocessing import Motion
from frischid.model.model import Model
from frischid.model.noise_floor import octaves_above, torque_noise
from frischid.model.noisy_motion import SensorNoise, sharpened, true_path
from frischid.regression.regressor import Regressor

DRAWS = 3  # of the noise: the bias of a fit to noisy columns varies from draw to draw
TWIN_STEPS = 4  # steps from the model to the twin, at most


@dataclass(frozen=True, eq=False)
class HealthyTwin:
    """The healthy twin of a model on some logs."""

    fit: CrossValidator
    """Fit of the model to the logs, without any candidate."""

    @cached_property
    def draws(self) -> list[CrossValidator]:
        """The same fit to the records of the twin, for some draws of the noise."""
        model, criteria = self.fit.model, self.fit.criteria
        theta, record = model.estimate.theta, self._records(model)
        first = record(0)
        bias = first.theta - theta
        biased = bias @ first.fit.information @ bias > special.chdtri(len(bias), criteria.significance)
        for _ in range(TWIN_STEPS if biased else 0):
            before, theta = error_of(first), theta + self.fit.theta - first.theta
            record = self._records(replace(model, estimate=replace(model.estimate, theta=theta)))
            first = record(0)
            if (error_of(first) <= criteria.floor_tolerance * before).all():
                break
        return [first, *map(record, range(1, DRAWS))]

    def _records(self, model: Model) -> Callable[[int], CrossValidator]:
        """The fit to the record of a robot with a model's parameters, for a seed of the noise."""
        regressor = Regressor(model.robot, model.effects, model.reference)
        lowpass, twins = self._lowpass, dict[Motion, _Twin]()  # by the object: two logs may have one name

        def seen(rng: np.random.Generator, motion: Motion) -> Motion:
            if motion not in twins:
                twins[motion] = _Twin.of(model, regressor, motion, lowpass)
            return twins[motion].seen(rng)

        return lambda seed: self.fit.with_motions(partial(seen, np.random.default_rng(seed)))

    @cached_property
    def _lowpass(self) -> LowPass:
        """The filter of the true path: what noise adds to the positions below a high cut-off is no motion."""
        lowpass = self.fit.model.lowpass
        if lowpass.cutoff is None:
            return lowpass
        moving = (motion for motion in self.fit.data.cache.prepared if not motion.at_poses)
        return replace(lowpass, cutoff=min(lowpass.cutoff, clean_cutoff(moving)))

    @cached_property
    def error(self) -> Array:
        """Held-out error of the twin's model, N·m (N), shape (J,): the rms of all draws."""
        return _rms(self.draws)

    def explained(self, places: Sequence[Effect]) -> float:
        """Error of the twin, which lacks nothing, that an effect may seem to explain: the limit for a further draw.

        Parameters
        ----------
        places : sequence of Effect
            The effect at each of its places. The twin's records choose its shapes, as the logs did.

        Returns
        -------
        float
            Fall of the summed squared NRMSE of the joints; zero where the effect does not pay its price.
        """
        first = self.draws[0]
        as_given = _together(first, [c for c in first.candidates(places) if c.columns and c.finite])
        if as_given is None or as_given.gain <= 0:
            return 0.0
        found = [_together(twin, _shaped(twin, places)) for twin in self.draws]
        parts = [0.0 if x is None else max(x.explained, 0.0) for x in found]
        reach = float(special.stdtrit(len(parts) - 1, 1.0 - self.fit.criteria.block_p_value))
        return float(np.mean(parts) + reach * np.std(parts, ddof=1) * np.sqrt(1.0 + 1.0 / len(parts)))

    def share_left(self, places: Sequence[Effect]) -> Array:
        """Error of the twin's model with some effects over its error without them, (J,), at most 1.

        Parameters
        ----------
        places : sequence of Effect
            Each effect at each of its places, in the order in which they enter; the twin's records choose their shapes.
        """
        after, before = _rms([_with(twin, places) for twin in self.draws]), self.error
        return np.divide(np.minimum(after, before), before, out=np.ones(len(before)), where=before > 0)


def _together(twin: CrossValidator, places: Sequence[Candidate]) -> ScoredCandidate | None:
    """An effect at all its places on one record of the twin; None where it has none."""
    return scored(twin, [places[0] if len(places) == 1 else twin.joined(places)]) if places else None


def _shaped(twin: CrossValidator, places: Sequence[Effect]) -> list[Candidate]:
    """Each effect in the shape that predicts one record of the twin best."""
    alternatives = [[place, *type(place).variants(place.joints)] for place in places]
    found = (scored(twin, shapes) for shapes in usable_candidates(twin, alternatives, changed=True) if shapes)
    return [x.candidate for x in found if x is not None]


def _with(twin: CrossValidator, places: Sequence[Effect]) -> CrossValidator:
    """A fit to one record of the twin with further effects."""
    for candidate in _shaped(twin, places):
        twin = twin.extended(candidate)
    return twin


def _rms(draws: Sequence[CrossValidator]) -> Array:
    """Root mean square of the held-out errors of some fits, N·m (N), (J,)."""
    return np.asarray(np.sqrt(np.mean([error_of(v) ** 2 for v in draws], axis=0)))


def error_of(validator: CrossValidator) -> Array:
    """Held-out error of each joint without the part that uncertain parameters alone cause, N·m (N), (J,)."""
    return np.asarray(validator.predictive_nrmse() * validator.spread)


@dataclass(frozen=True, eq=False)
class _Twin:
    """The twin on one motion: its path and torque, and the noise of the sensors that record it."""

    path: Motion
    """The path, with the torque of the twin."""
    noise: SensorNoise | None
    """Noise of the path; None where the motion is a set of poses, which are averages."""
    level: Array
    """Standard deviation of the torque's noise, N·m (N), as in the noise floor, (J,); zero where no torque is fitted.
    """

    @classmethod
    def of(cls, model: Model, regressor: Regressor, motion: Motion, lowpass: LowPass) -> _Twin:
        """The twin of a model on a motion, whose true path is that behind a filter."""
        if motion.at_poses:
            return cls(replace(motion, tau=regressor.torque(motion, model.full_theta)), None, np.zeros(0))
        path = true_path(motion, lowpass)
        torque = regressor.torque(path, model.full_theta) + sharpened(model, path)
        fitted, level = model.torque_index, np.zeros(torque.shape[1])
        measured = motion.tau[:, fitted]
        octaves = octaves_above(measured, motion.direction[:, fitted], motion.step, model.lowpass)
        level[fitted] = torque_noise(measured, octaves, model.lowpass)
        return cls(replace(path, tau=torque), SensorNoise.of(path, motion, model.lowpass), level)

    def seen(self, rng: np.random.Generator) -> Motion:
        """The record of the twin, with noise drawn at random."""
        if self.noise is None:
            return self.path
        noise = self.level * rng.normal(size=self.path.tau.shape)
        return replace(self.noise.drawn(rng), tau=self.path.tau + noise)
