"""A table of a model's drives for the actuator configuration of simulators, with ranges to randomise over.

One row per joint: stiffness (kp) and damping (kd) of the drive, armature, viscous and Coulomb friction of the joint,
effort limit, and delay, also in steps of the simulator. Each value has ``_low`` and ``_high``: the 95 % range. A value
that the logs leave open has a wide range, and this range is the honest domain randomisation. A value without a largest
one, because the drive's gain has none, has no ``_high`` (null in JSON, empty in CSV).
"""

from __future__ import annotations

import csv
import io
import json
from typing import Any

import numpy as np

from frischid.errors import InputError
from frischid.export.names import cell
from frischid.model.drive_parameters import DriveParameter, drive_parameters
from frischid.model.model import Model

NAMES = {
    "torque_per_ampere": "torque_per_ampere",
    "stiffness": "stiffness",
    "damping": "damping",
    "armature": "armature",
    "viscous": "viscous_friction",
    "coulomb": "friction",
    "effort_limit": "effort_limit",
    "delay": "delay",
}
"""Quantity -> its name in simulators."""
SIMULATOR_STEP = 0.005
"""s. Usual step of simulators for learning, in which the delay is counted unless the caller names another."""


def actuator_rows(model: Model, step: float = SIMULATOR_STEP) -> list[dict[str, Any]]:
    """One row per joint, as plain values.

    Parameters
    ----------
    step : float
        The simulator's step, s, in which the delay is counted.

    Raises
    ------
    InputError
        The step is not positive, or the model has no drive parameters.
    """
    if not 0 < step < np.inf:
        raise InputError(f"the simulator's step must be a positive time in s, got {step}")
    by_joint: dict[str, list[DriveParameter]] = {}
    for x in drive_parameters(model):
        by_joint.setdefault(x.joint, []).append(x)
    if not by_joint:
        raise InputError("the model has neither friction, armature nor a controller: there is no actuator to write")
    rows = []
    for joint, values in by_joint.items():
        row: dict[str, Any] = {"joint": joint}
        for x in values:
            name = NAMES[x.quantity]
            high = x.upper if np.isfinite(x.upper) else None
            row |= {name: x.value, f"{name}_low": x.lower, f"{name}_high": high, f"{name}_known": x.known}
        if "delay" in row:
            row |= {f"delay_steps{end}": row[f"delay{end}"] / step for end in ("", "_low", "_high")}
        rows.append(row)
    return rows


def actuators_json(model: Model, step: float = SIMULATOR_STEP) -> str:
    """The table as JSON: the robot, the simulator's step, and a list of joints."""
    content = {"robot": model.robot.name, "step": step, "joints": actuator_rows(model, step)}
    return json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def actuators_csv(model: Model, step: float = SIMULATOR_STEP) -> str:
    """The table as CSV, one line per joint."""
    rows = actuator_rows(model, step)
    names = list(dict.fromkeys(name for row in rows for name in row))
    text = io.StringIO()
    writer = csv.DictWriter(text, names, lineterminator="\n")
    writer.writeheader()
    writer.writerows(row | {"joint": cell(row["joint"])} for row in rows)
    return text.getvalue()
