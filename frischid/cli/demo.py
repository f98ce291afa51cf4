"""The whole procedure on a robot whose true parameters are known.

First part: simulate, identify, compare with another motion. Second part: the same arm with a hidden effect. The model
fails, the diagnosis names the effect, the effect is added, and the error falls.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from frischid.core.types import Array
from frischid.diagnosis.addition import add
from frischid.diagnosis.diagnosis import diagnose
from frischid.diagnosis.result import Diagnosis
from frischid.diagnosis.step import Step
from frischid.effects import BASELINE, parse_effects
from frischid.logs.log import Log
from frischid.model.identification import Identification, identify
from frischid.model.model import Model
from frischid.motions.simulation import Noise, parameters_of, simulate
from frischid.motions.trajectory import random_fourier
from frischid.robot.robot import Robot

TRUTH = {"Ia1": 0.121, "Ia2": 0.2118, "off1": 0.4, "off2": -0.2}
"""Parameters that the planar arm's URDF lacks: reflected rotor inertias (kg·m²) and torque offsets (N·m)."""
NOISE = Noise(q=2e-5, tau=0.01)
HIDDEN, STRENGTH = "joint_spring@joint2", {"ks2": 1.5}
"""Strength of the effect hidden in the second part, a spring on joint 2, N·m/rad."""


@dataclass(frozen=True, eq=False)
class Demo:
    """A finished demonstration."""

    found: Identification
    truth: Array
    """True base parameters, (p,)."""
    seconds: float
    """Length of each of the two simulated logs."""
    rate: float
    """Samples per second, Hz."""
    diagnosis: Diagnosis
    """Diagnosis of the arm with the hidden effect."""
    step: Step
    """The step that added the effect found."""
    model: Model
    """Model of the arm with the hidden effect, before that step."""
    logs: tuple[Log, ...]
    """Two motions of that arm; the model was not fitted to the second."""


def run(seed: int, progress: Callable[[str], None] = lambda _: None) -> Demo:
    """Simulate two motions of the planar arm, identify on one, compare on the other.

    Parameters
    ----------
    seed : int
        Seed of the motions and the noise.
    progress : callable
        Called with the name of each step of the work.
    """
    robot = Robot.load("planar2")
    seconds, rate = 40.0, 200.0

    def record(hidden: str, extra: dict[str, float]) -> list[Log]:
        return [
            simulate(
                robot,
                random_fourier(robot, seconds, seed=2 * seed + k, harmonics=16, scale=0.9),
                rate=rate,
                effects=(*BASELINE, *parse_effects(hidden)),
                parameters=TRUTH | extra,
                noise=NOISE,
                channels=(),
                seed=2 * seed + k,
                name=name,
            )
            for k, name in enumerate(("motion A", "motion B (held out)"))
        ]

    progress("simulating two motions of the planar arm")
    log, held_out = record("", {})
    found = identify(robot, [log], valid=[held_out], progress=progress)
    theta = parameters_of(robot, BASELINE, TRUTH)
    progress("hiding an effect in the arm")
    log, held_out = record(HIDDEN, STRENGTH)
    model = identify(robot, [log], recursion="none", progress=progress).model
    diagnosis = diagnose(model, [log], valid=[held_out], progress=progress)
    best = diagnosis.findings[0]
    step = add(model, best.members, [log], valid=[held_out], finding=best)
    truth = np.asarray(found.reduction.mapping @ theta)
    return Demo(found, truth, seconds, rate, diagnosis, step, model, (log, held_out))
