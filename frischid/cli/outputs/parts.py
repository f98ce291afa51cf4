"""Objects that several outputs share: headline, alarms, comparison, parameters, physical consistency."""

from __future__ import annotations

from typing import Literal

from msgspec import UNSET, Struct, UnsetType

from frischid.model.comparison_criteria import ComparisonCriteria
from frischid.model.drive_parameters import Known
from frischid.model.headline import Measured
from frischid.model.model_records import NotNegative, ParameterRecord, Share


class Output(Struct, forbid_unknown_fields=True):
    """An object without further keys."""


class AlarmOutput(Output):
    """One reason not to trust a model, or an error; `value` is null where there is no finite figure."""

    id: str
    severity: Literal["severe", "doubt"]
    sentence: str
    remedy: str
    joints: list[str]
    value: float | None
    limit: float


class HeadlineOutput(Output):
    """The model's one error, and the errors beside it (NRMSE, mean over the joints)."""

    nrmse: NotNegative
    grade: str
    measured: Measured
    noise_floor: NotNegative
    urdf_nrmse: NotNegative
    constant_nrmse: NotNegative
    logs: list[str]
    joints: dict[str, NotNegative]
    alarms: list[AlarmOutput]


class ConditionOutput(Output):
    """Error of a joint (N·m, N) in one condition, over its error otherwise."""

    joint: str
    condition: str
    ratio: float
    rmse: NotNegative
    samples: int
    p_value: Share


class WorstOutput(Output):
    """The sample with the largest error: log, time in s, torque in N·m (N)."""

    source: str
    t: float
    measured: float
    predicted: float


class JointErrorOutput(Output):
    """Error of one joint: rmse, bias and std in N·m (N); correlation_time in s."""

    rmse: NotNegative
    nrmse: NotNegative
    fit: float
    bias: float
    std: NotNegative
    nominal_nrmse: NotNegative
    constant_nrmse: NotNegative
    noise_floor: NotNegative
    expected_nrmse: float | None
    correlation_time: float | None
    white: bool
    depends_on: dict[str, float]
    worst: WorstOutput


class ComparisonOutput(Output):
    """A model against logs."""

    nrmse: NotNegative
    noise_floor: NotNegative
    nominal_nrmse: NotNegative
    constant_nrmse: NotNegative
    samples: int
    poses: int
    standstill_share: Share
    nrmse_with_standstill: NotNegative
    logs: list[str]
    not_compared: list[str]
    alarms: list[AlarmOutput]
    conditions: list[ConditionOutput]
    criteria: ComparisonCriteria
    joints: dict[str, JointErrorOutput]


class HorizonOutput(Output):
    """Error of the simulated motion after a time (null: along the whole logs); null where it became unstable."""

    horizon_s: float | None
    starts: int
    joints: dict[str, float | None]
    urdf_joints: dict[str, float | None]
    tip_mm: float | None
    urdf_tip_mm: float | None


class MotionErrorOutput(Output):
    """Simulated against measured motion; joints in rad (m)."""

    horizons: list[HorizonOutput]
    whole: HorizonOutput
    tip_joint: str
    logs: list[str]
    closed_loop: bool


class StepErrorOutput(Output):
    """NRMSE before and after a step; test errors are null without test logs."""

    error_before: NotNegative
    error_after: NotNegative
    measured_on: str
    test_before: float | None
    test_after: float | None


class ReachOutput(Output):
    """What one format holds of a model."""

    whole: bool
    without: list[str]
    refused: list[str]
    steps: bool
    beside: list[str]


class LagOfJointOutput(Output):
    """Lag of one joint's torque and its standard error, s."""

    name: str
    lag: float
    error: NotNegative
    significant: bool


class TorqueLagOutput(Output):
    """Lag of the torque behind the motion, its standard error, the sampling step, and what the model takes back, s."""

    lag: float
    error: NotNegative
    step: float
    p_value: Share
    joints: list[LagOfJointOutput]
    differing: list[str]
    significant: bool
    sampling_steps: float
    taken: float
    sampling: bool
    said: str
    warning: str


class DriveOutput(Output):
    """One drive parameter with its bounds, and how well the logs know it."""

    joint: str
    quantity: str
    unit: str
    value: float
    lower: float | None
    upper: float | None
    known: Known
    of: str


class FittedParameterOutput(ParameterRecord, frozen=True):
    """One base parameter as in the model file; `true` only where a simulation knows the truth."""

    true: float | UnsetType = UNSET


class ActiveOutput(Output):
    """A condition of physical consistency that holds with equality."""

    where: str
    constraint: str


class BlameOutput(Output):
    """Share of one link in the misfit (χ²)."""

    where: str
    misfit: float


class ConsistencyOutput(Output):
    """Links that a body can have, near the base parameters; standard parameters by name, SI units."""

    feasible: bool
    reproduces: bool
    misfit: float
    change_in_standard_errors: dict[str, float]
    least_eigenvalue: dict[str, float]
    divergence: dict[str, float]
    active: list[ActiveOutput]
    blame: list[BlameOutput]
    boxes: dict[str, tuple[list[float], list[float]]]
    free_masses: list[str]
    free_parameters: dict[str, list[str]]
    standard: dict[str, float]
    notes: list[str]
