"""Results of a fleet: each robot, and all robots together."""

from __future__ import annotations

from dataclasses import dataclass

from frischid.diagnosis.findings import Finding
from frischid.fleet.deviation import Change, Deviation, Null
from frischid.fleet.jobs import Skipped
from frischid.model.alarms import Alarm
from frischid.model.model import Model

SIGNIFICANCE = 0.01
"""p value, corrected for the number of robots, below which a robot differs: one false alarm in a hundred fleets."""
SAME_ERROR = 1.1
"""The model's existing parameters explain a change if their error is at most this multiple of a new effect's error."""


@dataclass(frozen=True, eq=False)
class Member:
    """Results of one robot."""

    name: str
    logs: int
    samples: int
    seconds: float
    """`logs`, `samples`, `seconds`: Numbers of logs and samples, and their length."""
    deviation: Deviation
    """Its own parameters, and their difference from the fleet's."""
    excess: float
    """Its difference from the others, as a multiple of the usual difference in this fleet (see `deviation.Null`)."""
    p_value: float
    """P value of this difference, corrected for the number of robots."""
    changes: tuple[Change, ...] = ()
    """Parameters of the model that differ from the fleet's; only for robots that differ."""
    finding: Finding | None = None
    """Effect that explains most of its error, from `diagnose`; only for robots that differ."""

    @property
    def differs(self) -> bool:
        """Whether the robot differs from the fleet by more than chance."""
        return self.p_value < SIGNIFICANCE

    @property
    def parameters_explain(self) -> bool:
        """Whether parameters that the model already has explain the change, so that no new effect is needed."""
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
    """Result of `frischid.fleet.fleet.identify_fleet`."""

    model: Model
    """The model with the parameters that the robots share."""
    members: tuple[Member, ...]
    """All robots, the largest difference from the fleet first."""
    skipped: tuple[Skipped, ...]
    """Logs that could not be used."""
    null: Null
    """Distribution of the usual differences between its robots."""
    where: str
    """The processes that did the work."""
    notes: tuple[str, ...]
    warnings: tuple[str, ...]
    alarms: tuple[Alarm, ...] = ()
    """Reasons not to trust the shared parameters, nor the list of robots that differ from them."""

    @property
    def different(self) -> tuple[Member, ...]:
        """Robots that differ significantly, ranked."""
        return tuple(m for m in self.members if m.differs)
