"""Export of a model as a URDF, an MJCF file, code for a control loop, or a table of the drives.

A file is checked before it appears: a URDF is loaded again and must give the model's rigid torque. The export's notes
name every effect that a format cannot hold (rotors in a URDF). Effects for which an MJCF file has no place are in a
Python file beside it; both files are written, or none.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from frischid.core.files import check_writable, write_text, written
from frischid.errors import FrischidError, InputError, UnknownNameError
from frischid.export.actuators import SIMULATOR_STEP, actuators_csv, actuators_json
from frischid.export.code import c_source, numpy_source
from frischid.export.consistency import Box, Consistency, as_identified, make_consistent
from frischid.export.mjcf import mjcf_source
from frischid.export.mjcf_edit import edited_mjcf
from frischid.export.mjcf_effects import MARK, effects_source
from frischid.export.notes import note_on_gravity, notes_of
from frischid.export.proofread import proofread
from frischid.export.reach import changes_in
from frischid.export.urdf import difference_of, urdf_source
from frischid.model.model import Model
from frischid.model.model_argument import check_model
from frischid.robot.inertia import is_physical

FORMATS = {".urdf": "URDF", ".xml": "MJCF", ".c": "C", ".py": "NumPy", ".json": "actuators", ".csv": "actuators"}
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
    step: float | None = None,
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
    step : float, optional
        The simulator's step, s, in which the table of the drives counts their delay; 0.005 s if not given.

    Returns
    -------
    Export

    Raises
    ------
    NotPhysicalError
        No robot has these parameters within their bounds, and `force` is not given.
    InputError
        The suffix is unknown, the file cannot be written, or the text for it is malformed; or a file stands where the
        Python file beside an MJCF file would be written, and that file is not from frischid. Or `step` is not a
        positive number, or an option is given for a file that has no use for it.

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
    check_model(model)
    target = Path(path)
    if target.suffix not in FORMATS:
        raise UnknownNameError("export format", target.suffix or target.name, FORMATS)
    check_writable(target)
    if FORMATS[target.suffix] == "actuators":
        if into is not None or boxes:
            given = "--into (into=)" if into is not None else "--box (boxes=)"
            raise InputError(f"{target}: {given} is for files with links; a table of drives has none")
        table = {".json": actuators_json, ".csv": actuators_csv}[target.suffix]
        write_text(target, table(model, SIMULATOR_STEP if step is None else step))
        changes = changes_in(model)
        before = f"the table holds the drives before the robot changed: {', '.join(changes)} is not in it"
        return Export(target, "actuators", model, None, None, (before,) if changes else ())
    if step is not None:
        raise InputError(f"{target}: --step (step=) counts delays in a table of drives, a file .json or .csv")
    if into is not None and target.suffix != ".xml":
        raise InputError(f"{target}: --into (into=) writes MJCF only; give the output a name that ends with .xml")
    physical, consistency = _physical(model, force, boxes, shapes)
    kind, difference = FORMATS[target.suffix], None
    if kind == "URDF":
        text = urdf_source(physical)
        difference = difference_of(physical, text)
        if difference > AGREEMENT and not force:
            raise InputError(
                f"{target}: not written, because the URDF's torque would differ from the model's by {difference:.1e} "
                "of its size; please report this with the model file"
            )
    elif into is not None:
        text = edited_mjcf(physical, Path(into))
    else:
        text = {"MJCF": mjcf_source, "C": c_source, "NumPy": numpy_source}[kind](physical)
    proofread(text, kind, str(target))
    other = _written_beside(physical, target, text) if kind == "MJCF" else None
    if other is None:
        write_text(target, text)
    notes = (*notes_of(physical, kind, model), *(() if into is None else note_on_gravity(physical, Path(into))))
    return Export(target, kind, physical, consistency, difference, notes, other)


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
