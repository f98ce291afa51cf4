"""Commands to copy, with the files that were used: a command without its test log or mapping file gives another result.

Names come from a model's file, so each is quoted for the shell.
"""

from __future__ import annotations

import shlex
from collections.abc import Callable, Iterable
from pathlib import Path

from frischid.diagnosis.rivals import in_command
from frischid.logs.log_file import LogFile
from frischid.model.model import Model
from frischid.model.own_logs import file_of

Name = Callable[[str], str]
"""How a command writes a path: `from_here`, or `alone` on a page that somebody else reads."""


def from_here(path: str) -> str:
    """A path from the current folder, where it lies there."""
    here = Path(path)
    return str(here.relative_to(Path.cwd())) if here.is_absolute() and here.is_relative_to(Path.cwd()) else path


def alone(path: str) -> str:
    """The name of a file without its folders, which are those of the machine that wrote a page."""
    return Path(path).name


def tested_files(model: Model) -> list[LogFile]:
    """Files of the logs that the model's last step was tested on."""
    event = model.history[-1] if model.history else {}
    return [file for entry in event.get("test_logs", ()) if (file := file_of(entry)) is not None]


def fitted_files(model: Model) -> list[LogFile]:
    """Files of the logs that the model was last fitted to."""
    return [file for entry in model.fitted_logs if (file := file_of(entry)) is not None]


def with_tests(files: Iterable[LogFile], name: Name = from_here) -> str:
    """Options that name test logs and the mapping files that explain their columns."""
    files = list(files)
    return "".join(f" --valid {_quoted(name(file.path))}" for file in files) + with_maps(files, name)


def with_logs(files: Iterable[LogFile], name: Name = from_here) -> str:
    """Arguments that name logs, and the mapping files that explain their columns."""
    files = list(files)
    return "".join(f" {_quoted(name(file.path))}" for file in files) + with_maps(files, name)


def with_maps(files: Iterable[LogFile], name: Name) -> str:
    """Options that name the mapping files of some logs."""
    maps = dict.fromkeys(file.mapping.path for file in files if file.mapping is not None)
    return "".join(f" --map {_quoted(name(path))}" for path in maps)


def check_command(model: Model, output: str = "", name: Name = from_here) -> str:
    """The command that looks for faults in the fitted logs; with an output, it writes a mapping that undoes them."""
    files, robot = fitted_files(model), model.robot
    logs = with_logs(files, name) or " LOG..."
    joints = "" if model.joints == robot.joints else f" --torque-joints {shlex.quote(','.join(model.joints))}"
    written = f" -o {_quoted(output)}" if output else ""
    return f"frischid check {in_command(robot, name)}{logs}{joints}{written}"


def excite_command(model: Model, name: Name = from_here) -> str:
    """The command that plans a motion of the model's robot."""
    return f"frischid excite {in_command(model.robot, name)} -o motion.csv"


def _quoted(path: str) -> str:
    """A path as a shell reads it; a path that looks like an option begins with the folder."""
    return shlex.quote(f"./{path}" if path.startswith("-") else path)
