"""The simulated robot in the scene: transparent, beside the measured robot, along one log."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from viser import ClientHandle
from viser.extras import ViserUrdf

from frischid.core.types import Array
from frischid.figures.torque import side_by_side
from frischid.studio.bench import Bench, State
from frischid.studio.bodies import urdf_of

LOOK = (0.835, 0.369, 0.0, 0.35)
"""Red, green, blue and opacity: the vermilion of the report's ghost."""


class Ghost:
    """The simulated robot in one tab; absent where no motion can be simulated.

    Parameters
    ----------
    configuration : callable
        Positions of the robot's joints (J,) -> those of the drawn robot.
    """

    def __init__(self, client: ClientHandle, bench: Bench, configuration: Callable[[Array], Array]) -> None:
        self._client, self._bench, self._configuration = client, bench, configuration
        self._drawn: ViserUrdf | None = None

    def show(self, x: float) -> None:
        """Show a moment of the common axis, s; nothing where no simulated motion exists."""
        q = simulated_at(self._bench.state, x)
        if self._drawn is None:
            if q is None:
                return
            self._drawn = ViserUrdf(
                self._client,
                urdf_of(self._bench.state.model.robot),
                root_node_name="/ghost",
                mesh_color_override=LOOK,
            )
        self._drawn.show_visual = q is not None
        if q is not None:
            self._drawn.update_cfg(self._configuration(q))


def simulated_at(state: State, x: float) -> Array | None:
    """Simulated positions at a moment of the common axis, (J,); None where there are none.

    Parameters
    ----------
    x : float
        s.
    """
    beside = state.beside
    if beside is None:
        return None
    starts, _ = side_by_side(state.prediction)
    t = x - float(starts[state.prediction.sources.index(beside.source)])
    if not beside.t[0] <= t <= beside.t[-1]:
        return None
    q = beside.simulated[min(int(np.searchsorted(beside.t, t)), len(beside.t) - 1)]
    return q if np.isfinite(q).all() else None
