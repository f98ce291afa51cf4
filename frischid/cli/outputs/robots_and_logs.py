"""Outputs of the commands that fit no model: on robots, logs and motions, effects, the paper and the installation."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from msgspec import UNSET, Meta, UnsetType

from frischid.checks.check_criteria import CheckCriteria
from frischid.checks.log_issue import Sureness
from frischid.cli.outputs.parts import Output
from frischid.logs.mapping_rules import mapping_schema
from frischid.model.model_records import NotNegative, Share


class RobotJointOutput(Output):
    """One joint; its limits in rad, rad/s, N·m (m, m/s, N), null where the URDF states none."""

    name: str
    number: int
    kind: Literal["prismatic", "revolute"]
    lower: float | None
    upper: float | None
    velocity: float | None
    effort: float | None


class BaseParameterOutput(Output):
    """One base parameter and the standard parameters that it stands for."""

    name: str
    expression: str
    unit: str
    joint: str
    effect: str


class RobotOutput(Output):
    """A robot and its identifiable parameters; gravity in m/s²."""

    name: str
    source: str
    gravity: tuple[float, float, float]
    joints: list[RobotJointOutput]
    mimic: list[str]
    locked: dict[str, float]
    effects: list[str]
    rank: int
    gap: float
    merging_cost: float
    base_parameters: list[BaseParameterOutput]
    identifiable_alone: list[str]
    identifiable_in_combination: list[str]
    not_identifiable: list[str]


class DatasetOutput(Output):
    """One public data set."""

    name: str
    title: str
    licence: str
    page: str
    files: int


class FetchedOutput(Output):
    """A data set that was fetched; `logs`: the files that were written."""

    name: str
    about: str
    logs: list[str]


MappingFile = Annotated[dict[str, Any], Meta(extra_json_schema=mapping_schema())]
"""The tables of a mapping file; the type of a key comes from the rules that the reader has."""


class MapOutput(Output):
    """A proposed mapping file, and the reasons."""

    mapping: MappingFile
    reasons: list[str]
    missing: list[str]
    guesses: list[str]


class FaultOutput(Output):
    """One fault of a hypothesis, and its joints."""

    kind: str
    joints: list[str]


class ExplanationOutput(Output):
    """The faults that explain the torques best, their probability, and what explains the torques nearly as well."""

    faults: list[FaultOutput]
    probability: Share
    runner_up: list[tuple[str, list[str]]]


class IssueOutput(Output):
    """One fault of a log, with its remedy; `blocks`: no identification is possible."""

    kind: str
    what: str
    where: list[str]
    sure: Sureness
    advice: str
    blocks: bool


class JointFiguresOutput(Output):
    """Figures of one joint of a log: noise in the channel's unit, lags in s; a figure may be missing."""

    noise_q: float | UnsetType = UNSET
    noise_v: float | UnsetType = UNSET
    noise_a: float | UnsetType = UNSET
    noise_tau: float | UnsetType = UNSET
    velocity_lag: float | UnsetType = UNSET
    velocity_factor: float | UnsetType = UNSET
    standstill: float | UnsetType = UNSET
    torque_lag: float | UnsetType = UNSET
    nominal_nrmse: float | UnsetType = UNSET
    friction_nrmse: float | UnsetType = UNSET
    free_nrmse: float | UnsetType = UNSET


class CheckedLogOutput(Output):
    """One log: figures (those that could be measured), issues, warnings. Times in s, steps in ms."""

    log: str
    joint_figures: dict[str, JointFiguresOutput]
    issues: list[IssueOutput]
    warnings: list[str]
    blocked: bool
    samples: int | UnsetType = UNSET
    seconds: float | UnsetType = UNSET
    rate_hz: float | UnsetType = UNSET
    mean_rate_hz: float | UnsetType = UNSET
    steps_ms: tuple[float, float, float] | UnsetType = UNSET
    repeated_share: float | UnsetType = UNSET
    comes_again_after: float | UnsetType = UNSET
    repeated_seconds: float | UnsetType = UNSET
    gaps: int | UnsetType = UNSET
    bad_lines: int | UnsetType = UNSET
    missing_share: float | UnsetType = UNSET
    jitter: float | UnsetType = UNSET
    stamps_follow: float | UnsetType = UNSET
    stamps_follow_error: float | UnsetType = UNSET
    channels: list[str] | UnsetType = UNSET
    nominal: str | UnsetType = UNSET
    explanation: ExplanationOutput | UnsetType = UNSET
    torque_lag: float | UnsetType = UNSET
    torque_lag_error: float | UnsetType = UNSET
    rigid_parameters: int | UnsetType = UNSET
    unseen_parameters: list[str] | UnsetType = UNSET
    joints: list[str] | UnsetType = UNSET
    notes: list[str] | UnsetType = UNSET
    poses: int | UnsetType = UNSET


class CheckOutput(Output):
    """Logs checked; `correction`: text of a mapping file that undoes faults."""

    logs: list[CheckedLogOutput]
    ok: bool
    correction: str
    robot_correction: list[str]
    criteria: CheckCriteria


class CutOutput(Output):
    """A part of a log that was written."""

    output: str
    samples: int
    seconds: float


class PeakOutput(Output):
    """Largest value of one quantity of one joint, against its limit (null: the URDF states none)."""

    joint: str
    kind: str
    value: float
    limit: float | None


class NearestOutput(Output):
    """Smallest distance of two bodies on the motion and the margin that is asked, m; when, s."""

    bodies: str
    distance: float | None
    margin: float
    time: float


class SeparateOutput(Output):
    """How well a motion separates two effects."""

    effects: tuple[str, str]
    standard_errors_smaller_by: float
    correlation: float
    correlation_of_random_motions: float


class PlanOutput(Output):
    """A planned motion; times in s."""

    criterion: str
    cost: float
    evaluations: int
    seconds: NotNegative
    inflation: dict[str, float]
    violations: list[str]
    seconds_of_motion: NotNegative
    approach_seconds: NotNegative
    return_seconds: NotNegative
    peaks: list[PeakOutput]
    nearest: NearestOutput | None
    notes: list[str]
    output: str
    picture: str | None
    separate: SeparateOutput | UnsetType = UNSET
    standard_errors_smaller_by: dict[str, float] | UnsetType = UNSET


class SimulateOutput(Output):
    """A simulated log that was written."""

    output: str
    samples: int
    seconds: float
    rate_hz: float
    joints: list[str]


class PackageOutput(Output):
    """The package that an effect comes from; without a package, its module."""

    name: str | UnsetType = UNSET
    version: str | UnsetType = UNSET
    module: str | UnsetType = UNSET


Plain = bool | int | float | str | None


class EffectOutput(Output):
    """One effect of the catalogue; `parameters`: its shape parameters with their defaults."""

    effect: str
    title: str
    equation: str
    symbols: dict[str, str]
    sentence: str
    looks_like: str
    confused_with: list[str]
    confirmed_by: str
    reference: str
    parameters: dict[str, Plain | list[Plain]]
    package: PackageOutput | None


class MissingOutput(Output):
    """Packages of an optional part that are not installed."""

    missing: list[str]


class TrialOutput(Output):
    """One trial of the self-test."""

    name: str
    passed: bool
    detail: str
    seconds: NotNegative


class DoctorOutput(Output):
    """The state of an installation; a package that is missing has the version null."""

    frischid: str
    python: str
    platform: str
    cores: int | None
    packages: dict[str, str | None]
    optional: dict[str, MissingOutput]
    self_test: list[TrialOutput]
    passed: bool


class SpreadOutput(Output):
    """Mean and standard deviation over the runs, one of each per column of the table."""

    mean: list[float | None]
    deviation: list[float | None]


PaperNumbers = dict[str, bool | float | list[float | None] | SpreadOutput | None]


class PaperTableOutput(Output):
    """Figures of one table of the paper, by their names there: a list of rows, or numbers by name."""

    numbers: dict[str, list[float | dict[str, Plain] | None] | PaperNumbers | None]
    notes: list[str]


class PaperFigureOutput(Output):
    """One figure of the paper, and how to read it."""

    title: str
    reading: str


class PaperOutput(Output):
    """The paper's tables, computed again; also the file that `frischid paper -o` writes."""

    schema: Literal["frischid.paper/1"]
    points: str
    authors_points: bool
    runs: int
    tables: dict[str, PaperTableOutput]
    figures: list[PaperFigureOutput]


class PracticeOutput(Output):
    """The practice folder."""

    folder: str
    files: list[str]


class StudioOutput(Output):
    """A studio that is ready."""

    address: str
    output: str
    warnings: list[str]
