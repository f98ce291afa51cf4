"""The file behind a log: where it lies, and how a path from a model file is checked before the file is read.

A model remembers the files it was fitted to by path, size and hash. A model file may come from anybody, and so may the
paths in it. `difference` looks at such a path without trusting it: only a regular file (or the folder of a ROS 2 bag)
of the recorded size, with a suffix of a log, is opened; it is hashed, and nothing is taken from it unless the hash is
the recorded one. Devices, pipes and sockets are never opened.
"""

from __future__ import annotations

import hashlib
import os
import stat
from dataclasses import dataclass
from pathlib import Path

BLOCK = 1 << 20
"""Bytes hashed at a time."""
MOST_MAPPING_BYTES = 1 << 20
"""Bytes. A mapping file is some lines of text; a larger one is none."""


@dataclass(frozen=True)
class StoredFile:
    """A file as it was when it was read."""

    path: str
    sha256: str
    bytes: int
    """Its size; of a folder, that of its files together."""


@dataclass(frozen=True)
class LogFile:
    """The file of a log, and the mapping file that explained its columns, if there was one."""

    path: str
    bytes: int
    mapping: StoredFile | None = None


def parts_of(path: Path) -> list[Path]:
    """The files behind a path: itself; of the folder of a bag, its files in the order of their names."""
    return sorted(p for p in path.iterdir() if p.is_file()) if path.is_dir() else [path]


def size_of(path: Path) -> int:
    """Bytes of a file; of a folder, of its files together."""
    return sum(part.stat().st_size for part in parts_of(path))


def difference(stored: StoredFile, suffixes: tuple[str, ...]) -> str:
    """Say why a path does not lead to the stored file any more; empty where it does.

    Parameters
    ----------
    stored : StoredFile
        As somebody's file claims it.
    suffixes : tuple of str
        Of the files that may be opened, in lower case.
    """
    path = Path(stored.path)
    try:
        bag = path.is_dir() and (path / "metadata.yaml").is_file()
        if not bag and path.suffix.lower() not in suffixes:
            return "its name is not that of a log"
        parts = parts_of(path) if bag else [path]
        states = [part.stat() for part in parts]
        if not all(stat.S_ISREG(state.st_mode) for state in states):
            return "it is no regular file"
        if sum(state.st_size for state in states) != stored.bytes:
            return "its size is another one now"
        return "" if _digest(parts) == stored.sha256 else "its content is another one now (the hash differs)"
    except FileNotFoundError:
        return "there is no such file"
    except (OSError, ValueError) as error:  # ValueError: a null character in the path
        return f"it cannot be read ({getattr(error, 'strerror', None) or 'its path is no path'})"


def _digest(parts: list[Path]) -> str:
    """Hash of files one after the other; a file that turns into a device meanwhile is not waited for."""
    digest = hashlib.sha256()
    for part in parts:
        descriptor = os.open(part, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
        with os.fdopen(descriptor, "rb") as file:
            if not stat.S_ISREG(os.fstat(descriptor).st_mode):
                raise OSError(0, "no regular file")
            while block := file.read(BLOCK):
                digest.update(block)
    return digest.hexdigest()
