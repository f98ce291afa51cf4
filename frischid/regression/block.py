"""Samples that go into a regressor, and the filtered blocks that come out.

    Z = [Y | τ | 1 | τ_known | q | q̇ | q̈]

One array holds the regressor and all channels, because the same filter is applied to all of them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from frischid.core.types import Array
from frischid.logs.preprocessing import Motion
from frischid.robot.robot import Robot

COLUMNS_BESIDE_Y = 6
"""Columns of `Block.Z` beside those of Y: τ, ones, the torque of known parameters, q, q̇, q̈."""


@dataclass(frozen=True, eq=False)
class Samples:
    """The channels of consecutive samples of a motion that a regressor needs."""

    t: Array
    """Time, s, (N,)."""
    q: Array
    v: Array
    a: Array
    """`q`, `v`, `a`: Positions, rad (m), velocities and accelerations, (N, J)."""
    start: float
    """Time at which the log begins, s."""
    extra: Mapping[str, Array] = field(default_factory=dict)
    """Further channels that effects read, for example ``temperature_<joint>``, (N,)."""

    @classmethod
    def of(cls, motion: Motion) -> Samples:
        """All samples of a motion."""
        return cls(motion.t, motion.q, motion.v, motion.a, motion.start, motion.extra)

    def part(self, kept: slice) -> Samples:
        """Some consecutive samples of these."""
        extra = {name: values[kept] for name, values in self.extra.items()}
        return Samples(self.t[kept], self.q[kept], self.v[kept], self.a[kept], self.start, extra)


@dataclass(frozen=True, eq=False)
class Block:
    """Filtered and decimated samples of one stretch of motion."""

    t: Array
    """Shape (M,)."""
    Z: Array
    """The C columns of Y, then `tau`, ones, `known`, `q`, `v`, `a`, (M, C + 6, J)."""
    used: NDArray[np.bool_]
    """False at standstill, where dry friction is undetermined, (M, J): such a torque row is not fitted and does not
    count in errors."""
    source: str
    """The log."""

    @property
    def Y(self) -> Array:
        """Regressor, shape (M, C, J): ``τ[k] = Y[k].T @ θ``."""
        return self.Z[:, :-COLUMNS_BESIDE_Y]

    @property
    def tau(self) -> Array:
        """Measured torque less that of the known parameters, (M, J), N·m (N); NaN where not measured."""
        return self.Z[:, -6]

    @property
    def known(self) -> Array:
        """Torque of the known parameters, which are not fitted, (M, J), N·m (N)."""
        return self.Z[:, -4]

    @property
    def q(self) -> Array:
        """Filtered positions, (M, J)."""
        return self.Z[:, -3]

    @property
    def v(self) -> Array:
        """Filtered velocities, (M, J)."""
        return self.Z[:, -2]

    @property
    def a(self) -> Array:
        """Filtered accelerations, (M, J)."""
        return self.Z[:, -1]


def stack(blocks: Sequence[Block], robot: Robot, joints: Sequence[str]) -> tuple[Array, Array, NDArray[np.intp]]:
    """Rows of several blocks, sample by sample and joint by joint, without the rows of joints at standstill.

    Returns
    -------
    Y : ndarray, shape (R, C)
    tau : ndarray, shape (R,)
    which : ndarray of int, shape (R,)
        Position in `joints` of each row's joint.
    """
    index: NDArray[np.intp] = np.array([robot.joints.index(n) for n in joints])
    used = np.concatenate([b.used[:, index].ravel() for b in blocks])
    rows = [b.Y[:, :, index].transpose(0, 2, 1).reshape(-1, b.Y.shape[1])[b.used[:, index].ravel()] for b in blocks]
    tau = np.concatenate([b.tau[:, index].ravel() for b in blocks])
    return np.concatenate(rows), tau[used], np.resize(np.arange(len(index)), len(used))[used]
