"""The logs a model was fitted to, found again: by the path and the hash that the model's file remembers.

A model file holds the path of each log relative to the file itself, so that a folder with models and logs can be moved,
and no path of somebody's machine travels with the model. A path is never trusted: `frischid.logs.log_file.difference`
says what is looked at, and a file is read only if its hash is the remembered one. A mapping file is remembered in the
same way. A log that was made in Python, or read with a mapping written in Python, has no file and is not found again.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path, PurePosixPath
from typing import Any, NamedTuple

import msgspec

from frischid.core.text import listed
from frischid.errors import InputError
from frischid.logs.content_size import fits_in_memory
from frischid.logs.log import Log
from frischid.logs.log_file import MOST_MAPPING_BYTES, LogFile, StoredFile, difference
from frischid.logs.readers import read_log
from frischid.logs.recording import Recording, chunks_of
from frischid.logs.tables import LOG_SUFFIXES
from frischid.model.model import Model
from frischid.model.model_argument import check_model

MOST_REASONS = 3  # logs that were not found and are named


class OwnLogs(NamedTuple):
    """A model's own logs: those that were found, and why the others were not.

    Attributes
    ----------
    logs : tuple of Log or Recording
        A large file is a recording.
    missing : tuple of str
        A name and a reason for each log that was not found.
    """

    logs: tuple[Log | Recording, ...]
    missing: tuple[str, ...]

    @property
    def reasons(self) -> str:
        """The first few of `missing`, and the number of the others."""
        few, others = self.missing[:MOST_REASONS], len(self.missing) - MOST_REASONS
        return listed([*few, f"{others} more"] if others > 0 else few)


def own_logs(model: Model, given: tuple[Log | Recording, ...] = ()) -> OwnLogs:
    """Find the logs that a model was fitted to.

    Parameters
    ----------
    model : Model
    given : tuple of Log or Recording
        Logs that are at hand; those among them are not looked for.

    Returns
    -------
    OwnLogs

    Examples
    --------
    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> import frischid as fr
    >>> robot = fr.Robot.load("planar2")
    >>> log = fr.simulate(robot, fr.random_fourier(robot, 5.0, seed=1), rate=100.0)
    >>> with TemporaryDirectory() as folder:
    ...     fr.write_log(log, Path(folder) / "log.parquet")
    ...     log = fr.read_log(Path(folder) / "log.parquet", robot.joints)
    ...     fr.identify(robot, [log], recursion="none").model.save(Path(folder) / "model.json")
    ...     found = fr.own_logs(fr.Model.load(Path(folder) / "model.json"))
    >>> [len(log) for log in found.logs], found.missing
    ([501], ())
    """
    check_model(model)
    here = {log.identity for log in given}
    logs: list[Log | Recording] = []
    missing: list[str] = []
    for entry in model.fitted_logs:
        if entry.get("sha256") in here:
            continue
        name = _name(entry)
        found = _found(entry, model)
        if isinstance(found, str):
            missing.append(f"{name}: {found}")
        else:
            logs.append(found)
    return OwnLogs(tuple(logs), tuple(missing))


def paths_of(model: Model) -> list[Path]:
    """Paths of the files that a model remembers, whether or not they are there."""
    files = [file for entry in model.fitted_logs if (file := file_of(entry)) is not None]
    return [Path(path) for x in files for path in (x.path, *([] if x.mapping is None else [x.mapping.path]))]


def _found(entry: Mapping[str, Any], model: Model) -> Log | Recording | str:
    """A log, or why it is not read."""
    file = file_of(entry)
    if file is None:
        return "its file is not known"
    sha256 = str(entry.get("sha256"))
    reason = difference(StoredFile(file.path, sha256, file.bytes), LOG_SUFFIXES)
    if reason:
        return reason
    mapping = file.mapping
    if mapping is not None:
        if mapping.bytes > MOST_MAPPING_BYTES:
            return "its mapping file is too large"
        reason = difference(mapping, (".toml",))
        if reason:
            return f"mapping file {Path(mapping.path).name}: {reason}"
    try:
        joints = (*model.robot.joints, *model.robot.locked)
        form = None if mapping is None else mapping.path
        if not fits_in_memory([Path(file.path)]):
            return Recording.open(file.path, joints, form)
        log = read_log(file.path, joints, form)
    except InputError as error:
        return str(error)
    return log if log.sha256 == sha256 else "its content changed while it was read"


def _name(entry: Mapping[str, Any]) -> str:
    """Name of a log for a message."""
    text = PurePosixPath(str(entry.get("source", "log"))).name
    return "".join(c if c.isprintable() else "?" for c in text) or "log"


# ---------------------------------------------------------------- what a model's history keeps


def log_entry(log: Log | Recording, samples: int | None = None) -> dict[str, Any]:
    """A log as an event of the history keeps it: name, hash, samples, and its file where it has one."""
    entry: dict[str, Any] = {"source": log.source, "sha256": log.identity}
    if samples is not None:
        entry["samples"] = samples
    if log.file is not None:
        entry["file"] = asdict(log.file)
    return entry


def fitted_entry(log: Log | Recording) -> dict[str, Any]:
    """The same with its number of samples, counted."""
    return log_entry(log, sum(map(len, chunks_of(log))))


def file_of(entry: Mapping[str, Any]) -> LogFile | None:
    """The file in an entry of the history; None where there is none, or what stands there is none."""
    try:
        return msgspec.convert(entry["file"], LogFile) if "file" in entry else None
    except msgspec.ValidationError:
        return None
