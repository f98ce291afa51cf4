"""A torque that bends over the load: gears with play under slowly changing load, and whatever saturates.

A gear with play, moved slowly, rests on one flank of its teeth or on the other, or floats in between. A torque that is
measured or lost on the flanks then follows the load up to a small load, where the teeth press against each other, and
stays the same beyond it. A motor or a torque sensor that saturates bends in the same way. With the load τ_load,j that
the gear carries (the rigid-body torque of the reference parameters),

    τ_j = gl_j tanh(τ_load,j / knee).

Where the knee is larger than every load of the logs, tanh(x) = x − x³/3 + … leaves (gl/knee) τ_load,j: a part of the
load, as from a torque channel with a wrong scale. So `DriveGain` is the limit of this effect for large knees (dry and
viscous friction of the same joint, which a gain scales too, are parameters of every model). It has one parameter less.

`Backlash` is the other half of the same physics: the motion of the link while it crosses the gap, which shows in fast
motion. A gear may need both.

Sources: Nordin and Gutman 2002, Automatica 38(10); Tuttle and Seering 1996, "A nonlinear model of a harmonic drive gear
transmission", IEEE Trans. Robotics and Automation 12(3), on the soft windup of a gear at small load.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from frischid.effects.base import Effect
from frischid.effects.state import State, Term
from frischid.effects.units import TORQUE_PAIR


@dataclass(frozen=True)
class GearPlay(Effect):
    """Torque that follows a small load and stays the same beyond it, ``gl tanh(load/knee)``.

    Attributes
    ----------
    knee : float
        Load at which the torque bends, N·m (N).
    """

    id = "gear_play"
    title = "gear play under slow load (a torque that bends over the load)"
    equation = "gl·tanh(τ_rigid/knee)"
    sentence = (
        "the torque of {joint} bends over the load: it follows a small load and stays the same beyond it. The gear has "
        "play or is soft at small load, or the motor or the torque sensor saturates"
    )
    looks_like = (
        "the residual drawn against load is a step with rounded edges at zero load, the same at all speeds and in both "
        "directions"
    )
    confused_with = ("backlash", "drive_gain", "offset", "load_friction", "hysteresis")
    confirmed_by = (
        "move the joint slowly through the pose where its load is zero, in both directions, without and with a "
        "payload: the step stays at zero load, and does not follow the angle or the direction"
    )
    reference = "Nordin and Gutman 2002, Automatica 38(10)"

    loaded = True
    code: ClassVar = {"gl": "tanh({load} / {knee})"}
    shapes: ClassVar = {"knee": (0.03, 0.1, 0.3, 0.8, 2.0, 5.0, 13.0, 35.0, 100.0)}
    units: ClassVar = {"knee": TORQUE_PAIR}

    knee: float = 10.0

    def __post_init__(self) -> None:
        self.require_positive(knee="load in N·m (N)")

    def terms(self, state: State) -> list[Term]:
        """One column per joint: the saturated load."""
        return self.per_joint(state, "gl", "", lambda i: np.tanh(state.load[:, i] / self.knee))
