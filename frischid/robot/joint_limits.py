"""Limits of position, velocity and effort that a URDF gives its joints.

    lower ≤ q ≤ upper,   |q̇| ≤ velocity,   |τ| ≤ effort

If a URDF gives none, Pinocchio sets zeros or huge numbers; here such a limit is infinite.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from frischid.core.types import Array

LARGEST_LIMIT = 1e6
"""A position (rad, m), velocity (rad/s, m/s) or effort (N·m, N) as large as this is a placeholder; no robot has it."""


@dataclass(frozen=True, eq=False)
class JointLimits:
    """URDF limits of the joints, each of shape (J,): rad (m), rad/s (m/s), N·m (N)."""

    lower: Array
    upper: Array
    velocity: Array
    effort: Array

    @property
    def middle(self) -> Array:
        """Middle of the range of position, (J,), rad (m); zero for a joint without a range."""
        bounded = np.isfinite(self.lower) & np.isfinite(self.upper)
        return np.where(bounded, 0.5 * (np.where(bounded, self.lower, 0.0) + np.where(bounded, self.upper, 0.0)), 0.0)

    @property
    def stroke(self) -> Array:
        """Range of position, (J,), rad (m); infinite for a joint without a range."""
        return self.upper - self.lower

    def within(self, reach: float | Array) -> tuple[Array, Array]:
        """Positions of every joint that are at most `reach` (rad, m) from zero, as their bounds, (J,) each.

        Where the whole range lies farther out, the bounds are those of its nearest part, at most ``2 reach`` long.
        """
        lower, upper = np.maximum(self.lower, -reach), np.minimum(self.upper, reach)
        beyond, nearest = lower >= upper, np.clip(0.0, self.lower, self.upper)
        lower = np.where(beyond, np.maximum(self.lower, nearest - 2 * reach), lower)
        return lower, np.where(beyond, np.minimum(self.upper, nearest + 2 * reach), upper)


def read_limits(model: Any, joints: Sequence[int]) -> JointLimits:
    """Take the limits of some joints from a Pinocchio model; infinite where the URDF gives none.

    Parameters
    ----------
    joints : sequence of int
        Pinocchio's index of each joint.
    """
    rows = [model.joints[k] for k in joints]
    bounded = [r.nq == 1 for r in rows]  # a continuous joint is a pair (cos, sin) without limits
    lower = np.array([model.lowerPositionLimit[r.idx_q] if b else -np.inf for r, b in zip(rows, bounded, strict=True)])
    upper = np.array([model.upperPositionLimit[r.idx_q] if b else np.inf for r, b in zip(rows, bounded, strict=True)])
    velocity = np.array([model.velocityLimit[r.idx_v] for r in rows])
    effort = np.array([model.effortLimit[r.idx_v] for r in rows])
    unset = lower >= upper
    lower[unset | (lower <= -LARGEST_LIMIT)], upper[unset | (upper >= LARGEST_LIMIT)] = -np.inf, np.inf
    velocity[(velocity <= 0) | (velocity >= LARGEST_LIMIT)] = np.inf
    effort[(effort <= 0) | (effort >= LARGEST_LIMIT)] = np.inf
    return JointLimits(lower, upper, velocity, effort)
