"""Results that are kept beside the object they were computed from, so that the same work is not done twice.

    f(x, key)  is computed once, while x lives and the key is among the last few

The studio fits the same logs again after every click. The samples of a log never change, so what follows from them
alone is the same at every step. A result lives no longer than its object, and an object keeps the results of its last
few keys only.
"""

from __future__ import annotations

import threading
import weakref
from collections.abc import Callable, Hashable
from typing import Any, Generic, TypeVar

Result = TypeVar("Result")
KEYS_KEPT = 2


class Remembered(Generic[Result]):
    """Results of one function of an object and a key.

    Equal objects are still two objects here, and an object must not change.

    Examples
    --------
    >>> from frischid.core.remembered import Remembered
    >>> class Curve: ...
    >>> lengths, curve = Remembered[int](), Curve()
    >>> lengths.of(curve, "fine", lambda: 3), lengths.of(curve, "fine", lambda: 1 // 0)
    (3, 3)
    """

    def __init__(self) -> None:
        self._kept: weakref.WeakKeyDictionary[Any, dict[Hashable, Result]] = weakref.WeakKeyDictionary()
        self._lock = threading.Lock()

    def of(self, what: object, key: Hashable, compute: Callable[[], Result]) -> Result:
        """The result for an object and a key; computed if it is not known. An error is not kept."""
        with self._lock:
            results = self._kept.get(what, {})
            if key in results:
                return results[key]
        found = compute()  # two threads may both compute it; the result is the same
        with self._lock:
            results = self._kept.setdefault(what, {})
            results[key] = found
            while len(results) > KEYS_KEPT:
                del results[next(iter(results))]
        return found
