"""The output of the command fleet."""

from __future__ import annotations

from frischid.cli.outputs.diagnoses import FindingOutput
from frischid.cli.outputs.parts import AlarmOutput, Output
from frischid.model.model_records import NotNegative

Pair = tuple[float, float]


class SharedParameterOutput(Output):
    """One parameter of a fleet; `spread`: standard deviation over the robots, null with fewer than two."""

    name: str
    expression: str
    unit: str
    value: float
    stderr: NotNegative
    spread: float | None


class NullOutput(Output):
    """How much equal robots of a fleet differ."""

    scale: float
    freedom: float | None
    within: float


class ChangeOutput(Output):
    """Parameters of one effect of one joint that changed: of the fleet, of the robot."""

    effect: str
    joint: str
    values: dict[str, Pair]
    error_after: float


class FleetRobotOutput(Output):
    """One robot of a fleet."""

    name: str
    logs: int
    samples: int
    seconds: NotNegative
    differs: bool
    excess: float
    p_value: float
    effect: str
    error_fleet: float
    error_own: float
    values: list[float] | None
    stderr: list[float] | None
    undetermined: str
    changes: list[ChangeOutput]
    finding: FindingOutput | None


class SkippedOutput(Output):
    """A log of a fleet that was not used."""

    robot: str
    address: str
    reason: str


class FleetOutput(Output):
    """A fleet of equal robots; `different`: names of the robots that differ."""

    where: str
    cutoff_hz: float | None
    parameters: list[SharedParameterOutput]
    null: NullOutput
    robots: list[FleetRobotOutput]
    different: list[str]
    skipped: list[SkippedOutput]
    notes: list[str]
    warnings: list[str]
    alarms: list[AlarmOutput]
