"""The noise floor of a diagnosis: the error that sensors and drives cause, as far as the data do not refute it.

A held-out error counts without the part that uncertain parameters alone cause (Q of `weighted_fit`). So the floor of
joint j is the noise n_j alone, and needs no variance of the prediction.

Noise in the columns biases a fit, so the error *without* an effect has a higher floor, that of the healthy twin
(`healthy_twin`). An effect may absorb some of that bias, so the error *with* an effect is held against n_j. The rules
use n_j; the probabilities use both.

Noise of the drives that is as slow as the motion is part of n_j, as far as it shows above the band (`slow_noise`).

A floor is computed from assumptions on the noise. An error below the floor proves that the floor is wrong there. Where
the model has no effect, that error is the floor. An effect whose columns follow the noise of the positions takes a part
of the noise away, and on the twin too: there it leaves the share s_j of the error. So with the error e_j of the model
with all effects that entered, the floor is at most e_j / s_j.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from frischid.core.types import Array
from frischid.diagnosis.cross_validation import CrossValidator
from frischid.diagnosis.healthy_twin import HealthyTwin, error_of
from frischid.diagnosis.repeats import measured_noise
from frischid.diagnosis.slow_noise import slow_noise
from frischid.effects import Effect
from frischid.model.noise_floor import NoiseFloor, Octaves


@dataclass(frozen=True, eq=False)
class Floor:
    """The noise floor, before and after the effects are known."""

    noise: Array
    """Noise of the sensors, and of the drives without its slow part, N·m (N), (J,)."""
    fit: CrossValidator
    """The fit whose floor this is."""
    octaves: Sequence[Octaves] = ()
    """Noise of the torques above the filter's band; none where repeated motions measure the noise."""
    said: str = ""
    """A sentence on repeated motions, empty without any."""

    @classmethod
    def of(cls, validator: CrossValidator) -> Floor:
        """The floor of a model's error on some logs; measured where a motion comes again (`repeats`)."""
        measured = measured_noise(validator)
        if measured is not None:
            return cls(measured.noise, validator, said=measured.said)
        noise = NoiseFloor(validator.model)
        for _ in noise.watch(validator.data.cache.prepared):
            pass
        return cls(noise.under(error_of(validator)), validator, tuple(noise.octaves))

    @cached_property
    def twin(self) -> HealthyTwin:
        """The healthy twin; its held-out error is the floor of the error without an effect."""
        return HealthyTwin(self.fit)

    def without_effects(self, noise: Array) -> Array:
        """The floor of the error without an effect, (J,), from that of `under`: the larger of that and the twin's."""
        return np.maximum(noise, self.twin.error)

    def under(self, full: CrossValidator, entered: Sequence[Effect]) -> Array:
        """The floor where the model with all effects that entered is known, N·m (N), (J,).

        Slow noise of the drives raises the floor; an error below the floor lowers it.

        Parameters
        ----------
        full : CrossValidator
            Of the model with all effects that entered.
        entered : sequence of Effect
            These effects, in the order in which they entered.
        """
        floor, error = np.maximum(self.noise, slow_noise(self.octaves, full)), error_of(full)
        left = self.twin.share_left(entered) if (error < floor).any() else np.ones(len(error))
        return refuted(floor, error, left)


def refuted(floor: Array, error: Array, left: Array) -> Array:
    """The floor, (J,), lowered where an error is below the share of the floor that the effects of its model leave."""
    most = np.divide(error, left, out=np.full(len(floor), np.inf), where=left > 0)
    return np.asarray(np.minimum(floor, most))


def asks_for_explanation(residual: Array, noise: Array, validator: CrossValidator) -> NDArray[np.bool_]:
    """Joints whose error is clearly above the sensor noise, and by more than is negligible beside their torque."""
    criteria = validator.criteria
    return np.asarray((residual**2 - noise**2 > criteria.smallest_error**2) & (residual > criteria.clear_error * noise))
