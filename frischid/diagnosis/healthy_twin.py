"""The healthy twin: the held-out error that a perfect model of the robot would have on the logs.

The twin is a robot exactly like the model. It moves along the logs' path, and sensors as noisy as the logs' record it
(`frischid.model.noisy_motion`). Nothing is missing from its model. But noise in q, q̇, q̈ is noise in the regressor's
columns, and a fit to noisy columns is biased: every fold has another bias, so parameters of the other folds leave an
error. An error of the logs that is no more than that of the twin is no evidence for a missing effect. Effects explain a
part of the twin's error too. A finding shows this gain beside the gain on the logs. Where the gain on the logs is no
larger, the finding is not called missing: that is a test by a bootstrap from the model of the null hypothesis.

Source: Efron and Tibshirani 1993, An Introduction to the Bootstrap, section 16.4 (a test by a bootstrap from the model
of the null hypothesis).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from frischid.core.types import Array
from frischid.diagnosis.cross_validation import CrossValidator
from frischid.diagnosis.scored_candidate import scored
from frischid.effects import Effect
from frischid.logs.preprocessing import Motion
from frischid.model.model import Model
from frischid.model.noise_floor import octaves_above, torque_noise
from frischid.model.noisy_motion import SensorNoise, sharpened, true_path
from frischid.regression.regressor import Regressor

DRAWS = 3  # of the noise: the bias of a fit to noisy columns varies from draw to draw


@dataclass(frozen=True, eq=False)
class HealthyTwin:
    """The healthy twin of a model on some logs.

    Attributes
    ----------
    fit : CrossValidator
        Fit of the model to the logs, without any candidate.
    """

    fit: CrossValidator

    @cached_property
    def draws(self) -> list[CrossValidator]:
        """The same fit to the records of the twin, for some draws of the noise."""
        model = self.fit.model
        regressor = Regressor(model.robot, model.effects, model.reference)
        twins: dict[Motion, _Twin] = {}  # by the object: two logs may have one name

        def seen(rng: np.random.Generator, motion: Motion) -> Motion:
            if motion not in twins:
                twins[motion] = _Twin.of(model, regressor, motion)
            return twins[motion].seen(rng)

        return [self.fit.with_motions(partial(seen, np.random.default_rng(seed))) for seed in range(DRAWS)]

    @cached_property
    def error(self) -> Array:
        """Held-out error of the twin's model, N·m (N), shape (J,): the rms of all draws."""
        return np.asarray(np.sqrt(np.mean([(v.predictive_nrmse() * v.spread) ** 2 for v in self.draws], axis=0)))

    def gain(self, places: Sequence[Effect]) -> float:
        """Gain that an effect seems to have on the twin, which lacks nothing, for the first draw of the noise.

        Parameters
        ----------
        places : sequence of Effect
            The effect at each of its places, in its shape.
        """
        twin = self.draws[0]
        parts = [c for c in twin.candidates(places) if c.columns and c.finite]
        if not parts:
            return 0.0
        found = scored(twin, [parts[0] if len(parts) == 1 else twin.joined(parts)])
        return 0.0 if found is None else max(found.gain, 0.0)


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
