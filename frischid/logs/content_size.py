"""How much memory the numbers of a file need, from what the file says of itself, before it is read.

    bytes = 8 · numbers in all columns

A compressed file of a few MB may hold thousands of times its size. So the size on the disk does not say whether a log
fits into memory.
"""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Iterable
from pathlib import Path

import pyarrow as pa

from frischid.errors import InputError
from frischid.logs.bags import is_bag, message_bytes
from frischid.logs.log_file import size_of
from frischid.logs.tables import format_of

IN_MEMORY = 32 * 2**20
"""Bytes of the numbers of all logs that are read as a whole; beyond, logs are read chunk by chunk."""
MOST_BYTES = 2 * 2**30
"""Bytes. A log of more numbers is not read as a whole."""


def content_bytes(path: Path) -> int:
    """Bytes that the numbers of a file need, at least its size; a file that is damaged is found when it is read."""
    size = size_of(path) if path.exists() else 0
    try:
        if is_bag(path):
            return max(size, message_bytes(path))
        found = format_of(path)
        return size if found is None else max(size, found.content_bytes(path))
    except (InputError, OSError, ValueError, pa.ArrowException, zipfile.BadZipFile, zlib.error, NotImplementedError):
        return size


def fits_in_memory(paths: Iterable[Path]) -> bool:
    """Whether logs are small enough together to be read as a whole, for commands that can read them in chunks."""
    return sum(content_bytes(path) for path in paths) <= IN_MEMORY


def check_size(path: Path) -> None:
    """Refuse (InputError) a file whose numbers are too many to be read as a whole."""
    if (size := content_bytes(path)) > MOST_BYTES:
        raise InputError(
            f"{path}: holds {size / 2**30:.1f} GiB of numbers, and at most {MOST_BYTES / 2**30:g} GiB are read as a "
            "whole; cut the log into shorter files, or give it to identify, compare, diagnose or report "
            "(frischid.Recording.open in Python), which read it in chunks"
        )
