"""What the drive train adds between the motor and the joint.

A rotor of inertia I_m behind a gear of ratio k turns k times as fast as its joint. Seen from the joint it weighs
``Ia = k² I_m``, often more than the link itself. The full form also counts what the spinning rotor does to the
link that carries it (see `Robot.rotor_coupling`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from frischid.effects.base import Effect, State, Term, torque_unit
from frischid.errors import InputError


@dataclass(frozen=True)
class RotorInertia(Effect):
    """Reflected inertia of the motor's rotor.

    Attributes
    ----------
    coupled : bool
        False: ``Ia q̈`` on the joint's own row, with ``Ia`` on the joint's side. True: the full form of a motor carried
        by the previous link, whose parameter ``Im`` is on the motor's side and which couples neighbouring rows.
    ratio : float
        Gear ratio (motor turns per joint turn); used by the full form only.
    """

    id: ClassVar[str] = "rotor_inertia"
    title: ClassVar[str] = "reflected rotor inertia"
    equation: ClassVar[str] = "Ia·a  (coupled: Im·(ratio²·a + ratio·z·ω̇) and its reaction on the rows before)"
    sentence: ClassVar[str] = "{joint} needs torque in proportion to its acceleration beyond its links': rotor inertia"
    looks_like: ClassVar[str] = "a straight line through zero when the residual is drawn against acceleration"
    confused_with: ClassVar[tuple[str, ...]] = ("payload",)
    confirmed_by: ClassVar[str] = "fast oscillations of this joint alone, in poses with different link inertia about it"
    reference: ClassVar[str] = "Sciavicco, Siciliano and Villani 1996, Robotica 14(4); Featherstone 2008, sec. 9.6"

    coupled: bool = False
    ratio: float = 1.0

    def __post_init__(self) -> None:
        if not np.isfinite(self.ratio) or self.ratio == 0:
            raise InputError(f"rotor_inertia: ratio must be a finite number other than zero, got {self.ratio}")

    def terms(self, state: State) -> list[Term]:
        """One column a joint: its acceleration, or the coupled form over all rows."""
        return [self._term(state, *joint) for joint in self.acts_on(state.robot)]

    def _term(self, state: State, i: int, name: str, number: str) -> Term:
        unit = torque_unit(state.robot, i, "acceleration")
        if not self.coupled:
            return Term(self.column("Ia", unit, name, number, sign=1), {i: state.a[:, i]})
        torque = state.robot.rotor_coupling(state.q, state.v, state.a, name, self.ratio)
        rows = {j: torque[:, j] for j in range(torque.shape[1])}
        return Term(self.column("Im", unit, name, number, sign=1), rows)
