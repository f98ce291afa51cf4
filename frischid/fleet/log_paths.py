"""Paths of the logs of many robots, on a disk or at any address that fsspec knows, and the robot of each log.

    logs/**/*.parquet            logs/r017/monday/3.parquet is of r017, the first folder below the pattern's fixed part;
                                 a file directly in the fixed part is a robot of its own
    logs/r017/1.csv logs/r018/1.csv    names of files, as a shell makes of a pattern: the first folder below the one
                                 that all of them share
    logs/{robot}_*.parquet       the pattern names the robot: logs/r017_3.parquet is of r017
    s3://bucket/{robot}/*        any address that fsspec and its plug-ins can open

Logs are in the order of their addresses, in whatever order a file system lists them.
"""

from __future__ import annotations

import glob
import os
import re
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from frischid.core.extras import install_command
from frischid.errors import InputError

_ROBOT = "{robot}"
_WILD = re.compile(r"[*?\[{]")


@dataclass(frozen=True, order=True)
class LogPath:
    """One log: its robot, and its address."""

    robot: str
    address: str


def find_logs(patterns: Sequence[str]) -> list[LogPath]:
    """Find the logs that patterns match, in order, each once.

    Parameters
    ----------
    patterns : sequence of str
        File names, glob patterns (``**`` goes through folders), or addresses; see the module.

    Raises
    ------
    InputError
        A pattern matches nothing, or a matched name does not identify its robot.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from frischid.fleet.log_paths import find_logs
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     for name in ("r017_1.csv", "r017_2.csv", "r018_1.csv"):
    ...         _ = Path(folder, name).write_text("")
    ...     found = find_logs([f"{folder}/{{robot}}_*.csv"])
    >>> [path.robot for path in found]
    ['r017', 'r017', 'r018']
    """
    found: dict[str, LogPath] = {}  # by the file, however its name is written
    shared = os.path.commonprefix([_plain(p) for p in patterns if _is_name(p)])  # noqa: RUF071 (cut at a slash below)
    for pattern in patterns:
        addresses = _matches(pattern.replace(_ROBOT, "*"))
        if not addresses:
            raise InputError(f"{pattern}: no file matches; quote the pattern so that the shell leaves it alone")
        plain = f"{shared[: shared.rfind('/') + 1]}*" if _is_name(pattern) else _plain(pattern)
        for address in addresses:
            found.setdefault(_file(address), LogPath(robot_of(address, plain), address))
    return sorted(found.values())


def _file(address: str) -> str:
    """The one name of a file: ``logs/1.csv`` of ``./logs/1.csv``, ``logs//1.csv`` and the whole path."""
    return address if "://" in address else os.path.abspath(address)  # noqa: PTH100 (a link may be a robot of its own)


def _is_name(pattern: str) -> bool:
    """Whether a pattern is the name of one file, which may hold brackets."""
    return _WILD.search(pattern) is None or ("://" not in pattern and Path(pattern).is_file())


def robot_of(address: str, pattern: str) -> str:
    """Name of the robot of an address that a pattern matched."""
    if _ROBOT in pattern:
        match = re.fullmatch(_expression(pattern), address)
        if match is None:
            raise InputError(
                f"{address}: the name of the robot cannot be read with the pattern {pattern}; correct the text around "
                f"{{robot}}"
            )
        return match["robot"]
    fixed = pattern[: found.start()] if (found := _WILD.search(pattern)) else pattern
    below = PurePosixPath(address[len(fixed[: fixed.rfind("/") + 1]) :])
    return below.parts[0] if len(below.parts) > 1 else below.stem


def _expression(pattern: str) -> str:
    """A glob pattern with {robot} as a regular expression."""
    tokens = {"**/": "(?:.*/)?", "**": ".*", "*": "[^/]*", "?": "[^/]"}
    parts = re.split(r"(\*\*/|\*\*|\*|\?|\{robot\}|\[!?\]?[^]]*\])", pattern)
    named = False
    out = ""
    for part in parts:
        if part == _ROBOT:
            out += "(?P=robot)" if named else "(?P<robot>[^/]+?)"
            named = True
        elif len(part) > 2 and part[0] == "[":
            out += _set(part[1:-1])
        else:
            out += tokens.get(part) or re.escape(part)
    return out


def _set(inside: str) -> str:
    """A glob pattern's set of characters, without its brackets, as a regular expression."""
    other = inside.startswith("!")
    return f"[{'^' * other}{''.join(c if c == '-' else re.escape(c) for c in inside[other:])}]"


def _matches(pattern: str) -> list[str]:
    if "://" not in pattern:
        if Path(pattern).is_file():
            return [pattern]
        found = glob.glob(pattern, recursive=True)  # noqa: PTH207 (Path.glob cannot use absolute patterns)
        return sorted(path for path in found if Path(path).is_file())
    fs, path = _filesystem(pattern)
    return sorted(str(fs.unstrip_protocol(p)) for p in fs.glob(path))


def _plain(pattern: str) -> str:
    """A pattern as its file system writes addresses."""
    if "://" not in pattern:
        return pattern
    fs, path = _filesystem(pattern)
    return str(fs.unstrip_protocol(path))


def _filesystem(address: str) -> tuple[Any, str]:
    try:
        import fsspec
    except ImportError:
        raise InputError(f"{address}: addresses need fsspec: {install_command('cluster')}") from None
    try:
        fs, path = fsspec.core.url_to_fs(address)
    except (ImportError, ValueError) as error:
        raise InputError(f"{address}: {error}") from error
    return fs, path


@contextmanager
def local(address: str) -> Iterator[Path]:
    """A path on this machine with the file at an address; if the file was copied, the copy is removed afterwards.

    Raises
    ------
    InputError
        The file cannot be fetched from the address.
    """
    if "://" not in address:
        yield Path(address)
        return
    fs, path = _filesystem(address)
    with tempfile.TemporaryDirectory(prefix="frischid-") as folder:
        copy = Path(folder) / PurePosixPath(path).name
        try:
            fs.get_file(path, str(copy))
        except OSError as error:
            raise InputError(f"{address}: cannot be fetched ({error})") from error
        yield copy
