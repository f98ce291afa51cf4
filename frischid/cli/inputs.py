"""Read a robot and its logs as the options of the command line describe them."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from frischid.cli.arguments import MapFiles, RobotArguments, angle_of, matching, number, pairs
from frischid.cli.paths import check_found

if TYPE_CHECKING:
    from frischid.logs.log import Log
    from frischid.model.model import Model
    from frischid.robot.robot import Robot

Progress = Callable[[str], None]


def _untold(_: str) -> None:
    pass


def load(
    robot: str,
    arguments: RobotArguments,
    paths: Sequence[str] = (),
    mapping: MapFiles = None,
    *,
    whole: bool = True,
    progress: Progress = _untold,
) -> tuple[Robot, list[Any]]:
    """The robot as the options describe it, and its logs.

    A joint that is locked without an angle is locked at its median position in the first log. If not `whole`, logs that
    are too large for memory together become recordings, which are read chunk by chunk.
    """
    from statistics import median

    from frischid.logs.recording import chunks_of
    from frischid.logs.wraps import unwrapped
    from frischid.robot.robot import Robot

    nominal = Robot.load(robot)
    check_found(lambda: files_of(nominal))
    logs = (read if whole else opened)(paths, nominal, mapping, progress)
    locks: dict[str, float] = {}
    for item in arguments.lock:
        pattern, given, angle = item.partition("=")
        for joint in matching(pattern, nominal.joints) or []:
            locks[joint] = angle_of(joint, angle) if given else float("nan")
    joints = matching(arguments.joints, nominal.joints)
    if joints is not None:
        locks |= {j: float("nan") for j in nominal.joints if j not in joints and j not in locks}
    free = [joint for joint, angle in locks.items() if angle != angle]
    first = next(chunks_of(logs[0])) if logs and free else None
    for joint in free:
        if first is not None and joint in first.joints:
            locks[joint] = median(unwrapped(first.select([joint])).q[:, 0].tolist())
    frames = arguments.frames
    machine = Robot.load(
        robot,
        lock=locks,
        gravity=arguments.gravity,
        base_rpy=arguments.base_rpy,
        frames=pairs(frames.split(",")) if "=" in frames else frames,
        known={k: number(k, v) for k, v in pairs(arguments.known).items()},
    )
    return machine, logs


def read(paths: Sequence[str], robot: Robot, mapping: MapFiles, progress: Progress = _untold) -> list[Log]:
    """Logs of a robot; a mapping file, if given, explains their columns."""
    from frischid.logs.mapping import LogMap
    from frischid.logs.readers import read_log

    check_found(paths)
    # A mapping may name joints that are locked in this robot; their columns are read but not used.
    form, names = LogMap.of(mapping), names_of(robot)
    logs = []
    for k, path in enumerate(paths, 1):
        progress(f"reading logs ({k} of {len(paths)})")
        logs.append(read_log(path, names, form))
    return logs


def opened(paths: Sequence[str], robot: Robot, mapping: MapFiles, progress: Progress = _untold) -> list[Any]:
    """Logs of a robot: in memory if they are small together, otherwise as recordings, read chunk by chunk."""
    from frischid.logs.content_size import fits_in_memory
    from frischid.logs.mapping import LogMap
    from frischid.logs.recording import Recording

    check_found(paths)
    if fits_in_memory(map(Path, paths)):
        return list(read(paths, robot, mapping, progress))
    form, names = LogMap.of(mapping), names_of(robot)
    return [Recording.open(path, names, form) for path in paths]


def opened_or_own(paths: Sequence[str], model: Model, mapping: MapFiles, progress: Progress = _untold) -> list[Any]:
    """The logs that are named; without a name, those the model was fitted to, found by path and hash.

    Raises
    ------
    InputError
        No log is named, and none of the model's own is found.
    """
    if paths:
        return opened(paths, model.robot, mapping, progress)
    from frischid.errors import InputError
    from frischid.model.own_logs import own_logs

    progress("reading the model's own logs")
    found = own_logs(model)
    if not found.logs:
        why = f"were not found ({found.reasons})" if found.missing else "are not named in its file"
        raise InputError(f"no log is named, and the model's own logs {why}; name the logs")
    several = f"{len(found.logs)} logs" if len(found.logs) > 1 else "log"
    lost = f"; not found: {found.reasons}" if found.missing else ""
    click.echo(
        f"note: no log is named; the model's own {several} (found by path and hash) will be used{lost}", err=True
    )
    return list(found.logs)


def names_of(robot: Robot) -> tuple[str, ...]:
    """All joints of a robot, in the order of its tree, the locked ones too."""
    from dataclasses import replace

    return replace(robot, locked={}, known={}, frames="joint").joints if robot.locked else robot.joints


def model_of(path: str, torque_joints: str | None = None) -> Model:
    """The model of a file, with the torque rows of some joints if they are named; a file without a hash is named."""
    from frischid.core.text import printable
    from frischid.model.model import Model
    from frischid.model.own_logs import paths_of

    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always", UserWarning)
        model = Model.load(path)
    for warning in said:
        click.echo(f"note: {printable(str(warning.message))}", err=True)
    check_found(lambda: [*meshes_of(model.robot), *paths_of(model)])
    joints = matching(torque_joints, model.joints)
    if joints is None:
        return model
    from numpy import array

    from frischid.model.standstill_joints import rows_of

    return rows_of(model, array([name in joints for name in model.joints]))


def models_of(paths: Sequence[str], torque_joints: str | None = None) -> dict[str, Model]:
    """The models of several files, by the shortest name that tells them apart.

    Raises
    ------
    InputError
        A file is given twice, or cannot be read.
    """
    from frischid.errors import InputError

    if len({Path(path).resolve() for path in paths}) < len(paths):
        raise InputError(f"a model file is given twice: {', '.join(paths)}; give two different models to compare")
    stems = [Path(path).stem for path in paths]
    names = stems if len(set(stems)) == len(stems) else paths
    return {name: model_of(path, torque_joints) for name, path in zip(names, paths, strict=True)}


def files_of(robot: Robot) -> list[Path]:
    """The URDF of a robot, and its meshes."""
    from frischid.robot.urdf_reading import robot_names

    return [robot_names().get(robot.source, Path(robot.source)), *meshes_of(robot)]


def meshes_of(robot: Robot) -> list[Path]:
    """The meshes of a robot that are on this machine."""
    from frischid.motions.collision import mesh_files

    return mesh_files(robot)
