"""A body that the last link carries for a part of the log: it is taken within the log, or put down.

    τ − τ_nominal ≈ s(t) · Γ_last(q, q̇, q̈) φ + friction,      s(t) = 0 or 1

The first s is the stretch of time in which a body explains most (`frischid.regression.two_states`). Then φ and s follow
from each other in turns. The body must be possible, as one that is carried always (`payload`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from frischid.checks.payload import LEAST_ERROR, last_joint, last_link, possible
from frischid.checks.row_fits import RowFits
from frischid.checks.sketch import FRICTION_NUMBERS, Sketch, shared_fit
from frischid.core.text import listed
from frischid.core.types import Array
from frischid.regression.two_states import best_stretch, likeliest_states

_BLOCKS_OF_A_SKETCH = 50  # between whose ends the first stretch is sought
_MASS_AND_MOMENT = 4  # first parameters of a link: they change the torque most
_MOST_TOLD = 3  # stretches in a sentence
_CHANGES_OF_STATES = 4  # turns; the states usually stay the same after two


@dataclass(frozen=True, eq=False)
class CarriedBody:
    """A body that the last link carries for a while."""

    joint: str
    mass: float
    """kg."""
    carried: NDArray[np.bool_]
    """Whether the last link carries it, (M,)."""
    torque: Array
    """Its torque, (M, J), N·m (N)."""

    @property
    def changes(self) -> int:
        """How often it is taken or put down."""
        return int(np.count_nonzero(np.diff(self.carried.astype(int))))

    @property
    def story(self) -> str:
        """Whether it is taken, put down, or both: "takes up a load"."""
        taken = np.diff(self.carried.astype(int))
        both = ["takes up a load"] * bool((taken > 0).any()) + ["puts a load down"] * bool((taken < 0).any())
        return " and ".join(both)

    def times(self, sketch: Sketch) -> str:
        """The stretches in words, counted from the log's first sample, as ``frischid cut`` does."""
        ends = np.flatnonzero(np.diff(self.carried.astype(int), prepend=0, append=0)).reshape(-1, 2)
        t = sketch.t - sketch.start
        told = [f"from {t[a]:.1f} to {t[b - 1]:.1f} s" for a, b in ends[:_MOST_TOLD].tolist()]
        more = [f"{len(ends) - _MOST_TOLD} more times"] if len(ends) > _MOST_TOLD else []
        return listed([*told, *more])


def carried_body(fits: RowFits) -> CarriedBody | None:
    """Find the body that explains most where the last link carries it for a while; None without a possible one."""
    sketch = fits.sketch
    joint, Y = last_joint(sketch.robot), last_link(sketch)
    if Y.shape[1] < 10 or not len(sketch.rows):
        return None
    states = _first(sketch, Y)
    for _ in range(_CHANGES_OF_STATES):
        if states.all() or not states.any():
            return None
        columns = {int(j): Y[:, :, j] * states[:, None] for j in sketch.rows}
        phi = shared_fit(sketch, columns, sketch.tau - sketch.nominal)[:10]
        body = np.einsum("nck,c->nk", Y, phi)
        new = _likeliest(fits, body, states)
        if np.array_equal(new, states):
            break
        states = new
    if phi[0] <= 0 or not possible(sketch, Y, phi):
        return None
    return CarriedBody(joint, float(phi[0]), states, body * states[:, None])


def _first(sketch: Sketch, Y: Array) -> NDArray[np.bool_]:
    """The stretch in which a mass and its first moment explain most, beside each joint's own friction."""
    M, k, R = len(sketch), _MASS_AND_MOMENT, len(sketch.rows)
    ends = np.linspace(0, M, min(_BLOCKS_OF_A_SKETCH, M) + 1).astype(int)
    starts = ends[:-1]
    cross, left = np.zeros((len(starts), FRICTION_NUMBERS * R, k)), np.zeros((len(starts), k))
    own = np.zeros((len(starts), k, k))
    for row, j in enumerate(sketch.rows):
        use = sketch.motion.uses(int(j))[:, None] / sketch.spread[row]
        C, y = Y[:, :k, j] * use, (sketch.tau[:, j] - sketch.nominal[:, j])[:, None] * use
        Q, _ = np.linalg.qr(sketch.motion.friction(j)[:, :FRICTION_NUMBERS] * use)
        y = y - Q @ (Q.T @ y)
        place = slice(FRICTION_NUMBERS * row, FRICTION_NUMBERS * (row + 1))
        cross[:, place] = np.add.reduceat(Q[:, :, None] * C[:, None, :], starts)
        left += np.add.reduceat(y * C, starts)
        own += np.add.reduceat(C[:, :, None] * C[:, None, :], starts)
    _, first, last = best_stretch(cross, left, own)
    samples = np.arange(M)
    return np.asarray((samples >= ends[first]) & (samples < ends[last]))


def _likeliest(fits: RowFits, body: Array, states: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The likeliest states for the torque of a body, (M, J), that was fitted with other states."""
    sketch, gain = fits.sketch, np.zeros(len(fits.sketch))
    loaded = sketch.nominal + body * states[:, None]
    for row, (j, noise) in enumerate(zip(sketch.rows, sketch.errors(loaded), strict=True)):
        use = sketch.motion.uses(int(j))
        F = sketch.motion.friction(j)[:, :FRICTION_NUMBERS]
        error = sketch.tau[:, j] - loaded[:, j]
        error = error - F @ np.linalg.lstsq(F[use], error[use], rcond=None)[0]
        torque = body[:, j]
        unit = max(noise, LEAST_ERROR) ** 2 * sketch.spread[row] ** 2 * use.sum() / max(fits.weight[row], 1.0)
        gain += np.where(use, torque * (2 * (error + torque * states) - torque), 0.0) / unit
    return likeliest_states(gain, 2.0 * float(np.log(max(fits.weight.sum(), 2.0))))
