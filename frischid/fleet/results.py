"""Results of a fleet: each robot, and all robots together."""

from __future__ import annotations

from dataclasses import dataclass

from frischid.diagnosis.findings import Finding
from frischid.fleet.deviation import Change, Deviation, Null
from frischid.fleet.jobs import Skipped
from frischid.model.model import Model

SIGNIFICANCE = 0.01
"""p value, corrected for the number of robots, below which a robot differs: one false alarm in a hundred fleets."""
SAME_ERROR = 1.1
"""The model's existing parameters explain a change if their error is at most this multiple of a new effect's error."""


@dataclass(frozen=True, eq=False)
class Member:
    """Results of one robot.

    Attributes
    ----------
    name : str
    logs, samples, seconds
        What was counted.
    deviation : Deviation
        Its own parameters, and how they differ from the others'.
    excess : float
        How far it is from the others, as a multiple of what is usual in this fleet: mean one (see `deviation.Null`).
    p_value : float
        Corrected for the number of robots.
    changes : tuple of Change
        Parameters of the model that are no longer the fleet's; of robots that differ.
    finding : Finding or None
        Effect that explains most of its error, from `diagnose`; of robots that differ.
    """

    name: str
    logs: int
    samples: int
    seconds: float
    deviation: Deviation
    excess: float
    p_value: float
    changes: tuple[Change, ...] = ()
    finding: Finding | None = None

    @property
    def differs(self) -> bool:
        """Whether it differs from the fleet by more than chance."""
        return self.p_value < SIGNIFICANCE

    @property
    def parameters_explain(self) -> bool:
        """Whether parameters that the model has already account for the change, rather than a new effect."""
        if not self.changes:
            return False
        return self.finding is None or self.changes[-1].error_after <= SAME_ERROR * self.finding.error_after

    @property
    def effect(self) -> str:
        """Name of the change, ``effect@joint``; ``"unknown"`` when nothing explains it, empty when nothing changed."""
        if not self.differs:
            return ""
        if self.parameters_explain:
            return ", ".join(f"{c.effect}@{c.joint}" for c in self.changes)
        if self.finding is None:
            return "unknown"
        return self.finding.effect + ("@" + "+".join(self.finding.joints) if self.finding.joints else "")


@dataclass(frozen=True, eq=False)
class Fleet:
    """What `frischid.fleet.fleet.identify_fleet` found.

    Attributes
    ----------
    model : Model
        With the parameters that the robots have in common.
    members : tuple of Member
        Every robot, those that differ most first.
    skipped : tuple of Skipped
        Logs that could not be used.
    null : Null
        How much its robots usually differ.
    where : str
        Where the work was done.
    notes, warnings : tuple of str
    """

    model: Model
    members: tuple[Member, ...]
    skipped: tuple[Skipped, ...]
    null: Null
    where: str
    notes: tuple[str, ...]
    warnings: tuple[str, ...]

    @property
    def different(self) -> tuple[Member, ...]:
        """Robots that differ significantly, ranked."""
        return tuple(m for m in self.members if m.differs)
