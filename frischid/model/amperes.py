"""Friction, rotor inertia and gravity of joints in amperes, for logs of currents whose gain nobody weighed.

    i_j = τ_j / K_j.     fv_j / K_j,  fc_j / K_j,  Ia_j / K_j  and  τ_j(q, 0, 0) / K_j

do not depend on K_j: the current was fitted, and K_j only names the unit. So these figures hold even if K_j is wrong.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from frischid.core.types import Array
from frischid.effects import columns_of
from frischid.logs.preprocessing import Motion
from frischid.model.drive_parameters import DRIVE_EFFECTS, values_of
from frischid.model.model import Model
from frischid.regression.regressor import Regressor

_HELD_POSES = 500
"""Poses of a motion at which the current that holds the arm is computed; more would not change its extremes."""


@dataclass(frozen=True)
class JointCurrents:
    """Currents of one joint, A; a pair is a value and its standard error, or None where the logs do not show it."""

    joint: str
    viscous: tuple[float, float] | None
    """A·s/rad (A·s/m)."""
    coulomb: tuple[float, float] | None
    """A."""
    armature: tuple[float, float] | None
    """Rotor inertia, A·s²/rad (A·s²/m)."""
    holding: tuple[float, float]
    """Smallest and largest current that holds the arm still at the poses of the logs: gravity and offset, A."""

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON values."""
        return asdict(self)


def in_amperes(model: Model, motions: Iterable[Motion]) -> tuple[JointCurrents, ...]:
    """Currents of each joint of a model whose torque came from a current.

    Parameters
    ----------
    motions : iterable of Motion
        Motions whose poses count, such as ``model.motions(logs)``.

    Returns
    -------
    tuple of JointCurrents
        Joints with torques of their own are left out.

    Examples
    --------
    >>> from dataclasses import replace
    >>> import frischid as fr
    >>> robot = fr.Robot.load("planar2")
    >>> log = fr.simulate(robot, fr.random_fourier(robot, 5.0, seed=1), rate=100.0, parameters={"fc1": 0.4})
    >>> amperes = replace(log, tau=None, current=log.tau / [10.0, 5.0])
    >>> found = fr.identify(robot, [amperes], recursion="none")
    >>> value, error = found.amperes[0].coulomb
    >>> bool(abs(value - 0.04) < 0.001)
    True
    """
    if model.currents is None:
        return ()
    gains = {n: model.currents.gain[n] for n in model.joints if n in model.currents.gain}
    low, high = _holding(model, motions)
    values = {(c.joint, c.effect, c.name.rstrip("0123456789")): (x, s) for c, x, s, _ in values_of(model)}
    found = []
    for name, gain in gains.items():
        drawn: dict[str, tuple[float, float] | None] = {}
        for quantity, effect in DRIVE_EFFECTS.items():
            pair = values.get((name, *effect))
            drawn[quantity] = None if pair is None else (pair[0] / abs(gain), pair[1] / abs(gain))
        j = model.robot.joints.index(name)
        ends = sorted((float(low[j] / gain), float(high[j] / gain)))
        found.append(JointCurrents(name, drawn["viscous"], drawn["coulomb"], drawn["armature"], (ends[0], ends[1])))
    return tuple(found)


def _holding(model: Model, motions: Iterable[Motion]) -> tuple[Array, Array]:
    """Smallest and largest torque that holds the arm at the poses of motions, (J,) each."""
    low = np.full(len(model.robot.joints), np.inf)
    high = -low
    # At rest nothing lags: neither a link behind its motor nor the record.
    effects = [e for e in model.effects if not (e.memory and e.loaded)]
    regressor = Regressor(model.robot, model.effects, model.reference).with_effects(effects)
    values = dict(zip((c.name for c in columns_of(model.robot, model.effects)), model.full_theta, strict=True))
    theta = np.array([values[c.name] for c in regressor.columns])
    for motion in motions:
        some = motion.part(slice(None, None, max(1, len(motion.q) // _HELD_POSES)))
        still = np.zeros_like(some.q)
        torque = theta @ regressor(np.zeros(len(still)), some.q, still, still, extra=some.extra)
        known = model.robot.known_torque(some.q, still, still)
        torque = torque if known is None else torque + known
        low, high = np.minimum(low, torque.min(axis=0)), np.maximum(high, torque.max(axis=0))
    return low, high
