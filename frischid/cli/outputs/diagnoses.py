"""Output of `diagnose`, and its parts that other commands print too."""

from __future__ import annotations

from typing import Literal

from msgspec import UNSET, UnsetType

from frischid.cli.outputs.parts import HeadlineOutput, Output
from frischid.diagnosis.criteria import DiagnosisCriteria
from frischid.diagnosis.situation import Situation
from frischid.diagnosis.verdict import Verdict
from frischid.model.model_records import NotNegative, Share


class FindingOutput(Output):
    """One candidate effect: errors before and after (NRMSE), explained share, gain of the log likelihood.

    `members`: its effects with shapes and places, as `add` reads them.
    """

    effect: str
    joints: list[str]
    error_before: NotNegative
    error_after: NotNegative
    gain: float
    removed: float
    share: float
    floors: float
    over_twin: float
    twin_removed: NotNegative
    parameters: dict[str, float]
    confused_with: list[str]
    sentence: str
    entered: bool
    own: float
    probability: Share
    significant: bool
    withheld: str
    elsewhere: list[str]
    negligible: bool
    absent_in_motion: bool
    members: list[str]


class ContactOutput(Output):
    """A contact from `start` to `stop`, s, in a log whose first time stamp is `log_start`."""

    source: str
    start: float
    stop: float
    joints: list[str]
    strength: float
    log_start: float


class SearchJointOutput(Output):
    """Error of a joint on the logs that select, beside its noise floor."""

    error: NotNegative
    noise_floor: NotNegative


class SearchOutput(Output):
    """Error on the logs that select, mean and by joint."""

    error: NotNegative
    noise_floor: NotNegative
    joints: dict[str, SearchJointOutput]


class DescriptionOutput(Output):
    """What the residual of a joint depends on (p value of each variable), where no effect explains the residual.

    `removed`: share of the joint's squared held-out error that the formula explains. `joints`: number in the names of
    variables -> joint.
    """

    joint: str
    depends_on: dict[str, float]
    formula: list[str]
    removed: float
    joints: dict[str, str]


class SimulatedRatioOutput(Output):
    """Error of the simulated motion with an effect, rad (m), and over the error without it."""

    joints: dict[str, float]
    ratio: float


class SimulatedFindingOutput(Output):
    """The simulated motion with one finding."""

    effect: str
    where: list[str]
    probability: Share
    simulated: SimulatedRatioOutput | None
    refused: str


class MotionDiagnosisOutput(Output):
    """The simulated motion with each finding and without; joints in rad (m)."""

    horizon_s: float
    closed_loop: bool
    on: Literal["test logs", "fitted logs"]
    joints: dict[str, float]
    findings: list[SimulatedFindingOutput]


class StretchOutput(Output):
    """A stretch of time, s, of a log whose first time stamp is `log_start`."""

    source: str
    start: float
    stop: float
    log_start: float


class TorqueLimitOutput(Output):
    """A torque that is at its limit for a while."""

    joint: str
    limit: NotNegative
    commanded: bool
    stretches: list[StretchOutput]


class CarriedLoadOutput(Output):
    """A body that the robot carries for a while; masses in kg."""

    joint: str
    mass: float | None
    mass_error: NotNegative | None
    stretches: list[StretchOutput]


class AlwaysMissingOutput(Output):
    """An effect that the model's own logs already show, of a robot that changed after them."""

    effect: str
    joints: list[str]
    probability: Share


class DiagnosisOutput(Output):
    """What the model lacks."""

    verdict: Verdict
    situation: Situation
    headline: HeadlineOutput
    search: SearchOutput
    probabilities: dict[str, Share]
    findings: list[FindingOutput]
    always_missing: list[AlwaysMissingOutput]
    contacts: list[ContactOutput]
    limits: list[TorqueLimitOutput]
    load: CarriedLoadOutput | None
    notes: list[str]
    description: DescriptionOutput | None
    criteria: DiagnosisCriteria
    simulated: MotionDiagnosisOutput | UnsetType = UNSET
