"""Outputs about models: identify, compare, add, improve, history, report, demo."""

from __future__ import annotations

from typing import Literal

from msgspec import UNSET, UnsetType

from frischid.cli.outputs.diagnoses import DiagnosisOutput
from frischid.cli.outputs.parts import (
    AlarmOutput,
    ComparisonOutput,
    DriveOutput,
    FittedParameterOutput,
    HeadlineOutput,
    MotionErrorOutput,
    Output,
    ReachOutput,
    StepErrorOutput,
    TorqueLagOutput,
)
from frischid.diagnosis.criteria import DiagnosisCriteria
from frischid.diagnosis.situation import Situation
from frischid.estimators.urdf_prior import PriorCriteria
from frischid.forward.shooting import OutputErrorOptions
from frischid.logs.log_file import LogFile
from frischid.model.alarms import AlarmCriteria
from frischid.model.identification_criteria import IdentificationCriteria
from frischid.model.model_records import ControllerRecord, CurrentsRecord, NotNegative, PriorRecord

Pair = tuple[float, float]


class AmperesOutput(Output):
    """What one joint draws, A: value and standard error, or null; `holding`: least and largest current of gravity."""

    joint: str
    viscous: Pair | None
    coulomb: Pair | None
    armature: Pair | None
    holding: Pair


class FrischOutput(Output):
    """The bounds of the Frisch scheme."""

    same_orthant: bool
    changing_sign: list[str]
    exact: bool


class EmptiedOutput(Output):
    """Where the bounding-box recursion contradicted itself."""

    parameter: str
    lower: float
    upper: float
    window: int


class RecursionOutput(Output):
    """The bounding-box recursion."""

    variant: str
    windows: int
    skipped: int
    emptied: EmptiedOutput | None


class SpeedRangeOutput(Output):
    """Multiples of the fitted logs' speed: at which the error is expected to double, and that the URDF allows."""

    doubles: float
    allowed: float


class IdentifyOutput(Output):
    """A model that was identified; the model file holds the rest."""

    robot: str
    samples: int
    cutoff_hz: float | None
    rank: int
    gap: float
    merging_cost: float
    condition: float
    estimator: str
    controller: ControllerRecord | None
    currents: CurrentsRecord | None
    amperes: list[AmperesOutput]
    drives: list[DriveOutput]
    parameters: list[FittedParameterOutput]
    prior: PriorRecord | None
    frisch: FrischOutput | None
    bbrf: RecursionOutput | None
    headline: HeadlineOutput | None
    cross_validation: dict[str, float]
    comparison: ComparisonOutput | None
    alarms: list[AlarmOutput]
    torque_lag: TorqueLagOutput | None
    speed_range: SpeedRangeOutput | None
    notes: list[str]
    warnings: list[str]


class HeldOutMotionOutput(Output):
    """Simulated motion on test logs, by the linear answer and by output error."""

    linear: MotionErrorOutput
    output_error: MotionErrorOutput


class MovedOutput(Output):
    """A model fitted to the simulated motion: `identify --estimator output_error`."""

    headline: HeadlineOutput
    position_error_over_linear: float
    singular_values: list[float]
    kept_parameters: list[str]
    variance_inflation: float
    held_out: HeldOutMotionOutput | None
    parameters: list[FittedParameterOutput]


class CompareOutput(Output):
    """A model compared with logs; `simulated` only with --simulate."""

    headline: HeadlineOutput
    comparison: ComparisonOutput
    simulated: MotionErrorOutput | UnsetType = UNSET


class AddOutput(Output):
    """A model with one more effect."""

    effect: str
    headline: HeadlineOutput | None
    step: StepErrorOutput
    exports: dict[str, ReachOutput]
    model: str


class ImproveStepOutput(StepErrorOutput):
    """One step of an improvement."""

    effect: str
    joints: list[str]


class ImproveOutput(Output):
    """A model with the effects that were found missing; `last`: the diagnosis after the last step."""

    headline: HeadlineOutput
    steps: list[ImproveStepOutput]
    exports: dict[str, ReachOutput]
    criteria: DiagnosisCriteria
    last: DiagnosisOutput


class StepLogOutput(Output):
    """One log of a step: its hash, and its file where it came from one."""

    source: str
    sha256: str | None
    samples: int | UnsetType | None = UNSET
    file: LogFile | UnsetType = UNSET


class StepPriorOutput(Output):
    """The prior of a step; `rows`: rows that the data of each joint counted for."""

    kind: Literal["urdf"]
    rows: float
    scales: dict[str, float]


class StepCriteriaOutput(Output):
    """Every number that decided in `identify`."""

    identification: IdentificationCriteria
    prior: PriorCriteria
    alarms: AlarmCriteria


class HistoryStepOutput(Output):
    """One step of a model, as its file holds it (`history` of the model file); each action has its own keys."""

    action: Literal["identify", "identify fleet", "output_error", "add", "consistent"]
    effects: list[str]
    logs: list[StepLogOutput]
    test_logs: list[StepLogOutput] | UnsetType = UNSET
    cross_validated: HeadlineOutput | UnsetType = UNSET
    test: HeadlineOutput | UnsetType = UNSET
    test_before: NotNegative | UnsetType = UNSET
    error_before: NotNegative | UnsetType | None = UNSET
    error_after: NotNegative | UnsetType | None = UNSET
    measured_on: str | UnsetType = UNSET
    situation: Situation | UnsetType = UNSET
    sentence: str | UnsetType = UNSET
    torque_lag: TorqueLagOutput | UnsetType = UNSET
    speed_range: SpeedRangeOutput | UnsetType = UNSET
    prior: StepPriorOutput | UnsetType = UNSET
    criteria: StepCriteriaOutput | UnsetType = UNSET
    robots: int | UnsetType = UNSET
    log_count: int | UnsetType = UNSET
    first_log: str | UnsetType = UNSET
    samples: int | UnsetType = UNSET
    different: list[str] | UnsetType = UNSET
    kept: list[str] | UnsetType = UNSET
    options: OutputErrorOptions | UnsetType = UNSET
    misfit: float | UnsetType = UNSET
    largest_change_in_standard_errors: float | UnsetType = UNSET
    active: list[tuple[str, str]] | UnsetType = UNSET
    notes: list[str] | UnsetType = UNSET
    warnings: list[str] | UnsetType = UNSET
    alarms: list[AlarmOutput] | UnsetType = UNSET
    unpredicted: list[str] | UnsetType = UNSET


class HistoryOutput(Output):
    """The steps of a model."""

    headline: HeadlineOutput | None
    steps: list[HistoryStepOutput]


class QualityOutput(Output):
    """One log of a report: rate in Hz, steps in s, ranges of the joints in SI units."""

    source: str
    samples: int
    seconds: NotNegative
    rate: float
    steps: Pair
    gaps: int
    kept: float
    noise: dict[str, list[float | None]]
    lower: list[float]
    upper: list[float]
    speed: list[float]
    acceleration: list[float]
    standstill: list[float]
    notes: list[str]
    warnings: list[str]


class BesideOutput(Output):
    """Errors of several models on the same logs."""

    logs: list[str]
    seen: bool
    nrmse: dict[str, NotNegative]
    joints: dict[str, dict[str, NotNegative]]


class ReportOutput(Output):
    """A report that was written; `beside` only with several models."""

    report: str
    bytes: int
    headline: HeadlineOutput
    held_out: list[str]
    warnings: list[str]
    diagnosis: DiagnosisOutput | None
    logs: list[QualityOutput]
    beside: BesideOutput | UnsetType = UNSET


class HiddenOutput(Output):
    """The second part of the demonstration: an effect that the model knows nothing of."""

    truth: str
    diagnosis: DiagnosisOutput
    headline: HeadlineOutput | None


class DemoOutput(IdentifyOutput):
    """The demonstration: an identification, and a hidden effect."""

    report: str
    hidden: HiddenOutput
