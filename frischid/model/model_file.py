"""The model file: a JSON object of schema ``frischid.model/2``, checked field by field before a model is built from it.

The records of `frischid.model.model_records` say which fields there are, and of which type. Beyond the types,
`read_records` and `check_columns` make sure that every number is finite, every matrix fits the number of parameters,
and every parameter belongs to the column of the regressor that it claims. An error names the field and what was
expected.

A file of schema ``frischid.model/1`` is read too: it has no prior, and may lack what later versions added.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec

from frischid.core.types import Column
from frischid.errors import InputError
from frischid.model.fit_record import LEVELS
from frischid.model.model_records import EventRecord, ModelRecord
from frischid.robot.robot import Robot

SCHEMA = "frischid.model/2"
FIRST_SCHEMA = "frischid.model/1"
DEEPEST = 50  # lists and tables in each other, in one step; frischid writes fewer than ten
LARGEST_IN_FILE = 1e100  # sums of its square still are numbers of double precision


def read_json(path: str | Path) -> Any:
    """Content of a JSON file.

    Raises
    ------
    InputError
        The file cannot be read, or is not JSON.
    """
    writes = "`frischid identify ROBOT LOG -o model.json` writes one"
    try:
        return json.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"{path}: the model file cannot be read ({error.strerror}); {writes}") from None
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        if Path(path).suffix.lower() in {".urdf", ".xml"}:
            raise InputError(f"{path}: a robot, not a model file; {writes}, and this command takes it first") from None
        raise InputError(f"{path}: not a JSON model file ({error}); {writes}, and it stands before logs") from None
    except RecursionError:
        raise _too_deep(path) from None


def _too_deep(source: str | Path) -> InputError:
    return InputError(f"{source}: the model file is damaged: its objects are nested too deep; take a copy of the file")


def read_records(data: Any, source: str) -> list[ModelRecord]:
    """Check a model and the steps before it, newest first.

    Parameters
    ----------
    data : object
        Content of a model file, as plain JSON values.
    source : str
        Its name in messages.

    Raises
    ------
    InputError
        Not a frischid model, of a schema this version does not read, or a field is wrong.
    """
    records: list[ModelRecord] = []
    content, place = data, ""
    while content is not None or not records:
        schema = content.get("schema") if isinstance(content, Mapping) else None
        if schema not in (SCHEMA, FIRST_SCHEMA):
            raise InputError(
                f"{source}: expected a frischid model of schema {SCHEMA}, found {schema!r}; write one with `frischid "
                "identify ROBOT LOG -o model.json`, or read it with the version of frischid that wrote it"
            )
        try:
            record = msgspec.convert(content, ModelRecord)
        except msgspec.ValidationError as error:
            text = str(error) if " - at " in str(error) else f"{error} - at `$`"
            step = place.rstrip(".") or "the whole file"
            raise damaged(source, text.replace("`$.", f"`{place}").replace("`$`", f"`{step}`")) from error
        except RecursionError:
            raise _too_deep(source) from None
        for number, event in enumerate(record.history):
            _check_event(event, f"{place}history[{number}]", source)
        if not records and record.robot is None:
            raise damaged(source, "Object missing required field `robot`")
        _check_numbers({k: v for k, v in content.items() if k != "previous"}, place, source)
        _check_shapes(record, place, source)
        records.append(record)
        content, place = record.previous, f"{place}previous."
    return records


def _check_event(event: Mapping[str, Any], place: str, source: str) -> None:
    """Refuse a step of the history whose fields are of another type than they are read as."""
    try:
        msgspec.convert(event, EventRecord)
    except msgspec.ValidationError as error:
        text = str(error) if " - at " in str(error) else f"{error} - at `$`"
        raise damaged(source, text.replace("`$", f"`{place}")) from error


def damaged(source: str, what: str) -> InputError:
    """The error of a model file that cannot be used, with the field and what was expected there."""
    return InputError(f"{source}: the model file is damaged: {what}")


def _check_numbers(data: Mapping[str, Any], place: str, source: str) -> None:
    """Refuse a number that is not finite, or whose square is not, and objects that are nested too deep."""
    waiting: list[tuple[str, Any, int]] = [(place + k, v, 1) for k, v in data.items()]
    while waiting:
        where, value, depth = waiting.pop()
        if depth > DEEPEST:
            raise _too_deep(source)
        if isinstance(value, int | float):
            if not abs(value) <= LARGEST_IN_FILE:
                raise damaged(source, f"expected a finite number below {LARGEST_IN_FILE:g}, got {value} - at `{where}`")
        elif isinstance(value, Mapping):
            waiting += [(f"{where}.{k}", v, depth + 1) for k, v in value.items()]
        elif isinstance(value, list | tuple):
            waiting += [(f"{where}[{k}]", v, depth + 1) for k, v in enumerate(value) if not isinstance(v, str)]


def _check_shapes(record: ModelRecord, place: str, source: str) -> None:
    """Refuse matrices that do not fit the parameters, and joints or columns that come twice."""
    p = len(record.parameters)
    for name, matrix in (("covariance", record.covariance), ("information", record.information)):
        if len(matrix) != p or any(len(row) != p for row in matrix):
            raise damaged(source, f"expected {p} rows of {p} numbers, one per parameter - at `{place}{name}`")
        for i, row in enumerate(matrix):
            if row[i] < 0:
                raise damaged(source, f"expected a variance, at least 0, got {row[i]} - at `{place}{name}[{i}][{i}]`")
    for kind, values in (
        ("joints", [j.name for j in record.joints]),
        ("column", [x.column for x in record.parameters]),
    ):
        for k, value in enumerate(values):
            if value in values[:k]:
                where = f"joints[{k}].name" if kind == "joints" else f"parameters[{k}].column"
                raise damaged(source, f"expected each {kind} once, got {value} again - at `{place}{where}`")
    if record.fitted is not None:
        lengths = {"velocity": len(record.joints), "acceleration": len(record.joints), "urdf": p}
        if [len(row) for row in record.fitted.scores] != [len(record.joints)] * len(LEVELS):
            raise damaged(
                source, f"expected {len(LEVELS)} rows of {len(record.joints)} numbers - at `{place}fitted.scores`"
            )
        for name in ("model_share", "spread"):
            if getattr(record.fitted, name):  # earlier versions wrote none
                lengths[name] = len(record.joints)
        for name, length in lengths.items():
            if len(getattr(record.fitted, name)) != length:
                raise damaged(source, f"expected {length} numbers - at `{place}fitted.{name}`")
    methods = set(record.parameters[0].bounds) if record.parameters else set()
    for k, parameter in enumerate(record.parameters):
        if set(parameter.bounds) != methods:
            expected = ", ".join(sorted(methods)) or "none"
            raise damaged(source, f"expected bounds of {expected} - at `{place}parameters[{k}].bounds`")


def check_columns(record: ModelRecord, columns: Sequence[Column], joints: Sequence[str], source: str) -> None:
    """Compare every parameter and joint with the robot and the effects of the file.

    A base parameter has the name of its leading column, with an ``R`` behind it if other parameters are added to it.

    Raises
    ------
    InputError
        A parameter stands at another parameter's column, or a joint is not the robot's.
    """
    for k, x in enumerate(record.parameters):
        if x.column >= len(columns):
            raise damaged(
                source,
                f"expected a column below {len(columns)}, got {x.column} - at `parameters[{k}].column` ({x.name})",
            )
        own = columns[x.column]
        if x.name not in (own.name, f"{own.name}R") or (x.joint, x.effect) != (own.joint, own.effect):
            raise damaged(
                source,
                f"column {x.column} of this robot with these effects is {own.name} ({own.effect}, {own.joint}), but "
                f"`parameters[{k}]` claims it for {x.name} ({x.effect}, {x.joint}): the effects or the robot of the "
                "file were changed; take a copy of the file as frischid wrote it",
            )
    for k, joint in enumerate(record.joints):
        if joint.name not in joints:
            raise damaged(
                source, f"expected a joint of the robot ({', '.join(joints)}), got {joint.name} - at `joints[{k}]`"
            )
    if record.prior is not None and [x.name for x in record.prior.parameters] != [c.name for c in columns]:
        raise damaged(source, "expected the robot's and the effects' parameters in order - at `prior.parameters`")
    if record.standard is not None:
        absent = [c.name for c in columns if c.name not in record.standard]
        if absent:
            raise damaged(source, f"expected a value of {', '.join(absent)} - at `standard`")


def robot_of(record: ModelRecord, source: str) -> Robot:
    """The robot of a record.

    Raises
    ------
    InputError
        Its URDF or its settings are not usable.
    """
    try:
        return Robot.from_dict(msgspec.to_builtins(record.robot))
    except InputError as error:
        raise damaged(source, f"{error} - at `robot`") from error
