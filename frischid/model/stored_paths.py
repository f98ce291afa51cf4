"""Paths of logs in a model file: relative to the file, so that they move with it and name no folder of a machine.

In memory the history of a model holds absolute paths. `portable` makes them relative when a model is saved, `located`
makes them absolute when it is read. A file that holds an absolute path was not written by frischid and is refused.

The robot's file is named in the same way, where there is one: commands to copy name it, and its meshes lie beside it.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any

from frischid.errors import InputError

_LISTS = ("logs", "test_logs")  # of an event: entries of logs


def portable(data: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Content of a model file whose paths are relative to a folder.

    Parameters
    ----------
    data : mapping
        `Model.to_dict`.
    folder : Path
        Of the model file.
    """
    found: dict[str, Any] = _with_paths(
        data, lambda path: _relative(path, folder), lambda source: _robot_from(source, folder), rename=True
    )
    return found


def located(data: Any, folder: Path, source: str) -> Any:
    """Content of a model file whose paths are absolute; the rest of it is not looked at.

    Parameters
    ----------
    data : object
        Content of the file.
    folder : Path
        Of the model file.
    source : str
        Its name in messages.

    Raises
    ------
    InputError
        A path is absolute, or holds a character that no name of a file has.
    """
    return _with_paths(
        data, lambda path: _absolute(path, folder, source), lambda name: _robot_here(name, folder), rename=False
    )


def _with_paths(data: Any, convert: Callable[[str], str], of_robot: Callable[[str], str], *, rename: bool) -> Any:
    """The content with other paths, in every step; `rename`: where a log's path stands in words, too."""
    steps = list(_steps(data))
    whole: Any = None
    below: Any = None
    for step in reversed(steps):
        events = step.get("history")
        changed = [_event(e, convert, rename) for e in events] if isinstance(events, list) else events
        whole = {**step, "history": changed} if "history" in step else dict(step)
        robot = step.get("robot")
        if isinstance(robot, Mapping) and isinstance(robot.get("source"), str):
            whole["robot"] = {**robot, "source": of_robot(robot["source"])}
        if "previous" in step and isinstance(step["previous"], Mapping):
            whole["previous"] = below
        below = whole
    return data if whole is None else whole


def _steps(data: Any) -> Iterator[Mapping[str, Any]]:
    """A model and the steps before it, newest first."""
    while isinstance(data, Mapping):
        yield data
        data = data.get("previous")


def _event(event: Any, convert: Callable[[str], str], rename: bool) -> Any:
    if not isinstance(event, Mapping):
        return event
    new = dict(event)
    names: dict[str, str] = {}
    for key in _LISTS:
        if isinstance(event.get(key), list):
            new[key] = [_entry(entry, convert, names if rename else None) for entry in event[key]]
    return {key: x if key in _LISTS else _renamed(x, names) for key, x in new.items()} if names else new


def _entry(entry: Any, convert: Callable[[str], str], names: dict[str, str] | None) -> Any:
    """An entry of a log with other paths; its old and new name go to `names`."""
    if not (isinstance(entry, Mapping) and isinstance(entry.get("file"), Mapping)):
        return entry
    file = _file(entry["file"], convert)
    if isinstance(file.get("mapping"), Mapping):
        file["mapping"] = _file(file["mapping"], convert)
    if names is None or not isinstance(file.get("path"), str):
        return {**entry, "file": file}
    names[str(entry.get("source"))] = file["path"]
    return {**entry, "source": file["path"], "file": file}


def _file(file: Mapping[str, Any], convert: Callable[[str], str]) -> dict[str, Any]:
    path = file.get("path")
    return {**file, "path": convert(path)} if isinstance(path, str) else dict(file)


def _renamed(value: Any, names: Mapping[str, str]) -> Any:
    """A JSON value whose sentences have the new names."""
    if isinstance(value, Mapping):
        return {key: _renamed(x, names) for key, x in value.items()}
    if isinstance(value, list | tuple):
        return [_renamed(x, names) for x in value]
    for old, new in names.items():
        value = value.replace(old, new) if isinstance(value, str) else value
    return value


def _robot_from(source: str, folder: Path) -> str:
    """The file of a robot from a folder on; the name of a robot, or of a file that is not there, as it is."""
    return _relative(source, folder) if os.path.isfile(source) else source  # noqa: PTH113 (any text is no error)


def _robot_here(source: str, folder: Path) -> str:
    """The file of a robot from the present folder on, where it lies below; what names no file, as it is."""
    found = Path(os.path.normpath(Path(os.path.realpath(folder), source)))
    if PurePosixPath(source).is_absolute() or not os.path.isfile(found):  # noqa: PTH113 (any text is no error)
        return source
    return str(found.relative_to(Path.cwd()) if found.is_relative_to(Path.cwd()) else found)


def _relative(path: str, folder: Path) -> str:
    """A path from a folder on; the name alone where no path leads from one to the other (another drive)."""
    absolute = Path(os.path.realpath(Path(path).parent), Path(path).name)
    try:
        return Path(os.path.relpath(absolute, os.path.realpath(folder))).as_posix()
    except ValueError:
        return absolute.name


def _absolute(path: str, folder: Path, source: str) -> str:
    windows = PureWindowsPath(path)
    if PurePosixPath(path).is_absolute() or windows.drive or windows.root or not path.isprintable():
        raise InputError(
            f"{source}: the model file is damaged: expected a path relative to the file, got {path!r} - at "
            "`history[].logs[].file.path`"
        )
    return os.path.normpath(Path(os.path.realpath(folder), path))
