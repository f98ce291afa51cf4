"""Fields of a model file of schema ``frischid.model/2``, and their types.

`frischid.model.model_file` reads and checks them.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from msgspec import Meta, Struct

NotNegative = Annotated[float, Meta(ge=0)]
Share = Annotated[float, Meta(ge=0, le=1)]
CutoffHz = Annotated[float, Meta(ge=1e-3, le=1e6)]
"""Hz. A lower cut-off needs a filter of millions of taps at usual rates; no sensor of a robot is faster."""


class RobotRecord(Struct, forbid_unknown_fields=True, frozen=True):
    """The robot, with the text of its URDF."""

    name: str
    source: str
    urdf: str
    gravity: tuple[float, float, float]
    locked: dict[str, float]
    frames: str | dict[str, str]
    known: dict[str, float]


class FilterRecord(Struct, forbid_unknown_fields=True, frozen=True):
    """How logs are filtered; time by which their torque is late, s."""

    cutoff_hz: CutoffHz | None
    reason: str
    velocity: Literal["auto", "measured", "derived"]
    torque_lag: Annotated[float, Meta(ge=-1, le=1)] = 0.0


class ParameterRecord(Struct, forbid_unknown_fields=True, frozen=True):
    """One base parameter: its column of the regressor, its value and its bounds (null where open)."""

    name: str
    expression: str
    unit: str
    joint: str
    effect: str
    sign: Literal[-1, 0, 1]
    column: Annotated[int, Meta(ge=0)]
    value: float
    stderr: NotNegative
    bounds: dict[str, tuple[float | None, float | None]]
    from_data: Share | None = None


class JointRecord(Struct, forbid_unknown_fields=True, frozen=True):
    """One joint whose torque was fitted."""

    name: str
    sigma: NotNegative
    weight: NotNegative
    mean_torque: float


class EmptiedRecord(Struct, forbid_unknown_fields=True, frozen=True):
    """Where the bounding-box recursion contradicted itself."""

    parameter: str
    window: int | None


class RecursionRecord(Struct, forbid_unknown_fields=True, frozen=True):
    """How the bounds of the bounding-box recursion closed in."""

    names: list[str]
    units: list[str]
    variant: str
    windows: int
    emptied: EmptiedRecord | None
    steps: list[int]
    lower: list[list[float | None]]
    upper: list[list[float | None]]


class PriorParameterRecord(Struct, forbid_unknown_fields=True, frozen=True):
    """Prior of one parameter, its value given the logs, and the share of its knowledge that came from the logs."""

    name: str
    mean: float
    spread: NotNegative
    negative: NotNegative
    nonnegative: bool
    group: str
    value: float
    from_log: Share


class PriorRecord(Struct, forbid_unknown_fields=True, frozen=True):
    """The URDF as a prior, and how many rows the data of each joint counted for."""

    kind: Literal["urdf"]
    rows: Annotated[float, Meta(gt=0)]
    scales: dict[str, Annotated[float, Meta(gt=0)]]
    parameters: list[PriorParameterRecord]


class FitFields(Struct, forbid_unknown_fields=True, frozen=True):
    """Reach of the fitted logs, the URDF with fitted friction, and quantiles of the error on stretches left out."""

    velocity: list[NotNegative]
    acceleration: list[NotNegative]
    urdf: list[float]
    scores: list[list[NotNegative | None]]
    model_share: list[Share] = []
    spread: list[NotNegative | None] = []


class ControllerRecord(Struct, forbid_unknown_fields=True, frozen=True, omit_defaults=True):
    """The controller that makes torques of commands: values of all joints, or by joint."""

    kp: float | dict[str, float] | None = None
    kd: float | dict[str, float | None] | None = 0.0
    limit: float | dict[str, float] | None = None
    dead_band: float | dict[str, float] = 0.0
    delay: float | dict[str, float] = 0.0
    kp_doubt: float | dict[str, float] = 0.0
    delay_doubt: float | dict[str, float] = 0.0
    kd_near: float | dict[str, float] = 0.0
    delay_told: float | None = None
    held: bool = False


class CurrentsRecord(Struct, forbid_unknown_fields=True, frozen=True):
    """Torque per ampere of joints, and the doubt about it as a share, by joint."""

    gain: dict[str, float]
    doubt: dict[str, NotNegative] = {}


class EventLogRecord(Struct, frozen=True):
    """One log of a step: where it was, and its hash."""

    source: str
    sha256: str | None
    samples: Annotated[int, Meta(ge=0)] | None = None


class AlarmRecord(Struct, forbid_unknown_fields=True, frozen=True):
    """One alarm of an identification."""

    id: str
    severity: Literal["severe", "doubt"]
    sentence: str
    remedy: str
    joints: list[str] = []
    value: float | None = 0.0
    limit: float = 0.0


class ErrorRecord(Struct, frozen=True):
    """A headline of a step; `frischid.model.headline` reads the rest of it."""

    nrmse: NotNegative


class EventRecord(Struct, frozen=True):
    """One step of the history: the fields that are read again. A step may hold more."""

    action: str
    effects: list[str] = []
    logs: list[EventLogRecord] = []
    test_logs: list[EventLogRecord] = []
    cross_validated: ErrorRecord | None = None
    error_before: NotNegative | None = None
    error_after: NotNegative | None = None
    test: ErrorRecord | None = None
    test_before: NotNegative | None = None
    measured_on: str = ""
    sentence: str = ""
    notes: list[str] = []
    warnings: list[str] = []
    unpredicted: list[str] = []
    alarms: list[AlarmRecord] = []


class ModelRecord(Struct, forbid_unknown_fields=True, frozen=True):
    """A model file, or one of the steps before it (`previous`, which has no robot of its own)."""

    schema: str
    frischid: str
    effects: list[dict[str, Any]]
    filter: FilterRecord
    estimator: str
    parameters: list[ParameterRecord]
    joints: Annotated[list[JointRecord], Meta(min_length=1)]
    condition: NotNegative
    notes: list[str]
    reference: dict[str, float] | None
    history: list[dict[str, Any]]
    covariance: list[list[float]]
    information: list[list[float]]
    previous: Annotated[dict[str, Any], Meta(extra_json_schema={"$ref": "#/$defs/ModelRecord"})] | None
    robot: RobotRecord | None = None
    standard: dict[str, float] | None = None
    recursion: RecursionRecord | None = None
    prior: PriorRecord | None = None
    fitted: FitFields | None = None
    controller: ControllerRecord | None = None
    currents: CurrentsRecord | None = None
    sha256: str | None = None
