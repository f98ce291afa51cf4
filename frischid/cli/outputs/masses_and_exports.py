"""Outputs about masses, gains and files made from a model: payload, gains, consistent, export."""

from __future__ import annotations

from typing import Annotated, Any, get_args

from msgspec import UNSET, Meta, UnsetType

from frischid.cli.outputs.parts import AlarmOutput, ConsistencyOutput, Output
from frischid.export.actuators import NAMES
from frischid.model.drive_parameters import Known
from frischid.model.model_records import NotNegative, Share


class EnterOutput(Output):
    """What to type at the robot's controller."""

    franka: str
    ur: str
    kuka: str


class PayloadOutput(Output):
    """A body on the robot: kg, m, kg·m² about its centre of mass; also the file that `payload -o` writes.

    Without a body the numbers are null, and `bound_95` has the largest mass that the logs leave possible.
    """

    frame: str
    carrier: str
    mass: float | None
    center_of_mass: tuple[float, float, float] | None
    inertia: tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]] | None
    bound_95: dict[str, NotNegative]
    from_log: dict[str, Share]
    nrmse: NotNegative | None
    nrmse_without: NotNegative | None
    notes: list[str]
    alarms: list[AlarmOutput]
    enter: EnterOutput | None


class GainOutput(Output):
    """Gain of one joint by three methods; `given` only where the mapping file has one."""

    joint: str
    gain: float | None
    stderr: float | None
    total_least_squares: float | None
    constrained: float | None
    given: float | UnsetType | None = UNSET


class WeighedOutput(Output):
    """The payload that the given gains would measure, kg and m."""

    mass: float
    mass_stderr: float
    centre_of_mass: list[float | None]
    relative_error: float


class GainsOutput(Output):
    """Drive gains from logs with and without a payload of `mass`, kg."""

    channel: str
    mass: float
    joints: list[GainOutput]
    samples: int
    cutoff_hz: float | None
    notes: list[str]
    payload: WeighedOutput | None


class ConsistentOutput(ConsistencyOutput):
    """Physically consistent links; `model`: the file that was written."""

    model: str | None
    alarms: list[AlarmOutput]


class ExportOutput(Output):
    """A file that was written; `difference`: of its torque from the model's."""

    file: str
    format: str
    notes: list[str]
    difference: float | None
    alarms: list[AlarmOutput]
    consistency: ConsistencyOutput | UnsetType = UNSET
    effects_file: str | UnsetType | None = UNSET


def _actuator_row() -> dict[str, Any]:
    number = {"type": ["number", "null"]}
    properties: dict[str, Any] = {"joint": {"type": "string"}}
    for name in NAMES.values():
        properties |= {name: number, f"{name}_low": number, f"{name}_high": number}
        properties[f"{name}_known"] = {"enum": list(get_args(Known))}
    properties |= {f"delay_steps{end}": number for end in ("", "_low", "_high")}
    return {"properties": properties, "required": ["joint"], "additionalProperties": False}


class ActuatorFile(Output):
    """The file that ``export`` to actuators writes: one row of plain values per joint; `step` in s."""

    robot: str
    step: float
    joints: list[Annotated[dict[str, Any], Meta(extra_json_schema=_actuator_row())]]
