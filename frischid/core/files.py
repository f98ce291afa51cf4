"""Files that are never half written: written under another name in the same folder, then renamed.

Used by every writer of logs, models, reports and exports. A rename within a folder is atomic (POSIX ``rename``), so a
reader sees the old file or the new one.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from frischid.errors import InputError


def check_writable(path: str | Path) -> Path:
    """Refuse an output path before the work is done rather than after.

    Returns
    -------
    Path
        The file that is to be written: where a link leads.

    Raises
    ------
    InputError
        There is no such folder, or something else than a file has that name.
    """
    target = Path(path)
    target = target.resolve() if target.is_symlink() else target
    if not target.parent.is_dir():
        raise InputError(f"{path}: there is no folder {target.parent}; make it first, or write elsewhere")
    if target.is_dir():
        raise InputError(f"{path} is a folder; give the name of a file")
    if target.exists() and not target.is_file():
        raise InputError(f"{path} is a device or a pipe; give the name of a file")
    return target


@contextmanager
def written(path: str | Path) -> Iterator[Path]:
    """Give a scratch path; the file written there appears as `path` when the block ends without an error.

    Raises
    ------
    InputError
        It cannot be written.
    """
    target = check_writable(path)
    scratch = target.with_name(f".{target.name}.{os.getpid()}.tmp")
    try:
        yield scratch
        scratch.replace(target)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror})") from error
    finally:
        scratch.unlink(missing_ok=True)


def write_text(path: str | Path, text: str) -> None:
    """Write a UTF-8 file; errors as `written`."""
    with written(path) as scratch:
        scratch.write_text(text, encoding="utf-8")
