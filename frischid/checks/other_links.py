"""The rival of a fault of positions: they are right, and the links weigh something else than the URDF says.

With the torques of row j in units of their standard deviation, and friction projected out,

    τ_j ≈ Y_j θ,      θ_c ~ N(0, d_c²),   d = M, M L, M L²   of mass, first moments and inertias,

with the lengths L of the links and a mass M of the robot, which the torques choose. The marginal likelihood of the
torques is that of the most likely θ less the price of all these parameters (MacKay 1992, Neural Computation 4(3)),

    −½ Σ_j n_j log(e_j² + e_URDF²) − ½ Σ_c (θ_c / d_c)² − ½ log det(1 + D H D).

n_j, e_j and e_URDF are those of `explanation`; H is the information about θ. Ten numbers for each link explain much, so
their price is high: a few faults of a log explain its torques better, if the URDF's links are right.
"""

from __future__ import annotations

import numpy as np

from frischid.checks.row_fits import RowFits
from frischid.checks.sketch import Sketch
from frischid.core.types import Array
from frischid.robot.stated_inertials import sizes_of_links

MASSES = np.geomspace(0.1, 1000.0, 13)
"""Masses M that are tried, kg: three for each power of ten."""
_NOISE_TURNS = 4  # of the error and the parameters, each from the other


def evidence_of_other_links(sketch: Sketch) -> float:
    """Log marginal likelihood of the torques, comparable with the score of a hypothesis (`explanation`)."""
    Y, weight = sketch.motion.regressor(), RowFits(sketch).weight
    size, moments = sizes_of_links(sketch.robot), []
    for k, j in enumerate(sketch.rows):
        use = sketch.used[:, j]
        y = np.column_stack([Y[use, :, j], sketch.tau[use, j]]) / sketch.spread[k]
        Q, _ = np.linalg.qr(sketch.motion.friction(j)[use][:, :4])
        y -= Q @ (Q.T @ y)
        moments.append(y.T @ y / max(int(use.sum()), 1))
    return max(_evidence(np.array(moments), weight, mass * size, sketch.criteria.urdf_error) for mass in MASSES)


def _evidence(moments: Array, weight: Array, spread: Array, floor: float) -> float:
    """Log marginal likelihood for moments (R, C + 1, C + 1) of the rows, and standard deviations (C,)."""
    square = np.full(len(moments), 2 * floor**2)
    for _ in range(_NOISE_TURNS):
        H = np.tensordot(weight / square, moments, axes=(0, 0))
        A = np.eye(len(spread)) + spread[:, None] * H[:-1, :-1] * spread
        x = np.linalg.solve(A, spread * H[:-1, -1])
        d = np.append(spread * x, -1.0)
        square = np.maximum(moments @ d @ d, 0.0) + floor**2
    return -0.5 * (float(weight @ np.log(square)) + float(x @ x) + float(np.linalg.slogdet(A)[1]))
