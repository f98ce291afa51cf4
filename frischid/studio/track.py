"""Poses of the robot along the logs, which follow one another on one axis of time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from frischid.core.types import Array
from frischid.figures.torque import side_by_side
from frischid.studio.bench import Bench


@dataclass(frozen=True, eq=False)
class Track:
    """Poses along the logs on one axis of time; shared by all tabs."""

    x: Array
    """Time on the common axis, s, ascending, (N,)."""
    q: Array
    """Positions of the robot's joints, rad (m), (N, J)."""

    @classmethod
    def of(cls, bench: Bench) -> Track:
        """Recorded positions over the time axis of the figures."""
        robot = bench.state.model.robot
        starts, _ = side_by_side(bench.state.prediction)
        logs = [*bench.fit, *bench.valid]
        x = np.concatenate([log.t - log.t[0] + start for log, start in zip(logs, starts, strict=True)])
        order = np.argsort(x, kind="stable")  # a log's end, which the figures trim, may overlap the next log
        q = np.concatenate([log.select(robot.joints).q for log in logs])
        return cls(x[order], q[order])

    def at(self, x: float) -> Array:
        """Positions at a moment, (J,)."""
        return np.asarray(self.q[min(int(np.searchsorted(self.x, x)), len(self.x) - 1)])
