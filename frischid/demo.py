"""The whole job on a robot whose truth is known: simulate, identify, look at the error on another motion."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from frischid.effects import BASELINE
from frischid.gram import Array
from frischid.identification import Identification, identify
from frischid.robot import Robot
from frischid.simulation import Noise, parameters_of, simulate
from frischid.trajectory import random_fourier

TRUTH = {"Ia1": 0.121, "Ia2": 0.2118, "off1": 0.4, "off2": -0.2}
"""What the URDF does not say of the planar arm: reflected rotor inertias (kg·m²) and torque offsets (N·m)."""
NOISE = Noise(q=2e-5, tau=0.01)


@dataclass(frozen=True, eq=False)
class Demo:
    """A finished demonstration.

    Attributes
    ----------
    found : Identification
    truth : ndarray, shape (p,)
        True base parameters.
    seconds : float
        Length of each of the two simulated logs.
    rate : float
        Samples a second, Hz.
    """

    found: Identification
    truth: Array
    seconds: float
    rate: float


def run(seed: int, progress: Callable[[str], None] = lambda _: None) -> Demo:
    """Simulate two motions of the planar arm, identify on one, compare on the other.

    Parameters
    ----------
    seed : int
        Of the motions and the noise.
    progress : callable
        Told what is being done.
    """
    robot = Robot.load("planar2")
    seconds, rate = 40.0, 200.0
    progress("simulating two motions of the planar arm")
    log, held_out = (
        simulate(
            robot,
            random_fourier(robot, seconds, seed=2 * seed + k, harmonics=16, scale=0.9),
            rate=rate,
            parameters=TRUTH,
            noise=NOISE,
            channels=(),
            seed=2 * seed + k,
            name=name,
        )
        for k, name in enumerate(("motion A", "motion B (held out)"))
    )
    found = identify(robot, [log], valid=[held_out], progress=progress)
    theta = parameters_of(robot, BASELINE, TRUTH)
    return Demo(found, np.asarray(found.reduction.mapping @ theta), seconds, rate)
