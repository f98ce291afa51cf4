"""Arrays that are read again and again: in memory while there are few, beyond that in a temporary file.

A diagnosis goes through its filtered rows some dozens of times. Making them anew would mean reading and preparing the
logs each time; a file of them is smaller than the logs they come from, is read at the speed of memory, and gives back
what was written, bit by bit. So results do not depend on where an array is.
"""

from __future__ import annotations

import os
import tempfile
import threading
from dataclasses import dataclass
from typing import IO

import numpy as np

from frischid.gram import Array

LIMIT = 64 * 2**20
"""Bytes of all arrays of a store together that stay in memory."""


class Store:
    """Where arrays are put.

    Parameters
    ----------
    limit : int
        Bytes that stay in memory; what comes later goes to a file without a name, gone with the process.
    """

    def __init__(self, limit: int | None = None) -> None:
        self.left = LIMIT if limit is None else limit
        self._file: IO[bytes] | None = None
        self._end, self._lock = 0, threading.Lock()

    def takes(self, size: int) -> bool:
        """Whether so many bytes more may stay in memory; if so they count."""
        if size > self.left:
            return False
        self.left -= size
        return True

    def put(self, x: Array) -> Stored:
        """Keep an array."""
        if self.takes(x.nbytes):
            return Stored(x.shape, held=x)
        data = np.ascontiguousarray(x, dtype=np.float64)
        with self._lock:
            if self._file is None:
                self._file = tempfile.TemporaryFile(buffering=0)
            place, self._end = self._end, self._end + data.nbytes
            self._file.seek(place)
            view = memoryview(data).cast("B") if data.size else memoryview(b"")
            while view:
                view = view[self._file.write(view) :]
        return Stored(x.shape, file=self._file, place=place)


@dataclass(frozen=True, eq=False)
class Stored:
    """One array, in memory or in the file."""

    shape: tuple[int, ...]
    held: Array | None = None
    file: IO[bytes] | None = None
    place: int = 0

    def read(self) -> Array:
        """The array itself; not to be written to."""
        if self.held is not None:
            return self.held
        out = np.empty(self.shape)
        assert self.file is not None  # it is either held or written
        view, place = memoryview(out).cast("B") if out.size else memoryview(b""), self.place
        while view:
            got = os.preadv(self.file.fileno(), [view], place)
            if not got:
                raise OSError("the temporary file of a diagnosis has become shorter")
            view, place = view[got:], place + got
        return out
