"""The healthy twin: the held-out error that a perfect model of the robot would have on the logs.

The twin is a robot exactly like the model. It moves along the logs' path, and sensors as noisy as the logs' record it
(`frischid.model.noisy_motion`). Nothing is missing from its model. But noise in q, q̇, q̈ is noise in the regressor's
columns, and a fit to noisy columns is biased: every fold has another bias, so parameters of the other folds leave an
error. An error of the logs that is no more than that of the twin is no evidence for a missing effect.

Source: Efron and Tibshirani 1993, An Introduction to the Bootstrap, section 16.4 (a test by a bootstrap from the model
of the null hypothesis).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from frischid.core.types import Array
from frischid.diagnosis.cross_validation import CrossValidator
from frischid.logs.preprocessing import Motion
from frischid.model.model import Model
from frischid.model.noise_floor import octaves_above, torque_noise
from frischid.model.noisy_motion import SensorNoise, sharpened, true_path
from frischid.regression.regressor import Regressor

DRAWS = 3  # of the noise: the bias of a fit to noisy columns varies from draw to draw


def healthy_twin_error(validator: CrossValidator) -> Array:
    """Held-out error of the model of the healthy twin, N·m (N), shape (J,): the rms of all draws of the noise.

    Parameters
    ----------
    validator : CrossValidator
        Fit of the model to the logs, without any candidate.
    """
    model = validator.model
    regressor = Regressor(model.robot, model.effects, model.reference)
    twins: dict[Motion, _Twin] = {}  # by the object: two logs may have one name

    def seen(rng: np.random.Generator, motion: Motion) -> Motion:
        if motion not in twins:
            twins[motion] = _Twin.of(model, regressor, motion)
        return twins[motion].seen(rng)

    draws = (validator.with_motions(partial(seen, np.random.default_rng(seed))) for seed in range(DRAWS))
    return np.asarray(np.sqrt(np.mean([(twin.base_nrmse() * twin.spread) ** 2 for twin in draws], axis=0)))


@dataclass(frozen=True, eq=False)
class _Twin:
    """The twin on one motion: its path and torque, and the noise of the sensors that record it.

    Attributes
    ----------
    path : Motion
        The path, with the torque of the twin.
    noise : SensorNoise or None
        Noise of the path; None where the motion is a set of poses, which are averages.
    level : ndarray, shape (J,)
        Standard deviation of the torque's noise, N·m (N).
    """

    path: Motion
    noise: SensorNoise | None
    level: Array

    @classmethod
    def of(cls, model: Model, regressor: Regressor, motion: Motion) -> _Twin:
        """The twin of a model on a motion."""
        if motion.at_poses:
            return cls(replace(motion, tau=regressor.torque(motion, model.full_theta)), None, np.zeros(0))
        path = true_path(motion, model.lowpass)
        torque = regressor.torque(path, model.full_theta) + sharpened(model, path)
        octaves = octaves_above(motion.tau, motion.direction, motion.step, model.lowpass)
        noise = SensorNoise.of(path, motion, model.lowpass)
        return cls(replace(path, tau=torque), noise, torque_noise(motion.tau, octaves, model.lowpass))

    def seen(self, rng: np.random.Generator) -> Motion:
        """The record of the twin, with noise drawn at random."""
        if self.noise is None:
            return self.path
        noise = self.level * rng.normal(size=self.path.tau.shape)
        return replace(self.noise.drawn(rng), tau=self.path.tau + noise)
