"""Files that are never half written, and never written over an input.

`read_toml` reads the small files that users write by hand.

Every writer of logs, models, reports and exports writes under another name in the same folder, then renames. A rename
within a folder is atomic (POSIX ``rename``), so a reader sees the old file or the new one. The file under the other
name is locked (``flock``) as long as its writer lives: a file that a killed process left behind has no lock, and the
next writer in that folder removes it.
"""

from __future__ import annotations

import os
import sys
import tomllib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from frischid.errors import InputError

if sys.platform != "win32":
    import fcntl

_PREFIX, _SUFFIX = ".frischid-", ".tmp"


def check_writable(path: str | Path) -> Path:
    """Refuse an unusable output path before the work is done, not after.

    Returns
    -------
    Path
        The file that is to be written: where a link leads.

    Raises
    ------
    InputError
        There is no such folder, the user may not write there, or the name is that of something else than a file.
    """
    target = Path(path)
    try:
        target = Path(os.path.realpath(target)) if target.is_symlink() else target
        if target.is_symlink():
            raise InputError(f"{path}: cannot be written (links in a circle); give another name")
        if target.is_dir():
            raise InputError(f"{path} is a folder; give the name of a file")
        if not target.parent.is_dir():
            raise InputError(f"{path}: there is no folder {target.parent}; make it first, or write elsewhere")
        if target.exists() and not target.is_file():
            raise InputError(f"{path} is a device or a pipe; give the name of a file")
    except OSError as error:  # a name that is too long
        raise InputError(f"{path}: cannot be written ({error.strerror}); give another name") from error
    if not os.access(target.parent, os.W_OK | os.X_OK):
        raise InputError(f"{path}: you may not write in the folder {target.parent}; write elsewhere")
    if target.exists() and not os.access(target, os.W_OK):
        raise InputError(f"{path} is write-protected; give another name")
    return target


def check_outputs(outputs: Iterable[str | Path], inputs: Iterable[str | Path]) -> None:
    r"""Refuse to write over a file that is read, and to write two things into one file.

    A link to a file, a second name of the file (hard link) and ``./../`` forms of its path are the file.

    Parameters
    ----------
    outputs, inputs : iterable of str or Path
        Files that are to be written, and files or folders that are read. An input that does not exist, for example
        the name of a robot, is no file.

    Raises
    ------
    InputError
        An output is an input, lies in an input that is a folder and exists there, or is another output.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from frischid.core.files import check_outputs
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = Path(folder, "log.csv").write_text("t\n")
    ...     check_outputs([f"{folder}/model.json"], [f"{folder}/log.csv"])
    ...     check_outputs([f"{folder}/./log.csv"], [f"{folder}/log.csv"])
    Traceback (most recent call last):
    frischid.errors.InputError: ...log.csv is read as well: ...
    """
    wanted, read = list(outputs), list(inputs)
    for number, output in enumerate(wanted):
        for other in wanted[:number]:
            if _is_same(output, other):
                raise InputError(f"{output}: two outputs would go to this file; give them different names")
        for other in read:
            if _is_same(output, other) or _is_within(output, other):
                raise InputError(
                    f"{output} is read as well: it would be overwritten; nothing was done, give the output another name"
                )


def _is_same(one: str | Path, other: str | Path) -> bool:
    try:
        return os.path.samefile(one, other)  # noqa: PTH121 (either may be text)
    except (OSError, ValueError):  # one of them does not exist
        return os.path.realpath(one) == os.path.realpath(other)


def _is_within(output: str | Path, folder: str | Path) -> bool:
    """Whether an output is a file that is there, somewhere below a folder."""
    try:
        inside = Path(os.path.realpath(output)).is_relative_to(os.path.realpath(folder))
        return inside and Path(folder).is_dir() and Path(output).is_file()
    except (OSError, ValueError):
        return False


@contextmanager
def written(path: str | Path) -> Iterator[Path]:
    """Give a scratch path; the file written there appears as `path` when the block ends without an error.

    Raises
    ------
    InputError
        The file cannot be written.
    """
    target = check_writable(path)
    try:
        _remove_left_behind(target.parent)
        scratch, lock = _scratch(target.parent)
        try:
            yield scratch
            scratch.replace(target)
        finally:
            scratch.unlink(missing_ok=True)
            os.close(lock)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror or error})") from error


def write_text(path: str | Path, text: str) -> None:
    """Write a UTF-8 file; errors as `written`."""
    with written(path) as scratch:
        scratch.write_text(text, encoding="utf-8")


def read_toml(path: str | Path, what: str) -> tuple[dict[str, Any], bytes]:
    """Content of a TOML file, and its bytes; `what` names the file in messages.

    Raises
    ------
    InputError
        The file cannot be read, or is not TOML.
    """
    try:
        content = Path(path).read_bytes()
        return tomllib.loads(content.decode("utf-8-sig")), content  # Windows writes a byte order mark
    except OSError as error:
        raise InputError(f"{path}: the {what} file cannot be read ({error.strerror})") from error
    except ValueError as error:
        raise InputError(f"{path}: the {what} file is not TOML: {error}") from error
    except RecursionError:
        raise InputError(f"{path}: the {what} file's lists are nested too deep; it has tables only") from None


def _scratch(folder: Path) -> tuple[Path, int]:
    """A new empty file, and the descriptor that locks it until it is closed."""
    while True:
        path = folder / f"{_PREFIX}{os.urandom(8).hex()}{_SUFFIX}"
        descriptor = os.open(path, os.O_CREAT | os.O_EXCL | os.O_RDWR, 0o666)
        if sys.platform != "win32":
            with suppress(OSError):  # a file system without locks
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if os.fstat(descriptor).st_nlink:
            return path, descriptor
        os.close(descriptor)  # another process removed it before it was locked


def _remove_left_behind(folder: Path) -> None:
    """Remove the files of writers that were killed; those of living writers are locked."""
    if sys.platform == "win32":
        return
    for path in folder.glob(f"{_PREFIX}*{_SUFFIX}"):
        with suppress(OSError):  # somebody else's, or removed meanwhile
            descriptor = os.open(path, os.O_RDWR | os.O_NOFOLLOW)
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
                path.unlink(missing_ok=True)
            finally:
                os.close(descriptor)
