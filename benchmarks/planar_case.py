"""The paper's planar arm and its motion, for the benchmarks of estimators and of the recursion.

`frischid paper` reproduces the paper itself (`frischid/paper`). Here the arm is that of `urdf/planar2.urdf`, with the
right columns, and the motion that of the authors' points, or a random Fourier motion where FRISCHID_DATA is not set.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

import frischid as fr
from frischid.core.types import Array
from frischid.motions.simulation import parameters_of
from frischid.motions.trajectory import Trajectory
from frischid.regression.base_parameters import Reduction
from frischid.regression.regressor import Regressor
from frischid.regression.structure import structure
from frischid.robot.scale import SI

EFFECTS = "viscous, coulomb(width=1e-6), rotor_inertia(coupled=true, ratio=0.1)"
ROTORS = {"Im1": 12.10, "Im2": 21.18}
RATE, DURATION, WINDOW, TORQUE_NOISE = 50.0, 99.0, 1000, 1.0


@dataclass(frozen=True, eq=False)
class Arm:
    """The arm with the paper's frames and effects: its base parameters in the paper's order, friction first."""

    regressor: Regressor
    reduction: Reduction
    base: tuple[int, ...]
    names: tuple[str, ...]
    expressions: tuple[str, ...]
    signs: tuple[int, ...]
    theta: Array

    def rows(self, t: Array, q: Array, v: Array, a: Array) -> Array:
        """Base regressor with the joints' rows sample by sample, shape (2N, 9)."""
        Y = self.regressor(t, q, v, a)[:, list(self.base)]
        return np.ascontiguousarray(Y.transpose(0, 2, 1)).reshape(-1, len(self.base))


@cache
def arm() -> Arm:
    """Load the arm; the URDF ships with frischid."""
    robot = fr.Robot.load("planar2", frames="far_end", known={"my1": 0.0, "my2": 0.0})
    effects = fr.parse_effects(EFFECTS)
    regressor = Regressor(robot, effects)
    reduction = structure(regressor, robot.joints, scale=SI)
    theta = reduction.mapping @ parameters_of(robot, effects, ROTORS)
    columns, expressions = reduction.base_columns(), reduction.expressions()
    order = sorted(range(len(columns)), key=lambda i: columns[i].effect == "rigid")
    return Arm(
        regressor,
        reduction,
        tuple(reduction.base[i] for i in order),
        tuple(columns[i].name for i in order),
        tuple(expressions[i] for i in order),
        tuple(columns[i].sign for i in order),
        theta[order],
    )


@dataclass(frozen=True, eq=False)
class Case:
    """The noise-free motion and its torque.

    Attributes
    ----------
    source : str
        Origin of the motion.
    t : ndarray, shape (N,)
    q, v, a : ndarray, shape (N, 2)
    tau : ndarray, shape (2N,)
    points : tuple of ndarray
        t, q, v, a at the points that were joined, one per second.
    """

    source: str
    t: Array
    q: Array
    v: Array
    a: Array
    tau: Array
    points: tuple[Array, Array, Array, Array]


def case_study(folder: Path | None, seed: int) -> Case:
    """Join the authors' points by quintics; without these points, take a random Fourier motion of the same length."""
    motion: Trajectory
    if folder is not None:
        file = folder / "frisch_planar" / "exciting_points.csv"
        table = np.loadtxt(file, delimiter=",", skiprows=1)
        points = (table[:, 0], table[:, 1:3], table[:, 3:5], table[:, 5:7])
        motion, source = fr.Quintic(*points), "the authors' 100 points, joined by quintics"
    else:
        motion = fr.random_fourier(arm().regressor.robot, DURATION, seed=seed)
        seconds = np.arange(DURATION + 1)
        points = (seconds, *motion(seconds))
        source = "a random Fourier motion (set FRISCHID_DATA for the authors' points)"
    t = np.arange(round(motion.duration * RATE) + 1) / RATE
    q, v, a = motion(t)
    return Case(source, t, q, v, a, arm().rows(t, q, v, a) @ arm().theta, points)
