"""The noise floor of held-out errors: sensor noise, the uncertainty of the prediction, and what the data refute.

A fit to some folds predicts another one with parameters that are uncertain. So even without any missing effect, the
held-out error of joint j is above the sensor noise n_j by the variance of the prediction (leverage),

    floor_j² = n_j² + (n_j / σ_j)² Σ_f tr(H_f⁻¹ G_fj) / N_j,

with H_f the information of the parameters without fold f, G_fj the moments of joint j in fold f, N_j the rows of the
joint, and σ_j the residual that H_f counts with: the part of the variance that sensor noise alone would cause.

Noise in the columns biases a fit, so the error *without* an effect has a higher floor, that of the healthy twin
(`healthy_twin`). An effect may absorb some of that bias, so the error *with* an effect is held against floor_j. The
rules use floor_j; the probabilities use both.

Noise of the drives that is as slow as the motion is part of n_j, as far as it shows above the band (`slow_noise`). Few
rows of slow noise are independent, so it makes parameters, and therefore predictions, more uncertain than white noise.

A floor is computed from assumptions on the noise. A held-out error below the floor proves that the floor is wrong
there: then that error is the floor.

Source: Hastie, Tibshirani and Friedman 2009, The Elements of Statistical Learning, section 7.3.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import linalg

from frischid.core.types import Array
from frischid.diagnosis.cross_validation import CrossValidator
from frischid.diagnosis.healthy_twin import HealthyTwin
from frischid.diagnosis.repeats import measured_noise
from frischid.diagnosis.slow_noise import slow_noise
from frischid.model.noise_floor import NoiseFloor, Octaves


def with_leverage(validator: CrossValidator, floor: Array) -> Array:
    """The floor with the variance of the prediction.

    Parameters
    ----------
    validator : CrossValidator
    floor : ndarray, shape (J,)
        Sensor noise of each joint, N·m (N).
    """
    gram = validator.columns.gram[:, :, :-1, :-1]  # (folds, J, p, p)
    variance = np.zeros(len(floor))
    for fold, moments in enumerate(gram):
        factor = validator.fit.systems[fold].factor
        variance += [float(np.trace(linalg.cho_solve(factor, G))) for G in moments]
    share = np.minimum(floor / np.maximum(validator.fit.sigma, 1e-300), 1.0) ** 2
    return np.asarray(np.sqrt(floor**2 + share * variance / validator.counts.sum(axis=0)))


@dataclass(frozen=True, eq=False)
class Floor:
    """The noise floor of held-out errors, before and after the effects are known.

    Attributes
    ----------
    noise : ndarray, shape (J,)
        Noise of the sensors, that of the drives without its slow part, N·m (N).
    known : ndarray, shape (J,)
        From this noise and the uncertainty of the prediction, N·m (N).
    fit : CrossValidator
        The fit whose floor this is.
    octaves : sequence of Octaves
        Noise of the torques above the filter's band; none where repeated motions measure the noise.
    said : str
        A sentence on repeated motions, empty without any.
    """

    noise: Array
    known: Array
    fit: CrossValidator
    octaves: Sequence[Octaves] = ()
    said: str = ""

    @classmethod
    def of(cls, validator: CrossValidator) -> Floor:
        """The floor of a model's error on some logs; measured where a motion comes again (`repeats`)."""
        measured = measured_noise(validator)
        if measured is not None:
            known = with_leverage(validator, measured.noise)
            return cls(measured.noise, known, validator, said=measured.said)
        noise = NoiseFloor(validator.model)
        for _ in noise.watch(validator.data.cache.prepared):
            pass
        error = validator.base_nrmse() * validator.spread
        under = noise.under(error)
        known = np.minimum(with_leverage(validator, under), np.maximum(under, error))
        return cls(under, known, validator, tuple(noise.octaves))

    @cached_property
    def twin(self) -> HealthyTwin:
        """The healthy twin; its held-out error is the floor of the error without an effect."""
        return HealthyTwin(self.fit)

    def without_effects(self, noise: Array) -> Array:
        """The floor of the error without an effect, (J,), from that of `under`: the larger of that and the twin's."""
        return np.maximum(noise, self.twin.error)

    def under(self, full: CrossValidator) -> Array:
        """The floor where the model with all effects that entered is known, N·m (N), (J,).

        Slow noise of the drives raises the floor; an error below the floor lowers it.
        """
        noise = np.maximum(self.noise, slow_noise(self.octaves, full))
        return refuted(np.maximum(self.known, with_leverage(full, noise)), full)


def refuted(floor: Array, full: CrossValidator) -> Array:
    """The floor, lowered where the model with all effects that entered has a smaller held-out error."""
    return np.asarray(np.minimum(floor, full.base_nrmse() * full.spread))
