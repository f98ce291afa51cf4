"""The parts of a model, from records and as plain JSON values: effects, estimate, bounds, prior.

`frischid.model.model_file` reads the records and says which file is damaged where.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import msgspec
import numpy as np

from frischid.core.types import Array, Column
from frischid.effects import EFFECTS, Effect, columns_of, effect_from_dict
from frischid.errors import EmptyBoxError, InputError, UnknownNameError
from frischid.estimators.frisch import Box
from frischid.estimators.least_squares import Estimate
from frischid.estimators.urdf_prior import UrdfPrior
from frischid.logs.controller import PDController
from frischid.logs.current_gains import CurrentGains
from frischid.logs.filters import LowPass
from frischid.model.fit_record import FitRecord
from frischid.model.model_file import check_columns, damaged
from frischid.model.model_records import ControllerRecord, CurrentsRecord, ModelRecord
from frischid.robot.robot import Robot


def effects_of(record: ModelRecord, robot: Robot, source: str) -> tuple[tuple[Effect, ...], tuple[Column, ...]]:
    """The effects of a record, and the columns that they and the robot make.

    Raises
    ------
    InputError
        An effect comes from a package that is not installed, or an effect or its values are wrong.
    """
    for saved in record.effects:
        if isinstance(saved.get("package"), Mapping):
            try:
                EFFECTS.of_package(str(saved.get("effect")), saved["package"])
            except InputError as error:
                raise InputError(f"{source}: {error}") from error
    try:
        effects = tuple(effect_from_dict(e) for e in record.effects)
        return effects, tuple(columns_of(robot, effects))
    except (InputError, KeyError, TypeError, ValueError) as error:
        raise damaged(source, f"{type(error).__name__} {error} - at `effects`") from error


def estimate_of(record: ModelRecord) -> Estimate:
    """The estimate of a record."""
    p = len(record.parameters)
    shares = [x.from_data for x in record.parameters]
    known = [share for share in shares if share is not None]
    return Estimate(
        columns=tuple(Column(x.name, x.unit, x.joint, x.effect, x.sign) for x in record.parameters),
        theta=_array([x.value for x in record.parameters]),
        covariance=_array(record.covariance).reshape(p, p),
        joints=tuple(j.name for j in record.joints),
        sigma=_array([j.sigma for j in record.joints]),
        weights=_array([j.weight for j in record.joints]),
        condition=record.condition,
        estimator=record.estimator,
        information=_array(record.information).reshape(p, p),
        notes=tuple(record.notes),
        from_data=_array(known) if len(known) == len(shares) else None,
    )


def boxes_of(record: ModelRecord, source: str) -> dict[str, Box]:
    """The bounds of a record, by method.

    Raises
    ------
    InputError
        A lower bound lies above its upper bound.
    """
    names = tuple(x.name for x in record.parameters)
    boxes = {}
    for method in record.parameters[0].bounds if record.parameters else ():
        lower = _array([-np.inf if (b := x.bounds[method][0]) is None else b for x in record.parameters])
        upper = _array([np.inf if (b := x.bounds[method][1]) is None else b for x in record.parameters])
        try:
            boxes[method] = Box(names, lower, upper)
        except EmptyBoxError as error:
            raise damaged(source, f"{error} - at `parameters[].bounds.{method}`") from error
    return boxes


def parameter_dict(estimate: Estimate, i: int, bounds: Mapping[str, Box]) -> dict[str, Any]:
    """Parameter `i` of an estimate as a `ParameterRecord` has it, without ``expression`` and ``column``."""
    column = estimate.columns[i]
    return {
        "name": column.name,
        "unit": column.unit,
        "joint": column.joint,
        "effect": column.effect,
        "sign": column.sign,
        "value": float(estimate.theta[i]),
        "stderr": float(estimate.stderr[i]),
        "from_data": None if estimate.from_data is None else float(estimate.from_data[i]),
        "bounds": {k: [_or_none(box.lower[i]), _or_none(box.upper[i])] for k, box in bounds.items()},
    }


def filter_dict(lowpass: LowPass, velocity: str) -> dict[str, Any]:
    """How logs are prepared, as a `FilterRecord` has it."""
    return {
        "cutoff_hz": lowpass.cutoff,
        "reason": lowpass.reason,
        "velocity": velocity,
        "torque_lag": float(lowpass.torque_lag),
    }


def robot_dict(robot: Robot) -> dict[str, Any]:
    """The robot, its numbers as Python's own."""
    data = robot.to_dict()
    numbers = {"gravity": list(map(float, data["gravity"]))}
    return data | numbers | {"locked": plain_numbers(data["locked"]), "known": plain_numbers(data["known"])}


def robot_text(robot: Robot) -> str:
    """Everything that a robot is, as one text: equal for equal robots."""
    return json.dumps(robot_dict(robot), sort_keys=True)


def plain_numbers(values: Mapping[str, float] | None) -> dict[str, float] | None:
    """A mapping of numbers as Python's own floats."""
    return None if values is None else {name: float(x) for name, x in values.items()}


def plain_part(part: Any) -> dict[str, Any] | None:
    """A part of a model as plain JSON values; None for a part that the model has not."""
    return None if part is None else dict(part.to_dict())


def without_robot(data: dict[str, Any]) -> dict[str, Any]:
    """Every step is of the same robot: its URDF is kept once."""
    return {k: v for k, v in data.items() if k != "robot"}


def parts_of(record: ModelRecord, robot: Robot, source: str) -> dict[str, Any]:
    """Fields of a model without `robot` and `previous`.

    Raises
    ------
    InputError
        An effect is not there, or a part does not fit the robot and the effects.
    """
    effects, columns = effects_of(record, robot, source)
    check_columns(record, columns, robot.joints, source)
    return {
        "effects": effects,
        "lowpass": LowPass(record.filter.cutoff_hz, record.filter.reason, record.filter.torque_lag),
        "velocity": record.filter.velocity,
        "base": tuple(x.column for x in record.parameters),
        "expressions": tuple(x.expression for x in record.parameters),
        "estimate": estimate_of(record),
        "mean_torque": _array([j.mean_torque for j in record.joints]),
        "bounds": boxes_of(record, source),
        "reference": record.reference,
        "standard": record.standard,
        "history": tuple(record.history),
        "recursion": None if record.recursion is None else msgspec.to_builtins(record.recursion),
        "prior": None if record.prior is None else UrdfPrior.from_dict(msgspec.to_builtins(record.prior)),
        "fitted": None if record.fitted is None else FitRecord.from_dict(msgspec.to_builtins(record.fitted)),
        "controller": None if record.controller is None else controller_of(record.controller, robot, source),
        "currents": None if record.currents is None else currents_of(record.currents, robot, source),
    }


def controller_of(record: ControllerRecord, robot: Robot, source: str) -> PDController:
    """The controller of a record.

    Raises
    ------
    InputError
        A value is not usable, or of a joint that the robot does not have.
    """
    try:
        found = PDController.from_dict(msgspec.to_builtins(record))
        found.check_joints((*robot.joints, *robot.locked))
    except InputError as error:
        raise damaged(source, f"{error} - at `controller`") from error
    return found


def currents_of(record: CurrentsRecord, robot: Robot, source: str) -> CurrentGains:
    """The torque per ampere of a record.

    Raises
    ------
    InputError
        A value is not usable, or of a joint that the robot does not have.
    """
    try:
        for joint in record.gain:
            if joint not in (*robot.joints, *robot.locked):
                raise UnknownNameError("joint", joint, robot.joints)
        return CurrentGains(record.gain, record.doubt)
    except InputError as error:
        raise damaged(source, f"{error} - at `currents`") from error


def plain_estimate(
    e: Estimate, base: Sequence[int], expressions: Sequence[str], bounds: Mapping[str, Box], mean_torque: Array
) -> dict[str, Any]:
    """Parameters and joints as plain JSON values; inverse of `estimate_of` and `boxes_of`."""
    return {
        "estimator": e.estimator,
        "parameters": [
            {**parameter_dict(e, i, bounds), "expression": expressions[i], "column": int(base[i])}
            for i in range(len(base))
        ],
        "joints": [
            {"name": n, "sigma": float(s), "weight": float(w), "mean_torque": float(m)}
            for n, s, w, m in zip(e.joints, e.sigma, e.weights, mean_torque, strict=True)
        ],
        "condition": float(e.condition),
        "notes": list(e.notes),
        "covariance": e.covariance.tolist(),
        "information": e.information.tolist(),
    }


def _or_none(x: float) -> float | None:
    return float(x) if np.isfinite(x) else None


def _array(values: Any) -> Array:
    return np.array(values, dtype=float)
