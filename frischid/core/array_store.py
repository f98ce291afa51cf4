"""Arrays that are read again and again: in memory while they are small together, otherwise in a temporary file.

A diagnosis reads its filtered samples dozens of times, and so does an errors-in-variables estimate with its corrected
states (`frischid.diagnosis` and `frischid.estimators.errors_in_variables` use this module). Computing these arrays
again would mean to read and prepare the logs each time. A temporary file is read nearly at the speed of memory and
returns the same bits, so results do not depend on the place of an array.

Why not ``numpy.memmap``: each mapped array holds a file descriptor (the 1018th of 1024 fails), its pages count as
memory of the process, and reading 2000 arrays of 96 kB takes 0.20 s instead of 0.05 s. Why not Arrow: its files must be
complete before they are read, and no array in them can be replaced.
"""

from __future__ import annotations

import os
import tempfile
import threading
import weakref
from array import array
from dataclasses import dataclass
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

LIMIT = 64 * 2**20
"""Bytes of a store's arrays that stay in memory."""

Values = NDArray[Any]


class Store:
    """Place for arrays, in memory or in a temporary file.

    Parameters
    ----------
    limit : int, optional
        Bytes that stay in memory, `LIMIT` by default. Later arrays go to a file without a name, which disappears with
        the store, or when the process ends in any way.

    Examples
    --------
    >>> import numpy as np
    >>> from frischid.core.array_store import Store
    >>> kept = Store(limit=0).put(np.arange(3.0))  # no byte in memory
    >>> kept.read()
    array([0., 1., 2.])
    """

    def __init__(self, limit: int | None = None) -> None:
        self.left = LIMIT if limit is None else limit
        self.written = 0
        self._file: IO[bytes] | None = None
        self._lock = threading.Lock()

    def takes(self, size: int) -> bool:
        """Whether `size` more bytes may stay in memory; if so, they are counted."""
        with self._lock:
            if size > self.left:
                return False
            self.left -= size
            return True

    def put(self, x: Values) -> Stored:
        """Keep an array."""
        if self.takes(x.nbytes):
            return Stored(x.shape, x.dtype, _own(x))
        with self._lock:
            if self._file is None:
                self._file = tempfile.TemporaryFile(prefix="frischid-", buffering=0)  # noqa: SIM115 (open as long as the store)
                weakref.finalize(self, self._file.close)
            place, self.written = self.written, self.written + x.nbytes
        self.write(x, place)
        return Stored(x.shape, x.dtype, None, self, place)

    def write(self, x: Values, place: int) -> None:
        """Put an array at a place of the file."""
        assert self._file is not None  # the place was given by `put`
        view = _bytes(np.ascontiguousarray(x))
        done = 0
        while done < len(view):
            done += os.pwrite(self._file.fileno(), view[done:], place + done)

    def read(self, shape: tuple[int, ...], dtype: np.dtype[Any], place: int) -> Values:
        """An array from the file."""
        assert self._file is not None  # the array was written before
        out = np.empty(shape, dtype)
        view = _bytes(out)
        done = 0
        while done < len(view):
            got = os.preadv(self._file.fileno(), [view[done:]], place + done)
            if not got:
                raise OSError(
                    "a temporary file became shorter while frischid read it; free space in the folder of temporary "
                    "files (TMPDIR), and start again"
                )
            done += got
        return out


@dataclass(eq=False, slots=True)
class Stored:
    """One array, in memory or in the file of a store."""

    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    held: Values | None
    store: Store | None = None
    place: int = 0

    def read(self) -> Values:
        """The array; the caller must not change it."""
        if self.held is not None:
            return self.held
        assert self.store is not None  # an array is either in memory or in the file
        return self.store.read(self.shape, self.dtype, self.place)

    def replace(self, x: Values) -> None:
        """Replace the array by another one of the same shape and type."""
        if self.held is not None:
            self.held = _own(x)
        elif self.store is not None:
            self.store.write(x, self.place)


class Series:
    """A sequence of arrays (n, ...) of a store that differ in n only: 16 bytes of memory per array in the file.

    A diagnosis has thousands of arrays of every motion; a `Stored` for each would need more memory than many logs.
    """

    def __init__(self, store: Store) -> None:
        self._store = store
        self._held: dict[int, Values] = {}
        self._length, self._place = array("q"), array("q")
        self._form: tuple[tuple[int, ...], np.dtype[Any]] = (), np.dtype(float)

    def __len__(self) -> int:
        return len(self._length)

    def append(self, x: Values) -> None:
        """Append an array."""
        kept = self._store.put(x)
        if kept.held is not None:
            self._held[len(self)] = kept.held
        self._form = x.shape[1:], x.dtype
        self._length.append(len(x))
        self._place.append(kept.place)

    def __getitem__(self, number: int) -> Values:
        """Array number `number`; the caller must not change it."""
        if number in self._held:
            return self._held[number]
        shape, dtype = self._form
        return self._store.read((self._length[number], *shape), dtype, self._place[number])


def _own(x: Values) -> Values:
    """The array as a file would return it: in C order and not a view, which would keep the whole viewed array."""
    return x if x.base is None and x.flags.c_contiguous else np.array(x, order="C")


def _bytes(x: Values) -> memoryview:
    return x.reshape(-1).view(np.uint8).data
