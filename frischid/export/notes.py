"""Notes on an exported file: the effects and values that its format cannot hold, and where they are instead.

A reader of the file alone would take a missing effect for an effect that the robot does not have.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from frischid.export.code_columns import CodeModel
from frischid.export.consistency import unmeasured_friction
from frischid.export.mjcf_gears import LEAST_ROTOR
from frischid.export.mjcf_share import delays, forces, share_of
from frischid.export.reach import URDF_EFFECTS, beside, left_out
from frischid.export.urdf import of_several_links
from frischid.model.drive_parameters import drive_parameters
from frischid.model.model import Model
from frischid.robot.mjcf_reading import gravity_of_mjcf
from frischid.robot.robot import GRAVITY

STEP_FUNCTION = (
    "the torque depends on the past, so the code is a step function: call `init` once, then `step` at every sample of "
    "the control loop"
)
ATTRIBUTES = {"armature": "armature", "viscous": "damping", "coulomb": "frictionloss"}
"""Quantity of the table of drives -> the attribute of a joint that MJCF has for it."""
DIGITS = 3
"""Significant digits of a value in a note. Values that agree to so many digits are the same to a reader."""


def notes_of(model: Model, kind: str, identified: Model) -> list[str]:
    """Notes on values that were not measured or that the format cannot hold, and on a torque that was recorded late.

    `identified` is the model before its links were made physical; its drives stand in the table of drives.
    """
    notes = unmeasured_friction(identified)
    notes += [late] if (late := model.lowpass.lag_of_a_record) else []
    if kind in ("C", "NumPy"):
        return notes + ([STEP_FUNCTION] if CodeModel.of(model).remembers else [])
    if left := left_out(model, kind):
        notes.append(f"left out of the {kind} file: {', '.join(left)}")
    if kind == "MJCF":
        return notes + _notes_of_pair(model) + _other_drives(identified, share_of(model).joints)
    symbols = {"viscous": "fv", "coulomb": "fc"}
    negative = [
        f"{symbols[e]} of {joint} ({x:.3g})"
        for e in sorted(URDF_EFFECTS)
        for joint, x in model.of_effect(e, symbols[e]).items()
        if x < 0
    ]
    if negative:
        notes.append(f"written as zero because they are negative: {', '.join(negative)}")
    several = of_several_links(model.robot)
    if several:
        notes.append(
            f"the bodies behind {', '.join(several)} have several links with an inertial; the links of a body were "
            "changed by one affine map, so that together they have the identified inertia"
        )
    if model.robot.locked:
        notes.append(f"identified with {', '.join(model.robot.locked)} held still: valid at those positions")
    if not np.allclose(model.robot.gravity, GRAVITY):
        notes.append(
            f"a URDF holds no gravity: the model's is {_vector(model)} m/s² in the base; set the same where you load it"
        )
    friction = {"damping": model.of_effect("viscous", "fv"), "frictionloss": model.of_effect("coulomb", "fc")}
    written = {j: {key: values[j] for key, values in friction.items() if j in values} for j in model.joints}
    return notes + _other_drives(identified, written)


def note_on_gravity(model: Model, into: Path) -> tuple[str, ...]:
    """A note where the user's own MJCF file keeps another gravity than the model has."""
    own = gravity_of_mjcf(into) or GRAVITY
    if np.allclose(model.robot.gravity, own):
        return ()
    return (f"{into.name} keeps its own gravity; the model's is {_vector(model)} m/s²: set <option gravity> to it",)


def _vector(model: Model) -> str:
    return f"({', '.join(f'{x:.4g}' for x in model.robot.gravity)})"


def _notes_of_pair(model: Model) -> list[str]:
    """Which effects are in the XML, which are in the Python file, and what is no force."""
    rest, late = beside(model), delays(model)
    out = (*rest, *left_out(model, "MJCF"))
    ids = dict.fromkeys(e.id for e in forces(model).effects if str(e) not in out)
    notes = [f"in the XML: {', '.join(ids) or 'no effect'}"]
    share = share_of(model)
    if gears := share.gears:
        named = ", ".join(gear.name for train in gears.values() for gear in train.gears)
        notes.append(
            f"added joints, each in the body and on the axis of its motor's joint: {named}. The motor's joint has the "
            "encoder's angle; the link's angle is the sum of both"
        )
        light = [joint for joint, train in gears.items() if share.joints[joint]["armature"] == train.rotor]
        if light:
            notes.append(
                f"armature of {', '.join(light)}: {100 * LEAST_ROTOR:g} % of the link's inertia, because the model has "
                "no rotor inertia there, and a motor before a gear needs one"
            )
    if rest:
        notes.append(f"in the Python file beside it: {', '.join(rest)}")
    if late:
        said = ", ".join(f"{name} {1e3 * x:.1f} ms" for name, x in late.items())
        notes.append(
            f"in neither file, because a late record of the torque is no force on the robot: {said}; to replay "
            "a recorded torque, read the record ahead by this time"
        )
    return notes


def _other_drives(identified: Model, written: dict[str, dict[str, float]]) -> list[str]:
    """How far values of the joints in the file are from the table of drives, where they differ.

    The file has one set of values that fits physical links. The table has each value as the logs show it.
    """
    far = []
    for x in drive_parameters(identified):
        here = written.get(x.joint, {}).get(ATTRIBUTES.get(x.quantity, ""))
        width = max(x.upper - x.value, x.value - x.lower)
        if here is None or not 0 < width < np.inf:
            continue
        table, file = (f"{value:.{DIGITS}g}" for value in (x.value, here))
        if table != file:
            said = f"{x.quantity} of {x.joint}, {table} in the table and {file} {x.unit} here"
            far.append((abs(here - x.value) / width, said))
    if not far:
        return []
    return [
        "this file holds drive values that fit its physical links; an export to .json or .csv writes the identified "
        f"values. The largest difference, as a share of the 95 % range: {max(far)[1]}"
    ]
