"""Arrays that are read again and again: in memory while there are few, beyond that in a temporary file.

A diagnosis goes through its filtered rows some dozens of times. Making them anew would mean reading and preparing the
logs each time; a file of them is smaller than the logs they come from, is read at the speed of memory, and gives back
what was written, bit by bit. So results do not depend on where an array is.
"""

from __future__ import annotations

import os
import tempfile
import threading
import weakref
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from frischid.gram import Array

LIMIT = 64 * 2**20
"""Bytes of all arrays of a store together that stay in memory."""


class Store:
    """Where arrays are put.

    Parameters
    ----------
    limit : int, optional
        Bytes that stay in memory, `LIMIT` by default; what comes later goes to a file without a name, gone with the
        store.
    """

    def __init__(self, limit: int | None = None) -> None:
        self.left = LIMIT if limit is None else limit
        self.written = 0
        self._file: int | None = None
        self._lock = threading.Lock()

    def takes(self, size: int) -> bool:
        """Whether so many bytes more may stay in memory; if so they count."""
        with self._lock:
            if size > self.left:
                return False
            self.left -= size
            return True

    def put(self, x: Array) -> Stored:
        """Keep an array."""
        if self.takes(x.nbytes):
            # not a view, which would keep all of what it looks into
            return Stored(x.shape, x if x.base is None else x.copy())
        with self._lock:
            if self._file is None:
                self._file, path = tempfile.mkstemp(prefix="frischid-")
                Path(path).unlink()
                weakref.finalize(self, os.close, self._file)
            place, self.written = self.written, self.written + x.nbytes
        view = _bytes(np.ascontiguousarray(x))
        done = 0
        while done < len(view):
            done += os.pwrite(self._file, view[done:], place + done)
        return Stored(x.shape, None, self, place)

    def read(self, shape: tuple[int, ...], place: int) -> Array:
        """An array from the file."""
        assert self._file is not None  # it was written
        out = np.empty(shape)
        view = _bytes(out)
        done = 0
        while done < len(view):
            got = os.preadv(self._file, [view[done:]], place + done)
            if not got:
                raise OSError("a temporary file has become shorter while it was read")
            done += got
        return out


@dataclass(frozen=True, eq=False)
class Stored:
    """One array, in memory or in the file of a store."""

    shape: tuple[int, ...]
    held: Array | None
    store: Store | None = None
    place: int = 0

    def read(self) -> Array:
        """The array itself; not to be written to."""
        if self.held is not None:
            return self.held
        assert self.store is not None  # it is either held or written
        return self.store.read(self.shape, self.place)


def _bytes(x: Array) -> memoryview:
    return x.reshape(-1).view(np.uint8).data
