"""The information of a motion on the parameters of position drives.

With the rows Π of torque, each over its noise, and the prior covariance S of all parameters, logs leave the covariance

    C = (Πᵀ Π + S⁻¹)⁻¹,      cost = (log det C_dd)/k = −(log det A − log det A_rest)/k,      A = Πᵀ Π + S⁻¹

of the k parameters d of the drives (D_s-optimality). These are armature and friction of every joint, one delay of all
commands, and the gain of every joint. The last two are columns of a torque that follows from commands
(`frischid.effects.commands`): a delay δ adds δ d/dt(kp q_cmd), and a gain that is softer by g adds g τ. With

    kp q_cmd = τ + kp q + kd q̇,

the delay's column is τ̇ beside multiples of q̇ and q̈, which friction and armature have already. So only τ̇ counts, and
no gain has to be known: the plan holds for any. The torque is that of the URDF.

Source: A. C. Atkinson, A. N. Donev and R. D. Tobias, Optimum Experimental Designs, with SAS, Oxford 2007, 10.3.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from frischid.core.types import Array
from frischid.motions.optimality import UNSMOOTHED, Criterion


@dataclass(frozen=True, eq=False)
class DriveInformation(Criterion):
    """Mean log variance of the drives' parameters, given all others."""

    name: ClassVar[str] = "drives"
    title: ClassVar[str] = "mean log variance of armature, friction, delay and gains"
    positive: ClassVar[bool] = False
    listed: ClassVar[bool] = False

    mapping: Array
    """Base parameters from all C parameters, (p, C)."""
    theta: Array
    """The URDF's parameters, (C,)."""
    spread: Array
    """Prior standard deviation of every parameter, of the delay in s, and of each joint's gain as a share of it, (C + 1
    + J,)."""
    drives: NDArray[np.bool_]
    """Parameters of the drives, besides delay and gains, (C,)."""
    noise: Array
    """Standard deviation of the torque's noise, N·m (N), (J,)."""
    rows: float
    """Independent rows of a joint that a log of this length has."""
    step: float
    """s between the samples."""

    def __call__(self, W: Array, exponent: float = UNSMOOTHED) -> tuple[float, Array]:
        """See `Criterion`."""
        Y = W[0] / self.noise
        F = self._with_commands(Y)
        flat = F.transpose(1, 0, 2).reshape(F.shape[1], -1)
        share = self.rows / W.shape[1]
        cost, G = self._of_moments(share * flat @ flat.T)
        slope = 2.0 * share * np.matmul(G, F)
        gradient = np.zeros_like(W)
        gradient[0] = self._through_commands(slope) / self.noise
        return cost, gradient

    def covariance(self, W: Array) -> Array:
        """Covariance of all C + 1 + J parameters after a motion with the base regressor W, (N, p, J)."""
        F = self._with_commands(W / self.noise)
        flat = F.transpose(1, 0, 2).reshape(F.shape[1], -1)
        return np.asarray(np.linalg.inv(self._information(self.rows / len(W) * flat @ flat.T)))

    @property
    def wanted(self) -> NDArray[np.intp]:
        """Indices of the drives' parameters among all C + 1 + J."""
        return np.flatnonzero(np.concatenate([self.drives, np.ones(1 + len(self.noise), dtype=bool)]))

    def _with_commands(self, Y: Array) -> Array:
        """The rows of Y (N, p, J) with the columns of the delay and of each joint's gain."""
        torque = np.einsum("npj,p->nj", Y, self.mapping @ self.theta)
        late = self._rate(torque)[:, None]
        return np.concatenate([Y, late, torque[:, None] * np.eye(Y.shape[2])], axis=1)

    def _through_commands(self, slope: Array) -> Array:
        """Derivative by Y from that by `_with_commands`."""
        p, J = len(self.mapping), slope.shape[2]
        by_torque = self._rate_back(slope[:, p]) + np.einsum("njj->nj", slope[:, p + 1 : p + 1 + J])
        return np.asarray(slope[:, :p] + np.einsum("nj,p->npj", by_torque, self.mapping @ self.theta))

    def _rate(self, x: Array) -> Array:
        """Central differences over time; the ends stand still."""
        rate = np.zeros_like(x)
        rate[1:-1] = (x[2:] - x[:-2]) / (2 * self.step)
        return rate

    def _rate_back(self, g: Array) -> Array:
        """The transpose of `_rate`."""
        back = np.zeros_like(g)
        back[2:] += g[1:-1] / (2 * self.step)
        back[:-2] -= g[1:-1] / (2 * self.step)
        return back

    def _whole(self) -> Array:
        """The map from all parameters to those of the rows, (p + 1 + J, C + 1 + J)."""
        p, C = self.mapping.shape
        extra = 1 + len(self.noise)
        whole = np.zeros((p + extra, C + extra))
        whole[:p, :C], whole[p:, C:] = self.mapping, np.eye(extra)
        return whole

    def _information(self, moments: Array) -> Array:
        whole = self._whole()
        return np.asarray(whole.T @ moments @ whole + np.diag(self.spread**-2))

    def _of_moments(self, moments: Array) -> tuple[float, Array]:
        """Cost and its derivative by the moments, in units of the prior."""
        scaled = self._whole() * self.spread
        A = scaled.T @ moments @ scaled + np.eye(scaled.shape[1])
        wanted = self.wanted
        rest = np.setdiff1d(np.arange(len(A)), wanted)
        others = A[np.ix_(rest, rest)]
        G = -np.linalg.inv(A)
        G[np.ix_(rest, rest)] += np.linalg.inv(others)
        cost = float(np.linalg.slogdet(others)[1] - np.linalg.slogdet(A)[1]) / len(wanted)
        return cost, np.asarray(scaled @ G @ scaled.T / len(wanted))
