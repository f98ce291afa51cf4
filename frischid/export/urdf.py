"""Export of a model as a URDF, an MJCF file, or code for a control loop.

A file is checked before it appears: a URDF is loaded again and must give the model's rigid torque. The export's notes
name every effect that a format cannot hold (rotors in a URDF). Effects for which an MJCF file has no place are in a
Python file beside it; both files are written, or none.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from frischid.core.files import check_writable, write_text, written
from frischid.core.types import Array
from frischid.errors import FrischidError, InputError, UnknownNameError
from frischid.export.actuators import actuators_csv, actuators_json
from frischid.export.code import c_source, numpy_source
from frischid.export.code_columns import CodeModel
from frischid.export.consistency import Box, Consistency, as_identified, make_consistent
from frischid.export.mjcf import mjcf_source
from frischid.export.mjcf_edit import edited_mjcf
from frischid.export.mjcf_effects import MARK, effects_source
from frischid.export.mjcf_gears import LEAST_ROTOR
from frischid.export.mjcf_share import delays, forces, share_of
from frischid.export.proofread import proofread
from frischid.export.reach import URDF_EFFECTS, beside, left_out
from frischid.model.model import Model
from frischid.robot.inertia import is_physical, pseudo_inertia, redistributed
from frischid.robot.kinematic_tree import links_of
from frischid.robot.robot import Robot
from frischid.robot.urdf_edit import UrdfText

FORMATS = {".urdf": "URDF", ".xml": "MJCF", ".c": "C", ".py": "NumPy", ".json": "actuators", ".csv": "actuators"}
STEP_FUNCTION = (
    "the torque depends on the past, so the code is a step function: call `init` once, then `step` at every sample of "
    "the control loop"
)
AGREEMENT = 1e-6  # largest relative difference of the written URDF's torque from the model's


class NotPhysicalError(FrischidError):
    """No robot can have the model's parameters; the message names the link and the way to export the model anyway."""


@dataclass(frozen=True, eq=False)
class Export:
    """An exported file.

    Attributes
    ----------
    path : Path
    format : str
        One of the values of `FORMATS`.
    model : Model
        The model as written, with physical links.
    consistency : Consistency or None
        Changes that made the model physical; None when it was physical already, or was exported with `force`.
    difference : float or None
        Relative difference of the written URDF's torque from the model's rigid part, on random states.
    notes : tuple of str
        Effects and values that the format cannot hold.
    effects_path : Path or None
        Python file beside an MJCF file, with the effects for which the XML has no place; None where the XML has all.

    Examples
    --------
    >>> import tempfile
    >>> import frischid as fr
    >>> robot = fr.Robot.load("planar2")
    >>> log = fr.simulate(robot, fr.random_fourier(robot, 5.0, seed=1), rate=100.0)
    >>> model = fr.identify(robot, [log], recursion="none").model
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     done = fr.export(model, f"{folder}/robot.urdf")
    >>> done.format, done.difference < 1e-6
    ('URDF', True)
    >>> done.notes
    ('left out of the URDF file: offset, rotor_inertia...',)
    """

    path: Path
    format: str
    model: Model
    consistency: Consistency | None
    difference: float | None
    notes: tuple[str, ...]
    effects_path: Path | None = None


def export(
    model: Model,
    path: str | Path,
    *,
    force: bool = False,
    boxes: Mapping[str, Box] | None = None,
    shapes: bool = True,
    into: str | Path | None = None,
) -> Export:
    """Write a model to a file; the suffix chooses the format: .urdf, .xml (MJCF), .c or .py (NumPy only).

    Effects for which MJCF has no place go to a Python file beside the XML, ``robot_effects.py`` beside ``robot.xml``.
    With .json or .csv, the file is a table of the drives, with ranges (`frischid.export.actuators`).

    Parameters
    ----------
    model : Model
        Made physical first unless it is physical; see `frischid.export.consistency.make_consistent`.
    path : str or Path
    force : bool
        Export even a model that is not physical, with its parameters as identified.
    boxes, shapes
        As for `frischid.export.consistency.make_consistent`.
    into : str or Path, optional
        The MJCF file that the robot was read from: the written file is this one with other numbers.

    Returns
    -------
    Export

    Raises
    ------
    NotPhysicalError
        No robot has these parameters within their bounds, and `force` is not given.
    InputError
        The suffix is unknown, the file cannot be written, or the text for it is malformed; or a file stands where the
        Python file beside an MJCF file would be written, and that file is not from frischid.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import frischid as fr
    >>> robot = fr.Robot.load("planar2")
    >>> log = fr.simulate(robot, fr.random_fourier(robot, 5.0, seed=1), rate=100.0)
    >>> model = fr.identify(robot, [log], recursion="none").model
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     done = fr.export(model, f"{folder}/control.c")
    ...     text = Path(done.path).read_text(encoding="utf-8")
    >>> "void planar2_inverse_dynamics(" in text, done.notes
    (True, ())
    """
    target = Path(path)
    if target.suffix not in FORMATS:
        raise UnknownNameError("export format", target.suffix or target.name, FORMATS)
    check_writable(target)
    if FORMATS[target.suffix] == "actuators":
        write_text(target, {".json": actuators_json, ".csv": actuators_csv}[target.suffix](model))
        return Export(target, "actuators", model, None, None, ())
    physical, consistency = _physical(model, force, boxes, shapes)
    kind, difference = FORMATS[target.suffix], None
    if kind == "URDF":
        text = urdf_source(physical)
        difference = _difference(physical, text)
        if difference > AGREEMENT and not force:
            raise InputError(
                f"{target}: not written, because the URDF's torque would differ from the model's by {difference:.1e} "
                "of its size; please report this with the model file"
            )
    elif into is not None:
        if kind != "MJCF":
            raise InputError(f"{target}: --into (into=) writes MJCF only; give the output a name that ends with .xml")
        text = edited_mjcf(physical, Path(into))
    else:
        text = {"MJCF": mjcf_source, "C": c_source, "NumPy": numpy_source}[kind](physical)
    proofread(text, kind, str(target))
    other = _written_beside(physical, target, text) if kind == "MJCF" else None
    if other is None:
        write_text(target, text)
    return Export(target, kind, physical, consistency, difference, tuple(_notes(physical, kind)), other)


def effects_path(path: Path) -> Path:
    """Name of the Python file beside an MJCF file: ``robot.xml`` -> ``robot_effects.py``."""
    return path.with_name(f"{path.stem}_effects.py")


def _written_beside(model: Model, target: Path, text: str) -> Path | None:
    """Write the MJCF file with the Python file of the effects that it lacks; None where it lacks none."""
    source, other = effects_source(model), effects_path(target)
    old = other.is_file() and MARK in other.read_text(encoding="utf-8", errors="replace")[:200]
    if source is None:
        if old:
            raise InputError(
                f"{other}: this file of an earlier export has effects that the new {target.name} has itself, so MuJoCo "
                "would apply them twice; remove it, or give the new file another name"
            )
        return None
    if other.exists() and not old:
        raise InputError(
            f"{other} was not written by frischid, and would be overwritten by the effects that {target.name} lacks; "
            "nothing was done, give the MJCF file another name"
        )
    proofread(source, "NumPy", str(other))
    with written(target) as xml, written(other) as python:
        xml.write_text(text, encoding="utf-8")
        python.write_text(source, encoding="utf-8")
    return other


def _physical(
    model: Model, force: bool, boxes: Mapping[str, Box] | None, shapes: bool
) -> tuple[Model, Consistency | None]:
    """The model with physical links, or with `force` the identified ones that are closest to the URDF's."""
    if model.standard is not None and boxes is None:
        wrong = [n for n, ok in zip(model.robot.bodies, is_physical(model.links), strict=True) if not ok]
        if wrong and not force:
            raise NotPhysicalError(
                f"the bodies behind {', '.join(wrong)} are not physical (a pseudo-inertia with a negative eigenvalue); "
                "run `frischid consistent` on the model, or export it with --force"
            )
        return model, None
    if force:
        return as_identified(model), None
    found = make_consistent(model, boxes=boxes, shapes=shapes)
    if not (found.result.reproduces and found.result.feasible):
        worst = "; ".join(f"{name} costs {share:.0f}" for name, share in found.result.blame[:3])
        raise NotPhysicalError(
            "no physical robot has these base parameters within their bounds: the nearest is "
            f"{found.unexplained:.1f} standard errors away (root mean square; χ² {found.result.misfit:.0f}, of which "
            f"{worst or 'no single link'} explains most). Is an effect missing (frischid diagnose)? --force exports "
            "the parameters as identified"
        )
    return found.model, found


def urdf_source(model: Model) -> str:
    """The robot's URDF with the model's inertials and joint friction; no other byte of the text changes.

    If a body consists of several links (fixed or locked to one another), all of them change by the same affine map, so
    that each keeps its share: see `frischid.robot.inertia.redistributed`.
    """
    robot, text = model.robot, UrdfText(model.robot.urdf)
    links = model.links if robot.transforms is None else (robot.transforms @ model.links[:, :, None])[:, :, 0]
    inertias: dict[str, Array] = {}
    for joint, theta in zip(robot.bodies, links, strict=True):
        inertias |= _parts(robot, text, joint, theta)
    damping, loss = model.of_effect("viscous", "fv"), model.of_effect("coulomb", "fc")
    dynamics = {
        joint: {
            key: max(0.0, values[joint])
            for key, values in (("damping", damping), ("friction", loss))
            if joint in values
        }
        for joint in robot.joints
    }
    return text.edited(inertias, {joint: values for joint, values in dynamics.items() if values})


def _parts(robot: Robot, text: UrdfText, joint: str, theta: Array) -> dict[str, Array]:
    """Pseudo-inertias of a body's links, each in its own frame."""
    poses = links_of(robot, joint)
    main = text.child_link(joint)
    names = [n for n in poses if n == main or text.pseudo_inertia(n).any()]
    H = np.array([poses[n] for n in names])
    old = H @ np.array([text.pseudo_inertia(n) for n in names]) @ H.transpose(0, 2, 1)
    masses = old[:, 3, 3]
    heaviest = int(masses.argmax()) if masses.any() else names.index(main)
    back = np.linalg.inv(H)
    new = back @ redistributed(old, pseudo_inertia(theta), heaviest) @ back.transpose(0, 2, 1)
    return {n: P for n, P, before in zip(names, new, old, strict=True) if P.any() or before.any()}


def _difference(model: Model, text: str) -> float:
    """Relative difference of an exported URDF's torque from the model's rigid part, on random states."""
    robot = model.robot
    exported = Robot.from_dict({**robot.to_dict(), "urdf": text, "known": {}})
    rng = np.random.default_rng(0)
    J = len(robot.joints)
    lower, upper = np.maximum(robot.limits.lower, -np.pi), np.minimum(robot.limits.upper, np.pi)
    q = rng.uniform(lower, upper, (50, J))
    v, a = rng.normal(size=(2, 50, J))
    bare = replace(model, effects=(), reference=None)
    expected = bare.inverse_dynamics(q, v, 3 * a)
    return float(np.abs(exported.inverse_dynamics(q, v, 3 * a) - expected).max() / np.abs(expected).max())


def _notes(model: Model, kind: str) -> list[str]:
    """Notes on effects and values that the format cannot hold, and on a torque that was recorded late."""
    notes = [late] if (late := model.lowpass.lag_of_a_record) else []
    if kind in ("C", "NumPy"):
        return notes + ([STEP_FUNCTION] if CodeModel.of(model).remembers else [])
    if left := left_out(model, kind):
        notes.append(f"left out of the {kind} file: {', '.join(left)}")
    if kind == "MJCF":
        return notes + _notes_of_pair(model)
    symbols = {"viscous": "fv", "coulomb": "fc"}
    negative = [
        f"{symbols[e]} of {joint} ({x:.3g})"
        for e in sorted(URDF_EFFECTS)
        for joint, x in model.of_effect(e, symbols[e]).items()
        if x < 0
    ]
    if negative:
        notes.append(f"written as zero because they are negative: {', '.join(negative)}")
    several = _of_several_links(model.robot)
    if several:
        notes.append(
            f"the bodies behind {', '.join(several)} have several links with an inertial; the links of a body were "
            "changed by one affine map, so that together they have the identified inertia"
        )
    if model.robot.locked:
        notes.append(f"identified with {', '.join(model.robot.locked)} held still: valid at those positions")
    return notes


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


def _of_several_links(robot: Robot) -> list[str]:
    """Bodies whose inertia is spread over several links of the URDF."""
    text = UrdfText(robot.urdf)
    return [j for j in robot.bodies if sum(text.pseudo_inertia(n).any() for n in links_of(robot, j)) > 1]
