"""Friction with memory: before a joint slides, its surfaces bend like a spring.

Dahl's presliding state z depends on the path and not on the speed,

    dz/dq = (1 − z sgn q̇) / distance   ⇒   z_k = s − (s − z_{k−1}) exp(−|Δq_k| / distance),   s = sgn Δq_k,

exact from sample to sample. After a reversal the friction changes its sign within a few `distance`s, not at once.

Source: Dahl 1968, "A solid friction model", Aerospace Corporation TOR-0158; Canudas de Wit, Olsson, Åström and
Lischinsky 1995, IEEE Trans. Automatic Control 40(3) (the LuGre model, whose slow limit this is).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from frischid.core.types import Array
from frischid.effects.base import Effect
from frischid.effects.state import SIGN_WIDTH, State, Term
from frischid.effects.units import ANGLE_UNITS, SPEED_UNITS


def presliding(t: Array, v: Array, distance: float) -> Array:
    """Dahl's state along a motion, between −1 and 1.

    The path is the integral of the speed, because the speed carries less noise than differences of positions. The
    motion before the log is unknown. The joint is assumed to have come a long way in the direction of its first clear
    motion.

    Parameters
    ----------
    t, v : ndarray, shape (N,)
        Time, s, and speed, rad/s (m/s).
    distance : float
        Path over which the friction changes its sign, rad (m).

    Returns
    -------
    ndarray, shape (N,)
    """
    if not len(v):
        return np.zeros(0)
    path, begins = _path(t, v)
    # While the direction s stays the same, s − z decays with the way covered: only the reversals need a loop.
    side = np.sign(path)
    turns = np.flatnonzero(np.diff(side, prepend=np.nan) != 0)
    sizes = np.diff(turns, append=len(path))
    way = np.concatenate([[0.0], np.cumsum(np.abs(path))])
    kept = np.exp((np.repeat(way[turns], sizes) - way[1:]) / distance)
    z, starts = begins, []
    for s, at_end in zip(side[turns].tolist(), kept[turns + sizes - 1].tolist(), strict=True):
        starts.append(z)
        z = s - (s - z) * at_end
    return np.concatenate([[begins], side - (side - np.repeat(starts, sizes)) * kept])


def _path(t: Array, v: Array) -> tuple[Array, float]:
    """Signed way between two samples from the first clear motion on, rad (m), (N - 1,), and this motion's direction."""
    moving = np.abs(v) > SIGN_WIDTH
    first = int(moving.argmax()) if moving.any() else len(v)
    path = 0.5 * (v[1:] + v[:-1]) * np.diff(t)
    path[:first] = 0.0
    return path, float(np.sign(v[first])) if moving.any() else 0.0


def remembered(t: Array, v: Array, distance: float) -> Array:
    """Share of the first sample's state z that is in the state of each sample, (N,).

    It decays with the way covered, which counts from the first clear motion on.

    Parameters
    ----------
    t, v, distance
        As of `presliding`.
    """
    way = np.concatenate([[0.0], np.cumsum(np.abs(_path(t, v)[0]))])[: len(v)]
    return np.asarray(np.exp(-way / distance))


@dataclass(frozen=True)
class Hysteresis(Effect):
    """Dahl friction that replaces an equal part of the Coulomb friction, ``fh (z − tanh(q̇/width))``.

    Together with the Coulomb friction of the model the sum is ``fh z + (fc − fh) tanh(q̇/width)``: a part fh of the dry
    friction has memory.

    Attributes
    ----------
    distance : float
        Presliding distance, rad (m).
    width : float
        Speed over which the sign is smoothed, rad/s (m/s); as in the model's Coulomb friction.
    """

    id = "hysteresis"
    title = "presliding friction with memory"
    equation = "fh·(z − tanh(v/width)),  dz/dq = (1 − z·sgn v)/distance"
    sentence = (
        "when {joint} reverses, its dry friction changes sign over some distance and not at once: "
        "presliding friction with memory"
    )
    looks_like = "after each reversal, an error that depends on the path since the reversal and not on the speed"
    confused_with = ("stribeck", "coulomb", "backlash", "cable_hose", "time_delay")
    confirmed_by = (
        "record tiny slow back-and-forth motions of growing size: the torque drawn against the angle forms loops"
    )
    reference = "Dahl 1968, Aerospace Corporation TOR-0158; Canudas de Wit et al. 1995, IEEE TAC 40(3)"

    friction = True
    after_change = ("friction_change",)
    code: ClassVar = {"fh": "{z} - tanh({v} / {width})"}
    dry = True
    smooths_sign = True
    memory = True
    shapes: ClassVar = {"distance": (0.0005, 0.002, 0.006, 0.02, 0.06)}
    units: ClassVar = {"distance": ANGLE_UNITS, "width": SPEED_UNITS}

    distance: float = 0.006
    width: float = SIGN_WIDTH

    def __post_init__(self) -> None:
        self.require_positive(distance="distance in rad (m)", width="speed in rad/s (m/s)")

    def terms(self, state: State) -> list[Term]:
        """One column per joint: the state z less the smoothed sign of the speed."""

        def column(i: int) -> Array:
            v = state.v[:, i]
            return np.asarray(presliding(state.t, v, self.distance) - np.tanh(v / self.width))

        return self.per_joint(state, "fh", "", column, sign=1)

    def remembered(self, state: State) -> list[Term]:
        """Share of the first sample's state z, for each joint."""
        return self.per_joint(state, "fh", "", lambda i: remembered(state.t, state.v[:, i], self.distance))


@dataclass(frozen=True)
class CableHose(Effect):
    """Cables and hoses that bend with the joint: a spring whose strands rub on each other, ``kh q + fz z``.

    Attributes
    ----------
    distance : float
        Path over which the rubbing changes its sign, rad (m): far longer than in a gear.
    """

    id = "cable_hose"
    title = "cables and hoses: a spring with hysteresis"
    equation = "kh·q + fz·z,  dz/dq = (1 − z·sgn v)/distance"
    sentence = (
        "a torque like that of a spring pulls {joint} back, and is larger on the way out than on the way back: cables "
        "or hoses bend with the joint"
    )
    looks_like = "the residual drawn against angle is a slanted loop"
    confused_with = ("joint_spring", "hysteresis")
    confirmed_by = "record slow sweeps over the whole range, out and back, with the cables and without them"
    reference = "Wang, Gondokaryono, Munawar and Fischer 2019, IEEE Robotics and Automation Letters 4(4)"
    generalises = ("joint_spring", "hysteresis")
    after_change = ("offset_change",)
    code: ClassVar = {"kh": "{q}", "fz": "{z}"}
    memory = True
    shapes: ClassVar = {"distance": (0.1, 0.3, 1.0)}
    units: ClassVar = {"distance": ANGLE_UNITS}

    distance: float = 0.3

    def __post_init__(self) -> None:
        self.require_positive(distance="distance in rad (m)")

    def terms(self, state: State) -> list[Term]:
        """Two columns per joint: its angle, and the state z of the rubbing."""
        return [
            *self.per_joint(state, "kh", "position", lambda i: state.q[:, i], sign=1),
            *self.per_joint(state, "fz", "", lambda i: presliding(state.t, state.v[:, i], self.distance), sign=1),
        ]

    def remembered(self, state: State) -> list[Term]:
        """Share of the first sample's state z, for each joint."""
        return self.per_joint(state, "fz", "", lambda i: remembered(state.t, state.v[:, i], self.distance))
